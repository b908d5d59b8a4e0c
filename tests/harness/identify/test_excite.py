"""Motions that are designed, what they promise, their experiment files, and experiments before and after."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import make_interp_spline

import gough_stewart as gs
from tests.harness.identify.information import with_changes
from tests.harness.identify.machine_logs import Course, friction
from tests.support.arrays import FloatArray
from tests.support.commands import invoke
from tests.support.lagrangian import Pose, forces_along, legs_along
from tests.support.uneven import UNEVEN

NAMES = "platform_mass,platform_com,platform_inertia"
ELEMENTS = ("platform_mass", *(f"platform_com[{k}]" for k in (1, 2, 3)))
ELEMENTS += tuple(f"platform_inertia[{k}]" for k in ("1,1", "1,2", "1,3", "2,2", "2,3", "3,3"))
# The stroke is the only limit.
_LIMITS: dict[str, Any] = dict.fromkeys(("leg_length_min", "actuator_force_max", "joint_angle_max"))
PLATFORM = replace(UNEVEN, leg_length_max=3.4, leg_viscous_friction=0.0, leg_coulomb_friction=0.0, **_LIMITS)


def along(motion_of: Any, time: FloatArray, h: float = 1e-4) -> Pose:
    """The poses of a motion and the rates of their angles, by differences."""

    def pose(at: FloatArray) -> FloatArray:
        motion = motion_of(at)
        return np.concatenate([motion.position, motion.orientation], axis=1)

    q, after, before = pose(time), pose(time + h), pose(time - h)
    return Pose(q, (after - before) / (2 * h), (after - 2 * q + before) / h**2)


def information_of(platform: gs.Platform, pose: Pose) -> tuple[FloatArray, float]:
    """Singular values of D/√n of the forces by scaled parameters [N], and the RMS force [N], by a Lagrangian."""
    size, mass = platform.characteristic_length, platform.platform_mass
    scale = np.array([mass, *[size] * 3, *[mass * size**2] * 6])
    columns = [
        (forces_along(with_changes(platform, {n: e}), pose) - forces_along(with_changes(platform, {n: -e}), pose))
        / (2 * e)
        for n, e in zip(ELEMENTS, [1.0, *[1e-3] * 3, *[0.1] * 6], strict=True)
    ]
    D = (np.stack(columns, axis=-1) * scale).reshape(-1, len(scale))
    sigma = np.linalg.svd(D / np.sqrt(len(pose.q)), compute_uv=False)
    return sigma, float(np.sqrt((forces_along(platform, pose) ** 2).mean()))


def test_what_a_motion_excites_is_told_as_by_a_lagrangian_within_nine_tenths_of_the_tightest_limit() -> None:
    """Expected: both criteria by another formulation; each motion is better by its own; a ninth more just fits."""
    options: dict[str, Any] = {"duration": 6.0, "frequency": 0.25, "harmonics": 3, "fade": 0.7, "trials": 1, "seed": 3}
    said: list[str] = []
    designs = {
        "trace": gs.excite(PLATFORM, NAMES, criterion="trace", status=said.append, **options),
        "determinant": gs.excite(PLATFORM, NAMES.split(","), **options),
    }
    assert said[-1].startswith("condition number ")
    seen = {}
    for criterion, design in designs.items():
        sigma, force = information_of(PLATFORM, along(design.reference.about(PLATFORM), np.linspace(0.0, 6.0, 28)))
        # accelerations by differences
        assert design.condition_number == pytest.approx(sigma[0] / sigma[-1], rel=1e-3)
        assert design.log_determinant == pytest.approx(2 * np.log(sigma / force).sum(), abs=1e-2)
        seen[criterion] = 2 * np.log(sigma / force).sum(), ((sigma / force) ** -2).sum()
    assert seen["determinant"][0] > seen["trace"][0]
    assert seen["trace"][1] < seen["determinant"][1]

    best = designs["determinant"].reference
    assert (best.duration, best.frequency, best.fade) == (6.0, 0.25, 0.7)
    assert {np.array(values).shape for values in (best.position_sine, best.orientation_cosine)} == {(3, 3)}
    names = ("position_sine", "position_cosine", "orientation_sine", "orientation_cosine")
    for by, keeps in ((0.99 / 0.9, True), (1.06 / 0.9, False)):
        larger = best.model_copy(update={name: (by * np.array(getattr(best, name))).tolist() for name in names})
        length, _ = legs_along(PLATFORM, along(larger.about(PLATFORM), np.linspace(0.0, 6.0, 1500)))
        assert (length.max() <= 3.4) == keeps


def test_promised_errors_are_those_of_a_log_and_a_motion_tells_ten_times_more_than_a_circle() -> None:
    """Expected: standard errors of a log of the motion, by a Lagrangian, with the noise that the promise states."""
    platform = replace(gs.load_preset("motion_base"), actuator_force_max=9000.0)
    names = f"{NAMES},leg_viscous_friction,leg_coulomb_friction"
    design = gs.excite(platform, names, duration=2.5, fade=0.5, frequency=1.0, harmonics=2, trials=1, seed=1)
    time, reference = np.arange(2500) / 1000, design.reference.about(platform)
    coarse = np.arange(-0.05, 2.56, 0.01)
    smooth = replace(platform, leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    pose = along(reference, coarse)
    force = make_interp_spline(coarse, forces_along(smooth, pose), k=3)(time)
    length, velocity = legs_along(platform, along(reference, time))
    force = force + friction(platform, Course(), velocity)
    assert np.abs(force).max() < 9000.0
    circle = gs.Circle(radius=0.2, frequency=0.4, fade_in=1.0).about(platform)
    of_circle, of_motion = (
        sigma[-1] / sigma[0]
        for sigma, _ in (information_of(smooth, along(motion, coarse[5:-5:4])) for motion in (circle, reference))
    )
    assert of_motion > 10 * of_circle
    rng = np.random.default_rng(3)
    force = force + 0.01 * np.sqrt((force**2).mean(axis=0)) * rng.standard_normal(force.shape)
    log = gs.Log(1e-6 * np.rint(length / 1e-6), time, force)
    errors = gs.identify(log, platform, names, validation=0.0).standard_errors
    assert_allclose(design.standard_errors, errors, rtol=0.1)


def test_without_limits_a_motion_tells_more_than_random_ones_and_their_forces_stay_usual() -> None:
    """Expected: noise is a share of the forces, so that forces of nearly singular poses are worth nothing."""
    platform = replace(gs.load_preset("liu2000"), platform_inertia=np.diag([5.0, 6.0, 9.0]))
    design = gs.excite(platform, NAMES, duration=5.0, frequency=0.4, harmonics=2, trials=1)
    rng, shape = np.random.default_rng(2), (2, 3)
    names = ("position_sine", "position_cosine", "orientation_sine", "orientation_cosine")
    for _ in range(5):
        drawn = {name: (0.15 * rng.standard_normal(shape)).tolist() for name in names}
        motion = design.reference.model_copy(update=drawn).about(platform)
        sigma, force = information_of(platform, along(motion, np.linspace(0.0, 5.0, 40)))
        assert design.log_determinant > 2 * np.log(sigma / force).sum() + 3


def test_what_cannot_be_designed_is_refused() -> None:
    """Expected: the platform and the parameters; no actuator carries the platform with 1 N."""
    with pytest.raises(gs.GoughStewartError, match="no motion was found within the limits of uneven that excites plat"):
        gs.excite(replace(UNEVEN, actuator_force_max=1.0), "platform_mass", duration=3.0, trials=2)
    with pytest.raises(gs.GoughStewartError, match="trials is 0; expected at least 1 motion"):
        gs.excite(PLATFORM, NAMES, trials=0)


def test_the_command_writes_an_experiment_with_the_motion_and_its_origin(tmp_path: Path) -> None:
    """Expected: the motion of the same seed in Python, another of another; six times the highest frequency."""
    platform = replace(PLATFORM, name='my "own"')
    gs.save_platform(platform, tmp_path / "own.toml")
    options: dict[str, Any] = {"duration": 4.0, "frequency": 0.3, "harmonics": 2, "fade": 0.8, "trials": 1}
    options["criterion"] = "trace"
    words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    words += ["--estimate", "platform_mass,platform_com", "--seed", "5", "--out", str(tmp_path / "out")]
    done = invoke("excite", "--platform", str(tmp_path / "own.toml"), *words)
    assert done.exit_code == 0, done.stderr
    same, other = (gs.excite(platform, "platform_mass,platform_com", **options, seed=seed) for seed in (5, 6))
    experiment = gs.load_experiment(tmp_path / "out" / "excitation.toml")
    assert experiment.title == 'excitation of my "own"'
    assert experiment.reference == same.reference
    assert not np.array_equal(same.reference.coefficients, other.reference.coefficients)
    text = (tmp_path / "out" / "excitation.toml").read_text("utf-8")
    assert "with --seed 5:" in text
    number = same.condition_number
    assert f"#   platform_mass,platform_com\n# Condition number of their regressor: {number:.3g}.\n" in text
    assert 'bandwidth = "3.6 Hz"' in text
    assert 'file = "platform.toml"' in text
    assert (experiment.loop.duration, experiment.loop.sample_time) == (4.0, 1e-3)
    assert experiment.sensors.quantisation["leg_length"] == 1e-6
    shown = {row["path"]: row["value"] for row in json.loads((tmp_path / "out" / "report.json").read_text())["numbers"]}
    assert shown["condition_number"] == pytest.approx(number)
    assert shown["log_determinant"] == pytest.approx(same.log_determinant)


def test_an_experiment_before_and_after_has_one_machine_and_two_beliefs() -> None:
    """Expected: runs of the experiment with either platform as belief; errors and feedback by their definitions."""
    nominal = gs.load_preset("liu2000")
    heavier = replace(nominal, platform_mass=14.0, platform_com=np.array([0.02, -0.01, 0.05]))
    machine = {"plant.parameters.platform_mass": 14.5}
    settings = {"loop.duration": 0.2, "actuators.lag": 2e-4, **machine}
    both = gs.before_and_after(gs.load_experiment("circle_computed_torque", settings), nominal, heavier)
    believed = {"platform.parameters": {"platform_mass": 14.0, "platform_com": [0.02, -0.01, 0.05]}}
    # of the machine, only its mass is told; the rest is as believed before
    plant = {"plant.parameters": {"platform_mass": 14.5, "platform_com": [0.0, 0.0, 0.0]}}
    expected = gs.run("circle_computed_torque", settings), gs.run("circle_computed_torque", settings | believed | plant)
    for record, other in zip((both.before, both.after), expected, strict=True):
        assert_allclose(record["position"], other["position"], rtol=0, atol=1e-12)
        assert_allclose(record["controller.force"], other["controller.force"], rtol=0, atol=1e-8)
    lines = [[cell.strip() for cell in line.split("│")[1:-1]] for line in repr(both).splitlines()]
    rows = {line[0]: line[1:] for line in lines if line}
    measures: tuple[tuple[str, Any], ...] = (
        ("position error, RMS µm", lambda r: 1e6 * norm(r["reference.position"] - r["position"])),
        ("position error, peak µm", lambda r: 1e6 * peak(r["reference.position"] - r["position"])),
        ("orientation error, RMS deg", lambda r: 180 / np.pi * norm(r["error.orientation"])),
        ("leg length error, RMS µm", lambda r: 1e6 * norm(r["error.leg_length"])),
        ("feedback's share of the force, RMS N", lambda r: norm(r["controller.force"] - r["controller.feedforward"])),
    )
    for name, measure in measures:
        assert rows[name] == [f"{measure(record):.4g}" for record in expected], name
    disk = [
        rows[name] for name in ("disk margin α", "gain of each leg, up or down dB", "phase of each leg, either way deg")
    ]
    for before, after in (*disk, rows["crossover Hz"]):
        assert before != after  # another design
    # both tell one disk: gain ± = (2 ± α)/(2 ∓ α), phase = 2 atan(α/2) [Seiler, Packard & Gahinet, 2020]
    for k in (0, 1):
        alpha = float(disk[0][k])
        assert float(disk[1][k]) == pytest.approx(20 * np.log10((2 + alpha) / (2 - alpha)), rel=1e-2)
        assert float(disk[2][k]) == pytest.approx(np.degrees(2 * np.arctan(alpha / 2)), rel=1e-2)


def norm(values: FloatArray) -> float:
    """Root mean square over time of the norms of vectors."""
    return float(np.sqrt((values**2).sum(axis=1).mean()))


def peak(values: FloatArray) -> float:
    """The largest norm of vectors."""
    return float(np.sqrt((values**2).sum(axis=1)).max())
