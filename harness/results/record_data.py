"""The rows of a run as a table, one per time, in SI units; interface variables under their FMI 2.0 names."""

from dataclasses import dataclass
from typing import Any

import polars

from gough_stewart.harness.errors import RecordError
from gough_stewart.model import interface
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True, repr=False)
class RecordData:
    """Table and metadata of a record, by the names of signals."""

    table: polars.DataFrame
    metadata: dict[str, Any]

    def __getitem__(self, name: str) -> FloatArray:
        """A column (n,), or all columns of a variable (n, size): `record["position"]`, `record["error.leg_length"]`.

        Raises
        ------
        RecordError
            There is no such column; suggests the nearest name.
        """
        if name in self.table.columns:
            return self.table[name].to_numpy()
        columns = self.columns_of(name)
        if not columns:
            names = {column.split("[")[0]: None for column in self.table.columns}
            raise RecordError(f"the record has no '{name}'{interface.nearest(name, names)}")
        return self.table.select(columns).to_numpy()

    def __contains__(self, name: str) -> bool:
        """Whether a column or variable of this name exists."""
        return name in self.table.columns or bool(self.columns_of(name))

    def columns_of(self, name: str) -> list[str]:
        """The columns of a variable."""
        return [column for column in self.table.columns if column.startswith(f"{name}[")]
