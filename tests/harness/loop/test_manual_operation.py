"""Controllers that an experiment switches off and on: in every host, on every plant, in ensembles, and as exported C.

Expected, from a plain loop over the recorded samples: off, the command is the manual force and the controller rests in
what is measured; on, what its command lacked of that force is added, and fades by (1 − T / 1 s) a sample.
"""

import threading
from typing import Any

import casadi
import control
import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.plants.lanes import Stepping
from tests.support.arrays import FloatArray
from tests.support.exported import PID, SINE, Exported, largest_difference, source_of
from tests.support.exported import uneven_experiment as exported_experiment
from tests.support.uneven_loops import experiment_of as uneven_experiment

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


def linear() -> Any:
    """The same as a linear system."""
    return control.ss(np.eye(6), np.eye(6), np.diag(KI), np.diag(K), T)


def traced() -> casadi.Function:
    """The same as a CasADi function."""
    r, y, memory = (casadi.SX.sym(name, 6) for name in ("r", "y", "memory"))
    outputs = [K * (r - y) + KI * memory, memory + r - y]
    names = ["reference_leg_length", "leg_length", "memory"], ["actuator_force", "memory_next"]
    return casadi.Function("law", [r, y, memory], outputs, *names)


def experiment_of(**tables: Any) -> gs.Experiment:
    """An uneven loop around a moving reference, whose forces do not pass their limit."""
    motion = {"type": "sine", "position_amplitude": ["8 mm", "-5 mm", "6 mm"], "frequency": "4 Hz"}
    loop = {"duration": 0.24, "sample_time": T, "plant_step": 1e-3, "delay": 1}
    around = {"reference": motion, "limits": {"reference": "warn"}, "loop": loop, "change": CHANGES}
    sensors = {"noise": {"leg_length": "20 um"}, "seed": 5}
    return uneven_experiment("pd", **{**around, "sensors": sensors, **tables})


def expected_of(
    error: FloatArray, spans: dict[int, Any], on: tuple[int, ...], start: FloatArray, rests: bool
) -> FloatArray:
    """The commands (m, 6) of the loop above; a linear controller `rests` with its sum at 0, others keep theirs."""
    commands, is_off = list[FloatArray](), False
    total = lacked = force = np.zeros(6)
    for k, e in enumerate(error):
        if k in spans:
            is_off, force = True, np.array(spans[k] or (commands[-1] if commands else start))
        is_off = is_off and k not in on
        total = np.zeros(6) if is_off and rests else total
        wanted = K * e + KI * total
        commands.append(force if is_off else wanted + lacked)
        lacked = force - wanted if is_off else lacked * (1 - T)
        total = total if is_off else total + e
    return np.array(commands)


@pytest.mark.parametrize(
    ("controller", "plant", "host"),
    [
        *((linear(), "model", "compiled"), (linear(), "scipy", "Python"), (linear(), "fmu2", "Python")),
        *((linear(), "fmu3", "Python"), (traced(), "model", "compiled"), (traced(), "scipy", "Python")),
        (Integral, "model", "Python"),
    ],
)
def test_the_command_follows_while_it_is_off_and_begins_there(controller: Any, plant: str, host: str) -> None:
    """Also: no bump at a switch, which is what the change of one sample's error makes; and the verdict says when."""
    record = gs.run(experiment_of(plant={"kind": plant}), controller=controller)
    assert record.metadata["host"].startswith(host)
    samples = slice(0, 240, 4)
    command, error = record["controller.force"][samples], record["reference.leg_length"] - record["measured.leg_length"]
    error = error[samples]
    expected = expected_of(error, SPANS, ON, np.zeros(6), isinstance(controller, control.StateSpace))
    scale = np.abs(expected).max()
    assert np.abs(command - expected).max() < 1e-9 * scale
    for k in ON:
        assert np.abs(command[k] - command[k - 1] - K * (error[k] - error[k - 1])).max() < 1e-9 * scale
        assert np.abs(command[k] - K * error[k]).max() > 20  # by which it would jump
    assert record["flag.manual"][samples].ravel().tolist() == [10 <= k < 25 or 35 <= k < 45 for k in range(60)]
    assert "ontroller off from 0.037 to 0.1 s; controller off from 0.14 to 0.18 s" in record.report().verdict.text


@pytest.mark.parametrize("controller", [linear(), Integral])
def test_members_are_switched_each_at_its_time_and_some_are_off_from_the_start(controller: Any) -> None:
    """Of machines that differ, with jitter; at 0 s the command before is the force that holds the machine."""
    varied = {
        "change.1.at": {"choice": ["0 ms", "36 ms", "40 ms"]},
        "change.2.at": {"choice": ["60 ms", "72 ms", "100 ms"]},
        "change.3.manual_force": {"uniform": [40, 60]},
        "platform_mass": {"uniform": [12, 16]},
    }
    changes = [{"at": 0.04, "enabled": False}, CHANGES[1], {**CHANGES[2], "manual_force": FORCE}, CHANGES[3]]
    loop = {"duration": 0.24, "sample_time": T, "plant_step": 1e-3, "delay": 1, "jitter": "2 ms"}
    experiment = experiment_of(change=changes, loop=loop, ensemble={**varied, "members": 11})
    members = Members(experiment, controller)
    running = members.prepared(0, 11).batch.in_parallel(Stepping(1e-9, None))
    with running.plant:
        run = simulate(running.plant, running.law_from, running.loop)
    assert run.host.startswith("Python" if controller is Integral else "compiled")
    assert running.loop.reference is not None
    reference = running.loop.reference[:240:4, 12:18]
    offs = set()
    for k, values in enumerate(members.draws(0, 11).values):
        off, on = (round(values["change", number, "at"] / T) for number in "12")
        offs.add(off)
        spans = {off: None, 35: values["change", "3", "manual_force"]}
        error, start = reference - run.measured[:, k, 12:18], running.loop.start_force[k]
        expected = expected_of(error, spans, (on, 45), start, controller is not Integral)
        assert np.abs(run.command[:, k] - expected).max() < 1e-9 * np.abs(expected).max()
    assert offs == {0, 9, 10}


@pytest.mark.parametrize(("space", "plant"), [("leg", "model"), ("task", "model"), ("task", "scipy")])
def test_an_exported_controller_commands_the_same(space: str, plant: str) -> None:
    """Expected: the C with the same switch, for the same measurements and limits."""
    force = [31.0, -42.0, 17.0, 95.0, -23.0, 38.0]
    changes: list[dict[str, Any]] = [
        {"at": at, "enabled": k % 2 > 0} for k, at in enumerate((0.03, 0.0605, 0.09, 0.12))
    ]
    changes[0]["manual_force"] = force
    controller = {**PID, "space": space, "feedforward": "computed_torque"}
    tables = {"reference": SINE, "controller": controller, "actuators": {"force_limit": 80.0}}
    record = gs.run(exported_experiment(**tables, change=changes, plant={"kind": plant}))
    command, measured = (record[name][:300:3] for name in ("controller.force", "measured.leg_length"))
    code, forces = Exported(source_of(exported_experiment(**tables), parts="manual")).start(), []
    for k, lengths in enumerate(measured):
        code.set("enabled", float(not (20 <= k < 41 or 60 <= k < 80)))
        code.set("manual_force", force if k < 60 else command[59])
        forces.append(code.step(lengths)[0])
    assert np.abs(command).max() > 80
    assert largest_difference(np.array(forces), np.clip(command, -80, 80)) < 1e-9


def test_what_a_function_encloses_rests_while_the_controller_is_off() -> None:
    """Expected: as many calls kept as there are samples at which it is on; a lock, which has no copy, is named."""
    counts: list[int] = []

    def make(_platform: gs.Platform, _sample_time: float, lock: Any = None) -> Any:
        calls = 0

        def law(_sample: gs.Sample) -> FloatArray:
            nonlocal calls
            calls += lock is None
            counts.append(calls)
            return np.zeros(6)

        return law

    experiment = uneven_experiment(
        "pd", loop={"duration": 0.4, "sample_time": 0.004, "plant_step": 0.001}, change=CHANGES[:2]
    )
    gs.run(experiment, controller=make)
    assert counts[-1] == len(counts) == 100 - 15
    locked = gs.run(experiment, controller=lambda platform, period: make(platform, period, threading.Lock()))
    assert "needs a copy of it" in str(locked.metadata["outcome"]["cause"])


def test_a_force_without_the_switch_is_refused() -> None:
    for change in ({"manual_force": FORCE}, {"enabled": True, "manual_force": FORCE}):
        with pytest.raises(
            gs.GoughStewartError, match="manual_force acts while the controller is off; expected enabled ="
        ):
            gs.run(experiment_of(change=[{"at": 0.1, **change}]))
