"""What motions need of each leg, against Newton–Euler, differences of lengths and the work–energy theorem."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gough_stewart import Hold, Platform, Sine, Step
from gough_stewart.harness.motion.limits.needs import needs_along
from gough_stewart.harness.motion.motion import Motion
from tests.support.arrays import FloatArray
from tests.support.forces import forces_by_newton_euler
from tests.support.uneven import UNEVEN

SWAY = Sine(
    position_amplitude=(0.1, -0.16, 0.2), orientation_amplitude=(0.05, -0.08, 0.07), frequency=1.1, phase=0.3, fade_in=1
).about(UNEVEN)


def lengths(platform: Platform, motion: Motion) -> FloatArray:
    """|p + R P_i − B_i| (n, 6), with rotations by SciPy."""
    turns = Rotation.from_euler("xyz", motion.orientation).as_matrix()
    turned = platform.platform_points @ np.swapaxes(turns, 1, 2)
    return np.asarray(np.linalg.norm(motion.position[:, None] + turned - platform.base_points, axis=2))


def test_peaks_and_root_mean_squares_are_those_of_another_formulation() -> None:
    """Expected: forces by Newton–Euler and velocities by differences of lengths, row by row."""
    time = np.linspace(1.13, 2.53, 501)  # from no middle of the swing
    needs, h = needs_along(UNEVEN, time, SWAY(time)), 1e-6
    length = lengths(UNEVEN, SWAY(time))
    velocity = (lengths(UNEVEN, SWAY(time + h)) - lengths(UNEVEN, SWAY(time - h))) / (2 * h)
    force = forces_by_newton_euler(UNEVEN, SWAY, time)
    signals = {"leg_velocity": velocity, "actuator_force": force}
    signals |= {
        "motoring_power": np.maximum(force * velocity, 0),
        "regenerated_power": np.maximum(-force * velocity, 0),
    }
    # a mean of squares by Simpson's rule, not the trapezoidal one
    weights = np.array([1, *[4, 2] * 249, 4, 1]) / 3 / 500
    for leg in range(6):
        assert needs["leg_length_min"][leg] == pytest.approx(length[:, leg].min(), rel=1e-12)
        assert needs["leg_length_max"][leg] == pytest.approx(length[:, leg].max(), rel=1e-12)
        for name, values in signals.items():
            row = int(np.abs(values[:, leg]).argmax())
            assert needs[f"{name}_peak"][leg] == pytest.approx(values[row, leg], rel=1e-6)
            assert needs[f"{name}_peak_time"][leg] == time[row]
            if name != "leg_velocity":
                assert needs[f"{name}_peak_velocity"][leg] == pytest.approx(velocity[row, leg], abs=1e-7)
            if name != "actuator_force":
                assert needs[f"{name}_peak_force"][leg] == pytest.approx(force[row, leg], rel=1e-6)
            assert needs[f"{name}_rms"][leg] == pytest.approx(np.sqrt(weights @ values[:, leg] ** 2), rel=1e-3)
        assert needs["distance"][leg] == pytest.approx(weights @ np.abs(velocity[:, leg]) * 1.4, rel=2e-3)
        about_mean = length[:, leg] - weights @ length[:, leg]
        assert needs["stroke_rms"][leg] == pytest.approx(np.sqrt(weights @ about_mean**2), rel=1e-3)
    pull, push = -force.min(axis=0), force.max(axis=0)
    assert np.allclose(needs["actuator_force_push"], np.maximum(push, 0), rtol=1e-6)
    assert np.allclose(needs["actuator_force_pull"], np.maximum(pull, 0), rtol=1e-6)


def test_motoring_less_regenerated_energy_is_what_friction_takes_from_rest_to_rest() -> None:
    """Expected: the work–energy theorem over a motion that returns to its pose at rest: Σ ∫ (c L̇² + C |L̇|) dt."""
    platform = replace(UNEVEN, leg_friction_velocity=1e-5)
    swing = SWAY.model_copy(update={"phase": 0.0, "fade_in": 0.0})
    # from one turning point to the same one a period later
    time = np.linspace(0.25, 1.25, 20_001) / 1.1
    needs, h = needs_along(platform, time, swing(time)), 1e-6
    velocity = (lengths(platform, swing(time + h)) - lengths(platform, swing(time - h))) / (2 * h)
    viscous = platform.leg_viscous_friction * platform.leg_viscous_friction_factor
    coulomb = platform.leg_coulomb_friction * platform.leg_coulomb_friction_factor
    lost = np.trapezoid((viscous * velocity**2 + coulomb * np.abs(velocity)).sum(axis=1), time)
    net = needs["motoring_energy"].sum() - needs["regenerated_energy"].sum()
    assert needs["regenerated_energy"].min() > 0
    assert net == pytest.approx(lost, rel=1e-4)


def test_energies_of_each_sign_are_exact_where_power_is_linear_between_rows() -> None:
    """Expected: three rows of a heave, with the crossing of each power between its rows by similar triangles."""
    time = np.array([0.0, 0.1, 0.25])
    motion = SWAY(np.array([0.2, 0.45, 0.6]))
    needs = needs_along(UNEVEN, time, motion)
    velocity = needs_velocity(motion)
    power = forces_by_newton_euler(UNEVEN, lambda _: motion, time) * velocity
    assert (power[:-1] * power[1:] < 0).any()
    fine = np.linspace(0, 0.25, 200_001)
    for leg in range(6):
        values = np.interp(fine, time, power[:, leg])
        assert needs["motoring_energy"][leg] == pytest.approx(
            np.trapezoid(np.maximum(values, 0), fine), rel=1e-6, abs=1e-6
        )
        assert needs["regenerated_energy"][leg] == pytest.approx(
            np.trapezoid(np.maximum(-values, 0), fine), rel=1e-6, abs=1e-6
        )


def needs_velocity(motion: Motion) -> FloatArray:
    """Leg velocities by moving on for a microsecond."""
    h = 1e-7

    def moved(by: float) -> Motion:
        turned = Rotation.from_rotvec(by * motion.angular_velocity) * Rotation.from_euler("xyz", motion.orientation)
        return motion._replace(position=motion.position + by * motion.velocity, orientation=turned.as_euler("xyz"))

    return (lengths(UNEVEN, moved(h)) - lengths(UNEVEN, moved(-h))) / (2 * h)


def test_joint_angles_are_those_from_home() -> None:
    """Expected: the angle between a leg and its direction at home, in world for the base, in platform axes above."""
    time = np.linspace(0, 2, 201)
    needs, motion = needs_along(UNEVEN, time, SWAY(time)), SWAY(time)

    def directions(position: FloatArray, turn: Rotation) -> tuple[FloatArray, FloatArray]:
        leg = position + UNEVEN.platform_points @ turn.as_matrix().T - UNEVEN.base_points
        unit = leg / np.linalg.norm(leg, axis=1)[:, None]
        return unit, unit @ turn.as_matrix()

    home = directions(UNEVEN.home_position, Rotation.from_euler("xyz", UNEVEN.home_orientation.tolist()))
    angles = np.array(
        [
            [np.arccos(np.clip((a * b).sum(axis=1), -1, 1)) for a, b in zip(directions(p, turn), home, strict=True)]
            for p, turn in zip(motion.position, Rotation.from_euler("xyz", motion.orientation), strict=True)
        ]
    )
    for k, name in enumerate(("base_joint_angle", "platform_joint_angle")):
        assert np.allclose(needs[f"{name}_peak"], angles[:, k].max(axis=0), atol=1e-7)


def test_a_jump_of_the_reference_is_said_not_to_be_in_the_figures() -> None:
    time = np.linspace(0, 1, 101)
    jump = Step(position_change=(0, 0, 0.05), at=0.505).about(UNEVEN)
    assert "the reference jumps at 0.51 s" in "; ".join(needs_along(UNEVEN, time, jump(time)).notes)
    still = Hold().about(UNEVEN)
    assert len(needs_along(UNEVEN, time, still(time)).notes) == 1


def test_where_legs_cannot_hold_a_pose_there_are_no_forces() -> None:
    """Expected: in a singular pose, all joints in one plane, forces are not defined; lengths and speeds are."""
    flat = replace(
        UNEVEN, base_points=UNEVEN.base_points * [1, 1, 0], platform_points=UNEVEN.platform_points * [1, 1, 0]
    )
    rest = np.zeros((3, 3))
    motion = Motion(rest, rest, rest, rest, rest, rest)
    needs = needs_along(flat, np.array([0.0, 0.1, 0.2]), motion)
    assert np.isnan(needs["actuator_force_peak"]).all()
    assert np.isnan(needs["motoring_energy"]).all()
    assert np.isfinite(needs["leg_length_max"]).all()
    assert np.isfinite(needs["leg_velocity_rms"]).all()


def test_every_figure_has_its_unit_and_goes_with_the_speed_and_force_of_its_time() -> None:
    """Expected: names and units written out; at a peak, the row of the other quantities by Newton–Euler."""
    time = np.linspace(7.3, 8.1, 161)
    needs, h = needs_along(UNEVEN, time, SWAY(time)), 1e-6
    peaks = {
        "leg_velocity": ("m/s", ["force"]),
        "leg_acceleration": ("m/s2", ["velocity", "force"]),
        "actuator_force": ("N", ["velocity"]),
        "actuator_power": ("W", ["velocity", "force"]),
        "motoring_power": ("W", ["velocity", "force"]),
        "regenerated_power": ("W", ["velocity", "force"]),
        "base_joint_angle": ("rad", ["velocity"]),
        "platform_joint_angle": ("rad", ["velocity"]),
    }
    units = dict.fromkeys(("leg_length_min", "leg_length_max", "stroke", "stroke_rms", "distance"), "m")
    units |= {"actuator_force_push": "N", "actuator_force_pull": "N"}
    units |= {"motoring_energy": "J", "regenerated_energy": "J"}
    for name, (unit, others) in peaks.items():
        units |= {f"{name}_peak": unit, f"{name}_rms": unit, f"{name}_peak_time": "s"}
        units |= {f"{name}_peak_{other}": {"velocity": "m/s", "force": "N"}[other] for other in others}
    assert {name: need.unit for name, need in needs.of.items()} == units
    length = [lengths(UNEVEN, SWAY(time + k * h)) for k in (-1, 0, 1)]
    velocity = (length[2] - length[0]) / (2 * h)
    wide = [lengths(UNEVEN, SWAY(time + k * 1e-4)) for k in (-1, 0, 1)]
    acceleration = (wide[2] - 2 * wide[1] + wide[0]) / 1e-8
    force = forces_by_newton_euler(UNEVEN, SWAY, time)
    values = {"leg_acceleration": acceleration, "actuator_power": force * velocity}
    np.testing.assert_allclose(needs["stroke"], np.ptp(length[1], axis=0), rtol=1e-9)
    weights = np.full(161, 0.005)
    weights[[0, -1]] /= 2
    for name, of in values.items():
        row, leg = np.abs(of).argmax(axis=0), np.arange(6)
        np.testing.assert_allclose(needs[f"{name}_peak"], of[row, leg], rtol=1e-4)
        np.testing.assert_array_equal(needs[f"{name}_peak_time"], time[row])
        np.testing.assert_allclose(needs[f"{name}_peak_velocity"], velocity[row, leg], atol=1e-7)
        np.testing.assert_allclose(needs[f"{name}_peak_force"], force[row, leg], rtol=1e-6)
        np.testing.assert_allclose(needs[f"{name}_rms"], np.sqrt(weights @ of**2 / 0.8), rtol=1e-4)


@pytest.mark.parametrize(
    ("change", "absent"),
    [
        ({"leg_viscous_friction": 0.0}, None),
        ({"leg_coulomb_friction": 0.0}, None),
        ({"leg_viscous_friction": 0.0, "leg_coulomb_friction": 0.0}, "the platform states no friction, so"),
        (
            {"leg_viscous_friction": 0.0, "leg_coulomb_friction": 0.0, "leg_armature": 0.0},
            "the platform states no friction and no inertia of motors and screws (leg_armature), so",
        ),
        ({"leg_armature": 0.0}, "the platform states no inertia of motors and screws (leg_armature), so"),
    ],
)
def test_only_what_is_missing_is_said_to_be(change: dict[str, Any], absent: str | None) -> None:
    time = np.linspace(7.3, 7.5, 41)
    notes = needs_along(replace(UNEVEN, **change), time, SWAY(time)).notes
    assert len(notes) == (1 if absent is None else 2)
    assert absent is None or notes[1].startswith(absent)


def test_one_row_has_figures_too() -> None:
    """Expected: its own values; no distance, energy or deviation from a mean."""
    time = np.array([7.4])
    needs, motion = needs_along(UNEVEN, time, SWAY(time)), SWAY(time)
    np.testing.assert_allclose(needs["leg_length_max"], lengths(UNEVEN, motion)[0], rtol=1e-12)
    np.testing.assert_allclose(needs["leg_velocity_rms"], np.abs(needs_velocity(motion))[0], rtol=1e-5, atol=1e-7)
    for name in ("stroke", "stroke_rms", "distance", "motoring_energy", "regenerated_energy"):
        np.testing.assert_array_equal(needs[name], np.zeros(6))
