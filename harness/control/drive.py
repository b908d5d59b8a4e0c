"""The drives: limits on a command, then, by a rate limit and a lag, the force that acts; and manual operation."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field

from gough_stewart.harness.control.component import Signals, Stepped
from gough_stewart.harness.quantities import PositiveForceRate, Time, Unit, positive_or_word
from gough_stewart.harness.section import TableSection
from gough_stewart.model.operations import clip, greater, less, minimum, not_equal, sign, where

# In which a force fades that was taken over from manual operation [s].
TRANSFER_TIME = 1.0

ForceLimit = Annotated[
    float | str,
    BeforeValidator(lambda value: positive_or_word(value, "N", "platform", "none")),
    *(Unit("N"), Field(description="largest force of an actuator")),
]


class ActuatorChoice(TableSection):
    """`[actuators]`: limits, and the time constant of a lag; the platform's force limit by default."""

    force_limit: ForceLimit = "platform"
    rate_limit: Annotated[PositiveForceRate | None, Field(description="rate limit of the drives")] = None
    lag: Annotated[Time, Field(description="time constant of the drives")] = 0.0


class LimitCoefficients(NamedTuple):
    """Of `ForceLimits`."""

    low: Any  # [N]; None if no member has a limit
    high: Any
    change: Any  # largest change of the force in a sample [N]; None if no member has a rate limit


class ForceLimits(Stepped):
    """Clips a command to ± `force_limit`, and foresees how much of it the drives reach within a sample.

    Their force one sample after each command, `planned`, changes by at most `rate_limit` times the sample time. The
    excess is `planned` minus the command, which controllers with integral action feed back.
    """

    name: ClassVar[str] = "force"
    table: ClassVar[type[TableSection]] = ActuatorChoice
    keys: ClassVar[tuple[str, ...]] = ("force_limit", "rate_limit")
    absent: ClassVar[Mapping[str, float]] = {"force_limit": np.inf, "rate_limit": np.inf}
    inputs: ClassVar[tuple[str, ...]] = ("command",)
    outputs: ClassVar[tuple[str, ...]] = ("allowed", "force_limited", "excess")
    states: ClassVar[tuple[str, ...]] = ("planned",)
    by_channel: ClassVar[tuple[str, ...]] = ("low", "high")

    @staticmethod
    def prepare(values: Mapping[str, Any], period: Any) -> LimitCoefficients:
        limit = values["force_limit"]
        return LimitCoefficients(-limit, limit, values["rate_limit"] * period)

    @staticmethod
    def without_idle(coefficients: LimitCoefficients) -> LimitCoefficients:
        c = coefficients
        if not np.isfinite(c.high).any():
            c = c._replace(low=None, high=None)
        return c if np.isfinite(c.change).any() else c._replace(change=None)

    @staticmethod
    def start(coefficients: LimitCoefficients, inputs: Signals) -> Signals:
        """The command; no states without a rate limit."""
        return () if coefficients.change is None else inputs

    @staticmethod
    def step(coefficients: LimitCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        low, high, change = coefficients
        (command,) = inputs
        if high is None:
            allowed, is_cut = command, None
        else:
            allowed = clip(command, low, high)
            is_cut = not_equal(allowed, command)
        if change is None:
            return states, (allowed, is_cut, None if high is None else allowed - command)
        (planned,) = states
        planned = clip(allowed, planned - change, planned + change)
        return (planned,), (allowed, is_cut, planned - command)


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
    table: ClassVar[type[TableSection]] = ActuatorChoice
    keys: ClassVar[tuple[str, ...]] = ("rate_limit", "lag")
    absent: ClassVar[Mapping[str, float]] = {"rate_limit": np.inf, "lag": 0.0}
    inputs: ClassVar[tuple[str, ...]] = ("target",)
    outputs: ClassVar[tuple[str, ...]] = ("actuator_force", "rate_limited")
    states: ClassVar[tuple[str, ...]] = ("reached", "followed")

    @staticmethod
    def prepare(values: Mapping[str, Any], period: Any) -> DriveCoefficients:
        rate, lag = values["rate_limit"], values["lag"]
        lags = greater(lag, 0.0)
        return DriveCoefficients(period, rate, where(less(rate, np.inf), rate, 0.0), where(lags, lag, 1.0), lags)

    @staticmethod
    def without_idle(coefficients: DriveCoefficients) -> DriveCoefficients:
        c = coefficients
        if not np.isfinite(c.rate).any():
            c = c._replace(rate=None, slope=None)
        if not c.lags.any():
            return c._replace(lag=None, lags=None)
        return c._replace(lags=None) if c.lags.all() else c

    @staticmethod
    def start(_coefficients: DriveCoefficients, inputs: Signals) -> Signals:
        return inputs[0], inputs[0]

    @staticmethod
    def step(coefficients: DriveCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        h, rate, slope, tau, lags = coefficients
        (r0, force), (target,) = states, inputs
        if rate is None:
            r1 = mean = target
            reached, on_ramp, rest, is_behind = r0, force, h, None
        else:
            # from r₀ to the target at ±rate, reached after a ≤ h, or at the step's end not yet
            distance = target - r0
            a = minimum(np.abs(distance) / rate, h)
            slope = sign(distance) * slope
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


class TakeoverCoefficients(NamedTuple):
    """Of `Takeover`."""

    share: Any  # of what was taken over that fades in a sample


class Takeover(Stepped):
    """Off, the command is the manual force; on, it begins there, and what the controller's own lacks of it fades."""

    name: ClassVar[str] = "takeover"
    table: ClassVar[type[TableSection]] = TableSection
    keys: ClassVar[tuple[str, ...]] = ()
    inputs: ClassVar[tuple[str, ...]] = ("wanted", "manual_force", "off")
    outputs: ClassVar[tuple[str, ...]] = ("command",)
    states: ClassVar[tuple[str, ...]] = ("transfer",)

    @staticmethod
    def prepare(_values: Mapping[str, Any], period: Any) -> TakeoverCoefficients:
        return TakeoverCoefficients(period / TRANSFER_TIME)

    @staticmethod
    def start(_coefficients: TakeoverCoefficients, inputs: Signals) -> Signals:
        return (0 * inputs[0],)

    @staticmethod
    def step(coefficients: TakeoverCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        (transfer,), (wanted, manual_force, off) = states, inputs
        is_off = greater(off, 0.0)
        lacked = where(is_off, manual_force - wanted, transfer - transfer * coefficients.share)
        return (lacked,), (where(is_off, manual_force, wanted + transfer),)
