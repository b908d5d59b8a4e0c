"""Loops that grow or oscillate by themselves: closed forms of errors, and loops whose stability is known otherwise."""

import html
from collections.abc import Callable
from typing import Any

import numpy as np
import polars
import pytest
from scipy import signal

import gough_stewart as gs
from tests.support.records import Floats, columns

STEP, N = 1e-3, 2000
TIME: Floats = np.asarray(STEP * np.arange(N), dtype=float)
# Six different legs, and joints of which the fourth is the farthest from Op.
SHARES = np.array([1.0, -0.7, 0.4, 0.9, -0.2, 0.55])
POINTS = [[0.1, 0.05, 0.0], [-0.2, 0.1, 0.0], [0.0, -0.25, 0.05], [0.3, 0.1, 0.0], [-0.1, -0.2, 0.0], [0.2, 0.0, 0.1]]


def record_of(error: Floats, motion: Floats | None = None, **sensors: Any) -> gs.Record:
    """A record with errors (n, 6) [m], or of (n,) with another share in each leg, about a reference (n,) or (n, 6)."""
    error = np.outer(error, SHARES) if error.ndim == 1 else error
    n = len(error)
    moves = np.zeros(n) if motion is None else motion
    reference = 2.0 + (np.outer(moves, np.ones(6)) if moves.ndim == 1 else moves)
    zeros = np.zeros((n, 6))
    values = {
        **{"leg_length": reference - error, "reference.leg_length": reference, "error.leg_length": error},
        **{"position": zeros[:, :3], "orientation": zeros[:, :3], "leg_velocity": zeros, "actuator_force": zeros},
    }
    table = {k: v for name, value in values.items() for k, v in columns(name, value).items()}
    known = {
        "outcome": {"status": "completed", "time": STEP * (n - 1), "cause": None},
        "platform": {"platform_points": POINTS},
        "experiment": {"controller": {"type": "pd"}, "sensors": sensors},
    }
    return gs.Record(polars.DataFrame({"time": STEP * np.arange(n), **table}), known)


def found_in(record: gs.Record | Floats, motion: Floats | None = None, **sensors: Any) -> dict[str, Any] | None:
    whole = record if isinstance(record, gs.Record) else record_of(record, motion, **sensors)
    oscillation: dict[str, Any] | None = gs.metrics(whole)["outcome"]["oscillation"]
    return oscillation


def cycle(frequency: float, amplitude: float = 4e-4, rate: float = 0.0) -> Floats:
    return np.asarray(amplitude * np.exp(rate * TIME) * np.sin(2 * np.pi * frequency * TIME))


def after_step(frequency: float, rate: float) -> Floats:
    """The error after a step of 10 mm at 1.5 s: it swings about the new reference."""
    late = TIME - 1.5
    return np.where(late >= 0, 0.01 * np.cos(2 * np.pi * frequency * late) * np.exp(rate * late), 0.0)


STEPS_LATE = np.where(TIME >= 1.5, 0.01, 0.0)
SLOW = np.sin(2 * np.pi * 0.4 * TIME)
# Errors, motion of the reference, and some of what is found.
FOUND: dict[str, tuple[Floats, Floats | None, dict[str, Any] | None]] = {
    "a slow cycle": (cycle(3.7, 0.02), None, {"leg": 1, "is_growing": False, "frequency": 3.7, "amplitude": 0.02}),
    "three slow cycles": (cycle(2.27, 0.02), None, {"frequency": 2.27}),
    "two cycles": (cycle(38) + cycle(61, 3e-4), None, None),
    "a cycle": (2e-3 * np.exp(-9 * TIME) + cycle(38.3), None, {"frequency": 38.3, "amplitude": 4e-4}),
    "a fast cycle": (cycle(140.0, 5e-5), None, {"frequency": 140.0, "amplitude": 5e-5, "earlier": None}),
    "a cycle that decays by a fifth": (cycle(38, rate=-0.18), None, None),
    "a cycle that decays by an eighth": (cycle(38, rate=-0.14), None, {"is_growing": False}),
    # it grows if 2 s double it, from the first quarter to the last third: e^(1.5 · 0.462) = 2
    "a slow cycle that grows little": (cycle(1.5, 1e-2, 0.45), None, None),
    "a cycle that grows little": (cycle(38, rate=0.46), None, {"is_growing": False}),
    "a cycle that grows": (cycle(38, rate=0.5), None, {"is_growing": True, "frequency": 38, "since": 0.0}),
    "a cycle that grows fast": (cycle(12, 1e-3, 0.8), None, {
        "is_growing": True, "frequency": 12, "amplitude": 1e-3 * np.exp(1.58), "earlier": 1e-3 * np.exp(0.35)}),
    "a cycle beside a drift": ((0.02 * TIME + 0.01 + cycle(38))[:1501], None, {"frequency": 38, "amplitude": 4e-4}),
    "2 % of damping": (0.02 * np.exp(-0.47 * TIME) * np.cos(2 * np.pi * 3.7 * TIME), None, None),
    "a slow approach": (0.01 * (1 - np.exp(-TIME / 0.6)), None, None),
    "a very slow approach": (0.01 * (1 - np.exp(-TIME / 3)), None, None),
    # 1.15 times as much from each sixth of 2 s to the next: e^(0.419 / 3)
    "nearly ever faster": (1e-2 * np.exp(0.40 * TIME), None, None),
    "ever faster": (1e-2 * np.exp(0.44 * TIME), None, {"is_growing": True, "frequency": None, "earlier": 1e-2}),
    "ever faster down": (-1e-3 * np.exp(3 * TIME), None, {"is_growing": True, "amplitude": 1e-3 * np.exp(5.997)}),
    "ever faster to zero": (1e-2 * (3 - np.exp(0.5 * TIME)), None, None),
    "ever faster, but tiny": (1e-7 * np.exp(TIME), None, None),
    "back twice as far": (after_step(2, 3), STEPS_LATE, {"is_growing": True, "earlier": 0.01, "since": 1.5}),
    "back twice as far, down": (-after_step(2, 3), -STEPS_LATE, {"is_growing": True, "earlier": 0.01}),
    "back as far": (after_step(2, 0), STEPS_LATE, None),
    "back twice as far after a motion": (
        after_step(2, 3), STEPS_LATE + np.where(TIME < 0.5, 0.02 * (1 - np.cos(4 * np.pi * TIME)), 0.0),
        {"is_growing": True, "earlier": 0.01, "since": 1.5}),
    # a step counts from rest alone, of 32 rows
    "back twice as far from a motion": (after_step(2, 3), STEPS_LATE + np.clip(TIME - 1.48, 0, 0.01), None),
    "a cycle beside a slow sine": (1e-3 * SLOW + cycle(47), 0.05 * SLOW, {"is_growing": False, "frequency": 47}),
    # of the first half, from 2/3 to 4/3 s, whose mean of e^(4 t) is (e^(16/3) − e^(8/3)) 3/8
    "one that grows there": (1e-3 * SLOW + cycle(47, rate=2), 0.05 * SLOW, {"is_growing": True, "earlier": 3.40e-3}),
    # in motion, from ten times above 0.4 Hz on, which two bins of 0.75 Hz hold
    "too near to the sine": (1e-3 * SLOW + cycle(14), 0.05 * SLOW, None),
    "far enough": (1e-3 * SLOW + cycle(18), 0.05 * SLOW, {"frequency": 18, "amplitude": 4e-4, "since": TIME[N // 3]}),
    "a motion without acceleration": (cycle(38), TIME, None),
    # a fifth of the rows has to be left after what acts, and 32
    "rest just long enough": (cycle(38), np.where(np.arange(N) >= 1600, 1e-4, 0.0), {"since": 1.6, "frequency": 38}),
    "rest too short": (cycle(38), np.where(np.arange(N) >= 1601, 1e-4, 0.0), None),
    "a short run": (1e-3 * np.exp(200 * TIME[:32]), None, {"is_growing": True}),
    "too short a run": (1e-3 * np.exp(200 * TIME[:31]), None, None),
    # lengths that no platform has
    "nearly 10⁹ m": (0.99e9 * np.exp(3 * (TIME - TIME[-1])), None, {"is_growing": True}),
    "more than 10⁹ m": (1.01e9 * np.exp(3 * (TIME - TIME[-1])), None, None),
    "a reference of more": (np.exp(3 * TIME), np.outer(0 * TIME + 1.01e9, np.eye(6)[4]), None),
}  # fmt: skip


@pytest.mark.parametrize("case", FOUND)
def test_what_a_loop_does_by_itself_is_told_and_nothing_else(case: str) -> None:
    """Expected: the sine or exponential that the errors were made of; to 3 %, amplitudes at the end to 10 %."""
    error, motion, wanted = FOUND[case]
    found = found_in(error, motion)
    assert (found is None) == (wanted is None)
    for name, value in (wanted or {}).items():
        tolerance = 0.1 if name in ("amplitude", "earlier") else 0.03
        is_exact = value is None or isinstance(value, bool)
        assert (found or {})[name] == (value if is_exact else pytest.approx(value, rel=tolerance)), name


def test_the_leg_that_moves_most_is_told_in_words() -> None:
    """Expected: of six legs that cycle alike, in other sizes, the fourth; times of a record that begins at 7.3 s."""
    shares = np.array([0.3, -0.5, 0.2, 1.0, -0.6, 0.1])
    made = record_of(np.outer(cycle(38), shares), np.where(TIME >= 0.4, 0.003, 0.0))
    record = gs.Record(made.table.with_columns(polars.col("time") + 7.3), made.metadata)
    found = found_in(record) or {}
    assert (found["leg"], found["since"]) == (4, pytest.approx(7.7))
    words = (
        f"leg 4 oscillates at 38 Hz without input, with an amplitude of {found['amplitude'] * 1e3:.3g} mm. Lower the "
        "bandwidth or the delay; `gough-stewart margins` shows what the loop allows"
    )
    assert " ".join(str(gs.metrics(record)).split()).startswith(f"completed at 1.999 s; {words}")
    assert words in html.unescape(gs.metrics(record)._repr_html_())
    assert words in " ".join(repr(record).split())
    growing = gs.metrics(record_of(np.outer(cycle(12, 1e-3, 0.8), shares)))
    loop = growing["outcome"]["oscillation"]
    sizes = f"from {1e3 * loop['earlier']:.3g} to {1e3 * loop['amplitude']:.3g} mm after 0 s"
    words = f"leg 4: without input, the error grows at {loop['frequency']:.3g} Hz {sizes}. Lower the"
    assert words in " ".join(str(growing).split())
    sound = gs.metrics(record_of(0 * TIME))
    assert "without input" not in str(sound) + sound._repr_html_()


def _white(random: np.random.Generator) -> Floats:
    return 1e-3 * random.normal(size=N)


def _through_a_loop(random: np.random.Generator) -> Floats:
    """White noise through a second-order loop of 1 to 10 Hz with a damping ratio of 0.2 to 1."""
    w, damping = 2 * np.pi * random.uniform(1, 10), random.uniform(0.2, 1)
    polynomials = [2 * damping * w, w * w], [1.0, 2 * damping * w, w * w]
    over, under = signal.bilinear(*polynomials, fs=1 / STEP)
    return np.asarray(1e-3 * signal.lfilter(over, under, random.normal(size=N + 500))[500:])


@pytest.mark.parametrize(("noise", "sensors"), [(_white, {}), (_through_a_loop, {"noise": {"leg_length": 1e-3}})])
def test_noise_is_no_alarm(noise: Callable[[np.random.Generator], Floats], sensors: dict[str, Any]) -> None:
    """Expected: no alarm in 80 records, white noise undeclared: of 667 bins, five have seldom 3 % of the power."""
    random = np.random.default_rng(25)
    assert sum(found_in(noise(random), **sensors) is not None for _ in range(80)) == 0


_RADIUS, _TURNS = np.hypot(0.3, 0.1), 2 * np.pi * 38


@pytest.mark.parametrize(
    ("sensors", "least"),
    [
        ({"noise": {"leg_length": 2e-4}}, 12e-4),
        ({"noise": {"leg_length": 1e-9, "position": 2e-4}}, 12e-4),
        ({"noise": {"orientation": 1e-3}}, 6e-3 * _RADIUS),
        ({"noise": {"leg_length": 1e-9, "leg_velocity": 0.05}}, 0.3 / _TURNS),
        ({"noise": {"velocity": 0.05}}, 0.3 / _TURNS),
        ({"noise": {"angular_velocity": 0.1}}, 0.6 * _RADIUS / _TURNS),
        ({"quantisation": {"leg_length": 2e-4}}, 6e-4),
        ({"quantisation": {"position": 2e-4, "angular_velocity": 1e-9}}, 6e-4),
        ({"quantisation": {"leg_velocity": 0.5}, "noise": {"leg_length": 1e-6}}, 1.5 / _TURNS),
        ({}, 2e-6),
        ({"noise": None, "quantisation": None}, 2e-6),
    ],
)
def test_a_cycle_is_told_from_six_sigma_and_three_steps_on(sensors: dict[str, Any], least: float) -> None:
    """Expected: silence 10 % below and an alarm 10 % above; angles by the joints' radius, rates by the frequency."""
    assert found_in(cycle(38, 0.9 * least), **sensors) is None
    assert found_in(cycle(38, 1.1 * least), **sensors) is not None


def test_growth_that_sensors_explain_is_none() -> None:
    """Expected: a cycle that grows to 1.3 mm, beside 6 σ of 1.5 mm and of 1.2 mm; one that leaves for 24 mm."""
    for error, quiet, loud in ((cycle(38, rate=0.6), 2e-4, 2.5e-4), (1e-2 * np.exp(0.44 * TIME), 1e-3, 5e-3)):
        assert found_in(error, noise={"leg_length": loud}) is None
        assert (found_in(error, noise={"leg_length": quiet}) or {})["is_growing"]


def test_what_the_reference_explains_is_none() -> None:
    """Expected: none for errors of a loop that follows sines and slow moves, with friction and a nonlinear part."""
    random = np.random.default_rng(27)
    for _ in range(20):
        angle = 2 * np.pi * random.uniform(0.3, 6) * TIME + random.uniform(0, 6)
        friction = np.tanh(20 * np.cos(angle))
        error = 2e-3 * np.sin(angle - 0.4) + 4e-4 * friction + 1e-4 * np.sin(angle) ** 2
        assert found_in(error, 0.02 * np.sin(angle)) is None
        share = np.clip(TIME / random.uniform(0.5, 3), 0, 1)
        moves = share**3 * (10 - 15 * share + 6 * share**2)
        assert found_in(1e-3 * np.gradient(moves, STEP) + 2e-4 * np.sin(3 * moves), 0.1 * moves) is None


def test_each_leg_is_explained_by_its_own_motion() -> None:
    """Expected: of six motions at other frequencies, large errors that follow them are none; beside them, a cycle."""
    angle = 2 * np.pi * np.outer(TIME, [0.4, 0.9, 0.5, 1.1, 0.7, 0.6]) + np.arange(6)
    motion, error = 0.05 * np.sin(angle), 0.3 * np.cos(angle) + 0.1 * np.sin(angle)
    assert found_in(error, motion) is None
    found = found_in(error + np.outer(cycle(47, 3e-4), np.eye(6)[3]), motion) or {}
    assert (found["leg"], found["amplitude"]) == (4, pytest.approx(3e-4, rel=0.03))


@pytest.mark.parametrize(
    ("name", "acts"),
    [
        *(("external_force[2]", True), ("external_torque[3]", True), ("controller.injection[4]", True)),
        *(("platform_mass", True), ("gravity[1]", True), ("flag.force_cut[2]", True)),
        *(("flag.manual", True), ("kinetic_energy", False)),
    ],
)
def test_what_acts_on_the_loop_begins_the_judged_part_anew(name: str, acts: bool) -> None:
    """Expected: from its last change on; a cycle that ends there is none, whatever column acts."""
    is_late = TIME >= 1.2
    values = ~is_late if name.startswith("flag.") else np.where(is_late, 7.0, 5.0)
    for error, is_found in ((cycle(38) * ~is_late, False), (cycle(38) * is_late, True)):
        record = record_of(error)
        record.metadata["machine"] = {"platform_mass": 5.0, "gravity": [0.0, 0.0, -9.81]}
        found = found_in(gs.Record(record.table.with_columns(polars.Series(name, values)), record.metadata))
        assert not acts or (found is not None) == is_found
        assert found is None or found["since"] == pytest.approx(1.2 if acts else 0.0)


def test_a_small_change_counts_beside_a_large_constant_and_a_fault_to_the_end_leaves_no_rest() -> None:
    """Expected: 0.1 mN along y beside 10⁶ N along x, from its row on; rounding of the large one is no change."""
    record = record_of(cycle(38), np.where(TIME >= 0.6, 1e-4, 0.0))
    pushed = {"external_force[1]": 1e6 + 1e-4 * (TIME >= 1.5), "external_force[2]": 1e-4 * (TIME >= 1.2)}
    found = found_in(gs.Record(record.table.with_columns(**pushed), record.metadata)) or {}
    assert found["since"] == pytest.approx(1.2)
    frozen = polars.Series("flag.frozen_leg_length[3]", TIME >= 0.2)
    assert found_in(gs.Record(record.table.with_columns(frozen), record.metadata)) is None


def test_open_loops_and_runs_that_ended_early_are_not_judged() -> None:
    """Expected: none without control, without completion, without the columns; a user's controller closes the loop."""
    record = record_of(cycle(38))
    whole, open_loop = record.metadata, {"controller": {"type": "open_loop"}}
    for metadata, is_judged in (
        ({**whole, "outcome": {**whole["outcome"], "status": "diverged"}}, False),
        ({**whole, "experiment": open_loop}, False),
        ({**whole, "experiment": open_loop, "replaced": ["controller"]}, True),
        ({key: whole[key] for key in ("outcome", "platform")}, True),
        ({**whole, "experiment": {}, "platform": {}}, True),
    ):
        assert (found_in(gs.Record(record.table, metadata)) is not None) == is_judged
    for lacks in ("error.leg_length", "reference.leg_length"):
        assert found_in(gs.Record(record.table.drop(record.columns_of(lacks)), whole)) is None
    lost = np.where(np.arange(N) < N - 1, record["error.leg_length[6]"], np.nan)
    assert found_in(gs.Record(record.table.with_columns(polars.Series("error.leg_length[6]", lost)), whole)) is None
