"""Agreement of the formulations: measured differences with their bounds."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gough_stewart.harness.paper.open_loop import Trajectory
from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.formulations import kane, newton_euler
from gough_stewart.model.formulations.cases import OpenLoopCase
from gough_stewart.model.formulations.kane import KaneTrajectory
from gough_stewart.model.interface import IDEAL, Inputs, State
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True)
class Agreement:
    """A difference between two formulations, with its bound."""

    what: str
    measured: float
    bound: float
    unit: str = "relative"

    @property
    def holds(self) -> bool:
        """Whether the difference is within its bound; false for NaN."""
        return bool(self.measured <= self.bound)


def agreement(
    case: OpenLoopCase,
    kernel: Trajectory,
    kane_run: KaneTrajectory,
    stepping: FloatArray,
    leap: FloatArray,
    units: Mapping[str, FloatArray] = {},
) -> list[Agreement]:
    """All comparisons of an open-loop case with the kernel's run.

    `stepping` took many communication steps, `leap` one; `units` are the states of FMUs by importer.
    """
    # accelerations and joint forces at the states of the run, by four formulations
    platform, state = case.platform, State.from_vector(kernel.states)
    n = len(kernel.time)
    inputs = Inputs(*(np.broadcast_to(part, (n, *part.shape)) for part in case.inputs))
    task, _ = plant_equations(IDEAL, platform, kernel.states, inputs)
    configuration, y = kane.consistent_start(platform, state)
    by_kane = kane.solve(platform, configuration, y, inputs.actuator_force)
    R = matrix_from_orientation(state.orientation)
    by_newton = newton_euler.solve(platform, state.position, R, state.velocity, state.angular_velocity, *inputs)
    accelerations = {
        "task space (NumPy)": task[:, 6:],
        "Kane": by_kane.platform_acceleration,
        "Newton–Euler": np.concatenate([by_newton.linear, by_newton.angular], axis=-1),
    }
    by_kernel = np.concatenate([kernel["acceleration"], kernel["angular_acceleration"]], axis=-1)
    rows = [
        Agreement(f"platform acceleration: {name} against kernel", _relative(values, by_kernel), 1e-10)
        for name, values in accelerations.items()
    ]
    forces = kernel["joint_force"]
    rows.append(Agreement("joint forces: Newton–Euler against kernel", _relative(by_newton.joint_force, forces), 1e-10))

    # final poses, forces along the run, energy
    unit_bound = 1e-7 if case.is_published else 1e-6
    poses = {
        "Kane's DAE (RK45, rtol 1e-10) against kernel (DOP853, 1e-12)": (kane_run.platform.to_vector(), 1e-8),
        "stepping model (tolerance 1e-8, a step a row) against kernel": (stepping, 1e-6),
        "stepping model (tolerance 1e-8, one step) against kernel": (leap, 1e-6),
        **{f"{name} (tolerance 1e-8) against kernel": (states, unit_bound) for name, states in units.items()},
    }
    pose = kernel.states[-1, :6]
    ends = [
        Agreement(f"final pose: {name}", float(np.abs(states[-1, :6] - pose).max()), bound, "m, rad")
        for name, (states, bound) in poses.items()
    ]
    along = _relative(kane_run.joint_force, forces)
    # largest |E(t) − E(0) − W(t)| over the larger of max |W| and max T, W = Σ F_i (L_i(t) − L_i(0)) less friction's
    energy, legs = kernel["kinetic_energy"] + kernel["potential_energy"], kernel["leg_length"]
    work = (legs - legs[0]) @ case.actuator_force - kernel.friction_work
    largest = max(np.abs(work).max(), kernel["kinetic_energy"].max())
    energy_error = float(np.abs(energy - energy[0] - work).max() / largest)
    others = [
        Agreement("joint forces along the run: multipliers of Kane's DAE against task space", along, 1e-6),
        Agreement("energy minus work of the forces, largest over the run", energy_error, 1e-9),
    ]
    return [*rows, *ends[:3], *others, *ends[3:]]


def _relative(a: FloatArray, b: FloatArray) -> float:
    """Largest |a − b| over the largest |b| of the run: rows in which friction holds the platform are nearly zero."""
    a, b = a.reshape(len(a), -1), b.reshape(len(b), -1)
    return float(np.linalg.norm(a - b, axis=1).max() / np.linalg.norm(b, axis=1).max())
