"""How the sampled loop ends, and what it tells: rows in blocks, causes in words, broken numbers, interrupts.

That a loop computes what the documentation says is in `tests/harness/experiment/test_options_together.py`.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import gough_stewart as gs
from gough_stewart import State, StepError
from gough_stewart.harness.control.laws_of_members import SeparateLaws
from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.loop.folding import FoldsOfRows
from gough_stewart.harness.loop.loop import Actuators, Change, Limits
from gough_stewart.harness.loop.rows import BLOCK_SIZE, Observer, RowBlock
from gough_stewart.harness.loop.run import observe, simulate
from gough_stewart.harness.plants.lanes import Stepping
from gough_stewart.harness.plants.open import ModelPlant
from gough_stewart.harness.results.metric_folds import folds_of_loop, metric_kernels
from tests.harness.loop.test_compiled_loop import VARIED, batch_of, in_numpy
from tests.support.arrays import FloatArray
from tests.support.fake_plants import LENGTHS, MASSES, VELOCITY, ManyMasses, Masses, signals_of
from tests.support.loops import FORCES, constant, loop_of, reference, run_with

STEP = 2e-3


# ---- a run of one, on six masses with closed forms ----


def test_changes_at_one_time_all_come_in_their_order() -> None:
    """Expected: the last wrench, and a = F/m with the mass between them."""
    one, two = np.full(6, 1.0), np.full(6, 2.0)
    changes = (Change(0.0, external_wrench=one), Change(0.0, {"platform_mass": 3.0}), Change(0.0, external_wrench=two))
    run = run_with(constant(), loop_of(0.1, changes=changes))
    assert (run.inputs[:, 6:] == two).all()
    assert run.results[-1, VELOCITY] == pytest.approx(0.1 * FORCES / MASSES / 3)


class Limiting:
    """Gives `FORCES`, and says of each sample which of them it has limited itself."""

    used: tuple[str, ...] = ()

    def __init__(self, flags: NDArray[np.bool_]) -> None:
        self._flags, self.limited = flags, flags[0]

    def force(self, k: int, *_: object) -> FloatArray:
        self.limited = self._flags[k]
        return FORCES


def test_forces_that_the_controller_limits_itself_count_as_limited() -> None:
    """Expected: its flags of that sample, and those of the actuators beside them."""
    flags = np.random.default_rng(2).random((10, 6)) < 0.3
    loop = loop_of(0.1, actuators=Actuators(force_limit=1.5))
    run = simulate(Masses(), lambda _wanted, _measured: SeparateLaws([Limiting(flags)]), loop)  # type: ignore[list-item]
    np.testing.assert_array_equal(run.force_limited, flags | (np.abs(FORCES) > 1.5))


@pytest.mark.parametrize(("leg", "value"), [(0, np.nan), (3, -np.inf), (5, 1e31)])
def test_a_force_that_is_no_number_or_too_large_ends_the_run_before_it_acts(leg: int, value: float) -> None:
    """Expected: the row is kept with the forces before, the command as it was."""

    def breaking(sample: gs.Sample) -> FloatArray:
        return np.where((np.arange(6) == leg) & (sample.time > 0.095), value, FORCES)

    run = run_with(breaking, loop_of())
    assert run.outcome.status == "diverged"
    assert str(value) in str(run.outcome.cause)
    assert run.outcome.time == run.time[-1] == pytest.approx(0.1)
    assert (run.inputs[:, :6] == FORCES).all()
    assert run.command[10] == pytest.approx(np.where(np.arange(6) == leg, value, FORCES), nan_ok=True)
    assert not run.force_limited.any()
    assert len(run_with(constant(np.full(6, value)), loop_of()).time) == 1


def test_progress_tells_the_time_and_ctrl_c_keeps_what_ran_so_far() -> None:
    """Expected: reports at equal times; all rows up to the interruption, which comes with the first after 0.5 s."""
    told = list[float]()

    def interrupt(time: float) -> None:
        told.append(time)
        if time > 0.5:
            raise KeyboardInterrupt

    run = run_with(constant(), loop_of(2.0), progress=interrupt)
    assert run.outcome.status == "interrupted"
    assert run.outcome.time == run.time[-1]
    assert 0.5 < run.time[-1] < 0.7
    assert len(run.results) == len(run.time)
    assert told[0] == 0
    assert np.diff(told) == pytest.approx(told[1])
    assert told[1] < 0.2


def test_what_fails_before_the_first_row_is_an_error() -> None:
    """Expected: nothing to keep, so that errors and Ctrl-C go on as they are."""

    def interrupt(_sample: gs.Sample) -> list[float]:
        raise KeyboardInterrupt

    with pytest.raises(gs.GoughStewartError, match="time 0 s; expected 6 forces"):
        run_with(lambda _sample: None, loop_of())
    with pytest.raises(KeyboardInterrupt):
        run_with(interrupt, loop_of())
    with pytest.raises(gs.GoughStewartError, match="a controller without a reference"):
        run_with(constant(), loop_of(wants=False))
    for where in ("results", "set_inputs"):
        with pytest.raises(gs.GoughStewartError, match="it broke"):
            run_with(constant(), loop_of(), Failing(where, 0, PlantError("it broke")))


def test_what_a_law_does_to_its_sample_changes_nothing() -> None:
    def careless(sample: gs.Sample) -> FloatArray:
        for values in (*sample.reference.values(), *sample.measured.values()):
            values[:] = np.nan
        return FORCES

    careful = run_with(constant(), loop_of(0.1))
    assert run_with(careless, loop_of(0.1)).results == pytest.approx(careful.results, abs=0)


class Failing(Masses):
    """Raises an error at a call of one of its functions, counted from 0."""

    def __init__(self, name: str, call: int, error: Exception) -> None:
        super().__init__()
        calls, function = iter(range(10_000)), getattr(self, name)

        def failing(*arguments: Any) -> Any:
            if next(calls) == call:
                raise error
            return function(*arguments)

        setattr(self, name, failing)


@pytest.mark.parametrize("error", [StepError("leg_length[2]", 0.0, 0.1, "it broke"), PlantError("it broke")])
@pytest.mark.parametrize("where", ["results", "results of the row", "signals", "set_inputs", "do_step"])
def test_an_error_of_the_plant_ends_the_run_with_the_rows_before_it(where: str, error: Exception) -> None:
    """Expected: the first rows of a run that goes on; a step that fails comes after its row, all else before."""
    whole, row = run_with(constant(), loop_of()), 37
    # controllers start with a reading of their own; signals are read from the results
    call = {"results": 2 * row + 1, "results of the row": 2 * row + 2, "signals": row + 1}.get(where, row)
    ended = run_with(constant(), loop_of(), Failing(where.partition(" ")[0], call, error))
    rows = row + 1 if where == "do_step" else row
    assert ended.outcome.status == ("diverged" if isinstance(error, StepError) else "stopped")
    assert ended.outcome.time == pytest.approx((rows - 1) * STEP, abs=1e-12)
    assert "it broke" in str(ended.outcome.cause)
    for name in ("time", "results", "inputs", "rate_limited", "stroke_exceeded", "sample_of_row"):
        np.testing.assert_array_equal(getattr(ended, name), getattr(whole, name)[:rows], err_msg=name)


# ---- limits, and rows in blocks ----


def _rows_of(forces: FloatArray, n: int) -> FloatArray:
    """Signals (n, 30) of the masses under constant forces from rest, row by row."""
    t, a = STEP * np.arange(n)[:, None], forces / MASSES
    return signals_of(LENGTHS + a * t**2 / 2, a * t, a + 0 * t)


def test_the_distance_from_the_reference_ends_members_with_bounds_of_their_own() -> None:
    """Expected: by hand the first row at which the distance in space is beyond the member's bound, and both numbers."""
    bounds = np.array([5e-3, np.inf, 0.02, 0.011])
    loop = loop_of(limits=Limits(largest_position_error=bounds), start_force=FORCES)
    n = loop.timing.steps + 1
    run = simulate(ManyMasses(np.ones(4)), None, replace(loop, feedforward=np.tile(FORCES, (50, 1)), shape=(4,)))
    error = np.linalg.norm(reference(loop.timing.times)[:, :3] - _rows_of(FORCES, n)[:, :3], axis=1)
    assert run.outcomes[1].status == "completed"
    for k in (0, 2, 3):
        row = int((error > bounds[k]).argmax())
        assert row > 15
        expected = f"the platform is {error[row]:.3g} m from its reference; the limit is {bounds[k]:g} m"
        assert (run.outcomes[k].status, run.outcomes[k].cause) == ("diverged", expected)
        assert run.outcomes[k].time == pytest.approx(row * STEP)


def test_a_bound_itself_is_allowed() -> None:
    """Expected: a platform that stands still at exactly its bound, and a leg at exactly its end, go on."""
    standing = signals_of(LENGTHS, np.zeros(6), np.zeros(6))
    loop = loop_of(limits=Limits((LENGTHS.min(), LENGTHS.max()), "stop", 0.25))
    wanted = np.tile(standing, (loop.timing.steps + 1, 1))
    wanted[:, 1] += 0.25
    still = replace(loop, reference=wanted)
    assert run_with(constant(np.zeros(6)), still).outcome.status == "completed"
    for limits in (
        Limits((LENGTHS.min() + 1e-12, 9.0), "stop"),
        Limits((0.0, LENGTHS.max() - 1e-12), "stop"),
        Limits(largest_position_error=0.25 - 1e-12),
    ):
        assert run_with(constant(np.zeros(6)), replace(still, limits=limits)).outcome.time == 0.0
    for ignored in ("ignore", "warn"):
        only_told = replace(still, limits=Limits((0.0, LENGTHS.max() - 1e-12), ignored))
        run = run_with(constant(np.zeros(6)), only_told)
        assert run.outcome.status == "completed"
        np.testing.assert_array_equal(run.stroke_exceeded, np.tile(LENGTHS.max() == LENGTHS, (len(run.time), 1)))


class Blocks(Observer):
    """Keeps what it gets."""

    def __init__(self) -> None:
        self.first, self.parts = list[int](), list[tuple[FloatArray, ...]]()
        self.counting = list[NDArray[np.intp]]()

    def block(self, rows: RowBlock) -> None:
        names = ("signals", "forces", "force_limited", "rate_limited")
        self.first.append(rows.first)
        self.parts.append(tuple(getattr(rows, name)[: rows.count + 1].copy() for name in names))
        self.counting.append(rows.counting.copy())


@pytest.mark.parametrize("members", [1, 3, 700])
def test_blocks_follow_each_other_and_bring_the_row_before(members: int) -> None:
    """Expected: each row once and in order; the first row of a block is the last one before; sizes that fit a cache."""
    blocks, n = Blocks(), 251
    plant = ManyMasses(np.linspace(1, 2, members))
    observe(plant, None, replace(loop_of(start_force=FORCES), feedforward=np.tile(FORCES, (50, 1))), blocks)
    counts = [len(part[0]) - 1 for part in blocks.parts]
    assert blocks.first == np.cumsum([0, *counts[:-1]]).tolist()
    assert sum(counts) == n
    assert max(counts) <= max(16, BLOCK_SIZE // members)
    assert len(counts) == {1: 1, 3: 1, 700: 16}[members]  # 251 rows, at least 16 at a time
    for before, after in zip(blocks.parts, blocks.parts[1:], strict=False):
        for last, first in zip(before, after, strict=True):
            np.testing.assert_array_equal(last[-1], first[0])
    lengths = np.concatenate([part[0][1:, 12:18, -1] for part in blocks.parts])
    factor = 2.0 if members > 1 else 1.0
    np.testing.assert_allclose(lengths, _rows_of(FORCES / factor, n)[:, 12:18], rtol=1e-12)
    forces = np.concatenate([part[1][1:, :, -1] for part in blocks.parts])
    np.testing.assert_array_equal(forces, np.tile(FORCES, (n, 1)))
    assert (np.concatenate(blocks.counting) == np.repeat(counts, members)).all()


# ---- numbers that get out of hand, in both hosts ----


def members_of(noise: NDArray[Any] | None, push: float) -> tuple[Any, dict[str, FloatArray]]:
    """Outcomes and metrics of nine members, with noise of the leg lengths [m] and a force on the fifth [N]."""
    running = batch_of("pd", {}, VARIED, 9).in_parallel(Stepping(tolerance=1e-9))
    loop = running.loop
    if noise is not None:
        loop = replace(loop, sensors=replace(loop.sensors, noise={"leg_length": np.resize(noise, running.size)}))
    force = np.zeros((running.size, 6))
    force[4, 0] = push
    loop = replace(loop, start_force=loop.start_force + force)
    rows = FoldsOfRows(loop, folds_of_loop(loop, {}), running.size, metric_kernels())
    with running.plant:
        return observe(running.plant, running.law_from, loop, rows)[:9], rows.results()


def in_both(monkeypatch: pytest.MonkeyPatch, run: Callable[[], Any]) -> list[Any]:
    """Of the host in machine code, and of that in Python."""
    compiled = run()
    with in_numpy(monkeypatch):
        return [compiled, run()]


def test_a_noise_that_makes_forces_infinite_ends_its_members_at_their_first_sample(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Expected: of 1e306 m, whose forces no number holds, one row; without noise the whole run."""
    noise = np.where(np.arange(9) % 3 == 1, 1e306, 0.0)
    both = in_both(monkeypatch, lambda: members_of(noise, 0.0))
    for outcomes, metrics in both:
        for k, outcome in enumerate(outcomes):
            assert outcome.status == ("diverged" if k % 3 == 1 else "completed"), k
            assert metrics["rows"][k] == (1 if k % 3 == 1 else 121)
        assert "the controller's forces are [" in str(outcomes[1].cause)
    assert both[0][0] == both[1][0]


def test_a_member_that_diverges_in_the_first_step_ends_there_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the row at the start counts, with the force; the others complete their run with numbers."""
    for outcomes, metrics in in_both(monkeypatch, lambda: members_of(None, 1e14)):
        assert [outcome.status for outcome in outcomes] == ["diverged" if k == 4 else "completed" for k in range(9)]
        assert outcomes[4].time == 0.0
        assert metrics["rows"][:9].tolist() == [1.0 if k == 4 else 121.0 for k in range(9)]
        assert metrics["force.peak"][0, 4] == pytest.approx(1e14, rel=1e-6)
        assert np.isfinite(metrics["tracking.position.norm_rms"][:9]).all()


class Broken(ModelPlant):
    """The machine of `heave_step`, of which one result is wrong from some time [s] on."""

    def __init__(self, name: str, value: float, since: float = 0.0995, **parameters: float) -> None:
        machine = gs.load_preset("motion_base").with_parameters(parameters)
        still = np.zeros(3)
        super().__init__(machine, State(machine.home_position, machine.home_orientation, still, still))
        self._at, self._value, self._since, self._now = self.columns.index(name), value, since, 0.0

    def do_step(self, time: float, step: float) -> None:
        super().do_step(time, step)
        self._now = time + step

    def results(self) -> FloatArray:
        results = np.array(super().results())
        results[self._at] = self._value if self._now >= self._since else results[self._at]
        return results


ELASTIC = {"leg_stiffness": 1e7, "leg_armature": 100.0}


@pytest.mark.parametrize(
    ("name", "unit", "value", "parameters"),
    [
        ("position[2]", "m", np.nan, {}),
        ("leg_length[3]", "m", -np.inf, {}),
        ("angular_velocity[1]", "rad/s", 1e300, {}),  # which nobody reads
        ("motor_position[6]", "m", np.nan, ELASTIC),
        ("motor_velocity[1]", "m/s", -1e300, ELASTIC),
    ],
)
def test_what_a_plant_breaks_is_said_of_the_plant(
    name: str, unit: str, value: float, parameters: dict[str, float]
) -> None:
    """Expected: its result by name, value and unit, at the row that has it; not what the controller makes of it."""
    settings = {"loop.duration": 0.2, "plant.parameters": parameters, "sensors.side": "motor"}
    record = gs.run("heave_step", settings, plant=Broken(name, value, **parameters))
    outcome = record.metadata["outcome"]
    assert (outcome["status"], outcome["cause"]) == ("diverged", f"the plant gave {name} = {value:g} {unit}")
    assert outcome["time"] == pytest.approx(0.1)
    assert record.table.height == 101


@pytest.mark.parametrize("since", [0.0, 0.0995])
def test_a_controller_is_not_asked_about_a_broken_plant(since: float) -> None:
    """Expected: its samples before that row only; what it would make of the plant's number is not the cause."""
    told: list[float] = []

    def law(sample: gs.Sample) -> FloatArray:
        told.append(sample.time)
        return np.full(6, sample.measured["leg_length"][2])

    plant = Broken("leg_length[3]", np.nan, since=since)
    record = gs.run("heave_step", {"loop.duration": 0.2}, plant=plant, controller=law)
    assert record.metadata["outcome"]["cause"] == "the plant gave leg_length[3] = nan m"
    assert told == pytest.approx(np.arange(0, since, 1e-3))


def test_forces_that_are_no_numbers_are_said_of_who_made_them() -> None:
    """Expected: the injection if it is too large, and the controller if its own forces are none."""
    forces = [0.0, 1e300, 0.0, 0.0, 0.0, 0.0]
    for made, cause in (
        ({"injection": lambda _time: forces}, f"the injection's forces are {forces} N"),
        ({"controller": lambda _sample: np.full(6, np.nan)}, f"the controller's forces are {[np.nan] * 6} N"),
    ):
        outcome = gs.run("heave_step", {"loop.duration": 0.1}, **made).metadata["outcome"]
        assert (outcome["status"], outcome["time"], outcome["cause"]) == ("diverged", 0.0, cause)


@pytest.mark.parametrize("key", ["ensemble.tolerance", "plant.tolerance"])
@pytest.mark.parametrize("value", [0, -1e-9, float("nan"), float("inf")])
def test_a_tolerance_that_no_step_can_hold_is_refused(key: str, value: float) -> None:
    """Expected: the key and the value, before anything runs."""
    with pytest.raises(gs.GoughStewartError, match=f"{key}: is {value:g}".replace("e-09", "e-0?9")):
        gs.ensemble("heave_tolerances", {key: value}, members=2, workers=1)
