"""An importer besides FMPy: libcosim (over Modelon's FMI Library), FMI 2.0 Co-Simulation, plant and controller."""

from pathlib import Path

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart import build
from gough_stewart.fmu_build.build import build_units
from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.fmu_build.plant.plant_component import plant_component
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.export.controller_units import component_of
from gough_stewart.harness.export.design import designed
from gough_stewart.harness.paper.open_loop import run_kernel
from gough_stewart.model.formulations.cases import paper_case
from tests.support.arrays import FloatArray
from tests.support.controllers import SAMPLE_TIME, uneven_experiment
from tests.support.exported_loop import MISTAKEN, exported_loop

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
    assert error <= 1e-7
    # its parser found nothing to complain of
    assert "[error]" not in log.out + log.err
    assert "[warning]" not in log.out + log.err


def test_plant_and_controller_connected_in_libcosim_are_the_loop_in_python(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Expected: the loop in Python with a delay of one sample; libcosim steps both, then hands values on."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    experiment = uneven_experiment(tmp_path, rate_limit=None)
    record, controller = gs.run(experiment), component_of(designed(experiment))
    prepared = prepare(experiment)
    own = plant_component(
        prepared.platform, start=prepared.start, actuator_force=prepared.loop.start_force, is_in_a_system=True
    )
    paths = [build_units(component, tmp_path, fmi=["2.0"])[0] for component in (own, controller)]
    execution = CosimExecution.from_step_size(step_size=round(SAMPLE_TIME * 1e9))
    plant, law = (
        execution.add_local_slave(CosimLocalSlave(fmu_path=str(path), instance_name=name))
        for path, name in zip(paths, ("plant", "law"), strict=True)
    )
    for name, source, of_source, target, of_target in (
        ("leg_length", plant, PLANT, law, controller.layout),
        ("actuator_force", law, controller.layout, plant, PLANT),
    ):
        for a, b in zip(of_source.by_name[name].slots, of_target.by_name[name].slots, strict=True):
            assert execution.connect_real_variables(source, a, target, b) == 0
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    samples = 90  # later ones look ahead beyond the end of the run in Python
    assert execution.simulate_until(round(samples * SAMPLE_TIME * 1e9))
    first = PLANT.by_name["position"].first
    pose = np.array(observer.last_real_values(plant, list(range(first, first + 6))))
    expected = np.concatenate([record["position"][4 * samples], record["orientation"][4 * samples]])
    error = np.abs(pose - expected).max()
    log = capfd.readouterr()
    print(f"libcosim against the loop in Python: {error:.1e} m, rad")
    assert error <= 1e-9
    assert "[error]" not in log.out + log.err
    assert "[warning]" not in log.out + log.err


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
