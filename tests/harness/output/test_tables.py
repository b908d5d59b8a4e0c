"""Tables in terminals of any width."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough_stewart.harness.output.tables import Named, Sheet, quantity_text
from tests.support.whole_tables import check_is_whole, printed


def legs(number: str) -> Sheet:
    sheet = Sheet("Legs", ("", *"123456", "all"))
    sheet.add(Named("actuator force, of its limit", "%"), *[number] * 7)
    return sheet


def test_names_fold_before_columns_move() -> None:
    """Expected: one table with all seven numbers, which unfolded would be 90 wide."""
    text = printed(legs("12.34"), 80)
    assert text.count("12.34") == 7
    assert text.count("┏") == 1
    assert max(map(len, text.splitlines())) <= 80


def test_numbers_that_fill_the_line_go_on_in_a_table_below() -> None:
    """Expected: legs 1 to 3, and below them legs 4 to 6 with all; every head once, the name in both."""
    lines = printed(legs("0.007151"), 80).splitlines()
    heads = ["".join(line.replace("┃", " ").split()) for line in lines if line.startswith("┃")]
    assert heads == ["123", "456all"]
    assert sum("actuator force" in line for line in lines) == 2
    assert "".join(lines).count("0.007151") == 7


_words = st.text("abcdeé台_,", min_size=1, max_size=12)
_names = st.lists(_words, min_size=1, max_size=6).map(" ".join)
_numbers = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(lambda value: f"{value:.4g}"),
    st.sampled_from(["", "–", "< 0.001", "-1.234e-05", "× 0.265 to 3.77"]),
)


@st.composite
def _sheets(draw: st.DrawFn) -> Sheet:
    columns = draw(st.integers(0, 9))
    sheet = Sheet("T", ("", *draw(st.lists(_words, min_size=columns, max_size=columns))))
    for _ in range(draw(st.integers(1, 5))):
        name = draw(st.one_of(_names, st.builds(Named, _names, st.sampled_from(["mm", "%"]))))
        sheet.add(name, *draw(st.lists(_numbers, min_size=columns, max_size=columns)), ends_group=draw(st.booleans()))
    return sheet


@settings(max_examples=60, deadline=None)
@given(_sheets(), st.integers(40, 120))
def test_no_width_cuts_or_breaks_a_number(sheet: Sheet, width: int) -> None:
    """Expected: every cell of the sheet, read back from between the lines that were printed."""
    check_is_whole(sheet, width)


def test_sentences_fold_and_stand_at_the_left() -> None:
    sheet = Sheet("", ("outcome", "members", "cause"))
    sheet.add("diverged", "3", "the platform is 0.31 m from its reference; the bound is 0.05 m, at most by far")
    check_is_whole(sheet, 60)
    assert "│ the platform" in printed(sheet, 60)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1.9e-11, "mm", "< 0.001"),
        (-1.9e-11, "mrad", "< 0.001"),
        (0.0, "mm", "0"),
        (None, "mm", "–"),
        (0.00123456, "mm", "0.001235"),
        (1e-5, "a unit that is not listed", "1e-05"),
    ],
)
def test_what_is_too_small_to_be_looked_at_is_only_less(value: float | None, unit: str, text: str) -> None:
    """Expected: a thousandth of a millimetre or milliradian as the least."""
    assert quantity_text(value, unit) == text
