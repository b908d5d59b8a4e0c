"""Importers besides FMPy: libcosim (over Modelon's FMI Library) and Ecos run an SSP."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.exported_loop import MISTAKEN, exported_loop

pytestmark = pytest.mark.evidence


@pytest.fixture(params=[1, 3])
def delayed(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Settings of the exported loop with a delay [samples]."""
    return {**MISTAKEN, "loop.delay": request.param}


def test_the_exported_loop_in_libcosim(
    delayed: dict[str, Any], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Expected: the harness, on its own model of the plant; the step is that of the archive."""
    pytest.importorskip("libcosimpy", reason="libcosimpy has no wheel for this machine")
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    execution = CosimExecution.from_ssp_file(ssp_path=str(exported_loop(tmp_path, delayed)))
    index = {info.name.decode(): info.index for info in execution.slave_infos()}["plant"]
    references = {v.name.decode(): v.reference for v in execution.slave_variables(index)}
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    expected, rows = gs.run("heave_step", delayed)["leg_length"], []
    for _ in range(len(expected) - 1):
        execution.step(1)
        rows.append(observer.last_real_values(index, [references[f"leg_length[{k}]"] for k in range(1, 7)]))
    error = np.abs(np.array(rows) - expected[1:]).max()
    log = capfd.readouterr()
    print(f"the exported loop with a delay of {delayed['loop.delay']}, libcosim against the harness: {error:.1e} m")
    assert error <= 1e-9
    assert "[error]" not in log.out + log.err
    assert "[warning]" not in log.out + log.err


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_the_exported_loop_in_ecos(version: str, delayed: dict[str, Any], tmp_path: Path) -> None:
    """Expected: the harness, on its own model of the plant."""
    try:
        from ecospy.EcosSimulation import EcosSimulation
    except (ImportError, OSError) as missing:
        pytest.skip(f"Ecos does not load here: {missing}")
    (ssp,) = gs.export("heave_step", delayed, forms="ssp", ssp_fmi=version, out=tmp_path)
    simulation = EcosSimulation(MISTAKEN["loop.sample_time"], ssp_path=str(ssp))
    simulation.init()
    for expected in gs.run("heave_step", delayed)["leg_length"]:
        found = [simulation.get_real(f"plant::leg_length[{k}]") for k in range(1, 7)]
        assert np.abs(found - expected).max() <= 1e-9
        simulation.step()
