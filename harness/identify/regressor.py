"""Names of what can be estimated; the regressor of inverse dynamics from leg lengths, F = W φ, and derivatives of F.

    platform   m, m r_G, I = J + m (r_G·r_G 1 − r_G r_Gᵀ) about Op
    legs       m2, m2 d, m1 r1, I0 = m1 r1² + J1 + J2 + m2 d², m_a: all parameters in the equations of a leg
    friction   viscous and Coulomb, of each leg

[Khalil & Dombre, Modeling, Identification and Control of Robots, 2002, ch. 12; for the legs `model.dynamics`.]
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.harness.errors import IdentificationError, LogError, MotionError
from gough_stewart.harness.identify.log import Part
from gough_stewart.harness.identify.lowpass import smoothed
from gough_stewart.harness.motion.recorded.recording import poses_of_lengths
from gough_stewart.model import interface
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics
from gough_stewart.model.friction import friction_force
from gough_stewart.model.interface import N_PARAMETERS, State, nearest
from gough_stewart.model.kinematics import (
    jacobian_of_legs,
    leg_accelerations,
    leg_geometry,
    rates_of_legs,
)
from gough_stewart.model.parameters import FACTOR_OF, PHYSICAL, TABLE, Parameters, of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.vectors import Array, FloatArray, apply, cross, dot

# Quantities of a log, not of the platform: shape and unit. Their nominal value is 0, that of a gain 1.
OF_LOGS: dict[str, tuple[tuple[int, ...], str]] = {
    "leg_length_offset": ((6,), "m"),
    "force_gain": ((6,), ""),
    "force_offset": ((6,), "N"),
    "delay": ((), "s"),
    "base_tilt": ((2,), "rad"),
}
# Shapes and units of all that may be estimated.
_KINDS = {row.name: (row.shape, row.unit) for row in PHYSICAL if not row.words} | OF_LOGS
# One value for all legs, or six.
PER_LEG = ("leg_viscous_friction", "leg_coulomb_friction")
_ELEMENT = re.compile(r"(\w+)\[(\d+)(?:,(\d+))?\]")
PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
COM = tuple(f"platform_com[{a}]" for a in (1, 2, 3))
INERTIA = tuple(f"platform_inertia[{a + 1},{b + 1}]" for a, b in PAIRS)
_OF_LEGS = ("lower_mass", "upper_mass", "lower_com", "upper_com", "lower_inertia", "upper_inertia", "armature")
# The only other parameter of the equations is the smoothing velocity of friction; these make the regressor.
_FIXED = ("base_points", "platform_points", "gravity")
INERTIAL = 10 + 5
SIZE = INERTIAL + 12
# The place of the armature in φ.
ARMATURE = INERTIAL - 1
_JOINTS = 36
assert [v.name for v in interface.PLATFORM_PARAMETERS[:2]] == ["base_points", "platform_points"]


def expanded(names: Iterable[str]) -> tuple[str, ...]:
    """The elements of these names: `platform_com` means its three, `leg_viscous_friction[1..6]` one per leg.

    For the symmetric inertia, the six with ascending indices.
    """

    def indexed(stem: str, *, is_each_leg: bool = False) -> list[str]:
        indices = product(*(range(1, n + 1) for n in ((6,) if is_each_leg else _KINDS[stem][0])))
        return [
            f"{stem}[{','.join(map(str, index))}]" if index else stem
            for index in indices
            if stem != "platform_inertia" or index[0] <= index[1]
        ]

    elements: list[str] = []
    for name in map(str.strip, names):
        stem = name.partition("[")[0]
        if stem not in _KINDS:
            raise IdentificationError(f"estimate: no parameter '{name}'{nearest(stem, _KINDS)}", [name])
        if name in (stem, f"{stem}[1..6]"):
            elements += indexed(stem, is_each_leg=name != stem and stem in PER_LEG)
        elif name in indexed(stem, is_each_leg=stem in PER_LEG):
            elements.append(name)
        else:
            raise IdentificationError(f"estimate: no element '{name}'; {stem} has {', '.join(indexed(stem))}", [name])
    twice = sorted({n for n in elements if elements.count(n) > 1 or (n in PER_LEG and f"{n}[" in "".join(elements))})
    if twice:
        raise IdentificationError(f"estimate: {', '.join(twice)} is repeated; expected every parameter once", twice)
    if not elements:
        raise IdentificationError("estimate: no names; expected parameters such as platform_mass,platform_com")
    return tuple(elements)


def place_of(element: str) -> tuple[str, tuple[int, ...]]:
    """The parameter, and the index of the element in it, from 0."""
    match = _ELEMENT.fullmatch(element)
    if match is None:
        return element, ()
    stem, *digits = match.groups()
    return stem, tuple(int(digit) - 1 for digit in digits if digit is not None)


def unit_of(element: str) -> str:
    """The unit of an element [SI]."""
    return _KINDS[element.partition("[")[0]][1]


def value_of(platform: Platform, element: str) -> float:
    """The platform's value of an element; for quantities of a log that of a perfect one."""
    stem, index = place_of(element)
    if stem in OF_LOGS:
        return 1.0 if stem == "force_gain" else 0.0
    return float(_values_of(platform, stem, index)[index])


def _values_of(platform: Platform, stem: str, index: tuple[int, ...]) -> Array:
    """The values of a parameter; of all legs if one leg's is meant."""
    return np.array(of_legs(platform, stem) if index and stem in PER_LEG else getattr(platform, stem), dtype=float)


def with_values(platform: Platform, values: Mapping[str, float]) -> Platform:
    """The platform with other values, validated again; quantities of a log are left out."""
    changed: dict[str, Any] = {}
    for element, value in values.items():
        stem, index = place_of(element)
        if stem in OF_LOGS:
            continue
        if stem not in changed:
            changed[stem] = _values_of(platform, stem, index)
        changed[stem][index] = value
        if stem == "platform_inertia":
            changed[stem][index[::-1]] = value
    return platform.with_parameters({stem: value if value.ndim else value.item() for stem, value in changed.items()})


def motion_of_lengths(
    platform: Platform, leg_length: FloatArray, leg_velocity: FloatArray, leg_acceleration: FloatArray
) -> FloatArray:
    """Pose, twist and acceleration of the platform (n, 18) from lengths, velocities and accelerations of its legs.

    [v; ω] = J⁻¹ L̇ and [v̇; ω̇] = J⁻¹ (L̈ − L |u̇|² − u·(ω×(ω×c))), since L̈ = u·P̈ + L |u̇|². Poses are continuous from
    home.
    """
    try:
        poses = poses_of_lengths(platform, leg_length)
    except MotionError as error:
        raise LogError(str(error)) from error
    legs = leg_geometry(platform, poses.position, poses.orientation)
    J = jacobian_of_legs(legs)
    twist = np.linalg.solve(J, leg_velocity[..., None])[..., 0]
    state = State(poses.position, poses.orientation, twist[:, :3], twist[:, 3:])
    rates = rates_of_legs(legs, state)
    omega = state.angular_velocity[:, None, :]
    centripetal = dot(legs.direction, cross(omega, cross(omega, legs.arm)))
    known = legs.length * dot(rates.direction_rate, rates.direction_rate) + centripetal
    a = np.linalg.solve(J, (leg_acceleration - known)[..., None])[..., 0]
    return np.concatenate([state.to_vector(), a], axis=1)


def smooth_motion(part: Part, platform: Platform, cutoff: float, every: int) -> tuple[list[FloatArray], FloatArray]:
    """Low-passed L, L̇ and L̈ (j, 6) of a part, as `smoothed`, and the motion of its platform (j, 18)."""
    lengths = [smoothed(part.length, part.step, cutoff, every, k) for k in range(3)]
    return lengths, motion_of_lengths(platform, *lengths)


def states_of(motion: Array) -> tuple[State, Acceleration]:
    """State and acceleration of motions (n, 18)."""
    return State.from_vector(motion[:, :12]), Acceleration(motion[:, 12:15], motion[:, 15:])


def elements_of(platform: Platform, names: Iterable[str] = ()) -> dict[str, float]:
    """All elements on which φ depends, and further ones such as friction of one leg, with the platform's values."""
    for name, factor in FACTOR_OF.items():
        if name not in PER_LEG and not np.array_equal(getattr(platform, factor), TABLE[factor].default):
            raise IdentificationError(
                f"{name} has six values, and legs are identified as alike; expected one: identify with their mean, "
                f"{getattr(platform, name):g} {TABLE[name].unit}",
                [name],
            )
    factors = [f"{name}_factor[{k}]" for name in PER_LEG for k in range(1, 7)]
    of_legs = [f"leg_{name}" for name in _OF_LEGS]
    every = ("platform_mass", *of_legs, *COM, *INERTIA, *PER_LEG, *factors, *names)
    return {name: value_of(platform, name) for name in every}


def is_linear(name: str, platform: Platform) -> bool:
    """Whether inverse dynamics is linear or bilinear in this element."""
    return name in elements_of(platform) or name.partition("[")[0] in PER_LEG


def with_estimated(elements: Mapping[str, Any], names: Sequence[str], values: Sequence[Any] | Array) -> dict[str, Any]:
    """The elements with some replaced, or with the friction of one leg added."""
    return {**elements, **dict(zip(names, values, strict=True))}


def linear_parameters(elements: Mapping[str, Any]) -> Array:
    """φ (SIZE,) of the elements, real or complex."""
    e = elements
    m, c = e["platform_mass"], np.array([e[name] for name in COM])
    J = [e[name] for name in INERTIA]
    I = [J[k] + m * ((c @ c) * (a == b) - c[a] * c[b]) for k, (a, b) in enumerate(PAIRS)]
    m1, m2, r1, d, J1, J2, m_a = (e[f"leg_{name}"] for name in _OF_LEGS)
    I0 = m1 * r1**2 + J1 + J2 + m2 * d**2
    # a leg's own friction replaces the common value and its factor
    friction = [e.get(f"{name}[{k}]", e[name] * e[f"{name}_factor[{k}]"]) for name in PER_LEG for k in range(1, 7)]
    return np.array([m, *(m * c), *I, m2, m2 * d, m1 * r1, I0, m_a, *friction])


def gradient(elements: Mapping[str, Any], names: Sequence[str]) -> FloatArray:
    """∂φ/∂θ (SIZE, p) for these elements, by complex steps: exact to the last digit for these polynomials."""
    step = 1e-30
    columns = np.zeros((SIZE, len(names)))
    for k, name in enumerate(names):
        columns[:, k] = linear_parameters({**elements, name: elements[name] + 1j * step}).imag / step
    return columns


def regressor(platform: Platform, motion: FloatArray) -> FloatArray:
    """W (n, 6, SIZE): the actuator forces of n motions (n, 18) for each element of φ alone, with unit parameters.

    Inverse dynamics with F = W φ; joints, gravity and the smoothing velocity of friction are the platform's.
    """
    state, _ = states_of(motion)
    fixed = np.concatenate([np.ravel(getattr(platform, name)) for name in _FIXED])
    [wrenches] = _evaluated(wrenches_function(), motion, np.tile(fixed, (len(motion), 1)))
    legs = leg_geometry(platform, state.position, state.orientation)
    columns = wrenches.reshape(len(motion), -1, 6).mT
    inertial = np.linalg.solve(jacobian_of_legs(legs).mT, columns)
    # friction acts along the actuator, only on its own leg
    friction = np.split(friction_columns(platform, rates_of_legs(legs, state).length_rate), 2, axis=-1)
    return np.concatenate([inertial, *(column[..., None] * np.eye(6) for column in friction)], axis=-1)


def friction_columns(platform: Platform, leg_velocity: FloatArray) -> FloatArray:
    """Friction of n leg velocities (n, 6) [m/s] for unit viscous and unit Coulomb friction, side by side (n, 12)."""
    alone = [friction_force(_units(platform, **{name: 1}), leg_velocity) for name in PER_LEG]
    return np.concatenate(alone, axis=-1)


@cache
@interrupts_held_back()
def wrenches_function() -> casadi.Function:
    """CasADi Function: (motion (18), joints and gravity) -> Jᵀ F for each inertial parameter alone, in order."""
    motion, fixed = casadi.SX.sym("motion", 18), casadi.SX.sym("fixed", 39)
    state, acceleration = states_of(symbols(motion))
    joints = symbols(fixed)
    base, top = (joints[:, k : k + 18].reshape(1, 6, 3) for k in (0, 18))
    places = {"base_points": base, "platform_points": top, "gravity": joints[:, 36:]}

    def wrench(**units: Any) -> Array:
        parameters = replace(_units(None, **units), **places)
        return np.asarray(inverse_dynamics(parameters, state, acceleration, solve=lambda _matrix, vector: vector)[0])

    mass, upper = wrench(platform_mass=1), wrench(leg_upper_mass=1)
    columns = [mass]
    for axis in np.eye(3):
        # with zero inertia about Op, only mass and first moment remain
        about = np.outer(axis, axis) - np.eye(3)
        columns.append(wrench(platform_mass=1, platform_com=axis, platform_inertia=about) - mass)
    for a, b in PAIRS:
        unit = np.zeros((3, 3))
        unit[a, b] = unit[b, a] = 1
        columns.append(wrench(platform_inertia=unit))
    columns += [
        upper,
        wrench(leg_upper_mass=1, leg_upper_com=1, leg_upper_inertia=-1) - upper,
        wrench(leg_lower_mass=1, leg_lower_com=1, leg_lower_inertia=-1),
        wrench(leg_lower_inertia=1),
        wrench(leg_armature=1),
    ]
    result = casadi.cse(casadi.vertcat(*(element for column in columns for element in column)))
    return casadi.Function("wrenches", [motion, fixed], [result])


def _units(platform: Platform | None, **units: Any) -> Parameters:
    """Parameters that are all 0 except these, with those of the platform that φ does not include."""
    values: dict[str, Any] = {row.name: np.zeros(row.shape) for row in PHYSICAL}
    values["leg_friction_velocity"] = 1.0
    values |= {factor: np.ones(6) for factor in FACTOR_OF.values()}
    values |= {name: getattr(platform, name) for name in (*_FIXED, "leg_friction_velocity") if platform is not None}
    values |= {name: np.asarray(value, dtype=float) for name, value in units.items()}
    return Parameters(**values)


class ForceDerivatives(NamedTuple):
    """Derivatives of the actuator forces at n motions."""

    by_legs: FloatArray  # ∂F/∂(L, L̇, L̈) (n, 6, 3, 6) [N/m], [N s/m], [kg]; the third axis is the order
    by_parameters: FloatArray  # ∂F/∂p at fixed lengths (n, 6, N_PARAMETERS)
    motion_by_legs: FloatArray  # ∂(pose, twist, acceleration)/∂(L, L̇, L̈) (n, 18, 18)


def force_derivatives(motion: FloatArray, parameters: FloatArray, force: FloatArray) -> ForceDerivatives:
    """Derivatives of inverse dynamics at n motions (n, 18) with these forces (n, 6); exact.

    Inverse dynamics from a log takes lengths, not poses: G(m, p) = Jᵀ F with m the platform's motion, which follows
    from ℓ = (L, L̇, L̈) = h(m, p). So ∂F/∂ℓ = J⁻ᵀ G_m h_m⁻¹, and ∂F/∂p = J⁻ᵀ (G_p − G_m h_m⁻¹ h_p) at fixed ℓ.
    """
    n = len(motion)
    J, G_m, G_p, h_m, h_p = _evaluated(_equations(), motion, np.tile(parameters, (n, 1)), force)
    motion_by_legs, Jt = np.asarray(np.linalg.inv(h_m), dtype=float), np.swapaxes(J, 1, 2)
    by_legs = np.asarray(np.linalg.solve(Jt, G_m @ motion_by_legs), dtype=float)
    by_parameters = np.asarray(np.linalg.solve(Jt, G_p), dtype=float)
    by_parameters[:, :, : h_p.shape[2]] -= by_legs @ h_p
    return ForceDerivatives(by_legs.reshape(n, 6, 3, 6), by_parameters, motion_by_legs)


def _evaluated(function: casadi.Function, *arguments: FloatArray) -> list[FloatArray]:
    """Results (n, rows, columns) for n rows of arguments, through buffers, which copy nothing."""
    n = len(arguments[0])
    buffer: Any  # its type stubs do not accept NumPy arrays
    buffer, call = function.map(n).buffer()
    kept = [np.ascontiguousarray(argument, dtype=float).ravel() for argument in arguments]
    results = [np.empty((n, *function.size_out(k)[::-1])) for k in range(function.n_out())]
    for k, argument in enumerate(kept):
        buffer.set_arg(k, argument.data)
    for k, result in enumerate(results):
        buffer.set_res(k, result.reshape(-1).data)
    call()
    return [result.swapaxes(1, 2) for result in results]


@cache
@interrupts_held_back()
def _equations() -> casadi.Function:
    """CasADi Function: (m (18), p, F (6)) -> J, ∂G/∂m, ∂G/∂p, ∂h/∂m, ∂h/∂joints with G = inverse dynamics − Jᵀ F."""
    m, p, F = casadi.SX.sym("m", 18), casadi.SX.sym("p", N_PARAMETERS), casadi.SX.sym("F", 6)
    state, acceleration = states_of(symbols(m))
    parameters = Parameters(**interface.unpack(interface.PLATFORM_PARAMETERS, symbols(p)))
    legs = leg_geometry(parameters, state.position, state.orientation)
    needed = inverse_dynamics(parameters, state, acceleration, solve=lambda _matrix, vector: vector)
    G = casadi.vertcat(*(needed - apply(jacobian_of_legs(legs).mT, symbols(F))).reshape(-1))
    of_legs = (legs.length, rates_of_legs(legs, state).length_rate, leg_accelerations(legs, state, *acceleration))
    h = casadi.vertcat(*np.concatenate(of_legs, axis=1).reshape(-1))
    J = casadi.vertcat(*(casadi.horzcat(*row) for row in jacobian_of_legs(legs)[0]))
    # of all parameters lengths depend on the joints only, which are the first
    by_joints = casadi.jacobian(h, p)[:, :_JOINTS]
    blocks = [J, casadi.jacobian(G, m), casadi.jacobian(G, p), casadi.jacobian(h, m), by_joints]
    # without common subexpressions: finding them takes longer than they save
    return casadi.Function("equations", [m, p, F], [casadi.densify(block) for block in blocks])


def parameter_columns(names: Sequence[str]) -> FloatArray:
    """∂p/∂θ (N_PARAMETERS, k) of the kernel's p by elements of a platform."""
    elements = [name for variable in interface.PLATFORM_PARAMETERS for name in variable.scalar_names]
    columns = np.zeros((N_PARAMETERS, len(names)))
    for j, name in enumerate(names):
        stem, index = place_of(name)
        is_of_leg = index and stem in PER_LEG
        columns[elements.index(name.replace("[", "_factor[") if is_of_leg else name), j] = 1.0
        if stem == "platform_inertia":
            columns[elements.index(f"{stem}[{index[1] + 1},{index[0] + 1}]"), j] = 1.0
    return columns


def symbols(vector: casadi.SX) -> Array:
    """A CasADi vector (n,) as an array (1, n) for the physics."""
    return np.array([casadi.vertsplit(vector)], dtype=object)
