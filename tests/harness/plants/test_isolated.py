"""An FMU of somebody else: whatever it does, the rows before it stay, and the cause is named."""

import inspect
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path

import fmpy.fmi2
import numpy as np
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.fmu_plants import Fmu

# From this time on a step fails [s].
FAILS_AT = 0.0095
# The environment variable with the name of a file that the unit makes when it is freed.
FREED = "FREED"


class Failure(IntEnum):
    """What happens then; handed over in the place of the parameter `fixed_step_size`."""

    ERROR = 1
    FATAL = 2
    EXIT = 3
    CRASH = 4
    HANG = 5
    PRINT = 6  # no failure: it writes to its standard output, and goes on
    LEAVE = 7  # ends its process as if all were well
    WARN = 8  # no failure: it warns in each step
    UNKNOWN = 9  # a status that no standard knows
    LONG = 10  # an error with a message of 200 MB
    MANY = 11  # an error after 100,000 messages
    ALARM = 12  # an error by its message alone; the step says that all is well


_SOURCE = """
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
typedef struct {
  void (*log)(void*, const char*, int, const char*, const char*, ...);
  void* (*allocate)(size_t, size_t);
  void (*release)(void*);
  void* rest[2];
} Callbacks;
static int* failure;
static const Callbacks* callbacks;
#define API __attribute__((visibility("default")))
API void* fmi2Instantiate(const char* a, int b, const char* c, const char* d, const Callbacks* e, int f, int g) {
  (void)a; (void)b; (void)c; (void)d; (void)f; (void)g;
  callbacks = e;
  failure = e->allocate(1, sizeof *failure);
  return failure;
}
API int fmi2SetReal(void* c, const unsigned* references, size_t n, const double* values) {
  (void)c;
  for (size_t k = 0; k < n; k++) if (references[k] == FIXED_STEP_SIZE) *failure = (int)values[k];
  return 0;
}
API int fmi2GetReal(void* c, const unsigned* references, size_t n, double* values) {
  (void)c; (void)references;
  for (size_t k = 0; k < n; k++) values[k] = 1;
  return 0;
}
API int fmi2SetupExperiment(void* c, int d, double t, double s, int e, double u) {
  (void)c; (void)d; (void)t; (void)s; (void)e; (void)u;
  return 0;
}
API int fmi2EnterInitializationMode(void* c) { (void)c; return 0; }
API int fmi2ExitInitializationMode(void* c) { (void)c; return 0; }
API int fmi2DoStep(void* c, double time, double step, int n) {
  (void)c; (void)step; (void)n;
  if (time < FAILS_AT) return 0;
  switch (*failure) {
    case 1: callbacks->log(NULL, "plant", 3, "logStatusError", "the oil is cold"); return 3;
    case 2: return 4;
    case 3: fprintf(stderr, "out of oil\\n"); exit(7);
    case 4: abort();
    case 5: for (;;) sleep(1000);
    case 6: printf("%1000d\\n", 1); fflush(stdout); break;
    case 7: exit(0);
    case 8: callbacks->log(NULL, "plant", 1, "logStatusWarning", "the oil is warm"); break;
    case 9: return -1;
    case 10: {
      char* text = malloc(200000001);
      memset(text, 'x', 200000000);
      memcpy(text, "begin", 5);
      strcpy(text + 199999997, "end");
      callbacks->log(NULL, NULL, 3, "\\xff", text);
      return 3;
    }
    case 11: {
      char text[32];
      for (int k = 0; k < 100000; k++) {
        sprintf(text, "drop %d", k);
        callbacks->log(NULL, "plant", 1, "logStatusWarning", text);
      }
      return 3;
    }
    case 12: callbacks->log(NULL, "plant", 3, "logStatusError", "the oil is cold"); break;
  }
  return 0;
}
API void fmi2FreeInstance(void* c) {
  callbacks->release(c);
  const char* trace = getenv("FREED");
  if (trace) fclose(fopen(trace, "w"));
}
"""


def failing_unit(fmu: Fmu, target: Path) -> Path:
    """The archive of an FMU, FMI 2.0, with the binary replaced."""
    (reference,) = fmu.variables["fixed_step_size"].references
    source = _SOURCE.replace("FIXED_STEP_SIZE", str(reference)).replace("FAILS_AT", str(FAILS_AT))
    # what FMPy looks for and does not call here
    others = set(re.findall(r"def (fmi2[A-Z]\w+)\(", inspect.getsource(fmpy.fmi2)))
    others -= set(re.findall(r"fmi2\w+", source))
    source += "\n".join(f"API int {name}(void) {{ return 0; }}" for name in sorted(others))
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "unit.c").write_text(source)
        command = [sys.executable, "-m", "ziglang", "cc", "-O1", "-shared", "-fPIC", "unit.c", "-o", "unit.so"]
        subprocess.run(command, cwd=folder, check=True)
        library = Path(folder, "unit.so").read_bytes()
    with zipfile.ZipFile(fmu.path) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            is_binary = name.startswith("binaries/") and not name.endswith("/")
            new.writestr(name, library if is_binary else old.read(name))
    return target


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
    """Expected: one warning for its 10 steps from 0.01 s on, no prints; it is freed, and the temporary folder empty."""
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
