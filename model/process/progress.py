"""Long computations: callbacks of their progress, and Ctrl-C while a library runs that would lose it."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# Called with the simulation time [s].
TimeProgress = Callable[[float], None]
# Called with the name of the step that begins.
StepProgress = Callable[[str], None]


# SIGTERM and SIGHUP only if they have a Python handler, as in the command line
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


@contextmanager
def interrupts_held_back() -> Iterator[None]:
    """Defer signals to the end of a block; also a decorator.

    CasADi's operators lose exceptions that a signal handler raises in them, such as `KeyboardInterrupt`. Several
    signals in one block count as one.
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
