"""An importer besides FMPy: libcosim (over Modelon's FMI Library), FMI 2.0 Co-Simulation."""

from pathlib import Path

import numpy as np
import pytest

from gough_stewart.fmu_build.build import build
from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.harness.paper.open_loop import run_kernel
from gough_stewart.model.formulations.cases import paper_case

pytestmark = pytest.mark.evidence
libcosimpy = pytest.importorskip("libcosimpy", reason="libcosimpy has no wheel for this machine")


def test_the_papers_case_in_libcosim(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Expected: the kernel under DOP853 at 1e-12; libcosim steps by 10 ms at the unit's default tolerance."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    (path,) = build(tmp_path, fmi=["2.0"])
    case, nanoseconds = paper_case(), 1e9
    execution = CosimExecution.from_step_size(step_size=int(0.01 * nanoseconds))
    index = execution.add_local_slave(CosimLocalSlave(fmu_path=str(path), instance_name="plant"))
    for name, value in {**case.start._asdict(), "actuator_force": case.actuator_force}.items():
        for k, number in enumerate(value):
            assert execution.real_initial_value(index, PLANT.by_name[name].first + k, float(number))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    assert execution.simulate_until(int(case.duration * nanoseconds))
    first = PLANT.by_name["position"].first
    pose = observer.last_real_values(index, list(range(first, first + 6)))
    error = np.abs(np.array(pose) - run_kernel(case).states[-1, :6]).max()
    log = capfd.readouterr()
    print(f"libcosim against kernel: {error:.1e} m, rad")
    assert error <= 1e-9
    # its parser found nothing to complain of
    assert "[error]" not in log.out + log.err
    assert "[warning]" not in log.out + log.err
