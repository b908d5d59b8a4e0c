"""A third-party FMU in its own process, so that a crash there does not affect the run."""

import importlib
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants.plant import Plant
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.interface import DEFAULT_TOLERANCE, State, Variant
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.vectors import FloatArray

# Time for the FMU to terminate [s].
_PATIENCE = 2.0
# Interval at which its process checks whether the run is still alive [s].
_WATCH = 0.5
# Ctrl-C reaches only the run, which ends the FMU after it has kept its rows.
_OWN_GROUP: dict[str, Any] = {"process_group": 0}
if sys.platform == "win32":
    _OWN_GROUP = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}


class Isolated:
    """An object in a separate process, which may crash or hang without affecting this one.

    Calls and answers are pickles on its standard streams; an answer has a success flag, and a value or an error to be
    raised. Output is kept for the message after a crash. `multiprocessing` would import the user's script again.
    """

    def __init__(
        self,
        path: Path,  # of the FMU, for messages
        kind: str,  # the class of the object, "module:name", imported only there; it has a method `close`
        arguments: tuple[Any, ...],  # of the class
        error: type[GoughStewartError] = PlantError,  # if the process has ended
        environment: Mapping[str, str] | None = None,  # besides this process's
    ) -> None:
        self.path, self._error, self._is_waiting = path, error, False
        # contains everything that the FMU leaves behind
        self._folder = tempfile.TemporaryDirectory(prefix="gough-stewart-", ignore_cleanup_errors=True)
        self._printed = Path(self._folder.name, "printed")
        try:
            # an interrupt inside of Popen would lose sight of the process
            with self._printed.open("wb") as printed, interrupts_held_back():
                # with the module path of this process
                program = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve()"
                self._process = subprocess.Popen(
                    [sys.executable, "-c", program],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=printed,
                    env={**os.environ, "TMPDIR": self._folder.name, "TEMP": self._folder.name, **(environment or {})},
                    **_OWN_GROUP,
                )
            self.call("start", kind, arguments)
        except BaseException:
            self.close()
            raise

    def call(self, method: str, *arguments: Any) -> Any:
        """Call a method of the object and return its value."""
        calls, answers = self._process.stdin, self._process.stdout
        assert calls is not None
        assert answers is not None
        if calls.closed or self._is_waiting:  # an interrupted call has not returned
            raise self._ended(method, arguments)
        try:
            self._is_waiting = True
            _send(calls, (method, arguments))
            well, value = pickle.load(answers)
            self._is_waiting = False
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            raise self._ended(method, arguments) from error
        if not well:
            raise value
        return value

    def close(self) -> None:
        """End the process; may be called again."""
        process = getattr(self, "_process", None)
        if process is not None and process.returncode is None:
            self._end(process)
        self._folder.cleanup()

    def kill(self) -> None:
        """Kill the process from any thread; a call that waits for it raises."""
        self._process.kill()
        self._end(self._process)
        self._folder.cleanup()

    def _ended(self, method: str, arguments: tuple[Any, ...]) -> GoughStewartError:
        """The error after the process has ended, with its exit code and the last line of its output."""
        self._end(self._process)
        code = self._process.returncode
        how = f"ended its process with exit code {code}" if code >= 0 else f"crashed ({signal.Signals(-code).name})"
        where = f"do_step at time {arguments[0]:.9g} s" if method == "do_step" else method
        lines: list[str] = []
        if self._printed.exists():  # not closed
            with self._printed.open("rb") as printed:
                printed.seek(max(0, self._printed.stat().st_size - 2000))
                lines = printed.read().decode(errors="replace").strip().splitlines()
        last = f": {lines[-1][:200]}" if lines else ""
        return self._error(f"{self.path}: the FMU {how} in {where}{last}")

    def _end(self, process: "subprocess.Popen[bytes]") -> None:
        for stream in (process.stdin, process.stdout):
            assert stream is not None
            with suppress(OSError):  # unsent data
                stream.close()
        try:
            process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


class IsolatedFmu(Plant):
    """`FmuPlant` in its own process; `PlantError` also if that has ended."""

    def __init__(
        self,
        path: Path | str,
        platform: Platform,
        start: State | None = None,
        tolerance: float = DEFAULT_TOLERANCE,
        fixed_step_size: float = 0.0,
    ) -> None:
        self.path, self.columns = Path(path), Variant.of(platform).columns
        arguments = (self.path, platform, start, tolerance, fixed_step_size)
        self._isolated = Isolated(self.path, "gough_stewart.harness.plants.unit:FmuPlant", arguments)
        self.fmi_version: str = self._isolated.call("__getattribute__", "fmi_version")

    def set_inputs(self, inputs: FloatArray) -> None:
        self._isolated.call("set_inputs", inputs)

    def set_parameters(self, values: Mapping[str, object]) -> None:
        self._isolated.call("set_parameters", dict(values))

    def results(self) -> FloatArray:
        return np.asarray(self._isolated.call("results"))

    def signals(self) -> FloatArray:
        return np.asarray(self._isolated.call("signals"))

    def do_step(self, time: float, step: float) -> None:
        self._isolated.call("do_step", time, step)

    def remarks(self) -> str:
        """What the FMU said since the last call; nothing of a process that has ended."""
        with suppress(PlantError):
            return str(self._isolated.call("remarks"))
        return ""

    def close(self) -> None:
        self._isolated.close()


def serve() -> None:
    """The loop of the child process: make the object, then answer calls until the stream ends."""
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    calls, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    # keep input and output of the FMU out of the protocol
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    served: Any = None
    try:
        while True:
            try:
                method, arguments = pickle.load(calls)
            except EOFError:
                return
            try:
                value = None
                if served is None:
                    (module, name), arguments = arguments[0].split(":"), arguments[1]
                    served = getattr(importlib.import_module(module), name)(*arguments)
                else:
                    value = getattr(served, method)(*arguments)
                _send(answers, (True, value))
            except GoughStewartError as error:
                _send(answers, (False, error))
    finally:
        if served is not None:
            served.close()


def _end_with_parent(parent: int) -> None:
    """End with the parent: a hanging FMU does not see the end of the stream; an orphan gets another parent."""
    while os.getppid() == parent:
        time.sleep(_WATCH)
    os._exit(1)


def _send(stream: IO[bytes], message: Any) -> None:
    pickle.dump(message, stream, pickle.HIGHEST_PROTOCOL)
    stream.flush()
