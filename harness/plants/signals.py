"""The measurable signals between plant and controller, joined to one vector, and the layout of those of many members.

Values of many members lie element by element in memory, members contiguous: an array of shape (N, size) is a transposed
(size, N) one, and over time (n, N, size) a transposed (n, size, N). NumPy's elementwise operations keep that layout and
process members as vectors.
"""

from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import ControllerError
from gough_stewart.model import interface
from gough_stewart.model.vectors import FloatArray

# In the order of the results, so the vector of all signals is the first part of `Plant.results()`.
NAMES = ("position", "orientation", "velocity", "angular_velocity", "leg_length", "leg_velocity")
VARIABLES = tuple(interface.BY_NAME[name] for name in NAMES)
SIZE = interface.N_SIGNALS
# What is known of a reference.
REFERENCES = (*VARIABLES, interface.BY_NAME["acceleration"], interface.BY_NAME["angular_acceleration"])
# The legs' lengths and velocities, the last of them; of elastic legs also at the motors' side, from this column on.
LEGS = slice(12, SIZE)
MOTORS = "motor_position[1]"
Side = Literal["leg", "motor"]
AT_MOTORS = {"leg_length": "motor_position", "leg_velocity": "motor_velocity"}
N_LEGS = interface.BY_NAME["leg_length"].size
# A number of a single run, or an array (N,) for many members; the arithmetic is the same for both. Limits of legs that
# differ are (1, 6) or (N, 6).
PerMember = Any


def positions(names: Iterable[str]) -> NDArray[np.intp]:
    """Positions of some signals' elements in the vector of all; `ControllerError` for an unknown name, or none."""
    names = [names] if isinstance(names, str) else list(names)
    if not names:
        raise ControllerError(f"no signals; expected one or more of {', '.join(NAMES)}")
    places, place_of = [], interface.places(VARIABLES)
    for name in names:
        if name not in place_of:
            raise ControllerError(f"no signal '{name}'{interface.nearest(name, NAMES)}")
        places.append(place_of[name])
    return np.concatenate(places)


def column_names(names: Iterable[str]) -> list[str]:
    """Scalar names of some signals, 1-based."""
    return [scalar for name in names for scalar in interface.BY_NAME[name].scalar_names]


def stacked(values: Sequence[Any]) -> Any:
    """Arrays of members (..., size), of equal shape, as one (..., N, size), members contiguous."""
    return np.moveaxis(np.stack([np.asarray(value) for value in values], axis=-1), -1, -2)


def all_below(values: FloatArray, bound: float) -> bool:
    """Whether the sum of all squares shows that vectors (size, N) are shorter than a bound; False may be undecided."""
    flat = values.reshape(-1)
    return bool(flat.dot(flat) < bound * bound)


def of_member(value: PerMember, member: int) -> Any:
    """The value of one member, from a common number or an array (N,)."""
    return np.ravel(value)[member if np.ndim(value) else 0]


def of_legs(value: PerMember) -> FloatArray:
    """Limits of the legs (6, N) or (6, 1)."""
    values = np.asarray(value, dtype=float)
    return np.broadcast_to(values.T, (6, values.shape[0] if values.ndim else 1))
