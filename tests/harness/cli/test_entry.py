"""The entry point piece by piece: what a signal does at which time, and streams that are closed or full."""

import _thread
import errno
import io
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any

import pytest

from gough_stewart.harness.cli import app, command, entry

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and streams of POSIX")


class Patient(entry._Interrupts):
    """Notes a signal that is to come again instead of sending it."""

    def __init__(self) -> None:
        super().__init__()
        self.again: list[int] = []

    def _later(self, number: int) -> None:
        self.again.append(number)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A time that the test sets [s]."""
    now = SimpleNamespace(value=1000.0)
    monkeypatch.setattr("gough_stewart.harness.cli.entry.time.monotonic", lambda: now.value)
    return now


@pytest.fixture(autouse=True)
def _signals_as_before() -> Iterator[None]:
    names = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(name) for name in names]
    hook = sys.unraisablehook
    yield
    for name, handler in zip(names, before, strict=True):
        signal.signal(name, handler)
    sys.unraisablehook = hook


def frame(*files: str) -> FrameType:
    """A stack of these files, the innermost first."""
    made: Any = None
    for file in reversed(files):
        code = entry.main.__code__ if file == "main" else SimpleNamespace(co_filename=file)
        made = SimpleNamespace(f_code=code, f_back=made)
    return made  # type: ignore[no-any-return]


def test_a_signal_waits_before_the_start_and_while_modules_load(clock: SimpleNamespace) -> None:
    """Expected: it comes again up to ten seconds after the first; then, or in the command's own code, it interrupts.

    Imports outside of the entry point do not count, nor does anything after the end.
    """
    inside, beside = frame("a.py", "<frozen importlib._bootstrap>", "main"), frame("a.py", "main")
    begun = Patient()
    begun.begun = True
    with pytest.raises(KeyboardInterrupt):
        begun._handle(signal.SIGINT, beside)
    begun._handle(signal.SIGTERM, inside)
    clock.value += 9.9
    begun._handle(signal.SIGHUP, inside)
    assert begun.again == [signal.SIGTERM, signal.SIGHUP]
    clock.value += 0.2
    with pytest.raises(KeyboardInterrupt):
        begun._handle(signal.SIGTERM, inside)
    begun._handle(signal.SIGTERM, inside)  # a new one waits again
    assert len(begun.again) == 3
    with pytest.raises(KeyboardInterrupt):
        begun._handle(signal.SIGTERM, frame("a.py", "main", "<frozen importlib._bootstrap>"))
    early = Patient()
    early._handle(signal.SIGINT, beside)
    assert early.again == [signal.SIGINT]
    begun.ended = True
    begun._handle(signal.SIGINT, beside)
    assert len(begun.again) == 3


def test_only_default_handlers_are_replaced() -> None:
    """Expected: a handler of another and an ignored signal stay, as after nohup; an unknown name is passed over."""
    own = Patient()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    own.watch("SIGNOTHING", "SIGINT", "SIGHUP", "SIGTERM")
    assert signal.getsignal(signal.SIGINT) == own._handle
    assert signal.getsignal(signal.SIGTERM) == own._handle
    assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    Patient().watch("SIGINT")
    assert signal.getsignal(signal.SIGINT) == own._handle
    own.ignore()
    assert own.ended
    handlers = {signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    assert handlers == {signal.SIG_IGN}


def test_a_thread_of_its_own_has_no_signals() -> None:
    """Expected: no error where the entry point is imported outside of the main thread."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    errors: list[BaseException] = []
    done = _thread.allocate_lock()
    done.acquire()

    def watch() -> None:
        try:
            Patient().watch("SIGINT")
        except BaseException as error:
            errors.append(error)
        done.release()

    _thread.start_new_thread(watch, ())
    assert done.acquire(timeout=30)
    assert errors == []
    assert signal.getsignal(signal.SIGINT) == signal.default_int_handler


def test_an_interrupt_that_is_lost_comes_again_and_other_errors_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    own = Patient()

    def lost(error: BaseException) -> Any:
        values = {"exc_type": type(error), "exc_value": error, "exc_traceback": None, "err_msg": None, "object": None}
        return SimpleNamespace(**values)

    own.lost(lost(KeyboardInterrupt()))
    assert own.again == [signal.SIGINT]
    with pytest.MonkeyPatch.context() as patch:
        shown: list[Any] = []
        patch.setattr(sys, "__unraisablehook__", shown.append)
        own.lost(lost(ValueError("x")))
    assert [type(each.exc_value) for each in shown] == [ValueError]
    assert own.again == [signal.SIGINT]
    assert capsys.readouterr().err == ""


def test_a_signal_comes_again_in_the_main_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the same signal, sent to the thread that made the handler, after a moment."""
    sent: list[tuple[int, int]] = []
    slept: list[float] = []
    monkeypatch.setattr(
        "gough_stewart.harness.cli.entry._thread.start_new_thread", lambda function, given: function(*given)
    )
    monkeypatch.setattr(signal, "pthread_kill", lambda thread, number: sent.append((thread, number)))
    monkeypatch.setattr("gough_stewart.harness.cli.entry.time.sleep", slept.append)
    entry._Interrupts()._later(signal.SIGTERM)
    assert sent == [(_thread.get_ident(), signal.SIGTERM)]
    assert slept == [0.02]
    monkeypatch.delattr(signal, "pthread_kill")
    monkeypatch.setattr(
        "gough_stewart.harness.cli.entry._thread.interrupt_main", lambda number: sent.append((0, number))
    )
    entry._Interrupts()._later(signal.SIGHUP)
    assert sent[1:] == [(0, signal.SIGHUP)]


def ended(monkeypatch: pytest.MonkeyPatch, act: Any) -> tuple[Any, str]:
    """The exit code of the entry point around this command line, without its effects on this process; its messages."""
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(written, encoding="utf-8"))
    monkeypatch.setattr(entry, "_interrupts", Patient())
    monkeypatch.setattr(Patient, "ignore", lambda _: None)
    monkeypatch.setattr(entry, "_open_streams", lambda: None)
    monkeypatch.setattr(app, "main", act)
    monkeypatch.setattr("gc.freeze", lambda: None)
    with pytest.raises(SystemExit) as caught:
        entry.main()
    assert isinstance(sys.stderr, entry._ErrorStream)
    return caught.value.code, written.getvalue().decode()


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (None, 0, ""),
        (SystemExit(3), 3, ""),
        (KeyboardInterrupt(), 130, "interrupted; nothing written\n"),
        (OSError(errno.ENOSPC, "No space left on device"), 1, "error: No space left on device\n"),
        (OSError("only words"), 1, "error: only words\n"),
    ],
)
def test_how_a_command_line_ends(
    error: BaseException | None, code: int, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def act() -> None:
        command._latest[:] = [command.Command()]
        if error is not None:
            raise error

    assert ended(monkeypatch, act) == (code, said)
    own: Any = entry._interrupts
    assert (own.begun, own.ended) == (True, True)


def test_an_interrupt_during_the_end_keeps_the_code_and_one_within_typer_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def late() -> None:
        try:
            sys.exit(3)
        except SystemExit:
            raise KeyboardInterrupt  # noqa: B904

    assert ended(monkeypatch, late) == (3, "")

    def within() -> None:
        command._latest[:] = [command.Command(written=[tmp_path])]
        try:
            try:
                signal.default_int_handler(signal.SIGINT, None)
            except KeyboardInterrupt as interrupt:
                raise RuntimeError from interrupt
        except RuntimeError:
            raise SystemExit(130)  # noqa: B904

    assert ended(monkeypatch, within) == (130, f"interrupted; the files are in {tmp_path}\n")
    monkeypatch.delitem(sys.modules, "gough_stewart.harness.cli.command")
    assert entry._whereabouts() == "interrupted; nothing written"


class Full(io.StringIO):
    """A stream whose disk is full."""

    def flush(self) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    def fileno(self) -> int:
        return 99


@pytest.mark.parametrize(("code", "expected"), [(0, 1), (None, 1), (3, 3)])
def test_results_that_cannot_be_printed_are_a_failure(
    code: int | None, expected: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: one line, the worse of both codes, and the rest of the buffer discarded."""
    calls: list[tuple[int, int]] = []
    monkeypatch.setattr(Patient, "ignore", lambda _: calls.append((0, 0)))
    monkeypatch.setattr(entry, "_interrupts", Patient())
    monkeypatch.setattr("gc.freeze", lambda: None)
    monkeypatch.setattr(sys, "stdout", Full())
    monkeypatch.setattr(os, "open", lambda path, flags: (path, flags) == (os.devnull, os.O_WRONLY) and 77)
    monkeypatch.setattr(os, "dup2", lambda one, other: calls.append((one, other)))
    assert entry._flushed(code) == expected
    assert calls == [(0, 0), (77, 99)]
    assert capsys.readouterr().err == "error: standard output: No space left on device\n"
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    assert entry._flushed(code) is code


def test_a_command_starts_again_in_utf_8_only_where_the_locale_has_ascii(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the same words to the same interpreter, once; not again if that did not help."""
    started: list[Any] = []
    monkeypatch.setattr(os, "execv", lambda program, words: started.append((program, words)))
    monkeypatch.setattr(sys, "orig_argv", ["python", "-m", "gough_stewart", "run", "x"])
    monkeypatch.delenv("PYTHONUTF8", raising=False)
    for encoding in ("utf-8", "latin-1"):
        monkeypatch.setattr(sys, "getfilesystemencoding", lambda encoding=encoding: encoding)
        entry._speak_utf8()
    assert started == []
    monkeypatch.setattr(sys, "getfilesystemencoding", lambda: "ASCII")
    monkeypatch.setenv("PYTHONUTF8", "0")
    entry._speak_utf8()
    assert os.environ["PYTHONUTF8"] == "1"
    entry._speak_utf8()
    assert started == [(sys.executable, [sys.executable, "-m", "gough_stewart", "run", "x"])]


def test_closed_streams_lead_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: of input and errors, which are closed here: descriptors to the null device, and streams on them."""
    opened: list[Any] = []
    made: list[Any] = []

    def fstat(descriptor: int) -> None:
        if descriptor != 1:
            raise OSError(errno.EBADF, "closed")

    def fdopen(number: int, mode: str, **given: Any) -> int:
        made.append((number, mode, given))
        return number

    before = sys.stdout
    with monkeypatch.context() as patch:
        patch.setattr(os, "fstat", fstat)
        patch.setattr(os, "open", lambda *given: opened.append(given))
        patch.setattr(os, "fdopen", fdopen)
        patch.setattr(sys, "stdin", None)
        patch.setattr(sys, "stderr", None)
        entry._open_streams()
        streams = sys.stdin, sys.stdout, sys.stderr
    assert opened == [(os.devnull, os.O_RDWR)] * 2
    options = {"encoding": "utf-8", "errors": "replace", "closefd": False}
    assert made == [(0, "r", options), (2, "w", options)]
    assert streams == (0, before, 2)


def test_messages_on_a_full_disk_are_lost_without_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: their length as if written, and everything after them to the null device; line by line before that."""

    class Raw(io.RawIOBase):
        fails = False
        taken = b""

        def writable(self) -> bool:
            return True

        def fileno(self) -> int:
            return 98

        def write(self, data: Any) -> int:
            if Raw.fails:
                raise OSError(errno.ENOSPC, "No space left on device")
            Raw.taken += bytes(data)
            return len(data)

    calls: list[tuple[int, int]] = []
    stream = entry._ErrorStream(io.TextIOWrapper(io.BufferedWriter(Raw()), encoding="latin-1"))
    assert stream.encoding == "latin-1"
    assert stream.write("ü α\n") == 4
    assert Raw.taken == "ü ?\n".encode("latin-1")
    monkeypatch.setattr(os, "open", lambda path, flags: (path, flags) == (os.devnull, os.O_WRONLY) and 55)
    monkeypatch.setattr(os, "dup2", lambda one, other: calls.append((one, other)))
    Raw.fails = True
    assert stream.write("lost\n") == 5
    stream.flush()
    assert calls
    assert set(calls) == {(55, 98)}
    Raw.fails = False
    stream.flush()
