"""The help of every command, in a terminal of 80 columns."""

import re
import shlex
from typing import Any

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
        (["run", "heave_step", "--plant", "fmu4"], "'--plant': 'fmu4' is not one of 'model', 'scipy', 'fmu2', 'fmu3'."),
        (["ensemble", "heave_step", "--members", "x"], "'--members': expected a whole number"),
        (["ensemble", "heave_step", "--members", "0"], "'--members': expected a number greater than or equal to 1"),
        (["excite", "--duration", "long"], "'--duration': expected a number"),
    ],
)
def test_wrong_values_are_named_in_plain_words(arguments: list[str], message: str) -> None:
    done = invoke(*arguments)
    assert done.exit_code == 2
    assert message in done.output


PARAMETERS: list[tuple[Any, Any]] = [
    (command, parameter) for command in typer.main.get_group(cli.app).commands.values() for parameter in command.params
]


def test_every_option_is_explained_in_a_sentence_and_its_value_in_a_word() -> None:
    """Expected: a capital, a full stop, and words; a value's name without blanks: in capitals, or the choices."""
    for command, parameter in PARAMETERS:
        text, value = parameter.help, parameter.metavar
        assert re.fullmatch(r"[A-Z].* .*\.", text), (command.name, parameter.name)
        assert value is None or re.fullmatch(r"\S+", value), (command.name, parameter.name)
        if value is not None and parameter.name not in {"controller", "over_ensemble"}:
            is_name = re.fullmatch(r"[A-Z]+([.=|,\[\]:…]+(toml|html|[A-Z]+)?)*", value)
            assert is_name or re.fullmatch(r"[a-z0-9._-]+(\|[a-z0-9._-]+)+", value), (command.name, parameter.name)
        assert (value is None) == bool(getattr(parameter, "is_flag", False)), (command.name, parameter.name)


def test_names_are_completed_by_what_there_is() -> None:
    """Expected: presets, shipped experiments and systems that begin so, wherever one is an option or argument."""
    found: dict[str, set[str]] = {}
    for command, parameter in PARAMETERS:
        context = command.make_context(command.name, [], resilient_parsing=True)
        for name, begun in (("preset", "mot"), ("experiment", "heave_st"), ("target", "a"), ("name", "")):
            if parameter.name == name:
                for each in parameter.shell_complete(context, begun):
                    found.setdefault(f"{command.name} {name}", set()).add(each.value)
    for command in ("build", "excite", "identify", "reproduce", "workspace"):
        assert found[f"{command} preset"] == {"motion_base", "motion_base_screws"}
    for command in ("run", "check", "margins", "ensemble", "tune", "export"):
        assert found[f"{command} experiment"] == {"heave_step"}
    systems = {"all", "aarch64-linux", "aarch64-darwin"}
    assert found["build target"] == found["export target"] == systems
    assert {"liu2000", "motion_base"} <= found["presets name"]
    assert {"heave_step", "circle"} <= found["experiments name"]
    for command, parameter in PARAMETERS:
        if parameter.name == "target":
            context = command.make_context(command.name, [], resilient_parsing=True)
            assert [each.value for each in parameter.shell_complete(context, "n")] == ["native"]
