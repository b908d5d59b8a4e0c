"""The help of every command, in a terminal of 80 columns."""

import re
import shlex

import pytest
import typer.main

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


EXAMPLES = [
    pytest.param(shlex.split(example), id=example)
    for command in cli.app.registered_commands
    for example in re.findall(r"`gough-stewart ([^`]*)`", (command.callback.__doc__ or "").partition("Examples")[2])
]


@pytest.mark.parametrize("words", EXAMPLES)
def test_examples_of_the_help_have_options_that_are_there(words: list[str]) -> None:
    """Expected: the command takes the words; what is behind > is the shell's."""
    words = words[: words.index(">")] if ">" in words else words
    name, *arguments = words
    command = typer.main.get_group(cli.app).commands[name]
    assert command.make_context(name, arguments).params


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "heave_step", "--plant", "fmu4"], "'--plant': 'fmu4' is not one of 'model', 'fmu2', 'fmu3'."),
        (["ensemble", "heave_step", "--members", "x"], "'--members': expected a whole number"),
        (["ensemble", "heave_step", "--members", "0"], "'--members': expected a number greater than or equal to 1"),
        (["excite", "--duration", "long"], "'--duration': expected a number"),
    ],
)
def test_wrong_values_are_named_in_plain_words(arguments: list[str], message: str) -> None:
    done = invoke(*arguments)
    assert done.exit_code == 2
    assert message in done.output
