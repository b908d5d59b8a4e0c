"""The comparisons of the formulations: each sees a disturbance of its own quantity; cases of other platforms."""

from dataclasses import replace

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.paper.open_loop import Trajectory, agreement, run_kane, run_kernel, run_stepping
from gough_stewart.harness.paper.readings import other_readings
from gough_stewart.model import interface
from gough_stewart.model.formulations.cases import OpenLoopCase, case_of, paper_case
from tests.support.arrays import FloatArray
from tests.support.uneven import INPUTS, STATE, UNEVEN

CASE = OpenLoopCase("uneven *case*", UNEVEN, STATE, INPUTS.actuator_force, 0.05)


def disturbed(run: Trajectory, columns: tuple[str, ...], change: FloatArray) -> Trajectory:
    """The run with results multiplied by 1 + change (n,)."""
    results = run.results.copy()
    at = [k for k, name in enumerate(interface.RESULT_COLUMNS) if name.partition("[")[0] in columns]
    results[:, at] *= 1 + change[:, None]
    return replace(run, results=results)


def test_each_comparison_measures_what_it_names() -> None:
    """Expected: a disturbance of known size in one of the runs appears in its own row, and is 0 elsewhere."""
    kernel, kane, stepping, leap = run_kernel(CASE), run_kane(CASE), run_stepping(CASE), run_stepping(CASE, rows=False)
    wrong = kernel.states.copy()
    wrong[-1, 5] += 4e-4
    units = {"good FMU": kernel.states, "wrong FMU": wrong}
    rows = agreement(CASE, kernel, kane, stepping, leap, units)
    assert [row.holds for row in rows] == [True] * 10 + [False]
    assert (rows[10].what, rows[10].bound) == ("final pose: wrong FMU (tolerance 1e-8) against kernel", 1e-6)
    assert rows[10].measured == pytest.approx(4e-4, rel=1e-6)
    assert not replace(rows[0], measured=float("nan")).holds
    # the columns of the pose: the fourth is an angle, the second a position, negative and positive
    moved = [stepping.copy(), leap.copy()]
    moved[0][-1, 3] -= 3e-3
    moved[1][-1, 1] += 5e-3
    moved[0][:-1], moved[0][-1, 6:], moved[1][0] = 9.0, 9.0, 9.0
    position = kane.configuration.position.copy()
    position[-1, 2] -= 7e-3
    position[:-1] += 1.0
    changed = replace(kane, configuration=kane.configuration._replace(position=position))
    found = agreement(CASE, kernel, changed, moved[0], moved[1])
    assert [found[k].measured for k in (4, 5, 6)] == pytest.approx([7e-3, 3e-3, 5e-3], rel=1e-3)
    assert [found[k].measured for k in (0, 1, 2, 3, 7, 8)] == [rows[k].measured for k in (0, 1, 2, 3, 7, 8)]
    # the largest difference over the largest value of any row, each a norm over all components
    once = np.where(np.arange(101) == 17, 1e-3, 0.0)
    for columns, at in ((("joint_force",), (3, 7)), (("acceleration", "angular_acceleration"), (0, 1, 2))):
        size = np.linalg.norm(np.concatenate([kernel[c].reshape(101, -1) for c in columns], axis=1), axis=1)
        scale = (size * (1 + once)).max()
        for k, row in enumerate(agreement(CASE, disturbed(kernel, columns, once), kane, stepping, leap)):
            if k in at:
                assert row.measured == pytest.approx(1e-3 * size[17] / scale, rel=1e-4), row
            elif k < 4 or k == 7:
                assert row.measured == rows[k].measured
    # energy: the largest of |W| and T is the scale; all kinetic energies too large by 0.1 % are what they gain
    lost = kernel.friction_work + np.where(np.arange(101) == 40, 0.01, 0.0)
    work = (kernel["leg_length"] - kernel["leg_length"][0]) @ CASE.actuator_force - kernel.friction_work
    kinetic = kernel["kinetic_energy"]
    heavy = disturbed(kernel, ("kinetic_energy",), np.full(101, 1e-3))
    for run, gap in ((replace(kernel, friction_work=lost), 0.01), (heavy, 1e-3 * np.abs(kinetic - kinetic[0]).max())):
        row = agreement(CASE, run, kane, stepping, leap)[8]
        assert row.measured == pytest.approx(gap / max(np.abs(work).max(), kinetic.max()), rel=2e-3)
    # no weight, no forces, no work: the kinetic energy is the scale
    free = {"gravity": np.zeros(3), "leg_coulomb_friction": 0.0, "leg_viscous_friction": 0.0}
    case = replace(case_of(replace(gs.load_preset("motion_base"), **free)), duration=0.02)  # type: ignore[arg-type]
    rows = agreement(case, run_kernel(case), run_kane(case), run_stepping(case), run_stepping(case, rows=False))
    assert rows[8].holds


def test_another_platform_gets_the_case_scaled_to_its_size() -> None:
    """Expected, by Froude's rule: lengths λ, masses λ³, inertias λ⁵, times √λ, forces λ³; odd legs 55/49.5 of even."""
    scale, p = 0.25, replace(gs.load_preset("liu2000"), platform_mass=14.0, leg_armature=3.0)
    powers = {1: ("base_points", "platform_points", "home_position", "leg_lower_com", "leg_upper_com"),
              3: ("platform_mass", "leg_lower_mass", "leg_upper_mass", "leg_armature"),
              5: ("platform_inertia", "leg_lower_inertia", "leg_upper_inertia")}  # fmt: skip
    changed = {name: getattr(p, name) * scale**power for power, names in powers.items() for name in names}
    large, small = case_of(p), case_of(replace(p, name="small", **changed))
    assert not small.is_published
    assert small.duration == pytest.approx(np.sqrt(scale))
    assert np.allclose(small.actuator_force, large.actuator_force * scale**3, rtol=1e-12)
    assert np.allclose(large.actuator_force[::2] / large.actuator_force[1::2], 55 / 49.5, rtol=1e-6)
    end, expected = run_kernel(small).states[-1], run_kernel(large).states[-1]
    assert np.allclose(end[:3], expected[:3] * scale, atol=1e-9)
    assert np.allclose(end[3:6], expected[3:6], atol=1e-9)
    assert case_of(replace(gs.load_preset("liu2000"), name="mine", source="me")).is_published


def test_the_other_order_is_the_same_mechanism_with_renamed_legs_and_as_far_away() -> None:
    """Expected: swapping the forces instead of the legs gives the same motion; readings start from their own order."""
    case = paper_case()
    swapped = run_kernel(replace(case, actuator_force=case.actuator_force[[1, 0, 3, 2, 5, 4]]))
    assert np.allclose(run_kernel(paper_case(minus_first=True)).states, swapped.states, atol=1e-11)
    order = next(row for row in other_readings(minus_first=True) if row.point.startswith("order"))
    change = np.abs(swapped.states - run_kernel(case).states)[-1]
    assert (order.decided, order.other) == ("− first", "+ first")
    assert order.position_change == pytest.approx(change[:3].max(), rel=1e-6)


def test_a_case_that_the_plant_cannot_pass_says_which_quantity_when() -> None:
    with pytest.raises(gs.StepError, match="singular pose"):
        run_stepping(replace(paper_case(), actuator_force=np.full(6, -200.0)))
