"""`{ normal = ["120 kg", "10 kg"] }` and others: how one value varies, as written in an experiment file.

Quantile functions turn numbers in (0, 1), random ones or those of a design, into values. All are computed element by
element, so a value does not depend on its neighbours.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import prod
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from gough_stewart.harness.section import Section
from gough_stewart.model.units import PLAIN, number, plain_number
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


class Variation(Section):
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
        """The spread of a target under this distribution.

        Raises
        ------
        ValueError
            Numbers that are not a distribution of this target, one without a spread, or a deviation from a missing
            value.
        """
        kind = self.kind
        if self.factor is not None:
            return self._of_factor(self.factor, target)
        if self.offset is not None:
            nominal = _nominal(target)
            inner = _only_values(self.offset, "offset").spread(replace(target, nominal=np.zeros(target.shape)))
            return replace(inner, draw=lambda u: nominal + np.asarray(inner.draw(u), dtype=float))
        if kind in ("choice", "grid"):
            return self._of_values(kind, getattr(self, kind), target)
        if target.unit is None:
            raise ValueError(f"{kind} applies to numbers only; expected choice or grid")
        quantile = _DISTRIBUTIONS[kind](getattr(self, kind), target)

        def draw(u: FloatArray) -> FloatArray:
            drawn = quantile(u.reshape(len(u), *target.shape))
            if not target.is_symmetric:
                return drawn
            # the elements above the diagonal, and their mirror images
            return np.triu(drawn) + np.swapaxes(np.triu(drawn, 1), -1, -2)

        return Spread(prod(target.shape), draw)

    def _of_factor(self, factor: "Variation", target: VariedValue) -> Spread:
        nominal = _nominal(target)
        inner = _only_values(factor, "factor").spread(VariedValue("factor", PLAIN, (), np.ones(())))

        def drawn(u: FloatArray) -> FloatArray:
            return np.asarray(inner.draw(u), dtype=float)

        def draw(u: FloatArray) -> FloatArray:
            return drawn(u).reshape(-1, *(1 for _ in target.shape)) * nominal

        return Spread(1, draw, inner.levels, drawn)

    @staticmethod
    def _of_values(kind: str, values: list[Any], target: VariedValue) -> Spread:
        if not values:
            raise ValueError(f"{kind} has no values; expected at least two")
        parsed = values if target.unit is None else [_parsed(value, target, target.shape) for value in values]
        if all(np.array_equal(value, parsed[0]) for value in parsed):
            raise ValueError(f"{kind} is {values!r}, without a spread; expected at least two values that differ")
        among = values if all(isinstance(value, int) for value in values) else parsed

        def draw(u: FloatArray) -> Any:
            return _choice(u, among) if target.unit is None else np.asarray(_choice(u, among))

        return Spread(1, draw, len(values) if kind == "grid" else None)


def _only_values(inner: Variation, where: str) -> Variation:
    if inner.kind in ("factor", "offset"):
        raise ValueError(f"{where} of a {inner.kind}; expected a distribution in it")
    return inner


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


def _number_or_all(value: Any, target: VariedValue) -> FloatArray:
    """One number for all elements, or one for each."""
    return _parsed(value, target, target.shape if isinstance(value, list | tuple) else ())


def _listed(value: Any, sizes: tuple[int, ...], kind: str) -> list[Any]:
    numbers = list(value) if isinstance(value, list | tuple) else [value]
    if len(numbers) not in sizes:
        raise ValueError(f"{kind} is {value!r}; expected {_WANTED[kind]}")
    return numbers


def _positive(size: FloatArray, value: Any, expected: str) -> FloatArray:
    if not (size > 0).all():
        raise ValueError(f"is {value!r}, without a spread; expected {expected}")
    return size


def normal(u: FloatArray, mean: FloatArray, deviation: FloatArray) -> FloatArray:
    """N(μ, σ²): μ + σ Φ⁻¹(u)."""
    return np.asarray(mean + deviation * _scores(u))


def _normal(value: Any, target: VariedValue) -> Quantile:
    *mean, deviation = _listed(value, (1, 2), "normal")
    middle = _number_or_all(mean[0], target) if mean else _nominal(target)
    size = _positive(_number_or_all(deviation, target), value, "a standard deviation > 0")
    return lambda u: normal(u, middle, size)


def _uniform(value: Any, target: VariedValue) -> Quantile:
    """From a to b: a + (b − a) u."""
    bounds = [_number_or_all(bound, target) for bound in _listed(value, (1, 2), "uniform")]
    if len(bounds) == 1:
        half = _positive(bounds[0], value, "a half width > 0")
        bounds = [_nominal(target) - half, _nominal(target) + half]
    else:
        _positive(bounds[1] - bounds[0], value, "the lower bound below the upper one")
    low, high = bounds
    return lambda u: np.asarray(low + (high - low) * u)


def _truncated_normal(value: Any, target: VariedValue) -> Quantile:
    """N(μ, σ²) between two bounds: μ + σ Φ⁻¹(Φ(α) + u (Φ(β) − Φ(α))), α and β the bounds as multiples of σ from μ."""
    parts = [_number_or_all(part, target) for part in _listed(value, (2, 4), "truncated_normal")]
    if len(parts) == 2:
        deviation, bound = parts
        _positive(bound, value, "a bound > 0")
        mean, low, high = _nominal(target), _nominal(target) - bound, _nominal(target) + bound
    else:
        mean, deviation, low, high = parts
    _positive(deviation, value, "a standard deviation > 0")
    _positive(high - low, value, "the lower bound below the upper one")

    def quantile(u: FloatArray) -> FloatArray:
        from scipy.special import ndtr

        a, b = (low - mean) / deviation, (high - mean) / deviation
        # near 1, differences of Φ lose digits: in the upper tail use the mirrored distribution
        upper = a > 0
        a, b, v = np.where(upper, -b, a), np.where(upper, -a, b), np.where(upper, 1 - u, u)
        z = _scores(ndtr(a) + v * (ndtr(b) - ndtr(a)))
        return np.clip(mean + deviation * np.where(upper, -z, z), low, high)

    return quantile


def _lognormal(value: Any, target: VariedValue) -> Quantile:
    """The logarithm is normal, with mean ln m and deviation s: m exp(s Φ⁻¹(u)); m is the median."""
    *median, deviation = _listed(value, (1, 2), "lognormal")
    middle = _number_or_all(median[0], target) if median else _nominal(target)
    if not (middle > 0).all():
        raise ValueError(f"lognormal has the median {middle.tolist()}; expected a median > 0")
    size = _positive(np.array(plain_number(deviation)), value, "a deviation of the logarithm > 0")
    return lambda u: np.asarray(middle * np.exp(size * _scores(u)))


def _scores(u: FloatArray) -> FloatArray:
    """Φ⁻¹(u)."""
    from scipy.special import ndtri  # not needed, and slow, without an ensemble

    return np.asarray(ndtri(u))


def _choice(u: FloatArray, values: Sequence[Any]) -> list[Any]:
    """One of n values with equal probability, the one at ⌊n u⌋, for each of u (m, 1)."""
    n = len(values)
    return [values[min(int(n * share), n - 1)] for share in np.ravel(u).tolist()]


_DISTRIBUTIONS: dict[str, Callable[[Any, VariedValue], Quantile]] = {
    "normal": _normal,
    "uniform": _uniform,
    "truncated_normal": _truncated_normal,
    "lognormal": _lognormal,
}
_WANTED = {
    "normal": "[mean, standard deviation], or a standard deviation about the present value",
    "uniform": "[low, high], or half the width about the present value",
    "truncated_normal": "[mean, standard deviation, low, high], or [standard deviation, bound] about the present value",
    "lognormal": "[median, standard deviation of the logarithm], or that deviation about the present value",
}
