"""Parameter changes of many platforms during a run, parsed and checked for all at once."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model import interface
from gough_stewart.model.errors import InterfaceError, PlatformError
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.platform import Platform, Platforms
from gough_stewart.model.real import real_array
from gough_stewart.model.variant import IDEAL, Variant
from gough_stewart.model.vectors import FloatArray


def changed_parameter(
    present: Parameters, name: str, value: object, members: BoolArray, variant: Variant = IDEAL
) -> FloatArray:
    """A tunable parameter of all members (N, *shape), with a new value for some of them (N,).

    Parameters
    ----------
    present
        The present values of all.
    variant
        Theirs, which says what there is to change.
    value
        One for all, or (N, *shape), of which only the rows of `members` are used.

    Raises
    ------
    InterfaceError
        Not a tunable parameter, another shape, or not finite.
    """
    variable = interface.BY_NAME.get(name)
    if variable is None or variable not in variant.tunable:
        tunable = ", ".join(v.name for v in variant.tunable)
        raise InterfaceError(name, f"cannot be set during a run; expected one of {tunable}")
    new = np.array(getattr(present, name))
    try:
        found = np.array(value)
        is_own = found.ndim > len(variable.shape) and len(found) == len(members)
        new[members] = real_array(found[members] if is_own else value, new[members].shape if is_own else variable.shape)
    except ValueError as error:
        raise InterfaceError(name, f"{error} [{variable.unit}], {variable.description}") from None
    return new


def refuse_impossible(platforms: Sequence[Platform], members: BoolArray, values: Mapping[str, FloatArray]) -> None:
    """Raise the error of `Platform` for the first of these members with impossible values (N, *shape).

    Only those are made that fail the checks of all at once.
    """
    doubtful = Platforms.of(platforms).having(values).doubtful(values)
    for k in map(int, np.flatnonzero(doubtful & members)):
        try:
            replace(platforms[k], **{name: value[k] for name, value in values.items()})
        except PlatformError as error:
            text = str(error).partition(": ")[2]
            raise PlatformError(error.field, f"{text} (number {k} of the platforms)") from None
