"""The rows of the linear regression: parts of logs through one zero-phase low-pass, and what the model reads there.

    reading(t) = g ∘ (W(tilt) φ(θ) + f(θ)) (t − delay) + o

with gains g, offsets o, delay and tilt of the instruments, which are not the platform's: its file does not have them. W
is affine in gravity, which in the axes of a base out of level is Rᵀ g with R = R_y(β) R_x(α) and base_tilt = (α, β). f
is stiction, which is not linear in its parameters; other friction is in φ.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from gough_stewart.harness.identify.log import Part
from gough_stewart.harness.identify.lowpass import (
    cutoff_of,
    edge,
    kernel_correlations,
    kernel_of,
    noise_beyond,
    smoothed,
)
from gough_stewart.harness.identify.regressor import (
    ARMATURE,
    INERTIAL,
    OF_LOGS,
    PER_LEG,
    ForceDerivatives,
    elements_of,
    force_derivatives,
    friction_columns,
    gradient,
    linear_parameters,
    parameter_columns,
    place_of,
    regressor,
    smooth_motion,
    value_of,
    with_estimated,
)
from gough_stewart.harness.identify.sticking_friction import (
    COULOMB,
    STICTION,
    StickingFriction,
    ideal_of,
    sliding_rows,
    sticks,
    unit_friction,
)
from gough_stewart.model.kernel import parameter_vector
from gough_stewart.model.parameters import of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Lengths are filtered and differentiated with this multiple of the rows' cut-off, so their gain is flat below it.
WIDER = 2.0
# A leg reverses below this multiple of the smoothing velocity of friction, or this share of its usual velocity.
_REVERSAL, _SLOW = 10.0, 0.1
# Rows of the motion per period of the lengths' cut-off.
_ROWS_A_PERIOD = 4
INSTRUMENTS = ("force_gain", "force_offset", "delay", "base_tilt")

OfVelocity = Callable[[FloatArray, float], FloatArray]


class RawNoise(NamedTuple):
    """Noise of the raw signals, and how it reaches the rows."""

    force: FloatArray  # standard deviation (6,) [N]
    length: FloatArray  # (6,) [m]
    of_force: FloatArray  # covariances of filtered unit white noise m rows apart: (g ⋆ g)(m) (M + 1,)
    of_length: FloatArray  # (c_d ⋆ c_d')(m) of value, velocity and acceleration (M + 1, 3, 3)


@dataclass(frozen=True, eq=False)
class Segment:
    """The rows of one part of a log, F = W φ + ε, and signals from which rows of other delays and frictions follow."""

    part: Part
    time: FloatArray  # (m,) [s]
    W: FloatArray  # (m, 6, SIZE)
    cutoff: float  # of the filter on forces and regressor [Hz]
    sliding: FloatArray  # 1 if a leg slides during the whole window of a row, 0 if it reverses (m, 6)
    motion: FloatArray  # pose, twist, acceleration (m, 18)
    noise: RawNoise
    force_rows: NDArray[np.intp]  # (m,) of the smoothed force
    inertial: FloatArray  # W of masses at the rows of the motion (j, 6, INERTIAL)
    spacing: tuple[int, int]  # rows of the log per row of the motion, and of that per row of the regression
    velocity: FloatArray  # of the motors, smoothed (k, 6) [m/s]
    friction: FloatArray  # of these velocities, for unit viscous and unit Coulomb friction (k, 2, 6)
    velocity_rows: NDArray[np.intp]  # (m,) of functions of the velocity, smoothed

    def forces(self, delay: float = 0.0) -> FloatArray:
        """The measured forces at the rows (m, 6) [N], of readings that are late by `delay`."""
        # a held force belongs to the middle of its sample
        late = delay - self.part.step / 2 * self.part.holds_force
        return smoothed(self.part.force, self.part.step, self.cutoff, 1, 0, late)[self.force_rows]


def spacing_of(step: float, cutoff: float) -> tuple[int, int]:
    """Rows of the log per row of the motion, and of that per row of the regression: half a period of the cut-off."""
    every = max(1, int(1 / (_ROWS_A_PERIOD * WIDER * cutoff * step)))
    return every, max(1, int(1 / (2 * cutoff * step * every)))


def length_kernels(step: float, cutoff: float) -> FloatArray:
    """Weights of the raw lengths in the value, velocity and acceleration of a row, after both filters (3, j)."""
    every, _ = spacing_of(step, cutoff)
    between = kernel_of(step * every, cutoff)
    spread = np.zeros(every * (len(between) - 1) + 1)
    spread[::every] = between
    return np.stack([np.convolve(spread, kernel_of(step, WIDER * cutoff, d)) for d in range(3)])


def segment_of(part: Part, platform: Platform, cutoff: float | None = None) -> Segment:
    """The rows of a part.

    One kernel filters and differentiates the lengths; poses and rates follow by forward kinematics. The forces of
    inverse dynamics for each linear parameter, and the measured forces, then pass another low-pass. It removes noise
    beyond the cut-off, with the same effect on both sides of the equation.
    """
    h = part.step
    cutoff = min(0.5 / h / (1.5 * WIDER), cutoff_of(part.length, h) if cutoff is None else cutoff)
    wide = WIDER * cutoff
    # each row of the regression is a row of the motion, which is a row of the log
    every, thin = spacing_of(h, cutoff)
    lengths, motion = smooth_motion(part, platform, wide, every)
    W = regressor(platform, motion)[:, :, :INERTIAL]
    if part.motor is not None:
        # rotor and screw are on the motors' side
        W[:, :, ARMATURE] = smoothed(part.motor, h, wide, every, 2)
    inertial = smoothed(W.reshape(len(W), -1), h * every, cutoff, thin)
    # each row's place among those of the lengths' filter, and in the log
    inner = every * (edge(h * every, cutoff) + thin * np.arange(len(inertial)))
    at = edge(h, wide) + inner

    # friction steps where a leg reverses, so it needs all rows of the log
    velocity = smoothed(part.length if part.motor is None else part.motor, h, wide, 1, 1)
    per_unit = friction_columns(platform, velocity)
    lobe = math.ceil(0.5 / (cutoff * h * every))  # the filter's main one
    if sticks(platform):
        per_unit[:, 6:] = unit_friction(platform, velocity, h)
        slid = sliding_rows(platform, velocity, h)
        sliding = minimum_filter1d(slid, 2 * lobe * every + 1, axis=0)[inner]
    else:
        slowest = minimum_filter1d(np.abs(lengths[1]), 2 * lobe + 1, axis=0)[inner // every]
        fast = np.minimum(_REVERSAL * platform.leg_friction_velocity, _SLOW * np.sqrt((lengths[1] ** 2).mean(axis=0)))
        sliding = np.asarray(slowest > fast, dtype=float)
    force_rows, velocity_rows = at - edge(h, cutoff), inner - edge(h, cutoff)
    friction = smoothed(per_unit, h, cutoff)[velocity_rows].reshape(len(at), 2, 6)
    whole = np.concatenate(
        [inertial.reshape(len(at), 6, INERTIAL), *(friction[:, k, :, None] * np.eye(6) for k in range(2))], axis=2
    )

    # noise of the raw signals from what the wider low-pass rejects
    of_force, of_length = (noise_beyond(values, h, wide) for values in (part.force, part.length))
    correlations = kernel_correlations(kernel_of(h, cutoff), length_kernels(h, cutoff), every * thin)
    return Segment(
        part,
        part.time[at],
        whole,
        cutoff,
        sliding,
        # through the rows' filter, so that derivatives at these motions have no noise that the regressor does not have
        smoothed(motion, h * every, cutoff, thin),
        RawNoise(of_force, of_length, *correlations),
        force_rows,
        W,
        (every, thin),
        velocity,
        per_unit.reshape(-1, 2, 6),
        velocity_rows,
    )


@dataclass(frozen=True, eq=False)
class Regression:
    """The rows of all segments, one after the other."""

    platform: Platform
    smooth: Platform  # with rigid legs, and without stiction
    segments: tuple[Segment, ...]
    force: FloatArray  # F (m, 6) [N]
    time: FloatArray  # (m,) [s]
    W: FloatArray  # (m, 6, SIZE)
    sliding: FloatArray  # (m, 6)
    motion: FloatArray  # (m, 18)

    @classmethod
    def of(cls, parts: Sequence[Part], platform: Platform, cutoff: float | None = None) -> "Regression":
        """The rows of these parts."""
        segments = [segment_of(part, platform, cutoff) for part in parts]
        names = ("time", "W", "sliding", "motion")
        columns = (np.concatenate([getattr(segment, name) for segment in segments]) for name in names)
        force = np.concatenate([segment.forces() for segment in segments])
        return cls(platform, ideal_of(platform), tuple(segments), force, *columns)

    @cached_property
    def by_gravity(self) -> FloatArray:
        """∂W/∂g (m, 6, SIZE, 3)."""
        level, *turned = (
            regressor(self.smooth.with_parameters({"gravity": gravity}), self.motion)
            for gravity in (np.zeros(3), *np.eye(3))
        )
        return np.stack([by_axis - level for by_axis in turned], axis=-1)

    def used(self, names: Sequence[str]) -> FloatArray:
        """1 for rows that a fit of these elements uses, else 0 (m, 6): with Coulomb friction not where it reverses."""
        has_coulomb = self.platform.leg_coulomb_friction > 0 or any(name.startswith(COULOMB) for name in names)
        return self.sliding if has_coulomb else np.ones_like(self.sliding)

    def filtered(self, function: OfVelocity, derivative: int = 0) -> FloatArray:
        """A function (k, 6, q) of velocities (k, 6) and their step [s], or its rate, filtered as forces (m, 6, q)."""
        filtered = []
        for s in self.segments:
            values = function(s.velocity, s.part.step)
            rows = smoothed(values.reshape(len(values), -1), s.part.step, s.cutoff, 1, derivative)[s.velocity_rows]
            filtered.append(rows.reshape(len(rows), *values.shape[1:]))
        return np.concatenate(filtered)


def tilted(gravity: FloatArray, tilt: FloatArray) -> FloatArray:
    """Gravity (3,) in the axes of a base that is turned out of level by (α, β) about X, then Y: R_x(−α) R_y(−β) g."""
    (ca, cb), (sa, sb) = np.cos(tilt), np.sin(tilt)
    x, y, z = gravity
    x, z = cb * x - sb * z, sb * x + cb * z
    return np.array([x, ca * y + sa * z, -sa * y + ca * z])


def tilt_directions(gravity: FloatArray, tilt: FloatArray) -> FloatArray:
    """∂`tilted`/∂(α, β) (3, 2), by complex steps."""
    return np.stack([tilted(gravity, tilt + 1e-30j * axis).imag / 1e-30 for axis in np.eye(2)], axis=-1)


class RowModel:
    """What is read in the rows, as a function of the values of `names`, in their order."""

    def __init__(self, regression: Regression, names: Sequence[str]) -> None:
        self.regression, self.platform, self.names = regression, regression.smooth, tuple(names)
        of_law = (COULOMB, *STICTION) if sticks(regression.platform) else ()
        stems = [place_of(name)[0] for name in names]
        self.bent = [k for k, stem in enumerate(stems) if stem in of_law]
        self.linear = [k for k, stem in enumerate(stems) if stem not in (*INSTRUMENTS, *of_law)]
        self.linear_names = [names[k] for k in self.linear]
        self.elements = elements_of(self.platform, self.linear_names)
        bent = tuple(names[k] for k in self.bent)
        self.friction = StickingFriction(regression.platform, bent) if of_law else None
        self._last: tuple[bytes, FloatArray] = (b"", np.zeros(0))

    def instrument(self, stem: str, values: FloatArray) -> FloatArray:
        """The values of an instrument's parameter; what of it is not estimated is right."""
        result = np.full(OF_LOGS[stem][0], value_of(self.platform, stem))
        for name, value in zip(self.names, values, strict=True):
            if place_of(name)[0] == stem:
                result[place_of(name)[1]] = value
        return result

    def force(self, values: FloatArray) -> FloatArray:
        """The forces of the platform (m, 6) [N]."""
        return self.smooth_force(values) + (0.0 if self.friction is None else self._sticking(values)[:, :, 0])

    def smooth_force(self, values: FloatArray) -> FloatArray:
        """The forces without stiction (m, 6) [N]."""
        return np.asarray(self._regressor(values) @ linear_parameters(self._elements(values)))

    def rate(self, values: FloatArray) -> FloatArray:
        """How the forces of a level platform change (m, 6) [N/s]."""
        phi, rates = np.asarray(linear_parameters(self._elements(values)), dtype=float), []
        for s in self.regression.segments:
            (every, thin), step = s.spacing, s.part.step
            of_masses = smoothed(s.inertial @ phi[:INERTIAL], step * every, s.cutoff, thin, 1)
            friction = (s.friction * phi[INERTIAL:].reshape(2, 6)).sum(axis=1)
            rates.append(of_masses + smoothed(friction, step, s.cutoff, 1, 1)[s.velocity_rows])
        rate = np.concatenate(rates)
        return rate if self.friction is None else rate + self._sticking(values, 1)[:, :, 0]

    def residual(self, values: FloatArray) -> FloatArray:
        """What the log reads less what it should (m, 6) [N], at times that a delay shifts."""
        delay, gain, offset = (self.instrument(stem, values) for stem in ("delay", "force_gain", "force_offset"))
        read = (
            np.concatenate([s.forces(float(delay)) for s in self.regression.segments])
            if delay
            else self.regression.force
        )
        return np.asarray(read - (gain * self.force(values) + offset))

    def columns(self, values: FloatArray) -> FloatArray:
        """Derivatives of the reading by each parameter (m, 6, p)."""
        gain, tilt = self.instrument("force_gain", values), self.instrument("base_tilt", values)
        W, elements = self._regressor(values), self._elements(values)
        result = np.zeros((len(W), 6, len(self.names)))
        if self.linear:
            result[:, :, self.linear] = gain[:, None] * (W @ gradient(elements, self.linear_names))
        if self.bent:
            result[:, :, self.bent] = gain[:, None] * self._sticking(values)[:, :, 1:]
        for k, name in enumerate(self.names):
            stem, index = place_of(name)
            if stem == "force_gain":
                result[:, index[0], k] = self.force(values)[:, index[0]]
            elif stem == "force_offset":
                result[:, index[0], k] = 1.0
            elif stem == "delay":
                result[:, :, k] = -gain * self.rate(values)
            elif stem == "base_tilt":
                turned = tilt_directions(self.platform.gravity, tilt)[:, index[0]]
                by_tilt = np.einsum("nlpa,a->nlp", self.regression.by_gravity, turned)
                result[:, :, k] = gain * (by_tilt @ linear_parameters(elements))
        return result

    def _sticking(self, values: FloatArray, derivative: int = 0) -> FloatArray:
        """Stiction, and its derivatives by its parameters (m, 6, 1 + q); or their rates."""
        assert self.friction is not None
        friction, law = self.friction, values[self.bent]
        key = law.tobytes() + bytes([derivative])
        if self._last[0] != key:
            self._last = key, self.regression.filtered(lambda v, h: friction.force(law, v, h), derivative)
        return self._last[1]

    def _elements(self, values: FloatArray) -> dict[str, float]:
        return with_estimated(self.elements, self.linear_names, values[self.linear])

    def _regressor(self, values: FloatArray) -> FloatArray:
        tilt, W, gravity = self.instrument("base_tilt", values), self.regression.W, self.platform.gravity
        if not tilt.any():
            return W
        return np.asarray(W + self.regression.by_gravity @ (tilted(gravity, tilt) - gravity))

    def fit_at(
        self,
        values: FloatArray,
        is_fitted: NDArray[np.bool_],
        used: FloatArray,
        derivatives: ForceDerivatives | None = None,
    ) -> "RowFit":
        """The fit at these values; derivatives of a fit nearby do."""
        if derivatives is None:
            platform, names = self.platform, self.linear_names
            # the kernel has friction as a common value times six factors; that of single legs is 1 times six values
            factors: dict[str, Any] = {}
            for stem in PER_LEG:
                if any(name.startswith(f"{stem}[") for name in names):
                    factors |= {stem: 1.0, f"{stem}_factor": of_legs(platform, stem)}
            nominal = [value_of(platform, name) for name in names]
            p = parameter_vector(platform.with_parameters(factors))
            p = p + parameter_columns(names) @ (values[self.linear] - nominal)
            derivatives = force_derivatives(self.regression.motion, p, self.smooth_force(values))
            if self.friction is not None:
                friction, law, legs = self.friction, values[self.bent], range(6)
                by_lengths = self.regression.filtered(lambda v, h: friction.by_lengths(law, v, h))
                derivatives.by_legs[:, legs, :2, legs] += by_lengths.swapaxes(0, 1)
        columns, residual = self.columns(values)[is_fitted], self.residual(values)
        force, rate = self.force(values), self.rate(values)
        return RowFit(self, values, columns, residual, force, rate, derivatives, is_fitted, used)


class RowFit(NamedTuple):
    """A model of the rows at the values of a fit; columns are those of the n fitted rows, of m in all."""

    model: RowModel
    values: FloatArray  # (p,)
    columns: FloatArray  # ∂(reading)/∂θ (n, 6, p)
    all_residuals: FloatArray  # (m, 6) [N]
    force: FloatArray  # of the platform (m, 6) [N]
    rate: FloatArray  # its derivative by time (m, 6) [N/s]
    derivatives: ForceDerivatives  # at all rows
    is_fitted: NDArray[np.bool_]  # (m,)
    used: FloatArray  # 1 for fitted rows that are used (n, 6)

    @property
    def residual(self) -> FloatArray:
        """Of the fitted rows (n, 6) [N]."""
        return self.all_residuals[self.is_fitted]
