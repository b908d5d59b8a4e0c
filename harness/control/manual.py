"""A controller that is switched off and on without a bump."""

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from gough_stewart.harness.control.component import Signals, Stepped
from gough_stewart.harness.section import TableSection
from gough_stewart.model.operations import greater, where

# In which a force fades that was taken over from manual operation [s].
TRANSFER_TIME = 1.0


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
