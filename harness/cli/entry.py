"""Entry point of the console script: light, so that an interrupt finds a guard from the first moment on."""

# nothing but what Python has loaded anyway
import io
import os
import sys

_INTERRUPTED = "interrupted; nothing written"
_EXIT_ERROR = 1
_EXIT_INTERRUPTED = 130  # 128 and the number of SIGINT, as shells have it


def main() -> None:
    """Run the command line; Ctrl-C, a wish to end (SIGTERM, SIGHUP) and a stream that is full get one line each."""
    code: str | int | None = 0
    try:
        if isinstance(sys.stderr, io.TextIOWrapper):
            sys.stderr = _ErrorStream(sys.stderr)
        _end_as_by_ctrl_c()
        from gough_stewart.harness.cli import app

        app.main()
    except SystemExit as ended:
        code = ended.code
        # Typer ends without a word if it is itself interrupted
        if isinstance(getattr(ended.__context__, "__cause__", None), KeyboardInterrupt):
            _say(_INTERRUPTED)
    except KeyboardInterrupt:
        _say(_INTERRUPTED)
        code = _EXIT_INTERRUPTED
    except OSError as error:  # help that cannot be printed
        _say(f"error: {error.strerror or error}")
        code = _EXIT_ERROR
    sys.exit(_flushed(code))


def _end_as_by_ctrl_c() -> None:
    """What asks the process to end is handled as Ctrl-C: rows are kept, temporary files and compilers go."""
    import signal

    def interrupt(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:  # nohup has reasons of its own
            signal.signal(number, interrupt)


def _flushed(code: str | int | None) -> str | int | None:
    """The exit code, or another one if the results could not be printed; Python would end with a traceback."""
    import gc
    import signal

    # to look for garbage once more would keep the prompt away for up to half a second
    gc.freeze()
    # what is done is done: an interrupt has nothing left to stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        sys.stdout.flush()
    except OSError as error:
        _say(f"error: standard output: {error.strerror or error}")
        # what is left in the buffer has nowhere to go
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return code or _EXIT_ERROR
    return code


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


class _ErrorStream(io.TextIOWrapper):
    """Standard error that never fails: a full disk behind it costs what would have been said, not the run."""

    def __init__(self, stream: io.TextIOWrapper) -> None:
        encoding = stream.encoding
        super().__init__(stream.detach(), encoding, "replace", line_buffering=True)

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError:
            self._close_the_ear()
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError:
            self._close_the_ear()

    def _close_the_ear(self) -> None:
        """What is left in the buffers goes nowhere, and what follows, too."""
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
