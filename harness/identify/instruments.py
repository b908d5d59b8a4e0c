"""Parameters of the instruments that made a log: gains and offsets of forces, their delay, the tilt of the base.

    reading of force i (t) = force_gain_i F_i(t − delay) + force_offset_i,   gravity in the base's axes = Rᵀ g

with R = R_y(β) R_x(α) the turn of the base out of level by base_tilt = (α, β). They are not the platform's: its file
does not have them, and the forces that the log should have follow from them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.identify.names import place_of
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


def instruments_of(names: Sequence[str], values: FloatArray) -> Instruments:
    """The instruments with some elements replaced; the others are right."""
    gain, offset, tilt, delay = np.ones(6), np.zeros(6), np.zeros(2), 0.0
    whole = {"force_gain": gain, "force_offset": offset, "base_tilt": tilt}
    for name, value in zip(names, values, strict=True):
        stem, index = place_of(name)
        if stem == "delay":
            delay = float(value)
        elif stem in whole:
            whole[stem][index] = value
    return Instruments(gain, offset, delay, tilt)


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
