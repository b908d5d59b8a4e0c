"""TOML, read with errors that name line and key; values as they are written; the files that ship with the package."""

import re
import tomllib
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np
import tomlkit

_PLACE = re.compile(r"\(at line (\d+), column \d+\)")
_TABLE_TWICE = re.compile(r"Cannot declare (\(.*?\)) twice")
_KEY = re.compile(r"\s*([^=#]+?)\s*=")


def toml_values(text: str) -> dict[str, Any]:
    """The values of a TOML text; `ValueError` has one line with the place and the text found there."""
    try:
        # with a final newline, so that errors in the last line have a position, too
        return tomllib.loads(f"{text}\n")
    except RecursionError:
        raise ValueError("is not TOML: its values are nested too deeply") from None
    except ValueError as error:  # decoding errors, and integers with too many digits
        message = str(error)
        if place := _PLACE.search(message):
            # TOML counts line feeds only
            number, lines = int(place[1]), text.split("\n")
            # the key of a value with several lines is in a line above
            before = enumerate(reversed(lines[:number]))
            key = next(((number - k, match[1]) for k, line in before if (match := _KEY.match(line))), None)
            if message.startswith("Cannot overwrite a value") and key is not None:
                message = f"the key '{key[1]}' in line {key[0]} is a duplicate; expected every key once"
            elif declared := _TABLE_TWICE.match(message):
                name = ".".join(re.findall(r"'([^']*)'", declared[1]))
                message = f"the table [{name}] in line {number} is a duplicate; expected every table once"
            elif line := lines[number - 1].strip():
                message = f"{message}: {line[:60]}"
        raise ValueError(f"is not TOML: {message}") from error


def toml_item(value: Any) -> tomlkit.items.Item:
    """A value as it is written, lossless; an array with a line for each row of a matrix."""
    if not isinstance(value, np.ndarray):
        item: tomlkit.items.Item = tomlkit.item(value)
        return item
    array = tomlkit.array()
    array.extend(value.tolist())
    array.multiline(value.ndim == 2)
    return array


def toml_files(package: str, folder: str) -> dict[str, Traversable]:
    """The TOML files in a folder of a package by their names without .toml, in alphabetical order."""
    files = resources.files(package).joinpath(folder).iterdir()
    return dict(sorted((f.name.removesuffix(".toml"), f) for f in files if f.name.endswith(".toml")))
