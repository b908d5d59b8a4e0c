"""Rows in blocks, and the row, cause and words with which runs end, by hand from the closed form of six masses."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.loop.loop import Limits
from gough_stewart.harness.loop.rows import BLOCK_SIZE, Observer, RowBlock
from gough_stewart.harness.loop.run import observe, simulate
from gough_stewart.model.errors import StepError
from gough_stewart.model.vectors import FloatArray
from tests.support.fake_plants import LENGTHS, MASSES, ManyMasses, Masses, signals_of
from tests.support.loops import FORCES, constant, loop_of, reference, run_with

STEP = 2e-3
NO_JACOBIANS = np.zeros((0, 6, 6))


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
    plant = Failing(where.partition(" ")[0], call, error)
    found = run_with(constant(), loop_of(), plant)
    rows = row + 1 if where == "do_step" else row
    assert found.outcome.status == ("diverged" if isinstance(error, StepError) else "stopped")
    assert found.outcome.time == pytest.approx((rows - 1) * STEP, abs=1e-12)
    assert "it broke" in str(found.outcome.cause)
    for name in ("time", "results", "inputs", "rate_limited", "stroke_exceeded", "sample_of_row"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name)[:rows], err_msg=name)


@pytest.mark.parametrize("where", ["results", "set_inputs"])
def test_an_error_before_the_first_row_is_raised(where: str) -> None:
    with pytest.raises(PlantError, match="it broke"):
        run_with(constant(), loop_of(), Failing(where, 0, PlantError("it broke")))


def _rows_of(forces: FloatArray, n: int) -> FloatArray:
    """Signals (n, 30) of the masses under constant forces from rest, row by row."""
    t = STEP * np.arange(n)[:, None]
    a = forces / MASSES
    return signals_of(LENGTHS + a * t**2 / 2, a * t, a + 0 * t)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_stroke_ends_members_at_their_first_row_beyond_it(sign: float) -> None:
    """Expected: row, leg and length by hand, of members with forces of their own; the one within goes on."""
    factors = [14.0, 9.5, 11.0, 0.01]
    low, high = 0.78, 1.612
    loop = loop_of(limits=Limits((low, high), "stop"), wants=False, start_force=FORCES, shape=())
    n = loop.timing.steps + 1
    forces = np.array([sign * f * FORCES for f in factors])
    plant = ManyMasses(np.ones(4))
    many = replace(loop, feedforward=np.repeat(forces[None], 50, axis=0), start_force=forces, shape=(4,))
    run = simulate(plant, None, many)
    for k, own in enumerate(forces):
        lengths = _rows_of(own, n)[:, 12:18]
        beyond = (lengths < low) | (lengths > high)
        if not beyond.any():
            assert run.outcomes[k] == ("completed", 0.5, None)
            continue
        row = int(beyond.any(axis=1).argmax())
        leg = int(beyond[row].argmax())
        assert run.outcomes[k].status == "stopped"
        assert run.outcomes[k].time == pytest.approx(row * STEP)
        text = f"leg {leg + 1} is {lengths[row, leg]:.6g} m long; its stroke is 0.78 to 1.612 m"
        assert run.outcomes[k].cause == text
        assert len(run.of_member(k).time) == row + 1
    assert len({outcome.time for outcome in run.outcomes}) == 4
    assert run.outcomes[3].status == "completed"


def test_the_distance_from_the_reference_ends_members_with_bounds_of_their_own() -> None:
    """Expected: by hand the first row at which the distance in space is beyond the member's bound, and both numbers."""
    bounds = np.array([5e-3, np.inf, 0.02, 0.011])
    loop = loop_of(limits=Limits(largest_position_error=bounds), start_force=FORCES)
    n = loop.timing.steps + 1
    plant = ManyMasses(np.ones(4))
    run = simulate(plant, None, replace(loop, feedforward=np.tile(FORCES, (50, 1)), shape=(4,)))
    error = np.linalg.norm(reference(loop.timing.times)[:, :3] - _rows_of(FORCES, n)[:, :3], axis=1)
    for k, bound in enumerate(bounds):
        if not np.isfinite(bound):
            assert run.outcomes[k].status == "completed"
            continue
        row = int((error > bound).argmax())
        assert row > 15
        expected = f"the platform is {error[row]:.3g} m from its reference; the limit is {bound:g} m"
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
        self.first: list[int] = []
        self.parts: list[tuple[FloatArray, ...]] = []
        self.counting: list[NDArray[np.intp]] = []

    def block(self, rows: RowBlock) -> None:
        names = ("signals", "forces", "force_limited", "rate_limited")
        self.first.append(rows.first)
        self.parts.append(tuple(getattr(rows, name)[: rows.count + 1].copy() for name in names))
        self.counting.append(rows.counting.copy())


@pytest.mark.parametrize("members", [1, 3, 700, 1500])
def test_blocks_follow_each_other_and_bring_the_row_before(members: int) -> None:
    """Expected: each row once and in order; the first row of a block is the last one before; sizes that fit a cache."""
    blocks, n = Blocks(), 251
    plant = ManyMasses(np.linspace(1, 2, members))
    observe(plant, None, replace(loop_of(start_force=FORCES), feedforward=np.tile(FORCES, (50, 1))), blocks)
    counts = [len(part[0]) - 1 for part in blocks.parts]
    assert blocks.first == np.cumsum([0, *counts[:-1]]).tolist()
    assert sum(counts) == n
    assert max(counts) <= max(16, BLOCK_SIZE // members)
    assert len(counts) == {1: 1, 3: 1, 700: 16, 1500: 16}[members]  # 251 rows, at least 16 at a time
    for before, after in zip(blocks.parts, blocks.parts[1:], strict=False):
        for last, first in zip(before, after, strict=True):
            np.testing.assert_array_equal(last[-1], first[0])
    lengths = np.concatenate([part[0][1:, 12:18, -1] for part in blocks.parts])
    factor = 2.0 if members > 1 else 1.0
    np.testing.assert_allclose(lengths, _rows_of(FORCES / factor, n)[:, 12:18], rtol=1e-12)
    forces = np.concatenate([part[1][1:, :, -1] for part in blocks.parts])
    np.testing.assert_array_equal(forces, np.tile(FORCES, (n, 1)))
    assert (np.concatenate(blocks.counting) == np.repeat(counts, members)).all()
