"""An FMU of somebody else: whatever it does, the rows before it stay, and the cause is named."""

import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart import GoughStewartError, Sample, StepError
from gough_stewart.harness.plants.fmu import FmuPlant
from gough_stewart.harness.plants.isolated import Isolated, IsolatedFmu
from tests.support.failing_unit import FAILS_AT, FREED, Failure, failing_unit
from tests.support.fmu_plants import Fmu
from tests.support.lagrangian import FloatArray
from tests.support.uneven import INPUTS, STATE, UNEVEN


@pytest.fixture(scope="module")
def unit(fmus: dict[str, Fmu], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return failing_unit(fmus["2.0"], tmp_path_factory.mktemp("unit") / "failing.fmu")


def run_with(
    unit: Path, failure: Failure, law: Callable[[Sample], FloatArray] | None = None, warn: Callable[[str], None] = print
) -> gs.Record:
    """0.02 s at 1 ms a row."""
    text = f"""
title = "a unit that fails"
plant = {{kind = "fmu2", fixed_step_size = {float(failure)}}}
reference = {{type = "hold"}}
controller = {{type = "open_loop"}}
loop = {{duration = 0.02}}
limits = {{stroke = "ignore", position_error = 100}}
"""
    (unit.parent / "failing.toml").write_text(text)
    return gs.run(unit.parent / "failing.toml", fmu=unit, controller=law or (lambda _sample: np.zeros(6)), warn=warn)


WARM = "the oil is warm; " * 4
ENDS = {
    Failure.ERROR: r"failing.fmu: the oil is cold",
    Failure.FATAL: r"failing.fmu: .*",
    Failure.EXIT: r"ended its process with exit code 7 in do_step at time 0.01 s: out of oil",
    Failure.LEAVE: r"ended its process with exit code 0 in do_step at time 0.01 s$",
    Failure.CRASH: r"crashed \(SIGABRT\) in do_step at time 0.01 s",
    Failure.UNKNOWN: r"failing.fmu: fmi2DoStep failed with status -1",
    Failure.LONG: r"failing.fmu: beginx+ … 199,999,000 more bytes … x+end$",
    Failure.MANY: r"failing.fmu: drop 0; drop 1; .* … 99,992 more messages …; .*; drop 99999$",
    Failure.ALARM: r"failing.fmu: the oil is cold$",
}


@pytest.mark.parametrize("failure", ENDS)
def test_a_unit_that_fails_in_mid_run_leaves_the_rows_before(unit: Path, failure: Failure) -> None:
    """Expected: rows up to the first time after FAILS_AT, the outcome with the cause."""
    record = run_with(unit, failure)
    outcome = record.metadata["outcome"]
    assert outcome["status"] == "stopped"
    assert re.search(ENDS[failure], outcome["cause"])
    assert len(outcome["cause"]) < 2000
    assert record["time"][-1] == pytest.approx(np.ceil(1e3 * FAILS_AT) / 1e3)


def test_warnings_of_a_unit_are_one_remark_and_what_it_prints_is_kept_back(
    unit: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Expected: runs to their ends; one warning for those of its 10 steps from 0.01 s on."""
    said: list[str] = []
    record = run_with(unit, Failure.WARN, warn=said.append)
    assert record.metadata["outcome"]["status"] == "completed"
    assert said == record.metadata["warnings"] == [f"{unit}: {WARM}… 2 more messages …; {WARM.removesuffix('; ')}"]
    assert run_with(unit, Failure.PRINT).metadata["outcome"]["status"] == "completed"
    assert capfd.readouterr().out == ""


def test_ctrl_c_ends_a_unit_that_hangs_and_keeps_the_rows(unit: Path) -> None:
    """Expected: an outcome that says interrupted, within the time that the unit is given, and no process left."""

    def law(sample: Sample) -> FloatArray:
        if sample.time > FAILS_AT:
            threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
        return np.zeros(6)

    # a test run in the background may have been told to ignore it
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        record = run_with(unit, Failure.HANG, law)
    finally:
        signal.signal(signal.SIGINT, before)
    assert record.metadata["outcome"]["status"] == "interrupted"
    assert record["time"][-1] == pytest.approx(0.01)


def test_it_answers_and_refuses_as_in_process(fmus: dict[str, Fmu]) -> None:
    """Expected: to the last bit over changes, and errors with their data; steps and starts are in test_plants.py."""
    results = []
    for kind in (FmuPlant, IsolatedFmu):
        with kind(fmus["2.0"].path, UNEVEN, STATE) as plant:
            plant.set_parameters({"platform_mass": 12.5})
            plant.set_inputs(INPUTS.to_vector())
            plant.do_step(0.0, 0.05)
            results.append(plant.results())
            assert np.array_equal(plant.signals(), results[-1][:24])
            with pytest.raises(GoughStewartError, match="base_points"):
                plant.set_parameters({"base_points": np.zeros((6, 3))})
            plant.set_inputs(np.append(np.tile([1e4, -1e4], 3), np.zeros(6)))
            with pytest.raises(StepError) as caught:
                plant.do_step(0.05, 1.0)
            assert (caught.value.value, caught.value.time) == (1.0, 0.05)
    assert np.array_equal(results[0], results[1])


def test_it_is_freed_and_leaves_nothing(unit: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Expected: rule 8; the trace of fmi2FreeInstance; the temporary folder is as empty as before, also if refused."""
    freed, folder = tmp_path / "freed", tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv(FREED, str(freed))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    plant = IsolatedFmu(unit, UNEVEN)
    assert len(list(folder.iterdir())) == 1
    assert not freed.exists()
    plant.close()
    plant.close()
    assert freed.exists()
    with pytest.raises(GoughStewartError, match=r"nowhere.fmu: no such file"):
        IsolatedFmu("nowhere.fmu", UNEVEN)
    assert list(folder.iterdir()) == []


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for the process there")
def test_a_hanging_unit_ends_with_the_run_that_is_killed(unit: Path) -> None:
    """Expected: no process of the unit is left after SIGKILL of the run, which can clean up nothing."""
    program = f"""
from pathlib import Path
import gough_stewart as gs
from gough_stewart.harness.plants.isolated import IsolatedFmu
plant = IsolatedFmu(Path({str(unit)!r}), gs.load_preset("liu2000"), fixed_step_size={float(Failure.HANG)})
print(plant._isolated._process.pid, flush=True)
for k in range(20):
    plant.do_step(k * 1e-3, 1e-3)
"""
    run = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    child = Path("/proc", run.stdout.readline().strip())
    assert child.exists()
    time.sleep(0.3)  # until it hangs
    run.kill()
    run.communicate()
    end = time.monotonic() + 20
    while child.exists() and "zombie" not in (child / "status").read_text() and time.monotonic() < end:
        time.sleep(0.1)
    assert not child.exists() or "zombie" in (child / "status").read_text()


GIVEN = "tests.support.isolated_object:Given"
UNIT = Path("other.fmu")
NAME = "SOME_NAME_OF_THIS_TEST"


def test_an_object_in_another_process_has_its_arguments_answers_and_errors(tmp_path: Path) -> None:
    """Expected: arguments in their order; errors with their data, after which it goes on; closed when it is closed."""
    closed = tmp_path / "closed"
    other = Isolated(UNIT, GIVEN, (1.5, 2, closed), environment={NAME: "7.3", "TEMP": "elsewhere"})
    assert other.call("both", "x", {"a": 2}) == (1.5, 2, "x", {"a": 2})
    assert [other.call("variable", name) for name in (NAME, "TEMP", "PATH")] == ["7.3", "elsewhere", os.environ["PATH"]]
    folder = Path(other.call("variable", "TMPDIR"))
    assert folder.is_dir()
    with pytest.raises(StepError, match=r"^leg_length\[4\] = 0.25 at time 7.3 s: the leg has collapsed$") as caught:
        other.call("fail", 7.3)
    assert (caught.value.quantity, caught.value.value, caught.value.time) == ("leg_length[4]", 0.25, 7.3)
    assert other.call("both") == (1.5, 2)
    assert not closed.exists()
    other.close()
    assert closed.read_text() == "closed"
    assert not folder.exists()
    with pytest.raises(GoughStewartError, match=r"^other.fmu: the FMU ended its process with exit code 0 in both$"):
        other.call("both")
    with pytest.raises(StepError, match=r"^first = 1.5 at time 7.3 s: is refused$"):
        Isolated(UNIT, GIVEN, ("refuse", 2))
