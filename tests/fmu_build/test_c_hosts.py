"""The unit in hosts written in C: random calls under a sanitizer, instances in threads. Longer in tests/evidence."""

import sys
from pathlib import Path

import pytest

import gough_stewart as gs
from tests.support.c_hosts import (
    FUZZ,
    INSTANCES,
    NEVER_OK,
    ZIG,
    compile_built,
    functions_of_the_standards,
    fuzz,
    run_instances,
)

# undefined behaviour ends the program at once; both hosts are made of the same compilation of the unit
COMPILER = (*ZIG, "-O0", "-fsanitize=undefined", "-fsanitize-trap=undefined")


@pytest.fixture(scope="session")
def archives(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The paper's units, in the folder in which the programs are made."""
    return gs.build(tmp_path_factory.mktemp("hosts"))


@pytest.mark.evidence
def test_no_sequence_of_calls_breaks_the_contract(archives: list[Path]) -> None:
    """Expected: what tests/support/hosts/fuzz_contract.c checks after every call, from the standards and instance.h.

    Every function of the standards' headers is called; all that this unit offers succeed somewhere.
    """
    calls = fuzz(compile_built(FUZZ, archives[0].parent / "fuzz", COMPILER, archives), 1500)
    assert set(calls) == functions_of_the_standards()
    assert {function for function, n in calls.items() if n["ok"] == 0} == NEVER_OK


@pytest.mark.skipif(sys.platform != "linux", reason="memory is measured by glibc's mallinfo2")
def test_instances_in_threads_have_the_bits_of_instances_in_turn(archives: list[Path]) -> None:
    """Expected: the same unit, stepped in another order. At most 16 KiB for an instance."""
    result = run_instances(compile_built(INSTANCES, archives[0].parent / "instances", COMPILER, archives), 100, 8)
    assert result["bytes_per_instance"] <= 16 * 1024
