"""A compiler in the place of zig, for builds that take no time and fail as a test wants.

Its library holds the start values, which are compiled, and the name of the target.
"""

import json
import sys
from pathlib import Path

import pytest

_PROGRAM = """
import json, os, pathlib, shutil, signal, subprocess, sys, time
folder, command = pathlib.Path(os.environ["FAKE_ZIG"]), sys.argv[1:]
with (folder / "calls").open("a") as calls:
    print(json.dumps(command), file=calls)
objects, target = pathlib.Path(os.environ["ZIG_LOCAL_CACHE_DIR"]), "here"
if "-target" in command:
    target = command[command.index("-target") + 1]
exec((folder / "rule.py").read_text())
out = pathlib.Path(command[command.index("-o") + 1])
start = next(pathlib.Path(name) for name in command if name.endswith("/model.c"))
kept = folder.parent / f"{start.parent.name}.o"
if not kept.exists():
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= {f"ZIG_{name}_CACHE_DIR": str(folder.parent) for name in ("LOCAL", "GLOBAL")}
    made = f"{kept}.{os.getpid()}"
    arguments = ["-c", "-std=c11", "-I", command[command.index("-I") + 1], str(start), "-o", made]
    subprocess.run([sys.executable, "-m", "ziglang", "cc", *arguments], env=environment, check=True)
    os.replace(made, kept)
out.write_bytes(kept.read_bytes() + target.encode())
"""


class FakeZig:
    """The fake in a folder of its own, which the next builds find; their cache is empty at first."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.cache = folder, folder / "cache" / "gough-stewart"
        (folder / "ziglang").mkdir(parents=True)
        (folder / "ziglang" / "__init__.py").write_text("")
        (folder / "ziglang" / "__main__.py").write_text(_PROGRAM)
        self.rule("")
        for name, value in (("FAKE_ZIG", folder), ("PYTHONPATH", folder), ("ZIG_GLOBAL_CACHE_DIR", folder / "cache")):
            monkeypatch.setenv(name, str(value))

    def rule(self, code: str) -> None:
        """Python that runs first; knows `command`, `target`, `folder`, and the folder of `objects`."""
        (self.folder / "rule.py").write_text(code)

    def calls(self, *, forget: bool = True) -> list[list[str]]:
        """Arguments of all runs since they were last forgotten."""
        log = self.folder / "calls"
        lines = log.read_text().splitlines() if log.exists() else []
        if forget:
            log.unlink(missing_ok=True)
        return [json.loads(line) for line in lines]

    def as_cc(self) -> Path:
        """A program that is the same compiler under another name."""
        path = self.folder / "mycc"
        path.write_text(f'#!/bin/sh\nexec {sys.executable} -m ziglang "$@"\n')
        path.chmod(0o755)
        return path
