"""Plants by their contract: model, FMI 2.0 and FMI 3.0 give the same, and clean up after themselves."""

import re
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from unittest import mock
from zipfile import ZipFile

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart import GoughStewartError, Platform, State, StepError, load_preset
from gough_stewart.harness.plants.fmu import FmuPlant
from gough_stewart.harness.plants.isolated import IsolatedFmu
from gough_stewart.harness.plants.model import ModelPlant
from gough_stewart.harness.plants.open import open_plant
from gough_stewart.harness.plants.plant import Plant
from gough_stewart.harness.plants.unit import FmuInstance, UnitFile
from gough_stewart.model import interface
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.fmu_plants import Fmu
from tests.support.uneven import INPUTS, STATE, UNEVEN
from tests.support.uneven_loops import experiment_of

Open = Callable[[Platform, State | None], Plant]
KINDS = ("model", "2.0", "3.0")


@pytest.fixture(params=KINDS)
def open_one(request: pytest.FixtureRequest, fmus: dict[str, Fmu]) -> Open:
    """Each kind of plant, one after the other."""
    return opener(request.param, fmus)


def opener(kind: str, fmus: dict[str, Fmu]) -> Open:
    if kind == "model":
        return ModelPlant

    def open_fmu(platform: Platform, start: State | None = None) -> Plant:
        return FmuPlant(fmus[kind].path, platform, start)

    return open_fmu


def test_inputs_and_results_mean_what_the_interface_says(open_one: Open) -> None:
    """Expected: Newton and Euler's accelerations and joint forces under the forces, then the wrench, of the vector."""
    force, wrench, torque = INPUTS
    with open_one(UNEVEN, STATE) as plant:
        plant.set_inputs(np.concatenate([force, wrench, torque]))
        found = interface.unpack(interface.RESULTS, plant.results())
    R = matrix_from_orientation(STATE.orientation)
    expected = newton_euler.solve(
        UNEVEN, STATE.position, R, STATE.velocity, STATE.angular_velocity, force, wrench, torque
    )
    assert found["acceleration"] == pytest.approx(expected.linear, rel=1e-9)
    assert found["angular_acceleration"] == pytest.approx(expected.angular, rel=1e-9)
    assert found["joint_force"] == pytest.approx(expected.joint_force, rel=1e-8, abs=1e-8)
    assert np.concatenate([found[name] for name in State._fields]) == pytest.approx(STATE.to_vector(), abs=0)
    legs = STATE.position + UNEVEN.platform_points @ R.T - UNEVEN.base_points
    assert found["leg_length"] == pytest.approx(np.linalg.norm(legs, axis=1), rel=1e-12)


def test_a_failed_step_leaves_the_plant_as_it_was(open_one: Open, paper: Platform) -> None:
    """Expected: rule 6; 1e5 N turn the paper's platform through its singular pose within a second."""
    with open_one(paper, None) as plant:
        plant.set_inputs(np.append(np.tile([1e4, -1e4], 3), np.zeros(6)))
        before = plant.results()
        with pytest.raises(StepError) as caught:
            plant.do_step(0.0, 1.0)
        assert (plant.results() == before).all()
    assert "singular" in str(caught.value) or "90°" in str(caught.value) or "collapsed" in str(caught.value)


def test_parameters_change_together_or_not_at_all(open_one: Open, paper: Platform) -> None:
    """Expected: rule 3; without gravity and forces nothing accelerates at rest."""
    with open_one(paper, None) as plant:
        plant.set_inputs(np.zeros(12))
        at_rest = interface.unpack(interface.RESULTS, plant.results())["acceleration"]
        plant.do_step(0.0, 0.01)
        plant.set_parameters({"gravity": np.zeros(3), "platform_mass": 20.0})
        floating = interface.unpack(interface.RESULTS, plant.results())["acceleration"]
        with pytest.raises(GoughStewartError, match="base_points"):
            plant.set_parameters({"platform_mass": 30.0, "base_points": np.zeros((6, 3))})
        with pytest.raises(GoughStewartError, match="platform_com"):
            plant.set_parameters({"platform_mass": 30.0, "platform_com": [1.0, 2.0]})
        assert (interface.unpack(interface.RESULTS, plant.results())["acceleration"] == floating).all()
    assert at_rest[2] < -5
    assert abs(floating[2]) < 0.1


def test_an_inertia_that_no_body_has_is_refused_at_once_and_changes_nothing(open_one: Open) -> None:
    """Expected: rule 3, and rule 6 of a step under the old payload; no parameters at all are none."""
    with open_one(UNEVEN, None) as plant, open_one(UNEVEN, None) as other:
        with pytest.raises(GoughStewartError, match="triangle"):
            plant.set_parameters({"platform_mass": 30.0, "platform_inertia": np.diag([1.0, 1.0, 3.0])})
        plant.set_parameters({})
        for each in (plant, other):
            each.set_inputs(1.1 * np.append(UNEVEN.home_actuator_force, np.zeros(6)))
            each.do_step(0.0, 0.01)
        assert (plant.results() == other.results()).all()
        plant.set_parameters({"platform_inertia": np.diag([1.0, 1.0, 1.5])})
        with pytest.raises(GoughStewartError, match="triangle"):
            plant.set_parameters({"platform_inertia": np.diag([1.0, 2.0, 3.1])})
        plant.do_step(0.01, 0.01)


@pytest.mark.skipif(sys.platform != "linux", reason="mapped files are read from /proc")
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_closed_file_keeps_no_library_also_after_a_failed_instance(
    version: str, fmus: dict[str, Fmu], tmp_path: Path
) -> None:
    """Expected: no file of the unit's folder is mapped into this process afterwards."""
    with zipfile.ZipFile(fmus[version].path) as old, zipfile.ZipFile(tmp_path / "other.fmu", "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "modelDescription.xml":
                content = re.sub(rb'((?:guid|instantiationToken)="\{?)', rb"\1x", content)
            new.writestr(name, content)
    with UnitFile(fmus[version].path) as file, FmuInstance(file):
        assert str(file.folder) in Path("/proc/self/maps").read_text()
    with UnitFile(tmp_path / "other.fmu") as other, pytest.raises(GoughStewartError, match="wrong token"):
        FmuInstance(other)
    for closed in (file, other):
        assert str(closed.folder) not in Path("/proc/self/maps").read_text()


def test_closing_twice_is_fine_and_leaves_nothing(
    fmus: dict[str, Fmu], paper: Platform, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: rule 8; the temporary folder is as empty as before."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    plant = FmuPlant(fmus["3.0"].path, paper)
    assert len(list(tmp_path.iterdir())) == 1
    plant.close()
    plant.close()
    assert list(tmp_path.iterdir()) == []


def test_a_refused_start_leaves_nothing(
    fmus: dict[str, Fmu], paper: Platform, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: an error with the unit's words (a pitch beyond 90°), and no folder."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    start = State(paper.home_position, np.array([0.0, 2.0, 0.0]), np.zeros(3), np.zeros(3))
    with pytest.raises(GoughStewartError, match=r"\.fmu: start values refused: .*orientation"):
        FmuPlant(fmus["2.0"].path, paper, start)
    assert list(tmp_path.iterdir()) == []


def test_open_plant_builds_what_is_not_given_and_keeps_it(
    paper: Platform, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the first time progress is told and the cache has a file, the second time neither more."""
    monkeypatch.setattr("gough_stewart.fmu_build.cached.cache_folder", lambda: tmp_path)
    for count in (1, 0):
        told: list[str] = []
        with open_plant("fmu3", paper, progress=told.append) as plant:
            plant.do_step(0.0, 0.01)
        assert sum("FMI 3.0: sources" in text for text in told) == count
    names = ["gough_stewart_fmi3.fmu", "gough_stewart_fmi3.fmu.sha256"]
    assert sorted(file.name for file in tmp_path.rglob("*") if file.is_file()) == names


def test_runs_that_follow_each_other_unpack_the_unit_once(
    fmus: dict[str, Fmu], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Expected: one extraction for three plants, the second from another start, each as if it were the first."""
    unit = shutil.copy(fmus["3.0"].path, tmp_path)
    extract = mock.create_autospec(ZipFile.extractall, side_effect=ZipFile.extractall)
    monkeypatch.setattr(ZipFile, "extractall", extract)
    monkeypatch.setattr("gough_stewart.harness.plants.open.cached_build", lambda *_: unit)
    platform = load_preset("liu2000")
    moved = State(platform.home_position + 0.1, platform.home_orientation, np.ones(3), np.zeros(3))
    ends = []
    for start in (None, moved, None):
        with open_plant("fmu3", platform, start) as plant:
            plant.do_step(0.0, 0.01)
            ends.append(plant.results())
    assert extract.call_count == 1
    assert (ends[0] == ends[2]).all()
    assert (ends[0] != ends[1]).any()


def test_open_plant_refuses_in_whole_sentences(fmus: dict[str, Fmu]) -> None:
    """Expected: what does not fit to what, with a number or a file."""
    path = fmus["3.0"].path
    for kind, options, text in (
        ("model", {"fmu": path}, f"plant 'model' does not accept the file {path}; choose the plant fmu2 or fmu3"),
        ("fmu2", {"fmu": path}, f"{path}: is FMI 3.0; expected FMI 2.0 for the plant fmu2"),
        ("fmu3", {"fmu": fmus["2.0"].path}, f"{fmus['2.0'].path}: is FMI 2.0; expected FMI 3.0 for the plant fmu3"),
        ("fmu", {}, "plant is 'fmu'; expected one of model, scipy, fmu2, fmu3"),
    ):
        with pytest.raises(GoughStewartError) as caught, open_plant(kind, UNEVEN, **options):  # type: ignore[arg-type]
            pass
        assert str(caught.value).startswith(text)


@pytest.mark.usefixtures("units_in_process")
@pytest.mark.parametrize("kind", ["model", "fmu2", "fmu3", "file"])
def test_open_plant_hands_on_start_tolerance_and_step(kind: str, fmus: dict[str, Fmu]) -> None:
    """Expected: to the last bit the plants themselves with the same options; a file in a process of its own."""
    version = {"fmu2": "2.0", "fmu3": "3.0", "file": "2.0"}.get(kind)
    ends = []
    for tolerance, step in ((1e-3, 0.0), (1e-9, 0.0), (1e-8, 0.004)):
        if version is None:
            own: Plant = ModelPlant(UNEVEN, STATE, tolerance, step)
        else:
            own = FmuPlant(fmus[version].path, UNEVEN, STATE, tolerance, step)
        fmu = fmus["2.0"].path if kind == "file" else None
        name = "fmu2" if kind == "file" else kind
        options = {"tolerance": tolerance, "fixed_step_size": step, "fmu": fmu}
        with own, open_plant(name, UNEVEN, STATE, **options) as opened:  # type: ignore[arg-type]
            assert isinstance(opened, IsolatedFmu) == (kind == "file")
            for plant in (own, opened):
                plant.set_inputs(INPUTS.to_vector())
                plant.do_step(0.0, 0.05)
            assert np.array_equal(opened.results(), own.results())
            assert np.array_equal(opened.signals(), own.results()[:24])
            ends.append(own.results().tobytes())
    assert len(set(ends)) == len(ends)


def test_a_plant_of_one_platform_has_no_members(open_one: Open) -> None:
    """Expected: no leading axis; actions of members are refused by the name of the plant."""
    with open_one(UNEVEN, STATE) as plant:
        assert plant.shape == ()
        assert plant.results().shape == (50,)
        assert plant.signals().tolist() == plant.results()[:24].tolist()
        name = type(plant).__name__
        text = f"^{name} is a plant of one platform; expected a plant of many platforms for member actions$"
        with pytest.raises(GoughStewartError, match=text):
            plant.freeze(np.array([True]))
        with pytest.raises(GoughStewartError, match=text):
            plant.set_parameters_of(np.array([True]), {"platform_mass": 3.0})


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_plant_that_is_closed_refuses_calls(version: str, fmus: dict[str, Fmu]) -> None:
    """Expected: an error, not a crash of the process, since the library works on freed memory."""
    plant = FmuPlant(fmus[version].path, UNEVEN)
    plant.close()
    for call in (plant.results, plant.signals, lambda: plant.set_inputs(np.zeros(12))):
        with pytest.raises(GoughStewartError, match="has been freed"):
            call()


def test_kinds_of_plants_give_the_same_run() -> None:
    """Expected: poses within 1e-7 and all signals in proportion; of a machine that changes, is pushed and varies."""
    experiment = experiment_of(
        "pid",
        reference={"type": "sine", "frequency": "4 Hz", "position_amplitude": ["8 mm", "-5 mm", "6 mm"]},
        loop={"duration": 0.1, "sample_time": "4 ms", "plant_step": "2 ms", "delay": 1},
        sensors={"quantisation": {"leg_length": 0.0}},
        disturbance=[{"at": 0.02, "duration": 0.04, "force": ["80 N", "-90 N", "120 N"]}],
        change=[{"at": 0.05, "factors": {"platform_mass": 1.3}}],
        ensemble={"platform_mass": {"factor": {"uniform": [0.9, 1.2]}}},
    )
    for member in (None, 3):
        model, *units = (gs.run(experiment, {"plant.kind": kind}, member=member) for kind in ("model", "fmu2", "fmu3"))
        for unit in units:
            for name in ("position", "orientation", "velocity", "leg_length", "leg_velocity", "actuator_force"):
                gap, scale = np.abs(unit[name] - model[name]).max(), 1 + np.abs(model[name]).max()
                assert gap < (1e-7 if name == "position" else 1e-5 * scale), name
