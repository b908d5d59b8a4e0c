"""The reference that an experiment names, as a motion."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from gough_stewart.harness.motion import references
from gough_stewart.harness.motion.motion import Reference
from gough_stewart.harness.motion.reference_choice import FileReference, ReferenceChoice
from gough_stewart.harness.motion.table import read_reference
from gough_stewart.model.platform import Platform

_CLASSES: dict[str, Callable[..., Reference]] = {
    "hold": references.Hold,
    "step": references.Step,
    "point_to_point": references.PointToPoint,
    "sine": references.Sine,
    "circle": references.Circle,
    "chirp": references.Chirp,
}


def reference_of(choice: ReferenceChoice, platform: Platform, folder: Path) -> Reference:
    """The motion, about the home pose where the experiment says nothing else.

    Raises
    ------
    MotionError
        A file that cannot be read, or numbers that make no motion.
    """
    if isinstance(choice, FileReference):
        return read_reference(folder / choice.file)
    values = {key: np.array(v) if isinstance(v, tuple) else v for key, v in choice.model_dump(exclude={"type"}).items()}
    for key, home in (("position", platform.home_position), ("orientation", platform.home_orientation)):
        if values[key] is None:
            values[key] = home
    return _CLASSES[choice.type](**values)
