"""Parameters of an exported controller: fields of a struct in C, parameters of an FMU."""

import math
import re
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.control.component import Parameter
from gough_stewart.model.parameters import Bound, Variability, Variable
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray


class Setting(NamedTuple):
    """A parameter of the exported controller, with its designed value."""

    variable: Variable
    value: FloatArray  # in the variable's shape
    # C conditions on the struct `parameters`, besides finite values and the variable's bound
    conditions: tuple[str, ...] = ()
    may_be_infinite: bool = False  # a limit; none is 0, or infinite
    largest: float = LARGEST_NUMBER  # magnitude of an element
    expected: str = ""  # the conditions in the user's words; by default as they are


def setting(
    name: str,
    unit: str,
    bound: Bound,
    description: str,
    value: ArrayLike,
    *,
    variability: Variability = "tunable",
    conditions: Iterable[str] = (),
    may_be_infinite: bool = False,
    largest: float = LARGEST_NUMBER,
    expected: str = "",
) -> Setting:
    """A setting with the shape of its value."""
    value = np.asarray(value, dtype=float)
    variable = Variable(name, value.shape, unit, "parameter", variability, description, lower_bound=bound)
    return Setting(variable, value, tuple(conditions), may_be_infinite, largest, expected)


def setting_of(parameter: Parameter, value: ArrayLike, more: str = "") -> Setting:
    """The setting of a component's parameter, with more words in its description."""
    name, unit = parameter.name, parameter.unit
    is_limit = parameter.none is not None and math.isinf(parameter.none)
    # at least a thousandth, written so that it holds for float and for double
    condition = "!(value > 0) || value * 1000 >= 1" if is_limit else parameter.condition
    named = {"value": f"parameters->{name}", "sample_time": "parameters->sample_time"}
    condition = re.sub(r"\b(value|sample_time)\b", lambda word: named[word[0]], condition)
    return setting(
        *(name, unit, parameter.bound, parameter.description + more, value),
        conditions=(condition,) if condition else (),
        may_be_infinite=is_limit,
        expected=f"0, which is none, or at least 0.001 {unit}" if is_limit else parameter.expected,
    )
