"""Trajectories of the FMU in FMPy against the kernel under SciPy's DOP853 at 1e-12, an independent integrator."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.model import interface
from gough_stewart.model.formulations.cases import OpenLoopCase, case_of, paper_case
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.kinematics import conditioning
from gough_stewart.model.stepping import SteppingModel
from tests.support.fmu_plants import OK, Fmu, Plant, plant, refused
from tests.support.random_platforms import REGULAR, random_platform
from tests.support.uneven import GAINS, UNEVEN, uneven_case

# Pose after the case, at tolerance 1e-8 of the unit [m, rad].
BOUND = 1e-7


def reference(case: OpenLoopCase) -> NDArray[np.float64]:
    """States (n, 12) by DOP853 at 1e-12."""
    kernel, p, u = Kernel(), parameter_vector(case.platform), case.inputs.to_vector()
    solution = solve_ivp(
        lambda _t, x: kernel.derivatives(x, u, p).copy(),
        (0.0, case.duration),
        case.start.to_vector(),
        method="DOP853",
        t_eval=case.time,
        rtol=1e-12,
        atol=1e-12,
        max_step=case.time[1],
    )
    assert solution.success
    return solution.y.T


def start_of(case: OpenLoopCase) -> dict[str, Any]:
    """Platform, state and inputs by name."""
    parameters = {v.name: getattr(case.platform, v.name) for v in interface.PLATFORM_PARAMETERS}
    return {**parameters, **case.start._asdict(), **case.inputs._asdict()}


def simulate(fmu: Fmu, case: OpenLoopCase, fmi_type: str, **options: Any) -> Any:
    """FMPy's own simulation loop; parameters and start values by name."""
    starts, output = dict[str, Any](), list[str]()
    for name, value in start_of(case).items():
        row, flat = PLANT.by_name[name], np.ravel(value).tolist()
        if fmu.version == "2.0":
            starts |= dict(zip(row.scalar_names, flat, strict=True))
        else:
            starts[name] = flat if row.variable.shape else flat[0]
    for name in ("position", "orientation"):
        row = PLANT.by_name[name]
        output += row.scalar_names if fmu.version == "2.0" else (name,)
    return simulate_fmu(
        str(fmu.path),
        fmi_type=fmi_type,
        start_values=starts,
        output=output,
        stop_time=case.duration,
        output_interval=case.duration / 100,
        relative_tolerance=1e-8,
        **options,
    )


def final_pose(result: Any, case: OpenLoopCase) -> NDArray[np.float64]:
    """Position and orientation at the end of a result of FMPy."""
    assert result["time"][-1] == pytest.approx(case.duration, rel=1e-12)
    return np.concatenate([np.atleast_1d(result[name][-1]) for name in result.dtype.names if name != "time"])


@pytest.mark.parametrize("case", [paper_case(), uneven_case()], ids=lambda case: case.title)
@pytest.mark.parametrize("fmi_type", ["CoSimulation", "ModelExchange"])
def test_a_case_ends_where_the_kernel_does(fmu: Fmu, fmi_type: str, case: OpenLoopCase) -> None:
    end = final_pose(simulate(fmu, case, fmi_type), case)
    assert np.abs(end - reference(case)[-1, :6]).max() <= BOUND


def regular_cases(n: int) -> list[tuple[OpenLoopCase, NDArray[np.float64]]]:
    """Random platforms whose scaled case keeps away from singular poses, with their reference."""
    rng, found = np.random.default_rng(20), list[tuple[OpenLoopCase, NDArray[np.float64]]]()
    while len(found) < n:
        case = case_of(random_platform(rng))
        states = reference(case)
        if conditioning(case.platform, states[:, :3], states[:, 3:6]).condition_number.max() < REGULAR:
            found.append((case, states))
    return found


def test_twenty_random_platforms_set_through_parameters_end_where_the_kernel_does(fmu3: Fmu, fmu2: Fmu) -> None:
    for k, (case, states) in enumerate(regular_cases(20)):
        for fmi_type in ("CoSimulation", "ModelExchange"):
            end = final_pose(simulate((fmu2, fmu3)[k % 2], case, fmi_type), case)
            assert np.abs(end - states[-1, :6]).max() <= BOUND


def test_fmpys_loop_ends_at_a_singular_pose_instead_of_repeating_the_step(fmu: Fmu) -> None:
    """Expected: as FMPy has it, results up to there in FMI 2.0 (the unit answers fmi2Terminated), else an error."""
    case = replace(paper_case(), duration=1.5)
    if fmu.version == "2.0":
        with plant(fmu) as p:
            p.start(start_of(case))
            last = 0.0
            while refused(p.step, last, 0.015) == OK:
                last += 0.015
        result = simulate(fmu, case, "CoSimulation", timeout=20.0)
        assert result["time"][-1] == pytest.approx(last)
    else:
        with pytest.raises(FMICallException, match="discard"):
            simulate(fmu, case, "CoSimulation", timeout=20.0)


def run(fmu: Fmu, step: float, n: int, values: dict[str, Any], **options: Any) -> NDArray[np.float64]:
    with plant(fmu) as p:
        p.start(values, **options)
        for k in range(n):
            p.step(k * step, step)
        return p.pose


@pytest.mark.parametrize(("step", "n"), [(0.5, 1), (0.05, 10), (5e-4, 1000), (1e-6, 100)])
def test_any_communication_step_gives_the_same_motion(fmu: Fmu, step: float, n: int) -> None:
    case = uneven_case()
    kernel, p, u = Kernel(), parameter_vector(case.platform), case.inputs.to_vector()
    end = solve_ivp(
        lambda _t, x: kernel.derivatives(x, u, p).copy(),
        (0.0, step * n),
        case.start.to_vector(),
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
    ).y[:6, -1]
    assert np.abs(run(fmu, step, n, start_of(case)) - end).max() <= BOUND


def test_a_tighter_tolerance_gives_a_smaller_error(fmu: Fmu) -> None:
    """Expected: the error of an error-controlled method falls with its tolerance, about in proportion."""
    case = uneven_case()
    end = reference(case)[-1, :6]
    errors = [np.abs(run(fmu, 0.5, 1, start_of(case), tolerance=t) - end).max() for t in (1e-5, 1e-7, 1e-9, 1e-11)]
    assert all(later < earlier / 20 for earlier, later in pairwise(errors))


def test_fixed_steps_converge_with_the_order_of_classical_runge_kutta(fmu: Fmu) -> None:
    """Expected: halving the step divides the error by 2⁴, where friction is smooth over a step."""
    case = uneven_case()
    case = replace(case, platform=replace(case.platform, leg_friction_velocity=1.0))
    end = reference(case)[-1, :6]
    errors = [
        np.abs(run(fmu, 0.1, 5, start_of(case) | {"fixed_step_size": h}) - end).max() for h in (0.02, 0.01, 0.005)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx([4.0, 4.0], abs=0.3)


def test_fixed_steps_fit_into_every_communication_step(fmu: Fmu) -> None:
    """Expected: two steps of 0.02 s are the step of 0.03 s halved, by the rule of equal steps not above the size."""
    case = uneven_case()
    coarse = run(fmu, 0.03, 1, start_of(case) | {"fixed_step_size": 0.02})
    halved = run(fmu, 0.03, 1, start_of(case) | {"fixed_step_size": 0.015})
    assert np.array_equal(coarse, halved)


@pytest.mark.parametrize("start", [0.0, 1e4, 1e6, 1e9, -1e9])
@pytest.mark.parametrize("parts", [1, 10, 100])
def test_a_communication_step_takes_as_many_fixed_steps_at_any_time(fmu3: Fmu, start: float, parts: int) -> None:
    """Expected: `parts`, as the intermediate updates count them; rounding of late times adds none."""
    seen: list[float] = []
    made: list[Plant] = []
    made.append(Plant(fmu3, intermediateUpdate=lambda *arguments: seen.append(arguments[1])))
    (p,) = made
    p.start({"fixed_step_size": 0.01 / parts, "actuator_force": [28.5] * 6}, time=start)
    for k in range(3):
        seen.clear()
        p.step(start + k * 0.01, 0.01)
        assert len(seen) == parts
    p.free()


@pytest.mark.parametrize(("start", "parts"), [(-0.1, 1), (-0.1, 3), (-0.1, 7), (0.01, 5)])
def test_the_last_fixed_step_ends_where_the_communication_step_does(fmu3: Fmu, start: float, parts: int) -> None:
    """Expected: to the last bit, with no further step for what rounding leaves.

    Of the steps from -0.1 s, start + (end - start) is less than the end.
    """
    size = 0.35000000000000003
    end = start + size
    assert (start + (end - start) < end) == (start < 0)
    seen: list[float] = []
    p = Plant(fmu3, intermediateUpdate=lambda *arguments: seen.append(arguments[1]))
    p.start(start_of(uneven_case()) | {"fixed_step_size": 1.001 * size / parts}, time=start)
    p.step(start, size)
    assert p.get("time") == end
    p.free()
    assert len(seen) == parts
    assert seen == pytest.approx(start + size * (1 + np.arange(parts)) / parts, abs=1e-15)
    assert seen[-1] == end


def test_the_communication_step_may_vary_from_call_to_call(fmu: Fmu) -> None:
    case = uneven_case()
    rng = np.random.default_rng(3)
    times = np.concatenate([[0.0], np.sort(rng.uniform(0.0, case.duration, 60)), [case.duration]])
    with plant(fmu) as p:
        p.start(start_of(case))
        for t, step in zip(times, np.diff(times), strict=False):
            p.step(t, step)
        assert np.abs(p.pose - reference(case)[-1, :6]).max() <= BOUND


def test_the_integrator_of_an_importer_converges(fmu: Fmu) -> None:
    """Expected: explicit Euler has order 1."""
    case = uneven_case()
    end, errors = reference(case)[-1, :6], []
    for n in (1000, 2000):
        with plant(fmu, co_simulation=False) as p:
            p.start(start_of(case))
            errors.append(np.abs(euler(p, case.duration, n) - end).max())
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.05)


def euler(p: Plant, duration: float, n: int) -> NDArray[np.float64]:
    """Pose after n steps, by the calls that an importer makes."""
    x, xdot = np.zeros(12), np.zeros(12)
    from ctypes import POINTER, c_double

    def pointer(v: NDArray[np.float64]) -> Any:
        return v.ctypes.data_as(POINTER(c_double))

    derivatives = p.fmu.getDerivatives if p.is_fmi2 else p.fmu.getContinuousStateDerivatives
    p.fmu.getContinuousStates(pointer(x), 12)
    for k in range(n):
        derivatives(pointer(xdot), 12)
        x += xdot * duration / n
        p.fmu.setTime((k + 1) * duration / n)
        p.fmu.setContinuousStates(pointer(x), 12)
        enter_event_mode, terminate = p.fmu.completedIntegratorStep()
        assert not enter_event_mode
        assert not terminate
    return x[:6]


def test_a_closed_loop_runs_on_fmu_and_stepping_model_alike(fmu: Fmu) -> None:
    """Expected: the stepping model, another integrator over the same kernel, under the same sampled controller."""
    model, offset = (
        SteppingModel(UNEVEN, tolerance=1e-10, integrator="scipy"),
        np.array([0.05, 0.03, 0.02, 0.06, 0.01, 0.04]),
    )
    with plant(fmu) as p:
        p.start(tolerance=1e-10)
        home = p.get("leg_length")
        for k in range(100):
            for each in (model, p):
                length, rate = np.asarray(each.get("leg_length")), np.asarray(each.get("leg_velocity"))
                each.set("actuator_force", 28.5 + GAINS * (home + offset - length) - 120 * rate)
            model.do_step(k * 0.01, 0.01)
            p.step(k * 0.01, 0.01)
        for v in interface.RESULTS:
            assert p.get(v.name) == pytest.approx(np.asarray(model.get(v.name)), rel=1e-7, abs=1e-7)
