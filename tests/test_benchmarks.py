"""Benchmarks are run by hand; here, that they still find what they measure."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.support.interpreter import Interpreter

FOLDER = Path(__file__).parents[1] / "benchmarks"
# They compare with engines of the extra `evidence`.
NEEDS = {"run.py": "pinocchio"}


@pytest.mark.parametrize("name", sorted(path.name for path in FOLDER.glob("*.py")))
def test_a_benchmark_can_be_imported(name: str, interpreter: Interpreter, tmp_path: Path) -> None:
    if name in NEEDS and find_spec(NEEDS[name]) is None:
        pytest.skip(f"{NEEDS[name]} is not installed")
    importing = tmp_path / "importing.py"
    importing.write_text(f"import runpy; runpy.run_path({str(FOLDER / name)!r})")
    done = interpreter.script(importing, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
