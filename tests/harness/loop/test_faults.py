"""Legs whose force is cut, sensors that freeze, and controllers that are switched off and on, on two plants."""

import threading
from typing import Any

import casadi
import control
import numpy as np
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.documented_loop import accelerations, twist_of_rates
from tests.support.experiments import experiment_from
from tests.support.uneven_loops import experiment_of as uneven_experiment

MOTION = {"type": "sine", "position_amplitude": ["8 mm", "-5 mm", "6 mm"], "frequency": "4 Hz"}
AROUND: dict[str, Any] = {
    "reference": MOTION,
    "limits": {"reference": "warn"},
    "loop": {"duration": 0.2, "sample_time": "4 ms", "plant_step": "1 ms", "delay": 1},
    "actuators": {"lag": "3 ms", "rate_limit": "20 kN/s"},
    "sensors": {"noise": {"leg_length": "20 um"}, "quantisation": {"leg_length": "3 um"}, "seed": 5},
}
HOSTS = {"model": "compiled", "scipy": "Python"}


def record_of(plant: str, *faults: dict[str, Any], **tables: Any) -> gs.Record:
    """A run of an uneven loop whose reference moves, with these faults."""
    machine = {"kind": plant, "parameters": {"platform_mass": 14.5, "platform_com": [-0.02, 0.05, 0.3]}}
    record = gs.run(uneven_experiment("pid", **{**AROUND, "plant": machine, **tables}, fault=list(faults)))
    assert record.metadata["host"].startswith(HOSTS[plant])
    return record


@pytest.mark.parametrize("plant", HOSTS)
def test_a_cut_leg_has_no_force_from_that_row_on(plant: str) -> None:
    """Expected: exactly 0 N while it is cut; the run without the fault, bit by bit, before.

    Accelerations are the Lagrangian's with no force in these legs. A drive goes on beside the cut: when the force is
    back it is nearer to its command than the command's last step; a drive that began at 0 would be far off.
    """
    record = record_of(plant, {"at": 0.05, "cut": [2, 5], "duration": 0.061}, {"at": 0.081, "cut": [6]})
    free = record_of(plant)
    force, time = record["actuator_force"], record["time"]
    assert record.metadata["outcome"]["status"] == "completed"
    cut = np.zeros((len(time), 6), dtype=bool)
    cut[50:111, [1, 4]] = True
    cut[81:, 5] = True
    assert (force[cut] == 0).all()
    assert (force[~cut] != 0).all()
    assert np.array_equal(record["flag.force_cut"], cut)
    assert np.array_equal(force[:50], free["actuator_force"][:50])
    assert np.abs(record["position"][111] - free["position"][111]).max() > 1e-4
    machine = gs.Platform(**record.metadata["machine"])
    for row in (49, 50, 80, 81, 111, 200):
        q = np.concatenate([record["position"][row], record["orientation"][row]])
        twist = np.concatenate([record["velocity"][row], record["angular_velocity"][row]])
        rate = np.linalg.solve(twist_of_rates(q), twist)
        # of position alone: the rate of the velocity is that of the coordinates
        found = accelerations(machine, q, rate, force[row], np.zeros(6))[:3]
        assert record["acceleration"][row] == pytest.approx(found, rel=1e-7, abs=1e-7)
    # commands of a sample act one sample later: that of row 104 from row 108 on
    before, now = record["controller.force"][[100, 104], 1]
    assert abs(now - force[111, 1]) < abs(now - before) < 0.1 * abs(now)


@pytest.mark.parametrize("plant", HOSTS)
@pytest.mark.parametrize("own_clock", [False, True])
def test_a_frozen_sensor_holds_its_last_reading(plant: str, own_clock: bool) -> None:
    """Expected: what it measured last before the fault, or first; afterwards the noise of before."""
    sensors = {**AROUND["sensors"], **({"sample_time": "3 ms"} if own_clock else {})}
    freeze = {"at": 0.05, "freeze": {"leg_length": [1, 4]}, "duration": 0.05}
    from_then, always = {"at": 0.06, "freeze": {"leg_length": [6]}}, {"at": 0, "freeze": {"leg_length": [3]}}
    record = record_of(plant, freeze, from_then, always, sensors=sensors)
    free = record_of(plant, always, sensors=sensors)
    measured, true = record["measured.leg_length"], record["leg_length"]
    every = 3 if own_clock else 4
    samples = np.arange(0, 200, 4)
    frozen = (samples >= 52) & (samples < 100)
    for leg in (0, 3):
        assert (measured[samples[frozen], leg] == measured[52, leg]).all()
        if not own_clock:  # the last reading before, at sample 48
            assert measured[52, leg] == free["measured.leg_length"][48, leg]
    assert [np.ptp(measured[60:, 5]), np.ptp(measured[:, 2])] == [0, 0]
    assert min(np.ptp(true[60:, 5]), np.ptp(measured[:, 1])) > 1e-4
    assert measured[0, 2] == record_of(plant, sensors=sensors)["measured.leg_length"][0, 2]
    back = samples[samples >= 100 + every]
    read = back // every * every
    noise = measured[back, 0] - true[read, 0]
    theirs = free["measured.leg_length"][back, 0] - free["leg_length"][read, 0]
    assert np.abs(noise - theirs).max() <= 3.1e-6  # a step of 3 um at most, in place of noise of 20 um
    assert np.ptp(noise) > 2e-5


def test_faults_that_overlap_act_until_the_last_one_ends_also_from_a_file() -> None:
    """Expected: leg 2 from 0.02 to 0.08 s by two faults; leg 4 within, and encoders from 0.05 s on."""
    faults = [
        {"at": 0.02, "cut": [2], "duration": 0.04},
        {"at": 0.04, "cut": [2, 4], "duration": 0.04},
        {"at": 0.05, "freeze": {"leg_length": [1], "orientation": [3]}},
    ]
    made = uneven_experiment("pid", **AROUND, fault=faults)
    read = experiment_from(made.model_dump(mode="json", exclude_unset=True))
    assert read.fault == made.fault
    record = gs.run(read)
    time, cut = record["time"] + 1e-9, np.zeros((201, 6), dtype=bool)
    cut[20:80, 1] = cut[40:80, 3] = True
    assert np.array_equal(record["flag.force_cut"], cut)
    for name, element, size in (("leg_length", 0, 6), ("orientation", 2, 3)):
        frozen = (time > 0.05)[:, None] & (np.arange(size) == element)
        assert np.array_equal(record[f"flag.frozen_{name}"], frozen)


# ---- manual operation ----
# Expected, from a plain loop over the recorded samples: off, the command is the manual force and the controller rests
# in what is measured; on, what its command lacked of that force is added, and fades by (1 − T / 1 s) a sample.

K = np.array([1100.0, 1450.0, 900.0, 1250.0, 1600.0, 1000.0])
KI = np.array([40.0, 70.0, 30.0, 55.0, 80.0, 35.0])
FORCE = [60.0, 35.0, 52.0, 41.0, 66.0, 47.0]
T = 4e-3
# Off from sample 10 to 24 with a force, and again from 35, with the command of then.
CHANGES: list[dict[str, Any]] = [
    {"at": 0.037, "enabled": False, "manual_force": FORCE},
    {"at": 0.1, "enabled": True},
    {"at": 0.14, "enabled": False},
    {"at": 0.18, "enabled": True},
]
SPANS = {10: FORCE, 35: None}
ON = (25, 45)


class Integral:
    """F = K e + KI Σ e, whose memory is the sum."""

    def __init__(self, _platform: gs.Platform, _sample_time: float) -> None:
        self.sum = np.zeros(6)

    def __call__(self, sample: gs.Sample) -> FloatArray:
        error = sample.reference["leg_length"] - sample.measured["leg_length"]
        force = K * error + KI * self.sum
        self.sum = self.sum + error
        return force


def linear(poles: Any = 1.0) -> Any:
    """The same as a linear system, or with sums that forget: x⁺ = a x + e."""
    return control.ss(np.diag(np.broadcast_to(poles, 6)), np.eye(6), np.diag(KI), np.diag(K), T)


def traced() -> casadi.Function:
    """The same as a CasADi function, whose memory is a matrix."""
    r, y, memory = casadi.SX.sym("r", 6), casadi.SX.sym("y", 6), casadi.SX.sym("memory", 2, 3)
    outputs = [K * (r - y) + KI * casadi.vec(memory), memory + casadi.reshape(r - y, 2, 3)]
    names = ["reference_leg_length", "leg_length", "memory"], ["actuator_force", "memory_next"]
    return casadi.Function("law", [r, y, memory], outputs, *names)


def switched(**tables: Any) -> gs.Experiment:
    """An uneven loop around a moving reference, whose forces do not pass their limit."""
    loop = {"duration": 0.24, "sample_time": T, "plant_step": 1e-3, "delay": 1}
    around = {"reference": MOTION, "limits": {"reference": "warn"}, "loop": loop, "change": CHANGES}
    sensors = {"noise": {"leg_length": "20 um"}, "seed": 5}
    return uneven_experiment("pd", **{**around, "sensors": sensors, **tables})


def commands_of(
    error: FloatArray, spans: dict[int, Any], on: tuple[int, ...], start: FloatArray, poles: FloatArray | None
) -> FloatArray:
    """The commands (m, 6) of the loop above; a linear controller rests, with its sum at 0, others keep theirs."""
    commands, is_off = list[FloatArray](), False
    a = np.ones(6) if poles is None else poles
    rest = np.where(a < 1, 1 / np.where(a < 1, 1 - a, 1.0), 0.0)
    total, lacked, force = rest * error[0], np.zeros(6), np.zeros(6)
    for k, e in enumerate(error):
        if k in spans:
            is_off, force = True, np.array(spans[k] or (commands[-1] if commands else start))
        is_off = is_off and k not in on
        total = rest * e if is_off and poles is not None else total
        wanted = K * e + KI * total
        commands.append(force if is_off else wanted + lacked)
        lacked = force - wanted if is_off else lacked * (1 - T)
        total = total if is_off else a * total + e
    return np.array(commands)


@pytest.mark.parametrize(
    ("controller", "plant", "host"),
    [
        *((linear(), "model", "compiled"), (linear(), "scipy", "Python"), (linear(), "fmu3", "Python")),
        (linear([0.6, 0.3, 1.0, 0.8, 0.5, 0.7]), "model", "compiled"),
        *((traced(), "model", "compiled"), (traced(), "scipy", "Python"), (Integral, "model", "Python")),
    ],
)
def test_the_command_follows_while_it_is_off_and_begins_there(controller: Any, plant: str, host: str) -> None:
    """Also: no bump at a switch, which is what the change of one sample's error makes; and the verdict says when."""
    record = gs.run(switched(plant={"kind": plant}), controller=controller)
    assert record.metadata["host"].startswith(host)
    samples = slice(0, 240, 4)
    command, error = record["controller.force"][samples], record["reference.leg_length"] - record["measured.leg_length"]
    error = error[samples]
    poles = np.diag(controller.A) if isinstance(controller, control.StateSpace) else None
    expected = commands_of(error, SPANS, ON, np.zeros(6), poles)
    scale = np.abs(expected).max()
    assert np.abs(command - expected).max() < 1e-9 * scale
    for k in ON:
        assert np.abs(command[k] - command[k - 1] - K * (error[k] - error[k - 1])).max() < 1e-9 * scale
        assert np.abs(command[k] - K * error[k]).max() > 20  # by which it would jump
    assert record["flag.manual"][samples].ravel().tolist() == [10 <= k < 25 or 35 <= k < 45 for k in range(60)]
    assert "ontroller off from 0.037 to 0.1 s; controller off from 0.14 to 0.18 s" in record.report().verdict.text


@pytest.mark.parametrize("controller", [linear(), Integral])
def test_members_are_switched_each_at_its_time_and_some_are_off_from_the_start(controller: Any) -> None:
    """Expected: commands of the recursion, errors of single runs; at 0 s the last one is the force that holds it."""
    varied = {
        "change.1.at": {"choice": ["0 ms", "36 ms", "40 ms"]},
        "change.2.at": {"choice": ["60 ms", "72 ms", "100 ms"]},
        "change.3.manual_force": {"uniform": [40, 60]},
        "platform_mass": {"uniform": [12, 16]},
    }
    changes = [{"at": 0.04, "enabled": False}, CHANGES[1], {**CHANGES[2], "manual_force": FORCE}, CHANGES[3]]
    experiment = switched(change=changes, ensemble={**varied, "members": 11})
    many = gs.ensemble(experiment, controller=controller, workers=1)
    rms, offs = many.members["tracking.leg_length.rms"], set()
    poles = None if controller is Integral else np.ones(6)
    # the first member of each time at which they are switched off, and the last one
    for k in {*np.unique(many.values("change.1.at"), return_index=True)[1].tolist(), 10}:
        record = gs.run(experiment, member=k, controller=controller)
        assert record.metadata["host"].startswith("Python" if controller is Integral else "compiled")
        drawn = record.metadata["experiment"]["change"]
        off, on = (round(drawn[number]["at"] / T) for number in (0, 1))
        offs.add(off)
        error = (record["reference.leg_length"] - record["measured.leg_length"])[:240:4]
        spans = {off: None, 35: drawn[2]["manual_force"]}
        expected = commands_of(error, spans, (on, 45), record["actuator_force"][0], poles)
        assert np.abs(record["controller.force"][:240:4] - expected).max() < 1e-9 * np.abs(expected).max()
        assert rms[k] == pytest.approx(max(gs.metrics(record)["tracking"]["leg_length"]["rms"]), rel=1e-11)
    assert offs == {0, 9, 10}


def test_what_a_function_encloses_rests_while_the_controller_is_off() -> None:
    """Expected: calls of samples at which it is on, told the record's last command; a lock, without copy, is named."""
    counts, told = list[int](), list[FloatArray]()

    def make(_platform: gs.Platform, _sample_time: float, lock: Any = None) -> Any:
        calls = 0

        def law(sample: gs.Sample) -> FloatArray:
            nonlocal calls
            told.append(sample.command)
            calls += lock is None
            counts.append(calls)
            return np.zeros(6)

        return law

    loop = {"duration": 0.4, "sample_time": 0.004, "plant_step": 0.001}
    experiment = uneven_experiment("pd", loop=loop, change=CHANGES[:2])
    commands = gs.run(experiment, controller=make)["controller.force"][:-1:4]
    assert counts[-1] == len(counts) == 100 - 15
    assert np.array(told[1:]) == pytest.approx(commands[[*range(9), *range(24, 99)]], abs=1e-12)
    locked = gs.run(experiment, controller=lambda platform, period: make(platform, period, threading.Lock()))
    assert "needs a copy of it" in str(locked.metadata["outcome"]["cause"])


def test_what_a_limit_cuts_off_a_manual_force_does_not_reach_the_integral() -> None:
    """Expected: the same commands on both plants; at the switch that of the force, by a PD what the integral adds."""
    off = [{"at": 0.04, "enabled": False, "manual_force": [105.0] * 6}, {"at": 0.08, "enabled": True}]
    tables: dict[str, Any] = {
        "loop": {"duration": 0.16, "sample_time": T, "plant_step": 1e-3},
        "actuators": {"force_limit": "90 N"},
        "change": off,
    }
    compiled, stepped = (gs.run(uneven_experiment("pid", **tables, plant={"kind": kind}))
                         for kind in ("model", "scipy"))  # fmt: skip
    assert [record.metadata["host"][:8] for record in (compiled, stepped)] == ["compiled", "Python"]
    assert np.abs(compiled["controller.force"] - stepped["controller.force"]).max() < 1e-5
    assert (compiled["controller.force"][40:80] == 105).all()
    assert compiled["flag.force_limited"][40:80].all()
