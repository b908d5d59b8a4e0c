"""`[ensemble]`: how one value varies, and the points of members in the unit cube.

`{ normal = ["120 kg", "10 kg"] }` and others: quantile functions turn numbers in (0, 1), random ones or those of a
design, into values. All are computed element by element, so a value does not depend on its neighbours. Inputs may be
correlated: of correlations a Gaussian copula, of covariances a multivariate normal distribution.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import ceil, log2, prod
from typing import Annotated, Any, Literal
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, ValidationError, model_validator

from gough_stewart.harness.section import Number, TableSection, complaints
from gough_stewart.model.interface import TOLERANCES
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.units import PLAIN, number
from gough_stewart.model.vectors import FloatArray, real_array

Sampling = Literal["random", "latin_hypercube", "sobol", "saltelli"]
# Streams of the draws, separate from those of noise, which are children 0, 1, … of a member's seed.
_STREAM = 0x656E73
# The most numbers of a Latin hypercube, which can only be drawn as a whole.
MOST_OF_A_HYPERCUBE = 20_000_000
# Numbers that Philox draws per step of its counter.
_PER_STEP = 4
_SMALLEST = 2.0**-53
# Relative to the largest eigenvalue; smaller values are rounding errors.
_POSITIVE = 1e-12
# Most repetitions of a reordering; it ends when one does not improve it.
_ROUNDS = 20


@dataclass(frozen=True)
class SamplingDesign:
    """Points (members, size) in the open unit cube; those of member k depend only on the design and k.

    - "random": member k's numbers depend on the seed, the names and k, not on the number of members.
    - "sobol": scrambled Sobol' points; a longer sequence starts with the same points.
    - "latin_hypercube": depends on the number of members.
    - "saltelli": for Sobol' indices, in SALib's order without second order: for every point of two matrices
      A and B a row of A, for each group a row of A with that group from B, and the row of B.

    A number of members that the design does not allow is a `ValueError`.
    """

    sampling: Sampling
    seed: int
    members: int
    names: tuple[str, ...]  # of the varied inputs
    sizes: tuple[int, ...]  # the number of columns of each
    groups: tuple[tuple[int, ...], ...] = ()  # of names that count as one in Saltelli's design, by index
    size: int = field(init=False)  # numbers per member
    block: int = field(init=False)  # members per point: more than one in Saltelli's design

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", sum(self.sizes))
        object.__setattr__(self, "block", len(self.groups) + 2 if self.sampling == "saltelli" else 1)
        if self.members % self.block:
            # a Sobol' sequence is balanced at powers of two
            near = 2 ** max(0, round(log2(self.members / self.block))) * self.block
            raise ValueError(
                f"members is {self.members}; Saltelli's design needs {self.block} per point ({len(self.groups)} inputs "
                f"plus 2), expected a multiple, for instance {near}"
            )
        if self.sampling == "latin_hypercube" and self.members * self.size > MOST_OF_A_HYPERCUBE:
            raise ValueError(
                f"a Latin hypercube of {self.members} members with {self.size} numbers each can only be drawn as a "
                f"whole; expected at most {MOST_OF_A_HYPERCUBE} numbers; use sampling = 'sobol' or 'random'"
            )

    def points(self, first: int, last: int) -> FloatArray:
        """The points of members first to last − 1 (last − first, size)."""
        if not self.size:
            return np.zeros((last - first, 0))
        if self.sampling == "random":
            # of each name a counter-based stream, so that each member can start at its own position
            parts = []
            for name, size in zip(self.names, self.sizes, strict=True):
                steps = ceil(size / _PER_STEP)
                bits = np.random.Philox(np.random.SeedSequence(self.seed, spawn_key=(_STREAM, crc32(name.encode()))))
                bits.advance(first * steps)
                numbers = np.random.Generator(bits).random((last - first, steps * _PER_STEP))
                parts.append(numbers[:, :size])
            points = np.concatenate(parts, axis=1)
        elif self.sampling == "latin_hypercube":
            points = _hypercube(self.size, self.members, self.seed)[first:last]
        else:
            from scipy.stats import qmc  # takes half a second, and is needed for these designs only

            block, d = self.block, self.size
            begin, end = first // block, ceil(last / block)
            rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(_STREAM,)))
            # an interrupt while it reads its table of directions is lost, and the points would be others
            with interrupts_held_back():
                engine = qmc.Sobol(d if self.sampling == "sobol" else 2 * d, scramble=True, rng=rng)
            if begin:
                engine.fast_forward(begin)
            with (
                warnings.catch_warnings()
            ):  # of counts that are not powers of two: chunks are parts of a longer sequence
                warnings.simplefilter("ignore", UserWarning)
                points = np.asarray(engine.random(end - begin))
            if self.sampling == "saltelli":  # A, A with one group of inputs from B each, B
                A, B = points[:, :d], points[:, d:]
                ends, rows = np.cumsum((0, *self.sizes)), [A]
                for group in self.groups:
                    mixed = A.copy()
                    for k in group:
                        mixed[:, ends[k] : ends[k + 1]] = B[:, ends[k] : ends[k + 1]]
                    rows.append(mixed)
                ordered = np.stack([*rows, B], axis=1).reshape(-1, d)
                points = ordered[first - begin * block : last - begin * block]
        return np.asarray(np.maximum(points, _SMALLEST))


@lru_cache(2)
def _hypercube(size: int, members: int, seed: int) -> FloatArray:
    from scipy.stats import qmc

    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    return np.asarray(qmc.LatinHypercube(size, rng=rng).random(members))


class CorrelatedInputs(TableSection):
    """`[[ensemble.correlation]]` and `[[ensemble.covariance]]`: inputs and their matrix, in SI units.

    A vector stands for its elements in order.
    """

    of: list[str]
    matrix: list[list[Any]]

    @model_validator(mode="after")
    def _positive(self) -> "CorrelatedInputs":
        if len(set(self.of)) < len(self.of) or not self.of:
            raise ValueError(f"of is {self.of}; expected different names")
        try:
            C = self.values
        except ValueError as error:
            raise ValueError(f"the matrix {error}") from None
        if np.abs(C - C.T).max(initial=0.0) > 1e-9 * np.abs(C).max(initial=0.0):
            raise ValueError("the matrix is not symmetric")
        # scaled to correlations, so that different units do not make it look singular
        worst = float(np.diag(C).min(initial=np.inf))
        if worst > 0:
            worst = float(np.linalg.eigvalsh(correlation_of(C))[0])
        if not worst > _POSITIVE:
            raise ValueError(
                f"the matrix is not positive definite (smallest eigenvalue {worst:.3g}, scaled to correlations); "
                "expected > 0: reduce the correlations, or remove inputs that depend entirely on others"
            )
        return self

    @property
    def values(self) -> FloatArray:
        """The matrix (n, n)."""
        n = len(self.matrix)
        return real_array(self.matrix, (n, n))


def correlation_of(covariance: FloatArray) -> FloatArray:
    """R = D^(−1/2) C D^(−1/2) with the diagonal D of C."""
    scale = 1 / np.sqrt(np.diag(covariance))
    return np.asarray(covariance * scale * scale[:, None])


def correlated(u: FloatArray, correlation: FloatArray) -> FloatArray:
    """Turn independent uniform numbers (n, k) into ones whose normal scores have a correlation (k, k).

    z = L Φ⁻¹(u), R = L Lᵀ, and Φ(z); summed column by column, so that a row does not depend on those beside it.
    """
    from scipy.special import ndtr, ndtri

    L = np.linalg.cholesky(correlation)
    z = ndtri(u)
    out = np.empty_like(u)
    for i in range(u.shape[1]):
        total = z[:, 0] * L[i, 0]
        for j in range(1, i + 1):
            total = total + z[:, j] * L[i, j]
        out[:, i] = total
    return np.clip(ndtr(out), _SMALLEST, 1 - _SMALLEST)


def reordered(u: FloatArray, correlation: FloatArray) -> FloatArray:
    """Reorder the columns of a whole design (N, k) until their normal scores have nearly a correlation (k, k).

    Each column keeps its numbers, so one in each layer of a Latin hypercube. Scores z = Φ⁻¹(u) of correlation T = Q Qᵀ
    become z Q⁻ᵀ Pᵀ with R = P Pᵀ, and each column takes the order of its new scores; repeated with what is left of the
    difference. Iman & Conover, Commun. Statist. – Simul. Comput. 11 (1982) 311.
    """
    from scipy.special import ndtri

    n, k = u.shape
    ordered = np.sort(u, axis=0)
    scores, P = ndtri(ordered), np.linalg.cholesky(correlation)
    # of few members, which have no correlation of their own to correct
    best, least = np.take_along_axis(ordered, _ranks(correlated(u, correlation)), axis=0), np.inf
    z = ndtri(u)
    for _ in range(_ROUNDS if n > k else 0):
        try:
            Q = np.linalg.cholesky(np.corrcoef(z.T))
        except np.linalg.LinAlgError:  # singular up to rounding
            break
        ranks = _ranks(np.linalg.solve(Q, z.T).T @ P.T)
        z = np.take_along_axis(scores, ranks, axis=0)
        gap = float(np.abs(np.corrcoef(z.T) - correlation).max())
        if not gap < least:
            break
        best, least = np.take_along_axis(ordered, ranks, axis=0), gap
    return best


def _ranks(values: FloatArray) -> NDArray[np.intp]:
    return values.argsort(axis=0, kind="stable").argsort(axis=0)


# --- distributions ---------------------------------------------------------------------------------------------------


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
    is_mixed: bool = False  # of texts, numbers and switches, which a column of a table has as texts


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

    _kind: str  # the key that is set

    @model_validator(mode="after")
    def _one_of_them(self) -> "Variation":
        names = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(names) != 1:
            raise ValueError(
                f"expected one of {', '.join(type(self).model_fields)}; found {' and '.join(names) or 'none'}"
            )
        self._kind = names[0]
        return self

    def spread(self, target: VariedValue) -> Spread:  # noqa: PLR0912, PLR0915 - a section for each kind
        """The spread of a target under this distribution; a `ValueError` says what is no distribution of it."""
        kind = self._kind
        value = getattr(self, kind)
        if kind in ("factor", "offset") and value._kind in ("factor", "offset"):
            raise ValueError(f"{kind} of a {value._kind}; expected a distribution in it")
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

            is_mixed = not is_number and len(set(map(type, value))) > 1
            return Spread(1, draw_one, n if kind == "grid" else None, is_mixed=is_mixed)
        if target.unit is None:
            raise ValueError(f"{kind} applies to numbers only; expected choice or grid")
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
        middle, deviation, *bounds = numbers
        if kind == "uniform":
            bounds = numbers
        elif kind == "lognormal":
            if not (middle > 0).all():
                raise ValueError(f"lognormal has the median {middle.tolist()}; expected a median > 0")
            _check_spread(deviation, value, "a deviation of the logarithm > 0")
        else:
            _check_spread(deviation, value, "a standard deviation > 0")
        if bounds:
            _check_spread(bounds[1] - bounds[0], value, "the lower bound below the upper one")

        def draw(u: FloatArray) -> FloatArray:
            u = u.reshape(len(u), *target.shape)
            if kind == "uniform":  # a + (b − a) u
                drawn = bounds[0] + (bounds[1] - bounds[0]) * u
            elif kind == "normal":
                drawn = normal(u, middle, deviation)
            elif kind == "lognormal":  # the logarithm is normal, with mean ln m and deviation s: m exp(s Φ⁻¹(u))
                drawn = middle * np.exp(deviation * normal(u))
            else:  # μ + σ Φ⁻¹(Φ(α) + u (Φ(β) − Φ(α))), α and β the bounds as multiples of σ from μ
                from scipy.special import ndtr

                a, b = ((bound - middle) / deviation for bound in bounds)
                # near 1, differences of Φ lose digits: in the upper tail use the mirrored distribution
                upper = a > 0
                a, b, v = np.where(upper, -b, a), np.where(upper, -a, b), np.where(upper, 1 - u, u)
                z = normal(ndtr(a) + v * (ndtr(b) - ndtr(a)))
                drawn = np.clip(middle + deviation * np.where(upper, -z, z), *bounds)
            # of a symmetric matrix, the elements above the diagonal, and their mirror images
            return np.triu(drawn) + np.swapaxes(np.triu(drawn, 1), -1, -2) if target.is_symmetric else np.asarray(drawn)

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


def normal(u: FloatArray, mean: FloatArray | float = 0.0, deviation: FloatArray | float = 1.0) -> FloatArray:
    """N(μ, σ²): μ + σ Φ⁻¹(u)."""
    from scipy.special import ndtri  # not needed, and slow, without an ensemble

    return np.asarray(mean + deviation * ndtri(u))


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
        """Find the distributions in the table and its subtables, by dotted key."""
        self._varied, pending = {}, list((self.model_extra or {}).items())
        while pending:
            key, value = pending.pop(0)
            if isinstance(value, Variation):
                self._varied[key] = value
            elif not isinstance(value, Mapping):
                raise ValueError(  # noqa: TRY004 - pydantic wants this one
                    f"{key}: is {value!r}; expected a setting of the ensemble "
                    f"({', '.join(type(self).model_fields)}), "
                    "or the distribution of a varied value: {normal = [mean, deviation]}"
                )
            elif value.keys() & Variation.model_fields.keys():
                try:
                    self._varied[key] = Variation.built().model_validate(value)
                except ValidationError as error:
                    raise ValueError(f"{key}: {complaints(error, Variation, value)}") from None
            else:
                pending[:0] = [(f"{key}.{name}", part) for name, part in value.items()]
        return self

    @property
    def varied(self) -> Mapping[str, Variation]:
        """What varies, by key as written."""
        return self._varied
