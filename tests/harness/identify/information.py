"""What a log can tell of parameters at best, by the Cramér–Rao bound, from a Lagrangian and the known noise alone.

Force readings are gain · F(t − delay) + offset + white noise of σ; an unbiased estimate of θ has a covariance of at
least (Σ_k D_kᵀ D_k)⁻¹ with D = ∂(reading)/∂θ/σ, by central differences [Kay, Fundamentals of Statistical Signal
Processing I, 1993, ch. 3]. Noise of lengths takes next to nothing from it where the motion is slow.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gough_stewart import Platform
from tests.harness.identify.machine_logs import Course, friction, place, tilted
from tests.support.arrays import FloatArray
from tests.support.lagrangian import forces_along, legs_along

# Steps of differences; readings are polynomials of low degree in all but delay and tilt.
_STEPS = {"platform_com": 1e-3, "force_gain": 1e-3, "delay": 1e-4, "base_tilt": 1e-4}


def with_changes(machine: Platform, changes: Mapping[str, float]) -> Platform:
    """A machine some elements of which differ by so much; friction of a leg is its factor times the common one."""
    for element, change in changes.items():
        stem, index = place(element)
        value: FloatArray = np.array(getattr(machine, stem), dtype=float)
        change_to: dict[str, Any] = {}
        if index and stem in ("leg_viscous_friction", "leg_coulomb_friction"):
            factors = np.array(getattr(machine, f"{stem}_factor"))
            factors[index] += change / value
            change_to[f"{stem}_factor"] = factors
            machine = replace(machine, **change_to)
            continue
        value[index] += change
        if len(index) == 2 and index[0] != index[1]:
            value[index[::-1]] += change
        change_to[stem] = value if value.ndim else float(value)
        machine = replace(machine, **change_to)
    return machine


def readings(machine: Platform, course: Course, time: FloatArray, changes: Mapping[str, float]) -> FloatArray:
    """Readings of forces (n, 6) [N] along a course, of a machine and instruments that are changed by so much."""
    of_machine = {name: v for name, v in changes.items() if place(name)[0] in Platform.__dataclass_fields__}
    changed = with_changes(machine, of_machine)
    tilt = [changes.get(f"base_tilt[{k}]", 0.0) for k in (1, 2)]
    changed = replace(changed, gravity=tilted(machine.gravity, *tilt))
    pose = course.swing.along(machine, time - changes.get("delay", 0.0), course.duration)
    force = forces_along(changed, pose) + friction(changed, course, legs_along(changed, pose)[1])
    gain = 1 + np.array([changes.get(f"force_gain[{k}]", 0.0) for k in range(1, 7)])
    offset = np.array([changes.get(f"force_offset[{k}]", 0.0) for k in range(1, 7)])
    return np.asarray(gain * force + offset, dtype=float)


def sensitivities(
    machine: Platform, course: Course, time: FloatArray, names: Sequence[str], at: Mapping[str, float]
) -> FloatArray:
    """∂(reading)/∂θ (n, 6, p) of elements, where instruments are `at` what they do."""
    columns = []
    for name in names:
        step = _STEPS.get(place(name)[0], 1.0)
        ends = [readings(machine, course, time, {**at, name: at.get(name, 0.0) + h}) for h in (step, -step)]
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.stack(columns, axis=-1)


def information(columns: FloatArray, used: Any, noise: FloatArray, readings_a_row: float) -> FloatArray:
    """Σ Dᵀ D (p, p) of rows (n, 6, p), each of which stands for so many readings, with noise (6,) [N]."""
    D = np.asarray(columns * (used / noise)[..., None]).reshape(-1, columns.shape[-1])
    return np.asarray(readings_a_row * D.T @ D, dtype=float)
