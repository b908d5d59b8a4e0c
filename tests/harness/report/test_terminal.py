"""A report in a terminal: what comes first, what is left to the page, and tables as wide as there is room for."""

import json
import re
from functools import partial
from io import StringIO
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from rich.text import Text

from gough_stewart.harness.report.document import Cell, Column, Table, Value, from_json
from gough_stewart.harness.report.quantities import Quantity
from gough_stewart.harness.report.terminal import TerminalTable, show, text_of
from tests.support.commands import invoke
from tests.support.reports import report, table


def test_the_verdict_is_the_first_line_then_its_numbers_then_requirements_then_tables(tmp_path: Path) -> None:
    """Expected: of `check` with two requirements; details are for the page, warnings for the error stream."""
    settings = ("--set", "reference.frequency=1.2", "--set", "loop.sample_time=25 ms", "--out", str(tmp_path))
    wanted = ("--require", "limits.stroke <= 80 %", "--require", "limits.actuator_force_max < 5 %")
    done = invoke("check", "pitch_sine", *settings, *wanted)
    lines = [" ".join(line.split()) for line in done.stdout.splitlines()]
    assert done.exit_code == 3
    stroke, force = (re.search(rf"^{state} limits\.\S+ <=? \S+ % (\S+) %, (\S+) % {how}$", "\n".join(lines), re.M)
                     for state, how in (("met", "left"), ("missed", "beyond")))  # fmt: skip
    assert stroke is not None
    assert force is not None
    assert float(stroke[1]) + float(stroke[2]) == 80
    assert lines[0].startswith(f"Missed: limits.actuator_force_max < 5 % ({force[1]} %, {force[2]} % beyond). Can be")
    assert lines[1].startswith("sinusoidal pitch: platform motion_base, ")
    assert lines[2] == "set: reference.frequency = 1.2 (file: 0.5 Hz), loop.sample_time = 25 ms (file: 2 ms)"
    order = [lines.index(line) for line in ("Needs of the legs", "Shares of the limits") if line in lines]
    assert lines.index(stroke[0]) < lines.index(force[0]) < min(order, default=99)
    assert "Not checked, as the platform states no limit: leg acceleration." in lines
    assert "Each leg" not in lines


def test_units_stand_once_and_what_is_left_out_is_counted() -> None:
    """Expected: by hand; a unit stands beside the name of a row that shares it, or in the head."""
    legs = [["peak error", *({"value": 1e-4 * leg, "quantity": "length"} for leg in (1, 2))],
            ["peak force", *({"value": 101.5 * leg, "quantity": "force"} for leg in (1, 2))]]  # fmt: skip
    columns = [{"name": "cause"}, {"name": "peak", "quantity": "length"}]
    parts = (
        table("Legs", [{"name": ""}, {"name": "1"}, {"name": "2"}], legs, note="over the whole run"),
        table("Causes", columns, [["a", 1e-3], ["b", -2.5e-3], ["c", 3e-3]], first_shown=2),
        table(
            "Mixed",
            [*columns, {"name": "1"}, {"name": "2"}],
            [["a", 1e-3, *legs[1][1:]], ["b", 1e-3, *legs[0][1:2], legs[1][1]]],
        ),
        table("Versions", [{"name": ""}], [["python"]], detail=True),
        {"part": "note", "text": "A sentence."},
    )
    notes = [{"text": "of ten runs"}, {"text": "beyond its stroke", "kind": "warning"}]
    text = text_of(from_json(json.dumps(report(*parts, notes=notes))), 120)
    rows = [line for line in text.splitlines() if line.startswith(("│", "┃"))]
    assert [[cell.strip() for cell in re.split("[│┃]", row)[1:-1]] for row in rows] == [
        *(["", "1", "2"], ["peak error mm", "0.1", "0.2"], ["peak force N", "101.5", "203"]),
        *(["cause", "peak [mm]"], ["a", "1"], ["b", "-2.5"], ["cause", "peak [mm]", "1", "2"]),
        *(["a", "1", "101.5 N", "203 N"], ["b", "1", "0.1 mm", "101.5 N"]),
    ]
    assert all(each in text for each in ("over the whole run", "… 1 more on the page", "A sentence.", "of ten runs"))
    assert not any(each in text for each in ("Versions", "beyond its stroke"))


def test_without_a_terminal_the_verdict_is_one_line_without_colours() -> None:
    made = from_json(json.dumps(report(verdict={"text": "Missed: " + "word " * 20, "status": "bad"})))
    for force in (False, True):
        out = StringIO()
        show(made, Console(file=out, width=30, force_terminal=force, color_system="standard" if force else None))
        first = out.getvalue().splitlines()[0]
        assert first.startswith("\x1b[1;31mMissed: " if force else "Missed: ")
        assert (first == made.verdict.text) is not force
        assert ("\x1b[" in out.getvalue()) is force


def printed(made: Table, width: int) -> str:
    """As a terminal of this width shows it."""
    console = Console(width=width, color_system=None, legacy_windows=False)
    with console.capture() as capture:
        console.print(TerminalTable(made))
    return capture.get()


_words = st.text("abcdeé台_,", min_size=1, max_size=12)
_names = st.lists(_words, min_size=1, max_size=6).map(" ".join)
_numbers = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(lambda value: f"{value:.4g}"),
    st.sampled_from(["", "–", "< 0.001", "-1.234e-05", "× 0.265 to 3.77"]),
)


@st.composite
def _tables(draw: st.DrawFn) -> Table:
    columns = draw(st.integers(0, 9))
    heads = ("", *draw(st.lists(_words, min_size=columns, max_size=columns)))
    rows: list[tuple[Cell, ...]] = []
    for _ in range(draw(st.integers(1, 5))):
        unit = Quantity("", draw(st.sampled_from(["", "mm", "%"])))
        cells = st.one_of(_numbers, st.floats(1e-2, 1e9).map(partial(Value, quantity=unit)))
        rows.append((draw(_names), *draw(st.lists(cells, min_size=columns, max_size=columns))))
    ends = tuple(draw(st.sets(st.integers(0, len(rows) - 1))))
    return Table("T", tuple(map(Column, heads)), tuple(rows), group_ends=ends)


def joined(pieces: list[str]) -> str:
    return "".join("".join(pieces).split())


@settings(max_examples=60, deadline=None)
@given(_tables(), st.integers(40, 120))
def test_no_width_cuts_or_breaks_a_number(made: Table, width: int) -> None:
    """Expected: every cell, read back from between the lines that were printed; every part begins with the names."""
    text = printed(made, width)
    assert max((Text(line).cell_len for line in text.splitlines()), default=0) <= width, text
    names, *others = (
        [head, *(row[k] for row in made.shown)] for k, head in enumerate(column.title for column in made.columns)
    )
    parts: list[list[list[str]]] = []  # of each table below the other, by column, what stands in its lines
    for line in text.splitlines():
        if line.startswith("┏"):
            parts.append([[] for _ in line.split("┳")])
        elif line[:1] in ("┃", "│"):
            pieces = line[1:-1].split(line[0])
            assert len(pieces) == len(parts[-1]), line
            for column, piece in zip(parts[-1], pieces, strict=True):
                column.extend([piece.strip()] if piece.strip() else [])
    assert all(joined(part[0]) == joined(names) for part in parts), text
    for found, cells in zip([column for part in parts for column in part[1:]], others, strict=True):
        assert joined(found) == joined(cells), text
        if all(len(cell) <= 16 for cell in cells[1:]):
            numbers = [cell for cell in cells[1:] if cell]
            assert numbers == found[len(found) - len(numbers) :], text


# one column less than in all: the head "leg 1" folds; the sentence takes what is left
FOLDED = """\
Legs [of] <a> machine
┏━━━━━━━━━━━━━━━━━━━━┳━━━━━━┳━━━━━━━┳━━━━━━━━━━━━━━━━━━━━━━━━━━━━┳━━━━┓
┃                    ┃  leg ┃       ┃                            ┃    ┃
┃                    ┃    1 ┃ leg 2 ┃ note                       ┃    ┃
┡━━━━━━━━━━━━━━━━━━━━╇━━━━━━╇━━━━━━━╇━━━━━━━━━━━━━━━━━━━━━━━━━━━━╇━━━━┩
│ peak <force> N & m │ 12.5 │    -7 │ of the longest leg in the  │ 7  │
│                    │      │       │ second half of the run     │    │
│ flags              │    – │     3 │                            │ x  │
├────────────────────┼──────┼───────┼────────────────────────────┼────┤
│                    │    1 │ 22222 │ <b>x                       │ 11 │
└────────────────────┴──────┴───────┴────────────────────────────┴────┘
"""


def test_a_table_in_a_narrow_terminal_letter_by_letter() -> None:
    """Expected: written by hand by the rules: numbers at the right, all else at the left, names and sentences fold."""
    # A column without a head has nothing to compare; a group ends with a line. Names of 20 letters, numbers of 5, 6, 7,
    # 8 and 4 need 20 + 30 + 6 · 3 + 1 = 69; names fold to 18; then the columns are divided, the last take more.
    unit, long = Quantity("", "N & m"), "of the longest leg in the second half of the run"
    rows: tuple[tuple[Cell, ...], ...] = (
        ("peak <force>", Value(12.5, unit), Value(-7, unit), long, Value(7, unit)),
        ("flags", None, 3, "", "x"),
        ("", 1, 22222, "<b>x", 11),
    )
    heads = ("", "leg 1", "leg 2", "note", "")
    made = Table("Legs [of] <a> machine", tuple(map(Column, heads)), rows, group_ends=(1,))
    assert "".join(f"{line.rstrip()}\n" for line in printed(made, 71).splitlines()) == FOLDED
    names = ("", "h5", "h6", "h7", "h8", "h4")
    cells = ("twenty letters long.", *("9" * k for k in (5, 6, 7, 8, 4)))
    numbers = Table("T", tuple(map(Column, names)), (cells,))
    columns = {width: [line.count("┳") for line in printed(numbers, width).splitlines() if line.startswith("┏")]
               for width in (69, 67, 66, 50, 49, 33, 30)}  # fmt: skip
    assert columns == {69: [5], 67: [5], 66: [2, 3], 50: [2, 3], 49: [1, 2, 2], 33: [1] * 5, 30: [1] * 5}
