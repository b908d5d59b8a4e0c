"""Experiment files with other keys or in other folders: the author's text and named files stay the same."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

import gough_stewart as gs
from gough_stewart.harness.experiment.file import digests, names_from, text_with_settings

BASE: dict[str, Any] = {"title": "x", "controller": {"type": "pd", "bandwidth": 2}, "loop": {"duration": 1}}


NAMING: dict[str, dict[str, Any]] = {
    "platform.file": {"platform": {"file": "NAME"}},
    "plant.file": {"plant": {"file": "NAME"}},
    "plant.fmu": {"plant": {"kind": "fmu3", "fmu": "NAME"}},
    "controller.file, python": {"controller": {"type": "python", "file": "NAME"}},
    "controller.file, fmu": {"controller": {"type": "fmu", "file": "NAME"}},
    "reference.file, file": {"reference": {"type": "file", "file": "NAME"}},
    "reference.file, path": {"reference": {"type": "path", "file": "NAME", "timing": 1}},
}


@pytest.mark.parametrize("key", NAMING)
@pytest.mark.parametrize("name", ["own.csv", "a/../own.csv", "../mine/own.csv"])
def test_a_named_file_is_the_same_one_from_any_folder(tmp_path: Path, key: str, name: str) -> None:
    """Expected: what the operating system opens under both names; from a link, .. leads elsewhere."""
    mine, far = tmp_path / "mine", tmp_path / "far" / "away"
    (mine / "a").mkdir(parents=True)
    far.mkdir(parents=True)
    (mine / "own.csv").write_text("mine")
    (tmp_path / "link").symlink_to(far)

    def naming(file: str) -> gs.Experiment:
        ((section, values),) = NAMING[key].items()
        named = {k: file if v == "NAME" else v for k, v in values.items()}
        return gs.Experiment(**{**BASE, section: named}).from_file(key, mine)

    for folder in (mine, mine / "results" / "new", far, tmp_path / "link", tmp_path / "link" / "new"):
        folder.mkdir(exist_ok=True, parents=True)
        (found,) = names_from(naming(name), folder).values()
        assert (folder / found).read_text() == "mine"
    (absolute,) = names_from(naming(str(mine / "own.csv")), far).values()
    assert absolute == str(mine / "own.csv")
    assert digests(naming(name)).keys() == {name}


def test_a_shipped_recording_keeps_its_name(tmp_path: Path) -> None:
    """Expected: the motion of the shipped file, from the new text; the folder's own file of that name is not read."""
    text = text_with_settings("recorded_ride", {"loop.duration": 0.1}, folder=tmp_path)
    (tmp_path / "x.toml").write_text(text)
    moved, shipped = (gs.run(name, {"loop.duration": 0.1}) for name in (tmp_path / "x.toml", "recorded_ride"))
    assert (moved["reference.position"] == shipped["reference.position"]).all()
    (tmp_path / "ride.csv").write_text("time\n0\n")
    with pytest.raises(gs.GoughStewartError, match=r"reference\.file.*has a file of this name"):
        text_with_settings("recorded_ride", folder=tmp_path)


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
    made = gs.Experiment(**{**BASE, "ensemble": {"platform_mass": {"normal": ["10 kg", "1 kg"]}}})
    made = made.model_copy(update={"ensemble": None})
    (tmp_path / "x.toml").write_text(text_with_settings(made, {"loop.delay": 2}, folder=tmp_path))
    found = gs.load_experiment(tmp_path / "x.toml")
    assert found.model_dump(exclude={"loop": {"delay"}}) == made.model_dump(exclude={"loop": {"delay"}})
    assert found.loop.delay == 2


OWN = """# mine
title = "own"  # of three words
reference.type = "sine"
reference.frequency = "2 Hz"   # fast
reference.position_amplitude = [0, 0, 0.1]
controller = {type = "pd", bandwidth = 3}

[loop]
duration = "2 s"   # long enough
sample_time = "1 ms"

[[disturbance]]
at = 0.5
duration = 0.1
"""


def test_an_experiment_file_keeps_all_but_the_keys_that_are_set(tmp_path: Path) -> None:
    """Expected: line by line the author's text; new keys in their tables, values as a TOML reader sees them."""
    (tmp_path / "own.toml").write_text(OWN)
    text = text_with_settings(
        tmp_path / "own.toml",
        ["controller.bandwidth=4", "disturbance.1.force=[1, 2, 3]", "platform.preset=motion_base"],
        {"reference.time_scale": 1.25, "loop.duration": 2.5},
    )
    values = tomllib.loads(text)
    assert values["reference"] == {**tomllib.loads(OWN)["reference"], "time_scale": 1.25}
    assert values["controller"]["bandwidth"] == 4
    assert values["disturbance"] == [{"at": 0.5, "duration": 0.1, "force": [1, 2, 3]}]
    assert values["platform"] == {"preset": "motion_base"}
    assert values["loop"] == {"duration": 2.5, "sample_time": "1 ms"}
    for line in OWN.splitlines():
        if not line.startswith(('duration = "2 s"', "controller")):
            assert line in text.splitlines()
    assert "duration = 2.5   # long enough" in text
