"""Controllers with memory: each member has its own, as in a single run alone; a function that keeps any is found."""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.harness.ensemble.memory import BESIDE, EXPERIMENT, FILE, NAMED, RMS, SHORT, WAYS, Pid
from tests.support.metric_definitions import as_one_number

ARRAYS = ("command", "excess", "feedforward")
LIMITED = {"limits.reference": "warn", "sensors.noise.leg_length": 1e-4}
VARY = ["actuators.lag=0..0.002"]
# Of two chunks of members in two processes.
SHORTEST = {**SHORT, "loop.duration": 0.006, "reference.duration": 0.004, "reference.amplitude_scale": 0.01}


def ensemble(controller: Any, members: int = 2, settings: dict[str, Any] | None = None) -> gs.Ensemble:
    return gs.ensemble(EXPERIMENT, SHORT | (settings or {}), controller=controller, members=members, workers=1)


@pytest.fixture(scope="module")
def among() -> gs.Ensemble:
    """The ensemble of the class in one process, whose member 0 is that of its record to 1e-12."""
    alone = as_one_number(gs.metrics(gs.run(EXPERIMENT, SHORT, controller=Pid, member=0)))
    found = ensemble(Pid, 9)
    assert found.metrics
    for name in found.metrics:
        if alone.get(name) is not None:
            assert found.members[name][0] == pytest.approx(alone[name], rel=1e-12), name
    return found


@pytest.mark.parametrize("way", WAYS)
def test_a_member_has_the_same_bits_among_any_number_and_in_a_search(way: str, among: gs.Ensemble) -> None:
    """Expected: a class, an object and a closure give the same, alone, among 4 and 9, and again in this process."""
    controller = WAYS[way]()
    for members in (4, 1):
        assert ensemble(controller, members).members.equals(among.members.head(members), null_equal=True)
    if way == "object":  # which is copied for each member of each candidate
        options: dict[str, Any] = {"quantile": 1.0, "members": 4, "fresh": 1, "generations": 1, "population": 5}
        found = gs.tune(EXPERIMENT, VARY, RMS, {**SHORT, "actuators.lag": 0.0}, controller=controller, **options)
        assert found.before is not None
        assert found.before.value == among.values(RMS)[:4].max()


def test_a_member_has_the_same_bits_among_600_from_two_processes() -> None:
    """Two chunks of 512 and 88 members in two processes, which get an object of a class that no module has."""
    pytest.importorskip("cloudpickle")
    local = type("Local", (Pid,), {})(gs.load_preset("motion_base"), 1e-3)
    few = gs.ensemble(EXPERIMENT, SHORTEST, controller=Pid, members=4, workers=1)
    many = gs.ensemble(EXPERIMENT, SHORTEST, controller=local, members=600, workers=2)
    assert set(many.members["outcome"]) == {"completed"}
    assert many.members.head(4).equals(few.members, null_equal=True)


def in_file(folder: Path, **keys: str) -> dict[str, Any]:
    """The controllers of the file, with a module beside it."""
    (folder / "pid.py").write_text(FILE)
    (folder / "legs.py").write_text(BESIDE)
    return {"controller": {"type": "python", "file": str(folder / "pid.py"), "feedforward": "computed_torque", **keys}}


@pytest.mark.parametrize("kind", NAMED)
def test_a_python_file_gives_the_same(kind: str, among: gs.Ensemble, tmp_path: Path) -> None:
    """Expected: the bits of the class in Python, twice."""
    settings = in_file(tmp_path, **NAMED[kind])
    for _ in range(2):
        assert ensemble(None, 9, settings).members.equals(among.members, null_equal=True)
    record = gs.run(EXPERIMENT, SHORT | settings, member=3)
    assert as_one_number(gs.metrics(record))[RMS] == pytest.approx(among.values(RMS)[3], rel=1e-12)


def test_a_single_run_is_the_same_twice_and_leaves_the_object_as_it_was() -> None:
    mine = WAYS["object"]()
    mine.integral += 1e-3  # what it starts with, each time
    records = [gs.run(EXPERIMENT, SHORT, controller=mine) for _ in range(2)]
    assert records[0].table.equals(records[1].table)
    assert (mine.integral == 1e-3).all()
    assert mine.before is None
    fresh = gs.run(EXPERIMENT, SHORT, controller=Pid)
    assert not np.array_equal(records[0]["controller.force"][0], fresh["controller.force"][0])


CALLS: list[tuple[int, gs.Sample]] = []
MADE: list[int] = []


class Counts(Pid):
    """Writes down which controller is called with which sample; its arrays are its own, to change without effect."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        MADE.append(1)
        self.number = len(MADE) - 1

    def __call__(self, sample: gs.Sample) -> Any:
        CALLS.append((self.number, sample._replace(**{name: getattr(sample, name).copy() for name in ARRAYS})))
        force = super().__call__(sample)
        for name in ARRAYS:
            getattr(sample, name)[:] = 1e9
        return force


def told(number: int) -> list[gs.Sample]:
    return [sample for who, sample in CALLS if who == number]


@pytest.fixture(autouse=True)
def anew() -> None:
    CALLS.clear()
    MADE.clear()


JITTER = {"loop.plant_step": 2.5e-4, "loop.jitter": 6e-4}


@pytest.mark.parametrize(("members", "settings"), [(1, {}), (9, {}), (3, JITTER)])
def test_each_member_calls_its_own_controller_once_a_sample_in_order(members: int, settings: dict[str, Any]) -> None:
    """Expected: as many controllers as members and 30 calls of each: none for copies; also with jitter."""
    ensemble(Counts, members, settings)
    assert len(MADE) == members
    assert len(CALLS) == 30 * members
    for number in range(members):
        assert [sample.index for sample in told(number)] == list(range(30))
        assert [sample.time for sample in told(number)] == pytest.approx(1e-3 * np.arange(30))


def test_a_controller_that_fails_in_one_member_ends_that_member_alone(among: gs.Ensemble) -> None:
    """The class refuses the third controller that it makes, the fifth fails at its sample 10, and the last one, too."""

    class Fails(Counts):
        def __call__(self, sample: gs.Sample) -> Any:
            if self.number in (4, 8) and sample.index == 10:
                raise ValueError("no tenth")
            return super().__call__(sample)

    def make(platform: gs.Platform, sample_time: float) -> Any:
        law = Fails(platform, sample_time)
        if law.number == 2:
            raise ValueError("no third")
        return law

    found = ensemble(make, 9).members
    assert found["outcome"].to_list() == ["stopped" if k in (2, 4, 8) else "completed" for k in range(9)]
    for member, cause in ((2, "no third"), (4, "no tenth"), (8, "no tenth")):
        assert re.search(rf"{cause} \(.*test_memory\.py, line \d+\)$", found["cause"][member])
    others = [0, 1, 3, 5, 6, 7]
    assert found[others].equals(among.members[others], null_equal=True)


def test_a_sample_tells_what_a_digital_controller_knows() -> None:
    """Expected: the record's own columns, which the loop writes itself; what acts is the command and the excess."""
    multisine = {"type": "multisine", "leg": 2, "amplitude": 50.0, "band": [100.0, 300.0]}
    settings = {**SHORT, **LIMITED, "actuators": {"force_limit": 4200.0}, "injection": multisine}
    nominal = gs.load_preset("motion_base").platform_mass
    for run, member in enumerate((None, 0, 1)):
        record = gs.run(EXPERIMENT, settings, controller=Counts, member=member)
        samples = told(run)
        command, excess, feedforward = (np.array([getattr(s, name) for s in samples]) for name in ARRAYS)
        force = record["controller.force"][:30]
        limited = np.clip(force, -4200, 4200)
        assert (np.abs(limited - force)[:-1] > 1).any()
        assert not command[0].any()
        assert not excess[0].any()
        assert (command[1:] == force[:-1]).all()
        assert excess[1:] == pytest.approx((limited - force)[:-1], abs=1e-9)
        assert (feedforward == record["controller.feedforward"][:30]).all()
        assert [(s.index, s.sample_time) for s in samples] == [(k, 1e-3) for k in range(30)]
        # the nominal model, not the machine
        assert {s.platform.platform_mass for s in samples} == {nominal}
        assert member is None or record.metadata["machine"]["platform_mass"] != nominal


def test_each_member_is_told_what_the_limits_took_off_its_own_command() -> None:
    """Expected: what a controller hears among four is what it hears alone."""
    settings = {**LIMITED, "actuators": {"force_limit": 4200.0, "rate_limit": 5e5}}
    ensemble(Counts, 4, settings)
    for k, member in enumerate((0, 2)):
        gs.run(EXPERIMENT, SHORT | settings, controller=Counts, member=member)
        alone, together = (np.array([sample.excess for sample in told(number)]) for number in (4 + k, member))
        assert np.abs(alone).max() > 1
        assert np.array_equal(alone, together)


def proportional(sample: gs.Sample) -> Any:
    return 8e4 * (sample.reference["leg_length"] - sample.measured["leg_length"])


class Total:
    """Adds up the forces of `proportional`, for a law that keeps it."""

    sum = 0.0

    def __call__(self, sample: gs.Sample) -> Any:
        self.sum = self.sum + proportional(sample)
        return proportional(sample) + 1e-2 * self.sum


def in_a_closure() -> Any:
    total = Total()

    def law(sample: gs.Sample) -> Any:
        return total(sample)

    return law


def in_an_object() -> Any:
    """Copies of the object share the function that it holds."""
    law = in_a_closure()
    return type("Holds", (), {"__call__": lambda self, sample: self.law(sample), "law": staticmethod(law)})()


def late() -> Any:
    """Begins to remember at its last samples."""
    total = Total()
    return lambda sample: total(sample) if sample.index > 26 else proportional(sample)


def from_before() -> Any:
    """Gives a member the error of the one before."""
    before = [np.zeros(6)]

    def law(sample: gs.Sample) -> Any:
        force = proportional(sample)
        last, before[0] = before[0], force
        return force - 0.1 * last

    return law


def in_a_cause() -> Any:
    """Members end at the same sample with the same numbers, but for other reasons."""
    numbers, none = iter(range(9)), dict[int, Any]()
    return lambda sample: proportional(sample) if sample.index < 10 else none[next(numbers)]


REFUSED = r"first member gave other results when it ran again \(.*keeps memory, which all members share; use a factory"


@pytest.mark.parametrize("make", [in_a_closure, in_an_object, late, from_before, in_a_cause])
def test_a_function_with_memory_is_refused_wherever_it_keeps_it(make: Callable[[], Any]) -> None:
    with pytest.raises(gs.GoughStewartError, match=REFUSED):
        ensemble(make())


def test_memory_is_found_in_a_search_in_a_file_of_one_member_and_in_other_processes(tmp_path: Path) -> None:
    with pytest.raises(gs.GoughStewartError, match=REFUSED):
        gs.tune(EXPERIMENT, VARY, RMS, SHORT, controller=from_before(), members=1, population=5)
    with pytest.raises(gs.GoughStewartError, match=REFUSED):
        ensemble(None, 2, in_file(tmp_path, name="in_globals"))
    with pytest.raises(gs.GoughStewartError, match=REFUSED):
        ensemble(in_a_closure(), 1)
    pytest.importorskip("cloudpickle")
    with pytest.raises(gs.GoughStewartError, match=REFUSED):
        gs.ensemble(EXPERIMENT, SHORTEST, controller=in_a_closure(), members=600, workers=2)


def test_memory_that_changes_no_result_is_allowed() -> None:
    """Expected: 30 calls of 3 members and of the first again."""
    calls = list[int]()

    def counting(sample: gs.Sample) -> Any:
        calls.append(sample.index)
        return proportional(sample)

    assert ensemble(counting, 3).members["outcome"].to_list() == ["completed"] * 3
    assert calls == [k for k in range(30) for _ in range(3)] + list(range(30))


@pytest.mark.parametrize("only", [WAYS["object"](), proportional])
def test_a_factory_that_gives_the_same_object_twice_is_refused(only: Any) -> None:
    said = r"members 0 and 1 got the same (object of class Pid|proportional\(\))"
    with pytest.raises(gs.GoughStewartError, match=said):
        ensemble(lambda _platform, _sample_time: only)


def test_linear_controllers_of_a_factory_may_be_the_same_but_not_of_different_structure() -> None:
    """Expected: the ensemble of the linear controller itself, whose states are the loop's."""
    pid, pd = (gs.sampled(gs.pid(gs.Gains(2e4, 500.0, integral)), 1e-3) for integral in (100.0, 0.0))
    assert ensemble(lambda _platform, _sample_time: pid).members.equals(ensemble(pid).members, null_equal=True)
    both = [pd, pid]
    said = r"different structure, linear in .* 12 states, 18 inputs .* 6 states"
    with pytest.raises(gs.GoughStewartError, match=said):
        ensemble(lambda _platform, _sample_time: both.pop())


def test_what_cannot_be_copied_or_passed_or_varied_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    held = WAYS["object"]()
    held.numbers = (k for k in range(3))
    for call in (gs.run, gs.ensemble):
        with pytest.raises(gs.GoughStewartError, match=r"object of class Pid cannot be copied .* use a factory"):
            call(EXPERIMENT, SHORT, controller=held)
    with pytest.raises(gs.GoughStewartError, match=r"controller\.bandwidth: has no effect, since controller="):
        gs.tune(EXPERIMENT, ["controller.bandwidth=1..3Hz"], RMS, SHORT, controller=Pid, members=2)
    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    with pytest.raises(gs.GoughStewartError, match=r"cannot be passed .* install cloudpickle.* workers=1"):
        gs.ensemble(EXPERIMENT, SHORTEST, controller=lambda _sample: np.zeros(6), members=600, workers=2)
