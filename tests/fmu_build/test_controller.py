"""A controller's unit at its edges: a long delay, no limit, terminals; tests/harness/export has its law and samples."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.fmu_plants import DISCARD, Fmu, plant
from tests.support.lagrangian import FloatArray
from tests.support.schemas import complaints_of_schemas
from tests.support.uneven import UNEVEN
from tests.support.uneven_loops import POSE, experiment_of

T, LIMIT = 4e-3, 300.0
LENGTHS = gs.leg_geometry(UNEVEN, POSE[:3], POSE[3:]).length
ROWS = LENGTHS + 0.05 * np.random.default_rng(1).normal(size=(20, 6))


def loop(delay: int) -> gs.Experiment:
    return experiment_of(
        "pid",
        title="a <loop> & more",
        loop={"duration": 0.74, "sample_time": T, "delay": delay},
        actuators={"force_limit": LIMIT},
    )


@pytest.fixture(scope="module")
def prompt(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fmu]:
    """By FMI version: units whose forces come out a sample later."""
    paths = gs.export(loop(1), forms="fmu", out=tmp_path_factory.mktemp("prompt"), allow_unstable=True)
    return {unit.version: unit for unit in map(Fmu, paths)}


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    """Of a system whose loop has a delay of 15 samples; described in scalars, for importers without arrays."""
    folder = tmp_path_factory.mktemp("late")
    (path,) = gs.export(loop(15), forms="ssp", ssp_fmi="3.0", out=folder, allow_unstable=True)
    with zipfile.ZipFile(path) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("controller.fmu"))
        return Fmu(Path(archive.extract(name, folder)))


def test_forces_wait_for_the_delay_of_the_loop_however_long(prompt: dict[str, Fmu], late: Fmu) -> None:
    """Expected: start forces for 14 samples, then those of the prompt units; a delay of 16 is refused."""

    def forces_and_flags(unit: Fmu) -> FloatArray:
        outputs = []
        with plant(unit) as p:
            p.initialise(time=0.5)
            for k, lengths in enumerate(ROWS):
                p.set("leg_length", lengths)
                p.do_step(0.5 + k * T, T)
                outputs.append(p.get_all(["actuator_force", "force_limited"]))
        return np.array(outputs)

    first, found = forces_and_flags(prompt["2.0"]), forces_and_flags(late)
    np.testing.assert_array_equal(forces_and_flags(prompt["3.0"]), first)
    assert 0.2 < first[:, 6:].mean() < 0.8
    np.testing.assert_array_equal(np.abs(first[:, :6]) == LIMIT, first[:, 6:] == 1)
    np.testing.assert_array_equal(found[14:], first[:6])
    with plant(late) as p:
        np.testing.assert_array_equal(found[:14], np.tile([*p.get("start_force"), *np.zeros(6)], (14, 1)))
        assert p.get("output_delay") == 15
        p.refuses("expected a whole number of samples from 1 to 15", DISCARD, p.set, "output_delay", 16.0)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_no_limit_is_0_in_the_unit_and_none_in_the_c(prompt: dict[str, Fmu], version: str) -> None:
    """Expected: forces beyond the limit, which cuts them where it is on; no limit below 0, and no such gain."""
    forces = []
    for limit in (LIMIT, 0.0):
        with plant(prompt[version]) as p:
            p.set("force_limit", limit)
            p.initialise()
            p.set("leg_length", ROWS[0] - 0.5)
            p.do_step(0.0, T)
            forces.append(p.get("actuator_force"))
            assert p.get("force_limit") == limit
    cut, free = forces
    np.testing.assert_array_equal(cut, np.clip(free, -LIMIT, LIMIT))
    assert np.abs(free).max() > 2 * LIMIT
    with plant(prompt[version]) as p:
        for name in ("force_limit", "force_rate_limit"):
            unit = "N/s" if "rate" in name else "N"
            p.refuses(f"{name} = -1 {unit} rejected; expected a value >= 0", DISCARD, p.set, name, -1.0)


def test_the_description_names_the_loop_and_offers_no_model_exchange(prompt: dict[str, Fmu]) -> None:
    for version, unit in prompt.items():
        description, first = unit.description, "[1]" if version == "2.0" else ""
        experiment, found = description.defaultExperiment, {v.name: v for v in description.modelVariables}
        assert [float(getattr(experiment, name)) for name in ("startTime", "stopTime", "stepSize")] == [0.0, 0.74, T]
        assert (description.modelName, description.modelExchange) == ("GoughStewartController", None)
        assert description.coSimulation.modelIdentifier == "gough_stewart_controller"
        assert description.description.startswith("Controller of a Gough–Stewart platform: ")
        assert "a <loop> & more" in description.description
        assert found["force_limit"].description.endswith("; 0: no limit")
        assert (found["force_rate_limit"].unit, float(found["force_rate_limit"].start)) == ("N/s", 0.0)
        gain = found[f"proportional_gain{first}"]
        assert (gain.causality, gain.variability, gain.unit) == ("parameter", "tunable", "N/m")
        assert complaints_of_schemas(unit) == {}
