"""`[ensemble]`, and `{ normal = ["120 kg", "10 kg"] }` and others in it: how one value varies.

Quantile functions turn numbers in (0, 1), random ones or those of a design, into values. All are computed element by
element, so a value does not depend on its neighbours.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import prod
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field, ValidationError, model_validator

from gough_stewart.harness.quantities import Number
from gough_stewart.harness.sampling.design import CorrelatedInputs, Sampling
from gough_stewart.harness.section import TableSection, complaints
from gough_stewart.model.interface import TOLERANCES
from gough_stewart.model.units import PLAIN, number
from gough_stewart.model.vectors import FloatArray

# From numbers in (0, 1) to values, elementwise.
Quantile = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class VariedValue:
    """The varied value: its name, unit ("" if dimensionless, None if not a number), shape, and present value."""

    name: str
    unit: str | None
    shape: tuple[int, ...]
    nominal: FloatArray | None
    # a symmetric matrix
    is_symmetric: bool = False


@dataclass(frozen=True)
class Spread:
    """How a target varies: from `size` numbers in (0, 1) per member to its values."""

    size: int
    draw: Callable[[FloatArray], Any]  # from (n, size) to (n, *shape), or a list of n values of any kind
    levels: int | None = None  # number of values of a grid
    # if one number scales several elements: from (n, size) to that factor (n,)
    factor: Callable[[FloatArray], FloatArray] | None = None


class Variation(TableSection):
    """One distribution: of values, of a `factor` on the present value, or of an `offset` to it.

    `normal = [mean, deviation]`, `uniform = [low, high]`, `truncated_normal = [mean, deviation, low, high]`,
    `lognormal = [median, deviation of the logarithm]`, `choice = [...]`, `grid = [...]`. With one number
    `normal` and `uniform` are deviations from the present value, `lognormal` is a factor of it; with two
    `truncated_normal` has a deviation and a bound on both sides.
    """

    normal: Any = None
    uniform: Any = None
    truncated_normal: Any = None
    lognormal: Any = None
    choice: list[Any] | None = None
    grid: list[Any] | None = None
    factor: "Variation | None" = Field(default=None)
    offset: "Variation | None" = Field(default=None)

    @model_validator(mode="after")
    def _one_of_them(self) -> "Variation":
        names = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(names) != 1:
            raise ValueError(
                f"expected one of {', '.join(type(self).model_fields)}; found {' and '.join(names) or 'none'}"
            )
        return self

    @property
    def kind(self) -> str:
        """The key that is set."""
        (name,) = (name for name in type(self).model_fields if getattr(self, name) is not None)
        return name

    def spread(self, target: VariedValue) -> Spread:
        """The spread of a target under this distribution; a `ValueError` says what is no distribution of it."""
        kind = self.kind
        value = getattr(self, kind)
        if kind in ("factor", "offset") and value.kind in ("factor", "offset"):
            raise ValueError(f"{kind} of a {value.kind}; expected a distribution in it")
        if kind == "factor":
            nominal, of_factor = _nominal(target), value.spread(VariedValue("factor", PLAIN, (), np.ones(())))

            def factors(u: FloatArray) -> FloatArray:
                return np.asarray(of_factor.draw(u), dtype=float)

            ones = (1,) * len(target.shape)
            return Spread(1, lambda u: factors(u).reshape(-1, *ones) * nominal, of_factor.levels, factors)
        if kind == "offset":
            nominal = _nominal(target)
            about_zero: Spread = value.spread(replace(target, nominal=np.zeros(target.shape)))
            return replace(about_zero, draw=lambda u: nominal + np.asarray(about_zero.draw(u), dtype=float))
        if kind in ("choice", "grid"):  # one of n values with equal probability, the one at ⌊n u⌋
            n, is_number = len(value), target.unit is not None
            if not value:
                raise ValueError(f"{kind} has no values; expected at least two")
            parsed = [_parsed(one, target, target.shape) for one in value] if is_number else value
            if all(np.array_equal(one, parsed[0]) for one in parsed):
                raise ValueError(f"{kind} is {value!r}, without a spread; expected at least two values that differ")
            among = value if all(isinstance(one, int) for one in value) else parsed

            def draw_one(u: FloatArray) -> Any:
                drawn = [among[min(int(n * share), n - 1)] for share in np.ravel(u).tolist()]
                return np.asarray(drawn) if is_number else drawn

            return Spread(1, draw_one, n if kind == "grid" else None)
        if target.unit is None:
            raise ValueError(f"{kind} applies to numbers only; expected choice or grid")
        quantile = _quantile(kind, value, target)

        def draw(u: FloatArray) -> FloatArray:
            drawn = quantile(u.reshape(len(u), *target.shape))
            if not target.is_symmetric:
                return drawn
            # the elements above the diagonal, and their mirror images
            return np.triu(drawn) + np.swapaxes(np.triu(drawn, 1), -1, -2)

        return Spread(prod(target.shape), draw)


def _nominal(target: VariedValue) -> FloatArray:
    if target.nominal is None:
        raise ValueError("has no value to vary about; set one in the experiment, or use a distribution of values")
    return target.nominal


def _parsed(value: Any, target: VariedValue, shape: tuple[int, ...]) -> FloatArray:
    """Numbers in SI units of this shape."""
    if shape:
        if not isinstance(value, list | tuple) or len(value) != shape[0]:
            raise ValueError(f"is {value!r}; expected {shape[0]} elements")
        return np.array([_parsed(element, target, shape[1:]) for element in value])
    return np.array(number(value, target.unit or PLAIN))


def _scores(u: FloatArray) -> FloatArray:
    """Φ⁻¹(u)."""
    from scipy.special import ndtri  # not needed, and slow, without an ensemble

    return np.asarray(ndtri(u))


def normal(u: FloatArray, mean: FloatArray, deviation: FloatArray) -> FloatArray:
    """N(μ, σ²): μ + σ Φ⁻¹(u)."""
    return np.asarray(mean + deviation * _scores(u))


def _quantile(kind: str, value: Any, target: VariedValue) -> Quantile:
    """The quantile function of a distribution of numbers: normal, uniform, truncated_normal or lognormal."""
    parts, (sizes, wanted) = list(value) if isinstance(value, list | tuple) else [value], _WANTED[kind]
    if len(parts) not in sizes:
        raise ValueError(f"{kind} is {value!r}; expected {wanted} about the present value")
    # one number for all elements, or one for each
    numbers = [
        np.array(number(part, PLAIN))
        if kind == "lognormal" and k == len(parts) - 1
        else _parsed(part, target, target.shape if isinstance(part, list | tuple) else ())
        for k, part in enumerate(parts)
    ]
    if kind == "truncated_normal" and len(numbers) == 2:  # about the present value, between bounds
        deviation, bound = numbers
        _check_spread(bound, value, "a bound > 0")
        numbers = [_nominal(target), deviation, _nominal(target) - bound, _nominal(target) + bound]
    elif kind == "uniform" and len(numbers) == 1:
        _check_spread(numbers[0], value, "a half width > 0")
        numbers = [_nominal(target) - numbers[0], _nominal(target) + numbers[0]]
    elif len(numbers) == 1:
        numbers = [_nominal(target), *numbers]
    if kind == "lognormal":  # the logarithm is normal, with mean ln m and deviation s: m exp(s Φ⁻¹(u))
        median, deviation = numbers
        if not (median > 0).all():
            raise ValueError(f"lognormal has the median {median.tolist()}; expected a median > 0")
        _check_spread(deviation, value, "a deviation of the logarithm > 0")
        return lambda u: np.asarray(median * np.exp(deviation * _scores(u)))
    if kind == "uniform":  # a + (b − a) u
        low, high = numbers
        _check_spread(high - low, value, "the lower bound below the upper one")
        return lambda u: np.asarray(low + (high - low) * u)
    mean, deviation = numbers[:2]
    _check_spread(deviation, value, "a standard deviation > 0")
    if kind == "normal":
        return lambda u: normal(u, mean, deviation)
    low, high = numbers[2:]
    _check_spread(high - low, value, "the lower bound below the upper one")

    def truncated(u: FloatArray) -> FloatArray:
        """μ + σ Φ⁻¹(Φ(α) + u (Φ(β) − Φ(α))), α and β the bounds as multiples of σ from μ."""
        from scipy.special import ndtr

        a, b = (low - mean) / deviation, (high - mean) / deviation
        # near 1, differences of Φ lose digits: in the upper tail use the mirrored distribution
        upper = a > 0
        a, b, v = np.where(upper, -b, a), np.where(upper, -a, b), np.where(upper, 1 - u, u)
        z = _scores(ndtr(a) + v * (ndtr(b) - ndtr(a)))
        return np.clip(mean + deviation * np.where(upper, -z, z), low, high)

    return truncated


def _check_spread(size: FloatArray, value: Any, expected: str) -> None:
    if not (size > 0).all():
        raise ValueError(f"is {value!r}, without a spread; expected {expected}")


# How many numbers a distribution has, and what they are.
_WANTED: dict[str, tuple[tuple[int, ...], str]] = {
    "normal": ((1, 2), "[mean, standard deviation], or a standard deviation"),
    "uniform": ((1, 2), "[low, high], or half the width"),
    "truncated_normal": ((2, 4), "[mean, standard deviation, low, high], or [standard deviation, bound]"),
    "lognormal": ((1, 2), "[median, standard deviation of the logarithm], or that deviation"),
}


# --- the table -------------------------------------------------------------------------------------------------------

MEMBERS = 1000
MOST_MEMBERS = 10_000_000
# Finer than that of single runs: a hundredth costs a few internal steps more in a few rows.
TOLERANCE = 1e-10


class EnsembleChoice(TableSection):
    """`[ensemble]`: keys other than these fields name what varies.

    A bare name is a parameter of the machine (`platform_mass`); other keys go by table: `controller.bandwidth`,
    `loop.delay`, `platform.platform_mass` (of the nominal model), `disturbance.1.force`.
    """

    model_config = ConfigDict(extra="allow")

    # None: 1000, or the number of combinations of the grids
    members: Annotated[int, Field(ge=1, le=MOST_MEMBERS)] | None = None
    # of draws, noise and jitter; the sensors' seed by default
    seed: Annotated[int, Field(ge=0)] | None = None
    sampling: Sampling = "random"
    # of the members' internal steps; `[plant]` tolerance is that of the other plants
    tolerance: Annotated[Number, Field(ge=TOLERANCES[0], le=TOLERANCES[1])] = TOLERANCE
    # the signals kept as bands over time
    signals: list[str] | None = None
    # whether to compute the margins of each member's loop
    margins: bool = False
    # how many of the worst members get a full record, and the metric that ranks them
    worst: Annotated[int, Field(ge=0, le=1000)] = 5
    worst_by: str | None = None
    correlation: list[CorrelatedInputs] = Field(default_factory=list)
    covariance: list[CorrelatedInputs] = Field(default_factory=list)
    _varied: dict[str, Variation]

    @model_validator(mode="after")
    def _parse(self) -> "EnsembleChoice":
        self._varied = dict(_variations("", self.model_extra or {}))
        return self

    @property
    def varied(self) -> Mapping[str, Variation]:
        """What varies, by key as written."""
        return self._varied


def _variations(prefix: str, table: Mapping[str, Any]) -> Iterator[tuple[str, Variation]]:
    """The distributions in a table and its subtables, by dotted key."""
    for name, value in table.items():
        key = f"{prefix}{name}"
        if isinstance(value, Variation):
            yield key, value
        elif not isinstance(value, Mapping):
            raise ValueError(  # noqa: TRY004 - pydantic wants this one
                f"{key}: is {value!r}; expected a setting of the ensemble ({', '.join(EnsembleChoice.model_fields)}), "
                "or the distribution of a varied value: {normal = [mean, deviation]}"
            )
        elif value.keys() & Variation.model_fields.keys():
            try:
                yield key, Variation.built().model_validate(value)
            except ValidationError as error:
                raise ValueError(f"{key}: {complaints(error, Variation, value)}") from None
        else:
            yield from _variations(f"{key}.", value)
