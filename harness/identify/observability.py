"""Which parameters the motion of a log determines, judged on that motion alone.

Noise of the lengths that passes the filters excites, too: accelerations of a micrometre at 40 Hz look like rotations
that the platform never made, and give heave alone a centre of mass. Here lengths are low-passed just above the motion,
which takes a million times more from the information of noise than from that of the motion. What noise adds to the
regressor pulls estimates towards 0; by how much follows from its covariance after the filters: the regressor at each
row, with legs that are off by the principal axes of that covariance.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.log import Part
from gough_stewart.harness.identify.lowpass import HALF_LENGTH, cutoff_of, edge, smoothed
from gough_stewart.harness.identify.regressor import (
    COM,
    elements_of,
    force_derivatives,
    gradient,
    linear_parameters,
    regressor,
    smooth_motion,
    with_estimated,
)
from gough_stewart.harness.identify.row_model import length_kernels, spacing_of
from gough_stewart.harness.identify.screen import noise_of
from gough_stewart.model.kernel import parameter_vector
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# The cut-off of rows is 16 times the motion's highest frequency; lengths are low-passed at this share of it.
_OF_CUTOFF = 1 / 8
# At most this share of a part's length for one side of the filter.
_EDGE = 0.15
# A parameter is not excited if its standard error from the motion alone exceeds this share of its scale, if noise of
# lengths pulls it by more than the other share, or if what is held moves it by so many of its standard errors.
_LARGEST_ERROR, _LARGEST_BIAS, _MOVED = 0.5, 0.05, 2.0
# Forces are never known better than this share of their changes, even if they seem to have no noise.
_BEST_FORCE = 1e-3
# Smaller singular values are rounding errors.
_ROUNDING = 1e-9
# Rows of a part at which the effect of noise is computed.
_ROWS_WITH_NOISE = 60


class MotionRows(NamedTuple):
    """Rows of the regression by the motion alone, in standard deviations of the forces' noise."""

    regressor: FloatArray  # W (m, 6, SIZE), each row over the deviation of its force
    noise: FloatArray  # N (k, 6, SIZE): what noise of the lengths adds to Wᵀ W is Nᵀ N
    force: float  # typical change of forces [N]
    velocity: float  # typical velocity of legs [m/s]


class Identifiability(NamedTuple):
    """How well a motion determines elements."""

    bias: FloatArray  # (p,) expected error by noise of the lengths in the regressor, in units of the scale
    not_excited: tuple[str, ...]  # elements that get no number
    held: tuple[str, ...]  # of these, the ones that stay at nominal in the fit, so that the others can follow the log


def motion_rows(parts: Sequence[Part], platform: Platform, cutoff: float | None = None) -> MotionRows | None:
    """The rows by the motion alone of all fitted parts; None if all are shorter than the filter."""
    regressors, added, forces, velocities = [], [], [], []
    for whole in parts:
        n = int(whole.is_fitted(whole.time).sum())
        if n < 8:
            continue
        part, h = whole.rows(slice(0, n)), whole.rows(slice(0, n)).step
        row_cutoff = min(cutoff_of(whole.length, h) if cutoff is None else cutoff, 0.5 / h / 3)
        low = max(_OF_CUTOFF * row_cutoff, HALF_LENGTH / (_EDGE * n * h))
        every, thin = spacing_of(h, row_cutoff)
        if n <= 2 * edge(h, low) + 2 * every * (edge(h * every, row_cutoff) + 1) or low > row_cutoff:
            continue
        lengths, motion = smooth_motion(part, platform, low, every)
        W = regressor(platform, motion)
        clean = smoothed(W.reshape(len(W), -1), h * every, row_cutoff, thin).reshape(-1, 6, W.shape[-1])
        deviation = np.maximum(noise_of(part.force) * np.sqrt(2 * row_cutoff * h), _BEST_FORCE * part.force.std(axis=0))
        deviation = np.maximum(deviation, _ROUNDING * float(np.abs(part.force).max()))
        # the filter's ends count as well
        share = np.sqrt(n / (len(clean) * every * thin)) / np.maximum(deviation, np.finfo(float).tiny)[:, None]
        regressors.append(share * clean)
        sampled = motion[np.unique(np.linspace(0, len(motion) - 1, _ROWS_WITH_NOISE).astype(int))]
        by_legs = force_derivatives(sampled, parameter_vector(platform), np.zeros((len(sampled), 6))).motion_by_legs
        # columns of value, velocity and acceleration of one leg that together have the covariance of its noise
        kernels = length_kernels(h, row_cutoff)
        axes, moved = np.linalg.cholesky(kernels @ kernels.T), [sampled]
        for leg, size in enumerate(noise_of(part.length)):
            directions = size * by_legs[:, :, leg::6] @ axes
            moved += [sampled + directions[:, :, k] for k in range(3)]
        by_motion = regressor(platform, np.concatenate(moved)).reshape(len(moved), *W[: len(sampled)].shape)
        noise = (by_motion[1:] - by_motion[0]).reshape(-1, *W.shape[1:])
        added.append(share * np.sqrt(len(clean)) * (noise / np.sqrt(len(sampled))))
        forces.append(float(part.force.std(axis=0).mean()))
        velocities.append(float(np.sqrt((lengths[1] ** 2).mean())))
    if not regressors:
        return None
    force, velocity = float(np.mean(forces)), float(np.mean(velocities))
    return MotionRows(np.concatenate(regressors), np.concatenate(added), force, velocity)


def identifiability(
    rows: MotionRows, platform: Platform, names: Sequence[str], values: FloatArray, scale: FloatArray
) -> Identifiability:
    """What of these elements the motion determines, near these values."""
    elements = with_estimated(elements_of(platform), names, values.tolist())
    G = gradient(elements, names) * scale
    D, N = ((W @ G).reshape(-1, len(names)) for W in (rows.regressor, rows.noise))
    R = np.asarray(np.linalg.qr(D, mode="r"))
    errors = _errors(R)
    # (Iₘ + Iₙ)⁻¹ Nᵀ (Wₙ φ): noise makes forces that are not there
    inverse = np.linalg.pinv(D.T @ D + N.T @ N, hermitian=True)
    bias = inverse @ (N.T @ (rows.noise @ linear_parameters(elements)).ravel())
    left = list(range(len(names)))
    # centres of mass are held first: inertias then take what the log knows of both, and need not be those of a body
    while left and (now := _errors(R[:, left])).max() > _LARGEST_ERROR:
        candidates = [k for k, error in zip(left, now, strict=True) if error > _LARGEST_ERROR]
        left.remove(max(candidates, key=lambda k: (names[k] in COM, errors[k])))
    held = [k for k in range(len(names)) if k not in left]
    weak = (errors > _LARGEST_ERROR) | (np.abs(bias) > _LARGEST_BIAS)
    if left and held:
        # where legs hardly move, viscous friction makes up for a wrong Coulomb friction
        by_held = np.linalg.lstsq(R[:, left], R[:, held], rcond=None)[0]
        weak[left] |= _LARGEST_ERROR * np.linalg.norm(by_held, axis=1) > _MOVED * now
    return Identifiability(
        -bias,
        tuple(name for name, is_weak in zip(names, weak, strict=True) if is_weak),
        tuple(names[k] for k in held),
    )


def _errors(R: FloatArray) -> FloatArray:
    """Standard errors (p,) of a regression with this R; infinite where it is singular."""
    _, sigma, directions = np.linalg.svd(R, full_matrices=False)
    if len(sigma) < R.shape[1]:
        return np.full(R.shape[1], np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(np.sqrt(((directions.T / sigma) ** 2).sum(axis=1)), nan=np.inf))


def check_separable(platform: Platform, names: Sequence[str]) -> None:
    """Refuse elements that no motion can tell apart, or that no force depends on."""
    rng = np.random.default_rng(0)
    rho, n = platform.characteristic_length, 20 * (1 + len(names))
    home = np.concatenate([platform.home_position, platform.home_orientation])
    pose = home + 0.1 * np.repeat([rho, 1.0], 3) * rng.standard_normal((n, 6))
    rates = np.tile(np.repeat([rho, 1.0], 3), 2) * rng.standard_normal((n, 12))
    W = regressor(platform, np.concatenate([pose, rates], axis=1))
    D = (W @ gradient(elements_of(platform, names), names)).reshape(-1, len(names))
    size = np.linalg.norm(D, axis=0)
    none = [name for name, norm in zip(names, size, strict=True) if norm == 0]
    if none:
        raise IdentificationError(f"no force depends on {', '.join(none)}; remove them", none)
    # QR with pivots shows the combinations
    R, pivots = qr(D / size, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(R))
    rank = int((diagonal > _ROUNDING * diagonal[0]).sum())
    combined = [names[k] for k in pivots[rank:]]
    if not combined:
        return
    base = np.linalg.solve(R[:rank, :rank], R[:rank, rank:])
    texts = []
    for j, name in enumerate(combined):
        parts = [names[pivots[i]] for i in range(rank) if abs(base[i, j]) > 1e-6]
        texts.append(f"{name} has the same effect as a combination of {', '.join(parts)}")
    raise IdentificationError(f"{'; '.join(texts)}, in any motion; remove one of each", combined)
