"""`python -m tools.calls`: every function of the folders that runs is counted, and what only imports run is not.

Expected: the calls that the program written here makes, counted by reading it.
"""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from tools.calls import Calls
from tools.pages.blocks import ROOT

PROGRAM = """\
import threading
from dataclasses import dataclass


def doubled(x):
    return 2 * x


TWO = doubled(1)


@dataclass
class Leg:
    length: float

    @property
    def half(self):
        return self.length / 2


def raises():
    import NAME_late

    NAME_late.used()
    raise ValueError


def start():
    doubled(3)
    [doubled(x) for x in (1, 2)]
    Leg(3.0).half
    try:
        raises()
    except ValueError:
        pass
    doubled(4)
    thread = threading.Thread(target=lambda: doubled(5))
    thread.start()
    thread.join()


def never():
    pass
"""
LATE = """\
def at_import():
    pass


def used():
    pass


at_import()
"""


def written(folder: Path, name: str) -> None:
    folder.mkdir()
    (folder / f"{name}.py").write_text(PROGRAM.replace("NAME", name))
    (folder / f"{name}_late.py").write_text(LATE)


def test_functions_count_once_with_their_calls_and_imports_do_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: `doubled` runs at import and then five times, two of them in a comprehension and one in a thread.

    A decorated function begins at its decorator.
    """
    for name in ("rods", "others"):
        written(tmp_path / name, name)
        monkeypatch.syspath_prepend(tmp_path / name)
    (tmp_path / "link").symlink_to("rods")
    monkeypatch.syspath_prepend(tmp_path / "link")
    calls = Calls(tmp_path, ("rods",))
    with calls.counting():
        rods, others = importlib.import_module("rods"), importlib.import_module("others")
        rods.start()
        others.start()
    rods.start()
    assert {(f.file, f.name): number for f, number in calls.counts.items()} == {
        ("rods/rods.py", "start"): 1,
        ("rods/rods.py", "doubled"): 5,
        ("rods/rods.py", "Leg.half"): 1,
        ("rods/rods.py", "raises"): 1,
        ("rods/rods_late.py", "used"): 1,
        ("rods/rods.py", "start.<locals>.<lambda>"): 1,
    }
    assert calls.files == ["rods/rods.py", "rods/rods_late.py"]
    assert [f.line for f in calls.counts] == [28, 5, 16, 21, 5, 37]


def of_command(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "tools.calls", *arguments],
        cwd=cwd, capture_output=True, text=True, check=False, env={"PYTHONPATH": str(ROOT), "PATH": ""},
    )  # fmt: skip


def test_the_list_is_of_the_numbers_below_it_and_the_exit_code_is_the_command_s(tmp_path: Path) -> None:
    """Expected: what the command prints, the files with their functions, and as many of both as the last line says."""
    done = of_command("--list", "experiments", "no_such", cwd=tmp_path)
    lines = done.stdout.splitlines()
    files = [line for line in lines if line.startswith(("model/", "fmu_build/", "harness/"))]
    functions = [line for line in lines if line.startswith(" ")]
    assert done.returncode == 2
    assert "no_such" in done.stderr
    assert lines[-1] == f"{len(functions)} functions in {len(files)} files"
    assert files[0] == "harness/cli/entry.py"
    assert functions[0].split()[:2] == ["1", "main"]
    assert len(files) == len(set(files)) > 3


def test_without_a_list_there_are_two_numbers_and_without_a_command_a_message(tmp_path: Path) -> None:
    short = of_command("experiments", "heave_step", cwd=tmp_path).stdout.splitlines()
    assert short[-1].endswith(" files")
    assert not [line for line in short if line.startswith("harness/")]
    empty = of_command(cwd=tmp_path)
    assert empty.returncode == 2
    assert "expected arguments of gough-stewart" in empty.stderr
