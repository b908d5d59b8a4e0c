"""The platform: geometry, masses, friction, gravity, home pose and limits; frozen, and checked when made."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from gough_stewart.model import platform_checks
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.real import real_array
from gough_stewart.model.vectors import FloatArray

# Shape of every field that is not a text; () is a number. The first part is the parameter table of
# `gough_stewart.model.interface`; a test holds the two against each other.
SHAPES: Mapping[str, tuple[int, ...]] = {
    "base_points": (6, 3),
    "platform_points": (6, 3),
    "platform_mass": (),
    "platform_com": (3,),
    "platform_inertia": (3, 3),
    "leg_lower_mass": (),
    "leg_upper_mass": (),
    "leg_lower_com": (),
    "leg_upper_com": (),
    "leg_lower_inertia": (),
    "leg_upper_inertia": (),
    "leg_viscous_friction": (),
    "leg_coulomb_friction": (),
    "leg_friction_velocity": (),
    "gravity": (3,),
    "home_position": (3,),
    "home_orientation": (3,),
    "leg_length_min": (),
    "leg_length_max": (),
    "actuator_force_max": (),
    "joint_angle_max": (),
}
# Far beyond any machine, and still safe to square and cube.
LARGEST_NUMBER = 1e30
OPTIONAL_LIMITS = ("leg_length_min", "leg_length_max", "actuator_force_max", "joint_angle_max")


@dataclass(frozen=True, eq=False, kw_only=True)
class Platform:
    """A Gough–Stewart platform with six identical legs; names and units as in the interface table.

    Arrays are copied, converted to float64 and read-only. To change something, `dataclasses.replace` makes a new
    platform, checked again. Frames and signs: docs/notation.md.

    Raises
    ------
    PlatformError
        A parameter that no platform can have; its `field` names it, its text tells value, expectation and remedy.
    """

    base_points: FloatArray
    """B_i (6, 3) [m], world."""
    platform_points: FloatArray
    """P_i (6, 3) [m], platform axes, from Op."""
    platform_mass: float
    """With payload [kg]."""
    platform_inertia: FloatArray
    """(3, 3) [kg m²], platform axes, about the centre of mass."""
    leg_lower_mass: float
    leg_upper_mass: float
    """[kg]"""
    leg_lower_com: float
    """From B_i along u_i [m]."""
    leg_upper_com: float
    """From P_i back toward B_i [m]."""
    leg_lower_inertia: float
    leg_upper_inertia: float
    """Transverse, about the part's own centre of mass [kg m²]."""
    home_position: FloatArray
    """Op in the home pose (3,) [m]: start value of `position`."""
    home_orientation: FloatArray = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    """Roll, pitch, yaw in the home pose (3,) [rad]: start value of `orientation`."""
    platform_com: FloatArray = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    """r_G (3,) [m], platform axes."""
    leg_viscous_friction: float = 0.0
    """[N s/m]"""
    leg_coulomb_friction: float = 0.0
    """[N]"""
    leg_friction_velocity: float = 1e-3
    """Velocity over which the sign of Coulomb friction is smoothed [m/s]."""
    gravity: FloatArray = (0.0, 0.0, -9.81)  # type: ignore[assignment]
    """(3,) [m/s²], world."""
    leg_length_min: float | None = None
    leg_length_max: float | None = None
    """Stroke [m]; the dynamics ignore it."""
    actuator_force_max: float | None = None
    """[N]; the dynamics ignore it."""
    joint_angle_max: float | None = None
    """Largest angle of a joint from its direction in the home pose [rad]; the dynamics ignore it."""
    name: str = "unnamed"
    """A short name for tables and figures."""
    source: str = ""
    """Where the numbers come from."""

    def __post_init__(self) -> None:
        for text in ("name", "source"):
            if not isinstance(getattr(self, text), str):
                raise PlatformError(text, f"is {getattr(self, text)!r}; expected a text")
        for name, shape in SHAPES.items():
            value = getattr(self, name)
            if value is None and name in OPTIONAL_LIMITS:
                continue
            object.__setattr__(self, name, _frozen(name, value, shape))
        platform_checks.check(self)

    def __eq__(self, other: object) -> bool:
        """Equal in every number and text."""
        if not isinstance(other, Platform):
            return NotImplemented
        return all(np.array_equal(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))

    def __hash__(self) -> int:
        """Consistent with `==`."""
        return hash((self.name, self.base_points.tobytes(), self.platform_mass))

    def __setstate__(self, fields_by_name: dict[str, Any]) -> None:
        """Copies and unpickled platforms are read-only, too."""
        self.__dict__.update(fields_by_name)
        for value in fields_by_name.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def as_dict(self) -> dict[str, Any]:
        """Every field by name, in file order: texts, floats, arrays; limits that are not set are left out."""
        names = ["name", "source", *SHAPES]
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    @property
    def characteristic_length(self) -> float:
        """Root-mean-square distance ρ of the platform joints from Op [m]; scales angles against lengths."""
        return float(np.sqrt((self.platform_points**2).sum(axis=1).mean()))


def _frozen(name: str, value: object, shape: tuple[int, ...]) -> FloatArray | float:
    """A float, or a read-only float64 array of this shape."""
    try:
        array = real_array(value, shape)
    except ValueError as error:
        raise PlatformError(name, str(error)) from None
    if np.abs(array).max() > LARGEST_NUMBER:
        raise PlatformError(name, f"is {array.tolist()}; expected numbers below {LARGEST_NUMBER:g} in SI units")
    if shape == ():
        return float(array)
    array.setflags(write=False)
    return array
