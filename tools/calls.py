"""`python -m tools.calls COMMAND …`: counts the functions and files of the package that a command passes.

A measure of the way from the command line to the result: each of them is one more that a reader must follow.

    python -m tools.calls run heave_step --out results/heave
    python -m tools.calls --list run heave_step --out results/heave

A function counts once, however often it is called, and so does its file. What runs while a module is imported is left
out, and so are comprehensions, which are part of their function, code that other packages generate (`__init__` of a
dataclass), and processes that the command starts.
"""

import argparse
import sys
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
FOLDERS = ("model", "fmu_build", "harness")
_COMPREHENSIONS = ("<listcomp>", "<setcomp>", "<dictcomp>", "<genexpr>")
_IMPORTING = "<frozen importlib"


class Function(NamedTuple):
    """A function by its place."""

    file: str
    line: int
    name: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line} {self.name}"


class Calls:
    """How often each function of the folders was called."""

    def __init__(self, root: Path, folders: tuple[str, ...]) -> None:
        self._root = root.resolve()
        self._folders = folders
        self._files: dict[str, str | None] = {}  # by the name in the code; None is a file of others
        self._counts: Counter[tuple[str, int, str]] = Counter()
        self._of_thread = threading.local()

    @property
    def counts(self) -> dict[Function, int]:
        """Functions in the order of their first call, with the number of calls."""
        found: Counter[Function] = Counter()
        for (path, line, name), number in self._counts.items():
            file = self._file(path)
            if file is not None and not name.endswith(_COMPREHENSIONS):
                found[Function(file, line, name)] += number
        return dict(found)

    @property
    def files(self) -> list[str]:
        """Files with such a function, in the order of their first call."""
        return list(dict.fromkeys(function.file for function in self.counts))

    @contextmanager
    def counting(self) -> Iterator[None]:
        """Count in this thread, and in threads that are started meanwhile."""
        threading.setprofile(self._profile)
        sys.setprofile(self._profile)
        try:
            yield
        finally:
            sys.setprofile(None)
            threading.setprofile(None)

    def _profile(self, frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if code.co_filename.startswith(_IMPORTING):
            if event in ("call", "return"):
                depth = getattr(self._of_thread, "imports", 0)
                self._of_thread.imports = depth + (1 if event == "call" else -1)
        elif event == "call" and not getattr(self._of_thread, "imports", 0):
            self._counts[code.co_filename, code.co_firstlineno, code.co_qualname] += 1

    def _file(self, path: str) -> str | None:
        """The path from the root, through the links of the import namespace; None outside of the folders."""
        if path not in self._files:
            real = Path(path).resolve()
            inside = real.is_relative_to(self._root) and real.relative_to(self._root).parts[0] in self._folders
            self._files[path] = real.relative_to(self._root).as_posix() if inside else None
        return self._files[path]


def main(arguments: list[str] | None = None) -> int:
    """Run the command, count, and return the command's exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.calls", description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--list", action="store_true", help="also list the functions, by file, with their calls")
    parser.add_argument("command", nargs=argparse.REMAINDER, help="arguments of gough-stewart, such as: run heave_step")
    options = parser.parse_args(arguments)
    if not options.command:
        parser.error("no command; expected arguments of gough-stewart, such as: run heave_step")
    from gough_stewart.harness.cli.entry import main as command

    sys.argv = ["gough-stewart", *options.command]
    calls = Calls(ROOT, FOLDERS)
    code: str | int | None = 0
    try:
        with calls.counting():
            command()
    except SystemExit as ended:
        code = ended.code
    if options.list:
        print(*_listed(calls), sep="\n")
    print(f"{len(calls.counts)} functions in {len(calls.files)} files")
    return code if isinstance(code, int) else int(code is not None)


def _listed(calls: Calls) -> Iterator[str]:
    """Each file, and below it its functions with the number of calls."""
    for file in calls.files:
        yield file
        for function, number in calls.counts.items():
            if function.file == file:
                yield f"{number:9d} {function.name} ({function.line})"


if __name__ == "__main__":
    sys.exit(main())
