"""The loop in machine code against NumPy's loop, row by row, and each member against itself alone.

Expected values are those of NumPy's loop, an implementation of its own of clocks, memory and products; that one is held
against single steps and closed forms in the other files of this folder.
"""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.fmu_build import libraries as built
from gough_stewart.fmu_build.libraries import loop_sources
from gough_stewart.fmu_build.toolchain import BY_NAME
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.preparation import Batch
from gough_stewart.harness.loop import compiled_host, libraries
from gough_stewart.harness.loop.rows import Observer, RowBlock
from gough_stewart.harness.loop.run import Run, observe, simulate
from gough_stewart.harness.plants.lanes import BatchPlant, Stepping
from gough_stewart.harness.plants.signals import positions
from gough_stewart.model.process import installed
from tests.support.uneven_loops import experiment_of as uneven_experiment

STEPPING = Stepping(tolerance=1e-9)
VARIED: dict[str, Any] = {
    "platform_mass": {"factor": {"uniform": [0.8, 1.3]}},
    "leg_viscous_friction": {"uniform": [5.0, 40.0]},
    "platform_points": {"normal": "1 mm"},
}
# Everything at once, in space of legs and of the task; each clock is another one, and each member has other numbers.
ALL = {
    "loop": {"duration": 0.12, "sample_time": "4 ms", "plant_step": "1 ms", "jitter": "2 ms", "delay": 1},
    "sensors": {
        "noise": {"leg_length": "20 um"},
        "quantisation": {"leg_length": "3 um"},
        "sample_time": "3 ms",
        "seed": 5,
    },
    "actuators": {"force_limit": "75 N", "rate_limit": "2 kN/s", "lag": "3 ms"},
    "change": [{"at": 0.05, "factors": {"platform_mass": 1.4}}],
    "disturbance": [{"at": 0.03, "duration": 0.03, "force": ["180 N", "-90 N", "120 N"]}],
    "fault": [
        {"at": 0.035, "cut": [2, 5], "duration": 0.02},
        {"at": 0.05, "freeze": {"leg_length": [3, 4]}, "duration": 0.045},
        {"at": 0.08, "cut": [1], "freeze": {"leg_length": [4]}},
    ],
}
MANY: dict[str, Any] = {
    **VARIED,
    "fault.1.at": {"choice": ["21 ms", "35 ms"]},
    "fault.2.duration": {"choice": ["20 ms", "45 ms"]},
    "loop": {"delay": {"choice": [0, 1, 3]}, "jitter": {"choice": ["0 ms", "1 ms", "3 ms"]}},
    "sensors": {"noise": {"leg_length": {"uniform": ["0 um", "40 um"]}}},
    "actuators": {"lag": {"choice": ["0 ms", "2 ms", "5 ms"]}, "force_limit": {"uniform": ["68 N", "80 N"]}},
}
CASES: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "PD": ("pd", {}, VARIED),
    "PID in task space": ("task", {}, VARIED),
    "PD, all": ("pd", ALL, MANY),
    "PID, all": ("pid", ALL, MANY),
    "PID, rate limit alone": ("pid", {"actuators": {"force_limit": "none", "rate_limit": "700 N/s"}}, VARIED),
    "task space, all": ("task", ALL, MANY),
    "PD, all but a lag": (
        *("pd", {**ALL, "actuators": {"force_limit": "75 N", "rate_limit": "2 kN/s"}}),
        {**MANY, "actuators": {"force_limit": {"uniform": ["68 N", "80 N"]}}},
    ),
}


def batch_of(name: str, tables: dict[str, Any], varied: dict[str, Any], members: int) -> Batch:
    """Members of an uneven loop whose reference moves."""
    common = {"loop": {"duration": 0.12, "sample_time": "4 ms", "plant_step": "1 ms", "delay": 1}, **tables}
    motion = {"type": "sine", "position_amplitude": ["8 mm", "-5 mm", "6 mm"], "frequency": "4 Hz"}
    experiment = uneven_experiment(
        name,
        limits={"reference": "warn"},
        **common,
        reference=motion,
        ensemble={**varied, "members": members, "seed": 4},
    )
    return Members(experiment).prepared(0, members).batch


@contextmanager
def in_numpy(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Loops run row by row, with the same machine code for the plants."""
    with monkeypatch.context() as patched:
        patched.setattr(BatchPlant, "loop_run", property(lambda _: None))
        yield


def run_of(batch: Batch, stepping: Stepping = STEPPING) -> Run:
    """All members."""
    running = batch.in_parallel(stepping)
    with running.plant:
        return simulate(running.plant, running.law_from, running.loop)


def assert_same(ours: Run, theirs: Run, members: int, tolerance: float) -> None:
    """Rows and samples of members, of which runs may have copies of the last one."""
    assert (ours.used, ours.outcomes[:members]) == (theirs.used, theirs.outcomes[:members])
    for each in fields(Run):
        if each.name in ("outcomes", "used", "host", "time", "sample_of_row"):
            continue
        own, other = (np.asarray(getattr(run, each.name))[:, :members] for run in (ours, theirs))
        if each.name == "measured":  # of the signals that controllers use
            own, other = (values[..., positions(ours.used)] for values in (own, other))
        assert own.shape == other.shape, each.name
        if own.dtype == bool or not tolerance:
            assert np.array_equal(own, other, equal_nan=True), each.name
        elif own.size:
            scale = np.abs(other).max(axis=(0, 1))
            assert (np.abs(own - other).max(axis=(0, 1)) <= tolerance * scale).all(), each.name


@pytest.mark.parametrize(("case", "members"), [*product(CASES, [11]), ("PID, all", 1), ("PID, all", 8)])
def test_machine_code_gives_the_rows_of_numpys_loop(case: str, members: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: NumPy's, to the bit without a lag, whose exponential is another one; 1e-11 of scale with it.

    Readings with steps are left to the cases without a lag, since a flip of a step is no rounding.
    """
    name, tables, varied = CASES[case]
    has_lag = tables is ALL or name != "pd"
    if has_lag and tables:
        sensors = {key: value for key, value in ALL["sensors"].items() if key != "quantisation"}  # type: ignore[attr-defined]
        tables = {**tables, "sensors": sensors}
    batch = batch_of(name, tables, varied, members)
    ours = run_of(batch)
    assert ours.host.startswith("compiled, ")
    with in_numpy(monkeypatch):
        theirs = run_of(batch)
    assert theirs.host == "Python"
    assert_same(ours, theirs, members, 1e-11 if has_lag else 0.0)
    assert ours.results.shape[:2] == (121, members)
    if tables:
        assert ours.force_limited.any() or name == "pid"
        assert ours.rate_limited.any()


def test_a_members_bits_do_not_depend_on_the_others_or_on_the_size_of_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: among 11, at another place, alone, and in calls of some rows and of few internal steps, the same."""
    batch = batch_of("pid", ALL, MANY, 11)
    whole = run_of(batch)
    for chosen in ([4], [10, 4, 2], [*range(10, -1, -1)]):
        part = run_of(batch.take(chosen))
        at = chosen.index(4)
        for name in ("results", "inputs", "command", "measured", "controller_state", "rate_limited"):
            assert np.array_equal(getattr(part, name)[:, at], getattr(whole, name)[:, 4]), name
    monkeypatch.setattr(compiled_host, "_ROWS", 7)
    monkeypatch.setattr(compiled_host, "_WORK", 3)
    assert_same(run_of(batch), whole, 11, 0.0)


def ending(monkeypatch: pytest.MonkeyPatch, change: dict[str, Any], varied: dict[str, Any]) -> tuple[Run, Run]:
    """A run of members of which some end, in machine code and in NumPy."""
    settings = {"loop.duration": 0.4, "loop.sample_time": 2e-3, **change}
    ensemble = {**VARIED, **varied, "members": 11, "seed": 2}
    experiment = gs.load_experiment("heave_step", {**settings, "reference.at": 0.05, "ensemble": ensemble})
    batch = Members(experiment).prepared(0, 11).batch
    ours = run_of(batch)
    with in_numpy(monkeypatch):
        theirs = run_of(batch)
    return ours, theirs


TWIST = {"at": 0.1, "duration": 0.2, "torque": ["0 N.m", "1e6 N.m", "0 N.m"]}
STICKY = {
    "leg_friction_velocity": {"choice": ["0.01 m/s", "1e-11 m/s"]},
    "leg_coulomb_friction": {"choice": [50.0, 9e5]},
}


@pytest.mark.parametrize(
    ("change", "varied", "words"),
    [
        ({"limits.position_error": "40 mm"}, {}, "m from its reference; the limit is 0.04 m"),
        ({"disturbance": [TWIST], "limits.position_error": "1e6 m"}, {}, "singular pose"),
        ({}, STICKY, "too many for one plant step"),
    ],
)  # fmt: skip
def test_members_end_at_their_rows_for_their_causes(
    change: dict[str, Any], varied: dict[str, Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: time, status and words of NumPy's loop, and its rows up to there; some members go on."""
    ours, theirs = ending(monkeypatch, change, varied)
    assert ours.outcomes == theirs.outcomes[:11]
    ended = [k for k, each in enumerate(ours.outcomes) if each.status != "completed"]
    assert ended
    assert any(words in str(ours.outcomes[k].cause) for k in ended)
    for k in range(11):
        own, other = ours.of_member(k), theirs.of_member(k)
        assert len(own.time) == len(other.time)
        assert np.allclose(own.results, other.results, rtol=1e-6, atol=1e-9)


def test_a_run_ends_at_the_end_of_its_stroke(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: time and words of NumPy's loop; the last row is the first one beyond."""
    push = {"at": 0.1, "duration": 0.2, "force": ["0 N", "0 N", "900 kN"]}
    settings = {"loop.duration": 0.6, "reference.at": 0.05, "limits.stroke": "stop", "disturbance": [push]}
    settings |= {"limits.position_error": "10 m"}
    ours = gs.run("heave_step", settings)
    with in_numpy(monkeypatch):
        theirs = gs.run("heave_step", settings)
    assert ours.metadata["host"] != theirs.metadata["host"]
    assert ours.metadata["outcome"] == theirs.metadata["outcome"]
    assert "its stroke is" in ours.metadata["outcome"]["cause"]
    longest = ours.metadata["platform"]["leg_length_max"]
    assert (ours["leg_length"] > longest).any(axis=1).tolist() == [*[False] * (ours.table.height - 1), True]


def test_an_interrupt_keeps_the_rows_that_all_members_have_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: after the third part of the work, an outcome at the last row of all; its rows are those of the run."""
    batch = batch_of("pd", {}, VARIED, 3)
    whole = run_of(batch)
    monkeypatch.setattr(compiled_host, "_WORK", 10)
    running = batch.in_parallel(STEPPING)
    run, calls = running.plant.loop_run, []

    def interrupted(*arguments: Any) -> int:
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        assert run is not None
        return run(*arguments)

    monkeypatch.setattr(BatchPlant, "loop_run", property(lambda _: interrupted))
    part = simulate(running.plant, running.law_from, running.loop)
    n = len(part.time)
    assert 20 < n < 60
    assert {each.status for each in part.outcomes} == {"interrupted"}
    assert {each.time for each in part.outcomes} == {float(part.time[-1])}
    assert np.array_equal(part.results, whole.results[:n])


def test_threads_do_not_change_a_bit_and_an_interrupt_stops_them_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the rows of one thread, for more threads than vectors too; no thread works after an interrupt."""
    batch = batch_of("task", ALL, MANY, 41)
    rows = [rows_with(batch, threads) for threads in (1, 2, 3, 50)]
    assert all(np.array_equal(rows[0], each) for each in rows[1:])
    monkeypatch.setattr(compiled_host, "_WORK", 10)
    running = batch.in_parallel(STEPPING)
    run, calls, main = running.plant.loop_run, [], threading.get_ident()

    def interrupted(*arguments: Any) -> int:
        calls.append(1)
        if threading.get_ident() == main and len(calls) > 20:
            raise KeyboardInterrupt
        assert run is not None
        return run(*arguments)

    monkeypatch.setattr(BatchPlant, "loop_run", property(lambda _: interrupted))
    outcomes = observe(running.plant, running.law_from, running.loop, Signals(), threads=3)
    assert {each.status for each in outcomes} == {"interrupted"}
    n = len(calls)
    time.sleep(0.05)
    assert len(calls) == n


class Signals(Observer):
    """Keeps signals and forces of all rows (rows, 30, N)."""

    def __init__(self) -> None:
        self.blocks: list[np.ndarray[Any, Any]] = []

    def block(self, rows: RowBlock) -> None:
        n = rows.count
        self.blocks.append(np.concatenate([rows.signals[1 : n + 1], rows.forces[1 : n + 1]], axis=1))


def rows_with(batch: Batch, threads: int) -> np.ndarray[Any, Any]:
    """Signals and forces of all rows (rows, 30, N)."""
    running, kept = batch.in_parallel(STEPPING), Signals()
    observe(running.plant, running.law_from, running.loop, kept, threads=threads)
    return np.concatenate(kept.blocks)


def test_rows_reach_observers_in_blocks_without_gaps() -> None:
    """Expected: the rows of a complete run, in blocks one after the other, each with the row before it."""
    batch = batch_of("task", ALL, MANY, 3)
    whole = run_of(batch)

    class Kept(Observer):
        def __init__(self) -> None:
            self.blocks: list[tuple[int, np.ndarray[Any, Any]]] = []

        def start(self, timing: Any, plant: Any, members: int) -> RowBlock:
            rows = RowBlock(timing, plant, members)
            rows.most = 16
            return rows

        def block(self, rows: RowBlock) -> None:
            n = rows.count
            values = [
                rows.signals[: n + 1, :24],
                rows.forces[: n + 1],
                rows.force_limited[: n + 1],
                rows.rate_limited[: n + 1],
            ]
            self.blocks.append((rows.first, np.concatenate(values, axis=1)))

    running, kept = batch.in_parallel(STEPPING), Kept()
    observe(running.plant, running.law_from, running.loop, kept)
    assert [first for first, _ in kept.blocks] == [*range(0, 121, 16)]
    rows = np.concatenate([values[1:] for _, values in kept.blocks])
    assert np.array_equal(rows[:, :24].swapaxes(1, 2), whole.results[:, :, :24])
    assert np.array_equal(rows[:, 24:30].swapaxes(1, 2), whole.inputs[:, :, :6])
    assert np.array_equal(rows[:, 36:].swapaxes(1, 2), whole.rate_limited)
    limited = np.stack([whole.force_limited[whole.sample_of_row[:, k], k] for k in range(3)], axis=1)
    assert np.array_equal(rows[:, 30:36].swapaxes(1, 2), limited)
    assert limited.any()
    for (_, before), (_, after) in zip(kept.blocks, kept.blocks[1:], strict=False):
        assert np.array_equal(before[-1], after[0])


@pytest.mark.parametrize("call", [gs.run, gs.ensemble])
def test_without_machine_code_and_compiler_an_error_names_the_remedy(
    call: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the extra that brings a compiler, and no other loop instead."""
    monkeypatch.setattr(installed, "find_spec", lambda name: None if name == "ziglang" else find_spec(name))
    monkeypatch.setattr(built, "prebuilt_content", lambda *_: None)
    libraries.loop_kernel.cache_clear()
    with pytest.raises(
        gs.GoughStewartError, match=r"not installed: ziglang \(to compile\); .*gough-stewart\[compile\]"
    ):
        call("heave_step", {"ensemble": {"members": 2, "platform_mass": {"uniform": [900, 1100]}}})


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["aarch64-darwin", "aarch64-linux", "x86_64-windows"])
def test_other_systems_can_compile_the_loop(name: str, tmp_path: Path) -> None:
    """Expected: no complaint of the compiler, with the components' equations in it."""
    units, headers = loop_sources(libraries.components_header())
    for file, text in {**units, **headers}.items():
        (tmp_path / file).write_text(text)
    command = [sys.executable, "-m", "ziglang", "cc", "-target", BY_NAME[name].triple, "-std=c11", "-O0", "-Werror"]
    done = subprocess.run(
        [*command, "-c", "-I", ".", "loop.c", "-o", "loop.o"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "loop.o").stat().st_size > 10_000
