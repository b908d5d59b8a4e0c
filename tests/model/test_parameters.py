"""Every parameter reaches all that it concerns, and is what docs/notation.md says of it."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from gough_stewart import GoughStewartError, Platform
from tests.support.platform_files import loaded, written
from tests.support.random_platforms import random_platform

DOCS = Path(__file__).parents[2] / "docs"


class Documented(NamedTuple):
    """A row of the tables in docs/notation.md, which are written by hand: what the code must hold to."""

    shape: tuple[int, ...]
    unit: str
    default: Any  # a list, None for a limit that is not stated, or NEEDED
    bound: str | None
    in_fmu: str


NEEDED = "needed"


def documented() -> dict[str, Documented]:
    section = (DOCS / "notation.md").read_text(encoding="utf-8").split("## Parameters")[1]
    rows = {}
    for line in section.split("\n##")[0].splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if len(cells) == 6 and cells[0].startswith("`"):
            name, shape, unit, default, bound, in_fmu = cells
            numbers: Any = NEEDED if default == "–" else None
            if default not in ("–", "no limit"):
                numbers = [float(text) for text in default.replace("−", "-").split(",")]
            sides = () if shape == "1" else tuple(int(text) for text in shape.split(" × "))
            rows[name.strip("`")] = Documented(sides, unit, numbers, None if bound == "any" else bound, in_fmu)
    return rows


ALL = documented()
PHYSICAL = {name: row for name, row in ALL.items() if row.in_fmu in ("fixed", "tunable")}
OF_PARTS: dict[str, Any] = {
    "leg_friction_model": 2.0,
    "leg_static_friction": 1e6,
    "leg_stribeck_velocity": 0.0023,
    "leg_bristle_stiffness": 1e12,
    "leg_bristle_damping": 1234.5,
    "leg_breakaway_share": 0.71,
    "leg_stiffness": 1e7 / 3,
    "leg_damping": 77.7,
    "leg_static_friction_factor": np.linspace(0.9, 1.4, 6),
    "leg_stribeck_velocity_factor": np.linspace(0.8, 1.3, 6),
    "leg_bristle_stiffness_factor": np.linspace(1.2, 0.7, 6),
    "leg_bristle_damping_factor": np.linspace(0.7, 1.1, 6),
    "leg_breakaway_share_factor": np.linspace(0.6, 1.2, 6),
    "leg_stiffness_factor": np.linspace(0.5, 1.6, 6),
    "leg_damping_factor": np.linspace(1.7, 0.4, 6),
}
LIMITS: dict[str, Any] = {
    "leg_length_min": 1e-3,
    "leg_length_max": 1e3,
    "leg_velocity_max": 0.7,
    "actuator_force_max": 1 / 3,
    "actuator_power_max": 11.0,
    "joint_angle_max": 3.0,
    "leg_acceleration_max": 19.0,
}


@pytest.fixture(scope="module")
def uneven() -> Platform:
    """Every parameter differs from its default, and from every other."""
    return replace(random_platform(np.random.default_rng(12)), **LIMITS)


def test_a_platform_has_these_parameters_and_no_others(uneven: Platform) -> None:
    assert len(ALL) == 49
    assert set(uneven.as_dict()) == {"name", "source", *ALL}
    assert not set(tomllib.loads(written(uneven))) & set(OF_PARTS)
    homes = {name: row.in_fmu for name, row in ALL.items() if row.in_fmu.startswith("start")}
    assert homes == {f"home_{name}": f"start of `{name}`" for name in ("position", "orientation")}
    for name, expected in ALL.items():
        assert np.shape(getattr(uneven, name)) == expected.shape, name


def test_only_what_is_needed_has_to_be_named(uneven: Platform) -> None:
    needed = {name: getattr(uneven, name) for name, expected in ALL.items() if expected.default is NEEDED}
    platform = Platform(**needed)
    for name, expected in ALL.items():
        if expected.default is not NEEDED:
            value = getattr(platform, name)
            assert value is None if expected.default is None else np.all(np.ravel(value) == expected.default), name
    for name in needed:
        with pytest.raises(TypeError, match=name):
            Platform(**{other: value for other, value in needed.items() if other != name})


@pytest.mark.parametrize("name", [name for name, expected in ALL.items() if expected.bound])
def test_the_bound_is_held_and_named_with_the_unit(uneven: Platform, name: str) -> None:
    expected = ALL[name]
    refused = [-0.5, 0.0] if expected.bound == "> 0" else [-0.5]
    for value in refused:
        array = np.ones(expected.shape)
        array.flat[-1] = value
        which = f"{name}[{array.size}]" if expected.shape else name
        unit = "" if expected.unit == "1" else f" {expected.unit}"
        text = re.escape(f"{which}: is {value:g}{unit}; expected {expected.bound}")
        one: dict[str, Any] = {name: array if expected.shape else value}
        with pytest.raises(GoughStewartError, match=text):
            replace(uneven, **one)
    if expected.bound == ">= 0":
        one = {name: np.zeros(expected.shape) if expected.shape else 0.0}
        assert np.all(getattr(replace(uneven, **one), name) == 0)


def test_a_platform_file_holds_every_parameter_with_its_unit(uneven: Platform) -> None:
    own = replace(uneven, **OF_PARTS)
    file = written(own)
    assert loaded(file) == own
    values = tomllib.loads(file)
    assert values.pop("leg_friction_model") == "lugre"
    values["leg_friction_model"] = OF_PARTS["leg_friction_model"]
    for name, expected in ALL.items():
        assert np.array_equal(values[name], getattr(own, name)), name
        entry = file[re.search(rf"^{name} = ", file, re.M).start() :]  # type: ignore[union-attr]
        found = re.search(r"# \[(.*?)\] \S", entry)
        assert found, name
        assert found[1] == expected.unit, name


# a type checker sees one float
SIX: Any = [0.04, 0.0, 0.065, 0.11, 0.02, 0.075]
OF_LEGS = [name.removesuffix("_factor") for name in PHYSICAL if name.endswith("_factor")]


@pytest.mark.parametrize("name", OF_LEGS)
def test_six_values_become_their_mean_and_factors(uneven: Platform, name: str) -> None:
    uneven = replace(uneven, platform_mass=1e3)
    changed = uneven.with_parameters({name: SIX})
    assert getattr(changed, name) == pytest.approx(0.31 / 6, rel=1e-15)
    assert np.allclose(getattr(changed, f"{name}_factor") * getattr(changed, name), SIX, rtol=1e-15, atol=0)
    equal: dict[str, Any] = {name: [0.1] * 6}
    alike = changed.with_parameters(equal)
    assert getattr(alike, name) == 0.1
    assert np.array_equal(getattr(alike, f"{name}_factor"), np.ones(6))
    nothing: dict[str, Any] = {name: np.zeros(6)}
    free = changed.with_parameters(nothing)
    negative: dict[str, Any] = {name: [*SIX[:2], -2, *SIX[3:]]}
    with pytest.raises(GoughStewartError, match=rf"{name}\[3\]: is -2 .*; expected >= 0"):
        uneven.with_parameters(negative)
    assert (getattr(free, name), getattr(free, f"{name}_factor").tolist()) == (0.0, [1.0] * 6)
    assert loaded(written(changed)) == changed


@pytest.mark.parametrize("name", ["leg_coulomb_friction", "leg_lower_mass"])
def test_six_values_beside_factors_are_refused_wherever_a_platform_is_made(uneven: Platform, name: str) -> None:
    """Expected: as in a file; factors of 1, which contradict nothing, are not, nor are six instead of factors."""
    both: dict[str, Any] = {name: SIX, f"{name}_factor": [0.5, 1.5, 0.8, 1.2, 0.9, 1.1]}
    text = f"{name}: has six values beside {name}_factor; expected only one of "
    with pytest.raises(GoughStewartError, match=text):
        Platform(**{**uneven.as_dict(), **both})
    with pytest.raises(GoughStewartError, match=text):
        uneven.with_parameters(both)
    with pytest.raises(GoughStewartError, match=text):
        replace(uneven, **{name: both[name]})
    alone = Platform(**{**uneven.as_dict(), name: SIX, f"{name}_factor": [1] * 6})
    assert alone == uneven.with_parameters({name: SIX})
