"""A report as JSON, and back; docs/report.md describes the fields.

Fields with their default value are left out. Quantities are listed once, under `quantities`, and named elsewhere. A
part of a section says what it is by `part`.
"""

import json
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from gough_stewart.harness.report.chart import COLUMNS, Chart, Scene, Series
from gough_stewart.harness.report.document import Part, Report
from gough_stewart.harness.report.packing import decimated
from gough_stewart.harness.report.quantities import Quantity

VERSION = 1
# Points of a line, and frames of a scene, that other programs are given.
POINTS, FRAMES = 800, 201
_REPORT = TypeAdapter(Report)


def to_data(report: Report) -> dict[str, Any]:
    """A report as dictionaries, lists, strings, numbers, booleans and None."""
    keys: dict[Quantity, str] = {}
    data = json.loads(_REPORT.dump_json(report, context=keys))
    for section, written in zip(report.sections, data.get("sections", ()), strict=True):
        kinds = [type(part).__name__.lower() for part in section.parts]
        written["parts"] = [{"part": kind, **part} for kind, part in zip(kinds, written["parts"], strict=True)]
    for note in data.get("notes", ()):
        note["part"] = "note"
    return {"version": VERSION, "quantities": {key: quantity.changed for quantity, key in keys.items()}, **data}


def to_json(report: Report) -> str:
    """A report as JSON, on one line."""
    return json.dumps(to_data(report), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def from_json(text: str | bytes) -> Report:
    """The report of `to_json`; a ValueError names the field of other JSON."""
    data = json.loads(text)
    known = data if isinstance(data, dict) else {"version": type(data).__name__}
    if known.get("version") != VERSION:
        command = known.get("study") or "…"
        raise ValueError(
            f"version: {known.get('version')}; expected a report of version {VERSION}, as `gough-stewart {command} "
            "--report` writes"
        )
    del data["version"]
    for note in data.get("notes", ()):
        note.pop("part", None)
    try:
        return _REPORT.validate_python(data, context=data.pop("quantities", {}))
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"report.{'.'.join(map(str, first['loc']))}: {first['msg']}") from error


def schema() -> dict[str, Any]:
    """The JSON schema of a report's fields."""
    return _REPORT.json_schema()


def thinned(report: Report, points: int = POINTS) -> Report:
    """The same report for other programs: of a line at most so many points, of each interval the smallest and largest.

    Samples of members, of millions of numbers, are left out.
    """

    def fewer(part: Part) -> Part:
        if isinstance(part, Scene):
            return _few_frames(part)
        if not isinstance(part, Chart):
            return part
        part = part if part.samples is None else replace(part, samples=None)
        if part.kind not in ("line", "step") or all(len(series.values) <= points for series in part.series):
            return part
        series = tuple(_few_points(part.x_of(series), series, points) for series in part.series)
        # every series has abscissae of its own now
        return replace(part, x=replace(part.x, values=np.zeros(0)), series=series)

    sections = tuple(replace(section, parts=tuple(map(fewer, section.parts))) for section in report.sections)
    return replace(report, sections=sections)


def _few_points(x: Any, series: Series, points: int) -> Series:
    kept = decimated(np.arange(len(x), dtype=float), series.values, points)[0].astype(int)
    arrays = {name: getattr(series, name) for name in ("values", "low", "high", "members")}
    return replace(
        series, x=x[kept], of=len(x), **{name: array[kept] for name, array in arrays.items() if array is not None}
    )


def _few_frames(scene: Scene) -> Scene:
    """What was on or off between two of the frames is on if it was on in any part."""
    if len(scene.time) <= FRAMES:
        return scene
    kept = np.unique(np.linspace(0, len(scene.time) - 1, FRAMES).astype(int))
    arrays = {name: array[kept] for name in ("time", *COLUMNS) if (array := getattr(scene, name)) is not None}
    flags = tuple(
        replace(flag, values="".join("01"["1" in flag.values[a:b]] for a, b in pairwise(kept))) for flag in scene.flags
    )
    return replace(scene, flags=flags, **arrays)
