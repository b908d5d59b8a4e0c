"""Many logs of machines by a Lagrangian, perfect or with one fault, and what `identify` says of each.

A draw is a machine, a motion and noise of its own. Everything that is counted is known from the making of the log.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.stats import chi2

from gough_stewart.harness.identify.causes import Finding
from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.identify import identify
from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.identify.names import value_of
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray
from tests.support.machine_logs import NAMES, Course, Sensing, Swing, machine_log, random_machine

# Of legs: the machine has these, the fit believes in one value for all [N.s/m].
FRICTION = np.array([480.0, 620.0, 530.0, 590.0, 500.0, 580.0])
# Hypotheses that say what was done to the log, by fault, and the true values of their parameters.
NAMED: dict[str, tuple[str, FloatArray]] = {
    "gain of leg 1": ("gain of leg 1", np.array([1.02])),
    "forces late by 2 ms": ("delay of forces", np.array([2e-3])),
    "forces late by 0.5 ms": ("delay of forces", np.array([0.5e-3])),
    "force offsets": ("force offsets of all legs", np.array([10.0, -20.0, 30.0, -40.0, 25.0, -15.0])),
    "base tilted": ("tilt of the base", np.radians([0.5, 0.0])),
    "unequal friction": ("viscous friction of each leg", FRICTION),
}
# Hypotheses that must be named or listed.
LISTED = {"joints off": "joints", "length offsets": "offset of lengths"}
FAULTS = ("common gain", *NAMED, *LISTED)


@dataclass(frozen=True)
class Draw:
    """One log to be made and identified."""

    kind: str  # "perfect", "coloured", or a fault
    machine: int
    noise: int
    duration: float = 10.0
    force_noise: float = 0.01


def draws(perfect: int, machines: int, faults: int, coloured: int) -> Iterator[Draw]:
    """All draws: a fifth of the perfect logs is 20 s long, half has a tenth of the noise."""
    for k in range(perfect):
        machine = k * machines // perfect
        yield Draw("perfect", machine, k, 20.0 if machine % 5 == 4 else 10.0, (0.01, 0.001)[(k + machine) % 2])
    for kind, number in [("coloured", coloured), *((fault, faults) for fault in FAULTS)]:
        for k in range(number):
            yield Draw(kind, 2000 + k, 2000 + k)


def run(draw: Draw) -> dict[str, Any]:
    """What `identify` says of a draw, as plain data."""
    machine, believed, log = _log(draw)
    found = identify(log, believed, NAMES)
    truth = np.array([value_of(machine, name) for name in found.names])
    inside = (found.interval[:, 0] < truth) & (truth < found.interval[:, 1])
    diagnosis = found.diagnosis
    assert diagnosis is not None
    return {
        "kind": draw.kind,
        "machine": draw.machine,
        "noise": draw.force_noise,
        "duration": draw.duration,
        "alarm": diagnosis.alarm,
        "p_value": diagnosis.test.combined if diagnosis.test else None,
        "inside": inside.tolist(),
        "named": diagnosis.findings[0].name if diagnosis.findings else None,
        "listed": [each.name for each in diagnosis.findings],
        "texts": " ".join(diagnosis.sentences),
        "gain_error": diagnosis.common_gain.standard_error if diagnosis.common_gain else None,
        "mass": [float(v) for v in _mass(found, machine)],
        **_truth(draw.kind, diagnosis.findings),
    }


def _mass(found: Estimate, machine: Platform) -> tuple[float, float, float]:
    """Relative error of the mass, its standard error, and that with the gain unknown."""
    k = found.names.index("platform_mass")
    assert found.diagnosis is not None
    common = found.diagnosis.common_gain
    own = found.standard_errors[k]
    wide = own
    if common is not None and "platform_mass" in common.names:
        wide = common.standard_errors[common.names.index("platform_mass")]
    true = machine.platform_mass
    return (found.values[k] - true) / true, own / true, wide / true


def _truth(kind: str, findings: Sequence[Finding]) -> dict[str, Any]:
    """Whether the truth is in the intervals of the named hypothesis: each element's, and the joint 95 % region."""
    if kind not in NAMED or not findings or findings[0].name != NAMED[kind][0]:
        return {"each_inside": None, "jointly_inside": None, "distance": None}
    first, truth = findings[0], NAMED[kind][1]
    inside = (first.interval[:, 0] < truth) & (truth < first.interval[:, 1])
    error = first.values - truth
    distance = float(chi2.sf(error @ np.linalg.pinv(first.covariance, rcond=1e-12) @ error, len(truth)))
    return {"each_inside": inside.tolist(), "jointly_inside": distance > 0.05, "distance": distance}


@lru_cache(maxsize=4)
def _machine(seed: int) -> tuple[Platform, Platform]:
    return random_machine(seed)


def _log(draw: Draw) -> tuple[Platform, Platform, Log]:
    machine, believed = _machine(draw.machine)
    course = Course(Swing(seed=draw.machine), draw.duration)
    sensing = Sensing(force_noise=draw.force_noise)
    match draw.kind:
        case "common gain":
            sensing = replace(sensing, force_gain=1.02)
        case "gain of leg 1":
            sensing = replace(sensing, force_gain=(1.02, 1.0, 1.0, 1.0, 1.0, 1.0))
        case "forces late by 2 ms" | "forces late by 0.5 ms":
            sensing = replace(sensing, delay=float(NAMED[draw.kind][1][0]))
        case "force offsets":
            sensing = replace(sensing, force_offset=tuple(NAMED[draw.kind][1].tolist()))
        case "length offsets":
            sensing = replace(sensing, length_offset=(1e-3, -1e-3, 0.5e-3, 1e-3, -0.7e-3, -1e-3))
        case "base tilted":
            course = replace(course, base_tilt=tuple(NAMED[draw.kind][1].tolist()))
        case "joints off":
            course = replace(course, joints=1e-3, joints_seed=draw.machine)
        case "coloured":
            sensing = replace(sensing, coloured=2.0)
        case "unequal friction":
            mean = float(FRICTION.mean())
            machine = replace(machine, leg_viscous_friction=mean, leg_viscous_friction_factor=FRICTION / mean)
    return machine, believed, machine_log(machine, course, sensing, seed=draw.noise)


@dataclass(frozen=True)
class Row:
    """A figure of the campaign against what was asked."""

    what: str
    measured: float
    asked: tuple[float, float]
    of: int

    @property
    def holds(self) -> bool:
        """Whether the figure is in its range."""
        return self.asked[0] <= self.measured <= self.asked[1]

    def __str__(self) -> str:
        low, high = self.asked
        said = f"{self.what}: {100 * self.measured:.1f} % of {self.of}; asked {100 * low:g} to {100 * high:g} %"
        return said + ("" if self.holds else "  MISSED")


def rows_of(results: Sequence[dict[str, Any]]) -> list[Row]:
    """The figures, in the order of the table."""
    rows = []
    found, right = 0.95, 0.90
    perfect = [each for each in results if each["kind"] == "perfect"]
    if perfect:
        rows.append(Row("alarms of perfect logs", _share(perfect, "alarm"), (0.035, 0.065), len(perfect)))
        inside = [v for each in perfect for v in each["inside"]]
        rows.append(Row("coverage of 95 % intervals", float(np.mean(inside)), (0.94, 0.96), len(inside)))
    coloured = [each for each in results if each["kind"] == "coloured"]
    if coloured:
        unnamed = float(np.mean([each["alarm"] and each["named"] != "coloured noise" for each in coloured]))
        rows.append(Row("coloured noise, alarms that do not name it", unnamed, (0.0, 0.1), len(coloured)))
    for fault in FAULTS:
        some = [each for each in results if each["kind"] == fault]
        if not some:
            continue
        needed = (0.0, 1.0) if fault == "common gain" else (found, 1.0)
        rows.append(Row(f"{fault}, alarms", _share(some, "alarm"), needed, len(some)))
        if fault in NAMED:
            named = float(np.mean([each["named"] == NAMED[fault][0] for each in some]))
            rows.append(Row(f"{fault}, named first", named, (found, 1.0), len(some)))
            jointly = float(np.mean([bool(each["jointly_inside"]) for each in some]))
            rows.append(Row(f"{fault}, truth in the 95 % region of the named", jointly, (right, 1.0), len(some)))
        if fault in LISTED:
            listed = [LISTED[fault] in each["listed"] and "calibrate by poses" in each["texts"] for each in some]
            rows.append(Row(f"{fault}, in the list", float(np.mean(listed)), (found, 1.0), len(some)))
    return rows


def _share(results: Sequence[dict[str, Any]], key: str) -> float:
    return float(np.mean([bool(each[key]) for each in results]))
