"""Executes a Python file with modules of its own: no global of it, or of the modules beside it, is another's.

Modules beside the file are found by the import statements of the file and of those modules, before installed ones, as
when Python runs a file. They are loaded under names of their own, so that two helpers of one name do not meet.
"""

import ast
import builtins
import importlib
import importlib.util
import os
import sys
import threading
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager
from functools import lru_cache
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader, ModuleSpec, SourceFileLoader
from itertools import count
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

_PREFIX = "_gough_stewart_own_"
_NUMBERS = count()
_PACKAGE = __name__.partition(".")[0]
_FOLDER_LOCK = threading.RLock()


class PrivateModules:
    """A Python file, executed, with the modules beside it that it imports.

    Raises
    ------
    Exception
        Anything that the file raises.
    """

    def __init__(self, file: Path) -> None:
        self.folder = file.absolute().parent
        prefix = f"{_PREFIX}{next(_NUMBERS)}"
        package = ModuleType(prefix)
        package.__path__ = [str(self.folder)]
        package.__dict__["__builtins__"] = _builtins_of(prefix, self.folder)
        sys.modules[prefix] = package
        weakref.finalize(self, _forget, prefix)
        name = f"{prefix}.{''.join(c if c.isalnum() else '_' for c in file.stem)}"
        spec = importlib.util.spec_from_file_location(name, file.absolute(), loader=_Source(name, str(file.absolute())))
        assert spec is not None
        assert spec.loader is not None
        self.module = sys.modules[name] = importlib.util.module_from_spec(spec)
        with inside(self.folder):
            try:
                spec.loader.exec_module(self.module)
            except ImportError as error:
                error.msg = str(error.msg).replace(f"{prefix}.", "")
                raise


@contextmanager
def inside(folder: Path) -> Iterator[None]:
    """Run the user's code in its folder, where relative file names then resolve."""
    with _FOLDER_LOCK, chdir(folder):  # the working folder is that of the whole process
        yield


def is_beside(folder: Path, name: str) -> bool:
    """Whether a folder has a module or package of this name."""
    files = (f"{name}.py", os.path.join(name, "__init__.py"), *(f"{name}{suffix}" for suffix in EXTENSION_SUFFIXES))  # noqa: PTH118 - much faster
    return name != _PACKAGE and any((folder / each).is_file() for each in files)


def _forget(prefix: str) -> None:
    for name in [name for name in sys.modules if name == prefix or name.startswith(f"{prefix}.")]:
        del sys.modules[name]


def _builtins_of(prefix: str, folder: Path) -> dict[str, Any]:
    """The built-in functions for code of these modules; they differ in what an import statement calls.

    It holds no reference to the `PrivateModules`, which the modules would keep alive.
    """
    known = dict[str, bool]()

    def import_(
        name: str,
        globals: Mapping[str, object] | None = None,
        locals: Mapping[str, object] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        top = name.partition(".")[0]
        if level == 0:
            if top not in known:
                known[top] = is_beside(folder, top)
            if not known[top]:
                try:
                    return builtins.__import__(name, globals, locals, fromlist, level)
                except ModuleNotFoundError as error:
                    # a folder without __init__.py counts if nothing else has this name
                    if error.name != top or not (folder / top).is_dir():
                        raise
                    known[top] = True
            found = importlib.__import__(f"{prefix}.{name}", globals, locals, fromlist, 0)
            return found if fromlist else sys.modules[f"{prefix}.{top}"]
        return builtins.__import__(name, globals, locals, fromlist, level)

    return {**vars(builtins), "__import__": import_}


class _Source(SourceFileLoader):
    """Loads a module of ours: compiled from its text as it is now, without `__pycache__`, whose clock is coarse."""

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        return _compiled(path, self.get_data(path))

    def exec_module(self, module: ModuleType) -> None:
        package = sys.modules[module.__name__.partition(".")[0]]
        module.__dict__["__builtins__"] = package.__dict__["__builtins__"]
        super().exec_module(module)


@lru_cache(256)
def _compiled(path: str, text: bytes) -> CodeType:
    code: CodeType = compile(text, path, "exec", dont_inherit=True)
    return code


class _Finder:
    """Finds the modules beside a file, for names of ours only."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, _target: ModuleType | None = None) -> ModuleSpec | None:
        if not name.startswith(_PREFIX):
            return None
        last = name.rpartition(".")[2]
        for folder in map(Path, path or ()):
            package, source = folder / last / "__init__.py", folder / f"{last}.py"
            if package.is_file():
                return importlib.util.spec_from_file_location(
                    name,
                    package,
                    loader=_Source(name, str(package)),
                    submodule_search_locations=[str(package.parent)],
                )
            if source.is_file():
                return importlib.util.spec_from_file_location(name, source, loader=_Source(name, str(source)))
            for suffix in EXTENSION_SUFFIXES:
                compiled = folder / f"{last}{suffix}"
                if compiled.is_file():
                    loader = ExtensionFileLoader(name, str(compiled))
                    return importlib.util.spec_from_file_location(name, compiled, loader=loader)
            if (folder / last).is_dir():
                found = ModuleSpec(name, None, is_package=True)
                found.submodule_search_locations = [str(folder / last)]
                return found
        return None


sys.meta_path.insert(0, _Finder)


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
