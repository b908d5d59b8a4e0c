"""The limits on a command: what of it the drives can do, and what they cannot, for the controller's anti-windup."""

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from gough_stewart.harness.control.component import Clock, Signals, Stepped
from gough_stewart.harness.control.drive import ActuatorChoice
from gough_stewart.harness.section import Section
from gough_stewart.model.operations import clip, not_equal


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
    table: ClassVar[type[Section]] = ActuatorChoice
    keys: ClassVar[tuple[str, ...]] = ("force_limit", "rate_limit")
    absent: ClassVar[Mapping[str, float]] = {"force_limit": np.inf, "rate_limit": np.inf}
    clock: ClassVar[Clock] = "sample"
    inputs: ClassVar[tuple[str, ...]] = ("command",)
    outputs: ClassVar[tuple[str, ...]] = ("allowed", "force_limited", "excess")
    states: ClassVar[tuple[str, ...]] = ("planned",)

    @staticmethod
    def prepare(values: Mapping[str, Any], period: Any) -> LimitCoefficients:
        """As `Stepped`."""
        limit = values["force_limit"]
        return LimitCoefficients(-limit, limit, values["rate_limit"] * period)

    @staticmethod
    def without_idle(coefficients: LimitCoefficients) -> LimitCoefficients:
        """As `Stepped`."""
        c = coefficients
        if not np.isfinite(c.high).any():
            c = c._replace(low=None, high=None)
        return c if np.isfinite(c.change).any() else c._replace(change=None)

    @staticmethod
    def start(coefficients: LimitCoefficients, inputs: Signals) -> Signals:
        """As `Stepped`; none without a rate limit."""
        return () if coefficients.change is None else inputs

    @staticmethod
    def step(coefficients: LimitCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        """As `Stepped`."""
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
