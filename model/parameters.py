"""The ONE table of a platform's parameters: name, shape, unit, default, bound, meaning. All else derives from it.

To add a parameter, add one entry at the end of `ParametersOf`, so that older ones keep their value references in the
FMU. Its physics belongs in `dynamics` or `friction`, and the formulations that check them. A limit
that the dynamics ignore is one entry in `PlatformFields`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cached_property, partial
from itertools import product
from typing import Any, Generic, Literal, TypeVar

import numpy as np

from gough_stewart.model.vectors import Array, FloatArray, Scalars, per_leg

Causality = Literal["input", "output", "local", "parameter"]
Variability = Literal["continuous", "discrete", "fixed", "tunable"]
Bound = Literal["> 0", ">= 0"] | None
# Parts of a plant that not every platform has: bristles, which model stiction, and springs between motor and leg.
Part = Literal["bristles", "springs"]
FRICTION_MODELS = ("smooth", "elasto_plastic", "lugre")

_Array_co = TypeVar("_Array_co", bound=Array, covariant=True)
_Number_co = TypeVar("_Number_co", bound=Scalars, covariant=True)


@dataclass(frozen=True)
class Variable:
    """One row of a table: a parameter of a platform, or a variable of the plant."""

    name: str
    shape: tuple[int, ...]
    unit: str
    causality: Causality
    variability: Variability
    description: str
    # A number for all elements, the name of a `Platform` attribute, or None for computed variables.
    start: float | str | None = None
    is_state: bool = False
    # Values below (or, for "> 0", at) this bound are rejected when set; None allows any finite number.
    lower_bound: Bound = None
    # Size of a state's usual changes, by which integrators scale absolute tolerances: a millimetre, a milliradian.
    nominal: float = 1e-3
    # Of a parameter: a number or a tuple; None for a limit that need not be stated, ... for what must be.
    default: Any = ...
    # The words that files have for the values 0, 1, 2 …; none for a quantity.
    words: tuple[str, ...] = ()
    # A number for all legs, or an array of six.
    is_by_leg: bool = False
    # What a plant must have to use it; the ideal plant, rigid and with smooth friction, has none of these parts.
    part: Part | None = None

    @cached_property
    def size(self) -> int:
        """Number of scalars."""
        return math.prod(self.shape)

    @cached_property
    def scalar_names(self) -> tuple[str, ...]:
        """FMI 2.0 names of the elements in row-major order; the name itself for a scalar."""
        if not self.shape:
            return (self.name,)
        indices = product(*(range(1, n + 1) for n in self.shape))
        return tuple(f"{self.name}[{','.join(map(str, index))}]" for index in indices)

    def element(self, flat_index: int) -> "Variable":
        """One element as a scalar variable with its FMI 2.0 name."""
        return replace(self, name=self.scalar_names[flat_index], shape=())


def _row(
    unit: str,
    description: str,
    lower_bound: Bound = None,
    default: Any = ...,
    shape: tuple[int, ...] = (),
    variability: Variability = "fixed",
    **named: Any,
) -> Any:
    """A field of a dataclass, with its row of the table, but for the name, as metadata."""
    row = Variable(
        "", shape, unit, "parameter", variability, description, lower_bound=lower_bound, default=default, **named
    )
    if isinstance(default, tuple):
        return field(default_factory=lambda: np.array(default), metadata={"row": row})
    return field(default=MISSING if default is ... else default, metadata={"row": row})


_tunable = partial(_row, variability="tunable")
_factor = partial(_tunable, lower_bound=">= 0", default=(1.0,) * 6, shape=(6,))
_fixed_factor = partial(_factor, "1", variability="fixed")
_bristle, _spring = partial(_tunable, default=0.0, part="bristles"), partial(_row, default=0.0, part="springs")
_limit = partial(_row, lower_bound="> 0", default=None, is_by_leg=True)


@dataclass(frozen=True, eq=False, kw_only=True)
class ParametersOf(Generic[_Array_co, _Number_co]):
    """The physical parameters, as arrays of type `_Array_co` and numbers of type `_Number_co`; unchecked.

    Leading axes `...` broadcast against those of the state. The kernel's p and the FMU have these parameters in this
    order.
    """

    base_points: _Array_co = _row("m", "base joints in world", shape=(6, 3))
    platform_points: _Array_co = _row("m", "platform joints in platform axes, from Op", shape=(6, 3))
    platform_mass: _Number_co = _tunable("kg", "mass of the platform with payload", "> 0")
    platform_com: _Array_co = _tunable(
        "m", "platform's centre of mass in platform axes, from Op", None, (0.0, 0.0, 0.0), (3,)
    )
    platform_inertia: _Array_co = _tunable(
        "kg.m2", "platform's inertia about its centre of mass, platform axes", shape=(3, 3)
    )
    leg_lower_mass: _Number_co = _row("kg", "mass of a leg's lower part", ">= 0")
    leg_upper_mass: _Number_co = _row("kg", "mass of a leg's upper part", ">= 0")
    leg_lower_com: _Number_co = _row("m", "lower part's centre of mass, from the base joint along the leg", ">= 0")
    leg_upper_com: _Number_co = _row("m", "upper part's centre of mass, from the platform joint along the leg", ">= 0")
    leg_lower_inertia: _Number_co = _row("kg.m2", "lower part's transverse inertia about its centre of mass", ">= 0")
    leg_upper_inertia: _Number_co = _row("kg.m2", "upper part's transverse inertia about its centre of mass", ">= 0")
    leg_viscous_friction: _Number_co = _tunable("N.s/m", "viscous friction between the leg parts", ">= 0", 0.0)
    leg_coulomb_friction: _Number_co = _tunable("N", "Coulomb friction between the leg parts", ">= 0", 0.0)
    leg_friction_velocity: _Number_co = _tunable("m/s", "velocity over which Coulomb friction is smoothed", "> 0", 1e-3)
    gravity: _Array_co = _tunable("m/s2", "acceleration of gravity in world", None, (0.0, 0.0, -9.81), (3,))
    leg_armature: _Number_co = _row(
        "kg", "inertia J of rotor and screw reflected along the leg, J (2 pi/lead)^2", ">= 0", 0.0
    )
    leg_viscous_friction_factor: _Array_co = _factor("1", "each leg's viscous friction over leg_viscous_friction")
    leg_coulomb_friction_factor: _Array_co = _factor("1", "each leg's Coulomb friction over leg_coulomb_friction")
    # a word of `FRICTION_MODELS`, or its number, which a platform keeps
    leg_friction_model: Any = _bristle(
        "1", "law of friction: 0 smooth, 1 elasto_plastic, 2 lugre", words=FRICTION_MODELS, variability="fixed"
    )
    leg_static_friction: _Number_co = _bristle("N", "friction to overcome at rest, 0 for leg_coulomb_friction", ">= 0")
    leg_stribeck_velocity: _Number_co = _bristle(
        "m/s", "velocity over which static friction falls to Coulomb's", "> 0", default=1e-3
    )
    leg_bristle_stiffness: _Number_co = _bristle(
        "N/m", "presliding stiffness of a leg, 0 for presliding of 10 um", ">= 0"
    )
    leg_bristle_damping: _Number_co = _bristle("N.s/m", "presliding damping of a leg, 0 for half of critical", ">= 0")
    leg_breakaway_share: _Number_co = _bristle(
        "1", "share of Coulomb friction up to which a bristle is elastic, 0 for 0.8; lugre has none", ">= 0"
    )
    leg_stiffness: _Number_co = _spring(
        "N/m", "stiffness between motor and platform's side of a leg, 0 for rigid", ">= 0"
    )
    leg_damping: _Number_co = _spring("N.s/m", "damping of leg_stiffness, 0 for 2 % of critical", ">= 0")
    leg_lower_mass_factor: _Array_co = _fixed_factor("each leg's mass over leg_lower_mass")
    leg_upper_mass_factor: _Array_co = _fixed_factor("each leg's mass over leg_upper_mass")
    leg_lower_com_factor: _Array_co = _fixed_factor("each leg's distance over leg_lower_com")
    leg_upper_com_factor: _Array_co = _fixed_factor("each leg's distance over leg_upper_com")
    leg_lower_inertia_factor: _Array_co = _fixed_factor("each leg's inertia over leg_lower_inertia")
    leg_upper_inertia_factor: _Array_co = _fixed_factor("each leg's inertia over leg_upper_inertia")
    leg_armature_factor: _Array_co = _fixed_factor("each leg's inertia over leg_armature")
    leg_static_friction_factor: _Array_co = _factor(
        "1",
        "each leg's friction over leg_static_friction, 0 for that of Coulomb's",
        default=(0.0,) * 6,
        part="bristles",
    )
    leg_stribeck_velocity_factor: _Array_co = _factor(
        "1", "each leg's velocity over leg_stribeck_velocity", lower_bound="> 0", part="bristles"
    )
    leg_bristle_stiffness_factor: _Array_co = _factor(
        "1", "each leg's stiffness over leg_bristle_stiffness", part="bristles"
    )
    leg_bristle_damping_factor: _Array_co = _factor("1", "each leg's damping over leg_bristle_damping", part="bristles")
    leg_breakaway_share_factor: _Array_co = _factor("1", "each leg's share over leg_breakaway_share", part="bristles")
    leg_stiffness_factor: _Array_co = _fixed_factor("each leg's stiffness over leg_stiffness", part="springs")
    leg_damping_factor: _Array_co = _fixed_factor("each leg's damping over leg_damping", part="springs")


# The argument of the equations: a `Platform`, a batch of platforms, or CasADi symbols.
Parameters = ParametersOf[Array, Scalars]


@dataclass(frozen=True, eq=False, kw_only=True)
class PlatformFields(ParametersOf[FloatArray, float]):
    """All fields of a platform, unchecked: what dynamics use, the home pose, limits that they ignore, texts."""

    home_position: FloatArray = _row("m", "Op in the home pose, the start value of position", shape=(3,))
    home_orientation: FloatArray = _row(
        "rad", "roll, pitch, yaw in the home pose, the start value of orientation", None, (0.0, 0.0, 0.0), (3,)
    )
    leg_length_min: float | FloatArray | None = _limit("m", "shortest leg")
    leg_length_max: float | FloatArray | None = _limit("m", "longest leg")
    leg_velocity_max: float | FloatArray | None = _limit("m/s", "maximum leg velocity")
    actuator_force_max: float | FloatArray | None = _limit("N", "maximum actuator force")
    actuator_power_max: float | FloatArray | None = _limit("W", "maximum actuator power")
    joint_angle_max: float | None = _limit("rad", "maximum joint angle from home", is_by_leg=False)
    leg_acceleration_max: float | FloatArray | None = _limit("m/s2", "maximum leg acceleration")
    name: str = "unnamed"
    source: str = ""

    @property
    def characteristic_length(self) -> float:
        """Root-mean-square distance ρ of the platform joints from Op [m]; scales angles against lengths."""
        return float(np.sqrt((self.platform_points**2).sum(axis=1).mean()))

    @property
    def stroke(self) -> float | None:
        """The stroke of a leg, the shortest of six [m]; None if it has no limits."""
        low, high = self.leg_length_min, self.leg_length_max
        return None if low is None or high is None else float(np.min(np.subtract(high, low)))


# All numeric fields of a platform by name.
TABLE: Mapping[str, Variable] = {
    f.name: replace(f.metadata["row"], name=f.name, start=f.name) for f in fields(PlatformFields) if "row" in f.metadata
}
NEEDED = tuple(name for name, row in TABLE.items() if row.default is ...)
LIMITS = tuple(row for row in TABLE.values() if row.default is None)
TEXTS = tuple(f.name for f in fields(PlatformFields) if f.name not in TABLE)
PHYSICAL = tuple(TABLE[f.name] for f in fields(ParametersOf))
# Numbers that can also be given as six, with the parameter of their factors: see `by_leg`.
FACTOR_OF = {name.removesuffix("_factor"): name for name in TABLE if name.endswith("_factor")}


def of_legs(parameters: Any, name: str, absent: float | None = None) -> Array:
    """A parameter of each leg (..., 6): one that has factors, or a limit, with a value for legs without one."""
    value = getattr(parameters, name)
    if name in FACTOR_OF:
        return np.asarray(per_leg(value) * getattr(parameters, FACTOR_OF[name]))
    value, shape = np.asarray(absent if value is None else value, dtype=float), np.shape(parameters.platform_mass)
    return np.broadcast_to(value if value.ndim > len(shape) else value[..., None], (*shape, 6))


def stack(parameters: Sequence[Parameters]) -> Parameters:
    """Many platforms as one batch: every parameter gets a leading axis over the platforms.

    Parameters
    ----------
    parameters
        Platforms, names of presets, or files.

    Returns
    -------
    ParametersOf
        A batch of n platforms for the functions of geometry and forces: scalars become (n,), vectors (n, 3), points
        (n, 6, 3).

    Raises
    ------
    ArgumentError
        No platform, or something else than platforms.

    See Also
    --------
    mass_matrix, leg_geometry, ensemble

    Examples
    --------
    >>> platforms = gs.stack([gs.load_preset("liu2000"), gs.load_preset("motion_base")])
    >>> gs.mass_matrix(platforms, np.array([0, 0, 2.5]), np.zeros(3)).shape
    (2, 6, 6)
    """
    return Parameters(
        **{row.name: np.stack([np.asarray(getattr(platform, row.name)) for platform in parameters]) for row in PHYSICAL}
    )
