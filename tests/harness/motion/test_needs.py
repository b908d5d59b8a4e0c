"""What motions need of each leg, against Newton–Euler, differences of lengths and the work–energy theorem."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gough_stewart.harness.motion.motion import Motion
from gough_stewart.harness.motion.needs import needs_along
from gough_stewart.harness.motion.references import Hold, Sine, Step
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray
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


def test_what_the_figures_leave_out_is_said() -> None:
    time = np.linspace(0, 1, 101)
    assert len(needs_along(UNEVEN, time, SWAY(time)).notes) == 1
    smooth = replace(UNEVEN, leg_viscous_friction=0.0, leg_coulomb_friction=0.0, leg_armature=0.0)
    text = "; ".join(needs_along(smooth, time, SWAY(time)).notes)
    assert "no friction and no inertia of motors and screws" in text
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
