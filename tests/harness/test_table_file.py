"""Tables as instruments and spreadsheets write them: each variant has the numbers that were written to it."""

import codecs
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.motions import COLUMNS, motion_of
from tests.support.uneven import UNEVEN

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
    lines = [separator.join(COLUMNS), *head]
    for k, row in enumerate(values):
        lines.append(separator.join(repr(float(v)).replace(".", mark) for v in row))
        lines += between if k % 7 == 3 else ()
    return "\n".join(lines) + "\n"


def with_columns(separator: str, *extra: str) -> str:
    """The values with further columns: a name, then cells that repeat."""
    head, *lines = text(separator).splitlines()
    named = [separator.join([head, *(name for name, *_ in map(str.split, extra))])]
    cells = [column.split()[1:] for column in extra]
    rows = (separator.join([line, *(c[k % len(c)] for c in cells)]) for k, line in enumerate(lines))
    return "\n".join([*named, *rows]) + "\n"


SPACED = text(";").replace(";", " ;\t ")
WRITTEN = {
    "semicolons": text(";").encode(),
    "semicolons and decimal commas": text(";", ",").encode(),
    "tabulators": text("\t").encode(),
    "tabulators and decimal commas": text("\t", ",").encode(),
    "blanks around names and values": SPACED.encode(),
    "quotes": text().replace("time", '"time"').replace("position[2]", '"position[2]"').encode(),
    "a row of units": text(head=[",".join(UNITS)], scale=True).encode(),
    "a row of units in brackets": text(";", ",", [";".join(f"[{unit}]" for unit in UNITS)], scale=True).encode(),
    "a row of units with gaps": text(";", head=["s;;-;m;;rad;-"]).encode(),
    "blank rows": ("\n\n" + text(between=["", "  ", ",,,,,,"])).encode(),
    "comments": ("# from the rig\n# of a Monday; 1,5\n" + text(between=["# pause", "  # again, 1"])).encode(),
    "the code page 1252": ("# größer als 5 µm\n" + text(";", ",")).encode("cp1252"),
    "UTF-16": codecs.BOM_UTF16_LE + text(";", ",").encode("utf-16-le"),
    "UTF-16 with its bytes exchanged": codecs.BOM_UTF16_BE + text().encode("utf-16-be"),
    "a mark and other ends of lines": codecs.BOM_UTF8 + text(";", ",").replace("\n", "\r\n").encode(),
    "columns of words, and a comma that is no mark": with_columns(";", "note a,5 v.2 1,2,3", "state true x").encode(),
}


def read(path: Path) -> Any:
    return motion_of(UNEVEN, path.parent, type="file", file=path.name, unusual_speed=True)


@pytest.mark.parametrize("way", WRITTEN)
def test_a_table_is_read_as_what_it_is(way: str, tmp_path: Path) -> None:
    """Expected: the numbers that were written, as a reference motion."""
    (tmp_path / "ride.csv").write_bytes(WRITTEN[way])
    motion = read(tmp_path / "ride.csv")
    np.testing.assert_allclose(motion.time, VALUES[:, 0] - VALUES[0, 0], atol=1e-9)
    np.testing.assert_allclose(motion.position, VALUES[:, 1:4], rtol=1e-12)
    np.testing.assert_allclose(motion.orientation, VALUES[:, 4:], rtol=1e-12)


CELLS = text(";").splitlines()


def changed(row: int, old: str, new: str) -> str:
    lines = list(CELLS)
    assert old in lines[row]
    lines[row] = lines[row].replace(old, new)
    return "\n".join(lines)


FIRST = repr(float(VALUES[0, 1]))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (changed(1, FIRST, FIRST.replace(".", ",")),
         r"the column position\[1\] has .*; expected one decimal mark, and no marks of thousands"),
        (changed(1, FIRST, "1.234,5"),
         r"position\[1\] in row 1 is '1\.234,5'; expected a finite number, with a point, not"),
        (changed(1, FIRST, "x"), r"position\[1\] in row 1 is 'x'; expected a finite number"),
        (changed(2, "7.35;", "7.35;nan;"), "is not CSV: "),
        (changed(0, "time", "time [ms]").replace("\n", "\ns;m;m;m;rad;rad;rad\n", 1),
         r"has the unit s in the second row"),
        (changed(0, "position[2]", " position[1]"), r"has the column position\[1\] twice; expected every column once"),
        (changed(0, "time;", "time;stone;").replace("\n", "\nell;s;m;m;m;rad;rad;rad\n", 1), "time in row 1 is 'ell'"),
        (" ,;\n# nothing\n", "has no rows; expected a header and rows of numbers"),
        (b"a,\xe4\n\x8f\n", "is not text: byte 4 is 0x8f; expected CSV, best in UTF-8, or Parquet"),
        (b"PAR1 and nothing else", "is not Parquet: "),
    ],
)  # fmt: skip
def test_what_could_mean_two_things_is_refused_with_the_remedy(content: Any, reason: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(gs.GoughStewartError, match=rf"a\.csv: .*{reason}"):
        read(tmp_path / "a.csv")
