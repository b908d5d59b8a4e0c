"""Platform files: exact round trips, and errors that help."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart.model.errors import PlatformFileError
from gough_stewart.model.parameters import PHYSICAL
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import (
    load_platform,
    load_preset,
    platform_from_toml,
    platform_to_toml,
    preset_names,
    preset_text,
    save_platform,
)
from tests.support.random_platforms import random_platform
from tests.support.uneven import UNEVEN


@given(st.integers(0, 2**32 - 1), st.text(max_size=20), st.booleans())
def test_round_trip_is_exact(seed: int, text: str, with_limits: bool) -> None:
    platform = replace(random_platform(np.random.default_rng(seed)), name=text, source=text)
    if with_limits:
        platform = replace(platform, leg_length_min=1e-3, leg_length_max=1e3, actuator_force_max=1 / 3)
    written = platform_to_toml(platform)
    assert platform_from_toml(written) == platform
    assert platform_to_toml(platform_from_toml(written)) == written


@pytest.mark.parametrize("name", preset_names())
def test_presets_survive_toml_platform_toml(name: str) -> None:
    assert tomllib.loads(platform_to_toml(load_preset(name))) == tomllib.loads(preset_text(name))


def test_saves_and_loads_a_file(paper: Platform, tmp_path: Path) -> None:
    save_platform(paper, tmp_path / "mine.toml")
    assert load_platform(tmp_path / "mine.toml") == paper
    assert [p.name for p in tmp_path.iterdir()] == ["mine.toml"]


def test_a_failed_save_leaves_the_old_file_and_nothing_else(
    paper: Platform, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("old")

    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full_disk)
    with pytest.raises(PlatformFileError, match=r"mine.toml: cannot write this platform file: No space"):
        save_platform(paper, path)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["mine.toml"]


@pytest.mark.parametrize("text", ["gravity = " + "[" * 3000, "platform_mass = " + "9" * 5000], ids=["nested", "long"])
def test_toml_that_overruns_the_parser_is_refused(text: str) -> None:
    with pytest.raises(PlatformFileError, match="is not TOML"):
        platform_from_toml(text)


def test_a_byte_order_mark_is_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / "bom.toml").write_text(preset_text("liu2000"), encoding="utf-8-sig")
    assert load_platform(tmp_path / "bom.toml") == load_preset("liu2000")


def test_an_impossible_value_names_file_and_parameter() -> None:
    text = preset_text("liu2000").replace("platform_mass = 10.0", "platform_mass = -10.0")
    with pytest.raises(PlatformFileError, match=r"mine.toml: platform_mass: is -10 kg; expected > 0"):
        platform_from_toml(text, "mine.toml")


def test_a_file_that_is_not_text(tmp_path: Path) -> None:
    (tmp_path / "noise.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PlatformFileError, match="is not UTF-8 text"):
        load_platform(tmp_path / "noise.toml")


def test_an_experiment_is_no_platform() -> None:
    with pytest.raises(PlatformFileError, match="is an experiment; expected a platform file"):
        platform_from_toml("title = 'a'\ncontroller.type = 'open_loop'\nloop.duration = 1")


def test_a_file_is_written_line_by_line_as_a_user_reads_it() -> None:
    """Expected: by hand; one row of a matrix a line, unit and meaning beside the value, no comment beside texts."""
    lines = platform_to_toml(UNEVEN).splitlines()
    assert lines[:4] == [
        'name = "uneven"',
        'source = "made up for tests"',
        "base_points = [",
        "    [0.52, 1.93, 0.04],",
    ]
    assert lines[9] == "] # [m] base joints in world"
    assert "platform_mass = 11.5 # [kg] mass of the platform with payload" in lines
    assert "platform_com = [0.06, -0.11, 0.17] # [m] platform's centre of mass in platform axes, from Op" in lines
    factors = "leg_viscous_friction_factor = [0.7, 1.4, 0.9, 1.6, 0.5, 1.1]"
    assert f"{factors} # [1] each leg's viscous friction over leg_viscous_friction" in lines
    assert lines[-1] == "joint_angle_max = 0.7 # [rad] maximum joint angle from home"
    of_parts = [row.name for row in PHYSICAL if row.part is not None]
    keys = [key for key in UNEVEN.as_dict() if key not in of_parts]
    assert [re.match(r"\w+(?= = )", line)[0] for line in lines if re.match(r"\w+ = ", line)] == keys  # type: ignore[index]
    alike = platform_to_toml(replace(UNEVEN, leg_coulomb_friction_factor=np.ones(6), leg_armature=1.0))
    assert "leg_coulomb_friction_factor" not in alike
    assert "leg_viscous_friction_factor" in alike
    assert "leg_armature = 1.0" in alike
    assert platform_from_toml(alike).leg_coulomb_friction_factor.tolist() == [1] * 6


def test_what_has_a_default_may_be_missing_and_nothing_else() -> None:
    """Expected: every required key by name, in the order of a file; defaults of numbers and of arrays alike."""
    with pytest.raises(PlatformFileError) as caught:
        platform_from_toml("name = 'a'\nhome_position = [0, 0, 1]", "a.toml")
    assert str(caught.value) == (
        "a.toml: missing base_points, platform_points, platform_mass, platform_inertia, leg_lower_mass, "
        "leg_upper_mass, leg_lower_com, leg_upper_com, leg_lower_inertia, leg_upper_inertia; see a preset for a "
        "complete file"
    )
    assert caught.value.where == "a.toml"
    optional: tuple[str, ...] = (
        "name",
        "source",
        "platform_com",
        "gravity",
        "home_orientation",
        "leg_armature",
        "joint_angle_max",
    )
    optional += ("leg_viscous_friction", "leg_coulomb_friction", "leg_friction_velocity", "actuator_force_max")
    optional += ("leg_length_min", "leg_length_max", "leg_viscous_friction_factor", "leg_coulomb_friction_factor")
    text = platform_to_toml(UNEVEN)
    bare = "\n".join(line for line in text.splitlines() if not line.startswith(optional))
    assert platform_from_toml(bare).gravity.tolist() == [0, 0, -9.81]
    assert platform_from_toml(bare).name == "unnamed"


def test_wrong_keys_and_values_are_told_in_whole_sentences(tmp_path: Path) -> None:
    """Expected: file, key, value; keys of circles are known, one key of an experiment is not yet an experiment."""
    text = preset_text("liu2000")
    for line, says in (
        ("paring = 'far'", "unknown key 'paring'; did you mean 'pairing'?"),
        ("controller.type = 'pd'", "unknown key 'controller'"),
        ("loop.duration = 1", "unknown key 'loop'"),
        ("xyz = 1", "unknown key 'xyz'; expected one of name, source, base_points"),
        ("leg_velocity_max = [1, true]", "leg_velocity_max is [1, True]; expected numbers"),
        ("leg_velocity_max = [1, '2']", "leg_velocity_max is [1, '2']; expected numbers"),
        ("leg_velocity_max = 1979-05-27", "leg_velocity_max is datetime.date(1979, 5, 27); expected numbers"),
        ("leg_velocity_max = {a = 1}", "leg_velocity_max is {'a': 1}; expected numbers"),
        ("leg_length_min = true", "leg_length_min is True; expected numbers"),
    ):
        with pytest.raises(PlatformFileError, match=f"^mine.toml: {re.escape(says)}"):
            platform_from_toml(f"{line}\n{text}", "mine.toml")
    with pytest.raises(PlatformFileError, match=r"^TOML text: missing base_points"):
        platform_from_toml("")
    where = f"{tmp_path}: is a folder; expected a file, such as {tmp_path / 'platform.toml'}"
    with pytest.raises(PlatformFileError, match=f"^{re.escape(where)}$"):
        save_platform(UNEVEN, tmp_path)
    for path, reason in ((tmp_path, "Is a directory"), (tmp_path / "none.toml", "No such file or directory")):
        with pytest.raises(
            PlatformFileError, match=f"^{re.escape(f'{path}: cannot read this platform file: {reason}')}$"
        ):
            load_platform(str(path))
    (tmp_path / "bad.toml").write_text("a = = 3")
    with pytest.raises(PlatformFileError, match=f"^{re.escape(str(tmp_path / 'bad.toml'))}: is not TOML"):
        load_platform(tmp_path / "bad.toml")


def test_presets_are_named_and_errors_in_them_too() -> None:
    """Expected: the four of the documentation, in order; the text of a preset is that of its file."""
    assert preset_names() == ("desktop_hexapod", "liu2000", "motion_base", "motion_base_screws")
    assert [load_preset(name).name for name in preset_names()] == list(preset_names())
    with pytest.raises(PlatformFileError, match=r"^preset 'motion_bas': no such preset; did you mean 'motion_base'\?$"):
        preset_text("motion_bas")
    with pytest.raises(
        PlatformFileError, match=r"expected one of desktop_hexapod, liu2000, motion_base, motion_base_screws$"
    ):
        load_preset("qq")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        # a key that is quoted, and one with the sign of a comment: the place, and the line that is there
        ('"#a" = 1\n"#a" = 2', r'Cannot overwrite a value \(at line 2, column \d+\): "#a" = 2'),
        # the end of the text: no line to show
        ("gravity = [0,", r"Invalid value \(at end of document\)"),
        ("a = 1\n\x0b\nb = 2", r"Invalid statement \(at line 2, column 1\)"),
        # lines of the file are those that end with a line feed, whatever else a text may have
        ("name = 'a\u2028b\x85c'\r\nmass 10\r\nb = 1", r"\(at line 2, column \d+\): mass 10"),
        (
            "a = 1\n[leg.x]\n  [leg.x]  # again\n",
            r"the table \[leg.x\] in line 3 is a duplicate; expected every table once",
        ),
        ("a = 1\nb = 2\n\n\na = 3\nc = 4\nb = 5", r"the key 'a' in line 5 is a duplicate; expected every key once"),
        ("x = 1\n" + "y" * 100, r"\(at line 2, column 101\): " + "y" * 60),
    ],
)
def test_places_in_toml_are_those_of_the_line_at_fault(text: str, message: str) -> None:
    with pytest.raises(PlatformFileError, match=rf"^mine: is not TOML: ([^:]* )?({message})$") as caught:
        platform_from_toml(text, "mine")
    assert not str(caught.value).endswith((": ", ":"))
