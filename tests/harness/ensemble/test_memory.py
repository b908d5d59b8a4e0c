"""Controllers with memory: each member of each run has its own.

Expected everywhere: what the member gives alone, run by the loop of a single run. That a fresh controller is called
once a sample, in order, is counted by controllers that write down each call.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.ensemble import ensemble as runner
from gough_stewart.harness.errors import ControllerError, ExperimentError, SharedMemoryError
from gough_stewart.harness.results.metrics import flattened, metrics
from tests.support.memory import BESIDE, EXPERIMENT, FILE, NAMED, RMS, SHORT, WAYS, Pid, factory

N = 16
ARRAYS = ("command", "excess", "feedforward")


def row(found: gs.Ensemble, member: int = 0) -> Mapping[str, Any]:
    """All that the table says of a member."""
    return found.members.row(member, named=True)


@pytest.fixture(scope="module")
def alone() -> Mapping[str, float | None]:
    """The metrics of member 0, from its record."""
    return flattened(metrics(gs.run(EXPERIMENT, SHORT, controller=Pid, member=0)))


@pytest.fixture(scope="module")
def among(alone: Mapping[str, float | None]) -> gs.Ensemble:
    """The ensemble of the class in one process, whose member 0 is that of its record to 1e-12."""
    found = gs.ensemble(EXPERIMENT, SHORT, controller=Pid, members=N, workers=1)
    for name, value in row(found).items():
        if alone.get(name) is not None and name in found.metrics:
            assert value == pytest.approx(alone[name], rel=1e-12), name
    assert found.metrics
    return found


@pytest.mark.parametrize("way", WAYS)
def test_a_member_has_the_same_bits_among_any_number(way: str, among: gs.Ensemble) -> None:
    """Expected: a class, an object and a closure give the same, alone, among 4 and 8, and again in this process."""
    controller = WAYS[way]()
    for members in (1, 4, 8, 4):
        found = gs.ensemble(EXPERIMENT, SHORT, controller=controller, members=members, workers=1)
        assert found.members.equals(among.members.head(members), null_equal=True)


def test_a_member_has_the_same_bits_among_600_from_two_processes() -> None:
    """Two chunks of 512 and 88 members in two processes, which get an object of a class that no module has."""
    pytest.importorskip("cloudpickle")

    class Local(Pid):
        pass

    short = {**SHORT, "loop.duration": 0.006, "reference.duration": 0.004, "reference.amplitude_scale": 0.01}
    few = gs.ensemble(EXPERIMENT, short, controller=Pid, members=4, workers=1)
    local = Local(gs.load_preset("motion_base"), 1e-3)
    many = gs.ensemble(EXPERIMENT, short, controller=local, members=600, workers=2)
    assert set(many.members["outcome"]) == {"completed"}
    assert many.members.head(4).equals(few.members, null_equal=True)


def test_what_cannot_go_to_workers_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "SIZE", 2)
    monkeypatch.setattr("gough_stewart.harness.ensemble.passing._pickler", lambda: __import__("pickle"))
    with pytest.raises(ControllerError, match=r"cannot be passed to other processes .* workers=1"):
        gs.ensemble(EXPERIMENT, SHORT, controller=lambda _sample: np.zeros(6), members=4, workers=2)


@pytest.mark.parametrize("way", WAYS)
def test_a_search_says_what_the_ensemble_says(way: str, among: gs.Ensemble) -> None:
    """Expected: the evaluation of the experiment's own values is the worst of its 4 members, bit for bit."""
    found = gs.tune(
        EXPERIMENT,
        ["actuators.lag=0..0.002"],
        RMS,
        {**SHORT, "actuators.lag": 0.0},
        controller=WAYS[way](),
        quantile=1.0,
        members=4,
        fresh=1,
        generations=1,
        population=5,
    )
    assert found.before is not None
    assert found.before.value == among.values(RMS)[:4].max()


@pytest.mark.parametrize("kind", NAMED)
def test_a_python_file_gives_the_same(kind: str, among: gs.Ensemble, tmp_path: Path) -> None:
    """Expected: the bits of the class in Python, also with memory in globals, and in those of a module beside it."""
    (tmp_path / "pid.py").write_text(FILE)
    (tmp_path / "legs.py").write_text(BESIDE)
    controller = {"type": "python", "file": str(tmp_path / "pid.py"), "feedforward": "computed_torque", **NAMED[kind]}
    settings = {**SHORT, "controller": controller}
    for _ in range(2):
        found = gs.ensemble(EXPERIMENT, settings, members=8, workers=1)
        assert found.members.equals(among.members.head(8), null_equal=True)
    record = gs.run(EXPERIMENT, settings, member=3)
    assert flattened(metrics(record))[RMS] == pytest.approx(row(among, 3)[RMS], rel=1e-12)


def test_a_single_run_is_the_same_three_times_and_leaves_the_object_as_it_was() -> None:
    mine = WAYS["object"]()
    mine.integral += 1e-3  # what it starts with, each time
    records = [gs.run(EXPERIMENT, SHORT, controller=mine) for _ in range(3)]
    assert records[0].table.equals(records[1].table)
    assert records[0].table.equals(records[2].table)
    assert (mine.integral == 1e-3).all()
    assert mine.before is None
    fresh = gs.run(EXPERIMENT, SHORT, controller=Pid)
    assert not np.array_equal(records[0]["controller.force"][0], fresh["controller.force"][0])


CALLS: list[tuple[int, int, float]] = []
MADE: list[int] = []


class Counts(Pid):
    """Writes down which controller is called at which sample."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        MADE.append(1)
        self.number = len(MADE)

    def __call__(self, sample: gs.Sample) -> Any:
        CALLS.append((self.number, sample.index, sample.time))
        return super().__call__(sample)


@pytest.mark.parametrize("members", [1, 3, 9])
def test_each_member_calls_its_own_controller_once_a_sample_in_order(members: int) -> None:
    """Expected: as many controllers as members and 30 calls of each: none for copies."""
    CALLS.clear()
    MADE.clear()
    gs.ensemble(EXPERIMENT, SHORT, controller=Counts, members=members, workers=1)
    assert len(MADE) == members
    for number in range(1, members + 1):
        assert [index for who, index, _ in CALLS if who == number] == list(range(30))
        times = [time for who, _, time in CALLS if who == number]
        assert times == pytest.approx(1e-3 * np.arange(30))
    assert len(CALLS) == 30 * members


def test_with_jitter_too_each_is_called_once_a_sample_in_order() -> None:
    CALLS.clear()
    MADE.clear()
    settings = {**SHORT, "loop.plant_step": 2.5e-4, "loop.jitter": 6e-4}
    gs.ensemble(EXPERIMENT, settings, controller=Counts, members=3, workers=1)
    assert [[index for who, index, _ in CALLS if who == number] for number in (1, 2, 3)] == [list(range(30))] * 3


def test_a_controller_that_fails_in_one_member_ends_that_member_alone(among: gs.Ensemble) -> None:
    """The class refuses the third controller that it makes, and the fifth fails at its sample 10."""
    MADE.clear()

    class Fails(Counts):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            if self.number == 3:
                raise ValueError("no third")

        def __call__(self, sample: gs.Sample) -> Any:
            if self.number == 5 and sample.index == 10:
                raise ValueError("no tenth")
            return super().__call__(sample)

    found = gs.ensemble(EXPERIMENT, SHORT, controller=Fails, members=8, workers=1)
    assert found.members["outcome"].to_list() == ["stopped" if k in (2, 4) else "completed" for k in range(8)]
    assert "no third" in row(found, 2)["cause"]
    assert "no tenth" in row(found, 4)["cause"]
    for k in (0, 1, 3, 5, 6, 7):
        assert row(found, k) == row(among, k)


def test_the_same_factory_may_give_linear_controllers_which_run_together(tmp_path: Path) -> None:
    """Expected: the ensemble of the linear controller itself; the class is asked once for each member."""
    gains = gs.gains_from_bandwidth(gs.load_preset("motion_base"), 2.0, 0.8)
    linear = gs.sampled(gs.pid(gains), 1e-3)

    def make(platform: gs.Platform, sample_time: float) -> Any:
        return gs.sampled(gs.pid(gs.gains_from_bandwidth(platform, 2.0, 0.8)), sample_time)

    expected, found = (
        gs.ensemble(EXPERIMENT, SHORT, controller=each, members=4, workers=1, out=tmp_path / str(k))
        for k, each in enumerate((linear, make))
    )
    assert found.values(RMS) == pytest.approx(expected.values(RMS), rel=1e-9)


def test_a_function_with_memory_is_refused_by_what_it_keeps() -> None:
    """Each of the ways in which a function can keep something; one that keeps nothing runs."""
    total, names = np.zeros(6), {"kept": 0}

    def in_a_closure(_sample: gs.Sample) -> Any:
        nonlocal total
        total = total + 1e-3
        return total

    def in_a_value_of_a_closure(_sample: gs.Sample) -> Any:
        names["kept"] += 1
        return np.zeros(6)

    def in_a_default(_sample: gs.Sample, seen: list[int] = [0]) -> Any:  # noqa: B006 - the mistake itself
        seen[0] += 1
        return np.zeros(6)

    def in_a_keyword(_sample: gs.Sample, *, seen: list[int] = [0]) -> Any:  # noqa: B006
        seen[0] += 1
        return np.zeros(6)

    def in_an_attribute(_sample: gs.Sample) -> Any:
        vars(in_an_attribute)["calls"] = vars(in_an_attribute).get("calls", 0) + 1
        return np.zeros(6)

    def in_a_helper(sample: gs.Sample) -> Any:
        return in_a_closure(sample)

    refused = {
        in_a_closure: "closure variable 'total'",
        in_a_value_of_a_closure: "closure variable 'names'",
        in_a_default: "default of 'seen'",
        in_a_keyword: "default of 'seen'",
        in_an_attribute: "attribute 'calls'",
        in_a_global: "global 'KEPT'",
        in_a_helper: "closure variable 'total'",
    }
    for function, what in refused.items():
        with pytest.raises(SharedMemoryError, match=rf"{what}.*use a factory"):
            gs.ensemble(EXPERIMENT, SHORT, controller=function, members=2, workers=1)
    with pytest.raises(SharedMemoryError, match="closure variable 'total'"):
        gs.run(EXPERIMENT, SHORT, controller=in_a_closure, member=0)
    with pytest.raises(SharedMemoryError, match="closure variable 'total'"):
        gs.tune(EXPERIMENT, ["actuators.lag=0..0.002"], RMS, SHORT, controller=in_a_closure, members=1, population=5)
    said = list[str]()
    alone = gs.run(EXPERIMENT, SHORT, controller=in_a_closure, warn=said.append)  # it may, and is told
    assert "has changed the closure variable 'total'" in said[0]
    assert alone.metadata["warnings"] == said
    assert "warnings" not in gs.run(EXPERIMENT, SHORT, controller=without_memory).metadata
    fine = gs.ensemble(EXPERIMENT, SHORT, controller=without_memory, members=2, workers=1)
    assert fine.members["outcome"].to_list() == ["completed"] * 2


def test_a_function_that_begins_to_remember_late_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """At its last sample, after thirty that changed nothing, and in a process of its own."""
    kept = {"late": 0}

    def late(sample: gs.Sample) -> Any:
        if sample.index == 29:
            kept["late"] += 1
        return np.zeros(6)

    with pytest.raises(SharedMemoryError, match="closure variable 'kept'"):
        gs.ensemble(EXPERIMENT, SHORT, controller=late, members=2, workers=1)
    monkeypatch.setattr(runner, "SIZE", 2)
    with pytest.raises(SharedMemoryError, match="closure variable 'kept'"):
        gs.ensemble(EXPERIMENT, SHORT, controller=late, members=4, workers=2)


KEPT = np.zeros(6)


def in_a_global(_sample: gs.Sample) -> Any:
    KEPT[0] += 1e-3
    return KEPT.copy()


def without_memory(sample: gs.Sample) -> Any:
    return 8e4 * (sample.reference["leg_length"] - sample.measured["leg_length"])


def test_an_object_whose_copies_share_a_function_with_memory_is_refused() -> None:
    """A closure is not copied with the object that holds it."""

    class Holds:
        def __init__(self) -> None:
            self.law = factory(gs.load_preset("motion_base"), 1e-3)

        def __call__(self, sample: gs.Sample) -> Any:
            return self.law(sample)

    with pytest.raises(SharedMemoryError, match=r"closure variable '(before|integral)' of factory"):
        gs.ensemble(EXPERIMENT, SHORT, controller=Holds(), members=2, workers=1)


def test_a_factory_that_gives_the_same_object_twice_is_refused() -> None:
    only = WAYS["object"]()

    def make(_platform: gs.Platform, _sample_time: float) -> Any:
        return only

    with pytest.raises(SharedMemoryError, match="members 0 and 1 got the same object of class Pid"):
        gs.ensemble(EXPERIMENT, SHORT, controller=make, members=2, workers=1)


def test_an_object_that_cannot_be_copied_is_refused() -> None:
    class Open:
        def __init__(self) -> None:
            self.numbers = (k for k in range(3))

        def __call__(self, _sample: gs.Sample) -> Any:
            return np.zeros(6)

    for call in (gs.run, gs.ensemble):
        with pytest.raises(ExperimentError, match=r"object of class .*Open cannot be copied .* use a factory"):
            call(EXPERIMENT, SHORT, controller=Open())


def test_a_sample_tells_what_a_digital_controller_knows() -> None:
    """Expected: the record's own columns, which the loop writes itself; what acts is the command and the excess."""
    told: list[gs.Sample] = []

    class Sees(Pid):
        def __call__(self, sample: gs.Sample) -> Any:
            told.append(sample._replace(**{name: getattr(sample, name).copy() for name in ARRAYS}))
            force = super().__call__(sample)
            for name in ARRAYS:  # its own: no effect
                getattr(sample, name)[:] = 1e9
            return force

    settings = {
        **SHORT,
        "actuators": {"force_limit": 4200.0},
        "limits.reference": "warn",
        "sensors.noise.leg_length": 1e-4,
        "injection": {"type": "multisine", "leg": 2, "amplitude": 50.0, "band": [100.0, 300.0]},
    }
    for member in (None, 0, 1):
        told.clear()
        record = gs.run(EXPERIMENT, settings, controller=Sees, member=member)
        command, excess, feedforward = (np.array([getattr(s, name) for s in told]) for name in ARRAYS)
        force = record["controller.force"][:30]
        assert (command[0] == 0).all()
        assert (excess[0] == 0).all()
        assert (command[1:] == force[:-1]).all()
        assert (feedforward == record["controller.feedforward"][:30]).all()
        limited = np.clip(force, -4200, 4200)
        assert (np.abs(limited - force)[:-1] > 1).any()
        assert excess[1:] == pytest.approx((limited - force)[:-1], abs=1e-9)
        assert [(s.index, s.sample_time) for s in told] == [(k, 1e-3) for k in range(30)]
        # the nominal model, not the machine
        assert {s.platform.platform_mass for s in told} == {gs.load_preset("motion_base").platform_mass}
        assert member is None or record.metadata["machine"]["platform_mass"] != told[0].platform.platform_mass


def test_each_member_is_told_what_the_limits_took_off_its_own_command() -> None:
    """Expected: what a controller hears among four is what it hears alone."""
    told: dict[int, list[Any]] = {}

    class Hears(Counts):
        def __call__(self, sample: gs.Sample) -> Any:
            told.setdefault(self.number, []).append(sample.excess.copy())
            return super().__call__(sample)

    actuators = {"force_limit": 4200.0, "rate_limit": 5e5}
    settings = {**SHORT, "actuators": actuators, "limits.reference": "warn", "sensors.noise.leg_length": 1e-4}
    MADE.clear()
    gs.ensemble(EXPERIMENT, settings, controller=Hears, members=4, workers=1)
    together = dict(told)
    assert not np.array_equal(together[1], together[2])
    for member in (0, 2):
        told.clear()
        MADE.clear()
        gs.run(EXPERIMENT, settings, controller=Hears, member=member)
        assert np.abs(told[1]).max() > 1
        assert np.array_equal(told[1], together[member + 1])


def test_controllers_that_have_no_effect_cannot_vary() -> None:
    with pytest.raises(ExperimentError, match=r"controller\.bandwidth: has no effect, since controller="):
        gs.tune(EXPERIMENT, ["controller.bandwidth=1..3Hz"], RMS, SHORT, controller=Pid, members=2)
