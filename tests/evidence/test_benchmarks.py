"""Benchmarks are run by hand; here, that they still find what they measure."""

import runpy
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from tests.support.interpreter import Interpreter

pytestmark = pytest.mark.evidence
FOLDER = Path(__file__).parents[2] / "benchmarks"
# They compare with engines of the extra `evidence`.
NEEDS = {"run.py": "pinocchio", "peers.py": "mujoco"}


@pytest.mark.parametrize("name", sorted(path.name for path in FOLDER.glob("*.py")))
def test_a_benchmark_can_be_imported(name: str, interpreter: Interpreter, tmp_path: Path) -> None:
    if name in NEEDS and find_spec(NEEDS[name]) is None:
        pytest.skip(f"{NEEDS[name]} is not installed")
    importing = tmp_path / "importing.py"
    importing.write_text(f"import runpy; runpy.run_path({str(FOLDER / name)!r})")
    done = interpreter.script(importing, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_the_timers_in_c_compile(tmp_path: Path) -> None:
    """Expected: programs, of the sources as they are today."""
    for name in ("fmu.py", "coupled.py"):
        folder = tmp_path / name
        folder.mkdir()
        assert runpy.run_path(str(FOLDER / name))["compiled_timer"](folder).is_file()


def test_units_that_stick_and_give_are_timed_in_the_motion_of_the_ideal_one(tmp_path: Path) -> None:
    """Expected: a time each, and ends that fixed steps share with those under error control."""
    cost, errors = runpy.run_path(str(FOLDER / "machine.py"))["microseconds_a_step"](1, tmp_path)
    assert len(cost) == 3
    assert all(0 < each < np.inf for each in cost.values())
    assert max(errors.values()) < 1e-6


def test_a_step_of_the_loop_is_timed_around_that_of_the_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a part of the step is inside of the unit, and not all of it."""
    measured = runpy.run_path(str(FOLDER / "loop.py"))
    monkeypatch.setitem(measured["seconds_a_step"].__globals__, "ROUNDS", 1)
    monkeypatch.setitem(measured["seconds_a_step"].__globals__, "SETTINGS", ["loop.duration=0.3"])
    whole, inside = measured["seconds_a_step"]("3.0")
    assert 0 < inside < whole


def test_many_platforms_are_timed_beside_the_scalar_kernel(tmp_path: Path) -> None:
    """Expected: every row takes some time; the benchmark itself compares what the two kernels compute."""
    measured = runpy.run_path(str(FOLDER / "lanes.py"))["microseconds_a_member"](20, 2, tmp_path)
    assert len(measured) == 7
    assert all(0 < microseconds < np.inf for microseconds in measured.values())
