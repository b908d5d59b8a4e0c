"""A report is plain data, and JSON carries all of it."""

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart.harness.report.chart import Series
from gough_stewart.harness.report.document import Column, Number, Table, Value, from_json, schema, to_json
from gough_stewart.harness.report.quantities import LENGTH
from tests.support.reports import whole


def leaves(data: Any, path: tuple[Any, ...] = ()) -> dict[tuple[Any, ...], Any]:
    """Every text, number, true, false and null in data, by its keys and places."""
    inside = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    parts = [leaves(value, (*path, key)) for key, value in inside]
    return {where: leaf for part in parts for where, leaf in part.items()} if parts else {path: data}


def test_json_carries_every_field_of_every_part() -> None:
    """Expected: the data that were read, of a report with a value in every field, but for defaults, left out."""
    data = leaves(whole())
    again = leaves(json.loads(to_json(from_json(json.dumps(whole())))))
    changed = {
        (path[-1], value)
        for path, value in data.items()
        if path[0] != "quantities" and again.get(path, "absent") != value
    }
    assert changed == {("role", "actual")}
    seen = {word for path in data for word in path}
    fields = {name for kind in classes().values() for name in kind["properties"]}
    assert fields <= seen


def classes() -> dict[str, Any]:
    found: dict[str, Any] = schema()
    return {"Report": found, **{name: kind for name, kind in found["$defs"].items() if name != "Quantity"}}


def test_a_number_that_is_not_defined_is_none_and_arrays_are_read_only_copies() -> None:
    undefined: Any = math.nan
    assert Number("a", "a", undefined).value is None
    assert Value(undefined, LENGTH).value is None
    assert Table("", (Column("a", LENGTH),), ((undefined,),)).rows == ((None,),)
    values = np.zeros(3)
    series = Series("a", LENGTH, values)
    values[0] = 1
    assert series.values[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        series.values[0] = 2


def test_the_documentation_lists_every_field() -> None:
    """The classes themselves are the source; docs/report.md names each field of each, in order."""
    text = (Path(__file__).parents[3] / "docs/report.md").read_text(encoding="utf-8")
    for name, kind in classes().items():
        part = re.search(rf"^### {name}\n(.*?)(?=^##|\Z)", text, re.DOTALL | re.MULTILINE)
        assert part, name
        names = list(kind["properties"])
        assert [word for word in dict.fromkeys(re.findall(r"`(\w+)`", part[1])) if word in names] == names, name
