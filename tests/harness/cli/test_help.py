"""The help of every command in a terminal of 80 columns, and what a shell completes."""

import re
import shlex
from typing import Any

import pytest

from tests.support.commands import commands, invoke


def parameters() -> list[tuple[str, Any]]:
    return [(name, parameter) for name, command in commands().items() for parameter in command.params]


def test_help_is_whole_and_names_no_types_of_python() -> None:
    """Expected: no text that is cut, no <bool>, no <int range>, no line of more than 80."""
    for name in ("", *commands()):
        text = invoke(*name.split(), "--help", columns=80).stdout
        assert "…" not in text.replace("NAME,…", "").replace("],…", ""), name
        assert re.findall(r"<[a-zA-Z]", text) == [], name
        assert max(map(len, text.splitlines())) <= 80, name


def test_examples_of_the_help_have_options_that_are_there() -> None:
    """Expected: the command takes the words; what is behind > is the shell's."""
    examples = []
    for command in commands().values():
        examples += re.findall(r"`gough-stewart ([^`]*)`", (command.callback.__doc__ or "").partition("Examples")[2])
    assert len(examples) > 30
    for example in examples:
        name, *arguments = shlex.split(example.partition(" > ")[0])
        assert commands()[name].make_context(name, arguments).params, example


def test_every_option_is_explained_in_a_sentence_and_its_value_in_a_word() -> None:
    """Expected: a capital, a full stop, and words; a value's name without blanks: in capitals, or the choices."""
    for command, parameter in parameters():
        text, value, where = parameter.help, parameter.metavar, (command, parameter.name)
        assert re.fullmatch(r"[A-Z].* .*\.", text), where
        assert (not value) == bool(getattr(parameter, "is_flag", False)), where
        if value and parameter.name not in {"controller", "over_ensemble"}:
            is_name = re.fullmatch(r"[A-Z]+([.=|,\[\]:…]+(toml|html|[A-Z]+)?)*", value)
            assert is_name or re.fullmatch(r"[a-z0-9._-]+(\|[a-z0-9._-]+)+", value), where


@pytest.mark.parametrize(
    ("name", "begun", "expected", "of"),
    [
        ("preset", "mot", {"motion_base", "motion_base_screws"}, "build excite identify poses reproduce workspace"),
        ("experiment", "heave_st", {"heave_step"}, "run check margins ensemble tune export live serve frf identify"),
        ("target", "a", {"all", "aarch64-linux", "aarch64-darwin"}, "build export"),
        ("target", "n", {"native"}, "build export"),
        ("name", "liu", {"liu2000"}, "presets"),
        ("name", "circle_c", {"circle_computed_torque"}, "experiments"),
    ],
)
def test_names_are_completed_by_what_there_is(name: str, begun: str, expected: set[str], of: str) -> None:
    found = {
        command: {each.value for each in parameter.shell_complete(context, begun)}
        for command, parameter in parameters()
        if parameter.name == name
        for context in [commands()[command].make_context(command, [], resilient_parsing=True)]
    }
    assert {command: values for command, values in found.items() if values} == dict.fromkeys(of.split(), expected)
