"""Ctrl-C while CasADi traces the equations."""

import signal
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from gough_stewart.model import traced
from gough_stewart.model.process.progress import interrupts_held_back


@pytest.fixture(autouse=True)
def _handlers() -> Iterator[None]:
    """As they were before the test."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGALRM)
    before = [signal.getsignal(number) for number in numbers]
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


def interrupting(call: Callable[[], Any], delay: float) -> bool:
    """Whether an interrupt after some time comes out of a call that takes longer."""
    sent: list[float] = []

    def send(_number: int, _frame: object) -> None:
        sent.append(delay)
        signal.raise_signal(signal.SIGINT)

    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGALRM, send)
    try:
        signal.setitimer(signal.ITIMER_REAL, delay)
        call()
        signal.setitimer(signal.ITIMER_REAL, 0)
    except KeyboardInterrupt:
        return True
    return not sent


def test_ctrl_c_while_the_equations_are_traced_is_not_swallowed() -> None:
    """Expected: every one arrives; CasADi lost two of three."""
    assert all(interrupting(lambda: traced.traced_function.__wrapped__("legs"), 0.006 * (k + 1)) for k in range(8))


def test_of_several_signals_of_a_block_the_first_is_handled_and_handlers_are_back_after_an_error() -> None:
    """Expected: SIGTERM, which came first; an error of the block comes out, with the handlers as they were."""
    handled = list[int]()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with interrupts_held_back():  # what nobody handles in Python stays as it is
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, _frame: handled.append(number))
    handler = signal.getsignal(signal.SIGHUP)
    with interrupts_held_back():
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.raise_signal(number)
    assert handled == [signal.SIGTERM]
    with pytest.raises(ZeroDivisionError), interrupts_held_back():
        raise ZeroDivisionError
    assert signal.getsignal(signal.SIGHUP) is handler
    signal.raise_signal(signal.SIGINT)
    assert handled == [signal.SIGTERM, signal.SIGINT]
