"""The corrected simulation of a log: its inputs, its innovations as a function of all parameters, their covariance."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter1d

from gough_stewart.harness.identify.checks import check_forces, check_lengths, force_of, sample_time_of
from gough_stewart.harness.identify.estimate import nominal_values
from gough_stewart.harness.identify.instruments import instruments_of, is_of_instruments, tilt_directions, tilted
from gough_stewart.harness.identify.linear import has_coulomb
from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.identify.movement import motion_of_lengths
from gough_stewart.harness.identify.names import PER_LEG, place_of
from gough_stewart.harness.identify.rows.noise import (
    KernelCorrelations,
    RowNoise,
    kernel_correlations,
    two_noises,
    whitening_of,
)
from gough_stewart.harness.identify.rows.regression import cutoff_of
from gough_stewart.harness.identify.simulation import (
    Innovations,
    PredictorInputs,
    kernel_parameters,
    parameter_columns,
    simulated,
)
from gough_stewart.harness.identify.smoothing import edge, kernel_of, smoothed
from gough_stewart.model.dynamics import mass_matrix
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.vectors import FloatArray

# The filter's cut-off as a multiple of the motion's; a step is this share of its period.
_WIDER = 2.0
_STEPS_A_PERIOD = 4
# RK4 is stable to 2.78 on the real axis. Near that its error at reversals is more than the noise: at 1.5 innovations of
# some right machines had a fifth more variance.
_STIFFEST = 1.0
# Manoeuvring index of the α-β filter: the noise of acceleration relative to that of length, and its limits.
_INDICES = (1e-3, 10.0)
# A leg reverses below this multiple of the smoothing velocity of friction, so many steps around.
_REVERSAL, _LOBE = 10.0, 6
# Steps until the filter has forgotten its start.
SETTLING = 12


class Filters(NamedTuple):
    """The filters of a predictor, and what they leave."""

    alpha: float  # of the α-β filter
    beta: float
    apparent: FloatArray  # apparent mass of the legs over h², at the end of each step (n, 6, 6) [N/m]
    sliding: FloatArray  # 1 for legs that slide around a step, 0 for those that reverse (n, 6)
    correlations: KernelCorrelations  # of the differenced innovations
    # the filtered force if the log's is late by this [s], or its derivative
    force: Callable[..., FloatArray]


def predictor_inputs(
    log: Log, platform: Platform, cutoff: float | None = None
) -> tuple[PredictorInputs, FloatArray, Filters]:
    """The inputs of the simulation, the time at the end of each step (n,) [s], and filters."""
    h = sample_time_of(log)
    check_lengths(log, platform)
    check_forces(log, platform)
    highest = 0.5 / h / (2 * _WIDER)
    cutoff = min(highest, cutoff_of(log.leg_length, h) if cutoff is None else cutoff)
    wide = _WIDER * cutoff
    every = 2 * max(1, int(1 / (2 * _STEPS_A_PERIOD * cutoff * h)))
    delay = -h / 2 if log.holds_force else 0.0

    def late(by: float, derivative: int = 0) -> FloatArray:
        return smoothed(force_of(log), h, wide, every // 2, derivative, delay + by)

    force = late(0.0)
    lengths = [smoothed(log.leg_length, h, wide, every, k) for k in range(3)]
    state, _ = motion_of_lengths(platform, *lengths)
    n, step = len(lengths[0]) - 1, every * h
    J = np.asarray(leg_jacobian(platform, state.position, state.orientation))
    mobility = J @ np.linalg.solve(mass_matrix(platform, state.position, state.orientation), np.swapaxes(J, 1, 2))
    # the noise by the rejected part of the raw signals: only the ratio matters, and the filter passes the same share
    lost = slice(edge(h, wide), -edge(h, wide))
    of_force = float(np.std(force_of(log)[lost] - smoothed(force_of(log), h, wide, 1, 0, delay)))
    of_length = float(np.std(log.leg_length[lost] - smoothed(log.leg_length, h, wide)))
    accelerated = of_force * float(np.einsum("tii->ti", mobility).mean())
    alpha, beta = _gains(accelerated * step**2 / max(of_length, 1e-12))
    inverse, angles = np.linalg.inv(J), state.orientation
    turned = np.stack([orientation_rate_from_angular_velocity(angles, inverse[:, 3:, k]) for k in range(6)], -1)
    gain = np.concatenate([alpha * inverse[:, :3], alpha * turned, beta / step * inverse], axis=1)
    viscous, coulomb = (getattr(platform, name) * getattr(platform, f"{name}_factor") for name in PER_LEG)
    stiffest = float((viscous + coulomb / platform.leg_friction_velocity).max())
    rate = stiffest * float(np.linalg.eigvalsh(mobility).max())
    inputs = PredictorInputs(
        start=state.to_vector()[0],
        force=force[: 2 * n + 1],
        length=lengths[0][1 : n + 1],
        gain=gain[1 : n + 1],
        step=step,
        substeps=max(1, math.ceil(rate * step / _STIFFEST)),
    )
    assert log.time is not None  # checked by sample_time_of
    slowest = minimum_filter1d(np.abs(lengths[1]), 2 * _LOBE + 1, axis=0)
    filters = Filters(
        alpha,
        beta,
        np.linalg.inv(mobility[1 : n + 1]) / step**2,
        np.asarray(slowest[1 : n + 1] > _REVERSAL * platform.leg_friction_velocity, dtype=float),
        difference_correlations(h, wide, every),
        lambda by, derivative=0: late(by, derivative)[: 2 * n + 1],
    )
    return inputs, log.time[edge(h, wide) + every * np.arange(1, n + 1)], filters


def _gains(index: float) -> tuple[float, float]:
    """α and β of the stationary filter with manoeuvring index λ: α = 1 − r², β = 2 (1 − r)², r = (4+λ−√(8λ+λ²))/4."""
    lam = float(np.clip(index, *_INDICES))
    r = (4 + lam - math.sqrt(8 * lam + lam**2)) / 4
    return 1 - r * r, 2 * (1 - r) ** 2


class Predictor:
    """The simulation of one part of a log, as a function of all parameters."""

    def __init__(
        self, log: Log, platform: Platform, near: Platform, names: Sequence[str], cutoff: float | None
    ) -> None:
        self.names, self.platform = names, platform
        # gains and apparent masses are those of a platform near the best fit
        self.inputs, self.time, self.filters = predictor_inputs(log, near, cutoff)
        # the velocity of friction is seen in nothing but reversals
        all_of_it = "leg_friction_velocity" in names or not has_coulomb(platform, names)
        self.sliding = np.ones_like(self.filters.sliding) if all_of_it else self.filters.sliding
        self.own = [k for k, name in enumerate(names) if not is_of_instruments(name)]
        own = [names[k] for k in self.own]
        self._nominal = nominal_values(own, platform)
        self._p, columns = kernel_parameters(platform, own)
        self._directions = np.zeros((len(self._p), len(names)))
        self._directions[:, self.own] = columns
        self._gravity = [int(np.flatnonzero(parameter_columns([f"gravity[{k}]"]))[0]) for k in (1, 2, 3)]

    def simulated(self, theta: FloatArray, steps: int, *, derivatives: bool = True) -> Innovations:
        """Innovations of the first steps, with their derivatives if wanted."""
        instruments = instruments_of(self.names, theta)
        p, directions = self._p + self._directions[:, self.own] @ (theta[self.own] - self._nominal), self._directions
        inputs = self.inputs._replace(length=self.inputs.length[:steps])
        if len(self.own) < len(self.names):
            if instruments.tilt.any():
                p[self._gravity] = tilted(p[self._gravity], instruments.tilt)
            directions = directions.copy()
            force, rate = self.filters.force(instruments.delay), None
            force = (force - instruments.offset) / instruments.gain
            by_force = np.zeros((*force.shape, len(self.names)))
            for k, name in enumerate(self.names):
                stem, index = place_of(name)
                if stem == "force_gain":
                    by_force[:, index[0], k] = -force[:, index[0]] / instruments.gain[index[0]]
                elif stem == "force_offset":
                    by_force[:, index[0], k] = -1 / instruments.gain[index[0]]
                elif stem == "delay":
                    rate = self.filters.force(instruments.delay, 1) if rate is None else rate
                    by_force[:, :, k] = rate / instruments.gain
                elif stem == "base_tilt":
                    turned = tilt_directions(self.platform.gravity, instruments.tilt)
                    directions[self._gravity, k] = turned[:, index[0]]
            inputs = inputs._replace(force=force, by_force=by_force)
        if not derivatives:
            return simulated(inputs._replace(by_force=None), p, directions[:, :0])
        return simulated(inputs, p, directions)


def whitened_innovations(
    models: Sequence[Predictor], innovations: Sequence[Innovations], noise: RowNoise
) -> tuple[FloatArray, FloatArray]:
    """Whitened innovations (m,) and their derivatives (m, p), as unexplained forces, whose covariance is known."""
    columns = []
    for model, each in zip(models, innovations, strict=True):
        both = np.concatenate([each.values[:, :, None], each.sensitivity], axis=2)
        inner = slice(SETTLING + 1, SETTLING + len(both) - 1)
        filters = model.filters
        # A⁻¹ d/h² (n − 2, 6, k), with A⁻¹/h² at the inner steps (n − 2, 6, 6)
        forces = np.asarray(
            filters.apparent[inner]
            @ (both[2:] - (2 - filters.alpha - filters.beta) * both[1:-1] + (1 - filters.alpha) * both[:-2])
        )
        columns.append((model.sliding[inner, :, None] * forces).reshape(-1, both.shape[2]))
    white = noise.whitened(np.concatenate(columns))
    return white[:, 0], white[:, 1:]


def settled(innovations: Innovations) -> Innovations:
    """Without the steps until the filter has forgotten its start."""
    return Innovations(innovations.values[SETTLING:], innovations.sensitivity[SETTLING:])


def noise_of_innovations(chosen: Sequence[tuple[Predictor, int]], levels: tuple[FloatArray, float]) -> RowNoise:
    """The covariance of the unexplained forces, of the first n steps of every part.

    Parameters
    ----------
    levels
        Standard deviations of the raw forces (6,) [N] and lengths [m].
    """
    whitenings, sizes = [], []
    for model, n in chosen:
        inner = slice(SETTLING + 1, n - 1)
        filters, used = model.filters, model.sliding[inner]
        parts = two_noises(filters.correlations, filters.apparent[inner][:, :, None, :], *levels, used)
        whitenings.append(whitening_of(parts.covariance(1.0, 1.0)))
        sizes.append(len(used))
    return RowNoise(tuple(whitenings), tuple(sizes), *levels)


def difference_correlations(sample_time: float, cutoff: float, every: int) -> KernelCorrelations:
    """Correlations of A⁻¹ d/h² for unit noise of forces, and of d for unit noise of lengths.

    Parameters
    ----------
    sample_time
        Of the raw signals [s].
    cutoff
        Of their low-pass [Hz].
    every
        Samples of a step; even.
    """
    kernel = kernel_of(sample_time, cutoff)
    force, length = (np.zeros(len(kernel) + 2 * every) for _ in range(2))
    for shift in (every // 2, every, 3 * every // 2):
        force[shift : shift + len(kernel)] += kernel / 3
    for shift, weight in ((0, 1.0), (every, -2.0), (2 * every, 1.0)):
        length[shift : shift + len(kernel)] += weight * kernel
    return kernel_correlations(force, length[None], every)
