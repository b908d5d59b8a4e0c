"""What an exported controller does about inputs that cannot be: its safe force, and which inputs count as frozen."""

from typing import Literal, NamedTuple, get_args

import numpy as np

from gough_stewart.harness.errors import ExportError
from gough_stewart.model.parameters import Variable

SafeForce = Literal["feedforward", "zero"]
SAFE_FORCES: tuple[SafeForce, ...] = get_args(SafeForce)
# Signals whose references are lengths [m].
_WATCHED = ("leg_length", "position")


class Frozen(NamedTuple):
    """A measurement that is the same for some samples while its reference moves farther than that [m] is frozen."""

    samples: int
    movement: float  # [m]


class Faults(NamedTuple):
    """The choices."""

    safe_force: SafeForce = "feedforward"
    frozen: Frozen | None = None  # not watched

    def watched(self, measured: tuple[Variable, ...]) -> tuple[Variable, ...]:
        """Those of the measurements that are watched."""
        return () if self.frozen is None else tuple(v for v in measured if v.name in _WATCHED)


def faults_of(safe_force: str = "feedforward", frozen: object = None) -> Faults:
    """The choices from a user's values.

    Raises
    ------
    ExportError
        An unknown safe force; or samples and movement that are not two numbers > 0.
    """
    if safe_force not in SAFE_FORCES:
        raise ExportError(f"safe_force is {safe_force!r}; expected {' or '.join(map(repr, SAFE_FORCES))}")
    if frozen is None:
        return Faults(safe_force)
    try:
        samples, movement = (float(each) for each in frozen)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        samples, movement = np.nan, np.nan
    if not (1 <= samples <= 1e9 and samples == round(samples) and 0 < movement < np.inf):
        raise ExportError(
            f"frozen is {frozen!r}; expected a number of samples and a movement of the reference in metres that "
            "the sensors resolve, such as (50, 0.001)"
        )
    return Faults(safe_force, Frozen(int(samples), movement))


def check_faults(faults: Faults, measured: tuple[Variable, ...]) -> None:
    """Refuse to watch a controller that measures no lengths.

    Raises
    ------
    ExportError
        Names what it measures.
    """
    if faults.frozen is not None and not faults.watched(measured):
        raise ExportError(
            f"frozen needs measurements of {' or '.join(_WATCHED)}, whose references are lengths; the controller "
            f"measures {', '.join(v.name for v in measured) or 'nothing'}"
        )
