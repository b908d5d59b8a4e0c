"""The data of an ensemble: a row for each member, bands over time, and metadata.

`members` is the table of `columns.py`, `bands` that of `gough_stewart.harness.results.bands.bands_frame`. The metadata
contain at least `title`, `seed`, `sampling`, and `groups`: the varied columns, as lists of those that vary together.
"""

from dataclasses import dataclass
from typing import Any

import polars

from gough_stewart.harness.ensemble.columns import VARIED, metric_name, metric_names, numbers
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class EnsembleData:
    """Members, bands and metadata of an ensemble, by the names of metrics and inputs."""

    members: polars.DataFrame
    bands: polars.DataFrame
    metadata: dict[str, Any]
    # Signals of the first members at few times, of `bands.samples_frame`.
    samples: polars.DataFrame | None = None

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
