"""Readings of forces as a function of all parameters of the linear method, in the rows of the regression.

    reading(t) = g ∘ (W(tilt) φ(θ) + f(θ)) (t − delay) + o

with gains g, offsets o, delay and tilt of the instruments, which are not the platform's: its file does not have them. W
is affine in gravity, which in the axes of a base out of level is Rᵀ g with R = R_y(β) R_x(α) and base_tilt = (α, β). f
is friction that sticks, which is not linear in its parameters; other friction is in φ.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.identify.friction import StickingFriction
from gough_stewart.harness.identify.names import place_of
from gough_stewart.harness.identify.regression import Regression
from gough_stewart.harness.identify.regressor import (
    ForceDerivatives,
    gradient,
    linear_parameters,
    regressor,
    states_of,
    with_estimated,
)
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray


class Instruments(NamedTuple):
    """Values of the instruments' parameters."""

    gain: FloatArray  # (6,)
    offset: FloatArray  # (6,) [N]
    delay: float  # > 0 if forces are late [s]
    tilt: FloatArray  # of the base about X and Y (2,) [rad]


STEMS = ("force_gain", "force_offset", "delay", "base_tilt")


def is_of_instruments(name: str) -> bool:
    """Whether an element belongs to the instruments, not to the platform."""
    return name.partition("[")[0] in STEMS


def tilted(gravity: FloatArray, tilt: FloatArray) -> FloatArray:
    """Gravity (3,) in the axes of a base that is turned out of level by (α, β) about X, then Y: R_x(−α) R_y(−β) g."""
    (ca, cb), (sa, sb) = np.cos(tilt), np.sin(tilt)
    x, y, z = gravity
    x, z = cb * x - sb * z, sb * x + cb * z
    return np.array([x, ca * y + sa * z, -sa * y + ca * z])


def tilt_directions(gravity: FloatArray, tilt: FloatArray) -> FloatArray:
    """∂`tilted`/∂(α, β) (3, 2)."""
    (ca, cb), (sa, sb) = np.cos(tilt), np.sin(tilt)
    x, y, z = gravity
    turned = sb * x + cb * z
    by_alpha = [0.0, -sa * y + ca * turned, -ca * y - sa * turned]
    by_beta_x, by_beta_z = -sb * x - cb * z, cb * x - sb * z
    return np.array([by_alpha, [by_beta_x, sa * by_beta_z, ca * by_beta_z]]).T


class RowFit(NamedTuple):
    """A fit of the rows by any method."""

    names: tuple[str, ...]
    values: FloatArray  # (p,)
    columns: FloatArray  # ∂(reading)/∂θ (n, 6, p) of the fitted rows
    force: FloatArray  # of the platform at all rows (m, 6) [N]
    rate: FloatArray  # its derivative by time (m, 6) [N/s]
    derivatives: ForceDerivatives  # at all rows
    is_fitted: NDArray[np.bool_]  # (m,)
    used: FloatArray  # 1 for fitted rows that are used (n, 6)


class RowModel:
    """The model of the rows; values are those of `names`, in their order."""

    def __init__(
        self,
        regression: Regression,
        platform: Platform,
        elements: Mapping[str, float],
        names: Sequence[str],
        friction: StickingFriction | None = None,
    ) -> None:
        self.regression, self.platform, self.elements, self.names = regression, platform, elements, tuple(names)
        self.friction = friction
        self.bent = [] if friction is None else [list(names).index(name) for name in friction.names]
        self.linear = [k for k, name in enumerate(names) if not is_of_instruments(name) and k not in self.bent]
        self._last: tuple[bytes, FloatArray] = (b"", np.zeros(0))

    def phi(self, values: FloatArray) -> FloatArray:
        """The linear parameters φ (SIZE,)."""
        return np.asarray(linear_parameters(self._elements(values)), dtype=float)

    def instruments(self, values: FloatArray) -> Instruments:
        """The instruments; what of them is not estimated is right."""
        gain, offset, tilt, delay = np.ones(6), np.zeros(6), np.zeros(2), 0.0
        vectors = {"force_gain": gain, "force_offset": offset, "base_tilt": tilt}
        for name, value in zip(self.names, values, strict=True):
            stem, index = place_of(name)
            if stem == "delay":
                delay = float(value)
            elif stem in vectors:
                vectors[stem][index] = value
        return Instruments(gain, offset, delay, tilt)

    def force(self, values: FloatArray) -> FloatArray:
        """The forces of the platform (n, 6) [N]."""
        return self.smooth_force(values) + (0.0 if self.friction is None else self._sticking(values)[:, :, 0])

    def smooth_force(self, values: FloatArray) -> FloatArray:
        """The forces without friction that sticks (n, 6) [N]."""
        return np.asarray(self._regressor(values) @ self.phi(values))

    def rate(self, values: FloatArray) -> FloatArray:
        """How the forces of a level platform change (n, 6) [N/s]."""
        rate = self.regression.rate(self.phi(values))
        return rate if self.friction is None else rate + self._sticking(values, 1)[:, :, 0]

    def by_lengths(self, values: FloatArray) -> FloatArray:
        """Of friction that sticks, the derivatives by each leg's length and velocity (n, 2, 6)."""
        assert self.friction is not None
        friction, law = self.friction, values[self.bent]
        derivatives = self.regression.filtered(lambda v, h: friction.by_lengths(law, v, h), 0)
        return derivatives.reshape(len(derivatives), 2, 6)

    def residual(self, values: FloatArray) -> FloatArray:
        """What the log reads less what it should (n, 6) [N], at times that a delay shifts."""
        instruments = self.instruments(values)
        return self.regression.force_if_late(instruments.delay) - (
            instruments.gain * self.force(values) + instruments.offset
        )

    def columns(self, values: FloatArray) -> FloatArray:
        """Derivatives of the reading by each parameter (n, 6, p)."""
        instruments, phi = self.instruments(values), self.phi(values)
        W = self._regressor(values)
        result = np.zeros((len(W), 6, len(self.names)))
        if self.linear:
            by_platform = gradient(self._elements(values), [self.names[k] for k in self.linear])
            result[:, :, self.linear] = instruments.gain[:, None] * (W @ by_platform)
        if self.bent:
            result[:, :, self.bent] = instruments.gain[:, None] * self._sticking(values)[:, :, 1:]
        for k, name in enumerate(self.names):
            stem, index = place_of(name)
            if stem == "force_gain":
                result[:, index[0], k] = self.force(values)[:, index[0]]
            elif stem == "force_offset":
                result[:, index[0], k] = 1.0
            elif stem == "delay":
                result[:, :, k] = -instruments.gain * self.rate(values)
            elif stem == "base_tilt":
                turned = tilt_directions(self.platform.gravity, instruments.tilt)[:, index[0]]
                result[:, :, k] = instruments.gain * (np.einsum("nlpa,a->nlp", self._by_gravity, turned) @ phi)
        return result

    def _sticking(self, values: FloatArray, derivative: int = 0) -> FloatArray:
        """Friction that sticks, and its derivatives by its parameters (n, 6, 1 + q); or their rates."""
        assert self.friction is not None
        friction, law = self.friction, values[self.bent]
        key = law.tobytes() + bytes([derivative])
        if self._last[0] != key:
            filtered = self.regression.filtered(lambda v, h: friction.force(law, v, h), derivative)
            self._last = (key, filtered.reshape(len(filtered), 6, -1))
        return self._last[1]

    def _elements(self, values: FloatArray) -> dict[str, float]:
        return with_estimated(self.elements, [self.names[k] for k in self.linear], values[self.linear])

    def _regressor(self, values: FloatArray) -> FloatArray:
        tilt = self.instruments(values).tilt
        W = self.regression.rows.regressor
        if not tilt.any():
            return W
        return np.asarray(W + self._by_gravity @ (tilted(self.platform.gravity, tilt) - self.platform.gravity))

    @cached_property
    def _by_gravity(self) -> FloatArray:
        """∂W/∂g (n, 6, SIZE, 3)."""
        motion = states_of(self.regression.motion)
        level, *turned = (
            regressor(self.platform.with_parameters({"gravity": gravity}), *motion)
            for gravity in (np.zeros(3), *np.eye(3))
        )
        return np.stack([by_axis - level for by_axis in turned], axis=-1)
