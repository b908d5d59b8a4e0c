"""The platform: geometry, masses, friction, gravity, home pose and limits; frozen and validated."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from inspect import cleandoc
from typing import Any, Self

import numpy as np

from gough_stewart.model import platform_checks
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.interface import nearest
from gough_stewart.model.joint_circles import REPLACED, Pairing, joints_on_circles
from gough_stewart.model.machine_dynamics import holding_motor_position
from gough_stewart.model.parameters import FACTOR_OF, TABLE, TEXTS, PlatformFields, in_words
from gough_stewart.model.platform_checks import by_leg
from gough_stewart.model.platform_display import platform_html, platform_text
from gough_stewart.model.platform_hints import platform_hints
from gough_stewart.model.real import real_array
from gough_stewart.model.vectors import FloatArray

# Far beyond any real machine, but its square and cube do not overflow.
LARGEST_NUMBER = 1e30


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Platform(PlatformFields):
    """A Gough–Stewart platform with six identical legs; every parameter by name, in SI units.

    Arrays are copied, converted to float64 and read-only. To change a parameter, make a new platform with
    `dataclasses.replace`, which validates it again, or `with_parameters`, which also replaces the factors of friction
    by six values. Parameters, frames and signs: docs/notation.md.

    Raises
    ------
    PlatformError
        An invalid parameter; `field` has its name, the text has value, expectation and remedy.

    Examples
    --------
    >>> from dataclasses import replace
    >>> loaded = replace(gs.load_preset("motion_base"), platform_mass=1500.0)
    >>> loaded.actuator_force_max, loaded.base_points.shape
    """

    def __post_init__(self) -> None:
        for text in TEXTS:
            if not isinstance(getattr(self, text), str):
                raise PlatformError(text, f"is {getattr(self, text)!r}; expected a text")
        for name, factor in FACTOR_OF.items():
            # factors of 1, the default, contradict nothing
            keys = (name,) if np.array_equal(getattr(self, factor), np.ones(6)) else (name, factor)
            for key, value in by_leg({key: getattr(self, key) for key in keys}).items():
                object.__setattr__(self, key, value)
        for name, row in TABLE.items():
            value = getattr(self, name)
            if value is not None or not row.is_optional:
                object.__setattr__(self, name, _frozen(name, value, row.shape))
        platform_checks.check(self)

    def __eq__(self, other: object) -> bool:
        """Equal in every number and text."""
        if not isinstance(other, Platform):
            return NotImplemented
        return all(np.array_equal(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))

    def __hash__(self) -> int:
        """Consistent with `==`."""
        return hash((self.name, self.base_points.tobytes(), self.platform_mass))

    def __repr__(self) -> str:
        """Name, masses, geometry, home pose and limits, one line each."""
        return platform_text(self)

    def _repr_html_(self) -> str:
        """In a notebook: every parameter."""
        return platform_html(self)

    def __setstate__(self, fields_by_name: dict[str, Any]) -> None:
        """Restore with read-only arrays."""
        self.__dict__.update(fields_by_name)
        for value in fields_by_name.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @property
    def home_actuator_force(self) -> FloatArray:
        """Actuator forces (6,) [N] that hold the home pose at rest: the start values of plant and FMU."""
        return np.asarray(static_leg_forces(self, self.home_position, self.home_orientation))

    @property
    def home_motor_position(self) -> FloatArray:
        """Motor positions (6,) [m] that hold the home pose, for legs that give: L + F/k; L for rigid legs."""
        return holding_motor_position(self, self.home_position, self.home_orientation)

    @property
    def hints(self) -> tuple[str, ...]:
        """What looks like a mistake but is possible: odd units, touching legs, their order, active friction."""
        return platform_hints(self)

    @classmethod
    def from_radii(
        cls,
        base_radius: float,
        platform_radius: float,
        base_angle: float,
        platform_angle: float,
        *,
        home_leg_length: float,
        pairing: Pairing = "near",
        **parameters: Any,
    ) -> Self:
        """A symmetric platform whose joints are in pairs on two circles, level above its base at home.

        Pairs of base joints at the azimuths 120° k ± a/2, of platform joints at 60° + 120° k ± b/2, from X towards Y;
        each leg goes to the "near" or the "far" joint of the pair beside it. The height of the home pose follows from
        the leg length L: z² = L² − R² − r² + 2 R r cos Δ, with the turn Δ = 60° − (a + b)/2, or 60° − (a − b)/2 if far.

        Parameters
        ----------
        base_radius, platform_radius
            Radii R and r of the circles of joints [m].
        base_angle, platform_angle
            Angles a and b between the two joints of a pair [rad], above 0 and below 120°.
        home_leg_length
            Length L of the legs in the home pose [m].
        pairing
            "near" or "far".
        parameters
            The other parameters of the platform, by name.

        Returns
        -------
        Platform
            With the joints' centres, and the limits and home pose that are given.

        Raises
        ------
        PlatformError
            A number out of its range, legs that are too short to reach, or an invalid, unknown or missing parameter.

        Examples
        --------
        >>> preset = gs.load_preset("liu2000").as_dict()
        >>> needed = ("leg_", "platform_mass", "platform_inertia")
        >>> others = {name: value for name, value in preset.items() if name.startswith(needed)}
        >>> angle = np.radians(30)
        >>> platform = gs.Platform.from_radii(2.0, 1.0, angle, angle, home_leg_length=3.2459, **others)
        """
        given = [name for name in REPLACED if name in parameters]
        if given:
            raise PlatformError(given[0], "is determined by the radii and angles; leave it out")
        joints: dict[str, Any] = dict(
            joints_on_circles(base_radius, platform_radius, base_angle, platform_angle, home_leg_length, pairing)
        )
        for name in parameters:
            if name not in TABLE and name not in TEXTS:
                raise PlatformError(name, f"no such parameter{nearest(name, (*TABLE, *TEXTS))}")
        missing = [name for name, row in TABLE.items() if name not in {*joints, *parameters} and not row.has_default]
        if missing:
            raise PlatformError(missing[0], f"missing; expected {', '.join(missing)} beside the radii and angles")
        return cls(**joints, **parameters)

    def with_parameters(self, parameters: Mapping[str, Any]) -> Self:
        """A platform with other values of some parameters; as `dataclasses.replace`, which checks all of them again.

        Parameters
        ----------
        parameters
            Values by name, those of single legs as for a platform: six of a parameter that has a factor.

        Returns
        -------
        Platform
            With its other parameters unchanged.

        Raises
        ------
        PlatformError
            An unknown name, or an invalid value.
        """
        values = by_leg(parameters)
        new = self.unchecked(values)
        platform_checks.check(new, values)
        return new

    def unchecked(self, values: Mapping[str, Any]) -> Self:
        """`with_parameters` without the checks that concern several numbers or a bound; none by leg."""
        new: Self = object.__new__(type(self))
        new.__dict__.update(self.__dict__)
        for name, value in values.items():
            if name not in TABLE:
                raise PlatformError(name, f"no such parameter{nearest(name, TABLE)}")
            row = TABLE[name]
            new.__dict__[name] = None if value is None and row.is_optional else _frozen(name, value, row.shape)
        return new

    def as_dict(self) -> dict[str, Any]:
        """All fields by name, in file order: texts, words, floats, arrays; without limits that are not set."""
        values = {name: getattr(self, name) for name in (*TEXTS, *TABLE)}
        return {name: in_words(name, value) for name, value in values.items() if value is not None}


# help() lists the parameters from the table
Platform.__doc__ = f"{cleandoc(Platform.__doc__ or '')}\n\nParameters\n----------\n" + "\n".join(
    f"{name} : {row.shape or 'number'} [{row.unit}]\n    {row.description}" for name, row in TABLE.items()
)


def _frozen(name: str, value: object, shape: tuple[int, ...]) -> FloatArray | float:
    """A float, or a read-only float64 array of this shape."""
    if type(value) is float and shape == () and abs(value) <= LARGEST_NUMBER:  # the usual case, a shortcut
        return value
    words = TABLE[name].words
    if words and isinstance(value, str):
        if value not in words:
            raise PlatformError(name, f"is {value!r}; expected {', '.join(words)}")
        return float(words.index(value))
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
