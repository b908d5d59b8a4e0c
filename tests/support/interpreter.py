"""Python programs in processes of their own that need not import SciPy, python-control and matplotlib each time.

A server imports them once, traces the kernel once, and forks for every program, which then runs as if Python had just
started: its own arguments, folder, environment, output, and Ctrl-C. Only standard library and tests import this file;
as a script it is the server. It reads programs from its input, one line of JSON each, and answers with their exit
codes.
"""

import json
import os
import runpy
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

COMMAND = "gough-stewart"
# Third-party modules that take long to import and start no threads, which a fork would lose (as Polars does).
_HEAVY = (
    *("scipy.integrate", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.spatial.transform"),
    *("casadi", "control", "fmpy.fmi2", "fmpy.fmi3", "lxml.etree", "matplotlib.pyplot", "numpy"),
    *("PIL.Image", "pydantic", "rich.progress", "tomlkit", "typer"),
    "gough_stewart.harness.experiment.schema",
)
# What most programs would trace again, a second or two for each.
_KERNEL = ("derivatives_function", "outputs_function", "legs_function", "jacobians_function")


class Interpreter:
    """The server, and what it is asked for."""

    def __init__(self) -> None:
        # matplotlib reads its backend when it is imported
        self._server = subprocess.Popen(
            [sys.executable, __file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "MPLBACKEND": "agg"},
        )

    def script(
        self, path: Path, *arguments: str, cwd: Path, env: Mapping[str, str] | None = None
    ) -> subprocess.CompletedProcess[str]:
        """`python path arguments` in a folder, with more in its environment."""
        return self._run([str(path), *arguments], cwd, env or {})

    def command(
        self, *arguments: str, cwd: Path, env: Mapping[str, str] | None = None
    ) -> subprocess.CompletedProcess[str]:
        """`gough-stewart arguments` in a folder, with more in its environment."""
        return self._run([COMMAND, *arguments], cwd, env or {})

    def _run(self, argv: Sequence[str], cwd: Path, env: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        with tempfile.TemporaryDirectory() as folder:
            out, err = Path(folder, "out"), Path(folder, "err")
            # what opens a page in a browser opens none
            environment = {**os.environ, "MPLBACKEND": "agg", "BROWSER": "true", **env}
            program = {"argv": list(argv), "cwd": str(cwd), "env": environment, "out": str(out), "err": str(err)}
            self._server.stdin.write(json.dumps(program) + "\n")
            self._server.stdin.flush()
            answer = self._server.stdout.readline()
            assert answer, "the server has ended"
            return subprocess.CompletedProcess(list(argv), int(answer), out.read_text(), err.read_text())

    def close(self) -> None:
        """End the server."""
        self._server.communicate()


def _serve() -> dict[str, Any] | None:
    """Fork for each program; returns it in the child, and None at the end."""
    for line in sys.stdin:
        program: dict[str, Any] = json.loads(line)
        child = os.fork()
        if not child:
            return program
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
    return None


def _become(program: dict[str, Any]) -> None:
    """Run a program in this process, as Python's own start does; what it raises is for the interpreter to report."""
    for descriptor, path, flags in (
        (0, os.devnull, os.O_RDONLY),
        (1, program["out"], os.O_WRONLY | os.O_CREAT),
        (2, program["err"], os.O_WRONLY | os.O_CREAT),
    ):
        os.dup2(os.open(path, flags), descriptor)
    # a test run in the background may have been told to ignore it
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.chdir(program["cwd"])
    os.environ.clear()
    os.environ.update(program["env"])
    if "MUTANTS_TEST" in os.environ:  # the program's lines are those of the test that runs it
        measured = import_module("coverage").Coverage.current()
        if measured is not None:
            measured.switch_context(os.environ["MUTANTS_TEST"])
    sys.argv = program["argv"]
    if sys.argv[0] == COMMAND:
        import_module("gough_stewart.__main__").main()
    else:
        sys.path[0] = str(Path(sys.argv[0]).parent)
        runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    for name in _HEAVY:
        import_module(name)
    traced = import_module("gough_stewart.model.traced")
    for name in _KERNEL:
        getattr(traced, name)()
    asked = _serve()
    if asked is not None:
        _become(asked)
