"""TOML, with errors that name the line and the key."""

import re
import tomllib
from typing import Any

_PLACE = re.compile(r"\(at line (\d+), column \d+\)")
_TABLE_TWICE = re.compile(r"Cannot declare (\(.*?\)) twice")
_KEY = re.compile(r"\s*([^=#]+?)\s*=")


def toml_values(text: str) -> dict[str, Any]:
    """The values of a TOML text.

    Raises
    ------
    ValueError
        Not TOML; one line that names the place and what stands there, and a key that is there twice.
    """
    try:
        # with an end, so that errors in the last line have a place, too
        return tomllib.loads(f"{text}\n")
    except RecursionError:
        raise ValueError("is not TOML: its values lie too deep in each other") from None
    except ValueError as error:  # beside decoding errors: endless digits
        raise ValueError(f"is not TOML: {_explained(str(error), text.splitlines())}") from error


def _explained(message: str, lines: list[str]) -> str:
    found = _PLACE.search(message)
    if found is None:
        return message
    number = int(found[1])
    # of a value over several lines the key is above
    before = enumerate(reversed(lines[:number]))
    key = next(((number - k, match[1]) for k, line in before if (match := _KEY.match(line))), None)
    if message.startswith("Cannot overwrite a value") and key is not None:
        return f"the key '{key[1]}' in line {key[0]} is there already; expected every key once"
    if declared := _TABLE_TWICE.match(message):
        name = ".".join(re.findall(r"'([^']*)'", declared[1]))
        return f"the table [{name}] in line {number} is there already; expected every table once"
    line = lines[number - 1].strip() if number <= len(lines) else ""
    return f"{message}: {line[:60]}" if line else message
