"""Slow evidence: stiction from the log of a closed loop of the plant itself.

The plant is `SteppingModel`, a closed loop moves it, and the noise of the log is drawn here: nothing of it is what an
identification inverts. The machine's legs differ, and its payload is not in the middle; a designer knows the payload.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gough_stewart import Log, identify, load_preset, read_log, run

pytestmark = pytest.mark.evidence
LEGS = np.array([1.0, 1.2, 0.9, 1.1, 1.1, 0.7])
STICKING = {
    "leg_friction_model": "elasto_plastic",
    "leg_coulomb_friction": (100 * LEGS).tolist(),
    "leg_static_friction": 150.0,
    "leg_stribeck_velocity": 4e-3,
    "leg_bristle_stiffness": 1.2e7,
    "leg_bristle_damping": 5e4,
}
PAYLOAD = {
    "platform_com": [0.05, -0.03, 0.21],
    "platform_inertia": [[380.0, 12.0, -20.0], [12.0, 410.0, 8.0], [-20.0, 8.0, 690.0]],
}


def slow_log(folder: Path, scale: float = 0.06) -> Log:
    """Without noise: the excitation's machine with these legs, some millimetres at some mm/s."""
    changes = {f"plant.parameters.{name}": value for name, value in STICKING.items()}
    sine = scale * np.array([[-0.06, 0.03, 0.05], [0.04, 0.05, -0.03], [0.02, -0.04, 0.03]])
    cosine = scale * np.array([[0.05, 0.04, -0.04], [-0.03, 0.02, 0.05], [0.03, -0.02, 0.02]])
    motion = {
        "reference.frequency": "0.1 Hz",
        "reference.position_sine": sine.tolist(),
        "reference.position_cosine": cosine.tolist(),
        "reference.orientation_sine": cosine.tolist(),
        "reference.orientation_cosine": sine.tolist(),
    }
    run("excitation", changes | motion | {"sensors": {}, "loop.duration": 10}).write_parquet(folder / "record.parquet")
    return read_log(folder)


def noisy(log: Log, seed: int, force: float = 10.0, length: float = 3e-7) -> Log:
    rng = np.random.default_rng(seed)
    assert log.actuator_force is not None
    force_of_log = log.actuator_force + force * rng.standard_normal(log.leg_length.shape)
    return replace(
        log, actuator_force=force_of_log, leg_length=log.leg_length + length * rng.standard_normal(log.leg_length.shape)
    )


def test_a_closed_loop_of_the_plant_shows_how_its_legs_stick(tmp_path: Path) -> None:
    """Expected: the machine's parameters, within four standard errors, and closely; of each of two noisy logs."""
    believed = load_preset("motion_base").with_parameters(
        PAYLOAD | {"leg_friction_model": "elasto_plastic", "leg_coulomb_friction": (80 * LEGS).tolist()}
    )
    truth = {"platform_mass": 1516.9, "leg_viscous_friction": 560.0, "leg_coulomb_friction": 100 * LEGS.mean()}
    truth |= {name: float(STICKING[name]) for name in ("leg_static_friction", "leg_stribeck_velocity")}
    log = slow_log(tmp_path)
    for seed in (0, 1):
        found = identify(noisy(log, seed), believed, ",".join(truth))
        error = found.values - np.array(list(truth.values()))
        assert found.names == tuple(truth)
        assert (np.abs(error) < 4 * found.standard_errors).all()
        assert (np.abs(error / list(truth.values()))[2:] < 0.02).all()
