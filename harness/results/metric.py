"""What a metric of a run is: a number with words, unit and meaning.

Each is declared once, by the fold that computes it; `metric_folds` has all of them.
"""

from typing import Literal, NamedTuple

from gough_stewart.harness.report.quantities import Quantity


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
