"""Motions that are designed, their experiment files, and experiments before and after, in all their numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import gough_stewart as gs
from gough_stewart import before_and_after, excite, load_preset
from gough_stewart.harness.identify.excite import experiment_text, within_limits
from gough_stewart.harness.motion.motion import Reference
from gough_stewart.harness.report.terminal import text_of
from tests.support.information import with_changes
from tests.support.lagrangian import Pose, forces_along
from tests.support.uneven import UNEVEN

NAMES = "platform_mass,platform_com,platform_inertia"
ELEMENTS = ("platform_mass", *(f"platform_com[{k}]" for k in (1, 2, 3)))
ELEMENTS += tuple(f"platform_inertia[{k}]" for k in ("1,1", "1,2", "1,3", "2,2", "2,3", "3,3"))
PLATFORM = replace(UNEVEN, leg_length_min=None, leg_length_max=3.6, joint_angle_max=None, actuator_force_max=None)


def information_of(motion_of: Reference, duration: float, steps: int) -> tuple[np.ndarray, float]:
    """Singular values of D/√n of the forces by scaled parameters [N], and the RMS force [N].

    Forces of a Lagrangian along poses and their rates of angles, by differences of the pose.
    """
    time, h = np.linspace(0.0, duration, steps), 1e-4

    def pose(at: np.ndarray) -> np.ndarray:
        motion = motion_of(at)
        return np.concatenate([motion.position, motion.orientation], axis=1)

    q, after, before = pose(time), pose(time + h), pose(time - h)
    along = Pose(q, (after - before) / (2 * h), (after - 2 * q + before) / h**2)
    size, mass = PLATFORM.characteristic_length, PLATFORM.platform_mass
    scale = np.array([mass, *[size] * 3, *[mass * size**2] * 6])
    steps_of = np.array([1.0, *[1e-3] * 3, *[0.1] * 6])
    columns = [
        (forces_along(with_changes(PLATFORM, {n: e}), along) - forces_along(with_changes(PLATFORM, {n: -e}), along))
        / (2 * e)
        for n, e in zip(ELEMENTS, steps_of, strict=True)
    ]
    D = (np.stack(columns, axis=-1) * scale).reshape(-1, len(scale))
    sigma = np.linalg.svd(D / np.sqrt(len(time)), compute_uv=False)
    return sigma, float(np.sqrt((forces_along(PLATFORM, along) ** 2).mean()))


def test_what_a_motion_excites_is_told_as_by_a_lagrangian_and_the_criterion_is_the_one_asked_for() -> None:
    """Expected: both criteria by another formulation; each motion is better by its own one."""
    smooth = replace(PLATFORM, leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    options = {"duration": 6.0, "frequency": 0.25, "harmonics": 3, "trials": 2, "seed": 3}
    said: list[str] = []
    found = {
        "trace": excite(smooth, NAMES, criterion="trace", status=said.append, **options),  # type: ignore[arg-type]
        "determinant": excite(smooth, NAMES.split(","), **options),  # type: ignore[arg-type]
    }
    assert said[-1].startswith("condition number ")
    seen = {}
    for criterion, design in found.items():
        sigma, force = information_of(design.reference.about(smooth), 6.0, 28)
        # accelerations by differences
        assert design.condition_number == pytest.approx(sigma[0] / sigma[-1], rel=1e-3)
        assert design.log_determinant == pytest.approx(2 * np.log(sigma / force).sum(), abs=1e-2)
        seen[criterion] = 2 * np.log(sigma).sum(), (sigma**-2).sum()
    assert seen["determinant"][0] > seen["trace"][0]
    assert seen["trace"][1] < seen["determinant"][1]


def test_a_motion_uses_nine_tenths_of_the_tightest_limit() -> None:
    """Expected: a ninth more keeps the limits; a few percent beyond that do not."""
    tight = replace(PLATFORM, leg_length_max=3.4)
    found = excite(tight, NAMES, duration=5.0, frequency=0.4, harmonics=2, fade=0.7, trials=2, seed=1).reference
    assert (found.duration, found.frequency, found.fade) == (5.0, 0.4, 0.7)
    assert {np.array(each).shape for each in (found.position_sine, found.orientation_cosine)} == {(2, 3)}
    time = np.linspace(0.0, 5.0, 1500)

    def scaled(by: float) -> bool:
        names = ("position_sine", "position_cosine", "orientation_sine", "orientation_cosine")
        larger = found.model_copy(update={name: (by * np.array(getattr(found, name))).tolist() for name in names})
        return within_limits(tight, time, larger.about(tight)(time))

    assert scaled(0.99 / 0.9)
    assert not scaled(1.06 / 0.9)
    forceful = replace(tight, actuator_force_max=1.0)
    assert not within_limits(forceful, time, found.about(forceful)(time))
    with pytest.raises(gs.GoughStewartError, match="trials is 0; expected at least 1 motion"):
        excite(tight, NAMES, trials=0)


def test_the_experiment_of_a_motion_has_the_motion_and_its_origin(tmp_path: Path) -> None:
    """Expected: what was designed, read back from its file; a bandwidth of six times the highest frequency."""
    found = excite(PLATFORM, NAMES, duration=7.0, frequency=0.3, harmonics=2, fade=0.8, trials=1, seed=5)
    text = experiment_text(found, replace(PLATFORM, name='my "own"'), 'preset = "liu2000"', NAMES, 5)
    (tmp_path / "made.toml").write_text(text)
    experiment = gs.load_experiment(tmp_path / "made.toml")
    assert experiment.title == 'excitation of my "own"'
    assert experiment.reference == found.reference
    assert "with --seed 5:" in text
    assert f"#   {NAMES}\n# Condition number of their regressor: {found.condition_number:.3g}.\n" in text
    assert 'bandwidth = "3.6 Hz"' in text
    assert experiment.loop.duration == 7.0
    assert experiment.loop.sample_time == 1e-3
    assert experiment.sensors.quantisation["leg_length"] == 1e-6
    assert text.count('preset = "liu2000"') == 1


def test_an_experiment_before_and_after_has_one_machine_and_two_beliefs() -> None:
    """Expected: runs of the experiment with either platform as belief; errors and feedback by their definitions."""
    nominal = load_preset("liu2000")
    heavier = replace(nominal, platform_mass=14.0, platform_com=np.array([0.02, -0.01, 0.05]))
    machine = {"plant.parameters.platform_mass": 14.5}
    settings = {"loop.duration": 0.2, "actuators.lag": 2e-4, **machine}
    found = before_and_after(gs.load_experiment("circle_computed_torque", settings), nominal, heavier)
    believed = {"platform.parameters": {"platform_mass": 14.0, "platform_com": [0.02, -0.01, 0.05]}}
    # of the machine, only its mass is told; the rest is as believed before
    kept = {"plant.parameters": {"platform_mass": 14.5, "platform_com": [0.0, 0.0, 0.0]}}
    expected = gs.run("circle_computed_torque", settings), gs.run("circle_computed_torque", settings | believed | kept)
    for record, other in zip((found.before, found.after), expected, strict=True):
        assert_allclose(record["position"], other["position"], rtol=0, atol=1e-12)
        assert_allclose(record["controller.force"], other["controller.force"], rtol=0, atol=1e-8)
    table = found.table
    assert table.title.endswith(": before and after")
    assert table.heads == ("", "before", "after")
    rows = table.shown
    names = [row[0] for row in rows]
    assert names == [
        "position error, RMS µm",
        "position error, peak µm",
        "orientation error, RMS deg",
        "leg length error, RMS µm",
        "feedback's share of the force, RMS N",
        "disk margin α",
        "gain of each leg, up or down dB",
        "phase of each leg, either way deg",
        "crossover Hz",
    ]
    for k, record in enumerate(expected, 1):
        position, orientation = record["reference.position"] - record["position"], record["error.orientation"]
        length = record["error.leg_length"]
        feedback = record["controller.force"] - record["controller.feedforward"]
        values = [
            1e6 * np.sqrt((position**2).sum(axis=1).mean()),
            1e6 * np.sqrt((position**2).sum(axis=1)).max(),
            180 / np.pi * np.sqrt((orientation**2).sum(axis=1).mean()),
            1e6 * np.sqrt((length**2).sum(axis=1).mean()),
            np.sqrt((feedback**2).sum(axis=1).mean()),
        ]
        assert [row[k] for row in rows[:5]] == [f"{value:.4g}" for value in values]
    disk = [[str(cell) for cell in row[1:]] for row in rows[5:]]
    for before, after in disk:
        assert before != after  # another design
        assert "unstable" not in (before, after)
    # both tell one disk: gain ± = (2 ± α)/(2 ∓ α), phase = 2 atan(α/2) [Seiler, Packard & Gahinet, 2020]
    for k in (0, 1):
        alpha = float(disk[0][k])
        assert float(disk[1][k]) == pytest.approx(20 * np.log10((2 + alpha) / (2 - alpha)), rel=1e-2)
        assert float(disk[2][k]) == pytest.approx(np.degrees(2 * np.arctan(alpha / 2)), rel=1e-2)
    assert repr(found) == text_of([table])
