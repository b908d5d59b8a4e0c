"""Headings of tables of numbers: a name, and a unit in brackets, as in "leg_length[1] [mm]" or "time (ms)"."""

import re
from collections.abc import Mapping
from typing import NamedTuple

from gough_stewart.harness.quantities import unit_typed

_WITH_UNIT = re.compile(r"(.*?)(\s*)[\[(]([^\[\]()]*)[\])]")
_INDEX = re.compile(r"\d+(,\d+)*")


class Heading(NamedTuple):
    """A heading in its parts."""

    column: str  # as in the file
    name: str
    unit: str | None

    @classmethod
    def of(cls, column: str) -> "Heading":
        """Split a heading; "position[1]" is a name with an index, "qx [1]" has the unit 1."""
        parts = _WITH_UNIT.fullmatch(column.strip())
        if parts is None or (_INDEX.fullmatch(parts[3]) and not parts[2]):
            return cls(column, column.strip(), None)
        return cls(column, parts[1], parts[3].strip())

    def factor(self, units: Mapping[str, float]) -> float:
        """What converts the column to the first of these units, each with its factor; 1 without a unit.

        Raises
        ------
        ValueError
            Another unit; names those that are known.
        """
        if self.unit is None:
            return 1.0
        unit = unit_typed(self.unit)
        if unit not in units:
            known = ", ".join(unit for unit in units if unit)
            raise ValueError(f"{self.column} has the unit '{self.unit}'; expected one of {known}")
        return units[unit]
