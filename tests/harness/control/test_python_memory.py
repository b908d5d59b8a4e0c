"""Memory of controllers in Python, as ensembles see it: where functions may hide, and what is none of it."""

import threading
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.errors import ControllerError, ExperimentError, SharedMemoryError
from gough_stewart.model.vectors import FloatArray
from tests.support.memory import EXPERIMENT, SHORT

REST = {**SHORT, "loop.duration": 0.008}
ZERO = np.zeros(6)


def ensemble_of(controller: Any, **settings: Any) -> gs.Ensemble:
    return gs.ensemble(EXPERIMENT, REST | settings, controller=controller, members=2, workers=1)


def counting() -> Callable[..., FloatArray]:
    """A law that keeps something in a closure, which a copy of its holder shares."""
    calls = 0

    def law(_sample: gs.Sample, *_: object, **__: object) -> FloatArray:
        nonlocal calls
        calls += 1
        return ZERO

    return law


class Holder:
    """Calls a function that it reaches through what it holds."""

    def __init__(self, held: Any, reach: Callable[[Any], Any]) -> None:
        self.held, self.reach = held, reach

    def __call__(self, sample: gs.Sample) -> FloatArray:
        return np.asarray(self.reach(self.held)(sample))

    def step(self, sample: gs.Sample) -> FloatArray:
        return self(sample)


def first(held: Any) -> Any:
    return next(iter(held))


HOLDERS: dict[str, Callable[[], Any]] = {
    "attribute": lambda: Holder(counting(), lambda held: held),
    "list": lambda: Holder([None, counting()], lambda held: held[1]),
    "tuple": lambda: Holder((0, counting()), lambda held: held[-1]),
    "set": lambda: Holder({counting()}, first),
    "dictionary": lambda: Holder({"a": 1, "b": counting()}, lambda held: held["b"]),
    "object": lambda: Holder(SimpleNamespace(a=SimpleNamespace(law=counting())), lambda held: held.a.law),
    "partial": lambda: Holder(partial(counting(), 3), lambda held: held),
    "argument": lambda: Holder(partial(lambda law, sample: law(sample), counting()), lambda held: held),
    "keyword": lambda: Holder(partial(lambda sample, law: law(sample), law=counting()), lambda held: held),
    "method": lambda: Holder([counting()], first).step,
}


@pytest.mark.parametrize("where", HOLDERS)
def test_a_function_with_memory_is_found_wherever_an_object_holds_it(where: str) -> None:
    with pytest.raises(SharedMemoryError, match=r"counting\.<locals>\.law\(\) keeps memory between samples: .*'calls'"):
        ensemble_of(HOLDERS[where]())


class Itself:
    """Refers to itself, to a module, to a class, to the nominal platform, and to what cannot be told from others."""

    tool = threading  # its functions and their globals change all the time

    def __init__(self) -> None:
        self.me, self.module, self.kind, self.platform = self, np, Holder, gs.load_preset("motion_base")
        self.total = np.zeros(6)

    def __deepcopy__(self, _memo: object) -> "Itself":
        return Itself()

    def __call__(self, sample: gs.Sample) -> FloatArray:
        self.total = self.total + 1e-3 * sample.reference["leg_length"]
        return self.total


def factorial(n: int) -> int:
    return 1 if n < 2 else n * factorial(n - 1)


def even(n: int) -> bool:
    return n == 0 or odd(n - 1)


def odd(n: int) -> bool:
    return n > 0 and even(n - 1)


LOCK = threading.Lock()  # which cannot be pickled


def harmless(sample: gs.Sample, offset: float = 2.0, *, factor: float = 3.0) -> FloatArray:
    """Names functions that call themselves and each other, modules, classes, constants, and a lock."""
    with LOCK:
        return np.full(6, factor * offset * factorial(3) * even(sample.index) + len(HOLDERS))


def unbound() -> Callable[..., FloatArray]:
    """Has a closure variable that is never bound."""

    def law(_sample: gs.Sample) -> FloatArray:
        return ZERO if True else later

    if ZERO.any():
        later = 1.0
    return law


@pytest.mark.parametrize("controller", [Itself(), harmless, unbound()], ids=["object", "function", "unbound"])
def test_what_keeps_no_memory_of_its_own_runs(controller: Any) -> None:
    """Expected: no alarm of cycles, modules, classes, platforms, constants, recursion, or what cannot be pickled."""
    assert ensemble_of(controller).members["outcome"].to_list() == ["completed"] * 2


def test_memory_in_helpers_of_the_same_module_is_found_through_functions_that_call_each_other() -> None:
    """Expected: the global by its name, two calls away."""
    with pytest.raises(SharedMemoryError, match=r"through_two\(\) keeps memory between samples: the global 'SEEN' has"):
        ensemble_of(through_two)


SEEN = [0]


def through_two(sample: gs.Sample) -> FloatArray:
    return _one(sample, 2)


def _one(sample: gs.Sample, left: int) -> FloatArray:
    return _two(sample, left)


def _two(sample: gs.Sample, left: int) -> FloatArray:
    SEEN[0] += 1
    return ZERO if left == 0 else _one(sample, left - 1)


def test_factories_that_fail_for_some_members_end_those_alone() -> None:
    """Expected: the third of four makes nothing; the last, whose copies fill the vector, neither."""
    made = list[int]()

    def make(_platform: gs.Platform, sample_time: float) -> Any:
        made.append(len(made))
        if made[-1] in (2, 3):
            raise RuntimeError(f"no number {made[-1]}")
        return gs.sampled(gs.pid(gs.Gains(2e4 + made[-1], 500.0)), sample_time)

    found = gs.ensemble(EXPERIMENT, REST, controller=make, members=4, workers=1)
    assert found.members["outcome"].to_list() == ["completed", "completed", "stopped", "stopped"]
    causes = found.members["cause"].to_list()
    assert causes[:2] == [None, None]
    for k in (2, 3):
        assert causes[k].endswith(f"make() failed with RuntimeError: no number {k}")


def test_factories_of_different_structure_are_refused_by_what_they_made() -> None:
    made = list[int]()

    def make(_platform: gs.Platform, sample_time: float) -> Any:
        made.append(0)
        gains = gs.Gains(2e4, 500.0, 100.0 if len(made) > 1 else 0.0)
        return gs.sampled(gs.pid(gains), sample_time)

    message = (
        r"controllers of different structure, linear in leg space with 12 states, 18 inputs and the signals "
        r"leg_length; linear in leg space with 6 states, 12 inputs and the signals leg_length; expected one for all"
    )
    with pytest.raises(ControllerError, match=message):
        gs.ensemble(EXPERIMENT, REST, controller=make, members=2, workers=1)


def test_a_linear_controller_shared_by_a_factory_is_no_shared_memory() -> None:
    """Expected: its states are the loop's, so that the same object serves all; functions without memory do, too."""
    same = gs.sampled(gs.pid(gs.Gains(2e4, 500.0)), 1e-3)
    for shared in (same, harmless):
        found = ensemble_of(lambda _platform, _sample_time, shared=shared: shared)
        assert found.members["outcome"].to_list() == ["completed"] * 2


def test_a_shared_function_with_memory_from_a_factory_is_refused() -> None:
    law = counting()
    with pytest.raises(SharedMemoryError, match="closure variable 'calls'"):
        ensemble_of(lambda _platform, _sample_time: law)


def test_what_cannot_be_called_with_its_parameters_is_refused() -> None:
    """Expected: the signature, or the keyword that is missing, also one that only a name can give."""

    def three(_a: object, _b: object, _c: object, /) -> None: ...

    def one_more(platform: gs.Platform, sample_time: float, gain: float) -> None: ...

    def by_name(platform: gs.Platform, sample_time: float, *, gain: float, **rest: float) -> None: ...

    missing = r"accepts gain; missing gain, add it to \[controller\.parameters\]"
    for controller, message in (
        (
            three,
            r"takes \(_a: object, .*, /\).*; expected a function of one Sample, or a class or factory called as make\(",
        ),
        (one_more, missing),
        (by_name, missing),
    ):
        with pytest.raises(gs.GoughStewartError, match=message):
            gs.run(EXPERIMENT, REST, controller=controller)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"gian": 1.0}, r"parameters: .*make\(\) accepts gain, also; found 'gian'; did you mean 'gain'\?"),
        ({"gain": 1.0, "platform": 1.0}, r"parameters: .*make\(\) accepts gain, also; found 'platform'"),
        (
            {"also": 1.0},
            r"parameters: .*make\(\) accepts gain, also; missing gain, add it to \[controller\.parameters\]",
        ),
    ],
)
def test_parameters_that_a_factory_does_not_take_are_named(parameters: dict[str, float], message: str) -> None:
    def make(_platform: gs.Platform, _sample_time: float, gain: float, also: float = 0.0) -> Any:
        return lambda _sample: np.full(6, gain + also)

    settings = {"controller": {"type": "python", "parameters": parameters}}
    with pytest.raises(gs.GoughStewartError, match=message):
        gs.run(EXPERIMENT, REST | settings, controller=make)


def test_a_factory_with_free_keywords_takes_all_but_its_own_names() -> None:
    def make(platform: gs.Platform, sample_time: float, **numbers: float) -> Any:  # noqa: ARG001
        return lambda _sample: np.full(6, sum(numbers.values()))

    settings = {"controller": {"type": "python", "parameters": {"a": 3.0, "b": 4.0}}}
    assert gs.run(EXPERIMENT, REST | settings, controller=make)["controller.force"][0].tolist() == [7.0] * 6
    settings = {"controller": {"type": "python", "parameters": {"a": 3.0, "platform": 4.0}}}
    with pytest.raises(ExperimentError, match=r"make\(\) accepts no parameters; found 'platform'"):
        gs.run(EXPERIMENT, REST | settings, controller=make)


@pytest.mark.parametrize(
    ("force", "message"),
    [
        ([1.0] * 5, r"returned \[1\.0, 1\.0, 1\.0, 1\.0, 1\.0\] at time 0 s; expected 6 forces"),
        (np.ones((6, 1)), "expected 6 forces"),
        (["1"] * 6, "expected 6 forces"),
        ([1j] * 6, "expected 6 forces"),
        ([True] * 6, "expected 6 forces"),
        ([[1.0], [1.0, 2.0]], "expected 6 forces"),
        (None, "returned None at time 0 s; expected 6 forces"),
    ],
)
def test_what_is_not_six_forces_is_refused(force: Any, message: str) -> None:
    with pytest.raises(gs.GoughStewartError, match=message):
        gs.run(EXPERIMENT, REST, controller=lambda _sample: force)


def test_what_has_no_signature_is_tried_and_its_failure_told() -> None:
    """Expected: built-in classes and functions, of which Python does not know what they take."""
    with pytest.raises(
        gs.GoughStewartError, match=r"class dict failed with TypeError: dict expected at most 1 argument"
    ):
        gs.run(EXPERIMENT, REST, controller=dict)
    with pytest.raises(gs.GoughStewartError, match=r"the control function failed at time 0 s with (Type|Value)Error"):
        gs.run(EXPERIMENT, REST, controller=max)


def test_integers_are_forces() -> None:
    for force in ([1, 2, 3, 4, 5, 6], np.arange(1, 7, dtype=np.uint8), tuple(np.arange(1.0, 7))):
        record = gs.run(EXPERIMENT, REST, controller=lambda _sample, force=force: force)
        known = record["controller.feedforward"][0]
        assert record["controller.force"][0] - known == pytest.approx(np.arange(1.0, 7), abs=1e-9)
