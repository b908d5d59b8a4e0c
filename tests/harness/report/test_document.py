"""A report is plain data: it is checked when it is made, and JSON carries all of it."""

import json
import math
import re
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart.harness.report import chart, document
from gough_stewart.harness.report.chart import (
    Axis,
    Chart,
    Flag,
    Map,
    Mark,
    Scene,
    Series,
    Span,
    Strip,
    Surface,
    time_axis,
)
from gough_stewart.harness.report.codec import from_json, schema, to_data, to_json
from gough_stewart.harness.report.data import Data
from gough_stewart.harness.report.document import File, Note, Number, Report, Requirement, Section, Setting, Verdict
from gough_stewart.harness.report.quantities import (
    ANGLE,
    COUNT,
    FORCE,
    LENGTH,
    SHARE,
    Quantity,
)
from gough_stewart.harness.report.table import Column, Table, Value

_TIME: Any = [7.3, 7.4, 7.6]
# Lists become arrays; wrong values are refused.
_Axis: Any = Axis
_Number: Any = Number
_Series: Any = Series
_Scene: Any = Scene
_Chart: Any = Chart
_Verdict: Any = Verdict
_Map: Any = Map


def _surface(**other: Any) -> Surface:
    parts: dict[str, Any] = {"vertices": np.zeros((2, 3)), "triangles": np.zeros((1, 3)), "values": np.zeros(2)}
    parts |= {"names": ("x", "y", "z"), "quantities": (LENGTH,) * 3, "low": np.zeros(3), "high": np.ones(3), **other}
    return Surface("s", **parts)


def _heat(values: Any, rows: Any, **more: Any) -> Chart:
    chart: Chart = _Chart(
        "c", time_axis([0, 1]), (_Series("a", COUNT, values),), "heat", _Axis("y", LENGTH, rows), **more
    )
    return chart


def whole_report() -> Report:
    """A report with every kind of part, and a value in every field."""
    scene = _Scene(
        name="heave",
        base_points=np.arange(18.0).reshape(6, 3),
        platform_points=-np.arange(18.0).reshape(6, 3),
        lower=0.31,
        upper=0.42,
        time=_TIME,
        pose=np.arange(21.0).reshape(3, 7),
        leg_length=np.linspace(1, 2, 18).reshape(3, 6),
        home=np.arange(7.0),
        orientation=np.ones((3, 3)),
        reference=2 * np.arange(21.0).reshape(3, 7),
        actuator_force=np.arange(18.0).reshape(3, 6),
        external_force=np.ones((3, 3)),
        nearness=np.full((3, 6), 0.25),
        nearness_of=("stroke", "force"),
        flags=(Flag("force limited", "01"),),
        rows=30,
        run=1,
        decimals=7,
    )
    beside: dict[str, Any] = {"low": [0, 1, -math.inf], "high": [1, 2, 3], "x": [0.0, 1.0, 2.0], "members": [5, 6, 9]}
    values = [1e-3, math.nan, math.inf]
    series = _Series("leg 4", LENGTH, values, "measured", leg=4, run=1, component="x", of=30, **beside)
    marks = (Mark(2e-3, "limit", "horizontal", "limit"), Mark(7.5, "worst", "vertical", "bad", tells=False))
    shown: dict[str, Any] = {
        "spans": (Span(7.4, 1e-3, 2e-3, "left", "bad"),),
        "strips": (Strip("force", ((7.3, 7.4), (7.5, 7.6)), "bad", 0.4),),
    }
    log = _Axis("error", LENGTH, scale="log")
    chart = _Chart("errors", time_axis(_TIME), (series,), "step", log, marks, "some", "e", True, **shown)
    volume = _Series("volume", SHARE, [[0.1, 0.2], [math.nan, 1.0]])
    heat = _Chart("reach", _Axis("x", LENGTH, [0, 1]), (volume,), "heat", _Axis("y", LENGTH, [2, 3]))
    inside = np.array([[[1.0, -1.0]], [[2.0, math.nan]]])
    slices = _Map(inside, "log", ("free", "blocked"), _Axis("z", LENGTH, [5, 6]), 1, (0, 2), "home")
    layers = _Chart(
        "layers", _Axis("x", LENGTH, [0, 1]), (_Series("gain", COUNT, [[[1, math.inf]], [[3, 4]]]),), "heat",
        _Axis("y", LENGTH, [2]), map=slices,
    )  # fmt: skip
    surface = Surface(
        "region", ("x", "y", "roll"), (LENGTH, LENGTH, ANGLE), np.zeros(3), np.ones(3), np.eye(3) / 2,
        np.array([[0.0, 1, 2]]), np.array([1.0, 2, math.inf]), "gain", COUNT, "log", True,
    )  # fmt: skip
    bars = _Chart("causes", _Axis("cause", labels=("a", "b")), (_Series("members", COUNT, [3, 4]),), "bars")
    table = Table(
        "Legs",
        (Column("", explanation="what"), Column("1", LENGTH), Column("all")),
        (("peak", 1e-3, Value(3.5, FORCE)), ("ok", None, True), ("n", math.inf, 7)),
        sortable=True,
        first_shown=2,
        group_ends=(1,),
        links=("a.html", "", ""),
        note="of all",
        detail=True,
    )
    of_members: dict[str, Any] = {"members": [1.0, math.nan], "small_is_worse": True, "block": 3}
    ends = (7e-4, 9e-4, 1e-3, 2e-4)  # interval, limit, margin
    path = "tracking.position.norm_peak"
    number = _Number(path, "peak", 8e-4, LENGTH, *ends, "largest", **of_members, doubt="without jitter")
    required = Requirement("a <= 1 mm", "a", "the a", "open", None, 1e-3, LENGTH, math.inf, "needs 60 members")
    return Report(
        "Heave",
        _Verdict("Follows within 0.8 mm", "good", (number,)),
        (
            Section("Tracking", (table, chart, heat, layers, bars, scene, surface, Note("odd", "warning"))),
            Section("More", (), detail=True),
        ),
        study="run",
        lead="a step",
        numbers=(number,),
        requirements=(required,),
        settings=(Setting("loop.delay", ("1", "2"), "0"),),
        runs=("one", "two"),
        notes=(Note("well"),),
        files=(File("record.csv", "rows"),),
        repeat="gough-stewart run mine.toml --member",
    )


def _equal(one: Any, other: Any) -> bool:
    """Equality of all fields, by a walk of its own."""
    if is_dataclass(one) and not isinstance(one, type):
        return type(one) is type(other) and all(
            _equal(getattr(one, f.name), getattr(other, f.name)) for f in fields(one)
        )
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and np.array_equal(one, other, equal_nan=True)
    if isinstance(one, tuple):
        return isinstance(other, tuple) and len(one) == len(other) and all(map(_equal, one, other))
    return type(one) is type(other) and one == other


def test_json_carries_every_field_of_every_part() -> None:
    report = whole_report()
    text = to_json(report)
    assert _equal(from_json(text), report)
    # every field was given, so that none is equal by its default alone
    seen = {kind: set(data) for kind, data in _objects(to_data(report))}
    for kind in (Scene, Surface, Map, Series, Table, Report, Requirement, Number, Mark):
        assert seen[kind.__name__] >= {each.name for each in fields(kind)} - {"value"}, kind


def _objects(data: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """The objects in the data of `whole_report` by class."""
    parts = data["sections"][0]["parts"]
    return [
        ("Report", data),
        ("Scene", parts[5]),
        ("Surface", parts[6]),
        ("Map", parts[3]["map"]),
        ("Table", parts[0]),
        ("Series", parts[1]["series"][0]),
        ("Mark", {**parts[1]["marks"][1], **parts[1]["marks"][0], "direction": 0, "role": 0}),
        ("Requirement", data["requirements"][0]),
        ("Number", data["numbers"][0]),
    ]


def test_json_has_neither_nan_nor_infinity() -> None:
    def refuse(word: str) -> None:
        raise AssertionError(word)

    data = json.loads(to_json(whole_report()), parse_constant=refuse)
    series = data["sections"][0]["parts"][1]["series"][0]
    assert series["values"] == [1e-3, None, "Infinity"]
    assert series["low"] == [0, 1, "-Infinity"]
    assert data["sections"][0]["parts"][2]["series"][0]["values"] == [[0.1, 0.2], [None, 1.0]]


def test_the_schema_has_every_class() -> None:
    """Expected: JSON by the schema's own classes: those of the document, and the parts by their names."""
    known = schema()["$defs"]
    assert {"Chart", "Number", "Section", "Table", "Scene", "Surface", "Quantity"} <= set(known)
    assert known["Series"]["properties"]["leg"]["anyOf"][0] == {"maximum": 6, "minimum": 1, "type": "integer"}


def test_a_number_that_is_not_defined_is_none_and_arrays_are_read_only_copies() -> None:
    assert _Number("a", "a", math.nan).value is None
    assert Value(math.nan, LENGTH).text == "–"
    assert Table("", (Column("a", LENGTH),), ((math.nan,),)).rows == ((None,),)
    values = np.zeros(3)
    series = _Series("a", LENGTH, values)
    values[0] = 1
    assert series.values[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        series.values[0] = 2


_TWO = time_axis([0, 1])
REFUSED: dict[str, Any] = {
    "at least 1 item": lambda: _Chart("c", _TWO, ()),
    r"'a' of 'c' has \(3,\) values; expected \(2,\)": lambda: _Chart("c", _TWO, (_Series("a", LENGTH, [1, 2, 3]),)),
    "deg, mm; expected one unit": lambda: _Chart(
        "c", _TWO, (_Series("a", LENGTH, [1, 2]), _Series("b", ANGLE, [1, 2]))
    ),
    r"values; expected \(1,\)": lambda: _Chart("c", _TWO, (_Series("a", COUNT, [1, 2]),), "histogram"),
    r"expected \(2, 2\)": lambda: _heat([[1, 2]], [1, 2]),
    r"\(1, 2\) values; expected \(2, 1, 2\)": lambda: _heat([[1, 2]], [1], map=_Map(slices=_Axis("z", LENGTH, [1, 2]))),
    r"inside of the map 'c' has \(2, 1\) values": lambda: _heat([[1, 2]], [1], map=_Map(np.ones((2, 1)))),
    "the slice 2 is shown first; expected one of 2": lambda: _Map(slices=_Axis("z", LENGTH, [1, 2]), first=2),
    "a point of 1 coordinates; expected 2, or none": lambda: _Map(point=(1.0,)),
    r"vertices of the surface s has \(2, 2\) values": lambda: _surface(vertices=np.zeros((2, 2))),
    r"values of the surface s has \(3,\) values; expected \(2,\)": lambda: _surface(values=np.zeros(3)),
    "names a corner that is not there": lambda: _surface(triangles=np.array([[0.0, 1, 2]])),
    "at least 3 items": lambda: _surface(names=("x", "y")),
    "Input should be 'line', 'step'": lambda: _Chart("c", _TWO, (_Series("a", COUNT, [1, 2]),), "pie"),
    "Input should be 'reference'": lambda: _Series("a", LENGTH, [1.0], "best"),
    "less than or equal to 6": lambda: _Series("a", LENGTH, [1.0], leg=7),
    "1 values 'low' of a; expected 2": lambda: _Series("a", LENGTH, [1.0, 2.0], low=[1.0]),
    "list; expected an array of numbers": lambda: _Series("a", LENGTH, ["x"]),
    "an array of 4 dimensions; expected 1 or 2 or 3": lambda: _Series("a", LENGTH, np.zeros((1, 1, 1, 1))),
    "finite number": lambda: (Span(math.nan, 0, 1, "gain"), Mark(math.nan, "limit")),
    "row 1 of 't' has 2 cells; expected 1": lambda: Table("t", (Column("a"),), ((1, 2),)),
    "should match pattern": lambda: _Verdict("two\nlines", "good"),
    "Input should be 'good', 'marginal'": lambda: _Verdict("well", "fine"),
    "the SI unit 'parsec'; expected one of m, rad": lambda: Quantity("parsec", "pc"),
    "greater than 0": lambda: Quantity("m", "mm", 0.0),
    "the number a is there twice": lambda: Report("r", _Verdict("v", "told"), numbers=(_Number("a", "a", 1.0),) * 2),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_be_shown_is_refused(message: str) -> None:
    with pytest.raises(ValueError, match=message):
        REFUSED[message]()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.update(version=0), "version: 0; expected a report of version 1"),
        (lambda data: data.update(colour="red"), "report.colour: Unexpected"),
        (
            lambda data: data["numbers"][0].update(quantity="pace"),
            r"report.numbers.0.quantity: .*'pace'; expected one of .*length",
        ),
        (
            lambda data: data["sections"][0]["parts"][0].update(part="film"),
            r"parts.0: Input tag 'film'.*'table', 'chart'",
        ),
        (lambda data: data["sections"][0].update(parts=3), "parts: .*tuple"),
        (lambda data: data["verdict"].pop("status"), "report.verdict.status: Field required"),
    ],
)
def test_other_data_are_refused_by_the_place(change: Any, message: str) -> None:
    data = to_data(whole_report())
    change(data)
    with pytest.raises(ValueError, match=message):
        from_json(json.dumps(data))


def test_the_documentation_lists_every_field() -> None:
    """The classes themselves are the source; docs/report.md names each field of each, in order."""
    text = (Path(__file__).parents[3] / "docs/report.md").read_text(encoding="utf-8")
    classes = {kind.__name__: kind for kind in (*_classes(document), *_classes(chart), Scene, Surface, Flag)}
    for name, kind in classes.items():
        part = re.search(rf"^### {name}\n(.*?)(?=^##|\Z)", text, re.DOTALL | re.MULTILINE)
        assert part, name
        names = [field.name for field in fields(kind)]
        assert [word for word in dict.fromkeys(re.findall(r"`(\w+)`", part[1])) if word in names] == names, name


def _classes(module: Any) -> list[Any]:
    kinds = [kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, Data)]
    return [kind for kind in kinds if kind is not Data]
