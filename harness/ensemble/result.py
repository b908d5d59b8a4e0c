"""The result of an ensemble: a row for each member, bands over time, and metadata.

`members` is the table of `columns.py`, `bands` that of `gough_stewart.harness.results.bands.bands_frame`. The metadata
contain at least `title`, `seed`, `sampling`, and `groups`: the varied columns, as lists of those that vary together.
"""

from dataclasses import dataclass
from typing import Any

import polars

from gough_stewart.harness.ensemble.columns import VARIED, metric_name, metric_names, numbers
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble:
    """An ensemble that has run; displays the quantiles of its metrics, and its failures."""

    members: polars.DataFrame
    bands: polars.DataFrame
    metadata: dict[str, Any]

    def __repr__(self) -> str:
        """Title and tables as in the terminal."""
        from gough_stewart.harness.ensemble.tables import ensemble_sheets
        from gough_stewart.harness.output.tables import text_of, to_terminal

        tables = (text_of(to_terminal(sheet)) for sheet in ensemble_sheets(self.members))
        return "\n".join([f"Ensemble: {self.title}", *tables])

    def _repr_html_(self) -> str:
        """The tables, for a notebook."""
        from gough_stewart.harness.ensemble.tables import ensemble_sheets
        from gough_stewart.harness.output.tables import to_html

        return f"<div>{''.join(map(to_html, ensemble_sheets(self.members)))}</div>"

    @property
    def metrics(self) -> tuple[str, ...]:
        """Names of the metrics and margins."""
        return metric_names(self.members)

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the varied inputs, without prefix."""
        return tuple(name.removeprefix(VARIED) for name in self.members.columns if name.startswith(VARIED))

    @property
    def title(self) -> str:
        """Title of the experiment."""
        return str(self.metadata.get("title", "ensemble"))

    def values(self, name: str) -> FloatArray:
        """A metric, a margin or a varied input of every member (N,); NaN if undefined."""
        column = f"{VARIED}{name}" if f"{VARIED}{name}" in self.members.columns else metric_name(self.members, name)
        return numbers(self.members, column)
