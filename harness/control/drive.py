"""The drives: from the command that reaches them to the force that acts, by a rate limit and a lag."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field

from gough_stewart.harness.control.component import Clock, Signals, Stepped
from gough_stewart.harness.control.state_space import Solve, StateSpace
from gough_stewart.harness.quantities import PositiveForceRate, Time, Unit, positive_or_word
from gough_stewart.harness.section import Section
from gough_stewart.model.operations import greater, less, minimum, not_equal, sign, where


def _force_limit(value: Any) -> float | str:
    return positive_or_word(value, "N", "platform", "none")


class ActuatorChoice(Section):
    """`[actuators]`: limits, and the time constant of a lag; the platform's force limit by default."""

    force_limit: Annotated[
        float | str,
        BeforeValidator(_force_limit),
        Unit("N"),
        Field(description="largest force of an actuator"),
    ] = "platform"
    rate_limit: Annotated[PositiveForceRate | None, Field(description="rate limit of the drives")] = None
    lag: Annotated[Time, Field(description="time constant of the drives")] = 0.0


class DriveCoefficients(NamedTuple):
    """Of `Drive`."""

    period: Any  # h [s]
    rate: Any  # [N/s], infinite without a limit; None if no member has one
    slope: Any  # the same, 0 without a limit
    lag: Any  # τ [s], 1 where there is none; None if no member has one
    lags: Any  # whether there is one; None if all members have


class Drive(Stepped):
    """Follows a target within `rate_limit`, ṙ = ± rate until r is there, and then by a `lag` τ ḟ = r − f.

    Between two steps of the plant r is a ramp and then constant, so r and f are exact; the force that acts is the mean
    of f over the step.
    """

    name: ClassVar[str] = "force"
    table: ClassVar[type[Section]] = ActuatorChoice
    keys: ClassVar[tuple[str, ...]] = ("rate_limit", "lag")
    absent: ClassVar[Mapping[str, float]] = {"rate_limit": np.inf, "lag": 0.0}
    clock: ClassVar[Clock] = "plant step"
    inputs: ClassVar[tuple[str, ...]] = ("target",)
    outputs: ClassVar[tuple[str, ...]] = ("actuator_force", "rate_limited")
    states: ClassVar[tuple[str, ...]] = ("reached", "followed")

    @staticmethod
    def prepare(values: Mapping[str, Any], period: Any) -> DriveCoefficients:
        """As `Stepped`."""
        rate, lag = values["rate_limit"], values["lag"]
        lags = greater(lag, 0.0)
        return DriveCoefficients(period, rate, where(less(rate, np.inf), rate, 0.0), where(lags, lag, 1.0), lags)

    @staticmethod
    def without_idle(coefficients: DriveCoefficients) -> DriveCoefficients:
        """As `Stepped`."""
        c = coefficients
        if not np.isfinite(c.rate).any():
            c = c._replace(rate=None, slope=None)
        if not c.lags.any():
            return c._replace(lag=None, lags=None)
        return c._replace(lags=None) if c.lags.all() else c

    @staticmethod
    def start(coefficients: DriveCoefficients, inputs: Signals) -> Signals:
        """As `Stepped`."""
        del coefficients
        return inputs[0], inputs[0]

    @staticmethod
    def step(coefficients: DriveCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        """As `Stepped`."""
        h, rate, slope, tau, lags = coefficients
        (r0, force), (target,) = states, inputs
        if rate is None:
            r1 = mean = target
            reached, on_ramp, rest, is_behind = r0, force, h, None
        else:
            # from r₀ to the target at ±rate, reached after a ≤ h, or at the step's end not yet
            way = target - r0
            a = minimum(np.abs(way) / rate, h)
            slope = sign(way) * slope
            r1 = where(less(a, h), target, r0 + slope * h)
            mean = r1 - (r1 - r0) * a / (2 * h)
            reached, is_behind = r1, not_equal(r1, target)
        if tau is None:
            return (reached, force), (mean, is_behind)
        if rate is not None:
            # on the ramp f = r − s τ + (f₀ − r₀ + s τ) e^(−t/τ)
            ramp = slope * tau
            on_ramp = r0 + slope * a - ramp + (force - r0 + ramp) * np.exp(-a / tau)
            on_ramp = where(greater(a, 0.0), on_ramp, force)
            rest = h - a
        # then f = r₁ + (f − r₁) e^(−t/τ); the mean of ḟ = (r − f)/τ over the step
        following = r1 + (on_ramp - r1) * np.exp(-rest / tau)
        late = mean - (following - force) * tau / h
        return (reached, following), (late if lags is None else where(lags, late, mean), is_behind)

    @staticmethod
    def linear(values: Mapping[str, Any], sample_time: Any, solve: Solve = np.linalg.solve) -> StateSpace:
        """Its lag, in continuous time: ḟ = (r − f)/τ."""
        del sample_time, solve
        lag = float(values["lag"])
        if not lag > 0:
            return Stepped.linear(values, None)
        one = np.eye(1)
        return StateSpace(-one / lag, one / lag, one, 0 * one)
