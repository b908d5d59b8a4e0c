"""Leg motion of a reference, and whether the platform can reach it."""

from typing import Literal, NamedTuple

import numpy as np

from gough_stewart.harness.errors import ReachError
from gough_stewart.harness.motion.limits.fitting import remedy
from gough_stewart.harness.motion.limits.shares import GEOMETRIC, WORST_CONDITION_NUMBER, Beyond, shares_along
from gough_stewart.harness.motion.motion import Motion, once_at_rest, pose_at_start
from gough_stewart.model.kinematics import leg_geometry, leg_jacobian, rates_of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

WhenBeyond = Literal["refuse", "warn"]


class LegMotion(NamedTuple):
    """A motion of the legs at n times; each (n, 6)."""

    leg_length: FloatArray  # [m]
    leg_velocity: FloatArray  # [m/s]


def legs_of(platform: Platform, motion: Motion) -> LegMotion:
    """Leg lengths and velocities of a motion, by inverse kinematics."""

    def lengths_and_rates(motion: Motion) -> LegMotion:
        legs = leg_geometry(platform, motion.position, motion.orientation)
        rates = rates_of_legs(legs, State(*motion[:4]))
        return LegMotion(np.asarray(legs.length), np.asarray(rates.length_rate))

    return LegMotion(*once_at_rest(lengths_and_rates, motion))


def jacobians_of(platform: Platform, motion: Motion) -> FloatArray:
    """Leg Jacobians along a motion (n, 6, 6)."""
    (jacobians,) = once_at_rest(lambda rows: [leg_jacobian(platform, rows.position, rows.orientation)], motion)
    return jacobians


def check_reach(
    platform: Platform,
    time: FloatArray,
    motion: Motion,
    largest_condition_number: float = WORST_CONDITION_NUMBER,
    *,
    centre: FloatArray | None = None,
    dynamic: WhenBeyond = "refuse",
    geometric: WhenBeyond = "refuse",
) -> list[str]:
    """Refuse a motion that exceeds a limit of the platform or comes near a singular pose; see `shares_along`.

    Parameters
    ----------
    time
        Times of the motion's rows (n,) [s].
    largest_condition_number
        Of the leg Jacobian with angles scaled to lengths.
    centre
        The pose (6,) about which a smaller motion is scaled; by default that of the first row.
    dynamic
        "warn" accepts motions that exceed limits of velocity, acceleration, force or power.
    geometric
        "warn" accepts motions that exceed the stroke, or come near a singular pose.

    Returns
    -------
    list of str
        One warning for each limit that is exceeded and accepted.

    Raises
    ------
    ReachError
        Names the first time at which a limit is exceeded, the quantity, its value, the leg, and how much slower or
        smaller the motion has to be.
    """
    shares = shares_along(platform, time, motion, largest_condition_number)
    exceeded = [limited for limited in shares.limited if not limited.within.all()]
    refused = [limited for limited in exceeded if (geometric if limited.limit in GEOMETRIC else dynamic) == "refuse"]
    if not refused:
        return [f"the reference exceeds a limit: {_at(time, limited.first_beyond)}" for limited in exceeded]
    first = min(refused, key=lambda limited: limited.first_beyond.row)
    beyond = first.first_beyond
    about = pose_at_start(motion) if centre is None else centre
    helps = remedy(platform, motion, about, largest_condition_number)
    raise ReachError(
        f"the reference cannot be reached: {_at(time, beyond)}; {helps}",
        float(time[beyond.row]),
        first.quantity,
        beyond.value,
        beyond.leg,
    )


def _at(time: FloatArray, beyond: Beyond) -> str:
    return f"at time {time[beyond.row]:.6g} s {beyond.text}"
