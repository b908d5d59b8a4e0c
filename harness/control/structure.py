"""Structural modes of a platform on legs that give: what they do to the bandwidth of a loop."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.control.linear import Mode, linear_matrices, modes
from gough_stewart.harness.control.margins import disk_margin, frequency_range, is_stable, response
from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.harness.errors import ControllerError
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import Array, FloatArray

# The search for the largest bandwidth: down to this share of the first mode, by this factor at first, to this share.
_LOWEST, _STEP, _RESOLUTION = 1 / 64, 1.5, 0.01
_STATES_OF_PLATFORM = 12


class StructuralMode(NamedTuple):
    """A mode of the platform on its legs."""

    frequency: float  # of the machine, whose motors are free: a resonance of the loop [Hz]
    damping_ratio: float
    held_frequency: float  # with motors that hold; nan if it does not oscillate [Hz]
    gain: float  # largest singular value of the loop transfer there; below 1 no phase makes it unstable


class Structure(NamedTuple):
    """The structural modes of a loop, and the bandwidth that they allow."""

    modes: tuple[StructuralMode, ...]  # lowest first; none that is overdamped
    disk: float  # the disk margin that `bandwidth` keeps
    # largest of this controller at that disk margin [Hz]; nan if there is none, None of a controller without bandwidth
    bandwidth: float | None


def structural_modes(
    platform: Platform, position: Array | None = None, orientation: Array | None = None
) -> tuple[tuple[Mode, ...], FloatArray]:
    """Modes of the platform on its legs in a pose (default: home), lowest first, and those of held motors [Hz].

    Of the linear model: with free motors these are its oscillating modes above the first mode of held motors, at most
    six; motors are held where their states are left out. Legs slide.
    """
    linear = linear_matrices(platform, position, orientation)
    part = slice(_STATES_OF_PLATFORM)
    nothing = np.zeros((0, 0))
    held = np.array(
        [each.frequency for each in _oscillating(StateSpace(linear.A[part, part], nothing, nothing, nothing))]
    )
    first = float(held[0]) if len(held) else 0.0
    return tuple(each for each in _oscillating(linear) if each.frequency > first)[-6:], held[-6:]


def structure_of(
    platform: Platform,
    transfer: StateSpace,
    family: tuple[float, Callable[[float], StateSpace]] | None,
    disk: float,
    position: Array | None = None,
    orientation: Array | None = None,
) -> Structure | None:
    """The structural modes of a loop in a pose; None of rigid legs.

    Parameters
    ----------
    transfer
        The loop transfer L (6×6).
    family
        The bandwidth [Hz] of its controller, and the same loop with another one; None if the controller has none.
    disk
        The disk margin to keep.
    """
    if not platform.leg_stiffness > 0:
        return None
    free, held = structural_modes(platform, position, orientation)
    held = np.concatenate([held, np.full(len(free), math.nan)])
    _, top = frequency_range(transfer)
    found = tuple(
        StructuralMode(each.frequency, each.damping_ratio, float(other), _gain_at(transfer, each.frequency, top))
        for each, other in zip(free, held[: len(free)], strict=True)
    )
    if family is None or not free:
        return Structure(found, disk, None)
    own, with_bandwidth = family
    return Structure(found, disk, largest_bandwidth(with_bandwidth, disk, free[0].frequency, own))


def largest_bandwidth(with_bandwidth: Callable[[float], StateSpace], disk: float, first: float, own: float) -> float:
    """The largest bandwidth [Hz] below a first mode whose loop has this disk margin, to 1 %; nan if there is none.

    Searched from the loop's own: upwards as long as the margin is kept, downwards until it is.
    """

    def keeps(bandwidth: float) -> bool:
        try:
            loop = with_bandwidth(bandwidth)
        except ControllerError:  # no such controller, as a PID whose integral time is too short for it
            return False
        return is_stable(loop) and disk_margin(loop).alpha >= disk

    low = high = min(own, first)
    if keeps(low):
        while high < first and keeps(high := min(first, _STEP * high)):
            low = high
    else:
        while not keeps(low := low / _STEP):
            if low < _LOWEST * first:
                return math.nan
        high = _STEP * low
    while high > (1 + _RESOLUTION) * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return low


def _oscillating(system: StateSpace) -> list[Mode]:
    return [each for each in modes(system) if each.eigenvalue.imag > 0]


def _gain_at(transfer: Any, frequency: float, top: float) -> float:
    """σ_max(L); nan beyond half of the sample rate `top` [rad/s]."""
    omega = 2 * math.pi * frequency
    return float(np.linalg.norm(response(transfer, np.array([omega]))[0], 2)) if omega < top else math.nan
