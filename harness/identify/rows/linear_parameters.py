"""The parameters φ in which inverse dynamics is linear, F = W φ, as functions of a platform's parameters.

    platform   m, m r_G, I = J + m (r_G·r_G 1 − r_G r_Gᵀ) about Op
    legs       m2, m2 d, m1 r1, I0 = m1 r1² + J1 + J2 + m2 d², m_a: all parameters in the equations of a leg
    friction   viscous and Coulomb, of each leg

[Khalil & Dombre, Modeling, Identification and Control of Robots, 2002, ch. 12; for the legs `model.dynamics`.]
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import casadi
import numpy as np
from scipy.linalg import qr

from gough_stewart.harness.identify.names import value_of
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics
from gough_stewart.model.friction import friction_force
from gough_stewart.model.kinematics import jacobian_of_legs, leg_geometry, rates_of_legs
from gough_stewart.model.parameters import PHYSICAL, Parameters
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.state import State
from gough_stewart.model.vectors import Array, FloatArray, transpose

# Below this share of the largest, what is left of a column is rounding.
_ROUNDING = 1e-9

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_SCALARS = (
    "platform_mass",
    "leg_lower_mass",
    "leg_upper_mass",
    "leg_lower_com",
    "leg_upper_com",
    "leg_lower_inertia",
    "leg_upper_inertia",
    "leg_armature",
)
COM = tuple(f"platform_com[{a}]" for a in (1, 2, 3))
INERTIA = tuple(f"platform_inertia[{a + 1},{b + 1}]" for a, b in PAIRS)
FRICTION = ("leg_viscous_friction", "leg_coulomb_friction")
# The only other parameter of the equations is the smoothing velocity of friction; these make the regressor.
_FIXED = ("base_points", "platform_points", "gravity")
INERTIAL = 10 + 5
SIZE = INERTIAL + 12
# The place of the armature in φ.
ARMATURE = INERTIAL - 1


def elements_of(platform: Platform) -> dict[str, float]:
    """All elements on which φ depends, with the platform's values."""
    factors = [f"{name}_factor[{k}]" for name in FRICTION for k in range(1, 7)]
    return {name: value_of(platform, name) for name in (*_SCALARS, *COM, *INERTIA, *FRICTION, *factors)}


def linear_parameters(elements: Mapping[str, Any]) -> Array:
    """φ (SIZE,) of the elements, real or complex."""
    e = elements
    m, c = e["platform_mass"], np.array([e[name] for name in COM])
    J = [e[name] for name in INERTIA]
    I = [J[k] + m * ((c @ c) * (a == b) - c[a] * c[b]) for k, (a, b) in enumerate(PAIRS)]
    m1, m2, r1, d = (e[f"leg_{name}"] for name in ("lower_mass", "upper_mass", "lower_com", "upper_com"))
    I0 = m1 * r1**2 + e["leg_lower_inertia"] + e["leg_upper_inertia"] + m2 * d**2
    # a leg's own friction replaces the common value and its factor
    friction = [
        e[own] if (own := f"{name}[{k}]") in e else e[name] * e[f"{name}_factor[{k}]"]
        for name in FRICTION
        for k in range(1, 7)
    ]
    return np.array([m, *(m * c), *I, m2, m2 * d, m1 * r1, I0, e["leg_armature"], *friction])


def with_estimated(elements: Mapping[str, Any], names: Sequence[str], values: Sequence[Any] | Array) -> dict[str, Any]:
    """The elements with some replaced, or with the friction of one leg added."""
    return {**elements, **dict(zip(names, values, strict=True))}


def gradient(elements: Mapping[str, Any], names: Sequence[str]) -> FloatArray:
    """∂φ/∂θ (SIZE, p) for these elements, by complex steps: exact to the last digit for these polynomials."""
    step = 1e-30
    values = [elements[name] for name in names]
    columns = []
    for k in range(len(names)):
        moved = [v + (1j * step if i == k else 0) for i, v in enumerate(values)]
        columns.append(linear_parameters(with_estimated(elements, names, moved)).imag / step)
    return np.stack(columns, axis=1) if columns else np.zeros((SIZE, 0))


def regressor(platform: Platform, state: State, acceleration: Acceleration) -> FloatArray:
    """W (n, 6, SIZE): the actuator forces of n states for each element of φ alone, with unit parameters.

    Inverse dynamics with F = W φ; joints, gravity and the smoothing velocity of friction are the platform's.
    """
    motion = np.concatenate([state.to_vector(), *acceleration], axis=1)
    fixed = [np.ravel(getattr(platform, name)) for name in _FIXED]
    columns = np.array(_wrenches_function()(motion.T, np.concatenate(fixed))).T.reshape(len(motion), -1, 6)
    legs = leg_geometry(platform, state.position, state.orientation)
    inertial = np.linalg.solve(transpose(jacobian_of_legs(legs)), transpose(columns))
    # friction acts along the actuator, only on its own leg
    rates = rates_of_legs(legs, state).length_rate
    alone = np.split(friction_columns(platform, rates), 2, axis=-1)
    return np.concatenate([inertial, *(part[..., None] * np.eye(6) for part in alone)], axis=-1)


def friction_columns(platform: Platform, leg_velocity: FloatArray) -> FloatArray:
    """Friction of n leg velocities (n, 6) [m/s] for unit viscous and unit Coulomb friction, side by side (n, 12)."""
    alone = [friction_force(_units(platform, **{name: 1}), leg_velocity) for name in FRICTION]
    return np.concatenate(alone, axis=-1)


@cache
@interrupts_held_back()
def _wrenches_function() -> casadi.Function:
    """CasADi Function: (motion (18), joints and gravity) -> Jᵀ F for each inertial parameter alone, in order."""
    motion, fixed = casadi.SX.sym("motion", 18), casadi.SX.sym("fixed", 39)
    numbers = np.array([casadi.vertsplit(motion)], dtype=object)
    state, acceleration = State.from_vector(numbers[:, :12]), Acceleration(numbers[:, 12:15], numbers[:, 15:])
    joints = np.array([casadi.vertsplit(fixed)], dtype=object)
    places = {
        "base_points": joints[:, :18].reshape(1, 6, 3),
        "platform_points": joints[:, 18:36].reshape(1, 6, 3),
        "gravity": joints[:, 36:],
    }

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
    columns.append(upper)
    columns.append(wrench(leg_upper_mass=1, leg_upper_com=1, leg_upper_inertia=-1) - upper)
    columns.append(wrench(leg_lower_mass=1, leg_lower_com=1, leg_lower_inertia=-1))
    columns.append(wrench(leg_lower_inertia=1))
    columns.append(wrench(leg_armature=1))
    result = casadi.cse(casadi.vertcat(*(element for column in columns for element in column)))
    return casadi.Function("wrenches", [motion, fixed], [result])


def _units(platform: Platform | None, **units: Any) -> Parameters:
    """Parameters that are all 0 except these, with those of the platform that φ does not include."""
    values: dict[str, Any] = {row.name: np.zeros(row.shape) for row in PHYSICAL}
    values["leg_friction_velocity"] = 1.0
    values |= {f"{name}_factor": np.ones(6) for name in FRICTION}
    values |= {name: getattr(platform, name) for name in (*_FIXED, "leg_friction_velocity") if platform is not None}
    values |= {name: np.asarray(value, dtype=float) for name, value in units.items()}
    return Parameters(**values)


def dependences(columns: FloatArray, names: Sequence[str]) -> tuple[list[str], str]:
    """Elements whose columns (n, p) are combinations of the others', by QR with pivots, and what that means in words.

    Columns are to be of similar size.
    """
    R, pivots = qr(columns, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(R))
    rank = int((diagonal > _ROUNDING * diagonal[0]).sum())
    dependent = [names[k] for k in pivots[rank:]]
    base = np.linalg.solve(R[:rank, :rank], R[:rank, rank:])
    texts = []
    for j, name in enumerate(dependent):
        parts = [names[pivots[i]] for i in range(rank) if abs(base[i, j]) > 1e-6]
        texts.append(f"{name} has the same effect as a combination of {', '.join(parts)}")
    return dependent, "; ".join(texts)
