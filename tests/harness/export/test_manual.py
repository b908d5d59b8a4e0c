"""Exported controllers that are switched off and on, in C and in a unit; six different legs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.export.design import Designed, designed
from tests.harness.export.test_controllers import HOLD, PD, PID, SINE
from tests.support.arrays import FloatArray
from tests.support.exported import REALS, Exported, uneven_experiment
from tests.support.sampled_unit import run_unit

MANUAL = np.array([31.0, -42.0, 17.0, 55.0, -23.0, 38.0])
ERROR = np.array([3, -2, 4, 1, -5, 2]) * 1e-3
CASES: dict[str, dict[str, Any]] = {
    "PD": {**PD, "feedforward": "gravity"},
    "PID": {**PID, "feedforward": "gravity"},
    "PID in task space": {**PID, "space": "task", "feedforward": "gravity"},
}


def made(controller: dict[str, Any], **options: Any) -> Designed:
    experiment = uneven_experiment(reference=HOLD, controller=controller, actuators={"force_limit": 60.0}, **options)
    return designed(experiment, parts=("manual",))


def off(code: Exported, force: FloatArray = MANUAL) -> Exported:
    code.set("enabled", 0)
    code.set("manual_force", force)
    return code


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("case", CASES)
def test_a_controller_follows_while_it_is_off_and_begins_there(case: str, real: str) -> None:
    """Expected: the manual force, cut to the limit; switched on, no more than the change of one sample from it.

    In double precision, `tests/harness/loop/test_faults.py` has every sample of the host.
    """
    code = off(Exported(made(CASES[case]), real).start())
    measured = code.designed.first_measured - ERROR
    for _ in range(200):
        force, limited = code.step(measured)
        np.testing.assert_allclose(force, MANUAL, rtol=1e-6)
        assert not limited.any()
    code.set("manual_force", 10 * MANUAL)
    force, limited = code.step(measured)
    np.testing.assert_array_equal(force, np.sign(MANUAL) * 60)
    assert limited.all()
    off(code).step(measured)
    code.set("enabled", 1)
    assert np.abs(code.step(measured)[0] - MANUAL).max() < 0.02


def test_the_force_that_was_taken_over_fades_with_the_stated_time() -> None:
    """Expected: of a PD at rest (1 − T/1 s)ⁿ of what its command lacked, by hand."""
    code = off(Exported(made(CASES["PD"])).start())
    measured = code.designed.first_measured - ERROR
    for _ in range(500):  # until the derivative's filter rests
        code.step(measured)
    lacked = code.remembered("transfer")
    code.set("enabled", 1)
    forces = np.array([code.step(measured)[0] for _ in range(300)])
    at_rest = MANUAL - lacked
    expected = at_rest + lacked * (1 - 0.0015) ** np.arange(300)[:, None]
    assert np.abs(lacked).min() > 3
    np.testing.assert_allclose(forces, np.clip(expected, -60, 60), atol=1e-9)


def test_bad_inputs_while_it_is_off_change_nothing_and_a_bad_manual_force_is_none() -> None:
    """Expected: the manual force whatever is measured, with its status; NaN as manual force leaves it on."""
    code = off(Exported(made(CASES["PID"])).start())
    measured = code.designed.first_measured
    code.step(measured)
    for row, status in ((np.full(6, np.nan), 1), (measured, 0)):
        force, _ = code.step(row)
        np.testing.assert_allclose(force, MANUAL)
        assert code.status == status
    off(code, np.full(6, np.nan))
    force, _ = code.step(measured)
    assert np.isfinite(force).all()


def test_without_a_switch_nothing_is_added() -> None:
    """Expected: the same forces as with one that is never used, and none of its members in the memory."""
    experiment = uneven_experiment(reference=SINE, controller=CASES["PID"])
    plain, switched = (Exported(designed(experiment, parts=parts)) for parts in ((), ("manual",)))
    rows = plain.designed.first_measured + 1e-3 * np.sin(np.arange(60))[:, None]
    np.testing.assert_array_equal(plain.forces(rows), switched.forces(rows))
    assert "enabled" not in plain.sources.headers["controller.h"]


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_unit_is_switched_by_its_inputs(version: str, tmp_path: Path) -> None:
    """Expected: the C at the same samples, one sample later; on by default."""
    experiment = uneven_experiment(reference=HOLD, controller=CASES["PID"], actuators={"force_limit": 60.0})
    (path,) = gs.export(experiment, forms="fmu", fmi=[version], parts="manual", out=tmp_path, allow_unstable=True)
    late = Exported(designed(experiment.model_copy(), parts=("manual",))).start()
    measured = late.designed.first_measured - ERROR
    inputs, expected = [], []
    for k in range(40):
        enabled = float(not 10 <= k < 30)
        late.set("enabled", enabled)
        late.set("manual_force", MANUAL)
        expected.append(late.step(measured)[0])
        inputs.append({"leg_length": measured, "manual_force": MANUAL})
        if k:
            inputs[-1]["enabled"] = np.array([enabled])
    outputs, begun = run_unit(path, inputs, 0.0015, 0.0)
    assert begun["enabled"] == 1
    np.testing.assert_allclose(outputs.force, expected, atol=1e-9)
    np.testing.assert_allclose(outputs.force[10:30], np.broadcast_to(MANUAL, (20, 6)))
