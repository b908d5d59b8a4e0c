"""Entry point of the console script; it imports little, so that interrupts are handled from the start."""

# only modules that Python has loaded already, or loads in a moment
import _thread
import gc
import io
import os
import signal
import sys
import time
from types import FrameType

from gough_stewart.harness.cli import ExitCode


class _Interrupts:
    """Turns Ctrl-C, SIGTERM and SIGHUP into `KeyboardInterrupt`, where that is safe.

    While modules load, extension modules turn it into errors of their own, and in a finaliser it is lost; there the
    signal comes again a little later. Before `main` it waits, after `main` it has no effect.
    """

    _AGAIN = 0.02  # [s]
    _PATIENCE = 10.0  # longer than any import here; then the import is interrupted [s]

    def __init__(self) -> None:
        self.begun = self.ended = False
        self._since: float | None = None  # the first signal that waits
        self._main = _thread.get_ident()

    def watch(self, *names: str) -> None:
        """Handle these signals, except those with handlers of others, such as nohup's."""
        for name in names:
            number = getattr(signal, name, None)
            if number is None or signal.getsignal(number) not in (signal.SIG_DFL, signal.default_int_handler):
                continue
            try:
                signal.signal(number, self._handle)
            except ValueError:  # not the main thread, which has no signals
                return

    def lost(self, unraisable: "sys.UnraisableHookArgs") -> None:
        """For `sys.unraisablehook`: an interrupt that nobody can catch comes again."""
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            self._later(signal.SIGINT)
        else:
            sys.__unraisablehook__(unraisable)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.ended:
            return
        now = time.monotonic()
        self._since = self._since or now
        # whether the import system is at work, within `main`
        is_importing = False
        while frame is not None and frame.f_code is not main.__code__ and not is_importing:
            is_importing = frame.f_code.co_filename.startswith("<frozen importlib")
            frame = frame.f_back
        if (not self.begun or is_importing) and now - self._since < self._PATIENCE:
            self._later(number)
            return
        self._since = None
        raise KeyboardInterrupt

    def _later(self, number: int) -> None:
        def again() -> None:
            time.sleep(self._AGAIN)
            if hasattr(signal, "pthread_kill"):
                signal.pthread_kill(self._main, number)  # wakes a call that waits, too
            else:
                _thread.interrupt_main(signal.Signals(number))

        _thread.start_new_thread(again, ())


_interrupts = _Interrupts()
_interrupts.watch("SIGINT")


def main() -> None:  # noqa: PLR0912, PLR0915 - one road, in sections
    """Run the command line; Ctrl-C, SIGTERM, SIGHUP and a full output stream give one line each."""
    code: str | int | None = 0
    is_interrupted = False
    try:
        try:
            sys.unraisablehook = _interrupts.lost
            # closed standard streams lead nowhere: the next file that is opened would take their place
            for descriptor, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
                try:
                    os.fstat(descriptor)
                except OSError:
                    os.open(os.devnull, os.O_RDWR)  # the lowest free descriptor
                if getattr(sys, name) is None:
                    stream = os.fdopen(descriptor, mode, encoding="utf-8", errors="replace", closefd=False)
                    setattr(sys, name, stream)
            # start again in UTF-8 mode where the locale is ASCII, in which names with umlauts cannot be written
            is_ascii = os.name == "posix" and sys.getfilesystemencoding().lower() == "ascii"
            if is_ascii and os.environ.get("PYTHONUTF8") != "1":
                os.environ["PYTHONUTF8"] = "1"
                os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])
            # a terminal without Greek shows question marks instead of a traceback
            if isinstance(sys.stdout, io.TextIOWrapper):
                sys.stdout.reconfigure(errors="replace")
            if isinstance(sys.stderr, io.TextIOWrapper):
                encoding = sys.stderr.encoding
                sys.stderr = _ErrorStream(sys.stderr.detach(), encoding, "replace", line_buffering=True)
            # these end the process like Ctrl-C: keep rows, remove temporary files, end compilers
            _interrupts.watch("SIGTERM", "SIGHUP")
            _interrupts.begun = True
            from gough_stewart.harness.cli import app

            # imports and figures create many objects that live to the end; collection would scan them often
            gc.set_threshold(200_000, 30, 30)
            app.app()
        finally:
            _interrupts.ended = True
    except SystemExit as ended:
        code = ended.code
        # Typer exits silently if it is itself interrupted
        is_interrupted = isinstance(getattr(ended.__context__, "__cause__", None), KeyboardInterrupt)
    except KeyboardInterrupt as interrupt:
        # an interrupt of the very end changes nothing
        if isinstance(interrupt.__context__, SystemExit):
            code = interrupt.__context__.code
        else:
            code, is_interrupted = ExitCode.INTERRUPTED, True
    except OSError as error:  # the help cannot be printed
        print(f"error: {error.strerror or error}", file=sys.stderr, flush=True)
        code = ExitCode.FAILED
    if is_interrupted:  # outside of a command, whose files may be written already
        command = sys.modules.get("gough_stewart.harness.cli.command")
        place = "nothing written" if command is None else command.Command.latest.whereabouts()
        print(f"interrupted; {place}", file=sys.stderr, flush=True)

    # the end of the process, which no signal disturbs, nor a last garbage collection of up to half a second
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    gc.freeze()
    try:
        sys.stdout.flush()
    except OSError as error:  # results that could not be printed; Python would end with a traceback
        print(f"error: standard output: {error.strerror or error}", file=sys.stderr, flush=True)
        _lead_nowhere(sys.stdout.fileno())
        code = code or ExitCode.FAILED
    sys.exit(code)


def _lead_nowhere(descriptor: int) -> None:
    """Discard what is left in the buffers of a stream, and all later output."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)


class _ErrorStream(io.TextIOWrapper):
    """Standard error that never fails: if its disk is full, messages are lost, but the run goes on."""

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError:
            _lead_nowhere(self.fileno())
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError:
            _lead_nowhere(self.fileno())
