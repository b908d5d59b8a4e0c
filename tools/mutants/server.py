"""A process that loads libraries (its arguments) and forks a run of pytest for each request, a line of JSON.

Loading NumPy, SciPy, CasADi and python-control takes longer than most trials. Before the fork, only those modules of
the repository are loaded that no mutant of the folder can change.
"""

import importlib
import json
import os
import signal
import sys
import traceback
from contextlib import suppress
from types import FrameType
from typing import Any

_child = 0


def serve() -> None:
    """Answer each request `{"arguments": …, "environment": …, "printed": …}` with the exit code of pytest."""
    for library in sys.argv[1:]:
        with suppress(ImportError):
            importlib.import_module(library)
    signal.signal(signal.SIGTERM, _end)
    for line in sys.stdin:
        print(_run(json.loads(line)), flush=True)


def _run(request: dict[str, Any]) -> int:
    global _child  # noqa: PLW0603 - the handler of the signal has no other way to it
    _child = os.fork()
    if _child == 0:
        os.setpgid(0, 0)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        printed = os.open(request["printed"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for stream, target in ((os.open(os.devnull, os.O_RDONLY), 0), (printed, 1), (printed, 2)):
            os.dup2(stream, target)
        os.environ.update(request["environment"])
        os._exit(_pytest(request["arguments"]))
    _, status = os.waitpid(_child, 0)
    _kill(_child)  # processes that it may have left
    return os.waitstatus_to_exitcode(status)


def _pytest(arguments: list[str]) -> int:
    import pytest

    try:
        return int(pytest.main(arguments))
    except BaseException:
        traceback.print_exc()
        return 3
    finally:
        sys.stdout.flush()
        sys.stderr.flush()


def _kill(group: int) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(group, signal.SIGKILL)


def _end(_signal: int, _frame: FrameType | None) -> None:
    if _child:
        _kill(_child)
    os._exit(0)


if __name__ == "__main__":
    serve()
