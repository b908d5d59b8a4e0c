"""A small ensemble in which much varies: uneven, short, with members that are impossible; and a simple one of many."""

from typing import Any

import gough_stewart as gs

# Members of a chunk, as docs/ensembles.md says.
SIZE = 512

SMALL: dict[str, Any] = {
    "title": "small ensemble",
    "platform": {
        "preset": "motion_base",
        "parameters": {"platform_com": [0.05, -0.03, 0.1], "gravity": [0.4, -0.3, -9.7]},
    },
    "plant": {"parameters": {"leg_coulomb_friction": 60.0, "leg_viscous_friction": 400.0}},
    "reference": {"type": "sine", "position_amplitude": [0.01, 0.02, 0.03], "frequency": 2.0},
    "controller": {"type": "pd", "bandwidth": "3 Hz", "feedforward": "gravity"},
    "loop": {"duration": 0.06, "sample_time": 2e-3, "plant_step": 1e-3, "delay": 1},
    "sensors": {"noise": {"leg_length": "5 um"}, "quantisation": {"leg_length": "10 um"}},
    "disturbance": [{"at": 0.02, "duration": 0.02, "force": [100, 50, -80]}],
    "ensemble": {
        "members": 40,
        "seed": 3,
        "platform_mass": {"normal": [1000, 600]},
        "base_points": {"normal": "0.5 mm"},
        "platform_inertia": {"factor": {"uniform": [0.8, 1.3]}},
        "leg_viscous_friction": {"lognormal": 0.4},
        "loop": {"delay": {"choice": [0, 1, 2]}},
        "controller": {"bandwidth": {"uniform": ["2 Hz", "4 Hz"]}},
        "sensors": {"noise": {"leg_length": {"uniform": [1e-6, 2e-5]}}},
        "disturbance": {"1": {"force": {"normal": "20 N"}}},
    },
}


# Three chunks, of which the last is small; some members are impossible.
MANY: dict[str, Any] = {
    "title": "many",
    "loop": {"duration": 0.01, "sample_time": 2e-3, "plant_step": 1e-3, "delay": 1},
    "sensors.noise.leg_length": 1e-6,
    "sensors.quantisation": {},
    "reference.at": 0.002,
    "ensemble": {"members": 2 * SIZE + 40, "seed": 3, "platform_mass": {"normal": [1000, 600]}},
}


def small(**ensemble: Any) -> gs.Experiment:
    """That experiment, with other keys in its `[ensemble]`."""
    return gs.Experiment(**{**SMALL, "ensemble": {**SMALL["ensemble"], **ensemble}})
