"""Importers besides FMPy: libcosim (over Modelon's FMI Library) and Ecos run plant and controller as SSP."""

from pathlib import Path

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.exported_loop import MISTAKEN, exported_loop

pytestmark = pytest.mark.evidence
libcosimpy = pytest.importorskip("libcosimpy", reason="libcosimpy has no wheel for this machine")


@pytest.fixture(scope="module", params=[1, 3])
def delay(request: pytest.FixtureRequest) -> int:
    """Of the loop [samples]."""
    return int(request.param)


@pytest.fixture(scope="module")
def ssp(delay: int, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported_loop(tmp_path_factory.mktemp("ssp"), {**MISTAKEN, "loop.delay": delay})


def lengths_expected(delay: int) -> FloatArray:
    """Of the harness, on its own model of the plant."""
    found: FloatArray = gs.run("heave_step", {**MISTAKEN, "loop.delay": delay})["leg_length"]
    return found


def test_the_exported_loop_in_libcosim(ssp: Path, delay: int, capfd: pytest.CaptureFixture[str]) -> None:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    # the step is that of the archive
    execution = CosimExecution.from_ssp_file(ssp_path=str(ssp))
    index = {info.name.decode(): info.index for info in execution.slave_infos()}["plant"]
    references = {v.name.decode(): v.reference for v in execution.slave_variables(index)}
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    expected, rows = lengths_expected(delay), []
    for _ in range(len(expected) - 1):
        execution.step(1)
        rows.append(observer.last_real_values(index, [references[f"leg_length[{k}]"] for k in range(1, 7)]))
    error = np.abs(np.array(rows) - expected[1:]).max()
    log = capfd.readouterr()
    print(f"the exported loop with a delay of {delay}, libcosim against the harness: {error:.1e} m")
    assert error <= 1e-9
    assert "[error]" not in log.out + log.err
    assert "[warning]" not in log.out + log.err


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_the_exported_loop_in_ecos(version: str, delay: int, tmp_path: Path) -> None:
    try:
        from ecospy.EcosSimulation import EcosSimulation
    except (ImportError, OSError) as missing:
        pytest.skip(f"Ecos does not load here: {missing}")
    (ssp,) = gs.export("heave_step", {**MISTAKEN, "loop.delay": delay}, forms="ssp", ssp_fmi=version, out=tmp_path)
    expected = lengths_expected(delay)
    simulation = EcosSimulation(MISTAKEN["loop.sample_time"], ssp_path=str(ssp))
    simulation.init()
    rows = []
    for _ in range(len(expected)):
        rows.append([simulation.get_real(f"plant::leg_length[{k}]") for k in range(1, 7)])
        simulation.step()
    error = np.abs(np.array(rows) - expected).max()
    print(f"the exported loop with a delay of {delay}, FMI {version}, Ecos against the harness: {error:.1e} m")
    assert error <= 1e-9
