"""The paper's open-loop case: formulations agree, other platforms get a scaled case."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import fmpy
import numpy as np
import pytest

from gough_stewart import StepError, load_preset
from gough_stewart.fmu_build.build import VERSIONS
from gough_stewart.harness.paper import agreement, readings
from gough_stewart.harness.paper.open_loop import Trajectory, run_fmu, run_kane, run_kernel, run_stepping
from gough_stewart.harness.plants import unit
from gough_stewart.harness.plants.unit import FmiType, FmuInstance
from gough_stewart.model.formulations.cases import OpenLoopCase, case_of, paper_case, with_pairs_swapped
from tests.support.fmu_plants import Fmu


@pytest.fixture(scope="module")
def case() -> OpenLoopCase:
    return paper_case()


@pytest.fixture(scope="module")
def kernel_run(case: OpenLoopCase) -> Trajectory:
    return run_kernel(case)


def test_case_is_the_published_one(case: OpenLoopCase) -> None:
    """Expected: section IV of the paper."""
    assert case.duration == 1.0
    assert np.array_equal(case.start.to_vector(), [0, 0, 3, 0, 0, -0.1, 0, 0.2, 0, 0, 0.1, 0])
    assert np.array_equal(case.actuator_force, [55, 49.5, 55, 49.5, 55, 49.5])
    assert np.allclose(np.diff(case.time), 0.01, atol=1e-15)
    assert len(case.time) == 101


# stiff in its friction, which Kane's equations pay for: every day the beginning, and the whole case as evidence
@pytest.mark.parametrize("share", [0.1, pytest.param(1.0, marks=pytest.mark.evidence)])
def test_every_comparison_holds_on_a_platform_with_friction(share: float) -> None:
    """The whole case of the other two presets is in tests/harness/cli/test_reproduce.py."""
    case = case_of(load_preset("desktop_hexapod"))
    case = replace(case, duration=share * case.duration)
    stepping, leap = run_stepping(case), run_stepping(case, rows=False)
    rows = agreement.agreement(case, run_kernel(case), run_kane(case), stepping, leap)
    assert len(rows) == 9
    assert [row.what for row in rows if not row.holds] == []


def test_a_comparison_that_is_not_a_number_does_not_hold() -> None:
    assert not agreement.Agreement("nothing", float("nan"), 1.0, "m").holds


def test_minus_first_is_the_same_mechanism_with_renamed_legs(case: OpenLoopCase) -> None:
    """Expected: swapping the forces instead of the legs gives the same motion."""
    other = run_kernel(paper_case(minus_first=True))
    swapped = run_kernel(replace(case, actuator_force=case.actuator_force[[1, 0, 3, 2, 5, 4]]))
    assert np.allclose(other.states, swapped.states, atol=1e-11)
    assert with_pairs_swapped(with_pairs_swapped(case.platform)) == case.platform


def test_another_platform_gets_the_case_scaled_to_its_size() -> None:
    """Expected: Froude's rule: with lengths λ, masses λ³, inertias λ⁵ a copy moves alike in time √λ, forces λ³."""
    scale, p = 0.25, replace(load_preset("liu2000"), platform_mass=14.0, leg_armature=3.0)
    large = case_of(p)
    small = replace(
        p,
        name="small",
        base_points=p.base_points * scale,
        platform_points=p.platform_points * scale,
        home_position=p.home_position * scale,
        platform_mass=p.platform_mass * scale**3,
        leg_lower_mass=p.leg_lower_mass * scale**3,
        leg_upper_mass=p.leg_upper_mass * scale**3,
        leg_armature=p.leg_armature * scale**3,
        platform_inertia=p.platform_inertia * scale**5,
        leg_lower_inertia=p.leg_lower_inertia * scale**5,
        leg_upper_inertia=p.leg_upper_inertia * scale**5,
        leg_lower_com=p.leg_lower_com * scale,
        leg_upper_com=p.leg_upper_com * scale,
    )
    case = case_of(small)
    assert not case.is_published
    assert case.duration == pytest.approx(np.sqrt(scale))
    assert np.allclose(case.actuator_force, large.actuator_force * scale**3, rtol=1e-12)
    end, expected = run_kernel(case).states[-1], run_kernel(large).states[-1]
    assert np.allclose(end[:3], expected[:3] * scale, atol=1e-9)
    assert np.allclose(end[3:6], expected[3:6], atol=1e-9)


def test_forces_on_another_platform_relate_to_its_static_ones_as_published() -> None:
    """Expected: by symmetry equal static forces; odd legs 55/49.5 of the even ones."""
    force = case_of(load_preset("motion_base")).actuator_force
    assert np.allclose(force[::2] / force[1::2], 55 / 49.5, rtol=1e-6)


@pytest.mark.parametrize("preset", ["liu2000", "desktop_hexapod", "motion_base"])
@pytest.mark.parametrize("factor", [0.2, 0.7, 1.4, 5.0])
def test_changed_platforms_still_pass_their_case(preset: str, factor: float) -> None:
    """A payload changed on a preset is the first thing a user tries."""
    platform = load_preset(preset)
    mass, inertia = platform.platform_mass * factor, platform.platform_inertia * factor
    changed = replace(platform, platform_mass=mass, platform_inertia=inertia)
    end = run_stepping(case_of(changed))[-1]
    assert abs(end[2] / changed.home_position[2] - 1) < 0.5


def test_the_papers_platform_under_another_name_is_the_papers_case() -> None:
    case = case_of(replace(load_preset("liu2000"), name="mine", source="me"))
    assert case.is_published
    assert case.duration == 1.0
    assert case.platform.name == "mine"


@pytest.mark.parametrize(
    ("run", "solver"),
    [
        (run_kernel, "gough_stewart.harness.paper.open_loop"),
        (run_kane, "gough_stewart.model.formulations.kane"),
    ],
)
def test_an_integration_that_gives_up_is_an_error(
    case: OpenLoopCase, run: Callable[[OpenLoopCase], object], solver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SciPy's way of giving up: success is false, and a message."""
    gave_up = SimpleNamespace(success=False, t=np.array([0.0, 0.25]), message="step size too small")
    monkeypatch.setattr(f"{solver}.solve_ivp", lambda *_, **__: gave_up)
    with pytest.raises(StepError, match=r"at time 0.25 s: step size too small"):
        run(case)


def test_a_case_that_the_plant_cannot_pass_says_which_quantity_when(case: OpenLoopCase) -> None:
    with pytest.raises(StepError, match="singular pose"):
        run_stepping(replace(case, actuator_force=np.full(6, -200.0)))


def test_static_and_weight_figures_are_those_of_a_hand_calculation() -> None:
    """Expected: L = √(14 − 2√3); weight share 28 g L / 18; static force as in the dynamics tests."""
    found = readings.weight_of_the_published_forces()
    L = np.sqrt(14 - 2 * np.sqrt(3))
    assert found["share_of_total_weight"] == pytest.approx(28 * 9.81 * L / 18, rel=1e-12)
    h = 2 * 0.4144 + (L - 0.4144)
    vertical = 98.1 / 6 + 9.81 * 9 / L**2 + h / L * 9.81 * (1 - 9 / L**2)
    assert found["static_leg_force"] == pytest.approx(vertical * L / 3, rel=1e-12)


@pytest.fixture(scope="module")
def plus_first() -> tuple[list[readings.Reading], int]:
    """Other readings than the decided one, and how often progress was reported."""
    reports = []
    return readings.other_readings(progress=lambda: reports.append(1)), len(reports)


def test_each_reading_says_what_was_decided_and_what_else_could_be_meant(
    plus_first: tuple[list[readings.Reading], int],
) -> None:
    """Expected: written out, row by row."""
    pairing = "each base joint to the platform joint 30° away, alternately + and −"
    r2 = "0.4144 m below P, as both readings of the garbled value give"
    assert [(row.point, row.decided, row.other) for row in plus_first[0]] == [
        ("pairing of joints", pairing, "60° away, alternately + and −"),
        ("pairing of joints", pairing, "both lists in the printed order, all legs twisted by +60°"),
        ("order of the ± in the appendix, which swaps the forces of each pair", "+ first", "− first"),
        ("r2, centre of mass of the upper part", r2, "half of a uniform rod with J2 and m2, 0.4014 m below P"),
        ("r_G, centre of mass of the platform", "at Op", "0.1 m above Op"),
        ("g", "9.81 m/s²", "9.80665 m/s²"),
        ("friction in the legs", "none", "viscous, 1 N s/m"),
        ("axes of roll, pitch, yaw", "fixed X, then Y, then Z", "moving X, then Y', then Z''"),
    ]
    assert [row.remark.partition(":")[0] for row in plus_first[0]] == [
        *("", "impossible", "", "", "", "", ""),
        "the same motion under other angles",
    ]


def test_joints_of_other_readings_stand_at_the_azimuths_of_the_appendix(
    case: OpenLoopCase, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: 15° beside 60°, 180° and 300°, + before −, in the printed order; and each to the one beyond."""
    points = readings._far_pairing(case.platform).platform_points
    azimuth = np.degrees(np.arctan2(points[:, 0], points[:, 1])) % 360
    assert azimuth == pytest.approx([75, 285, 195, 45, 315, 165])
    assert np.linalg.norm(points, axis=1) == pytest.approx(1.0)
    given = list[list[float]]()
    monkeypatch.setattr(readings, "_on_azimuths", lambda _platform, degrees: given.append(degrees))
    readings._turned_alike(case.platform)
    assert given == [[middle + side for middle in (60, 180, 300) for side in (15, -15)]]


def test_readings_of_the_other_order_start_from_it(plus_first: tuple[list[readings.Reading], int]) -> None:
    """Expected: seen from the other order, the first order is as far away."""
    both = plus_first[0], readings.other_readings(minus_first=True)
    row, mirrored = (next(r for r in rows if r.point.startswith("order")) for rows in both)
    assert (mirrored.decided, mirrored.other) == (row.other, row.decided)
    assert mirrored.position_change == pytest.approx(row.position_change, rel=1e-6)


def test_without_gravity_the_energy_is_still_compared() -> None:
    """Expected: no weight, no forces, no work: the kinetic energy is the scale."""
    case = case_of(
        replace(load_preset("motion_base"), gravity=np.zeros(3), leg_coulomb_friction=0, leg_viscous_friction=0)
    )
    assert np.abs(case.actuator_force).max() < 1e-9
    assert agreement.energy_error(case, run_kernel(case)) <= 1e-9


def test_the_uniform_rod_reading_follows_from_j2_and_m2(case: OpenLoopCase) -> None:
    """Expected: J = m l²/12."""
    half = readings._as_uniform_rod(case.platform).leg_upper_com
    assert case.platform.leg_upper_mass * (2 * half) ** 2 / 12 == pytest.approx(case.platform.leg_upper_inertia)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("fmi_type", ["CoSimulation", "ModelExchange"])
def test_states_are_those_of_the_kernel_at_every_row(fmus: dict[str, Fmu], version: str, fmi_type: FmiType) -> None:
    """Expected: DOP853 at 1e-12."""
    case = paper_case()
    assert np.abs(run_fmu(fmus[version].path, case, fmi_type) - run_kernel(case).states).max() <= 1e-7


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("fmi_type", ["CoSimulation", "ModelExchange"])
def test_a_case_that_the_plant_cannot_go_through_is_an_error_with_its_reason(
    fmus: dict[str, Fmu], version: str, fmi_type: FmiType
) -> None:
    """The paper's case passes a singular pose at 1.136 s."""
    with pytest.raises(StepError, match="singular"):
        run_fmu(fmus[version].path, replace(paper_case(), duration=1.5), fmi_type)


@pytest.mark.parametrize("says", [True, False])
def test_a_run_that_ends_early_or_warns_is_an_error(
    fmus: dict[str, Fmu], says: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: a warning of the unit in the error's text, though all rows are there; too few rows without one."""
    simulate, made = fmpy.simulate_fmu, list[Any]()

    class Noted(FmuInstance):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            made.append(self)

    def simulated(*arguments: Any, **options: Any) -> Any:
        found = simulate(*arguments, **options)
        if says:
            made[-1].messages.append("a warning of the unit")
        return found if says else found[:-1]

    monkeypatch.setattr(unit, "FmuInstance", Noted)
    monkeypatch.setattr(fmpy, "simulate_fmu", simulated)
    with pytest.raises(StepError, match=r"FMI 3\.0 CoSimulation: rows") as caught:
        run_fmu(fmus["3.0"].path, paper_case(), "CoSimulation")
    assert ("a warning of the unit" in str(caught.value)) == says
