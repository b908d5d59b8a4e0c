"""The help of every command, in a terminal of 80 columns."""

import re

import pytest

from gough_stewart.harness.cli import app as cli
from tests.support.commands import invoke

COMMANDS = [command.name for command in cli.app.registered_commands]


@pytest.mark.parametrize("command", ["", *filter(None, COMMANDS)])
def test_help_is_whole_and_names_no_types_of_python(command: str) -> None:
    """Expected: no text that is cut, no <bool>, no <int range>, no line of more than 80."""
    text = invoke(*command.split(), "--help", columns=80).stdout
    assert "…" not in text.replace("NAME,…", "").replace("],…", "")
    assert re.findall(r"<[a-zA-Z]", text) == []
    assert max(map(len, text.splitlines())) <= 80
