"""Limits, delay and lag of the actuators against closed forms, with another force in each."""

import numpy as np
import pytest
from numpy.typing import NDArray

from gough_stewart.harness.control.laws_of_members import SeparateLaws
from gough_stewart.harness.loop.loop import Actuators
from gough_stewart.harness.loop.run import simulate
from gough_stewart.model.vectors import FloatArray
from tests.support.fake_plants import LENGTH, Masses
from tests.support.loops import FORCES, SHARES, constant, excess_gain, loop_of, run_with

START = np.array([0.53, 0.31, -0.24, 1.17, -0.46, 0.72])  # [N]


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_a_delay_holds_back_commands_by_its_samples(delay: int) -> None:
    """Expected: the starting forces for d samples, then each command d samples late."""
    commands = np.random.default_rng(delay).normal(size=(10, 6))
    loop = loop_of(0.1, start_force=START, actuators=Actuators(delay=delay), feedforward=commands)
    run = run_with(constant(np.zeros(6)), loop)
    expected = np.concatenate([np.tile(START, (delay, 1)), commands])[:10]
    assert run.inputs[:-1, :6] == pytest.approx(np.repeat(expected, 5, axis=0), abs=0)
    assert run.command == pytest.approx(commands, abs=0)


def test_the_force_limit_cuts_on_both_sides_and_says_so() -> None:
    """Expected: the command as it was, the force at the limit, the flag; a force at the limit is not cut."""
    command = np.array([9.0, -9.0, 4.0, -4.0, 3.0, -4.5])
    run = run_with(constant(command), loop_of(0.05, actuators=Actuators(force_limit=4.0)))
    assert (run.command == command).all()
    assert (run.inputs[:, :6] == [4, -4, 4, -4, 3, -4]).all()
    assert (run.force_limited == [True, True, False, False, False, True]).all()
    assert not run.rate_limited.any()


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


def test_controllers_hear_what_the_force_limit_cut_off() -> None:
    """Expected: u₀ = f, u₁ = f + s (±4 − f), by a gain of s on the excess, 9 N feedforward and less; never delayed."""
    feedforward = np.array([9.0, -8.0, 6.0, 3.0, -7.0, 5.0])
    loop = loop_of(0.04, feedforward=np.tile(feedforward, (4, 1)), actuators=Actuators(force_limit=4.0, delay=2))
    run = run_with(excess_gain(0.01), loop)
    expected = [feedforward]
    for _ in range(3):
        excess = np.clip(expected[-1], -4, 4) - expected[-1]
        expected.append(feedforward + SHARES * excess)
    assert run.command == pytest.approx(np.array(expected), abs=1e-12)


def test_the_excess_knows_what_the_rate_limit_will_leave_after_a_sample() -> None:
    """Expected: 100 N/s · 10 ms = 1 N a sample in reach, from the starting forces on, after the force limit."""
    feedforward = np.array([9.0, -8.0, 0.6, 3.0, -7.0, 2.5])
    actuators = Actuators(force_limit=4.0, rate_limit=100.0)
    loop = loop_of(0.05, feedforward=np.tile(feedforward, (5, 1)), actuators=actuators, start_force=START)
    run = run_with(excess_gain(0.01), loop)
    expected, planned = [feedforward], START
    for _ in range(4):
        planned = np.clip(np.clip(expected[-1], -4, 4), planned - 1, planned + 1)
        expected.append(feedforward + SHARES * (planned - expected[-1]))
    assert run.command == pytest.approx(np.array(expected), abs=1e-12)
    assert (run.force_limited == (np.abs(run.command) > 4)).all()


@pytest.mark.parametrize("delay", [0, 2, 10])
def test_a_ramp_slower_than_the_rate_limit_cuts_nothing(delay: int) -> None:
    """Expected: half the rate limit is there within half a sample, so that the controller hears of no excess."""
    slopes = np.array([5.0, -4.0, 3.0, 4.5, -5.0, 2.0])
    ramp = slopes * np.arange(100.0)[:, None]
    loop = loop_of(1.0, actuators=Actuators(rate_limit=1000.0, delay=delay), feedforward=ramp)
    run = run_with(excess_gain(0.01), loop)
    assert run.command == pytest.approx(ramp, abs=1e-9)
    # 5 N take 2.5 of the five plant steps
    held_back = run.rate_limited[:-1].reshape(100, 5, 6)
    assert held_back[1 + delay :, :2, 0].all()
    assert not held_back[:, 2:].any()


@pytest.mark.parametrize("lag", [0.0, 4e-3])
@pytest.mark.parametrize("rate_limit", [None, 130.0])
def test_rate_limit_and_lag_act_by_their_mean_over_a_step(rate_limit: float | None, lag: float) -> None:
    """Expected: ṙ = ±rate toward the command, τ ḟ = r − f, in steps 500 times finer; six different commands."""
    h, fine = 1e-3, 500
    rng = np.random.default_rng(3)
    start, commands = rng.normal(size=6), rng.normal(size=(12, 6))
    commands[5] = commands[4]  # reached at last
    actuators = Actuators(rate_limit=rate_limit, lag=lag)
    loop = loop_of(12 * h, h, h, actuators=actuators, start_force=start, feedforward=commands)
    run = run_with(constant(np.zeros(6)), loop)
    ramp, force = start.copy(), start.copy()
    for j, command in enumerate(commands):
        total = np.zeros(6)
        for _ in range(fine):
            before = ramp
            most = np.inf if rate_limit is None else rate_limit * h / fine
            ramp = before + np.clip(command - before, -most, most)
            # exact for the mean of the ramp over so short a time
            middle = ramp if rate_limit is None else (before + ramp) / 2
            after = middle if lag == 0 else middle + (force - middle) * np.exp(-h / fine / lag)
            total += after if lag == 0 else (force + after) / 2
            force = after
        assert run.inputs[j, :6] == pytest.approx(total / fine, abs=4e-6)
        assert run.rate_limited[j].tolist() == (ramp != command).tolist()


def test_a_rate_limited_run_does_not_depend_on_the_plant_step() -> None:
    """Expected: within 1e-6 m of steps ten times finer; a swing of ΔF may leave ΔF h²/(12 m) = 4e-7 m, of 125 kg."""

    def swing(sample: object) -> FloatArray:
        return np.asarray(300 * np.sin(70 * sample.time + np.arange(6)))  # type: ignore[attr-defined]

    coarse, fine = (
        run_with(swing, loop_of(plant_step=step, actuators=Actuators(rate_limit=20e3)), Masses(100.0))
        for step in (1e-3, 1e-4)
    )
    assert coarse.rate_limited.any()
    assert np.abs(coarse.results[:, LENGTH] - fine.results[::10, LENGTH]).max() < 1e-6
