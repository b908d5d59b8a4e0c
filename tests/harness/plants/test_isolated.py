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
from tests.support.arrays import FloatArray
from tests.support.failing_unit import FAILS_AT, FREED, Failure, failing_unit
from tests.support.fmu_plants import Fmu


@pytest.fixture(scope="module")
def unit(fmus: dict[str, Fmu], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return failing_unit(fmus["2.0"], tmp_path_factory.mktemp("unit") / "failing.fmu")


def experiment(unit: Path, failure: Failure) -> Path:
    """A file beside the unit: 0.02 s at 1 ms a row."""
    text = f"""
title = "a unit that fails"
plant = {{kind = "fmu2", fixed_step_size = {float(failure)}}}
reference = {{type = "hold"}}
controller = {{type = "open_loop"}}
loop = {{duration = 0.02}}
limits = {{stroke = "ignore", position_error = 100}}
"""
    path = unit.parent / f"{failure.name}.toml"
    path.write_text(text)
    return path


def run_with(
    unit: Path,
    failure: Failure,
    law: Callable[[gs.Sample], FloatArray] | None = None,
    warn: Callable[[str], None] = print,
) -> gs.Record:
    return gs.run(experiment(unit, failure), fmu=unit, controller=law or (lambda _sample: np.zeros(6)), warn=warn)


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


def test_a_unit_that_warns_and_prints_runs_to_its_end_and_leaves_nothing(
    unit: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Expected: one warning for those of its 10 steps from 0.01 s on; its prints are kept back.

    It is freed, by a trace of fmi2FreeInstance, and the temporary folder is as empty as before, also if it is refused.
    """
    freed, folder = tmp_path / "freed", tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv(FREED, str(freed))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    said: list[str] = []
    record = run_with(unit, Failure.WARN, warn=said.append)
    assert record.metadata["outcome"]["status"] == "completed"
    assert said == record.metadata["warnings"] == [f"{unit}: {WARM}… 2 more messages …; {WARM.removesuffix('; ')}"]
    assert freed.exists()
    assert run_with(unit, Failure.PRINT).metadata["outcome"]["status"] == "completed"
    assert capfd.readouterr().out == ""
    with pytest.raises(gs.GoughStewartError, match=r"nowhere.fmu: no such file"):
        gs.run(experiment(unit, Failure.PRINT), fmu=tmp_path / "nowhere.fmu")
    assert list(folder.iterdir()) == []


def test_ctrl_c_ends_a_unit_that_hangs_and_keeps_the_rows(unit: Path) -> None:
    """Expected: an outcome that says interrupted, within the time that the unit is given, and no process left."""

    def law(sample: gs.Sample) -> FloatArray:
        if sample.time > FAILS_AT:
            threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
        return np.zeros(6)

    # a test run in the background may have been told to ignore it
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        record = run_with(unit, Failure.HANG, law)
    finally:
        signal.signal(signal.SIGINT, before)
    assert record.metadata["outcome"]["status"] == "interrupted"
    assert record["time"][-1] == pytest.approx(0.01)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for the process there")
def test_a_hanging_unit_ends_with_the_run_that_is_killed(unit: Path) -> None:
    """Expected: no process of the unit is left after SIGKILL of the run, which can clean up nothing."""
    program = f"""
import gough_stewart as gs
import numpy as np
def law(sample):
    if sample.time > {FAILS_AT}:
        print("hangs", flush=True)
    return np.zeros(6)
gs.run({str(experiment(unit, Failure.HANG))!r}, fmu={str(unit)!r}, controller=law)
"""
    run = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    assert run.stdout.readline() == "hangs\n"
    (child,) = Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()
    run.kill()
    run.communicate()
    end, status = time.monotonic() + 20, Path("/proc", child, "status")
    while status.exists() and "zombie" not in status.read_text() and time.monotonic() < end:
        time.sleep(0.1)
    assert not status.exists() or "zombie" in status.read_text()
