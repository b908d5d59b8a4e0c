"""Plants by their contract: model, FMI 2.0 and FMI 3.0 give the same, and clean up after themselves."""

import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart import GoughStewartError
from gough_stewart.harness.plants.fmu import FmuPlant
from gough_stewart.harness.plants.isolated import IsolatedFmu
from gough_stewart.harness.plants.open import ModelPlant, open_plant
from gough_stewart.harness.plants.plant import Plant
from tests.support.fmu_plants import Fmu
from tests.support.uneven import INPUTS, STATE, UNEVEN
from tests.support.uneven_loops import experiment_of

KINDS = ("model", "2.0", "3.0")


def plant_of(kind: str, fmus: dict[str, Fmu], *arguments: Any) -> Plant:
    """A plant in this process: of a platform, a start, a tolerance and a fixed step."""
    return ModelPlant(*arguments) if kind == "model" else FmuPlant(fmus[kind].path, *arguments)


@pytest.mark.parametrize("kind", KINDS)
def test_parameters_change_together_or_not_at_all(kind: str, fmus: dict[str, Fmu], paper: gs.Platform) -> None:
    """Expected: rule 3; without gravity and forces nothing accelerates at rest."""

    def rise(plant: Plant) -> float:
        return float(plant.results()[plant.columns.index("acceleration[3]")])

    with plant_of(kind, fmus, paper) as plant:
        plant.set_inputs(np.zeros(12))
        assert rise(plant) < -5
        plant.do_step(0.0, 0.01)
        plant.set_parameters({"gravity": np.zeros(3), "platform_mass": 20.0})
        floating = rise(plant)
        assert abs(floating) < 0.1
        for name, value, reason in (
            ("base_points", np.zeros((6, 3)), "base_points"),
            ("platform_com", [1.0, 2.0], "platform_com"),
            ("platform_inertia", np.diag([1.0, 1.0, 3.0]), "triangle"),
        ):
            with pytest.raises(GoughStewartError, match=reason):
                plant.set_parameters({"platform_mass": 30.0, name: value})
        plant.set_parameters({})
        assert rise(plant) == floating


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_closed_or_refused_plant_leaves_nothing_and_refuses_calls(
    version: str, fmus: dict[str, Fmu], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: rule 8; an error, not a crash of the process; the temporary folder is as empty as before."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    plant = FmuPlant(fmus[version].path, UNEVEN)
    assert len(list(tmp_path.iterdir())) == 1
    plant.close()
    plant.close()
    for call in (plant.results, plant.signals, lambda: plant.set_inputs(np.zeros(12))):
        with pytest.raises(GoughStewartError, match="has been freed"):
            call()
    start = STATE._replace(orientation=np.array([0.0, 2.0, 0.0]))
    with pytest.raises(GoughStewartError, match=r"\.fmu: start values refused: .*orientation"):
        FmuPlant(fmus[version].path, UNEVEN, start)
    assert list(tmp_path.iterdir()) == []


def test_kinds_and_files_that_do_not_fit_are_refused(fmus: dict[str, Fmu]) -> None:
    """Expected: what does not fit to what, with a number or a file."""
    two, three = (fmus[version].path for version in ("2.0", "3.0"))
    for kind, file, text in (
        ("model", three, f"plant 'model' does not accept the file {three}; choose the plant fmu2 or fmu3"),
        ("fmu2", three, f"{three}: is FMI 3.0; expected FMI 2.0 for the plant fmu2"),
        ("fmu3", two, f"{two}: is FMI 2.0; expected FMI 3.0 for the plant fmu3"),
    ):
        with pytest.raises(GoughStewartError, match=re.escape(text)):
            gs.run("heave_step", {"loop.duration": 0.01}, plant=kind, fmu=file)  # type: ignore[arg-type]


@pytest.mark.usefixtures("units_in_process")
@pytest.mark.parametrize("kind", ["model", "fmu2", "fmu3", "file"])
def test_open_plant_hands_on_start_tolerance_and_step(kind: str, fmus: dict[str, Fmu]) -> None:
    """Expected: to the last bit the plants themselves with the same options; a file in a process of its own."""
    version = {"fmu3": "3.0", "model": "model"}.get(kind, "2.0")
    name: Any = "fmu2" if kind == "file" else kind
    fmu, ends = fmus["2.0"].path if kind == "file" else None, set[bytes]()
    for tolerance, step in ((1e-3, 0.0), (1e-9, 0.0), (1e-8, 0.004)):
        opened = open_plant(name, UNEVEN, STATE, tolerance=tolerance, fixed_step_size=step, fmu=fmu)
        with plant_of(version, fmus, UNEVEN, STATE, tolerance, step) as own, opened:
            assert isinstance(opened, IsolatedFmu) == (kind == "file")
            for plant in (own, opened):
                plant.set_inputs(INPUTS.to_vector())
                plant.do_step(0.0, 0.05)
            assert np.array_equal(opened.results(), own.results())
            assert np.array_equal(opened.signals(), own.results()[:24])
            ends.add(own.results().tobytes())
    assert len(ends) == 3


@pytest.mark.parametrize("kind", KINDS)
def test_a_plant_of_one_platform_has_no_members(kind: str, fmus: dict[str, Fmu]) -> None:
    """Expected: no leading axis; actions of members are refused by the name of the plant."""
    with plant_of(kind, fmus, UNEVEN, STATE) as plant:
        assert plant.shape == ()
        assert plant.results().shape == (50,)
        name, member = type(plant).__name__, np.array([True])
        text = f"^{name} is a plant of one platform; expected a plant of many platforms for member actions$"
        with pytest.raises(GoughStewartError, match=text):
            plant.freeze(member)
        with pytest.raises(GoughStewartError, match=text):
            plant.set_parameters_of(member, {"platform_mass": 3.0})


STEEL = {
    **{"leg_friction_model": "elasto_plastic", "leg_coulomb_friction": 12.0, "leg_static_friction": 17.0},
    **{"leg_bristle_stiffness": 1.7e6, "leg_stiffness": 2.3e6, "leg_armature": 3.1, "platform_mass": 14.5},
}


def loop(parameters: dict[str, Any], varied: dict[str, Any]) -> gs.Experiment:
    """A loop on a machine that changes, is pushed and varies."""
    return experiment_of(
        "pid",
        plant={"parameters": parameters, "tolerance": 1e-9},
        reference={"type": "sine", "frequency": "4 Hz", "position_amplitude": ["8 mm", "-5 mm", "6 mm"]},
        sensors={"side": "motor" if parameters else "leg", "quantisation": {"leg_length": 0.0}},
        loop={"duration": 0.06, "sample_time": "4 ms", "plant_step": "2 ms", "delay": 1},
        disturbance=[{"at": 0.02, "duration": 0.02, "force": ["180 N", "-90 N", "120 N"]}],
        change=[{"at": 0.032, "factors": {"platform_mass": 1.3, "leg_coulomb_friction": 0.9}}],
        ensemble={"tolerance": 1e-8, "platform_mass": {"factor": {"uniform": [0.9, 1.2]}}, **varied},
    )


@pytest.mark.parametrize("member", [None, 3])
@pytest.mark.parametrize(("parameters", "bound"), [({}, 1e-7), (STEEL, 2e-6)], ids=["ideal", "sticks and gives"])
def test_kinds_of_plants_give_the_same_run(parameters: dict[str, Any], bound: float, member: int | None) -> None:
    """Expected: the units, other integrations of the same platform, within the tolerances of both."""
    varied = {"leg_static_friction": {"uniform": [14.0, 20.0]}} if parameters else {}
    experiment = loop(parameters, varied)
    model = gs.run(experiment, member=member)
    for kind in ("fmu3",) if parameters else ("scipy", "fmu2", "fmu3"):
        other = gs.run(experiment, {"plant.kind": kind}, member=member)
        assert other.metadata["outcome"]["status"] == "completed"
        for name in ("position", "orientation", "velocity", "leg_length", "leg_velocity", "actuator_force"):
            gap, scale = np.abs(other[name] - model[name]).max(), 1 + np.abs(model[name]).max()
            assert gap < (bound if name in ("position", "orientation") else 100 * bound * scale), (kind, name)
        if parameters:
            assert np.abs(other["leg_bristle"] - model["leg_bristle"]).max() < 1e-8
            assert np.abs(other["motor_position"] - other["leg_length"]).max() > 1e-6


def test_an_ensemble_of_machines_names_members_of_another_kind() -> None:
    """Expected: all complete; a stiffness of 0 makes legs rigid, which no member may be alone."""
    rows = gs.ensemble(loop(STEEL, {"leg_stiffness": {"factor": {"uniform": [0.7, 1.3]}}}), members=8).members
    assert rows["outcome"].to_list() == ["completed"] * 8
    assert int(rows["internal_steps"].to_numpy().min()) > 30
    assert rows["tracking.position.norm_peak"].n_unique() == 8
    rows = gs.ensemble(loop(STEEL, {"leg_stiffness": {"choice": [2.0e6, 0.0]}}), members=8).members
    assert set(rows["outcome"].to_list()) == {"completed", "impossible"}
