"""Tables in terminals of any width, in notebooks and on pages."""

from dataclasses import replace
from functools import partial
from typing import Any
from urllib.parse import unquote, urljoin, urlsplit

from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import html

from gough_stewart.harness.report.document import Report, Section, Verdict
from gough_stewart.harness.report.page import page_of, to_html
from gough_stewart.harness.report.quantities import Quantity
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.report.terminal import stacked_columns, tables_text
from tests.support.whole_tables import check_is_whole, printed


def table(title: str, heads: tuple[str, ...], *rows: tuple[Cell, ...], ends: tuple[int, ...] = ()) -> Table:
    return Table(title, tuple(map(Column, heads)), rows, group_ends=ends)


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
    return table("T", heads, *rows, ends=ends)


@settings(max_examples=60, deadline=None)
@given(_tables(), st.integers(40, 120))
def test_no_width_cuts_or_breaks_a_number(made: Table, width: int) -> None:
    """Expected: every cell of the table, read back from between the lines that were printed."""
    check_is_whole(made, width)


def uneven() -> Table:
    """Two columns of numbers, one of sentences, a group that ends, an empty head, and texts like markup."""
    unit, long = Quantity("", "N & m"), "of the longest leg in the second half of the run"
    return table(
        "Legs [of] <a> machine",
        ("", "leg 1", "leg 2", "note", ""),
        ("peak <force>", Value(12.5, unit), Value(-7, unit), long, Value(7, unit)),
        ("flags", None, 3, "", "x"),
        ("", 1, 22222, "<b>x", 11),
        ends=(1,),
    )


WIDE = """\
Legs [of] <a> machine
┏━━━━━━━━━━━━━━━━━━━━┳━━━━━━━┳━━━━━━━┳━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━┳━━━━┓
┃                    ┃ leg 1 ┃ leg 2 ┃ note                                             ┃    ┃
┡━━━━━━━━━━━━━━━━━━━━╇━━━━━━━╇━━━━━━━╇━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━╇━━━━┩
│ peak <force> N & m │  12.5 │    -7 │ of the longest leg in the second half of the run │ 7  │
│ flags              │     – │     3 │                                                  │ x  │
├────────────────────┼───────┼───────┼──────────────────────────────────────────────────┼────┤
│                    │     1 │ 22222 │ <b>x                                             │ 11 │
└────────────────────┴───────┴───────┴──────────────────────────────────────────────────┴────┘
"""
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


def test_a_table_in_wide_and_in_narrower_terminals_letter_by_letter() -> None:
    """Expected: written by hand by the rules: numbers at the right, all else at the left, names and sentences fold.

    A column without a head has no numbers to compare; a group ends with a line; sixteen rows more hide nothing.
    """
    made = uneven()
    assert "".join(f"{line.rstrip()}\n" for line in printed(made, 110).splitlines()) == WIDE
    assert "".join(f"{line.rstrip()}\n" for line in printed(made, 71).splitlines()) == FOLDED
    # as text, it is at most 100 wide
    assert tables_text([made, made]) == WIDE + WIDE.rstrip("\n")
    assert printed(replace(made, title=""), 110).splitlines()[0].startswith("┏")


def test_a_table_of_a_page_tag_by_tag() -> None:
    """Expected: written by hand; heads of columns and rows have their scope, empty ones are no heads."""
    page = to_html(Report("t", Verdict("v <w>", "told"), (Section("s", (uneven(),)),)))
    assert page == (
        "<div><p><strong>v &lt;w&gt;</strong></p><table><caption>Legs [of] &lt;a&gt; machine</caption>"
        '<thead><tr><td></td><th scope="col">leg 1</th><th scope="col">leg 2</th><th scope="col">note</th><td></td>'
        '</tr></thead><tbody><tr><th scope="row">peak &lt;force&gt; <span class="unit">N &amp; m</span></th>'
        "<td>12.5</td><td>-7</td><td>of the longest leg in the second half of the run</td><td>7</td></tr>"
        '<tr class="group-end"><th scope="row">flags</th><td>–</td><td>3</td><td></td><td>x</td></tr>'
        "<tr><td></td><td>1</td><td>22222</td><td>&lt;b&gt;x</td><td>11</td></tr></tbody></table></div>"
    )


def test_widths_of_columns_and_shares_of_tables() -> None:
    """Expected, by hand: names of 20 letters, numbers of 5, 6, 7, 8 and 4, each framed by three more, and one line.

    All need 20 + 30 + 6 · 3 + 1 = 69; names fold to 18 = their least; then the tables divide, the last take more.
    """
    columns = [["", "twenty letters long."], *([f"h{k}", "9" * k] for k in (5, 6, 7, 8, 4))]
    whole = [[(0, 20), (1, 5), (2, 6), (3, 7), (4, 8), (5, 4)]]
    single = [[(1, 5)], [(2, 6)], [(3, 7)], [(4, 8)], [(5, 4)]]
    for width, expected in {
        200: whole, 69: whole, 68: [[(0, 19), *whole[0][1:]]], 67: [[(0, 18), *whole[0][1:]]],
        # 18 + 3 + 5 + 3 + 6 + 3 + 1 = 39 and 18 + 3 + 7 + 3 + 8 + 3 + 4 + 3 + 1 = 50
        66: [[(0, 20), (1, 5), (2, 6)], [(0, 20), (3, 7), (4, 8), (5, 4)]],
        50: [[(0, 18), (1, 5), (2, 6)], [(0, 18), (3, 7), (4, 8), (5, 4)]],
        49: [[(0, 20), (1, 5)], [(0, 20), (2, 6), (3, 7)], [(0, 20), (4, 8), (5, 4)]],
        # not even one beside the names of least width: 33 are 18 + 3 + 8 + 3 + 1; names give way
        **{width: [[(0, names), *each] for each in single] for width, names in ((33, 18), (30, 15), (3, 1))},
    }.items():  # fmt: skip
        assert stacked_columns(columns, width) == expected, width
    assert stacked_columns(columns[:1], 12) == [[(0, 8)]]
    # room goes first to what lacks most: sentences of 30 and 40 letters from 18 each
    short, long = ("word " * 6).strip() + "x", ("word " * 8).strip() + "x"
    for width, (one, other) in {100: (30, 40), 56: (18, 27), 61: (20, 30)}.items():
        assert stacked_columns([["", "n"], ["a", short], ["b", long]], width) == [[(0, 1), (1, one), (2, other)]]
    # a word of 26 letters stays whole, and of one of 27 letters only 26 do
    for letters, least in ((26, 26), (27, 26), (19, 19), (5, 18)):
        words = [["", "n"], ["a", "b" * letters + " and more words than fit in any line of this width"]]
        assert stacked_columns(words, 1 + 3 + 1 + 3 + least) == [[(0, 1), (1, least)]], letters


def on_page(made: Table) -> Any:
    """The element of a page's only table."""
    page = page_of(Report("r", Verdict("v", "told"), (Section("s", (made,)),)))
    elements: Any = html.document_fromstring(page).xpath("//main//table")
    (element,) = elements
    return element


def test_links_lead_to_files_whatever_their_names_and_not_out_of_the_folder() -> None:
    """Expected: a browser's address, decoded, is the name; a path out of the folder is a text."""
    names = ("a#b.html", "50 %/c?d.html", 'e"f.html', "javascript:alert(1)", "../g.html", "/etc/h", "i/../../j")
    made = on_page(Table("", (Column("name"), Column("n")), tuple((name, 1.0) for name in names), links=names))
    assert [cell.text_content() for cell in made.xpath(".//tbody//th")] == list(names)
    addresses = [urlsplit(urljoin("file:///runs/report.html", link)) for link in made.xpath(".//a/@href")]
    assert [unquote(each.path) for each in addresses] == [f"/runs/{name}" for name in names[:4]]
    assert not any(each.query or each.fragment or each.scheme != "file" for each in addresses)


def test_numbers_are_at_the_right_with_a_minus_and_words_are_not() -> None:
    """Expected: by hand; the first column names its row, and a hyphen within words stays one."""
    columns = (Column("what"), Column("error", Quantity("m", "m")), Column("cause"), Column("share"))
    made = on_page(Table("errors", columns, (("leg-1", -0.25, "a-b", "-3 %"), ("leg-2", None, "stopped", "+4 %"))))
    assert [head.get("class") for head in made.xpath(".//thead//th")] == [None, "n", None, "n"]
    rows = made.xpath(".//tbody/tr")
    assert [[cell.get("class") for cell in row.xpath("./td")] for row in rows] == [["n", None, "n"]] * 2
    assert [cell.text_content() for cell in rows[0]] == ["leg-1", "−0.25", "a-b", "−3 %"]
