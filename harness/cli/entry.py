"""Entry point of the console script; it imports little, so that interrupts are handled from the start."""

# only modules that Python has loaded already
import io
import os
import sys

_INTERRUPTED = "interrupted; nothing written"
_EXIT_ERROR = 1
_EXIT_INTERRUPTED = 130  # 128 + SIGINT, the shells' convention


def main() -> None:
    """Run the command line; Ctrl-C, SIGTERM, SIGHUP and a full output stream give one line each."""
    code: str | int | None = 0
    try:
        if isinstance(sys.stderr, io.TextIOWrapper):
            sys.stderr = _ErrorStream(sys.stderr)
        _end_as_by_ctrl_c()
        from gough_stewart.harness.cli import app

        app.main()
    except SystemExit as ended:
        code = ended.code
        # Typer exits silently if it is itself interrupted
        if isinstance(getattr(ended.__context__, "__cause__", None), KeyboardInterrupt):
            _say(_INTERRUPTED)
    except KeyboardInterrupt:
        _say(_INTERRUPTED)
        code = _EXIT_INTERRUPTED
    except OSError as error:  # the help cannot be printed
        _say(f"error: {error.strerror or error}")
        code = _EXIT_ERROR
    sys.exit(_flushed(code))


def _end_as_by_ctrl_c() -> None:
    """Handle signals that end the process like Ctrl-C: keep rows, remove temporary files, end compilers."""
    import signal

    def interrupt(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if (
            number is not None and signal.getsignal(number) is signal.SIG_DFL
        ):  # keep handlers of others, such as nohup's
            signal.signal(number, interrupt)


def _flushed(code: str | int | None) -> str | int | None:
    """The exit code, or 1 if the results could not be printed, where Python would end with a traceback."""
    import gc
    import signal

    # a last garbage collection would take up to half a second
    gc.freeze()
    # nothing is left to interrupt
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        sys.stdout.flush()
    except OSError as error:
        _say(f"error: standard output: {error.strerror or error}")
        # discard what is left in the buffer
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return code or _EXIT_ERROR
    return code


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


class _ErrorStream(io.TextIOWrapper):
    """Standard error that never fails: if its disk is full, messages are lost, but the run goes on."""

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
        """Discard what is left in the buffers, and all later output."""
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
