"""Experiment files in other folders: each file that they name stays the same file, and each value reads back."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart.harness.control.controllers import ControllerChoice
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.file import (
    digests,
    experiment_from,
    load_experiment,
    names_from,
    text_with_settings,
)
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.schema import Experiment, PlantChoice, PlatformChoice
from gough_stewart.harness.motion.references import ReferenceChoice
from gough_stewart.harness.section import Section, file_names, kinds

BASE: dict[str, Any] = {"title": "x", "controller": {"type": "pd", "bandwidth": 2}, "loop": {"duration": 1}}
# Tables that name a file, one for each key.
NAMING: dict[str, dict[str, Any]] = {
    "platform.file": {"platform": {"file": "NAME"}},
    "plant.file": {"plant": {"file": "NAME"}},
    "plant.fmu": {"plant": {"kind": "fmu3", "fmu": "NAME"}},
    "controller.file, python": {"controller": {"type": "python", "file": "NAME"}},
    "controller.file, fmu": {"controller": {"type": "fmu", "file": "NAME"}},
    "reference.file, file": {"reference": {"type": "file", "file": "NAME"}},
    "reference.file, path": {"reference": {"type": "path", "file": "NAME", "timing": 1}},
}


def experiment_naming(key: str, name: str, folder: Path) -> Experiment:
    (table, (section, values)) = key, next(iter(NAMING[key].items()))
    named = {k: name if v == "NAME" else v for k, v in values.items()}
    return experiment_from({**BASE, section: named}, table).from_file(table, folder)


def test_every_key_of_a_file_is_known_as_one() -> None:
    """Expected: the keys called file or fmu, by their names, in all tables, motions and controllers."""
    tables: list[type[Section]] = [PlatformChoice, PlantChoice]
    tables += [*kinds(ControllerChoice).values(), *kinds(ReferenceChoice).values()]
    expected = {(table.__name__, key) for table in tables for key in ("file", "fmu") if key in table.model_fields}
    known = set()
    for key in NAMING:
        experiment = experiment_naming(key, "some", Path())
        ((section, *rest),) = file_names(experiment)
        known.add((type(getattr(experiment, section)).__name__, *rest))
    assert known == expected


@pytest.mark.parametrize("key", NAMING)
@pytest.mark.parametrize("name", ["own.csv", "a/../own.csv", "../mine/own.csv", "./a/own.csv"])
def test_a_named_file_is_the_same_one_from_any_folder(tmp_path: Path, key: str, name: str) -> None:
    """Expected: what the operating system opens under both names; from a link, .. leads elsewhere."""
    mine, far = tmp_path / "mine", tmp_path / "far" / "away"
    (mine / "a").mkdir(parents=True)
    far.mkdir(parents=True)
    for file in (mine / "own.csv", mine / "a" / "own.csv"):
        file.write_text(str(file))
    (tmp_path / "link").symlink_to(far)
    experiment = experiment_naming(key, name, mine)
    expected = (mine / name).read_text()
    for folder in (mine, mine / "results" / "new", far, tmp_path / "link", tmp_path / "link" / "new"):
        folder.mkdir(exist_ok=True, parents=True)
        (found,) = names_from(experiment, folder).values()
        assert (folder / found).read_text() == expected
    (absolute,) = names_from(experiment_naming(key, str(mine / "own.csv"), mine), far).values()
    assert absolute == str(mine / "own.csv")
    assert digests(experiment).keys() == {name}


def test_a_shipped_recording_keeps_its_name(tmp_path: Path) -> None:
    """Expected: the motion of the shipped file, from the new text; the folder's own file of that name is not read."""
    text = text_with_settings("recorded_ride", {"loop.duration": 0.1}, folder=tmp_path)
    (tmp_path / "x.toml").write_text(text)
    moved, shipped = load_experiment(tmp_path / "x.toml"), load_experiment("recorded_ride", {"loop.duration": 0.1})
    motion, expected = prepare(moved).motion, prepare(shipped).motion
    assert motion is not None
    assert expected is not None
    assert np.array_equal(motion.position, expected.position)
    (tmp_path / "ride.csv").write_text("time\n0\n")
    with pytest.raises(ExperimentError, match=r"reference\.file.*has a file of this name"):
        text_with_settings("recorded_ride", folder=tmp_path)


def test_parameters_of_platforms_may_have_units() -> None:
    """Expected: the conversions written out here; numbers without unit are SI."""
    change = {"at": 0.1, "parameters": {"platform_mass": "1.1 t"}}
    parameters = {"platform_mass": "900 kg", "platform_com": ["10 mm", 0, "2 cm"], "leg_length_max": "3000 mm"}
    plant = {"leg_coulomb_friction": ["0.5 kN", 400, 300, 300, 300, 300], "gravity": [0, 0, "-9.8 m/s2"]}
    experiment = experiment_from(
        {**BASE, "platform": {"parameters": parameters}, "plant": {"parameters": plant}, "change": [change]}
    )
    assert experiment.platform.parameters == {
        "platform_mass": 900,
        "platform_com": pytest.approx([0.01, 0, 0.02], rel=1e-15),
        "leg_length_max": 3,
    }
    assert experiment.plant.parameters["leg_coulomb_friction"] == [500, 400, 300, 300, 300, 300]
    assert experiment.plant.parameters["gravity"] == [0, 0, -9.8]
    assert experiment.change[0].parameters["platform_mass"] == pytest.approx(1100, rel=1e-15)
    with pytest.raises(ExperimentError, match=r"plant\.parameters.*platform_mass is '12 mm'.*found the unit 'mm'"):
        experiment_from({**BASE, "plant": {"parameters": {"platform_mass": "12 mm"}}})
    arrays = experiment_from({**BASE, "platform": {"parameters": {"platform_com": np.array([0.0, 0.1, 0.2])}}})
    assert arrays.model_dump(mode="json")["platform"]["parameters"]["platform_com"] == [0, 0.1, 0.2]


@pytest.mark.parametrize(
    "text",
    [
        # tables in parts, dotted keys, and tables in one line
        'title="x"\n[loop]\nduration=1\n[controller]\ntype="pd"\nbandwidth=2\n[platform]\n[plant.parameters]\n',
        'title="x"\nloop.duration=1\ncontroller.type="pd"\ncontroller.bandwidth=2\nplatform.preset="liu2000"\n',
        'title="x"\nloop={duration=1}\ncontroller={type="pd",bandwidth=2}\nplatform={parameters={platform_mass=3}}\n',
        'controller.type="pd"\ntitle="x"\nloop.duration=1\ncontroller.bandwidth=2\nplatform.parameters={}\n',
        '[platform.parameters]\n[loop]\nduration=1\n[platform]\npreset="liu2000"\n[controller]\ntype="pd"\nbandwidth=2\n',
    ],
)
def test_every_layout_of_a_file_takes_new_keys(tmp_path: Path, text: str) -> None:
    """Expected: the parsed text with these values."""
    if "title" not in text:
        text = 'title="x"\n' + text
    (tmp_path / "x.toml").write_text(text)
    settings = {"platform.parameters.platform_mass": "11 kg", "controller.bandwidth": "3 Hz", "loop.delay": 1}
    found = tomllib.loads(text_with_settings(tmp_path / "x.toml", settings, {"plant.parameters.platform_mass": 12}))
    expected = tomllib.loads(text)
    expected["controller"]["bandwidth"], expected["loop"]["delay"] = "3 Hz", 1
    expected.setdefault("platform", {}).setdefault("parameters", {})["platform_mass"] = "11 kg"
    expected.setdefault("plant", {}).setdefault("parameters", {})["platform_mass"] = 12
    assert found == expected


def test_an_experiment_without_a_file_is_written_whole(tmp_path: Path) -> None:
    """Expected: the experiment itself, read back; what is None has no key."""
    made = experiment_from({**BASE, "ensemble": {"platform_mass": {"normal": ["10 kg", "1 kg"]}}})
    made = made.model_copy(update={"ensemble": None})
    (tmp_path / "x.toml").write_text(text_with_settings(made, {"loop.delay": 2}, folder=tmp_path))
    found = load_experiment(tmp_path / "x.toml")
    assert found.model_dump(exclude={"loop": {"delay"}}) == made.model_dump(exclude={"loop": {"delay"}})
    assert found.loop.delay == 2
