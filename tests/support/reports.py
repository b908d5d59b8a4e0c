"""Reports as data, in the format of docs/report.md: read from results and files, written by hand, shown as pages."""

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import gough_stewart as gs
from tests.support.commands import invoke

QUANTITIES: dict[str, dict[str, Any]] = {
    "length": {"si": "m", "unit": "mm", "factor": 1e3, "name": "length"},
    "angle": {"si": "rad", "unit": "deg", "factor": 180 / np.pi, "name": "angle"},
    "force": {"si": "N", "unit": "N", "name": "force"},
    "time": {"si": "s", "unit": "s", "name": "time", "symbol": "t"},
    "frequency": {"si": "Hz", "unit": "Hz", "name": "frequency", "symbol": "f"},
    "number": {"si": "", "unit": "", "name": "number"},
    "count": {"si": "", "unit": "", "name": "count", "digits": 9},
    "share": {"si": "1", "unit": "%", "factor": 100.0, "name": "share"},
}

_TIME = [7.3, 7.4, 7.6]


def series(name: str, values: Any, role: str = "actual", quantity: str = "length", **more: Any) -> dict[str, Any]:
    """A series of a chart."""
    return {"name": name, "quantity": quantity, "values": values, "role": role, **more}


def chart(title: str, x: Any, *lines: dict[str, Any], kind: str = "line", **more: Any) -> dict[str, Any]:
    """A chart over times, or over an axis."""
    axis = x if isinstance(x, dict) else {"name": "time", "quantity": "time", "values": x}
    return {"part": "chart", "title": title, "x": axis, "series": list(lines), "kind": kind, **more}


def table(title: str, columns: list[dict[str, Any]], rows: list[list[Any]], **more: Any) -> dict[str, Any]:
    """A table."""
    return {"part": "table", "title": title, "columns": columns, "rows": rows, **more}


def report(*parts: dict[str, Any], **fields: Any) -> dict[str, Any]:
    """A report with these parts in one section."""
    verdict = {"text": "v", "status": "told"}
    whole = {"version": 1, "quantities": QUANTITIES, "title": "r", "verdict": verdict}
    whole |= {"sections": [{"title": "s", "parts": list(parts)}], **fields}
    plain: dict[str, Any] = json.loads(json.dumps(whole, default=lambda array: array.tolist()).replace("NaN", "null"))
    return plain


def whole() -> dict[str, Any]:
    """A report with every kind of part, and a value in every field."""
    scene = {
        "part": "scene", "name": "heave", "base_points": np.arange(18.0).reshape(6, 3), "home": np.arange(7.0),
        "platform_points": -np.arange(18.0).reshape(6, 3), "lower": 0.31, "upper": 0.42, "time": _TIME,
        "pose": np.arange(21.0).reshape(3, 7), "leg_length": np.linspace(1, 2, 18).reshape(3, 6),
        "orientation": np.ones((3, 3)), "reference": 2 * np.arange(21.0).reshape(3, 7),
        "actuator_force": np.arange(18.0).reshape(3, 6), "external_force": np.ones((3, 3)),
        "nearness": np.full((3, 6), 0.25), "nearness_of": ["stroke", "force"], "rows": 30, "run": 1, "decimals": 7,
        "flags": [{"name": "force limited", "values": "01"}],
    }  # fmt: skip
    curve = series(
        "leg 4", [1e-3, None, "Infinity"], "measured", leg=4, run=1, component="x", of=30,
        low=[0.0, 1.0, "-Infinity"], high=[1.0, 2.0, 3.0], x=[0.0, 1.0, 2.0], members=[5.0, 6.0, 9.0],
    )  # fmt: skip
    errors = chart(
        "errors", _TIME, curve, kind="step", y={"name": "error", "quantity": "length", "scale": "log"}, note="some",
        group="e", detail=True, spans=[{"at": 7.4, "low": 1e-3, "high": 2e-3, "text": "left", "role": "bad"}],
        marks=[{"value": 2e-3, "text": "limit"}, {"value": 7.5, "text": "worst", "direction": "vertical", "role": "bad",
                                                  "tells": False}],
        strips=[{"name": "force", "intervals": [[7.3, 7.4], [7.5, 7.6]], "role": "bad", "share": 0.4}],
        samples={"members": [3.0, 5.0], "x": [7.3, 7.6], "values": [[1.0, 2.0], [3.0, 4.0]], "of": 9},
    )  # fmt: skip
    x, rows = ({"name": name, "quantity": "length", "values": [0.0, 1.0]} for name in "xy")
    slices = {"inside": [[[1.0, -1.0], [1.0, 1.0]], [[2.0, None], [1.0, 1.0]]], "scale": "log", "first": 1,
              "classes": ["free", "blocked"], "slices": {"name": "z", "quantity": "length", "values": [5.0, 6.0]},
              "point": [0.0, 2.0], "point_name": "home"}  # fmt: skip
    layers = [[[1.0, "Infinity"], [1.0, 1.0]], [[3.0, 4.0], [1.0, 1.0]]]
    surface = {
        "part": "surface", "title": "region", "names": ["x", "y", "roll"], "quantities": ["length", "length", "angle"],
        "low": [0.0] * 3, "high": [1.0] * 3, "vertices": np.eye(3) / 2, "triangles": [[0.0, 1.0, 2.0]],
        "values": [1.0, 2.0, "Infinity"], "name": "gain", "quantity": "count", "scale": "log", "detail": True,
    }  # fmt: skip
    causes = {"name": "cause", "labels": ["a", "b"]}
    columns = [{"name": "", "explanation": "what"}, {"name": "1", "quantity": "length"}, {"name": "all"}]
    cells: list[list[Any]] = [
        ["peak", 1e-3, {"value": 3.5, "quantity": "force"}],
        ["ok", None, True],
        ["n", "Infinity", 7],
    ]
    number = {
        "path": "tracking.position.norm_peak", "name": "peak", "value": 8e-4, "quantity": "length", "low": 7e-4,
        "high": 9e-4, "limit": 1e-3, "margin": 2e-4, "explanation": "largest", "members": [1.0, None],
        "small_is_worse": True, "block": 3, "in_sequence": True, "doubt": "without jitter",
    }  # fmt: skip
    required = {"text": "a <= 1 mm", "path": "a", "name": "the a", "status": "open", "value": None, "bound": 1e-3,
                "quantity": "length", "margin": "Infinity", "note": "needs 60 members"}  # fmt: skip
    return report(
        table("Legs", columns, cells, sortable=True, first_shown=2, group_ends=[1], links=["a.html", "", ""],
              note="of all", detail=True, beside=True),
        errors,
        chart("reach", x, series("volume", [[0.1, 0.2], [None, 1.0]], quantity="share"), kind="heat", y=rows),
        chart("layers", x, series("gain", layers, quantity="count"), kind="heat", y=rows, map=slices),
        chart("causes", causes, series("members", [3.0, 4.0], quantity="count"), kind="bars"),
        scene, surface, {"part": "note", "text": "odd", "kind": "warning"},
        title="Heave", verdict={"text": "Follows within 0.8 mm", "status": "good", "numbers": [number]},
        study="run", lead="a step", numbers=[number], requirements=[required], runs=["one", "two"],
        settings=[{"key": "loop.delay", "values": ["1", "2"], "default": "0"}], notes=[{"text": "well"}],
        files=[{"name": "record.csv", "what": "rows"}], repeat="gough-stewart run mine.toml --member",
    )  # fmt: skip


def page_of(whole: dict[str, Any]) -> bytes:
    """Its page."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "report.json").write_text(json.dumps(whole, allow_nan=False), encoding="utf-8")
        done = invoke("view", folder, "--out", f"{folder}/page.html")
        assert done.exit_code == 0, done.output
        return Path(folder, "page.html").read_bytes()


def page_of_records(records: list[gs.Record], names: list[str]) -> bytes:
    """The page of `gs.view`."""
    with tempfile.TemporaryDirectory() as folder:
        return gs.view(records, f"{folder}/page.html", names=names).read_bytes()


def tables_of(report: Any) -> dict[str, Any]:
    """The tables of a report in Python, by title."""
    return {part.title: part for part in report.parts() if type(part).__name__ == "Table"}


def report_in(folder: Path) -> dict[str, Any]:
    """The report that a command wrote to a folder."""
    return dict(json.loads((folder / "report.json").read_text(encoding="utf-8")))


def parts_in(data: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    """All tables, charts, notes or surfaces of a report as data."""
    return [part for section in data["sections"] for part in section["parts"] if part["part"] == kind]


def rows_in(table: dict[str, Any]) -> dict[str, list[Any]]:
    """The cells of a table as data by the first one of each row, numbers in SI units."""
    return {row[0]: [cell["value"] if isinstance(cell, dict) else cell for cell in row[1:]] for row in table["rows"]}


def units_in(data: dict[str, Any], table: dict[str, Any]) -> dict[str, str]:
    """The unit in which each row of a table as data is shown, by its first cell; that of its first number."""
    quantities = {row[0]: next((c["quantity"] for c in row[1:] if isinstance(c, dict)), None) for row in table["rows"]}
    return {name: data["quantities"].get(key, {}).get("unit", "") for name, key in quantities.items()}
