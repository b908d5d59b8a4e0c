"""Agreement of the formulations: measured differences with their bounds."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gough_stewart.harness.paper.open_loop import Trajectory
from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.formulations import kane, newton_euler
from gough_stewart.model.formulations.cases import OpenLoopCase
from gough_stewart.model.formulations.kane import KaneTrajectory
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True)
class Row:
    """One comparison."""

    what: str
    measured: float
    bound: float
    unit: str

    @property
    def holds(self) -> bool:
        """Whether the difference is within its bound; false for NaN."""
        return bool(self.measured <= self.bound)


def agreement(
    case: OpenLoopCase, kernel: Trajectory, kane_run: KaneTrajectory, stepping: FloatArray, leap: FloatArray
) -> list[Row]:
    """All comparisons of an open-loop case; `stepping` took many communication steps, `leap` one."""
    return [
        *instantaneous(case, kernel),
        Row(
            "final pose: Kane's DAE (RK45, rtol 1e-10) against kernel (DOP853, 1e-12)",
            float(np.abs(kane_run.platform.to_vector()[-1, :6] - kernel.states[-1, :6]).max()),
            1e-8,
            "m, rad",
        ),
        *(
            Row(
                f"final pose: stepping model (tolerance 1e-8, {how}) against kernel",
                float(np.abs(states[-1, :6] - kernel.states[-1, :6]).max()),
                1e-6,
                "m, rad",
            )
            for how, states in (("a step a row", stepping), ("one step", leap))
        ),
        Row(
            "joint forces along the run: multipliers of Kane's DAE against task space",
            _relative(kane_run.joint_force, kernel["joint_force"]),
            1e-6,
            "relative",
        ),
        Row(
            "energy minus work of the forces, largest over the run",
            energy_error(case, kernel),
            1e-9,
            "relative",
        ),
    ]


def of_fmus(case: OpenLoopCase, kernel: Trajectory, runs: Mapping[str, FloatArray]) -> list[Row]:
    """Final poses of the FMU's runs, by importer."""
    return [
        Row(
            f"final pose: {how} (tolerance 1e-8) against kernel",
            float(np.abs(states[-1, :6] - kernel.states[-1, :6]).max()),
            1e-7 if case.is_published else 1e-6,
            "m, rad",
        )
        for how, states in runs.items()
    ]


def instantaneous(case: OpenLoopCase, kernel: Trajectory) -> list[Row]:
    """Platform accelerations and joint forces at the states of a run, by four formulations."""
    platform, state = case.platform, State.from_vector(kernel.states)
    n = len(kernel.time)
    inputs = Inputs(*(np.broadcast_to(part, (n, *part.shape)) for part in case.inputs))
    by_kernel = np.concatenate([kernel["acceleration"], kernel["angular_acceleration"]], axis=-1)

    task, _ = plant_equations(IDEAL, platform, kernel.states, inputs)
    R = matrix_from_orientation(state.orientation)
    configuration, y = kane.consistent_start(platform, state)
    by_kane = kane.solve(platform, configuration, y, inputs.actuator_force)
    by_newton = newton_euler.solve(platform, state.position, R, state.velocity, state.angular_velocity, *inputs)
    accelerations = {
        "task space (NumPy)": task[:, 6:],
        "Kane": by_kane.platform_acceleration,
        "Newton–Euler": np.concatenate([by_newton.linear, by_newton.angular], axis=-1),
    }
    rows = [
        Row(f"platform acceleration: {name} against kernel", _relative(a, by_kernel), 1e-10, "relative")
        for name, a in accelerations.items()
    ]
    forces = _relative(by_newton.joint_force, kernel["joint_force"])
    return [*rows, Row("joint forces: Newton–Euler against kernel", forces, 1e-10, "relative")]


def energy_error(case: OpenLoopCase, run: Trajectory) -> float:
    """Largest |E(t) − E(0) − W(t)| over the larger of max |W| and max T.

    W = Σ F_i (L_i(t) − L_i(0)) less the work lost in friction, T the kinetic energy.
    """
    energy = run["kinetic_energy"] + run["potential_energy"]
    stroke = run["leg_length"] - run["leg_length"][0]
    work = stroke @ case.actuator_force - run.friction_work
    scale = max(np.abs(work).max(), run["kinetic_energy"].max())
    return float(np.abs(energy - energy[0] - work).max() / scale)


def _relative(a: FloatArray, b: FloatArray) -> float:
    """Largest |a − b| over the largest |b| of the run: rows in which friction holds the platform are nearly zero."""
    a, b = a.reshape(len(a), -1), b.reshape(len(b), -1)
    return float(np.linalg.norm(a - b, axis=1).max() / np.linalg.norm(b, axis=1).max())
