"""Platform files: exact round trips, and errors that help."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gough_stewart as gs
from tests.support.platform_files import loaded, written
from tests.support.random_platforms import random_platform
from tests.support.uneven import UNEVEN

PRESETS = ("desktop_hexapod", "liu2000", "motion_base", "motion_base_screws")


PAPER = written(gs.load_preset("liu2000"))


@given(st.integers(0, 2**32 - 1), st.text(max_size=20), st.booleans())
def test_round_trip_is_exact(seed: int, text: str, with_limits: bool) -> None:
    platform = replace(random_platform(np.random.default_rng(seed)), name=text, source=text)
    if with_limits:
        platform = replace(platform, leg_length_min=1e-3, leg_length_max=1e3, actuator_force_max=1 / 3)
    file = written(platform)
    assert loaded(file) == platform
    assert written(loaded(file)) == file
    assert loaded(b"\xef\xbb\xbf" + file.encode()) == platform  # a byte order mark is no obstacle


def test_presets_are_named_are_those_of_their_files_and_errors_name_them() -> None:
    """Expected: the four of the documentation, in order."""
    assert gs.preset_names() == PRESETS
    for name in PRESETS:
        text = (Path(gs.__file__).parent / "model/presets" / f"{name}.toml").read_text(encoding="utf-8")
        platform = gs.load_preset(name)
        assert platform.name == name
        assert platform.source
        home = platform.home_position, platform.home_orientation
        assert gs.evaluate_poses(platform, *home).condition_number < 10
        assert tomllib.loads(written(platform)) == tomllib.loads(text)
    for name, says in (("motion_bas", "did you mean 'motion_base'?"), ("qq", f"expected one of {', '.join(PRESETS)}")):
        with pytest.raises(gs.GoughStewartError, match=f"^preset '{name}': no such preset.* {re.escape(says)}$"):
            gs.load_preset(name)


def test_a_failed_save_leaves_the_old_file_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("old")

    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full_disk)
    with pytest.raises(gs.GoughStewartError, match=r"mine.toml: cannot write this platform file: No space"):
        gs.save_platform(UNEVEN, path)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["mine.toml"]


def test_a_file_is_written_line_by_line_as_a_user_reads_it() -> None:
    """Expected: by hand; one row of a matrix a line, unit and meaning beside the value, no comment beside texts."""
    lines = written(UNEVEN).splitlines()
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
    keys = [line.partition(" = ")[0] for line in lines if re.match(r"\w+ = ", line)]
    assert keys == [key for key in UNEVEN.as_dict() if key in keys]
    alike = written(replace(UNEVEN, leg_coulomb_friction_factor=np.ones(6), leg_armature=1.0))
    assert "leg_coulomb_friction_factor" not in alike
    assert "leg_viscous_friction_factor" in alike
    assert "leg_armature = 1.0" in alike
    assert loaded(alike).leg_coulomb_friction_factor.tolist() == [1] * 6


# A line before the file of the paper's platform, and what is said.
WRONG_LINES = [
    ("paring = 'far'", "unknown key 'paring'; did you mean 'pairing'?"),
    ("controller.type = 'pd'\nloop.duration = 1", "is an experiment; expected a platform file"),
    ("xyz = 1", "unknown key 'xyz'; expected one of name, source, base_points"),
    ("leg_velocity_max = [1, true]", "leg_velocity_max is [1, True]; expected numbers"),
    (
        "leg_velocity_max = [1, '2']",
        "leg_velocity_max is '2'; expected a number of m/s, or a string with one of the units m/s, mm/s",
    ),
    ("leg_velocity_max = 1979-05-27", "leg_velocity_max is datetime.date(1979, 5, 27); expected numbers"),
    ("leg_velocity_max = " + "[" * 3000, "is not TOML"),
    ("leg_velocity_max = " + "9" * 5000, "is not TOML"),
]


@pytest.mark.parametrize(("line", "says"), WRONG_LINES, ids=lambda text: text[:30])
def test_wrong_keys_and_values_are_told_with_the_file(line: str, says: str) -> None:
    """Expected: keys of circles are known, one key of an experiment is not yet an experiment."""
    with pytest.raises(gs.GoughStewartError, match=f"mine.toml: {re.escape(says)}"):
        loaded(f"{line}\n{PAPER}")


def test_files_that_cannot_be_read_or_written_are_named_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "noise.toml").write_bytes(b"\xff\xfe\x00")
    where = f"{tmp_path}: is a folder; expected a file, such as {tmp_path / 'platform.toml'}"
    with pytest.raises(gs.GoughStewartError, match=f"^{re.escape(where)}$"):
        gs.save_platform(UNEVEN, tmp_path)
    for path, reason in (
        (tmp_path, "Is a directory"),
        (tmp_path / "none.toml", f"No such file or directory; did you mean '{tmp_path / 'noise.toml'}'?"),
        (tmp_path / "noise.toml", "is not UTF-8 text; expected a TOML file"),
    ):
        with pytest.raises(
            gs.GoughStewartError, match=f"^{re.escape(f'{path}: cannot read this platform file: {reason}')}"
        ):
            gs.load_platform(str(path))


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
        ("a = 1\n[leg.x]\n  [leg.x]  # again\n", r"the table \[leg.x\] in line 3 is a duplicate; expected every .*"),
        ("a = 1\nb = 2\n\n\na = 3\nc = 4\nb = 5", r"the key 'a' in line 5 is a duplicate; expected every key once"),
        ("x = 1\n" + "y" * 100, r"\(at line 2, column 101\): " + "y" * 60),
    ],
)
def test_places_in_toml_are_those_of_the_line_at_fault(text: str, message: str) -> None:
    with pytest.raises(gs.GoughStewartError, match=rf"mine.toml: is not TOML: ([^:]* )?({message})$"):
        loaded(text)
