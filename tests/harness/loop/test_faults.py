"""Faults: legs whose force is cut, and sensors that freeze, in NumPy's loop and in machine code.

`test_compiled_loop.py` compares both loops row by row with faults of many members, `tests/harness/export` the plain C.
"""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.experiment.file import experiment_from
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.plants.lanes import BatchPlant
from gough_stewart.harness.results.record import machine_of
from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.state import Inputs
from tests.support.uneven_loops import experiment_of as uneven_experiment

MOTION = {"type": "sine", "position_amplitude": ["8 mm", "-5 mm", "6 mm"], "frequency": "4 Hz"}
AROUND: dict[str, Any] = {
    "reference": MOTION,
    "limits": {"reference": "warn"},
    "loop": {"duration": 0.2, "sample_time": "4 ms", "plant_step": "1 ms", "delay": 1},
    "actuators": {"lag": "3 ms", "rate_limit": "20 kN/s"},
    "sensors": {"noise": {"leg_length": "20 um"}, "quantisation": {"leg_length": "3 um"}, "seed": 5},
}


@pytest.fixture(params=["compiled", "NumPy"])
def host(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Both loops."""
    if request.param == "NumPy":
        monkeypatch.setattr(BatchPlant, "loop_run", property(lambda _: None))
    return str(request.param)


def record_of(*faults: dict[str, Any], **tables: Any) -> gs.Record:
    """A run of an uneven loop whose reference moves, with these faults."""
    return gs.run(uneven_experiment("pid", **{**AROUND, **tables}, fault=list(faults)))


def test_a_cut_leg_has_no_force_from_that_row_on(host: str) -> None:
    """Expected: exactly 0 N while it is cut; the run without the fault, bit by bit, before.

    Accelerations are those of forward dynamics with no force in these legs. A drive goes on beside the cut: when the
    force is back it is nearer to its command than the command's last step; a drive that began at 0 would be far off.
    """
    record = record_of({"at": 0.05, "cut": [2, 5], "duration": 0.061}, {"at": 0.081, "cut": [6]})
    free = record_of()
    force, time = record["actuator_force"], record["time"]
    assert record.metadata["outcome"]["status"] == "completed"
    cut = np.zeros((len(time), 6), dtype=bool)
    cut[50:111, [1, 4]] = True
    cut[81:, 5] = True
    assert (force[cut] == 0).all()
    assert (force[~cut] != 0).all()
    assert np.array_equal(force[:50], free["actuator_force"][:50])
    assert np.abs(record["position"][111] - free["position"][111]).max() > 1e-4
    machine = machine_of(record)
    for row in (49, 50, 80, 81, 111, 200):
        state = np.concatenate([record[name][row] for name in gs.State._fields])
        found, _ = plant_equations(IDEAL, machine, state, Inputs(force[row], np.zeros(3), np.zeros(3)))
        ours = record["acceleration"][row], record["angular_acceleration"][row]
        assert np.concatenate(ours) == pytest.approx(found[6:], rel=1e-9, abs=1e-9)
    # commands of a sample act one sample later: that of row 104 from row 108 on
    before, now = record["controller.force"][[100, 104], 1]
    assert abs(now - force[111, 1]) < abs(now - before) < 0.1 * abs(now)
    assert host in record.metadata["host"] or host == "NumPy"


@pytest.mark.parametrize("own_clock", [False, True])
def test_a_frozen_sensor_holds_its_last_reading(host: str, own_clock: bool) -> None:
    """Expected: what it measured last before the fault, noise and step included; afterwards the noise of before."""
    sensors = {**AROUND["sensors"], **({"sample_time": "3 ms"} if own_clock else {})}
    record = record_of(
        {"at": 0.05, "freeze": {"leg_length": [1, 4]}, "duration": 0.05},
        {"at": 0.06, "freeze": {"leg_length": [6]}},
        sensors=sensors,
    )
    free = record_of(sensors=sensors)
    measured, true = record["measured.leg_length"], record["leg_length"]
    every = 3 if own_clock else 4
    # the last reading that the controller had before, at its last sample or at the sensors' last clock
    last = 48
    samples = np.arange(0, 200, 4)
    frozen = (samples >= 52) & (samples < 100)
    for leg in (0, 3):
        assert (measured[samples[frozen], leg] == measured[52, leg]).all()
        if not own_clock:
            assert measured[52, leg] == free["measured.leg_length"][last, leg]
    assert np.ptp(measured[60:, 5]) == 0
    assert np.ptp(true[60:, 5]) > 1e-4
    back = samples[samples >= 100 + every]
    read = back // every * every
    noise = measured[back, 0] - true[read, 0]
    theirs = free["measured.leg_length"][back, 0] - free["leg_length"][read, 0]
    assert np.abs(noise - theirs).max() <= 3.1e-6  # a step of 3 um at most, in place of noise of 20 um
    assert np.ptp(noise) > 2e-5
    assert host in record.metadata["host"] or host == "NumPy"


def test_a_sensor_that_is_frozen_from_the_start_has_its_first_reading(host: str) -> None:
    """Expected: the first reading of the run without the fault."""
    record, free = record_of({"at": 0, "freeze": {"leg_length": [3]}}), record_of()
    assert (record["measured.leg_length"][:, 2] == free["measured.leg_length"][0, 2]).all()
    assert np.ptp(record["measured.leg_length"][:, 1]) > 1e-4
    assert host in record.metadata["host"] or host == "NumPy"


def test_faults_that_overlap_act_until_the_last_one_ends() -> None:
    """Expected: leg 2 from 0.02 to 0.08 s by two faults; leg 4 within, and an encoder from 0.05 s on."""
    faults = [
        {"at": 0.02, "cut": [2], "duration": 0.04},
        {"at": 0.04, "cut": [2, 4], "duration": 0.04},
        {"at": 0.05, "freeze": {"leg_length": [1], "orientation": [3]}},
    ]
    changes = prepare(uneven_experiment("pid", **AROUND, fault=faults)).loop.changes
    assert [change.time for change in changes] == pytest.approx([0.02, 0.04, 0.05, 0.06, 0.08])
    flags = np.array([change.faults for change in changes])
    assert flags[:, 1].tolist() == [1, 1, 1, 1, 0]
    assert flags[:, 3].tolist() == [0, 1, 1, 1, 0]
    # forces of 6 legs, then position (3), orientation (3), two velocities (6), leg_length
    assert flags[:, 6 + 5].tolist() == flags[:, 6 + 12].tolist() == [0, 0, 1, 1, 1]
    assert flags.sum() == 4 + 3 + 2 * 3  # legs 2 and 4, two elements of sensors


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"at": 0.1}, "fault.1.*has no effect; expected cut, a list of legs, or freeze, a table of signals"),
        ({"at": 0.1, "cut": [0]}, "fault.1.cut.*no leg 0; expected numbers from 1 to 6"),
        ({"at": 0.1, "cut": [3, 3]}, r"fault.1.cut.*is \[3, 3\]; expected each number once"),
        ({"at": 0.1, "freeze": {"position": [4]}}, "no element of position 4; expected numbers from 1 to 3"),
        ({"at": 0.1, "freeze": {"length": [4]}}, "no signal 'length'; expected position, orientation"),
        ({"at": 0.1, "freeze": {"position": []}}, r"position is \[\]; expected numbers from 1 to 3"),
        ({"at": 0.1, "freeze": [1]}, "expected a table of signals"),
        # times that are no rows
        ({"at": 5, "cut": [1]}, "fault: a fault at 5 s; expected a time from 0 to 0.2 s"),
        ({"at": 0.0505, "cut": [1]}, "fault: a fault at 0.0505 s; expected.*multiple"),
        ({"at": 0.1, "duration": 1e-9, "cut": [1]}, "fault: a fault of 1e-09 s at 0.1 s; expected at least"),
        ({"at": 0.1, "duration": 0.0205, "cut": [1]}, "fault: the end of a fault at 0.1205 s; expected.*multiple"),
    ],
)
def test_a_fault_that_cannot_be_is_refused_with_what_is_expected(fault: dict[str, Any], said: str) -> None:
    with pytest.raises(gs.GoughStewartError, match=f"(?s){said}"):
        prepare(uneven_experiment("pid", **AROUND, fault=[fault]))


def test_faults_go_through_a_file_and_back() -> None:
    """Expected: the same table from what a record keeps of it."""
    fault = {"at": 0.05, "cut": [2], "freeze": {"leg_length": [1]}, "duration": 0.02}
    one = uneven_experiment("pid", **AROUND, fault=[fault])
    again = experiment_from(one.model_dump(mode="json", exclude_unset=True))
    assert again.fault == one.fault
    assert again.fault[0].model_dump() == fault
