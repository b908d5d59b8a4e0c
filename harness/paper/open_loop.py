"""An open-loop case by Kane's DAE, the task-space kernel, the stepping model and the FMU, and how far these agree."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.integrate import solve_ivp

from gough_stewart.model import interface
from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.errors import StepError
from gough_stewart.model.formulations import kane, newton_euler
from gough_stewart.model.formulations.cases import OpenLoopCase
from gough_stewart.model.formulations.kane import KaneTrajectory
from gough_stewart.model.friction import friction_force
from gough_stewart.model.interface import IDEAL, Inputs, State
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.kinematics import leg_geometry, rates_of_legs
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.stepping import SteppingModel
from gough_stewart.model.vectors import Array, FloatArray

if TYPE_CHECKING:
    from gough_stewart.harness.plants.unit import FmiType


@dataclass(frozen=True)
class Trajectory:
    """States and results of a task-space run at the case's times."""

    time: FloatArray  # (n,) [s]
    states: FloatArray  # (n, 12)
    results: FloatArray  # (n, N_RESULTS), columns of `interface.RESULT_COLUMNS`
    friction_work: FloatArray  # (n,) [J], dissipated since the start

    def __getitem__(self, name: str) -> FloatArray:
        """The values of a result variable, (n, *shape)."""
        return interface.unpack(interface.RESULTS, self.results)[name]


def run_kernel(case: OpenLoopCase, rtol: float = 1e-12) -> Trajectory:
    """Integrate the kernel by DOP853, the reference of all comparisons; a StepError if it cannot continue."""
    kernel, platform = Kernel(), case.platform
    p, u, time = parameter_vector(platform), np.concatenate(case.inputs), case.time
    has_friction = platform.leg_viscous_friction != 0 or platform.leg_coulomb_friction != 0

    def derivative(_t: float, x: Array) -> Array:
        lost = 0.0
        if has_friction:
            state = State.from_vector(x[:12])
            rate = rates_of_legs(leg_geometry(platform, state.position, state.orientation), state).length_rate
            lost = float(friction_force(platform, rate) @ rate)
        return np.append(kernel.derivatives(x[:12], u, p), lost)

    solution = solve_ivp(
        derivative,
        (time[0], time[-1]),
        np.append(case.start.to_vector(), 0.0),
        method="DOP853",
        t_eval=time,
        rtol=rtol,
        atol=rtol,
        # dense output between steps is of lower order than the steps: keep steps short
        max_step=float(np.diff(time).max()),
    )
    if not solution.success:
        raise StepError("task-space kernel", float("nan"), float(solution.t[-1]), solution.message)
    states = solution.y[:12].T
    results = np.array([kernel.outputs(x, u, p).copy() for x in states])
    return Trajectory(solution.t, states, results, solution.y[12])


def run_stepping(case: OpenLoopCase, rows: bool = True) -> FloatArray:
    """States (n, 12) of the stepping model, a step for each row, or one; a StepError at a pose that it cannot pass."""
    model = SteppingModel(case.platform)
    model.set_many({**case.start._asdict(), "actuator_force": case.actuator_force})
    states = [model.state]
    times = case.time if rows else case.time[[0, -1]]
    for t, step in zip(times[:-1], np.diff(times), strict=True):
        model.do_step(float(t), float(step))
        states.append(model.state)
    return np.array(states)


def run_kane(
    case: OpenLoopCase,
    baumgarte: tuple[float, float] = (10.0, 10.0),
    rtol: float = 1e-10,
    own_steps: bool = False,
) -> kane.KaneTrajectory:
    """The paper's DAE with the method of ode45; see `kane.integrate`."""
    start = kane.consistent_start(case.platform, case.start)
    return kane.integrate(case.platform, *start, case.inputs, case.time, baumgarte, rtol, own_steps)


def run_fmu(fmu: Path, case: OpenLoopCase, fmi_type: "FmiType") -> FloatArray:
    """States (n, 12) at the case's times: one communication step per row, or FMPy's CVode with Model Exchange.

    Parameters keep the FMU's start values, those of the case's platform; the initial state and forces are set. A
    StepError has the FMU's messages; a PlantError is of a file that is no unit of the plant, or cannot run here.
    """
    import fmpy
    from fmpy.fmi1 import FMICallException

    from gough_stewart.fmu_build.plant.layout import PLANT
    from gough_stewart.harness.plants.unit import FmuInstance, UnitFile

    with UnitFile(fmu) as file, FmuInstance(file, fmi_type) as unit:
        starts, columns = dict[str, Any](), list[str]()
        for name, value in {**case.start._asdict(), "actuator_force": case.actuator_force}.items():
            elements = PLANT.by_name[name].variable.scalar_names
            starts |= dict(zip(elements, value.tolist(), strict=True)) if unit.is_fmi2 else {name: value.tolist()}
        for variable in interface.STATES:
            columns += variable.scalar_names if unit.is_fmi2 else [variable.name]
        who = f"FMI {file.version} {fmi_type}"
        try:
            result = fmpy.simulate_fmu(
                str(file.folder),
                model_description=file.description,
                fmu_instance=unit.fmu,
                fmi_type=fmi_type,
                start_values=starts,
                output=columns,
                stop_time=case.duration,
                output_interval=case.duration / (len(case.time) - 1),
                relative_tolerance=interface.DEFAULT_TOLERANCE,
            )
        except (FMICallException, RuntimeError) as error:
            reason = "; ".join(text for text in (unit.take_messages(), str(error)) if text)
            raise StepError(who, float("nan"), float("nan"), reason) from error
        if unit.messages or len(result) != len(case.time):
            raise StepError(f"{who}: rows", len(result), float(result["time"][-1]), unit.take_messages())
        return np.concatenate([np.asarray(result[column]).reshape(len(result), -1) for column in columns], axis=1)


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
