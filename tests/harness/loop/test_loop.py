"""The sampled loop, on a plant with a closed form and against python-control's discrete feedback."""

from collections.abc import Callable
from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart.harness.control.laws import Controller, Sample, controller_of, law_of
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.loop.actuators import Actuators, Drives
from gough_stewart.harness.loop.loop import Change, Limits, Loop, Run, simulate
from gough_stewart.harness.loop.sensors import Sensors
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants import signals
from gough_stewart.model.vectors import FloatArray
from tests.support.fake_plants import LENGTH, Masses

STILL = np.zeros(6)


def loop_of(
    duration: float = 0.5,
    sample_time: float = 0.01,
    plant_step: float | None = None,
    wanted_length: float | None = 1.2,
    feedforward: float = 0.0,
    **parts: Any,
) -> Loop:
    """A loop that wants a constant length."""
    timing = Timing(duration, sample_time, plant_step or sample_time)
    wanted = None
    if wanted_length is not None:
        wanted = np.zeros((timing.steps + 1, signals.SIZE + 6))
        wanted[:, LENGTH], wanted[:, 2] = wanted_length, wanted_length
    return Loop(
        timing, wanted, np.full((len(timing.samples), 6), feedforward), parts.pop("start_force", STILL), **parts
    )


def run_with(controller: Any, loop: Loop, plant: Masses | None = None, **options: Any) -> Run:
    made: Controller = controller_of(controller)
    return simulate(
        plant or Masses(),
        lambda wanted, measured: law_of(made, loop.timing.sample_time, np.zeros((0, 6, 6)), wanted, measured),
        loop,
        **options,
    )


def constant(force: float) -> Callable[[Sample], FloatArray]:
    return lambda _sample: np.full(6, force)


def pd(sample_time: float, kp: float = 50.0, kd: float = 15.0) -> Any:
    """Errors to forces, six equal channels: kp + kd (1 − z⁻¹)/T."""
    z = control.tf([1, 0], [1], sample_time)
    one = kp + kd * (z - 1) / (z * sample_time)
    return control.append(*[control.ss(one)] * 6)


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_the_loop_is_python_controls_discrete_feedback(delay: int) -> None:
    """Expected: response of feedback(z⁻ᵈ C(z) P(z)), P(z) the zero-order-hold equivalent of 1/(m s²), to a step."""
    T = 0.01
    loop = loop_of(sample_time=T, actuators=Actuators(delay=delay))
    assert loop.wanted is not None
    # at rest at first, where the controller's memory is zero; then a step of 0.2 m
    loop.wanted[0, LENGTH], loop.wanted[0, 2] = 1.0, 1.0
    run = run_with(pd(T), loop)
    plant = control.sample_system(control.ss([[0, 1], [0, 0]], [[0], [0.5]], [[1, 0]], 0), T)
    one = control.ss(control.tf([50 + 15 / T, -15 / T], [1, 0], T))
    late = control.ss(control.tf([1], [1] + [0] * delay, T))
    closed = control.feedback(control.series(one, late, plant), 1)
    response = control.forced_response(closed, loop.timing.times, 0.2 * (loop.timing.times > 0))
    assert np.abs(run.results[:, LENGTH] - 1 - response.outputs[:, None]).max() < 1e-12


def test_the_plant_step_changes_nothing_but_the_rows() -> None:
    """Expected: forces are held between samples, so that finer steps of an exact plant end in the same place."""
    coarse, fine = (run_with(pd(0.01), loop_of(plant_step=step)) for step in (0.01, 0.001))
    assert np.abs(coarse.results - fine.results[::10]).max() < 1e-12
    assert len(fine.time) == 501
    held = fine.inputs[:-1, :6].reshape(50, 10, 6)
    assert (held == held[:, :1]).all()
    assert (fine.sample_of_row == np.append(np.repeat(np.arange(50), 10), 49)).all()


def test_a_delay_holds_back_the_first_commands() -> None:
    """Expected: the starting forces for d samples, then the command."""
    loop = loop_of(0.05, start_force=np.full(6, 3.0), actuators=Actuators(delay=2))
    assert run_with(constant(7.0), loop).inputs[:, 0].tolist() == [3, 3, 7, 7, 7, 7]


def test_the_rate_limit_holds_at_every_plant_step() -> None:
    """Expected: a ramp of 100 N/s to 2 N, its mean over each step of 1 ms; the flag until the command is reached."""
    loop = loop_of(0.05, 0.01, 0.001, actuators=Actuators(rate_limit=100.0))
    run = run_with(constant(2.0), loop)
    expected = np.minimum(0.1 * np.arange(1, 51) - 0.05, 2.0)
    assert run.inputs[:-1, 0] == pytest.approx(expected, abs=1e-12)
    assert run.rate_limited[:-1, 0].tolist() == (0.1 * np.arange(1, 51) < 2.0 - 1e-9).tolist()


def test_the_lag_is_the_mean_of_its_closed_form_over_each_step() -> None:
    """Expected: f(t) = 2 (1 − e^(−t/τ)), averaged over [t, t+h]."""
    tau, h = 0.02, 0.001
    run = run_with(constant(2.0), loop_of(0.1, 0.01, h, actuators=Actuators(lag=tau)))
    t = run.time[:-1]
    mean = 2 - 2 * tau / h * np.exp(-t / tau) * (1 - np.exp(-h / tau))
    assert run.inputs[:-1, 0] == pytest.approx(mean, abs=1e-12)


@pytest.mark.parametrize("lag", [0.0, 4e-3])
@pytest.mark.parametrize("rate_limit", [None, 130.0])
def test_rate_limit_and_lag_act_by_their_mean_over_a_step(rate_limit: float | None, lag: float) -> None:
    """Expected: ṙ = ±rate toward the command, τ ḟ = r − f, in steps a thousand times finer; six different commands."""
    h, fine = 1e-3, 1000
    rng = np.random.default_rng(3)
    start, commands = rng.normal(size=6), rng.normal(size=(12, 6))
    drives = Drives(Actuators(rate_limit=rate_limit, lag=lag), start, h, h)
    ramp, force = start.copy(), start.copy()
    for command in commands:
        drives.command(command)
        mean, held_back = drives.step()
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
        assert mean == pytest.approx(total / fine, abs=2e-6)
        assert held_back.tolist() == (ramp != command).tolist()


def test_a_rate_limited_run_does_not_depend_on_the_plant_step() -> None:
    """Expected: within 1e-6 m of steps ten times finer; a swing of ΔF may leave ΔF h²/(12 m) = 5e-7 m, of 100 kg."""
    swing = lambda sample: 300 * np.sin(70 * sample.time + np.arange(6))  # noqa: E731
    coarse, fine = (
        run_with(swing, loop_of(plant_step=step, actuators=Actuators(rate_limit=20e3)), Masses(100.0))
        for step in (1e-3, 1e-4)
    )
    assert coarse.rate_limited.any()
    assert np.abs(coarse.results[:, LENGTH] - fine.results[::10, LENGTH]).max() < 1e-6


def test_samples_come_late_by_their_jitter_and_not_their_reference() -> None:
    """Expected: from 0 up to the jitter in whole steps, uniform; the law sees nominal time, late state."""
    timing = Timing(20.0, 0.01, 0.001, jitter=0.006, seed=3)
    late = timing.rows_of_samples - np.arange(0, 20000, 10)
    assert late[0] == 0
    assert np.unique(late).tolist() == [0, 1, 2, 3, 4, 5]
    # five standard errors of a share of 1/6 among 2,000
    assert np.abs(np.bincount(late) / 2000 - 1 / 6).max() < 5 * np.sqrt(5 / 36 / 2000)
    assert (timing.rows_of_samples != Timing(20.0, 0.01, 0.001, jitter=0.006, seed=4).rows_of_samples).any()
    seen = []

    def law(sample: Sample) -> FloatArray:
        seen.append((sample.time, sample.reference["leg_length"][2], sample.measured["leg_length"][2]))
        return np.full(6, 1.0 + len(seen) % 2)

    loop = loop_of(0.2)
    ramp = np.zeros((201, signals.SIZE + 6))
    ramp[:, LENGTH], ramp[:, 2] = 1 + np.arange(201)[:, None] * np.arange(1, 7) * 1e-4, 1.0
    short = Timing(0.2, 0.01, 0.001, jitter=0.006, seed=3)
    run = run_with(law, Loop(**{**vars(loop), "timing": short, "wanted": ramp}))
    rows = short.rows_of_samples
    assert [time for time, _, _ in seen] == pytest.approx(np.arange(20) * 0.01)
    assert [wanted for _, wanted, _ in seen] == pytest.approx(1 + np.arange(0, 200, 10) * 3e-4)
    assert [measured for _, _, measured in seen] == run.results[rows, 14].tolist()
    assert np.flatnonzero(np.diff(run.inputs[:200, 0])).tolist() == (rows[1:] - 1).tolist()
    assert run.sample_of_row.tolist() == [int((rows <= k).sum()) - 1 for k in range(201)]


@pytest.mark.parametrize("encoder", [0.004, 0.025])
def test_encoders_with_a_clock_of_their_own_hold_their_latest_reading(encoder: float) -> None:
    """Expected: at a sample the lengths of the encoders' last tick, quantised, whether they are faster or slower."""
    sensors = Sensors(quantisation={"leg_length": 1e-4}, sample_time=encoder)
    swing = lambda sample: np.sin(40 * sample.time + np.arange(6))  # noqa: E731
    run = run_with(swing, loop_of(0.3, 0.01, 0.001, sensors=sensors))
    ticks = np.floor(np.arange(0, 300, 10) / round(encoder / 1e-3) + 1e-9).astype(int) * round(encoder / 1e-3)
    assert run.measured[:, LENGTH] == pytest.approx(np.rint(run.results[ticks, LENGTH] / 1e-4) * 1e-4, abs=1e-12)
    assert (run.measured[:, 2] == run.results[ticks, 2]).all()


def test_what_is_injected_is_added_to_the_command_and_limited_with_it() -> None:
    """Expected: law + feedforward + injection, cut to the limit; different in every leg."""
    injection = np.random.default_rng(2).normal(size=(5, 6))
    run = run_with(constant(2.0), loop_of(0.05, feedforward=1.0, injection=injection, actuators=Actuators(3.5)))
    assert run.command == pytest.approx(3 + injection)
    assert run.inputs[:-1, :6] == pytest.approx(np.minimum(3 + injection, 3.5))


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Timing(1.0, 0.01, 0.001, jitter=0.01), "jitter is 0.01 s; expected less than the sample_time of 0.01"),
        (lambda: Timing(1.0, 0.01, 0.01, jitter=0.001), "at least the plant_step of 0.01 s"),
        (
            lambda: run_with(pd(0.01), loop_of(sensors=Sensors(sample_time=0.013))),
            "sample_time is 0.013 s; expected a m",
        ),
    ],
)
def test_jitter_and_encoders_that_do_not_fit_the_steps_are_refused(make: Callable[[], object], match: str) -> None:
    with pytest.raises(ControllerError, match=match):
        make()


def test_the_force_limit_cuts_and_says_so() -> None:
    """Expected: the command as it was, the force at the limit, the flag."""
    run = run_with(constant(-9.0), loop_of(0.05, actuators=Actuators(force_limit=4.0)))
    assert (run.command == -9).all()
    assert (run.inputs[:, :6] == -4).all()
    assert run.force_limited.all()


def test_controllers_hear_what_the_limits_cut_off() -> None:
    """Expected: a gain of 1 on the excess and 9 N feedforward: 9, then 9 + (4 − 9) = 4, which nothing cuts, then 9."""
    gain = control.ss([], [], [], np.hstack([np.zeros((6, 12)), np.eye(6)]), 0.01)
    run = run_with(gain, loop_of(0.04, feedforward=9.0, actuators=Actuators(force_limit=4.0)))
    assert run.command[:, 0].tolist() == [9.0, 4.0, 9.0, 4.0]


def test_the_rate_limit_is_part_of_the_excess() -> None:
    """Expected: 100 N/s · 10 ms = 1 N in reach of a command of 9 N: an excess of −8 N."""
    gain = control.ss([], [], [], np.hstack([np.zeros((6, 12)), np.eye(6)]), 0.01)
    run = run_with(gain, loop_of(0.02, feedforward=9.0, actuators=Actuators(rate_limit=100.0)))
    assert run.command[:, 0].tolist() == [9.0, 1.0]


@pytest.mark.parametrize("delay", [0, 2, 10])
def test_a_ramp_slower_than_the_rate_limit_cuts_nothing(delay: int) -> None:
    """Expected: half the rate limit is never held back, so that the controller hears of no excess."""
    heard = control.ss([], [], [], np.hstack([np.zeros((6, 12)), np.eye(6)]), 0.01)
    loop = loop_of(1.0, actuators=Actuators(rate_limit=1000.0, delay=delay))
    ramp = Loop(**{**vars(loop), "feedforward": 5.0 * np.arange(100.0)[:, None] * np.ones(6)})
    run = run_with(heard, ramp)
    assert run.command == pytest.approx(ramp.feedforward, abs=1e-9)
    assert not run.rate_limited.any()


@given(seed=st.integers(0, 2**32), deviation=st.floats(1e-6, 1e-2))
def test_the_same_seed_gives_the_same_bytes(seed: int, deviation: float) -> None:
    """Expected: identical bits for a seed, others for another; noise on one signal leaves the others' alone."""
    law = constant(1.0)
    noisy = Sensors({"leg_length": deviation, "position": deviation}, seed=seed)
    one, two = (run_with(law, loop_of(0.1, sensors=noisy)).measured for _ in range(2))
    assert one.tobytes() == two.tobytes()
    other = run_with(law, loop_of(0.1, sensors=Sensors(noisy.noise, seed=seed + 1))).measured
    assert (one[:, LENGTH] != other[:, LENGTH]).all()
    alone = run_with(law, loop_of(0.1, sensors=Sensors({"leg_length": deviation}, seed=seed))).measured
    assert alone[:, LENGTH].tobytes() == one[:, LENGTH].tobytes()


def test_noise_has_its_standard_deviation() -> None:
    """Expected: σ of 6 · 2,000 samples within five of its standard errors, σ/√(2n); mean within five of σ/√n."""
    sigma, n = 1e-3, 12000
    run = run_with(constant(0.0), loop_of(20.0, sensors=Sensors({"leg_length": sigma})))
    noise = run.measured[:, LENGTH] - 1.0
    assert abs(noise.std() - sigma) < 5 * sigma / np.sqrt(2 * n)
    assert abs(noise.mean()) < 5 * sigma / np.sqrt(n)


def test_quantised_lengths_are_multiples_within_half_a_step() -> None:
    """Expected: the definition of rounding to a step."""
    run = run_with(pd(0.01), loop_of(sensors=Sensors(quantisation={"leg_length": 1e-3})))
    measured, true = run.measured[:, LENGTH], run.results[:-1, LENGTH]
    assert np.abs(measured / 1e-3 - np.round(measured / 1e-3)).max() < 1e-9
    assert np.abs(measured - true).max() <= 0.5e-3 + 1e-12
    assert (run.measured[:, 2] == run.results[:-1, 2]).all()


def test_changes_come_into_effect_at_their_row() -> None:
    """Expected: a = F/m halves where m doubles; the wrench is an input from its time on."""
    changes = (Change(0.1, {"platform_mass": 4.0}), Change(0.2, external_wrench=np.arange(6.0)))
    run = run_with(constant(1.0), loop_of(0.3, changes=changes))
    gained = np.diff(run.results[:, 18])
    assert gained == pytest.approx(np.where(run.time[:-1] < 0.1 - 1e-9, 0.005, 0.0025), abs=1e-12)
    assert (run.inputs[:, 6:] == np.where(run.time[:, None] > 0.195, np.arange(6.0), 0.0)).all()


def test_a_failed_step_ends_the_run_with_its_cause() -> None:
    """Expected: rows up to the last good state, the plant's words."""
    run = run_with(constant(1.0), loop_of(), Masses(fails_at=0.1))
    assert run.outcome.status == "diverged"
    assert run.outcome.time == pytest.approx(0.1)
    assert "collapsed" in str(run.outcome.cause)
    assert run.time[-1] == pytest.approx(0.1)
    assert len(run.time) == len(run.results) == len(run.inputs) == len(run.sample_of_row) == 11


def test_forces_that_are_not_finite_end_the_run_before_they_act() -> None:
    """Expected: the row is kept with the forces before, the command as it was."""
    run = run_with(lambda s: np.full(6, np.nan if s.time > 0.095 else 1.0), loop_of())
    assert run.outcome.status == "diverged"
    assert "nan" in str(run.outcome.cause)
    assert run.time[-1] == pytest.approx(0.1)
    assert (run.inputs[:, :6] == 1.0).all()
    assert np.isnan(run.command[10]).all()
    first = run_with(constant(np.inf), loop_of())
    assert len(first.time) == 1


@pytest.mark.parametrize("force", [1e31, -1e308])
def test_forces_that_no_plant_takes_end_the_run_before_they_act(force: float) -> None:
    """Expected: the same outcome whatever the plant is; an FMU would refuse them, and the model fail in its step."""
    run = run_with(lambda s: np.array([1, 1, 1, 1, 1, force if s.time > 0.095 else 1.0]), loop_of())
    assert run.outcome.status == "diverged"
    assert f"{force!r}" in str(run.outcome.cause)
    assert run.time[-1] == pytest.approx(0.1)
    assert (run.inputs[:, :6] == 1.0).all()


def test_a_platform_that_has_left_its_reference_ends_the_run() -> None:
    """Expected: at a = 0.5 m/s², 0.2 − t²/4 < −0.3 first at t > √2 s, a row of 10 ms later at most."""
    loop = loop_of(3.0, limits=Limits(largest_position_error=0.3))
    run = run_with(constant(1.0), loop)
    assert run.outcome.status == "diverged"
    assert np.sqrt(2) < run.outcome.time < np.sqrt(2) + 0.01


def test_the_stroke_warns_or_stops() -> None:
    """Expected: 1 + t²/4 > 1.01 for t > 0.2; flags from there on, or the end."""
    warned, stopped = (run_with(constant(1.0), loop_of(limits=Limits((0.5, 1.01), how))) for how in ("warn", "stop"))
    assert (warned.stroke_exceeded[:, 0] == (warned.results[:, 12] > 1.01)).all()
    assert warned.outcome.status == "completed"
    assert stopped.outcome.status == "stopped"
    assert 0.2 < stopped.outcome.time <= 0.22
    assert "leg 1" in str(stopped.outcome.cause)


def test_ctrl_c_keeps_what_ran_so_far() -> None:
    """Expected: all rows before the interruption."""

    def interrupt(time: float) -> None:
        if time > 0.5:
            raise KeyboardInterrupt

    run = run_with(constant(0.0), loop_of(2.0), progress=interrupt)
    assert run.outcome.status == "interrupted"
    assert 0.5 < run.time[-1] < 2.0
    assert len(run.results) == len(run.time)


def test_without_a_law_the_feedforward_acts() -> None:
    """Expected: the open loop."""
    run = simulate(Masses(), None, loop_of(feedforward=2.5, wanted_length=None))
    assert (run.inputs[:, :6] == 2.5).all()
    assert run.controller_state.shape == (50, 0)


def test_a_function_sees_reference_and_measurement_by_name() -> None:
    """Expected: the fake plant's numbers under the interface's names."""
    seen: list[Sample] = []

    def law(sample: Sample) -> list[float]:
        seen.append(sample)
        return [0.0] * 6

    run_with(law, loop_of(0.02))
    assert seen[1].time == pytest.approx(0.01)
    assert (seen[0].reference["leg_length"] == 1.2).all()
    assert (seen[0].measured["leg_length"] == 1.0).all()
    assert seen[0].measured["position"].tolist() == [0, 0, 1]
    assert set(seen[0].measured) == set(signals.NAMES)
    assert (seen[0].reference["angular_acceleration"] == 0).all()


@pytest.mark.parametrize("given_back", [None, 3.0, [1, 2, 3], ["1"] * 6, np.zeros(6) + 1j])
def test_a_function_that_gives_no_six_forces_is_an_error(given_back: object) -> None:
    with pytest.raises(ControllerError, match="time 0 s; expected 6 forces"):
        run_with(lambda _sample: given_back, loop_of())


def test_a_function_that_fails_in_mid_run_ends_it_with_its_words() -> None:
    """Expected: an outcome with kind, text and time, and the rows before."""

    def failing(sample: Sample) -> list[float]:
        if sample.time > 0.095:
            raise RuntimeError("no more")
        return [1.0] * 6

    run = run_with(failing, loop_of())
    assert run.outcome.status == "stopped"
    assert "failed at time 0.1 s with RuntimeError: no more" in str(run.outcome.cause)
    assert len(run.time) == 10


@pytest.mark.parametrize(
    ("clocks", "match"),
    [
        ((1.0, 0.01, 0.003), r"plant_step 0.003 s does not divide sample_time 0.01 s.*0.00333"),
        ((1.0, 0.01, 0.02), "does not divide"),
        ((1.005, 0.02, 0.02), "duration"),
        ((-1.0, 0.01, 0.01), "duration is -1.0"),
        ((1.0, float("nan"), 0.01), "sample_time is nan"),
        ((1.0, 0.01, 0.0), "plant_step is 0.0"),
        ((1e9, 0.01, 0.01), r"duration 1e\+09 s has 1e\+11 plant steps of 0.01 s; expected at most 1000000"),
    ],
)
def test_clocks_that_do_not_fit_are_refused(clocks: tuple[float, float, float], match: str) -> None:
    with pytest.raises(ControllerError, match=match):
        Timing(*clocks)


def test_a_change_between_two_rows_is_refused() -> None:
    with pytest.raises(ControllerError, match=r"at 0.105 s.*multiple of the plant_step"):
        run_with(constant(0.0), loop_of(changes=(Change(0.105),)))
