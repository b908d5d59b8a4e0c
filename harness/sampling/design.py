"""The points of members in the unit cube, random or of a design, and inputs that are correlated.

Of correlations a Gaussian copula, of covariances a multivariate normal distribution.
"""

import math
import warnings
from dataclasses import dataclass
from functools import lru_cache
from math import ceil
from typing import Any, Literal
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from gough_stewart.harness.section import TableSection
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.vectors import FloatArray, real_array

Sampling = Literal["random", "latin_hypercube", "sobol", "saltelli"]
# Streams of the draws, separate from those of noise, which are children 0, 1, … of a member's seed.
_STREAM = 0x656E73
# The most numbers of a Latin hypercube, which can only be drawn as a whole.
MOST_OF_A_HYPERCUBE = 20_000_000
# Numbers that Philox draws per step of its counter.
_PER_STEP = 4
_SMALLEST = 2.0**-53


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

    def __post_init__(self) -> None:
        if self.members % self.block:
            # of a Sobol sequence, whose numbers are powers of two
            near = 2 ** max(0, round(math.log2(self.members / self.block))) * self.block
            raise ValueError(
                f"members is {self.members}; Saltelli's design needs {self.block} per point ({len(self.groups)} inputs "
                f"plus 2), expected a multiple, for instance {near}"
            )
        if self.sampling == "latin_hypercube" and self.members * self.size > MOST_OF_A_HYPERCUBE:
            raise ValueError(
                f"a Latin hypercube of {self.members} members with {self.size} numbers each can only be drawn as a "
                f"whole; expected at most {MOST_OF_A_HYPERCUBE} numbers; use sampling = 'sobol' or 'random'"
            )

    @property
    def size(self) -> int:
        """Numbers per member."""
        return sum(self.sizes)

    @property
    def block(self) -> int:
        """Members per point: more than one in Saltelli's design."""
        return len(self.groups) + 2 if self.sampling == "saltelli" else 1

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
        elif self.sampling == "sobol":
            points = _sobol(self.size, self.seed, first, last)
        else:  # Saltelli's: A, A with one group of inputs from B each, B
            block, d = self.block, self.size
            base = _sobol(2 * d, self.seed, first // block, ceil(last / block))
            A, B = base[:, :d], base[:, d:]
            ends, rows = np.cumsum((0, *self.sizes)), [A]
            for group in self.groups:
                mixed = A.copy()
                for k in group:
                    mixed[:, ends[k] : ends[k + 1]] = B[:, ends[k] : ends[k + 1]]
                rows.append(mixed)
            ordered = np.stack([*rows, B], axis=1).reshape(-1, d)
            at = first - first // block * block
            points = ordered[at : at + last - first]
        return np.asarray(np.maximum(points, _SMALLEST))


def _sobol(size: int, seed: int, first: int, last: int) -> FloatArray:
    from scipy.stats import qmc  # takes half a second, and is needed for these designs only

    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    # an interrupt while it reads its table of directions is lost, and the points would be others
    with interrupts_held_back():
        engine = qmc.Sobol(size, scramble=True, rng=rng)
    if first:
        engine.fast_forward(first)
    with warnings.catch_warnings():  # of counts that are not powers of two: chunks are parts of a longer sequence
        warnings.simplefilter("ignore", UserWarning)
        return np.asarray(engine.random(last - first))


@lru_cache(2)
def _hypercube(size: int, members: int, seed: int) -> FloatArray:
    from scipy.stats import qmc

    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    return np.asarray(qmc.LatinHypercube(size, rng=rng).random(members))


# Relative to the largest eigenvalue; smaller values are rounding errors.
_POSITIVE = 1e-12
# Most repetitions of a reordering; it ends when one does not improve it.
_ROUNDS = 20


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
