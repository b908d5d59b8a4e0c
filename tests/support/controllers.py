"""A controller that leaves: PID with unequal gains, limits that bite, a moving reference, an uneven platform."""

from pathlib import Path
from typing import Any

import numpy as np

from gough_stewart import Experiment, save_platform
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.loop.run import Run, simulate
from gough_stewart.harness.plants.open import ModelPlant
from tests.support.experiments import experiment_from
from tests.support.uneven import UNEVEN

SAMPLE_TIME = 0.004  # [s]
FORCE_LIMIT = 75.0  # [N], which the start-up of the motion asks more than
PROPORTIONAL = [800.0, 650.0, 900.0, 720.0, 1000.0, 850.0]  # [N/m]
INTEGRAL = [900.0, 700.0, 1000.0, 800.0, 1100.0, 950.0]  # [N/(m s)]


def uneven_experiment(folder: Path, rate_limit: float | None = 4000.0, **controller: Any) -> Experiment:
    """With a delay of one sample, and plant steps of a quarter of one; `controller` changes keys of its table."""
    save_platform(UNEVEN, folder / "uneven.toml")
    return experiment_from(
        {
            "title": "uneven <loop>",
            "platform": {"file": str(folder / "uneven.toml")},
            "reference": {
                "type": "sine",
                "position_amplitude": [0.05, -0.03, 0.08],
                "orientation_amplitude": [0.04, -0.06, 0.05],
                "frequency": 1.7,
            },
            "controller": {
                "type": "pid",
                "proportional_gain": PROPORTIONAL,
                "derivative_gain": [60.0, 45.0, 70.0, 52.0, 80.0, 64.0],
                "integral_gain": INTEGRAL,
                "feedforward": "computed_torque",
                **controller,
            },
            "actuators": {"force_limit": FORCE_LIMIT, "rate_limit": rate_limit},
            "limits": {"reference": "warn"},
            "loop": {"duration": 0.4, "sample_time": SAMPLE_TIME, "plant_step": SAMPLE_TIME / 4, "delay": 1},
        }
    )


def run_of(experiment: Experiment) -> Run:
    """Of the loop in Python around the model."""
    prepared = prepare(experiment)
    with prepared.law_in_a_run() as law_from:
        return simulate(ModelPlant(prepared.machine, prepared.start), law_from, prepared.loop)


def forces_of(run: Run) -> np.ndarray:
    """What the controller gives out at every sample (m, 6) [N], within the force limit."""
    return np.clip(run.command, -FORCE_LIMIT, FORCE_LIMIT)
