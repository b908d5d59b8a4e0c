"""Loops that grow or oscillate by themselves: closed forms of errors, and loops whose stability is known otherwise."""

import html
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from scipy import signal

import gough_stewart as gs
from gough_stewart.harness.results.oscillation import LegRows, Oscillation, may_move, oscillation, self_excited
from gough_stewart.harness.results.record import Record, columns
from gough_stewart.model.vectors import FloatArray
from tests.harness.cli.test_terminal import invoke

STEP, N = 1e-3, 2000
TIME: FloatArray = np.asarray(STEP * np.arange(N), dtype=float)
# Six different legs.
SHARES = np.array([1.0, -0.7, 0.4, 0.9, -0.2, 0.55])
# The fourth is the farthest from Op.
POINTS = [[0.1, 0.05, 0.0], [-0.2, 0.1, 0.0], [0.0, -0.25, 0.05], [0.3, 0.1, 0.0], [-0.1, -0.2, 0.0], [0.2, 0.0, 0.1]]


def record_of(error: FloatArray, motion: FloatArray | None = None, **sensors: Any) -> Record:
    """A record with these errors (n, 6) [m] about a reference that moves so (n,) in all legs [m]."""
    n = len(error)
    moves = np.zeros(n) if motion is None else motion
    reference = 2.0 + moves[:, None] * np.ones(6)
    values = {
        "time": STEP * np.arange(n)[:, None],
        "leg_length": reference - error,
        "reference.leg_length": reference,
        "reference.leg_velocity": np.gradient(reference, STEP, axis=0),
        "error.leg_length": error,
    }
    table = {
        name: values[key][:, k]
        for key in values
        for k, name in enumerate(["time"] if key == "time" else columns(key, 6))
    }
    known = {
        "outcome": {"status": "completed", "time": STEP * (n - 1), "cause": None},
        "platform": {"platform_points": POINTS},
        "experiment": {"controller": {"type": "pd"}, "sensors": sensors},
    }
    return Record(polars.DataFrame(table), known)


def found_in(error: FloatArray, motion: FloatArray | None = None, **sensors: Any) -> Oscillation | None:
    """From one signal (n,), with another share in each leg."""
    return oscillation(record_of(error[:, None] * SHARES, motion, **sensors))


@pytest.mark.parametrize(("frequency", "amplitude"), [(3.7, 0.02), (38.3, 4e-4), (140.0, 5e-5)])
def test_a_cycle_is_told_by_frequency_and_amplitude(frequency: float, amplitude: float) -> None:
    """Expected: those of a sine in the errors, in the leg with the largest share; it does not grow."""
    found = found_in(2e-3 * np.exp(-9 * TIME) + amplitude * np.sin(2 * np.pi * frequency * TIME + 0.3))
    assert found is not None
    assert not found.is_growing
    assert found.leg == 1
    assert found.frequency == pytest.approx(frequency, rel=0.03)
    assert found.amplitude == pytest.approx(amplitude, rel=0.1)
    assert f"{found.frequency:.3g} Hz" in found.text()


@pytest.mark.parametrize("frequency", [3.7, 38.3])
def test_an_oscillation_that_decays_is_none(frequency: float) -> None:
    """Expected: none at a damping ratio of 2 %, whose decay from one half of the rest to the other is 10 to 100 %."""
    assert found_in(0.02 * np.exp(-0.02 * 2 * np.pi * frequency * TIME) * np.cos(2 * np.pi * frequency * TIME)) is None


@pytest.mark.parametrize("rate", [1.0, 3.0])
def test_what_rises_exponentially_is_growing(rate: float) -> None:
    """Expected: growth, for a mode that oscillates, and for one that does not and starts slower than it goes on."""
    swinging = found_in(1e-3 * np.exp(rate * TIME) * np.sin(2 * np.pi * 4 * TIME))
    assert swinging is not None
    assert swinging.is_growing
    assert swinging.frequency == pytest.approx(4, rel=0.05)
    assert swinging.amplitude == pytest.approx(1e-3 * np.exp(rate * 2), rel=0.25)
    leaving = found_in(1e-3 * np.exp((1 + rate) * TIME))
    assert leaving is not None
    assert leaving.is_growing
    assert leaving.frequency is None


@pytest.mark.parametrize("constant", [0.1, 0.6, 3.0])
def test_what_comes_to_rest_elsewhere_is_none(constant: float) -> None:
    """Expected: none for a first-order approach to an error that stays, however slow."""
    assert found_in(0.01 * (1 - np.exp(-TIME / constant))) is None


def test_a_step_that_comes_back_twice_as_far_is_growing() -> None:
    """Expected: growth by the step of the reference, in a run too short for a cycle."""
    moves = np.where(TIME >= 1.5, 0.01, 0.0)
    error = np.where(TIME >= 1.5, 0.01 * np.cos(2 * np.pi * 2 * (TIME - 1.5)) * np.exp(3 * (TIME - 1.5)), 0.0)
    found = found_in(error, moves)
    assert found is not None
    assert found.is_growing
    assert found.earlier == pytest.approx(0.01)
    assert found.since == pytest.approx(1.5)
    assert found_in(np.where(TIME >= 1.5, 0.01 * np.cos(2 * np.pi * 2 * (TIME - 1.5)), 0.0), moves) is None


def _white(random: np.random.Generator) -> FloatArray:
    return 1e-3 * random.normal(size=N)


def _through_a_loop(random: np.random.Generator) -> FloatArray:
    """White noise through a second-order loop of 1 to 10 Hz with a damping ratio of 0.2 to 1."""
    w, damping = 2 * np.pi * random.uniform(1, 10), random.uniform(0.2, 1)
    polynomials = [2 * damping * w, w * w], [1.0, 2 * damping * w, w * w]
    over, under = signal.bilinear(*polynomials, fs=1 / STEP)
    response: FloatArray = 1e-3 * signal.lfilter(over, under, random.normal(size=N + 500))[500:]
    return response


@pytest.mark.parametrize("noise", [_white, _through_a_loop])
def test_declared_noise_is_no_alarm(noise: Callable[[np.random.Generator], FloatArray]) -> None:
    """Expected: no alarm in 200 records, which a false-alarm rate of 2.3 % would give in 1 of 100 cases only.

    An alarm takes an amplitude of 6 σ; the RMS of the error is at most about σ.
    """
    random = np.random.default_rng(25)
    assert sum(found_in(noise(random), noise={"leg_length": 1e-3}) is not None for _ in range(200)) == 0


@pytest.mark.parametrize(
    ("sensors", "least"),
    [
        ({"noise": {"leg_length": 2e-4}}, 12e-4),
        ({"quantisation": {"leg_length": 2e-4}}, 6e-4),
        ({"noise": {"orientation": 1e-3}}, 6e-3 * np.hypot(0.3, 0.1)),
        ({"quantisation": {"leg_velocity": 0.5}}, 1.5 / (2 * np.pi * 38)),
        ({}, 2e-6),
    ],
)
def test_a_cycle_is_told_from_six_sigma_and_three_steps_on(sensors: dict[str, Any], least: float) -> None:
    """Expected: silence 10 % below and an alarm 10 % above; angles by the joints' radius, rates by the frequency."""
    cycle = np.sin(2 * np.pi * 38 * TIME)
    assert found_in(0.9 * least * cycle, **sensors) is None
    assert found_in(1.1 * least * cycle, **sensors) is not None


def test_white_noise_that_nobody_declares_is_no_line() -> None:
    """Expected: none in 200 records: of 667 bins, five have seldom more than 3 % of the power."""
    random = np.random.default_rng(26)
    assert sum(found_in(_white(random)) is not None for _ in range(200)) == 0


def test_what_the_reference_explains_is_none() -> None:
    """Expected: none for errors of a loop that follows sines and slow moves, with friction and a nonlinear part."""
    random = np.random.default_rng(27)
    for _ in range(60):
        f, phase = random.uniform(0.3, 6), random.uniform(0, 6)
        angle = 2 * np.pi * f * TIME + phase
        friction = np.tanh(20 * np.cos(angle))
        error = 2e-3 * np.sin(angle - 0.4) + 4e-4 * friction + 1e-4 * np.sin(angle) ** 2
        assert found_in(error, 0.02 * np.sin(angle)) is None
        share = np.clip(TIME / random.uniform(0.5, 3), 0, 1)
        moves = share**3 * (10 - 15 * share + 6 * share**2)
        assert found_in(1e-3 * np.gradient(moves, STEP) + 2e-4 * np.sin(3 * moves), 0.1 * moves) is None


def test_a_cycle_beside_a_slow_sine_is_told() -> None:
    """Expected: the cycle's frequency, far above the reference's; its growth, if it grows."""
    slow = np.sin(2 * np.pi * 0.4 * TIME)
    cycle = 3e-4 * np.sin(2 * np.pi * 47 * TIME)
    found = found_in(1e-3 * slow + cycle, 0.05 * slow)
    assert found is not None
    assert not found.is_growing
    assert found.frequency == pytest.approx(47, rel=0.02)
    growing = found_in(1e-3 * slow + cycle * np.exp(2 * TIME), 0.05 * slow)
    assert growing is not None
    assert growing.is_growing


def test_leg_amplitude_and_times_are_those_of_the_leg_that_moves_most() -> None:
    """Expected: of six legs that cycle alike, in other sizes, the fourth; from the row after the last change on."""
    shares = np.array([0.3, -0.5, 0.2, 1.0, -0.6, 0.1])
    cycle = 4e-4 * np.sin(2 * np.pi * 38 * TIME)[:, None] * shares
    moves = np.where(TIME >= 0.4, 0.003, 0.0)
    record = record_of(cycle, moves)
    later = Record(record.table.with_columns(polars.col("time") + 7.3), record.metadata)
    found = oscillation(later)
    assert found is not None
    assert (found.leg, found.is_growing, found.earlier) == (4, False, None)
    assert found.amplitude == pytest.approx(4e-4, rel=0.02)
    assert found.frequency == pytest.approx(38, rel=0.01)
    assert found.since == pytest.approx(7.7)
    assert found.text() == (
        f"leg 4 oscillates at 38 Hz by itself, with an amplitude of {1e3 * found.amplitude:.3g} mm. Lower the "
        "bandwidth or the delay; `gough-stewart margins` shows what the loop allows"
    )
    slow = np.sin(2 * np.pi * 0.4 * TIME)
    moving = oscillation(record_of(cycle + 1e-3 * slow[:, None], 0.05 * slow))
    assert moving is not None
    assert moving.leg == 4
    assert moving.amplitude == pytest.approx(4e-4, rel=0.02)
    assert moving.since == pytest.approx(TIME[N // 3])


def test_growth_is_told_with_both_sizes() -> None:
    """Expected: of 1 mm · e^(0.8 t) in the second leg at 12 Hz: the peaks of the first quarter and of the end."""
    shares = np.array([0.3, 1.0, -0.2, 0.5, -0.6, 0.1])
    error = (1e-3 * np.exp(0.8 * TIME) * np.sin(2 * np.pi * 12 * TIME))[:, None] * shares
    found = oscillation(record_of(error))
    assert found is not None
    assert (found.leg, found.is_growing, found.since) == (2, True, 0.0)
    assert found.earlier == pytest.approx(1e-3 * np.exp(0.8 * 0.44), rel=0.08)
    assert found.amplitude == pytest.approx(1e-3 * np.exp(0.8 * 1.98), rel=0.08)
    assert found.frequency == pytest.approx(12, rel=0.03)
    sizes = f"from {1e3 * (found.earlier or 0):.3g} to {1e3 * found.amplitude:.3g} mm after 0 s"
    assert found.text().startswith(f"leg 2: by itself, the error grows at {found.frequency:.3g} Hz {sizes}. Lower the")
    leaving = oscillation(record_of((1e-3 * np.exp(3 * TIME))[:, None] * shares))
    assert leaving is not None
    assert (leaving.leg, leaving.frequency) == (2, None)
    assert leaving.earlier == pytest.approx(1e-3)
    assert leaving.amplitude == pytest.approx(1e-3 * np.exp(3 * TIME[-1]))
    assert "by itself, the error grows from 1 to 402 mm after 0 s" in leaving.text()


@pytest.mark.parametrize(
    "name", ["external_force[2]", "external_torque[3]", "controller.injection[4]", "platform_mass", "gravity[1]"]
)
def test_what_acts_on_the_loop_begins_the_judged_part_anew(name: str) -> None:
    """Expected: from its last change on; a cycle that ends there is none, whatever column acts, of six the fourth."""
    cycle = np.where(TIME < 1.2, 4e-4 * np.sin(2 * np.pi * 38 * TIME), 0.0)
    after = np.where(TIME < 1.2, 0.0, 4e-4 * np.sin(2 * np.pi * 38 * TIME))
    acts = polars.Series(name, np.where(TIME < 1.2, 5.0, 7.0))
    for error, is_found in ((cycle, False), (after, True)):
        record = record_of(error[:, None] * SHARES)
        record.metadata["machine"] = {"platform_mass": 5.0, "gravity": [0.0, 0.0, -9.81]}
        found = oscillation(Record(record.table.with_columns(acts), record.metadata))
        assert (found is not None) == is_found
        if found is not None:
            assert found.since == pytest.approx(1.2)
    # a column of results does not act
    ended = Record(
        record_of(after[:, None] * SHARES).table.with_columns(polars.Series("kinetic_energy", TIME)), record.metadata
    )
    found = oscillation(ended)
    assert found is None or found.since == 0.0


def test_short_runs_open_loops_and_runs_that_ended_early_are_not_judged() -> None:
    """Expected: none for 31 rows, but for 32 of the same growth; none without control, or without completion."""
    error = (1e-3 * np.exp(200 * TIME))[:, None] * SHARES
    whole = record_of(error[:32])
    assert oscillation(whole) is not None
    assert oscillation(record_of(error[:31])) is None
    status = {**whole.metadata, "outcome": {"status": "diverged", "time": 0.03, "cause": "far"}}
    assert oscillation(Record(whole.table, status)) is None
    assert (
        oscillation(Record(whole.table, {**whole.metadata, "experiment": {"controller": {"type": "open_loop"}}}))
        is None
    )
    assert (
        oscillation(Record(whole.table.drop("error.leg_length[6]").drop(columns("leg_length", 6)), whole.metadata))
        is None
    )
    lost = whole.table.with_columns(polars.Series("error.leg_length[6]", np.r_[error[:31, 5], np.nan]))
    assert oscillation(Record(lost, whole.metadata)) is None


@pytest.mark.parametrize(
    ("kind", "signal", "value", "factor"),
    [
        ("noise", "leg_length", 2e-4, 1.0),
        ("noise", "position", 2e-4, 1.0),
        ("noise", "orientation", 1e-3, np.hypot(0.3, 0.1)),
        ("noise", "leg_velocity", 0.05, 1 / (2 * np.pi * 38)),
        ("noise", "velocity", 0.05, 1 / (2 * np.pi * 38)),
        ("noise", "angular_velocity", 0.1, np.hypot(0.3, 0.1) / (2 * np.pi * 38)),
        ("quantisation", "position", 2e-4, 1.0),
        ("quantisation", "angular_velocity", 0.1, np.hypot(0.3, 0.1) / (2 * np.pi * 38)),
    ],
)
def test_each_sensor_explains_amplitudes_of_its_own(kind: str, signal: str, value: float, factor: float) -> None:
    """Expected: six deviations or three steps, as lengths at 38 Hz: silence 10 % below, an alarm 10 % above."""
    least = (6 if kind == "noise" else 3) * value * factor
    cycle = np.sin(2 * np.pi * 38 * TIME)
    sensors: dict[str, Any] = {kind: {"leg_length": 1e-9, signal: value}}
    assert found_in(0.9 * least * cycle, **sensors) is None
    assert found_in(1.1 * least * cycle, **sensors) is not None


def test_metrics_show_what_the_loop_does_by_itself() -> None:
    """Expected: the sentence of `run` before the tables, in a terminal and in a notebook; nothing for a sound loop."""
    cycle = 4e-4 * np.sin(2 * np.pi * 38 * TIME)
    record = gs.run("heave_step", {"loop.duration": 0.3})
    sound, cycling = gs.metrics(record), gs.metrics(record)
    found = found_in(cycle)
    assert found is not None
    cycling["outcome"] = {**cycling["outcome"], "oscillation": found._asdict()}
    assert sound["outcome"]["oscillation"] is None
    text = " ".join(str(cycling).split())
    assert text.startswith(f"completed at 0.3 s; {found.text()}")
    assert found.text() in html.unescape(cycling._repr_html_())
    assert str(sound).startswith("Tracking error")
    assert "by itself" not in sound._repr_html_()
    ended = {"status": "stopped", "time": 0.1, "cause": "leg <3> & more", "oscillation": None}
    sound["outcome"] = ended
    assert str(sound).startswith("stopped at 0.1 s: leg <3> & more\n")
    assert "stopped at 0.1 s: leg &lt;3&gt; &amp; more" in sound._repr_html_()


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (("heave_step", "--set", "loop.delay=60"), 0, r"oscillates at 2\.[67]\d? Hz by itself"),
        (("heave_step", "--set", "controller.bandwidth=20", "--set", "loop.delay=4"), 0, r"oscillates at 38(\.\d)? Hz"),
        (("too_slow", "--set", "loop.duration=1.6"), 3, "growing: leg"),
        (("heave_step", "--set", "loop.duration=0.6"), 0, ""),
    ],
)
def test_a_run_says_how_its_loop_ends(arguments: tuple[str, ...], code: int, says: str, tmp_path: Path) -> None:
    """Expected: three loops with an eigenvalue outside of the unit circle are told, the shipped one is not."""
    done = invoke("run", *arguments, "--out", str(tmp_path))
    assert done.exit_code == code
    assert re.search(says, done.stderr)
    assert ("by itself" in done.stderr) == bool(says)


@pytest.mark.parametrize("moving", [False, True])
def test_the_quick_look_at_many_members_passes_over_none_that_moves(moving: bool) -> None:
    """Expected: every member of which the whole judgement says something; and most sound ones are passed over."""
    rng = np.random.default_rng(17)
    n, members = 600, 160
    time: FloatArray = np.asarray(7.3 + 2e-3 * np.arange(n), dtype=float)
    shape = np.array([1.0, -0.7, 0.4, 0.9, -1.2, 0.6])
    turns = 2 * np.pi * (time - time[0])
    reference = 2.0 + 0.1 * np.outer(np.sin(0.5 * turns) if moving else turns >= 0.8, shape)
    begins = n - 1 if moving else int(np.argmax(turns >= 0.8))
    decay, rate = rng.uniform(-3, 4, members), rng.uniform(5, 300 if moving else 60, members)
    phase = rng.uniform(0, 6, (members, 6))
    waves = np.cos(rate[None, :, None] * turns[:, None, None] + phase) * shape
    envelope = np.exp(-np.outer(time - time[0], decay))[..., None]
    noise = rng.normal(size=(n, members, 6)) * 10.0 ** rng.uniform(-7, -3, members)[:, None]
    errors = 1e-3 * envelope * waves * (rng.random(members) < 0.6)[:, None] + noise
    errors += (
        1e-4
        * np.exp(np.outer(time - time[0], 6 * rng.random(members)))[..., None]
        * (rng.random(members) < 0.2)[:, None]
    )
    wanted: FloatArray = np.asarray(reference, dtype=float)
    rows: FloatArray = np.asarray(errors, dtype=float)
    found = [
        self_excited(LegRows(time, rows[:, k], wanted, begins, lambda _frequency: 1e-6)) is not None
        for k in range(members)
    ]
    may = may_move(rows, time, wanted, begins)
    assert not (np.array(found) & ~may).any()
    assert 20 < sum(found) < 140
    assert (~may).sum() > 20


def judged(error: FloatArray, reference: FloatArray | float = 2.0) -> Oscillation | None:
    """Of legs (n, 6), with nothing that acts."""
    n = len(error)
    return self_excited(LegRows(TIME[:n], error, np.broadcast_to(reference, (n, 6)) * 1.0, 0, lambda _frequency: 1e-6))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_lengths_that_no_platform_has_are_not_judged(sign: float) -> None:
    """Expected: an alarm 1 % below 10⁹ m and silence 1 % above, of error and reference, in one leg of six."""
    growing = np.exp(3 * (TIME - TIME[-1]))[:, None] * np.eye(6)[3]
    for factor, is_judged in ((0.99, True), (1.01, False)):
        size = sign * factor * 1e9
        assert (judged(size * growing) is not None) == is_judged
        assert (judged(growing, 2.0 + size * np.eye(6)[4]) is not None) == is_judged
    for lost in (np.nan, np.inf):
        assert judged(growing, np.where(np.arange(6) == 4, lost, 2.0)) is None


@pytest.mark.parametrize(("n", "frequency", "last"), [(N, 38.0, 1600), (100, 200.0, 68)])
def test_the_end_of_a_run_is_judged_from_a_fifth_of_its_rows_on_and_32(n: int, frequency: float, last: int) -> None:
    """Expected: at rest from the step on, if it leaves so many rows; one row less, nothing is told from the step."""
    cycle = 4e-4 * np.sin(2 * np.pi * frequency * TIME[:n])
    found = found_in(cycle, np.where(np.arange(n) >= last, 1e-4, 0.0))
    assert found is not None
    assert found.since == pytest.approx(TIME[last])
    assert found.frequency == pytest.approx(frequency, rel=0.01)
    assert found_in(cycle, np.where(np.arange(n) >= last + 1, 1e-4, 0.0)) is None


@pytest.mark.parametrize(
    ("rate", "is_found", "grows"),
    [(-0.18, False, False), (-0.14, True, False), (0.36, True, False), (0.46, True, False), (0.5, True, True)],
)
def test_how_fast_a_cycle_grows_decides_what_it_is(rate: float, is_found: bool, grows: bool) -> None:
    """Expected: it lasts if 90 % of it are left 0.67 s later, and grows if 2 s double it, first quarter to last third.

    e^(0.667 · −0.158) = 0.9; e^(1.5 · 0.462) = 2.
    """
    found = found_in(4e-4 * np.exp(rate * TIME) * np.sin(2 * np.pi * 38 * TIME))
    assert (found is not None) == is_found
    if found is not None:
        assert found.is_growing == grows
        assert found.frequency == pytest.approx(38, rel=0.01)
        assert (found.earlier is not None) == grows
        end = 4e-4 * np.exp(rate * (TIME[-1] if grows else 5 * TIME[-1] / 6))
        assert found.amplitude == pytest.approx(end, rel=0.03)


@pytest.mark.parametrize(
    ("error", "is_found"),
    [
        # 1.15 times as much from each sixth of 2 s to the next: e^(0.419 / 3)
        (1e-2 * np.exp(0.40 * TIME), False),
        (1e-2 * np.exp(0.44 * TIME), True),
        (-1e-2 * np.exp(0.44 * TIME), True),
        # towards zero
        (1e-2 * (3 - np.exp(0.5 * TIME)), False),
        # by less than sensors explain, and by more
        (1e-7 * np.exp(TIME), False),
        (1e-6 * np.exp(TIME), True),
    ],
)
def test_an_error_that_leaves_ever_faster_grows(error: FloatArray, is_found: bool) -> None:
    found = found_in(error)
    assert (found is not None) == is_found
    if found is not None:
        assert (found.is_growing, found.frequency, found.leg) == (True, None, 1)
        assert found.earlier == pytest.approx(abs(error[0]))
        assert found.amplitude == pytest.approx(abs(error[-1]))
        assert found_in(error, noise={"leg_length": 0.2 * abs(error[-1])}) is None


@pytest.mark.parametrize("n", [1500, 1501, 1999, 2000])
def test_a_slow_drift_hides_no_cycle(n: int) -> None:
    """Expected: the cycle, in windows of odd and even length, beside an error that changes a hundred times as much."""
    found = found_in((0.02 * TIME + 0.01 + 4e-4 * np.sin(2 * np.pi * 38 * TIME))[:n])
    assert found is not None
    assert not found.is_growing
    assert found.frequency == pytest.approx(38, rel=0.005)
    assert found.amplitude == pytest.approx(4e-4, rel=0.01)


def test_a_small_change_counts_beside_a_large_constant() -> None:
    """Expected: 0.1 mm of the reference beside 10⁶ N, from its row on; rounding of the large one is no change."""
    record = record_of((4e-4 * np.sin(2 * np.pi * 38 * TIME))[:, None] * SHARES, np.where(TIME >= 1.2, 1e-4, 0.0))
    pushed = polars.Series("external_force[1]", 1e6 + 1e-4 * (TIME >= 1.5))
    found = oscillation(Record(record.table.with_columns(pushed), record.metadata))
    assert found is not None
    assert found.since == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("frequency", "is_found"), [(3.0, False), (7.0, False), (14.0, False), (18.0, True), (25.0, True)]
)
def test_in_motion_only_what_is_far_above_the_reference_is_told(frequency: float, is_found: bool) -> None:
    """Expected: ten times above a sine of 0.4 Hz, which two bins of 0.75 Hz hold: from 15 Hz on."""
    slow = np.sin(2 * np.pi * 0.4 * TIME)
    found = found_in(1e-3 * slow + 3e-4 * np.sin(2 * np.pi * frequency * TIME), 0.05 * slow)
    assert (found is not None) == is_found
    if found is not None:
        assert found.frequency == pytest.approx(frequency, rel=0.005)
        assert found.amplitude == pytest.approx(3e-4, rel=0.01)
        assert not found.is_growing


_AFTER = np.maximum(TIME - 0.8, 0)
# Errors after a step of 10 mm at 0.8 s, and whether they are growing; None where the loop is sound.
AFTER_A_STEP: dict[str, tuple[FloatArray, bool | None]] = {
    "a cycle": (4e-4 * np.sin(2 * np.pi * 38 * _AFTER), False),
    "a cycle that grows": (1e-5 * np.exp(1.2 * _AFTER) * np.sin(2 * np.pi * 12 * _AFTER), True),
    "a slow cycle that grows": (1e-3 * np.exp(1.2 * _AFTER) * np.sin(2 * np.pi * 1.1 * _AFTER), None),
    "ever faster": (1e-4 * np.exp(2 * _AFTER), True),
    "back and three times as far": (0.01 * np.cos(1.6 * np.pi * _AFTER) * np.exp(1.2 * _AFTER) * (TIME >= 0.8), True),
    "back and less far": (0.01 * np.cos(1.6 * np.pi * _AFTER) * np.exp(-0.1 * _AFTER) * (TIME >= 0.8), None),
    "a decay": (0.01 * np.cos(10 * np.pi * _AFTER) * np.exp(-4 * _AFTER) * (TIME >= 0.8), None),
    "a slow approach": (0.01 * (1 - np.exp(-_AFTER / 0.6)), None),
    "a ramp": (1e-3 * _AFTER, None),
    "slower and slower": (1e-3 * _AFTER - 1e-4 * _AFTER**2, None),
    "noise": (1e-4 * np.random.default_rng(1).normal(size=N), None),
}


def test_each_reason_alone_is_seen_by_both_looks_at_a_loop() -> None:
    """Expected: as named above, of one member and of all at once, whose quick look may see more but not everything."""
    errors = np.stack([error[:, None] * SHARES for error, _ in AFTER_A_STEP.values()], axis=1)
    reference = 2.0 + np.where(TIME >= 0.8, 0.01, 0.0)[:, None] * np.ones(6)
    begins = 800
    may = may_move(errors, TIME, reference, begins)
    for k, (what, (_, grows)) in enumerate(AFTER_A_STEP.items()):
        found = self_excited(LegRows(TIME, errors[:, k], reference, begins, lambda _frequency: 1e-6))
        assert (None if found is None else found.is_growing) == grows, what
        assert may[k] == (grows is not None or what == "a slow cycle that grows"), what
    assert not may_move(errors[:31], TIME[:31], reference[:31], 0).any()
    assert may_move(errors[800:], TIME[800:], reference[800:], 0).tolist()[0]
    assert not may_move(errors[:, :0], TIME, reference, begins).size
    # a fifth of the rows is enough, and one row less is not
    cycle = (4e-4 * np.sin(2 * np.pi * 38 * TIME))[:, None, None] * SHARES
    for at, is_enough in ((1600, True), (1601, False)):
        late = 2.0 + np.where(np.arange(N) >= at, 1e-4, 0.0)[:, None] * np.ones(6)
        assert may_move(cycle, TIME, late, at).tolist() == [is_enough]
    # a reference that moves to the end, without any acceleration, explains nothing
    assert not may_move(errors, TIME, np.full((N, 6), 2.0), N - 1).any()


def test_the_lines_of_each_kind_are_those_of_the_metadata() -> None:
    """Expected: without sensors or experiment in the metadata, as of exact ones; open loops by their type alone."""
    record = record_of((4e-4 * np.sin(2 * np.pi * 38 * TIME))[:, None] * SHARES)
    whole = record.metadata
    for known in (
        {key: whole[key] for key in ("outcome", "platform")},
        {**whole, "experiment": {}},
        {**whole, "experiment": {"controller": {"type": "pid"}, "sensors": None}},
        {**whole, "experiment": {"sensors": {"noise": None, "quantisation": None}}},
        {**whole, "platform": {}},
    ):
        assert oscillation(Record(record.table, known)) is not None


def test_each_leg_is_explained_by_its_own_motion() -> None:
    """Expected: of six motions at other frequencies, large errors that follow them are none; beside them, a cycle."""
    angle = 2 * np.pi * np.outer(TIME, [0.4, 0.9, 0.5, 1.1, 0.7, 0.6]) + np.arange(6)
    reference: FloatArray = np.asarray(2 + 0.05 * np.sin(angle), dtype=float)
    error: FloatArray = np.asarray(0.3 * np.cos(angle) + 0.1 * np.sin(angle), dtype=float)
    cycling = error + 3e-4 * np.sin(2 * np.pi * 47 * TIME)[:, None] * np.eye(6)[3]
    assert self_excited(LegRows(TIME, error, reference, N - 1, lambda _frequency: 1e-6)) is None
    found = self_excited(LegRows(TIME, cycling, reference, N - 1, lambda _frequency: 1e-6))
    assert found is not None
    assert found.leg == 4
    assert found.amplitude == pytest.approx(3e-4, rel=0.03)
    assert found.frequency == pytest.approx(47, rel=1e-3)
    assert may_move(np.stack([error, cycling], axis=1), TIME, reference, N - 1).tolist() == [False, True]


def test_growth_that_sensors_explain_is_none() -> None:
    """Expected: a cycle that grows to 1.3 mm, beside 6 σ of 1.2 mm and of 1.5 mm."""
    growing = 4e-4 * np.exp(0.6 * TIME) * np.sin(2 * np.pi * 38 * TIME)
    louder, quieter = (found_in(growing, noise={"leg_length": sigma}) for sigma in (2.5e-4, 2.0e-4))
    assert louder is None
    assert quieter is not None
    assert quieter.is_growing


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_step_counts_from_rest_in_either_direction(sign: float) -> None:
    """Expected: growth by its size after a motion that ended long before; not after one that ended just there."""
    after = TIME >= 1.5
    error = sign * np.where(after, 0.01 * np.cos(4 * np.pi * (TIME - 1.5)) * np.exp(3 * (TIME - 1.5)), 0.0)
    step = sign * np.where(after, 0.01, 0.0)
    early = np.where(TIME < 0.5, 0.02 * (1 - np.cos(4 * np.pi * TIME)), 0.0)
    for moves in (step, step + early):
        found = found_in(error, moves)
        assert found is not None
        assert found.is_growing
        assert found.since == pytest.approx(1.5)
        assert found.earlier == pytest.approx(0.01)
    ramp = sign * np.where(after, 0.01, np.maximum(TIME - 1.49, 0.0))
    assert found_in(error, ramp) is None
