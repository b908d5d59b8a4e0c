"""A loop that is exported as SSP: uneven load, tilted gravity, a step."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gough_stewart as gs

EXPORTED: dict[str, Any] = {
    "loop.duration": 0.3,
    "loop.sample_time": 0.002,
    "loop.delay": 1,
    "reference.at": 0.05,
    "reference.orientation_change": [0.02, -0.03, 0.05],
    "controller.bandwidth": 3,
    "platform.parameters.platform_com": [0.05, -0.03, 0.2],
    "platform.parameters.gravity": [0.3, -0.2, -9.7],
    "sensors.quantisation": {},
}
# On a machine that is not what is believed.
MISTAKEN = EXPORTED | {"plant.parameters.platform_mass": 950.0}


def exported_loop(folder: Path, settings: Mapping[str, Any] = EXPORTED) -> Path:
    """The archive."""
    (ssp,) = gs.export("heave_step", settings, forms="ssp", out=folder)
    return ssp
