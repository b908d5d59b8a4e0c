"""Tables in a terminal of 80 columns."""

import pytest
from rich.console import Console

from gough_stewart.harness.output.tables import Named, Sheet, to_terminal


def shown(number: str) -> str:
    sheet = Sheet("Legs", ("", *"123456", "all"))
    sheet.add(Named("actuator force, of its limit", "%"), *[number] * 7)
    console = Console(width=80)
    with console.capture() as capture:
        console.print(to_terminal(sheet))
    return capture.get()


def test_names_are_broken_before_numbers_are_cut_off() -> None:
    """Expected: all seven numbers, in a table that would be 90 wide, and every word of the name."""
    text = shown("12.34")
    assert text.count("12.34") == 7
    assert all(word in text for word in ("actuator", "force,", "limit", "%"))
    assert max(map(len, text.splitlines())) <= 80


@pytest.mark.parametrize("number", ["0.007151", "1234567"])
def test_names_are_there_where_numbers_alone_fill_the_lines(number: str) -> None:
    """Expected: the name's first word; such tables are cut off as they always were, with an ellipsis."""
    assert "actuator" in shown(number)
