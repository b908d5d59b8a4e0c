"""The machine differs from what the designer believes: what comes from which, and what it costs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gough_stewart as gs

FloatArray = np.ndarray[Any, np.dtype[np.float64]]
RNG = np.random.default_rng(12)
BASE_ERRORS, PLATFORM_ERRORS = (
    each / np.linalg.norm(each, axis=1, keepdims=True) * 1e-3 for each in RNG.normal(size=(2, 6, 3))
)
POSE = {"position": [0.05, -0.1, 2.1], "orientation": [0.05, -0.03, 0.1]}


def experiment_with(machine: dict[str, Any], **more: Any) -> gs.Experiment:
    """The motion base at an uneven pose under PID, on a machine that differs."""
    return gs.Experiment(
        **{
            "title": "truth and belief",
            "platform": {"preset": "motion_base"},
            "plant": {"parameters": machine},
            "reference": {"type": "hold", **POSE},
            "controller": {
                "type": "pid",
                "bandwidth": "4 Hz",
                "damping_ratio": 0.8,
                "integral_time": "0.2 s",
                "feedforward": "gravity",
            },
            "loop": {"duration": "2 s", "sample_time": "2 ms"},
            **more,
        }
    )


def moved_joints() -> dict[str, Any]:
    believed = gs.load_preset("motion_base")
    return {
        "base_points": (believed.base_points + BASE_ERRORS).tolist(),
        "platform_points": (believed.platform_points + PLATFORM_ERRORS).tolist(),
        "leg_coulomb_friction": 0.0,
    }


def test_joint_errors_of_a_millimetre_are_seen_at_the_platform_as_geometry_predicts() -> None:
    """Expected: integral action makes the legs as long as believed, so that L_true(x + δx) = L_believed(x).

    To first order J δx = −u·(R δp − δb); the record's error is −δx. Second order: (1 mm)²/2 m, below 1e-6.
    """
    believed = gs.load_preset("motion_base")
    record = gs.run(experiment_with(moved_joints()))
    position, orientation = (np.array(POSE[name]) for name in ("position", "orientation"))
    u = gs.leg_geometry(believed, position, orientation).direction
    off = (u * (PLATFORM_ERRORS @ Rotation.from_euler("xyz", orientation).as_matrix().T - BASE_ERRORS)).sum(axis=1)
    expected = np.linalg.solve(gs.leg_jacobian(believed, position, orientation), off)
    assert np.abs(record["error.leg_length"][-1]).max() < 2e-6
    assert np.linalg.norm(expected[:3]) > 0.5e-3
    assert record["error.position"][-1] == pytest.approx(expected[:3], abs=5e-6)
    # small angles, about the world's axes; roll, pitch, yaw differ from them in second order of the pose's own angles
    assert np.abs(record["error.orientation"][-1] - expected[3:]).max() < 0.2 * np.abs(expected[3:]).max()


def test_an_injection_is_in_the_record_and_in_the_command() -> None:
    """Expected: a function of the nominal time, in six legs apart; without it no such column."""

    def wave(time: float) -> FloatArray:
        return np.asarray(10 * np.sin(30 * time + np.arange(6)))

    experiment = experiment_with({}, loop={"duration": 0.02, "sample_time": 0.002, "plant_step": 0.001})
    with_it, without = gs.run(experiment, injection=wave), gs.run(experiment)
    expected = np.array([wave(0.002 * (min(k, 19) // 2)) for k in range(21)])
    assert with_it["controller.injection"] == pytest.approx(expected)
    assert "controller.injection" not in without
    assert with_it["controller.force"][0] - without["controller.force"][0] == pytest.approx(expected[0])
    with pytest.raises(gs.GoughStewartError, match=r"the injection at time 0 s has shape \(3,\)"):
        gs.run(experiment, injection=lambda _time: [1.0, 2.0, 3.0])


def test_the_machine_may_come_from_a_file(tmp_path: Path) -> None:
    """Expected: the file's platform, with single parameters changed on it; the belief stays."""
    gs.save_platform(gs.load_preset("desktop_hexapod"), tmp_path / "machine.toml")
    (tmp_path / "x.toml").write_text(
        """
        title = "x"
        platform.preset = "motion_base"
        controller.type = "open_loop"
        loop.duration = 0.001
        plant = {file = "machine.toml", parameters = {leg_viscous_friction = 3.0}}
        """
    )
    metadata = gs.run(tmp_path / "x.toml").metadata
    assert metadata["machine"]["name"] == gs.load_preset("desktop_hexapod").name
    assert metadata["machine"]["leg_viscous_friction"] == 3
    assert gs.Platform(**metadata["platform"]) == gs.load_preset("motion_base")
    with pytest.raises(gs.GoughStewartError, match="plant: platform_mas: no such parameter; did you mean 'platform_m"):
        gs.run(tmp_path / "x.toml", {"plant.parameters.platform_mas": 3.0})
