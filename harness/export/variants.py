"""Laws whose gains may be turned while a machine runs, by what of them is fixed; c/machine has the laws by number."""

from itertools import product
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.control.controllers import SixChannels
from gough_stewart.harness.control.pid import DerivativeOn, Gains
from gough_stewart.harness.control.state_space import METHODS, Method

_DERIVATIVES: tuple[DerivativeOn, ...] = ("error", "measurement")


class TurnableLaw(NamedTuple):
    """What of a law is fixed while its gains are turned."""

    derivative_on: DerivativeOn
    integrates: bool
    discretisation: Method
    has_notch: bool


VARIANTS = tuple(TurnableLaw(*fixed) for fixed in product(_DERIVATIVES, (False, True), METHODS, (False, True)))


def variant_of(controller: SixChannels, gains: Gains) -> TurnableLaw | None:
    """Of a PD or PID; None if not all of its channels have the same actions."""
    differentiates, integrates = np.asarray(gains.derivative) > 0, np.asarray(gains.integral) > 0
    if not differentiates.all() or integrates.any() != integrates.all():
        return None
    actions = bool(integrates.all())
    return TurnableLaw(controller.derivative_on, actions, controller.discretisation, controller.notch is not None)
