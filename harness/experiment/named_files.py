"""The files that an experiment names: what is in them, and their names from another folder."""

import ast
import hashlib
import os
from collections.abc import Iterator
from importlib.machinery import PathFinder
from pathlib import Path

from gough_stewart.harness.control.controllers import PythonController
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.motion.recorded.recording import recording_path
from gough_stewart.harness.motion.references import FromFile
from gough_stewart.harness.section import file_names


def digests(experiment: Experiment) -> dict[str, str]:
    """SHA-256 of the files that an experiment names in its folder, by name; shipped files have none.

    Of a Python controller also the modules beside it that it imports, and the files that these name.
    """
    names = set(file_names(experiment).values())
    if isinstance(experiment.controller, PythonController) and experiment.controller.file is not None:
        file = experiment.folder / experiment.controller.file
        names |= {_from(path, experiment.folder) for path in _files_beside(file)}
    paths = {name: experiment.folder / name for name in sorted(names)}
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in paths.items() if path.is_file()}


def _files_beside(file: Path) -> set[Path]:
    """The modules and packages beside a Python file that import statements reach, and files that texts in them name.

    Of a package all modules count.
    """
    folder, seen, waiting = file.parent, set[Path](), [file]
    while waiting:
        path = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        try:
            nodes = list(ast.walk(ast.parse(path.read_bytes()))) if path.suffix == ".py" else []
        except (OSError, SyntaxError, ValueError):
            continue  # executing it says so
        for name in _imported(nodes):
            spec = PathFinder.find_spec(name, [str(folder)])
            if spec is not None and spec.submodule_search_locations is not None:
                waiting += [module for place in spec.submodule_search_locations for module in Path(place).rglob("*.py")]
            elif spec is not None and spec.origin is not None:
                waiting.append(Path(spec.origin))
        texts = (node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str))
        waiting += [folder / text for text in texts if os.path.isfile(folder / text)]  # noqa: PTH113 - of any text
    return seen - {file}


def _imported(nodes: list[ast.AST]) -> Iterator[str]:
    """The top-level names of import statements, also of those inside functions."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]


def _from(file: Path, folder: Path) -> str:
    """The name of a file from a folder, the same wherever both lie."""
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:  # on another drive
        return file.as_posix()


def names_from(experiment: Experiment, folder: Path) -> dict[tuple[str, ...], str]:
    """The names, by key, under which an experiment file in a folder finds the same files.

    Absolute names, and names of shipped recordings, stay as they are.

    Raises
    ------
    ExperimentError
        The folder has a file of its own under the name of a shipped one.
    """
    return {key: _name_from(experiment, key, Path(name), folder) for key, name in file_names(experiment).items()}


def _name_from(experiment: Experiment, key: tuple[str, ...], name: Path, folder: Path) -> str:
    if name.is_absolute():
        return str(name)
    is_recording = key[0] == "reference" and isinstance(experiment.reference, FromFile)
    if is_recording and recording_path(experiment.folder, str(name)) != experiment.folder / name:  # a shipped one
        if (folder / name).exists():
            raise ExperimentError(
                experiment.where,
                ".".join(key),
                f"is the shipped {name}, but {folder} has a file of this name, which an experiment there would read; "
                "choose another folder",
            )
        return str(name)
    # resolved first: ".." leads elsewhere from a folder that is a link
    target, there = (experiment.folder / name.parent).resolve() / name.name, folder.resolve()
    try:
        return Path(os.path.relpath(target, there)).as_posix()
    except ValueError:  # on another drive
        return target.as_posix()
