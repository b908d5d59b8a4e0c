"""Elastic legs and stiction: linear models, structural modes, and what they do to margins.

Expected: another program's printed frequencies, closed forms as k (J M⁻¹ Jᵀ + 1/m_a), and margins at other bandwidths.
"""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

import gough_stewart as gs
from gough_stewart import LoopMargins, Platform, UnstableLoopError, linearise, plant_system
from tests.support.real_platforms import SPRINGS, real_platform

# T. Dehaeze, stewart-simscape, org/identification.org: "Resonance Frequency [Hz]", from Simscape's linearisation
PRINTED = [780.6, 780.6, 903.9, 1061.4, 1061.4, 1269.6]
SOFT = {"platform.parameters.leg_stiffness": 2e7}


@cache
def with_gains(bandwidth: float = 2.0, **settings: Any) -> LoopMargins:
    """The margins of `heave_step` with the gains of a bandwidth, so that none is searched for."""
    changes = {key.rpartition(".")[2]: value for key, value in settings.items() if key.startswith("platform.")}
    gains = gs.gains_from_bandwidth(gs.load_preset("motion_base").with_parameters(changes), bandwidth, 0.8)
    kp, kd = np.asarray(gains.proportional), np.asarray(gains.derivative)
    made = gs.PD(proportional_gain=kp, derivative_gain=kd, derivative_on="measurement")
    return gs.margins("heave_step", {**settings, "controller": made})


def disk_of(settings: dict[str, Any], bandwidth: float = 2.0) -> float:
    return with_gains(bandwidth, **settings).disk.alpha


def seen_by_legs(platform: Platform, *pose: Any) -> Any:
    """W⁻¹ = J M⁻¹ Jᵀ of the platform's side of the legs, which has no armature; at home unless a pose is given."""
    pose = pose or (platform.home_position, platform.home_orientation)
    J = gs.leg_jacobian(platform, *pose)
    side = replace(platform, leg_stiffness=0.0, leg_damping=0.0, leg_armature=0.0)
    return J @ np.linalg.solve(gs.mass_matrix(side, *pose), J.T)


@pytest.fixture(scope="module")
def simscape() -> Platform:
    return gs.load_platform(Path(__file__).parent / "stewart_simscape.toml")


def frequencies(A: Any) -> Any:
    """Of oscillating modes [Hz], ascending."""
    values = np.linalg.eigvals(A)
    return np.sort(np.abs(values[values.imag > 1.0])) / (2 * np.pi)


def test_with_held_motors_modes_are_those_that_simscape_printed(simscape: Platform) -> None:
    A = np.asarray(linearise(simscape).A)
    # held: their states, the last twelve, do not move
    assert frequencies(A[:12, :12]) == pytest.approx(PRINTED, rel=1e-3)
    home = simscape.home_position, simscape.home_orientation
    assert gs.evaluate_poses(simscape, *home).first_mode == pytest.approx(PRINTED[0], rel=1e-3)


@pytest.mark.parametrize("platform", [real_platform(springs=True), None])
def test_with_free_motors_modes_are_those_of_two_masses_a_leg(platform: Platform | None, simscape: Platform) -> None:
    """Expected: ω² of K (1/m_a + W⁻¹) with the mass W that the legs see; without damping, friction and gravity."""
    platform = simscape if platform is None else platform
    bare = replace(platform, leg_damping=1e-9, gravity=np.zeros(3), leg_viscous_friction=0.0)
    squares = eigh(bare.leg_stiffness * (np.eye(6) / bare.leg_armature + seen_by_legs(bare)), eigvals_only=True)
    assert frequencies(np.asarray(linearise(bare).A)) == pytest.approx(np.sqrt(squares) / (2 * np.pi), rel=1e-6)


def test_legs_that_stick_stand_on_the_springs_of_their_bristles() -> None:
    """Expected: ω² of σ0 W⁻¹, W with the armature; sliding legs have no such modes."""
    bare: dict[str, Any] = {"leg_bristle_damping": 1e-6, "gravity": np.zeros(3), "leg_viscous_friction": 0.0}
    rigid = real_platform("lugre", **bare, leg_static_friction=26.0)
    sticks = linearise(rigid, coulomb_friction=True)
    home = rigid.home_position, rigid.home_orientation
    J, M = gs.leg_jacobian(rigid, *home), gs.mass_matrix(rigid, *home)
    squares = eigh(rigid.leg_bristle_stiffness * J @ np.linalg.solve(M, J.T), eigvals_only=True)
    assert frequencies(np.asarray(sticks.A)) == pytest.approx(np.sqrt(squares) / (2 * np.pi), rel=1e-6)
    assert sticks.state_labels[12:14] == ["leg_bristle[1]", "leg_bristle[2]"]
    slides = linearise(rigid)
    assert slides.nstates == 12
    assert len(frequencies(np.asarray(slides.A))) == 0


def test_the_nonlinear_system_has_the_states_of_its_platform() -> None:
    """Expected: at rest, the rates are 0; a stretched spring pushes platform and motor apart."""
    platform = real_platform("elasto_plastic", True)
    system = plant_system(platform, outputs=("leg_force", "leg_bristle"))
    home, still = [platform.home_position, platform.home_orientation], np.zeros(6)
    x = np.concatenate([*home, still, still, platform.home_motor_position, still])
    u = np.concatenate([platform.home_actuator_force, np.zeros(6)])
    assert np.abs(system.dynamics(0, x, u)).max() < 1e-6
    stretched = x + np.concatenate([np.zeros(18), 1e-6 * np.eye(6)[2], np.zeros(6)])
    force = system.output(0, stretched, u)[:6] - system.output(0, x, u)[:6]
    assert force == pytest.approx(1e-6 * SPRINGS["leg_stiffness"] * np.eye(6)[2], abs=1e-6)
    rates = system.dynamics(0, stretched, u)
    assert rates[26] == pytest.approx(-1e-6 * SPRINGS["leg_stiffness"] / SPRINGS["leg_armature"], rel=1e-6)


def test_a_bandwidth_that_rigid_legs_bear_is_refused_on_legs_that_give() -> None:
    """Expected: stable on rigid legs; on soft ones a run grows, no faster than the worst eigenvalue says."""
    soft = {"platform.parameters.leg_stiffness": 5e6}
    text = r"stable on rigid legs: those of 5e\+06 N/m, whose first structural mode is at 19 Hz, limit the bandwidth"
    with pytest.raises(UnstableLoopError, match=text) as caught:
        gs.margins("heave_step", soft)
    assert "choose a lower bandwidth" in str(caught.value)
    # without what the linear model leaves out, and small enough for the force limit
    own = {"plant.parameters.leg_coulomb_friction": 0, "loop.duration": 0.8, "reference.position_change": [0, 0, 1e-3]}
    record = gs.run("heave_step", soft | own)
    shaking = record["leg_force"][:, 0] - record["controller.force"][:, 0]
    early, late = np.ptp(shaking[500:600]), np.ptp(shaking[700:800])
    growth = (late / early) ** (1 / 200)
    # heave is not the worst of the six modes
    assert 1.005 < growth <= abs(caught.value.eigenvalue) + 1e-4


def test_encoders_at_the_motors_do_not_see_the_stretch_of_their_legs() -> None:
    """Expected: motors or lengths of legs are measured, at first without a kick; margins differ accordingly."""
    exact = {"loop.duration": 0.25, "sensors.quantisation.leg_length": 0, "sensors.noise.leg_length": 0}
    for side, name in (("leg", "leg_length"), ("motor", "motor_position")):
        record = gs.run("heave_step", SOFT | exact | {"sensors.side": side})
        # the last row has no sample of its own
        assert np.array_equal(record["measured.leg_length"][:-1], record[name][:-1])
        gains: Any = gs.gains_from_bandwidth(
            gs.load_preset("motion_base").with_parameters({"leg_stiffness": 2e7}), 2.0, 0.8
        )
        error = record["reference.leg_length"][0] - record[name][0]
        force = record["controller.force"][0] - record["controller.feedforward"][0]
        assert force == pytest.approx(gains.proportional * error, rel=1e-9, abs=1e-6)
    # a motor's encoder is collocated with its force: structural modes take no phase from it
    assert disk_of(SOFT | {"sensors.side": "motor"}) > 1.2 * disk_of(SOFT)
    assert disk_of({}) == disk_of({"sensors.side": "motor"})


def test_margins_are_those_of_legs_that_only_the_machine_has() -> None:
    """Expected: the disk margin that a design with these legs has; the believed beside it; or instability."""
    only_there: Any = with_gains(**{"plant.parameters.leg_stiffness": 2e7})
    friction = {"platform.parameters.leg_coulomb_friction": 0}
    assert only_there.disk.alpha == pytest.approx(disk_of({"platform.parameters.leg_stiffness": 2e7, **friction}))
    assert only_there.structure
    assert only_there.believed.disk.alpha == pytest.approx(disk_of({}), rel=1e-12)
    with pytest.raises(UnstableLoopError, match=r"stable with the believed platform as machine, with a disk margin"):
        gs.margins("heave_step", {"plant.parameters.leg_stiffness": 5e6})


@pytest.fixture(scope="module")
def found() -> LoopMargins:
    return gs.margins("heave_step", SOFT)


@pytest.mark.parametrize(("changes", "bandwidth"), [({}, 1.9), ({"sensors.side": "motor"}, 5.3)])
def test_what_the_page_says_that_the_allowed_bandwidth_rests_on(
    changes: dict[str, Any], bandwidth: float, found: LoopMargins
) -> None:
    """Expected: the numbers of docs/machine.md; each loop has its disk margin there, and not at 1.1 times as much."""
    settings = SOFT | changes
    structure: Any = (gs.margins("heave_step", settings) if changes else found).structure
    assert structure.bandwidth == pytest.approx(bandwidth, abs=0.05)
    at, beyond = (disk_of(settings, factor * structure.bandwidth) for factor in (1.0, 1.1))
    assert at >= 0.4 > beyond


def test_modes_of_the_pose_in_which_the_reference_begins_are_those_of_the_closed_form() -> None:
    """Damping is c/k of the stiffness, ζ = c ω/(2k), but for friction at the motors and gravity."""
    base = gs.load_preset("motion_base")
    soft = base.with_parameters({"leg_stiffness": 2e7, "leg_damping": 4e4})
    at = {"position": [0.25, -0.2, 2.1], "orientation": [0.05, 0.1, 0.2]}
    hold = {"reference": {"type": "hold", **at}, "loop.duration": 0.1, "platform.parameters.leg_armature": 90.0}
    damped = {"platform.parameters.leg_damping": 4e4}
    structure: Any = gs.margins("heave_step", SOFT | damped | hold).structure
    relative = seen_by_legs(soft, *map(np.array, at.values()))
    omega = np.sqrt(2e7 * np.linalg.eigvalsh(relative + np.eye(6) / 90.0))
    assert [mode.frequency for mode in structure.modes] == pytest.approx(omega / (2 * np.pi), rel=1e-3)
    assert [mode.damping_ratio for mode in structure.modes] == pytest.approx(4e4 * omega / 4e7, rel=0.1)
    held = np.sqrt(2e7 * np.linalg.eigvalsh(relative)) / (2 * np.pi)
    assert [mode.held_frequency for mode in structure.modes] == pytest.approx(held, rel=1e-3)


def test_margins_tell_the_modes_and_the_gain_of_the_loop_there(found: LoopMargins) -> None:
    """Expected: σ_max of C (z − A)⁻¹ B + D at the mode; in report, Bode plot and file the same numbers."""
    structure: Any = found.structure
    assert len(structure.modes) == 6
    L = found.transfer
    for mode in structure.modes:
        z = np.exp(2j * np.pi * mode.frequency * 1e-3)
        answer = L.C @ np.linalg.solve(z * np.eye(len(L.A)) - L.A, L.B) + L.D
        assert mode.gain == pytest.approx(np.linalg.svd(answer, compute_uv=False)[0], rel=1e-9)
    report = found.report()
    gain = next(chart for chart in report.charts if chart.title.startswith("gain of L"))
    marked = [(mark.text, mark.value) for mark in gain.marks if mark.direction == "vertical"]
    assert marked == [("first structural mode", structure.modes[0].frequency)]
    first, largest = structure.modes[0], max(mode.gain for mode in structure.modes)
    assert report.number("structure.first_mode").value == first.frequency == pytest.approx(37.95, abs=0.01)
    assert report.number("structure.damping_ratio").value == first.damping_ratio
    assert report.number("structure.gain").value == pytest.approx(20 * math.log10(largest))
    table: Any = next(part for part in report.parts() if getattr(part, "title", "") == "Structural modes")
    decibels = 20 * math.log10(first.gain)
    assert table.rows[0] == ("1", first.frequency, first.damping_ratio, first.held_frequency, pytest.approx(decibels))
    told = found.as_dict()["structure"]
    assert told["modes"][0] == first._asdict()
    assert told["bandwidth"] == report.number("structure.bandwidth").value == structure.bandwidth
    text = f"keeps a disk margin of 0.4 up to a bandwidth of {structure.bandwidth:.3g} Hz"
    assert any(text in part.text for part in report.parts() if hasattr(part, "text"))


def test_the_allowed_bandwidth_is_found_from_any_bandwidth_of_the_design(found: LoopMargins) -> None:
    """Expected: that of another design, within the search's 1 %."""
    first: Any = found.structure
    other: Any = gs.margins("heave_step", SOFT | {"controller.bandwidth": 1.0}).structure
    assert other.bandwidth == pytest.approx(first.bandwidth, rel=0.0101)


def test_rigid_legs_and_explicit_gains() -> None:
    rigid = with_gains()
    assert rigid.structure is None
    assert "structure" not in rigid.as_dict()
    report = rigid.report()
    assert not any(number.path.startswith("structure") for number in report.numbers)
    gain = next(chart for chart in report.charts if chart.title.startswith("gain of L"))
    assert not [mark for mark in gain.marks if mark.direction == "vertical"]
    found: Any = with_gains(**SOFT)
    assert found.structure.bandwidth is None
    assert found.report(charts=False).number("structure.bandwidth").value is None


def test_what_no_sample_shows_and_no_bandwidth_keeps_is_not_a_number() -> None:
    """Expected: no gain beyond half the sample rate, 50 Hz; no PID of Ti = 0.1 s below 1 Hz, where it is unstable."""
    structure: Any = with_gains(0.5, **SOFT, **{"loop.sample_time": 0.01}).structure
    assert {math.isnan(mode.gain) == (mode.frequency > 50) for mode in structure.modes} == {True}
    assert structure.modes[0].frequency < 50 < structure.modes[-1].frequency
    hasty = gs.PID(bandwidth=1.2, damping_ratio=0.8, integral_time=0.1)
    tight: Any = gs.margins("heave_step", SOFT | {"controller": hasty}).structure
    assert math.isnan(tight.bandwidth)
