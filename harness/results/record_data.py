"""The rows of a run as a table, one per time, in SI units; interface variables under their FMI 2.0 names."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
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
        columns = self._columns.get(name)
        if columns is None:
            variables = [variable for variable in self._columns if "[" not in variable]
            raise RecordError(f"the record has no '{name}'{interface.nearest(name, variables)}")
        values = [self.table.get_column(column).to_numpy() for column in columns]
        return values[0] if columns == [name] else np.column_stack(values)

    def __contains__(self, name: str) -> bool:
        """Whether a column or variable of this name exists."""
        return name in self._columns

    def columns_of(self, name: str) -> list[str]:
        """The columns of a variable."""
        return [column for column in self._columns.get(name, []) if column != name]

    @cached_property
    def _columns(self) -> dict[str, list[str]]:
        """The columns that each name stands for: a column for itself, a variable for all of its columns."""
        columns: dict[str, list[str]] = {}
        for column in self.table.columns:
            variable, bracket, _ = column.partition("[")
            if bracket:
                columns.setdefault(variable, []).append(column)
            columns[column] = [column]
        return columns
