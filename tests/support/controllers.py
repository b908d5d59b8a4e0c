"""A controller that leaves: PID with unequal gains, limits that bite, a moving reference, an uneven platform."""

from pathlib import Path
from typing import Any

import gough_stewart as gs
from tests.support.experiments import experiment_from
from tests.support.uneven import UNEVEN

SAMPLE_TIME = 0.004  # [s]
FORCE_LIMIT = 75.0  # [N], which the start-up of the motion asks more than
PROPORTIONAL = [800.0, 650.0, 900.0, 720.0, 1000.0, 850.0]  # [N/m]
INTEGRAL = [900.0, 700.0, 1000.0, 800.0, 1100.0, 950.0]  # [N/(m s)]


def uneven_experiment(folder: Path, rate_limit: float | None = 4000.0, **controller: Any) -> gs.Experiment:
    """With a delay of one sample, and plant steps of a quarter of one; `controller` changes keys of its table."""
    gs.save_platform(UNEVEN, folder / "uneven.toml")
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
