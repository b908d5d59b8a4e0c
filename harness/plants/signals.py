"""The measurable signals between plant and controller, joined to one vector."""

from collections.abc import Iterable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import ControllerError
from gough_stewart.model import interface

# In the order of the results, so the vector of all signals is the first part of `Plant.results()`.
NAMES = ("position", "orientation", "velocity", "angular_velocity", "leg_length", "leg_velocity")
VARIABLES = tuple(interface.BY_NAME[name] for name in NAMES)
SIZE = interface.size_of(VARIABLES)
# What is known of a reference.
REFERENCES = (*VARIABLES, interface.BY_NAME["acceleration"], interface.BY_NAME["angular_acceleration"])
# The legs' lengths and velocities, the last of them; of elastic legs also at the motors' side, from this column on.
LEGS = slice(12, SIZE)
MOTORS = "motor_position[1]"
Side = Literal["leg", "motor"]
AT_MOTORS = {"leg_length": "motor_position", "leg_velocity": "motor_velocity"}
N_LEGS = interface.BY_NAME["leg_length"].size


def positions(names: Iterable[str]) -> NDArray[np.intp]:
    """The positions of the elements of some signals in the vector of all signals.

    Raises
    ------
    ControllerError
        An unknown name, or no name.
    """
    names = [names] if isinstance(names, str) else list(names)
    if not names:
        raise ControllerError(f"no signals; expected one or more of {', '.join(NAMES)}")
    places = []
    place_of = interface.unpack(VARIABLES, np.arange(SIZE))
    for name in names:
        if name not in place_of:
            raise ControllerError(f"no signal '{name}'{interface.nearest(name, NAMES)}")
        places.append(place_of[name])
    return np.concatenate(places)


def column_names(names: Iterable[str]) -> list[str]:
    """Scalar names of some signals, 1-based."""
    return [scalar for name in names for scalar in interface.BY_NAME[name].scalar_names]
