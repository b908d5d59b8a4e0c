"""Benchmarks are run by hand; here, that they can be imported, and that their programs in C compile."""

import runpy
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

pytestmark = pytest.mark.evidence
FOLDER = Path(__file__).parents[2] / "benchmarks"
# They compare with engines of the extra `evidence`.
NEEDS = {"run.py": "pinocchio", "peers.py": "mujoco"}


@pytest.mark.parametrize("name", sorted(path.name for path in FOLDER.glob("*.py")))
def test_a_benchmark_can_be_imported(name: str, tmp_path: Path) -> None:
    if name in NEEDS and find_spec(NEEDS[name]) is None:
        pytest.skip(f"{NEEDS[name]} is not installed")
    importing = f"import runpy; runpy.run_path({str(FOLDER / name)!r})"
    subprocess.run([sys.executable, "-c", importing], cwd=tmp_path, check=True)


@pytest.mark.parametrize("name", ["fmu.py", "coupled.py"])
def test_the_timers_in_c_compile(name: str, tmp_path: Path) -> None:
    assert runpy.run_path(str(FOLDER / name))["compiled_timer"](tmp_path).is_file()
