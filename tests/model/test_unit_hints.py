"""Platforms whose numbers come from CAD programs: mm, g, kg mm², g mm², mm/s²."""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.nano import HEAVY, NANO
from tests.support.uneven import UNEVEN

MACHINES = {name: gs.load_preset(name) for name in ("liu2000", "motion_base", "motion_base_screws", "desktop_hexapod")}
MACHINES |= {"nano": NANO, "heavy": HEAVY}
# What the exponent of each unit is multiplied by: lengths, masses, inertias, gravity.
_UNITS: dict[str, tuple[float, float, float, float, str]] = {
    "inertia in kg mm²": (1, 1, 1e6, 1, "in kg mm2 or g mm2"),
    "inertia in g mm²": (1, 1, 1e9, 1, "in kg mm2 or g mm2"),
    "mass in g, inertia in g mm²": (1, 1e3, 1e9, 1, "in kg mm2 or g mm2"),
    "mass in g, inertia in kg mm²": (1, 1e3, 1e6, 1, "in kg mm2 or g mm2"),
    "mass in g": (1, 1e3, 1, 1, "in g?"),
    "gravity in mm/s²": (1, 1, 1, 1e3, "in mm/s2"),
    "lengths in mm": (1e3, 1, 1, 1, "lengths in mm"),
    "lengths in mm, inertia in kg mm²": (1e3, 1, 1e6, 1, "lengths in mm"),
    "mm and g": (1e3, 1e3, 1e9, 1, "lengths in mm"),
}
_LENGTHS = ("base_points", "platform_points", "platform_com", "home_position", "leg_lower_com", "leg_upper_com")
_LIMITS = ("leg_length_min", "leg_length_max")


def in_units(platform: gs.Platform, length: float, mass: float, inertia: float, gravity: float) -> gs.Platform:
    """A platform with the numbers of other units."""
    values: dict[str, Any] = platform.as_dict()
    factors = dict.fromkeys((*_LENGTHS, *_LIMITS), length)
    factors |= dict.fromkeys(("platform_mass", "leg_lower_mass", "leg_upper_mass"), mass)
    factors |= dict.fromkeys(("platform_inertia", "leg_lower_inertia", "leg_upper_inertia"), inertia)
    factors["gravity"] = gravity
    changed = {name: values[name] * factor for name, factor in factors.items() if name in values}
    return gs.Platform(**{**values, **changed})


@pytest.mark.parametrize("units", _UNITS)
@pytest.mark.parametrize("machine", MACHINES)
def test_units_of_cad_programs_are_hinted_at(machine: str, units: str) -> None:
    """Expected: a hint that names the unit, for machines from 0.4 kg to 50 t."""
    *factors, said = _UNITS[units]
    assert any(said in hint for hint in in_units(MACHINES[machine], *factors).hints)


@pytest.mark.parametrize("machine", MACHINES)
def test_real_machines_have_no_such_hint(machine: str) -> None:
    """Expected: none; nor of one in space, with a load far above its joints, or with its mass in its middle."""
    platform = MACHINES[machine]
    radius, mass = float(np.linalg.norm(platform.platform_points, axis=1).mean()), platform.platform_mass
    tall, dense = (mass * (share * radius) ** 2 * np.diag([1.0, 1.0, 0.9]) for share in (4.0, 0.1))
    for changed in ({}, {"gravity": [0, 0, 0]}, {"platform_inertia": tall}, {"platform_inertia": dense}):
        assert platform.with_parameters(changed).hints == ()


def test_an_inertia_of_a_leg_alone_is_hinted_at() -> None:
    """Expected: kg mm² of one part of a leg, by its name; legs without inertia of their own are sound."""
    for part in ("lower", "upper"):
        name = f"leg_{part}_inertia"
        (hint,) = UNEVEN.with_parameters({name: 1e6 * getattr(UNEVEN, name)}).hints
        assert hint.startswith(name)
        assert UNEVEN.with_parameters({name: 0.0}).hints == ()
