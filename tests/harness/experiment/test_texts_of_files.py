"""Experiment files with other keys or in other folders: the author's text and named files stay the same."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

import gough_stewart as gs
from tests.support.commands import invoke
from tests.support.uneven import UNEVEN

# Tables in parts, dotted keys, and tables in one line.
REFERENCE = 'reference={type="sine",position_amplitude=[0,0,0.3],frequency=4}\n'
LAYOUTS = [
    'title="x"\n[loop]\nduration=1\n[controller]\ntype="pd"\nbandwidth=2\n[platform]\n[plant.parameters]\n',
    'title="x"\nloop.duration=1\ncontroller.type="pd"\ncontroller.bandwidth=2\nplatform.preset="liu2000"\n',
    'title="x"\nloop={duration=1}\ncontroller={type="pd",bandwidth=2}\nplatform={parameters={platform_mass=3}}\n',
    'controller.type="pd"\ntitle="x"\nloop.duration=1\ncontroller.bandwidth=2\nplatform.parameters={}\n',
    'title="x"\n[platform.parameters]\n[loop]\nduration=1\n[platform]\npreset="liu2000"\n[controller]\n'
    'type="pd"\nbandwidth=2\n',
]


def fitted(file: Path, *settings: str, fit: str = "time") -> str:
    """The text of the experiment with these settings that `check --fit` writes beside it."""
    options = [part for setting in settings for part in ("--set", setting)]
    done = invoke("check", str(file), *options, "--fit", fit, "--out", str(file.parent / "out"))
    assert done.exit_code == 0, done.output
    return file.with_name(f"{file.stem}-fitted.toml").read_text()


@pytest.mark.parametrize("text", LAYOUTS)
def test_every_layout_of_a_file_takes_new_keys(tmp_path: Path, text: str) -> None:
    """Expected: the parsed text with these values, and the scale and duration of a motion that fits."""
    text = REFERENCE + text
    (tmp_path / "x.toml").write_text(text)
    settings = ["platform.parameters.leg_velocity_max=0.5 m/s", "controller.bandwidth=3 Hz", "loop.delay=1"]
    settings.append("loop.sample_time=10 ms")
    settings.append("plant.parameters.platform_mass=12")
    values, expected = tomllib.loads(fitted(tmp_path / "x.toml", *settings)), tomllib.loads(text)
    assert 1 < values["reference"].pop("time_scale") < 20
    assert values["loop"].pop("duration") > expected["loop"].pop("duration")
    expected["controller"]["bandwidth"], expected["loop"]["delay"] = "3 Hz", 1
    expected["loop"]["sample_time"] = "10 ms"
    expected.setdefault("platform", {}).setdefault("parameters", {})["leg_velocity_max"] = "0.5 m/s"
    expected.setdefault("plant", {}).setdefault("parameters", {})["platform_mass"] = 12
    assert values == expected


OWN = """# mine
title = "own"  # of three words
reference.type = "sine"
reference.frequency = "4 Hz"   # fast
reference.position_amplitude = [0, 0, 0.3]
controller = {type = "pd", bandwidth = 3}

[platform.parameters]
leg_velocity_max = 0.5

[loop]
duration = "2 s"   # long enough
sample_time = "10 ms"

[[disturbance]]
at = 0.5
duration = 0.1
"""


def test_an_experiment_file_keeps_all_but_the_keys_that_are_set(tmp_path: Path) -> None:
    """Expected: line by line the author's text; new keys in their tables, values as a TOML reader sees them."""
    (tmp_path / "own.toml").write_text(OWN)
    text = fitted(tmp_path / "own.toml", "controller.bandwidth=4", "disturbance.1.force=[1, 2, 3]", fit="amplitude")
    values = tomllib.loads(text)
    assert 0 < values["reference"].pop("amplitude_scale") < 1
    assert values["reference"] == tomllib.loads(OWN)["reference"]
    assert values["controller"]["bandwidth"] == 4
    assert values["disturbance"] == [{"at": 0.5, "duration": 0.1, "force": [1, 2, 3]}]
    for line in OWN.splitlines():
        if not line.startswith("controller"):
            assert line in text.splitlines()
    slower = fitted(tmp_path / "own.toml")
    duration = tomllib.loads(slower)["loop"]["duration"]
    assert f"duration = {duration}   # long enough" in slower


def test_named_files_are_the_same_ones_from_any_folder(tmp_path: Path) -> None:
    """Expected: what the system opens under both names; where a shipped name means another file, nothing is written."""
    mine, far = tmp_path / "mine", tmp_path / "far" / "away"
    (mine / "a").mkdir(parents=True)
    far.mkdir(parents=True)
    (tmp_path / "link").symlink_to(far)
    for name in ("platform.toml", "machine.toml"):
        gs.save_platform(UNEVEN, mine / name)
    head = "time [s],x [m],y [m],z [m],roll [rad],pitch [rad],yaw [rad]"
    rows = (f"{k / 100},0,0,{1e-5 * k**2},0,0,0" for k in range(12))
    (mine / "motion.csv").write_text("\n".join([head, *rows]))
    names = {"platform": "a/../platform.toml", "plant": str(mine / "machine.toml"), "reference": "../mine/motion.csv"}
    (mine / "x.toml").write_text(
        f'title = "x"\nplatform.file = "{names["platform"]}"\nplant.file = "{names["plant"]}"\n'
        f'reference = {{type = "file", file = "{names["reference"]}", at_home = "start"}}\n'
        'controller = {type = "pd", bandwidth = 2}\nloop = {duration = 0.02, sample_time = 0.005}\n'
    )
    search: Any = ("--vary", "controller.bandwidth=1..2Hz", "--minimise", "tracking.position.norm_rms")
    search += ("--generations", "1", "--population", "5")
    for folder in (mine / "results" / "new", tmp_path / "link"):
        done = invoke("tune", str(mine / "x.toml"), *search, "--out", str(folder))
        assert done.exit_code == 0, done.output
        tables = tomllib.loads((folder / "tuned.toml").read_text())
        for table, name in names.items():
            assert (folder / tables[table]["file"]).samefile(mine / name)
        assert tables["plant"]["file"] == names["plant"]
        assert gs.load_experiment(folder / "tuned.toml").reference is not None
    record = gs.run(mine / "x.toml")
    assert record.metadata["files"].keys() == set(names.values())
    (far / "ride.csv").write_text("time\n0\n")
    done = invoke("tune", "recorded_ride", *search, "--out", str(tmp_path / "link"), catch_exceptions=True)
    assert "has a file of this name" in " ".join((done.output + str(done.exception)).split())
