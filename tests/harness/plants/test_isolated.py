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
from fmpy.fmi1 import FMICallException

from gough_stewart.harness.control.python.sample import Sample
from gough_stewart.harness.errors import ControllerError, PlantError
from gough_stewart.harness.experiment.file import experiment_from
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.plants.fmu import FmuPlant
from gough_stewart.harness.plants.isolated import Isolated, IsolatedFmu
from gough_stewart.harness.plants.unit import Unit, UnitFile
from gough_stewart.harness.results.record import Record
from gough_stewart.model.errors import InterfaceError, StepError
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray
from tests.support.failing_unit import FAILS_AT, FREED, Failure, failing_unit
from tests.support.fmu_plants import Fmu
from tests.support.uneven import INPUTS, STATE, UNEVEN


@pytest.fixture(scope="module")
def unit(fmus: dict[str, Fmu], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return failing_unit(fmus["2.0"], tmp_path_factory.mktemp("unit") / "failing.fmu")


def no_forces(_sample: Sample) -> FloatArray:
    return np.zeros(6)


def run_with(
    unit: Path,
    failure: Failure,
    law: Callable[[Sample], FloatArray] = no_forces,
    warn: Callable[[str], None] | None = None,
) -> Record:
    """0.02 s at 1 ms a row."""
    values = {
        "title": "a unit that fails",
        "plant": {"kind": "fmu2", "fixed_step_size": float(failure)},
        "reference": {"type": "hold"},
        "controller": {"type": "open_loop"},
        "loop": {"duration": 0.02},
        "limits": {"stroke": "ignore", "position_error": 100},
    }
    return run(experiment_from(values), fmu=unit, controller=law, warn=warn)


@pytest.mark.parametrize(
    ("failure", "cause"),
    [
        (Failure.ERROR, r"failing.fmu: the oil is cold"),
        (Failure.FATAL, r"failing.fmu: .*"),
        (Failure.EXIT, r"ended its process with exit code 7 in do_step at time 0.01 s: out of oil"),
        (Failure.LEAVE, r"ended its process with exit code 0 in do_step at time 0.01 s$"),
        (Failure.CRASH, r"crashed \(SIGABRT\) in do_step at time 0.01 s"),
        (Failure.UNKNOWN, r"failing.fmu: fmi2DoStep failed with status -1"),
        (Failure.LONG, r"failing.fmu: beginx+ … 199,999,000 more bytes … x+end$"),
        (Failure.MANY, r"failing.fmu: drop 0; drop 1; .* … 99,992 more messages …; .*; drop 99999$"),
        (Failure.ALARM, r"failing.fmu: the oil is cold$"),
    ],
)
def test_a_unit_that_fails_in_mid_run_leaves_the_rows_before(unit: Path, failure: Failure, cause: str) -> None:
    """Expected: rows up to the first time after FAILS_AT, the outcome with the cause."""
    record = run_with(unit, failure)
    outcome = record.metadata["outcome"]
    assert outcome["status"] == "stopped"
    assert re.search(cause, outcome["cause"])
    assert len(outcome["cause"]) < 2000
    assert record["time"][-1] == pytest.approx(np.ceil(1e3 * FAILS_AT) / 1e3)


def test_a_warning_of_a_unit_is_a_remark(unit: Path) -> None:
    """Expected: a run to its end, with one warning for those of its 10 steps from 0.01 s on."""
    said: list[str] = []
    record = run_with(unit, Failure.WARN, warn=said.append)
    assert record.metadata["outcome"]["status"] == "completed"
    warm = "the oil is warm; " * 4
    assert said == [f"{unit}: {warm}… 2 more messages …; {warm.removesuffix('; ')}"]
    assert record.metadata["warnings"] == said


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


def test_messages_of_a_unit_are_heard_whole(unit: Path) -> None:
    """Expected: status, category, text and name as the unit hands them to the logger."""
    with UnitFile(unit) as file, Unit(file) as instance:
        instance.write_by_name({"fixed_step_size": float(Failure.ERROR)})
        instance.initialise()
        with pytest.raises(FMICallException):
            instance.do_step(FAILS_AT, 1e-3)
        assert instance.messages == [(3, "logStatusError", "the oil is cold", "plant")]
        assert instance.take_messages() == "the oil is cold"
        assert instance.messages == []


def test_what_a_unit_prints_does_not_disturb(unit: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run_with(unit, Failure.PRINT).metadata["outcome"]["status"] == "completed"
    assert capfd.readouterr().out == ""


def test_it_is_the_same_plant_as_in_process(fmus: dict[str, Fmu], paper: Platform) -> None:
    """Expected: to the last bit, over changes of inputs and parameters, and errors with their data."""
    path, rows = fmus["3.0"].path, []
    for kind in (FmuPlant, IsolatedFmu):
        with kind(path, paper) as plant:
            plant.set_parameters({"platform_mass": 12.5})
            plant.set_inputs(np.linspace(-30.0, 80.0, 12))
            plant.do_step(0.0, 0.02)
            rows.append(plant.results())
            with pytest.raises(InterfaceError, match="base_points"):
                plant.set_parameters({"base_points": np.zeros((6, 3))})
            plant.set_inputs(np.append(np.tile([1e4, -1e4], 3), np.zeros(6)))
            with pytest.raises(StepError, match=r"at time 0\.02") as caught:
                plant.do_step(0.02, 1.0)
            assert caught.value.time == 0.02
    assert (rows[0] == rows[1]).all()


def test_it_leaves_nothing(
    fmus: dict[str, Fmu], paper: Platform, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Expected: rule 8; the temporary folder is as empty as before, whether the unit was had or not."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    plant = IsolatedFmu(fmus["3.0"].path, paper)
    process = plant._other._process
    assert len(list(tmp_path.iterdir())) == 1
    plant.close()
    plant.close()
    assert process.returncode == 0  # by itself, when it has cleaned up
    with pytest.raises(PlantError, match=r"nowhere.fmu: no such file"):
        IsolatedFmu("nowhere.fmu", paper)
    assert list(tmp_path.iterdir()) == []


def test_a_unit_is_freed_when_it_is_closed(unit: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the trace of fmi2FreeInstance, which releases what the instance has allocated."""
    monkeypatch.setenv(FREED, str(tmp_path / "freed"))
    with IsolatedFmu(unit, UNEVEN):
        assert not (tmp_path / "freed").exists()
    assert (tmp_path / "freed").exists()


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for the process there")
def test_a_hanging_unit_ends_with_the_run_that_is_killed(unit: Path) -> None:
    """Expected: no process of the unit is left after SIGKILL of the run, which can clean up nothing."""
    program = f"""
import sys
from pathlib import Path
from gough_stewart.harness.plants.isolated import Isolated, IsolatedFmu
from gough_stewart.model.platform_toml import load_preset
plant = IsolatedFmu(Path({str(unit)!r}), load_preset("liu2000"), fixed_step_size={float(Failure.HANG)})
print(plant._other._process.pid, flush=True)
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
# Five thousand characters, of which no two hundred come twice.
LONG = "".join(f"{k:05}" for k in range(1000))


def test_an_object_in_another_process_has_its_arguments_and_answers(tmp_path: Path) -> None:
    """Expected: arguments of construction and of calls in their order; closed when it is closed."""
    closed = tmp_path / "closed"
    numbers = np.arange(6.0)
    other = Isolated(UNIT, GIVEN, (1.5, numbers, closed))
    first, second, third, fourth = other.call("both", "x", {"a": 2})
    assert (first, third, fourth) == (1.5, "x", {"a": 2})
    assert second.tolist() == numbers.tolist()
    assert other.call("variable", "SOME_NAME_OF_THIS_TEST") is None
    assert other._process.pid != os.getpid()
    assert os.getpgid(other._process.pid) != os.getpgid(0)
    assert not closed.exists()
    folder = Path(other._folder.name)
    assert other.call("variable", "TMPDIR") == other.call("variable", "TEMP") == str(folder)
    assert folder.is_dir()
    other.close()
    assert closed.read_text() == "closed"
    assert not folder.exists()
    assert other._process.returncode == 0
    other.close()
    with pytest.raises(PlantError, match=r"^other.fmu: the FMU ended its process with exit code 0 in both$"):
        other.call("both")


def test_errors_of_an_object_in_another_process_come_with_their_data() -> None:
    """Expected: kind, data and words; the object goes on. Of its construction too, and then no process is left."""
    other = Isolated(UNIT, GIVEN, (1, 2), environment={"SOME_NAME_OF_THIS_TEST": "7.3", "TEMP": "elsewhere"})
    try:
        assert other.call("variable", "SOME_NAME_OF_THIS_TEST") == "7.3"
        assert other.call("variable", "TEMP") == "elsewhere"
        assert other.call("variable", "PATH") == os.environ["PATH"]
        with pytest.raises(StepError, match=r"^leg_length\[4\] = 0.25 at time 7.3 s: the leg has collapsed$") as caught:
            other.call("fail", 7.3)
        assert (caught.value.quantity, caught.value.value, caught.value.time) == ("leg_length[4]", 0.25, 7.3)
        assert other.call("both") == (1, 2)
    finally:
        other.close()
    with pytest.raises(StepError, match=r"^first = 1.5 at time 7.3 s: is refused$"):
        Isolated(UNIT, GIVEN, ("refuse", 2))


@pytest.mark.parametrize(
    ("lines", "said"),
    [((), ""), (("first", "second"), ": second"), ((LONG,), f": {LONG[-1999:-1799]}"), (("last", "  ", ""), ": last")],
)
def test_a_process_that_ends_is_told_by_code_call_and_last_line(lines: tuple[str, ...], said: str) -> None:
    """Expected: the error class that was asked for; two hundred characters of the end of a long line."""
    other = Isolated(UNIT, GIVEN, (1, 2), ControllerError)
    with pytest.raises(ControllerError) as caught:
        other.call("leave", 5, *lines)
    assert str(caught.value) == f"other.fmu: the FMU ended its process with exit code 5 in leave{said}"
    with pytest.raises(ControllerError, match=r"ended its process with exit code 5 in both"):
        other.call("both")
    other.close()
    stepping = Isolated(UNIT, GIVEN, (1, 2))
    with pytest.raises(
        PlantError, match=r"^other.fmu: the FMU ended its process with exit code 3 in do_step at time 7.3"
    ):
        stepping.call("do_step", 7.3, 0.1)
    stepping.close()


def test_a_process_that_is_killed_raises_in_the_call_that_waits_for_it() -> None:
    other = Isolated(UNIT, GIVEN, (1, 2))
    folder = Path(other._folder.name)
    other.kill()
    assert other._process.returncode == -signal.SIGKILL
    assert not folder.exists()
    other.close()


def test_an_isolated_unit_has_the_start_tolerance_and_step_that_it_is_given(fmus: dict[str, Fmu]) -> None:
    """Expected: to the last bit the plant in process, whose tests say what these do; signals too."""
    rows = []
    for kind in (FmuPlant, IsolatedFmu):
        for tolerance, step in ((1e-8, 0.0), (1e-3, 0.0), (1e-8, 0.004)):
            with kind(fmus["2.0"].path, UNEVEN, STATE, tolerance, step) as plant:
                assert plant.fmi_version == "2.0"
                plant.set_inputs(INPUTS.to_vector())
                plant.do_step(0.0, 0.05)
                rows.append(plant.results())
                assert np.array_equal(plant.signals(), rows[-1][:24])
    assert all(np.array_equal(a, b) for a, b in zip(rows[:3], rows[3:], strict=True))
    assert len({row.tobytes() for row in rows}) == 3
