"""What a metric of a run is: a number with words, unit and meaning.

Each is declared once, by the fold that computes it; `metric_folds` has all of them.
"""

from typing import Literal, NamedTuple


class Quantity(NamedTuple):
    """A kind of number: its SI unit, and how it is displayed."""

    si: str  # as in `quantities.UNITS`; "" for a plain number
    unit: str
    factor: float  # from the metric's number to that in `unit`


LENGTH, ANGLE = Quantity("m", "mm", 1e3), Quantity("rad", "mrad", 1e3)
FORCE, POWER, ENERGY = Quantity("N", "N", 1.0), Quantity("W", "W", 1.0), Quantity("J", "J", 1.0)
VELOCITY, TIME = Quantity("m/s", "m/s", 1.0), Quantity("s", "s", 1.0)
# A percentage is a number in percent, a share one from 0 to 1.
SHARE, PERCENT, NUMBER = Quantity("1", "%", 100.0), Quantity("1", "%", 1.0), Quantity("", "", 1.0)


class Shown(NamedTuple):
    """How a number is displayed: its words, and its unit with the factor from the SI unit."""

    text: str
    unit: str
    factor: float


class Metric(NamedTuple):
    """A number of a run, or one for each leg or axis."""

    path: str
    text: str  # in tables, of one number for all legs or axes
    quantity: Quantity
    sentence: str
    better: Literal["smaller", "larger"] | None = None
    is_compared: bool = True  # whether it is shown beside that of other runs
    is_least: bool = False  # of several legs or axes, the least stands for all; of other metrics, the largest
    needs: tuple[str, ...] = ()  # columns of the record
