"""Ctrl-C where a library would swallow it."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# SIGTERM and SIGHUP only where somebody handles them in Python, as the command line does
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


@contextmanager
def interrupts_held_back() -> Iterator[None]:
    """Handle the signals of a block at its end; also a decorator.

    CasADi's operators on single symbols lose exceptions that a handler raises inside of them, `KeyboardInterrupt`
    among them. A second signal of the block counts no more than the first. Other threads than the main one never
    handle signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[int] = []
    numbers = [getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)]
    handlers = {number: handler for number in numbers if callable(handler := signal.getsignal(number))}
    try:
        for number in handlers:
            signal.signal(number, lambda number, _frame: held.append(number))
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if held:
            signal.raise_signal(held[0])
