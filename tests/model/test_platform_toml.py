"""Platform files: exact round trips, and errors that help."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart.model.errors import PlatformFileError
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


def test_an_interrupted_save_leaves_nothing_beside(
    paper: Platform, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save_platform(paper, tmp_path / "mine.toml")
    assert list(tmp_path.iterdir()) == []


def test_unknown_key_names_the_nearest_known_one() -> None:
    text = preset_text("liu2000").replace("platform_mass", "platfrom_mass")
    with pytest.raises(PlatformFileError, match="unknown key 'platfrom_mass'; did you mean 'platform_mass'"):
        platform_from_toml(text)


def test_unknown_key_like_nothing_lists_what_there_is() -> None:
    with pytest.raises(PlatformFileError, match="unknown key 'xyz'; expected one of name, source, base_points"):
        platform_from_toml("xyz = 1\n" + preset_text("liu2000"))


def test_missing_keys_are_named() -> None:
    with pytest.raises(PlatformFileError, match=r"missing base_points, .*home_position"):
        platform_from_toml("name = 'empty'")


def test_what_is_not_toml_says_where() -> None:
    with pytest.raises(PlatformFileError, match=r"broken.toml: is not TOML: .*line 1"):
        platform_from_toml("name = = 3", "broken.toml")


@pytest.mark.parametrize("text", ["gravity = " + "[" * 3000, "platform_mass = " + "9" * 5000], ids=["nested", "long"])
def test_toml_that_overruns_the_parser_is_refused(text: str) -> None:
    with pytest.raises(PlatformFileError, match="is not TOML"):
        platform_from_toml(text)


def test_a_number_beyond_floats_is_refused() -> None:
    text = preset_text("liu2000").replace("platform_mass = 10.0", "platform_mass = " + "9" * 400)
    with pytest.raises(PlatformFileError, match="platform_mass"):
        platform_from_toml(text)


def test_a_byte_order_mark_is_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / "bom.toml").write_text(preset_text("liu2000"), encoding="utf-8-sig")
    assert load_platform(tmp_path / "bom.toml") == load_preset("liu2000")


@pytest.mark.parametrize("value", ["true", "'10'", "[1, true]"])
def test_values_that_are_not_numbers_are_refused(value: str) -> None:
    text = preset_text("liu2000").replace("platform_mass = 10.0", f"platform_mass = {value}")
    with pytest.raises(PlatformFileError, match=r"platform_mass is .*; expected numbers"):
        platform_from_toml(text)


def test_an_impossible_value_names_file_and_parameter() -> None:
    text = preset_text("liu2000").replace("platform_mass = 10.0", "platform_mass = -10.0")
    with pytest.raises(PlatformFileError, match=r"mine.toml: platform_mass: is -10 kg; expected > 0"):
        platform_from_toml(text, "mine.toml")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(PlatformFileError, match="cannot read this platform file: No such file"):
        load_platform(tmp_path / "none.toml")


def test_a_file_that_is_not_text(tmp_path: Path) -> None:
    (tmp_path / "noise.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PlatformFileError, match="is not UTF-8 text"):
        load_platform(tmp_path / "noise.toml")


def test_unknown_preset_names_the_nearest() -> None:
    with pytest.raises(PlatformFileError, match="did you mean 'liu2000'"):
        load_preset("liu200")


def test_whole_numbers_are_read_as_floats() -> None:
    text = preset_text("liu2000").replace("platform_mass = 10.0", "platform_mass = 10")
    assert platform_from_toml(text) == load_preset("liu2000")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gravity = [0, 0, -9]\nname = 'a'\ngravity = [0, 0, -1]", "the key 'gravity' in line 3 is a duplicate"),
        ("a = 1\ngravity = [\n0,\n0]\ngravity = [\n1,\n2]\nb = 1", "the key 'gravity' in line 5 is a duplicate"),
        ("[leg]\n[leg]\n", r"the table \[leg\] in line 2 is a duplicate; expected every table once"),
        ("[a.b]\nc = 1\n[a.b]\n", r"the table \[a\.b\] in line 3 is a duplicate"),
        ("name = 'a'\nmass 10\n", r"\(at line 2, column \d+\): mass 10"),
    ],
)
def test_what_is_no_toml_names_line_and_key(text: str, message: str) -> None:
    with pytest.raises(PlatformFileError, match=rf"is not TOML: .*{message}") as caught:
        platform_from_toml(text)
    assert "\n" not in str(caught.value)


def test_an_experiment_is_no_platform() -> None:
    with pytest.raises(PlatformFileError, match="is an experiment; expected a platform file"):
        platform_from_toml("title = 'a'\ncontroller.type = 'open_loop'\nloop.duration = 1")
