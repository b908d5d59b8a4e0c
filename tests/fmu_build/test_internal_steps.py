"""The unit's internal steps against SciPy's RK45: the same method and controller, written by somebody else."""

import ctypes
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import RK45

from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.fmu_build.sources import library_sources
from gough_stewart.fmu_build.targets import chosen_targets
from gough_stewart.fmu_build.toolchain import compile_library
from gough_stewart.model.formulations.cases import OpenLoopCase, paper_case
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.variant import Variant
from tests.fmu_build.test_trajectories import start_of
from tests.support.fmu_plants import DISCARD, Fmu, Plant, plant, refused
from tests.support.real_platforms import real_platform
from tests.support.uneven import uneven_case


def times_by_scipy(case: OpenLoopCase, tolerance: float, end: float) -> NDArray[np.float64]:
    """Ends of the internal steps of RK45, Dormand and Prince's pair of orders 5 and 4."""
    kernel, p, u = Kernel(), parameter_vector(case.platform), case.inputs.to_vector()
    solver = RK45(
        lambda _t, x: kernel.derivatives(x, u, p).copy(),
        0.0,
        case.start.to_vector(),
        end,
        rtol=tolerance,
        atol=tolerance,
    )
    times = []
    while solver.status == "running":
        solver.step()
        times.append(solver.t)
    return np.array(times)


def times_of_unit(fmu: Fmu, values: dict[str, Any], steps: list[float], tolerance: float = 1e-8) -> list[list[float]]:
    """Ends of the internal steps of each communication step, as the intermediate updates have them."""
    seen: list[float] = []
    p = Plant(fmu, intermediateUpdate=lambda *arguments: seen.append(arguments[1]))
    p.start(values, tolerance=tolerance)
    time, found = 0.0, []
    for step in steps:
        seen.clear()
        p.step(time, step)
        time += step
        found.append(seen.copy())
    p.free()
    return found


@pytest.mark.parametrize("tolerance", [1e-4, 1e-7, 1e-10])
@pytest.mark.parametrize("case", [paper_case(), uneven_case()], ids=lambda case: case.title)
def test_the_internal_steps_are_those_of_dormand_and_prince(fmu3: Fmu, case: OpenLoopCase, tolerance: float) -> None:
    """Expected: the times of SciPy's steps, but for the last, of which the unit leaves no sliver."""
    expected = times_by_scipy(case, tolerance, case.duration)
    (found,) = times_of_unit(fmu3, start_of(case), [case.duration], tolerance)
    assert len(expected) >= 4
    assert len(found) in (len(expected), len(expected) - 1)
    assert found[-1] == case.duration
    # rounding of the error estimate, which is a small difference, moves a step by more than its share
    assert np.allclose(found[:-1], expected[: len(found) - 1], rtol=1e-4)


def test_a_sharp_friction_rejects_steps_as_scipy_does(fmu3: Fmu) -> None:
    """Expected: as above, where legs reverse and the error estimate jumps."""
    case = uneven_case()
    case = replace(case, platform=replace(case.platform, leg_friction_velocity=1e-3, leg_coulomb_friction=9.0))
    expected = times_by_scipy(case, 1e-6, case.duration)
    (found,) = times_of_unit(fmu3, start_of(case), [case.duration], 1e-6)
    assert len(found) == pytest.approx(len(expected), rel=0.03)
    assert np.allclose(found[:10], expected[:10], rtol=1e-4)


def test_a_platform_at_rest_begins_with_a_microsecond(fmu3: Fmu) -> None:
    """Expected: as Hairer has it where nothing moves, 1e-6 s, and then ten times more each."""
    case = uneven_case()
    still = replace(case.platform, gravity=np.zeros(3))
    values = start_of(replace(case, platform=still)) | dict.fromkeys(("velocity", "angular_velocity"), np.zeros(3))
    values |= {"actuator_force": np.zeros(6), "external_force": np.zeros(3), "external_torque": np.zeros(3)}
    (found,) = times_of_unit(fmu3, values, [0.5])
    sizes = np.diff([0.0, *found])
    assert sizes[0] == pytest.approx(1e-6)
    assert sizes[1:-1] == pytest.approx(10 * sizes[:-2])


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7])
def test_a_step_cut_to_end_on_time_proposes_no_less_than_before(fmu3: Fmu, share: float) -> None:
    """Expected: the larger of SciPy's first step and of its proposal after the cut one."""
    case, tolerance = uneven_case(), 1e-4
    kernel, p, u = Kernel(), parameter_vector(case.platform), case.inputs.to_vector()
    x = case.start.to_vector()
    arguments = lambda _t, x: kernel.derivatives(x, u, p).copy(), 0.0, x, 1.0, np.inf, tolerance, tolerance
    first = RK45(*arguments)
    cut = RK45(*arguments, first_step=share * first.h_abs)
    cut.step()
    h = share * first.h_abs
    assert cut.t == h
    _, second = times_of_unit(fmu3, start_of(case), [h, 0.4], tolerance)
    # the unit's first step knows that the span is short, SciPy's here does not
    assert second[0] - h == pytest.approx(max(first.h_abs, cut.h_abs), rel=1e-2)


def test_the_step_size_carries_over_a_short_communication_step(fmu3: Fmu) -> None:
    """Expected: communication steps far below the internal ones take one internal step each, long ones as before."""
    case = uneven_case()
    (whole,) = times_of_unit(fmu3, start_of(case), [0.4], 1e-5)
    first, *short, rest = times_of_unit(fmu3, start_of(case), [0.2, *[1e-4] * 20, 0.198], 1e-5)
    assert all(len(each) == 1 for each in short)
    assert len(first) + len(rest) <= len(whole) + 2


@pytest.mark.parametrize("size", [0.01, 0.013, 0.5, 1.0])
def test_fixed_steps_are_equal_and_not_above_their_size(fmu3: Fmu, size: float) -> None:
    """Expected: ⌈0.1/size⌉ steps at equal distances."""
    (found,) = times_of_unit(fmu3, start_of(uneven_case()) | {"fixed_step_size": size}, [0.1])
    n = int(np.ceil(0.1 / size))
    assert found == pytest.approx(np.linspace(0, 0.1, n + 1)[1:], rel=1e-14)
    assert found[-1] == 0.1


def test_a_fixed_step_that_ends_early_has_equal_steps_up_to_there(fmu3: Fmu) -> None:
    """Expected: asked at 0.02 s to end at 0.0512 s, four more steps of 7.8 ms, not above 10 ms."""
    seen: list[float] = []

    def update(_e: Any, time: float, _s: bool, _g: bool, _f: bool, _m: bool, wanted: Any, at: Any) -> None:
        seen.append(time)
        if time > 0.015:
            wanted[0], at[0] = True, 0.0512

    p = Plant(fmu3, intermediateUpdate=update, requiredIntermediateVariables=[0, 3], earlyReturnAllowed=True)
    p.start(start_of(uneven_case()) | {"fixed_step_size": 0.01})
    _, _, early, last = p.step(0.0, 0.2)
    end = p.pose
    p.free()
    assert early
    assert last == 0.0512
    assert seen == pytest.approx([0.01, 0.02, 0.0278, 0.0356, 0.0434, 0.0512], rel=1e-12)
    with plant(fmu3) as q:
        q.start(start_of(uneven_case()), tolerance=1e-12)
        q.step(0.0, last)
        assert end == pytest.approx(q.pose, abs=1e-7)


def test_too_many_fixed_steps_are_discarded_with_the_limit(fmu: Fmu) -> None:
    """Expected: a million in one communication step is allowed as a number, more is not."""
    with plant(fmu) as p:
        p.start({"fixed_step_size": 1e-9})
        assert refused(p.step, 0.0, 1.1e-3) == DISCARD
        assert "fixed_step_size = 1e-09 s: too small" in p.messages[-1].text
        assert "at most 1000000 steps" in p.messages[-1].text
        p.step(0.0, 1e-6)


# An equation whose state k alone is not a number after the first third of a second; the others rest.
_PROBE = """
#include <string.h>
#include "exponential.c"
const double NOMINAL_STATES[] = {[0 ... N_STATES - 1] = 1e-3};
static void derivatives(void *owner, double t, const double x[N_STATES], double xdot[N_STATES])
{
    (void)x;
    memset(xdot, 0, sizeof(double) * N_STATES);
    if (t > 1.0 / 3)
        xdot[*(int *)owner] = NAN;
}
static void decays(void *owner, const double x[N_STATES], double decay[N_LEGS])
{
    (void)owner, (void)x;
    memset(decay, 0, sizeof(double) * N_LEGS);
}
int arrive(const ode *problem, integration_point *at, double t, const double x[N_STATES], const double xdot[N_STATES],
           double *end)
{
    (void)problem, (void)xdot, (void)end;
    at->t = t;
    memcpy(at->x, x, sizeof at->x);
    return 1;
}
__attribute__((visibility("default"))) double end_of(int k)
{
    ode problem = {.owner = &k, .derivatives = derivatives, .decays = decays};
    integration_point at = {0};
    return integrate_controlled(&problem, &at, 1, 1e-6) == REACHED_END ? 1 : at.t;
}
"""


def test_no_state_that_is_not_a_number_is_accepted_in_exponential_steps(tmp_path: Path) -> None:
    """Expected: the integration ends where its equation does, whichever state has none."""
    variant = Variant(bristles=True, springs=True)
    component = plant_component(real_platform("lugre", springs=True))
    headers = {**library_sources(component).headers, "exponential.c": component.code.units["exponential.c"]}
    (target,) = chosen_targets(["native"])
    (tmp_path / "probe.so").write_bytes(compile_library("probe", {"probe.c": _PROBE}, headers, target))
    end_of = ctypes.CDLL(str(tmp_path / "probe.so")).end_of
    end_of.restype = ctypes.c_double
    for k in range(len(variant.scales)):
        assert end_of(k) == pytest.approx(1 / 3, abs=1e-6), k
