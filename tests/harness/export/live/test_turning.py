"""What is turned while a machine runs: rows against runs with these settings, margins against those of Python."""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.export.live.page import live_machine
from gough_stewart.harness.export.machine import POLES, REQUESTED
from tests.harness.export.test_machine import Machine, rows_of

PID = {"type": "pid", "bandwidth": 2.0, "integral_time": 1.0, "feedforward": "gravity"}
UNEVEN: dict[str, Any] = {
    **{"type": "pid", "proportional_gain": [3e5, 2e5, 2.5e5, 3e5, 2e5, 2.2e5], "derivative_on": "measurement"},
    **{"derivative_gain": [2e4, 3e4, 2.5e4, 2e4, 2.1e4, 2.6e4], "integral_gain": [1e5, 2e5, 1e5, 3e5, 2e5, 1e5]},
}
NOTCH = {"frequency": 40.0, "damping": 0.4, "depth": 0.2}
# An experiment, what it begins with, what is turned, and the same as settings of the file.
TURNED: dict[str, tuple[str, dict[str, Any], dict[str, float], dict[str, Any]]] = {
    "bandwidth and damping": ("pitch_sine", {}, {"bandwidth": 2.6, "damping_ratio": 0.9}, {}),
    "an integral with a delay": (
        *("pitch_sine", {"controller": PID}, {"bandwidth": 3.0, "integral_time": 0.7, "delay": 3, "filter_time": 4e-3}),
        {},
    ),
    "a task-space loop with a notch": (
        *("pitch_sine", {"controller.space": "task", "controller.notch": NOTCH}, {"bandwidth": 1.5, "delay": 1}, {}),
    ),
    "held inputs": (
        *("pitch_sine", {"controller.discretisation": "zoh", "actuators.lag": 4e-3}, {"bandwidth": 2.5}, {}),
    ),
    "a derivative of measurements": (
        *("heave_step", {"loop.plant_step": 5e-4}, {"bandwidth": 3.0, "filter_time": 0.01}, {}),
    ),
    "unequal gains": (
        *("pitch_sine", {"controller": UNEVEN}, {"proportional": 1.5, "derivative": 0.8, "integral": 2.0, "delay": 2}),
        {
            f"controller.{name}_gain": [factor * k for k in UNEVEN[f"{name}_gain"]]
            for name, factor in (("proportional", 1.5), ("derivative", 0.8), ("integral", 2.0))
        },
    ),
}
KEYS = {"delay": "loop.delay", "filter_time": "controller.derivative_filter"}
for row in TURNED.values():
    values, same = row[2:]
    named = {name: value for name, value in values.items() if f"controller.{name}_gain" not in same}
    same |= {KEYS.get(name, f"controller.{name}"): value for name, value in named.items()}


def machine_of(name: str, settings: dict[str, Any]) -> Machine:
    """The machine of a page."""
    return Machine(live_machine(gs.load_experiment(name, settings)).block)


def turn(machine: Machine, values: dict[str, float]) -> int:
    """Turn some settings."""
    wanted = machine.field("turn_wanted", len(REQUESTED))
    for name, value in values.items():
        wanted[REQUESTED.index(name)] = value
    return int(machine("turn"))


@pytest.mark.parametrize("case", TURNED)
def test_margins_and_modes_follow_what_is_turned(case: str) -> None:
    """Expected: `gs.margins` of an experiment with these settings, to 1e-4; another eigenvalue solver for the modes."""
    name, begin, values, settings = TURNED[case]
    ours, theirs = machine_of(name, begin), gs.margins(name, {**begin, **settings})
    assert turn(ours, values) == 0
    assert ours("margins") == 0
    found = ours.field("turn_results", POLES)
    legs = found[4 : POLES - 1].reshape(6, 5)
    expected = [[leg.gain_up, leg.gain_down, leg.phase, leg.delay, leg.crossover] for leg in theirs.legs]
    assert legs == pytest.approx(np.array(expected), rel=1e-4)
    assert found[2] == pytest.approx(theirs.sensitivity_peak, rel=1e-5)
    assert found[3] == pytest.approx(theirs.complementary_peak, rel=1e-5)
    n, most = int(found[1]), live_machine(gs.load_experiment(name, begin)).data["turn"]["most"]
    results = ours.field("turn_results", POLES + 4 * most)
    poles = results[POLES : POLES + 2 * n : 2] + 1j * results[POLES + 1 : POLES + 2 * n : 2]
    assert np.abs(poles).max() == pytest.approx(found[0], rel=1e-12)
    modes = results[POLES + 2 * most :].reshape(-1, 2)[: int(found[POLES - 1])]
    assert modes[0, 0] == pytest.approx(theirs.modes[0].frequency, rel=1e-6)
    assert modes[0, 1] == pytest.approx(theirs.modes[0].damping_ratio, rel=1e-6)
    # some pole near each of the slow modes: those of delays are defective, and have few digits
    slow = [mode.eigenvalue for mode in theirs.modes if mode.frequency < 30]
    for each in slow:
        assert np.abs(poles - np.exp(each * theirs.sample_time)).min() < 1e-6


@pytest.mark.parametrize(
    "case",
    ["an integral with a delay", "a task-space loop with a notch", "held inputs", "a derivative of measurements"],
)
def test_rows_follow_what_is_turned(case: str) -> None:
    """Expected: `run` with these settings to 1e-9 of SI units, and a force limit that is reached."""
    name, begin, values, settings = TURNED[case]
    common = {**begin, "loop.duration": 0.4, "sensors.quantisation": {}}
    ours = machine_of(name, common)
    assert turn(ours, {**values, "force_limit": 4100.0}) == 0
    limits = {"actuators.force_limit": 4100.0, "limits.reference": "warn"}
    theirs = rows_of(gs.run(name, {**common, **settings, **limits}))
    found = ours.run(len(theirs))
    assert np.abs(found["row_signals"] - theirs).max() <= 1e-9
    assert found["row_force_limited"].any()


@pytest.mark.parametrize(("key", "size"), [("noise", 2e-6), ("quantisation", 2e-5)])
def test_encoders_are_as_they_are_told(key: str, size: float) -> None:
    """Expected: a machine that was made so, to 1e-12, since gains are rounded otherwise."""
    common = {"loop.duration": 0.2, "sensors.noise": {}, "sensors.quantisation": {}, "sensors.seed": 5}
    ours, exact = machine_of("pitch_sine", common), machine_of("pitch_sine", common)
    made = machine_of("pitch_sine", {**common, f"sensors.{key}": {"leg_length": size}})
    assert turn(ours, {key: size}) == 0
    theirs = made.run(101)["row_signals"]
    assert np.abs(ours.run(101)["row_signals"] - theirs).max() <= 1e-12
    assert np.abs(theirs - exact.run(101)["row_signals"]).max() > 1e-7


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("bandwidth", np.nan), ("bandwidth", -1.0), ("damping_ratio", 0.0), ("delay", 1.5), ("delay", 99.0)),
        *(("force_limit", 0.0), ("noise", np.inf), ("filter_time", 1e-4), ("proportional", np.nan)),
    ],
)
def test_what_is_beyond_its_bounds_changes_nothing(name: str, value: float) -> None:
    """Expected: the position of what is refused, and the rows of a machine that was left alone."""
    ours, other = machine_of("pitch_sine", {}), machine_of("pitch_sine", {})
    assert turn(ours, {name: value}) == 1 + REQUESTED.index(name)
    assert np.array_equal(ours.run(200)["row_signals"], other.run(200)["row_signals"])


def test_an_unstable_loop_has_poles_and_no_margins() -> None:
    """Expected: `gs.margins` refuses the same loop as unstable, with this worst eigenvalue."""
    ours = machine_of("heave_step", {})
    assert turn(ours, {"bandwidth": 15.0, "delay": 12}) == 0
    assert ours("margins") == 0
    found = ours.field("turn_results", POLES)
    with pytest.raises(gs.UnstableLoopError) as error:
        gs.margins("heave_step", {"controller.bandwidth": 15.0, "loop.delay": 12})
    assert found[0] == pytest.approx(abs(error.value.eigenvalue), rel=1e-9)
    assert np.isnan(found[2:34]).all()
