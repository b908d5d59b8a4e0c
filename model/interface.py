"""The ONE table of variables: names, shapes, units, meaning. Stepping model, kernel, files and FMU share it.

Inputs, states, outputs and locals are declared here, and state and inputs as the arguments of the equations; a
platform's parameters are in `gough_stewart.model.parameters`.
The names are part of the public interface. Elements of arrays have their FMI 2.0 names, 1-based:
`leg_length[3]`, `joint_force[2,1]`.

The ideal plant has rigid legs and friction that is a function of velocity; the module's constants are of it. Stiction
needs the bristles' deflections as states, elastic legs the motors' positions and velocities: a `Variant` has these
parts or not. Their variables follow those of the ideal plant, so the first states, results and parameters are the same
in all variants.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from itertools import product
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.errors import InterfaceError, StepError
from gough_stewart.model.parameters import FRICTION_MODELS, PHYSICAL, Causality, Part, Variable
from gough_stewart.model.vectors import Array, concatenate, real_array


def _input(name: str, shape: tuple[int, ...], unit: str, description: str, start: float | str = 0.0) -> Variable:
    return Variable(name, shape, unit, "input", "continuous", description, start)


def _state(name: str, unit: str, description: str, start: float | str = 0.0, **named: Any) -> Variable:
    shape = (3,) if named.get("part") is None else (6,)
    return Variable(name, shape, unit, "output", "continuous", description, start, True, **named)


def _result(name: str, shape: tuple[int, ...], unit: str, causality: Causality, description: str) -> Variable:
    return Variable(name, shape, unit, causality, "continuous", description)


VARIABLES: tuple[Variable, ...] = (
    _input("actuator_force", (6,), "N", "force of each actuator, positive extends the leg", "home_actuator_force"),
    _input("external_force", (3,), "N", "external force at Op, world components"),
    _input("external_torque", (3,), "N.m", "external torque about Op, world components"),
    _state("position", "m", "origin Op of the platform frame in world", "home_position"),
    _state("orientation", "rad", "roll, pitch, yaw about the fixed world axes X, then Y, then Z", "home_orientation"),
    _state("velocity", "m/s", "velocity of Op in world"),
    _state("angular_velocity", "rad/s", "angular velocity of the platform, world components"),
    _result("leg_length", (6,), "m", "output", "distance from base joint to platform joint"),
    _result("leg_velocity", (6,), "m/s", "output", "rate of the leg length"),
    _result("acceleration", (3,), "m/s2", "output", "acceleration of Op in world"),
    _result("angular_acceleration", (3,), "rad/s2", "output", "angular acceleration, world components"),
    _result(
        "joint_force", (6, 3), "N", "local", "force of leg i on the platform at platform joint i, world components"
    ),
    _result("kinetic_energy", (), "J", "local", "kinetic energy of platform and legs"),
    _result(
        "potential_energy", (), "J", "local", "potential energy of platform and legs in gravity, zero at world z = 0"
    ),
    *(row for row in PHYSICAL if row.part is None),
    Variable(
        "fixed_step_size",
        (),
        "s",
        "parameter",
        "fixed",
        "of the FMU: 0 for error-controlled steps, > 0 for equal steps of at most this size",
        start=0.0,
        lower_bound=">= 0",
    ),
)
"""Every variable of the plant: `name`, `shape`, `unit`, `causality`, `variability`, `description`; see notation."""

# What a plant with parts has in addition, states in the order of the state vector; see `Variant`.
OF_PARTS: tuple[Variable, ...] = (
    _state("leg_bristle", "m", "deflection of the bristle of each leg's friction", nominal=1e-5, part="bristles"),
    _state("motor_position", "m", "length of each leg without its stretch", "home_motor_position", part="springs"),
    _state("motor_velocity", "m/s", "rate of motor_position", part="springs"),
    replace(
        _result("leg_force", (6,), "N", "output", "force of each leg's spring and damper, positive extends the leg"),
        part="springs",
    ),
    *(row for row in PHYSICAL if row.part is not None),
)

BY_NAME: Mapping[str, Variable] = {v.name: v for v in (*VARIABLES, *OF_PARTS)}
INPUTS = tuple(v for v in VARIABLES if v.causality == "input")
STATES = tuple(v for v in VARIABLES if v.is_state)
OUTPUTS = tuple(v for v in VARIABLES if v.causality == "output")
LOCALS = tuple(v for v in VARIABLES if v.causality == "local")
RESULTS = OUTPUTS + LOCALS
# The parameters of the platform, arguments of the kernel; `fixed_step_size` belongs to the FMU only.
PLATFORM_PARAMETERS = tuple(row for row in PHYSICAL if row.part is None)
# The first results, without direct feedthrough from the forces.
SIGNALS = RESULTS[: RESULTS.index(BY_NAME["leg_velocity"]) + 1]
# Lengths of the vectors from `pack`.
N_INPUTS, N_STATES, N_RESULTS, N_SIGNALS, N_PARAMETERS = (
    sum(v.size for v in variables) for variables in (INPUTS, STATES, RESULTS, SIGNALS, PLATFORM_PARAMETERS)
)

RESULT_COLUMNS = tuple(name for v in RESULTS for name in v.scalar_names)
_ELEMENTS: Mapping[str, tuple[Variable, int]] = {
    name: (v, k) for v in BY_NAME.values() for k, name in enumerate(v.scalar_names)
}


# The nominal of states but bristles, for which a tolerance is absolute in SI units.
NOMINAL = 1e-3
# Values of `leg_friction_model`.
SMOOTH, ELASTO_PLASTIC, LUGRE = (float(k) for k in range(len(FRICTION_MODELS)))


@dataclass(frozen=True)
class Variant:
    """The parts of a plant, and its variables."""

    bristles: bool = False
    springs: bool = False
    # names of its parts
    parts: tuple[Part, ...] = field(init=False, compare=False, repr=False)
    # in the order of x; outputs and locals in that of y, those of the ideal plant first; the parameters that act, of p
    states: tuple[Variable, ...] = field(init=False, compare=False, repr=False)
    results: tuple[Variable, ...] = field(init=False, compare=False, repr=False)
    # the results in a unit's order: states, other outputs, locals
    unit_results: tuple[Variable, ...] = field(init=False, compare=False, repr=False)
    parameters: tuple[Variable, ...] = field(init=False, compare=False, repr=False)
    # lengths of x, p and y
    n_states: int = field(init=False, compare=False, repr=False)
    n_parameters: int = field(init=False, compare=False, repr=False)
    n_results: int = field(init=False, compare=False, repr=False)
    # parameters that may change during a run
    tunable: tuple[Variable, ...] = field(init=False, compare=False, repr=False)
    # scalar names of the results
    columns: tuple[str, ...] = field(init=False, compare=False, repr=False)
    # by which absolute tolerances of the states are scaled (n,): 1, less for bristles
    scales: tuple[float, ...] = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        names: tuple[Part, ...] = ("bristles", "springs")
        parts = tuple(part for part in names if getattr(self, part))
        of_parts = [v for v in OF_PARTS if v.part in parts]
        states = (*STATES, *(v for v in of_parts if v.is_state))
        results = (*RESULTS, *(v for v in of_parts if v.causality == "output"))
        outputs = (v for v in results if v.causality == "output" and not v.is_state)
        parameters = tuple(row for row in PHYSICAL if row.part is None or row.part in parts)
        for name, value in (
            ("parts", parts),
            ("states", states),
            ("results", results),
            ("unit_results", (*states, *outputs, *LOCALS)),
            ("parameters", parameters),
            ("n_states", sum(v.size for v in states)),
            ("n_parameters", sum(v.size for v in parameters)),
            ("n_results", sum(v.size for v in results)),
            ("tunable", tuple(v for v in parameters if v.variability == "tunable")),
            ("columns", tuple(name for v in results for name in v.scalar_names)),
            ("scales", tuple(v.nominal / NOMINAL for v in states for _ in range(v.size))),
        ):
            object.__setattr__(self, name, value)

    @staticmethod
    def of(platform: Any) -> "Variant":
        """Variant of a platform: bristles unless `leg_friction_model` is smooth, springs if `leg_stiffness` is > 0."""
        return VARIANTS[bool(platform.leg_friction_model != SMOOTH), bool(platform.leg_stiffness > 0)]

    @property
    def words(self) -> str:
        """What such a platform has, for messages."""
        friction = "with stiction" if self.bristles else "with smooth friction"
        return f"{friction} and {'elastic legs' if self.springs else 'rigid legs'}"


# All there are, by their parts, made once: a model asks for its variant whenever it is restored.
VARIANTS = {(bristles, springs): Variant(bristles, springs) for bristles, springs in product((False, True), repeat=2)}
IDEAL = VARIANTS[False, False]
# The parameters that choose it.
CHOOSING = ("leg_friction_model", "leg_stiffness")
# Parameters of a plant whose legs slide without Coulomb friction, as a moving platform's do about its motion.
SLIDING: Mapping[str, float] = {"leg_friction_model": SMOOTH, "leg_coulomb_friction": 0.0, "leg_static_friction": 0.0}
# Of one with rigid legs.
RIGID: Mapping[str, float] = {"leg_stiffness": 0.0, "leg_damping": 0.0}


class State(NamedTuple):
    """Minimal state, 12 numbers: pose and twist of the platform frame."""

    position: Array
    """Of Op in world (..., 3) [m]."""
    orientation: Array
    """Roll, pitch, yaw about fixed X, Y, Z (..., 3) [rad]."""
    velocity: Array
    """Of Op in world (..., 3) [m/s]."""
    angular_velocity: Array
    """In world components (..., 3) [rad/s]."""

    @classmethod
    def from_vector(cls, x: Array) -> Self:
        """Split a vector x (..., 12) in SI units [m, rad, m/s, rad/s]."""
        return cls(x[..., :3], x[..., 3:6], x[..., 6:9], x[..., 9:])

    def to_vector(self) -> Array:
        """Concatenate to a vector (..., 12) in SI units [m, rad, m/s, rad/s]; leading axes broadcast."""
        return concatenate(self)


class Inputs(NamedTuple):
    """External forces: six actuators and one wrench at Op in world components."""

    actuator_force: Array  # (..., 6) [N], positive extends the leg
    external_force: Array  # (..., 3) [N]
    external_torque: Array  # (..., 3) [N m], about Op

    @classmethod
    def from_vector(cls, u: Array) -> Self:
        """Split a (..., 12) vector."""
        return cls(u[..., :6], u[..., 6:9], u[..., 9:])


def start_values(variables: Iterable[Variable], platform: object) -> dict[str, Array]:
    """Start values for a `Platform` by name, each in its shape; without computed variables, which have none."""
    starts: dict[str, Array] = {}
    for v in variables:
        if v.start is not None:
            start = getattr(platform, v.start) if isinstance(v.start, str) else v.start
            starts[v.name] = np.broadcast_to(np.asarray(start, dtype=float), v.shape)
    return starts


def pack(variables: Iterable[Variable], values: Mapping[str, Array | float]) -> NDArray[np.float64]:
    """One vector of all values, variables in table order, elements in row-major order."""
    return np.concatenate([np.asarray(values[v.name], dtype=float).reshape(-1) for v in variables])


def unpack(variables: Iterable[Variable], vector: Array) -> dict[str, Array]:
    """Inverse of `pack` over leading axes: (..., n) to one (..., *shape) array per name (views)."""
    values, at = {}, 0
    for v in variables:
        values[v.name] = vector[..., at : at + v.size].reshape((*vector.shape[:-1], *v.shape))
        at += v.size
    return values


def places(variables: Iterable[Variable]) -> dict[str, NDArray[np.intp]]:
    """Positions of the elements of variables in the vector from `pack`, by name, in the variable's shape."""
    variables = tuple(variables)
    return unpack(variables, np.arange(sum(v.size for v in variables)))


def find(name: str) -> tuple[Variable, int | None]:
    """The variable of a name, and the flat index of an element or None; an unknown name is an `InterfaceError`."""
    if not isinstance(name, str):
        raise InterfaceError(repr(name), "expected the name of a variable, a text")
    if name not in BY_NAME and name not in _ELEMENTS:
        raise InterfaceError(name, f"no such variable{nearest(name, {**BY_NAME, **_ELEMENTS})}")
    return (BY_NAME[name], None) if name in BY_NAME else _ELEMENTS[name]


def unit_text(unit: str) -> str:
    """A unit as people write it: N·m and m/s² for N.m and m/s2."""
    return re.sub(r"(?<=[a-z])[23]", lambda power: "²³"[int(power[0]) - 2], unit.replace(".", "·"))


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint for an unknown name: '; did you mean …?', or the known names."""
    names = list(known)
    for close in get_close_matches(name, names, n=1, cutoff=0.5):
        return f"; did you mean '{close}'?"
    return f"; expected one of {', '.join(k for k in names if '[' not in k)}"


def checked_value(variable: Variable, value: object) -> Array:
    """The value as a float array of the variable's shape; `InterfaceError` if it is not that of finite numbers."""
    try:
        return real_array(value, variable.shape)
    except ValueError as error:
        raise InterfaceError(variable.name, f"{error} [{variable.unit}], {variable.description}") from None


DEFAULT_TOLERANCE = 1e-8
# Below this range rounding dominates the error estimate; above it the estimate is meaningless.
TOLERANCES = (1e-13, 1e-2)
# In one communication step.
MOST_INTERNAL_STEPS = 20_000


def end_of_step(time: float, step: float, current: float) -> float:
    """End of a step from `time`, the model's `current` within rounding [s]; `StepError` for others, a step not > 0."""
    if not step > 0:
        raise StepError("step", step, current, "expected a communication step > 0 s")
    # the rounding error of a master's clock, but never a significant part of the step
    rounding = max(min(1e-9 * max(1.0, current), 1e-3 * step), 4 * math.ulp(current))
    if not abs(time - current) <= rounding:
        raise StepError("time", time, current, "expected the model's current time, since steps must be consecutive")
    end = time + step
    if not end > current:
        raise StepError("step", step, current, "too small to advance the time in double precision")
    return end
