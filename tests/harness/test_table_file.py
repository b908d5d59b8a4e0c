"""Tables as instruments and spreadsheets write them: each variant has the numbers that were written to it."""

import codecs
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gough_stewart as gs
from gough_stewart.harness.errors import TableError
from gough_stewart.harness.motion.recorded.recording import read_recording
from gough_stewart.harness.table_file import Heading, numbers_of, read_table, times_of
from gough_stewart.model.units import UNITS as FACTORS_OF_UNITS

NS = 1_700_000_000_123_456_789
NAMES = ("time", "position[1]", "position[2]", "position[3]", "orientation[1]", "orientation[2]", "orientation[3]")
UNITS = ("ms", "mm", "cm", "m", "deg", "mrad", "rad")
FACTORS = np.array([1e-3, 1e-3, 1e-2, 1.0, np.pi / 180, 1e-3, 1.0])
# From 7.3 s on; six different columns.
TIME = 7.3 + 0.05 * np.arange(30)
VALUES = np.column_stack(
    [TIME, *(0.02 * (k + 1) * np.sin((1.1 + 0.3 * k) * TIME + k) + 0.3 * k for k in range(5)), 0.07 * np.cos(TIME)]
)


def text(
    separator: str = ",", mark: str = ".", head: Sequence[str] = (), between: Sequence[str] = (), scale: bool = False
) -> str:
    """The values as CSV; `head` comes after the names, `between` after every seventh row."""
    values = VALUES / FACTORS if scale else VALUES
    lines = [separator.join(NAMES), *head]
    for k, row in enumerate(values):
        lines.append(separator.join(repr(float(v)).replace(".", mark) for v in row))
        lines += between if k % 7 == 3 else ()
    return "\n".join(lines) + "\n"


WRITTEN = {
    "semicolons": text(";").encode(),
    "semicolons and decimal commas": text(";", ",").encode(),
    "tabulators": text("\t").encode(),
    "tabulators and decimal commas": text("\t", ",").encode(),
    "a row of units": text(head=[",".join(UNITS)], scale=True).encode(),
    "a row of units in brackets": text(";", ",", [";".join(f"[{unit}]" for unit in UNITS)], scale=True).encode(),
    "blank rows": ("\n\n" + text(between=["", "  ", ",,,,,,"])).encode(),
    "comments": ("# from the rig\n# of a Monday; 1,5\n" + text(between=["# pause", "  # again, 1"])).encode(),
    "the code page 1252": ("# größer als 5 µm\n" + text(";", ",")).encode("cp1252"),
    "UTF-16": codecs.BOM_UTF16_LE + text(";", ",").encode("utf-16-le"),
    "UTF-16 with its bytes exchanged": codecs.BOM_UTF16_BE + text().encode("utf-16-be"),
    "a mark and other ends of lines": codecs.BOM_UTF8 + text(";", ",").replace("\n", "\r\n").encode(),
}


@pytest.mark.parametrize("way", WRITTEN)
def test_a_table_is_read_as_what_it_is(way: str, tmp_path: Path) -> None:
    """Expected: the numbers that were written, as a reference motion."""
    (tmp_path / "ride.csv").write_bytes(WRITTEN[way])
    motion = read_recording(tmp_path / "ride.csv").table
    np.testing.assert_allclose(motion.time, VALUES[:, 0] - VALUES[0, 0], atol=1e-9)
    np.testing.assert_allclose(motion.position, VALUES[:, 1:4], rtol=1e-12)
    np.testing.assert_allclose(motion.orientation, VALUES[:, 4:], rtol=1e-12)


def test_a_log_of_a_machine_is_read_in_the_same_way(tmp_path: Path) -> None:
    """Expected: the numbers that were written; leg 4 and the last column included."""
    names = ["time", *(f"leg_length[{k}]" for k in range(1, 7)), *(f"actuator_force[{k}]" for k in range(1, 7))]
    units = ["ms", *["mm"] * 6, *["kN"] * 6]
    time = np.arange(50) * 1e-3
    values = np.column_stack(
        [
            time,
            *(3.0 + 0.01 * k + 0.02 * np.sin(9 * time + k) for k in range(6)),
            *(900.0 + 70 * k + time for k in range(6)),
        ]
    )
    scaled = values / np.array([1e-3, *[1e-3] * 6, *[1e3] * 6])
    rows = [";".join(repr(float(v)).replace(".", ",") for v in row) for row in scaled]
    (tmp_path / "log.csv").write_text("\n".join(["# rig 3", ";".join(names), ";".join(units), *rows]))
    log = gs.read_log(tmp_path / "log.csv")
    assert log.actuator_force is not None
    assert log.time is not None
    np.testing.assert_allclose(log.leg_length, values[:, 1:7], rtol=1e-12)
    np.testing.assert_allclose(log.actuator_force, values[:, 7:], rtol=1e-12)
    np.testing.assert_allclose(log.time - log.time[0], time, atol=1e-12)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"b;a\n1;2.5\n1;3,5\n", "the column a has 3,5 and 2.5; expected one decimal mark, and no marks of thousands"),
        (b"a;b\n1.234,5;2\n", "a in row 1 is '1.234,5'; expected a finite number, with a point, not a comma"),
        (b"a,b\n1,2,3\n", "is not CSV: "),
        (b" ,;\n# nothing\n", "has no rows; expected a header and rows of numbers"),
        (b"a,\xe4\n\x8f\n", "is not text: byte 4 is 0x8f; expected CSV, best in UTF-8, or Parquet"),
        (b"b;a (s)\nm;m\n1;2\n", "the column a (s) has the unit m in the second row; expected one of the two"),
        (b"a; a \n1;2\n", "has the column a twice; expected every column once"),
        (b"b,a,a\n1,2,3\n", "has the column a twice; expected every column once"),
        (b"a,b\nstone,ell\n1,2\n", "a in row 1 is 'stone'; expected a finite number"),
        (b"PAR1 and nothing else", "is not Parquet: "),
    ],
)
def test_what_could_mean_two_things_is_refused_with_the_remedy(content: bytes, reason: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(TableError) as caught:
        numbers_of(read_table(tmp_path / "a.csv", "log"), "a")
    assert str(caught.value).startswith(reason)
    for path, missing in ((tmp_path / "none", "No such file or directory"), (tmp_path, "Is a directory")):
        with pytest.raises(gs.GoughStewartError, match=rf"^cannot read this log: {missing}$"):
            read_table(path, "log")


COLUMNS: dict[str, tuple[str, dict[str, list[str | None]]]] = {
    "blanks around names and values": (" time; force \n 1;\t2 \n", {"time": ["1"], "force": ["2"]}),
    "semicolons before tabulators before commas": ("a,b;\tc\n1;\t2\n", {"a,b": ["1"], "c": ["2"]}),
    "tabulators before commas": ("a,b\tc\n1\t2\n", {"a,b": ["1"], "c": ["2"]}),
    "separators in the rows are none": ("a,b\n1;2,3\n", {"a": ["1;2"], "b": ["3"]}),
    "quotes": ('a;"b c"\n1;"x; y"\n', {"a": ["1"], "b c": ["x; y"]}),
    "a row of units with gaps": (
        "t;state;b;c\nms;-;mm;\n1;2;3;4",
        {"t [ms]": ["1"], "state": ["2"], "b [mm]": ["3"], "c": ["4"]},
    ),
    "the same unit twice": ("a [m];b\nm;m\n1;2\n", {"a [m]": ["1"], "b [m]": ["2"]}),
    "no units": ("a;b\n-;-\n1;2", {"a": ["1"], "b": ["2"]}),
    "units in both rows": (
        "a [mm];b (mm);c [ deg ];R[1,3];p[1];r (s)\nmm;mm;deg;m;-;\n1;2;3;4;5;6",
        {"a [mm]": ["1"], "b (mm)": ["2"], "c [ deg ]": ["3"], "R[1,3] [m]": ["4"], "p[1]": ["5"], "r (s)": ["6"]},
    ),
    "brackets and quotes around units": (
        'a,b,c\n[mm],(s),"kN"\n1,2,3',
        {"a [mm]": ["1"], "b [s]": ["2"], "c [kN]": ["3"]},
    ),
    "empty brackets are no units": ("a;b\n[];[]\n1;2", {"a": ["[]", "1"], "b": ["[]", "2"]}),
    "one of two units is unknown": ("a,b\nmm,ell\n1,2", {"a": ["mm", "1"], "b": ["ell", "2"]}),
    "a short second row is no row of units": ("a,b\nms\n1,2", {"a": ["ms", "1"], "b": [None, "2"]}),
    "only a header": ("a;b\n", {"a": [], "b": []}),
    "a point in words beside decimal commas": (
        "a;note\n1,5;v.2\nv.2;1,5\n",
        {"a": ["1.5", "v.2"], "note": ["v.2", "1.5"]},
    ),
    "decimal commas in one of two columns": ("a;b\n1,5;1.5\n-,5e-3;2\n", {"a": ["1.5", "-.5e-3"], "b": ["1.5", "2"]}),
    "whole numbers and what is missing": ("a;b\n1;nan\n;-INF\n", {"a": ["1", None], "b": ["nan", "-INF"]}),
    "commas that are no marks": ("a;b\n1,2,3;4\nx,5;6\n", {"a": ["1,2,3", "x,5"], "b": ["4", "6"]}),
}


@pytest.mark.parametrize("rule", COLUMNS)
def test_each_rule_of_reading_text_has_its_columns(rule: str, tmp_path: Path) -> None:
    """Expected: names and strings by hand, from the rules in the docstring."""
    text, expected = COLUMNS[rule]
    (tmp_path / "a.csv").write_text(text)
    assert read_table(tmp_path / "a.csv", "log").to_dict(as_series=False) == expected


@given(
    st.lists(st.floats(-1e9, 1e9, allow_nan=False), min_size=1, max_size=8),
    st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", ","), ("\t", ".")]),
    st.sampled_from(["utf-8", "utf-8-sig", "cp1252", "utf-16"]),
)
def test_numbers_survive_every_way_of_writing_them(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[float], marks: tuple[str, str], encoding: str
) -> None:
    """Expected: the same floats, Python writes the fewest digits that give them; and the same letters."""
    separator, mark = marks
    rows = [separator.join([repr(x).replace(".", mark), repr(2 * x).replace(".", mark)]) for x in numbers]
    content = "\n".join([separator.join(["größe µ°", "b [mm]"]), *rows]).encode(encoding)
    path = tmp_path_factory.getbasetemp() / "numbers.csv"
    path.write_bytes(content)
    table = read_table(path, "log")
    assert numbers_of(table, "größe µ°").tolist() == numbers
    assert numbers_of(table, "b [mm]").tolist() == [2 * x for x in numbers]


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (
            ["1", "x", "3", "y", ""],
            "a in row 2 is 'x', and 2 more in this column; expected a finite number, see the log",
        ),
        (["1", "2", "z"], "a in row 3 is 'z'; expected a finite number, see the log"),
        (["1,5", "2"], "a in row 1 is '1,5'; expected a finite number, with a point, not a comma"),
        ([1.0, float("nan")], "a in row 2 is nan; expected a finite number, see the log"),
        ([float("inf"), 1.0], "a in row 1 is inf; expected a finite number, see the log"),
        ([1, None], "a in row 2 is None; expected a finite number, see the log"),
        ([True, False], "a has values of the type Boolean; expected numbers"),
    ],
)
def test_what_is_no_number_is_named_with_its_row(values: list[object], says: str) -> None:
    """Expected: the whole message; rows count from 1."""
    table = polars.DataFrame({"b": range(len(values)), "a": values}, strict=False)
    with pytest.raises(TableError) as caught:
        numbers_of(table, "a", ", see the log")
    assert str(caught.value) == says
    assert numbers_of(table, "b").tolist() == list(range(len(values)))


def test_times_since_the_first_keep_their_digits() -> None:
    """Expected: nanoseconds since 1970, subtracted as whole numbers; others as numbers, from 7.3 s."""
    steps = [0, 1, 3, 1_000_000_007]
    for values in ([NS + step for step in steps], [str(NS + step) for step in steps]):
        first, since = times_of(polars.DataFrame({"b": [5] * 4, "t": values}), "t")
        assert since.tolist() == steps
        assert first == pytest.approx(NS, rel=1e-15)
    for kind in ([7.3, 7.8, 9.05], ["7.3", "7.8", "9.05"]):
        first, since = times_of(polars.DataFrame({"t": kind}), "t")
        assert first == 7.3
        assert since.tolist() == pytest.approx([0, 0.5, 1.75])
    # floats that happen to be whole
    first, since = times_of(polars.DataFrame({"t": [7.0, 8.0]}), "t")
    assert (first, since.tolist()) == (7.0, [0, 1])
    first, since = times_of(polars.DataFrame({"t": polars.Series([], dtype=polars.Int64)}), "t")
    assert (first, since.tolist()) == (0.0, [])


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("x", "x", None),
        (" x ", "x", None),
        ("x [mm]", "x", "mm"),
        ("x[mm]", "x", "mm"),
        ("x (mm)", "x", "mm"),
        ("leg_length[4] [mm]", "leg_length[4]", "mm"),
        ("leg_length[4]", "leg_length[4]", None),
        ("base_points[4,3]", "base_points[4,3]", None),
        ("base_points[4,3] ( m )", "base_points[4,3]", "m"),
        ("qx [1]", "qx", "1"),
        ("a b (N m)", "a b", "N m"),
        ("x []", "x", ""),
        ("[mm]", "", "mm"),
    ],
)
def test_a_heading_is_a_name_and_a_unit_and_an_index_is_none(text: str, name: str, unit: str | None) -> None:
    """Expected: parts by hand; a millimetre is a thousandth of a metre; what is no length is refused."""
    assert Heading.of(text) == (text, name, unit)
    assert Heading.of("x [mm]").factor(FACTORS_OF_UNITS["m"]) == 1e-3
    assert Heading.of("time (min)").factor(FACTORS_OF_UNITS["s"]) == 60
    assert Heading.of("x[2]").factor(FACTORS_OF_UNITS["m"]) == 1
    with pytest.raises(ValueError, match=r"^x \[s\] has the unit 's'; expected one of m, cm, mm, um, µm, nm$"):
        Heading.of("x [s]").factor(FACTORS_OF_UNITS["m"])


def test_records_go_through_folders_whose_names_are_not_utf8(tmp_path: Path) -> None:
    """Expected: the same table; file systems allow any bytes."""
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/m\xfcll"))
    record = gs.run("heave_step", {"loop.duration": 0.01, "reference.at": 0.005})
    gs.save_record(record, folder)
    assert gs.read_record(folder).table.equals(record.table)
    assert gs.read_record(folder / "record.parquet").table.equals(record.table)
    lines = (folder / "record.csv").read_text().splitlines()
    assert len(lines) == record.table.height + 1
