"""The files that a Python file of the user depends on, found without executing it."""

import ast
from collections.abc import Iterator
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

from gough_stewart.harness.control.own_modules import is_beside


def files_beside(file: Path) -> list[Path]:
    """The file, the modules beside it that its import statements reach, and files that these name, in order.

    Of a package all modules count. A file is named by a text in the code, such as "gains.csv", relative to the folder.
    """
    folder = file.parent
    found: dict[Path, None] = {}
    waiting = [file]
    while waiting:
        each = waiting.pop()
        if each in found or not each.is_file():
            continue
        found[each] = None
        if each.suffix != ".py":
            continue
        try:
            tree = ast.parse(each.read_bytes())
        except (SyntaxError, ValueError):
            continue  # executing it says so
        for name in _imported(tree):
            if is_beside(folder, name) or (folder / name).is_dir():
                waiting += _modules(folder, name)
        waiting += [folder / text for text in _texts(tree) if _is_file(folder / text)]
    return sorted(found)


def _imported(tree: ast.AST) -> Iterator[str]:
    """The top-level names of all import statements, also of those inside functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]


def _modules(folder: Path, name: str) -> list[Path]:
    """The files of a module or package."""
    if (folder / name).is_dir():
        return sorted(each for kind in (".py", *EXTENSION_SUFFIXES) for each in (folder / name).rglob(f"*{kind}"))
    return [folder / f"{name}{kind}" for kind in (".py", *EXTENSION_SUFFIXES)]


def _texts(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
