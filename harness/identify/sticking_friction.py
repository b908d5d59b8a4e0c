"""Stiction in the rows of a log: the bristles follow from the legs' measured motion.

A bristle's deflection z depends on the sliding velocity of its own leg and on the law alone, ż = v − d(v, z) z. So the
lengths of a log give it without a simulation of the platform, and inverse dynamics stays a regression,

    F = W φ + σ0 z + σ1 ż,    z⁺ = z + (v − d z) h (1 − e^(−d h))/(d h)

with viscous friction in φ, and v and d frozen at the middle of a part of the sample, of length h: elastic displacements
and steady sliding are exact. ∂z/∂θ follows with it [model.friction; `leg_bristle` is z].
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi
import numpy as np

from gough_stewart.harness.identify.regressor import elements_of, symbols, value_of
from gough_stewart.model.friction import Bristles, bristle_decay, law_of_bristles
from gough_stewart.model.interface import RIGID, SLIDING, Variant
from gough_stewart.model.parameters import PHYSICAL, Parameters
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.vectors import FloatArray

# Parameters of the law that a log can show; presliding, and how a leg breaks away, are the platform's.
STICTION = ("leg_static_friction", "leg_stribeck_velocity")
COULOMB = "leg_coulomb_friction"
# The fields of the law in the order of a step's arguments; those beyond, and damping, are not in the decay.
_FIELDS = ("coulomb", "static", "stribeck_velocity", "stiffness", "breakaway")
_SUBSTEPS = 2
# Exponents below this are 0 [1]; relative steps of differences of the law, which is smooth.
_SMALL, _STEP = 1e-9, 1e-6
# Presliding distances of travel after which a leg slides, if the platform's are right within a factor of some.
_DISTANCES = 4.0


def sticks(platform: Platform) -> bool:
    """Whether the platform's friction sticks."""
    return Variant.of(platform).bristles


def ideal_of(platform: Platform) -> Platform:
    """The platform with rigid legs, and without stiction: the equations that are linear in parameters."""
    elements_of(platform)  # refuses legs that differ, before their values are left out
    rigid = platform.with_parameters(RIGID) if Variant.of(platform).springs else platform
    return rigid.with_parameters(SLIDING) if sticks(platform) else rigid


def resolved(platform: Platform) -> Platform:
    """The platform with its static friction as a number, if that is 0, which means Coulomb friction."""
    if not sticks(platform) or platform.leg_static_friction > 0:
        return platform
    static = StickingFriction(platform, ()).law().static / platform.leg_coulomb_friction_factor
    return platform.unchecked({STICTION[0]: float(np.mean(static))})


@dataclass(frozen=True)
class StickingFriction:
    """The friction of a platform's legs along a log, as a function of some elements of its law."""

    platform: Platform
    names: tuple[str, ...]  # (q,)

    def law(self, values: Sequence[float] | FloatArray = ()) -> Bristles:
        """The law at these values (q,), each of its fields (6,)."""
        known = dict(zip(self.names, map(float, values), strict=True))
        changed: dict[str, Any] = {row.name: getattr(self.platform, row.name) for row in PHYSICAL}
        if any(name.startswith(f"{COULOMB}[") for name in known):
            legs = [f"{COULOMB}[{k}]" for k in range(1, 7)]
            coulomb = np.array([known.get(leg, value_of(self.platform, leg)) for leg in legs])
            changed |= {COULOMB: coulomb.mean(), f"{COULOMB}_factor": coulomb / coulomb.mean()}
        changed |= {name: value for name, value in known.items() if "[" not in name}
        law = law_of_bristles(Variant.of(self.platform), Parameters(**changed))
        return Bristles(*(np.broadcast_to(np.asarray(part, dtype=float), (6,)) for part in law))

    def bent(self, values: FloatArray, velocity: FloatArray, step: float) -> FloatArray:
        """Deflections z [m] and ∂z/∂θ (j, 6, 1 + q) at rows with these velocities (j, 6) [m/s], unbent at the first."""
        law, by_values, q = self.law(values), self._law_by_values(values), len(self.names)
        X = np.zeros((6, 1 + q), order="F")
        v, after = np.zeros((6, 2), order="F"), np.zeros((6, 1 + q), order="F")
        directions = np.asfortranarray(np.concatenate([by_values[name] for name in _FIELDS], axis=0))
        of_law = np.concatenate([*(getattr(law, name) for name in _FIELDS), law.is_lugre * np.ones(6), [step]])
        buffer: Any  # its type stubs do not accept NumPy arrays
        buffer, call = _bristle_step(q).buffer()
        for k, argument in enumerate((X, v, of_law, directions)):
            buffer.set_arg(k, argument.reshape(-1, order="F").data)
        buffer.set_res(0, after.reshape(-1, order="F").data)
        bristles = np.zeros((len(velocity), 6, 1 + q))
        for k in range(len(velocity) - 1):
            v[:] = velocity[k : k + 2].T
            call()
            X[:] = bristles[k + 1] = after
        return bristles

    def force(self, values: FloatArray, velocity: FloatArray, step: float) -> FloatArray:
        """Friction without its viscous part, and its derivatives (j, 6, 1 + q) [N].

        ż is that between the rows beside, so that σ1 takes the momentum σ1 Δz, however quickly a leg breaks away.
        """
        law, by_values, bent = self.law(values), self._law_by_values(values), self.bent(values, velocity, step)
        rate = np.gradient(bent, step, axis=0)
        force = law.stiffness[:, None] * bent + law.damping[:, None] * rate
        force[..., 1:] += bent[..., :1] * by_values["stiffness"] + rate[..., :1] * by_values["damping"]
        return np.asarray(force)

    def by_lengths(self, values: FloatArray, velocity: FloatArray, step: float) -> FloatArray:
        """∂f/∂(L, L̇) (j, 6, 2) [N/m], [N s/m]: where a leg sticks that of its bristle, else the slope of the curve."""
        law, z = self.law(values), self.bent(values, velocity, step)[:, :, 0]
        moving = np.where(velocity == 0, np.finfo(float).tiny, velocity)
        elastic = np.clip(1 - bristle_decay(law, moving, z) * z / moving, 0.0, 1.0)
        slip = np.exp(-((velocity / law.stribeck_velocity) ** 2))
        slope = -2 * np.abs(velocity) / law.stribeck_velocity**2 * (law.static - law.coulomb) * slip
        return np.stack([law.stiffness * elastic, law.damping * elastic + (1 - elastic) * slope], axis=-1)

    def _law_by_values(self, values: FloatArray) -> Mapping[str, FloatArray]:
        """Derivatives (6, q) of the law's fields."""
        columns = {name: np.zeros((6, len(self.names))) for name in (*_FIELDS, "damping")}
        for k, step in enumerate(np.diag(_STEP * values)):
            above, below = self.law(values + step), self.law(values - step)
            for name, column in columns.items():
                column[:, k] = (getattr(above, name) - getattr(below, name)) / (2 * step[k])
        return columns


def unit_friction(platform: Platform, velocity: FloatArray, step: float) -> FloatArray:
    """Friction (j, 6) for unit Coulomb friction of each leg, by the platform's law."""
    friction = StickingFriction(platform, ())
    return friction.force(np.zeros(0), velocity, step)[..., 0] / friction.law().coulomb


def travel_since_reversal(velocity: FloatArray) -> FloatArray:
    """Σ |v| since each leg last changed its direction, up to each row (n, 6) [m/s times rows]."""
    travelled = np.cumsum(np.abs(velocity), axis=0)
    turns = np.zeros_like(velocity, dtype=bool)
    turns[1:] = velocity[1:] * velocity[:-1] < 0
    at_turn = np.maximum.accumulate(np.where(turns, travelled - np.abs(velocity), 0.0), axis=0)
    return np.asarray(travelled - at_turn)


def sliding_rows(platform: Platform, velocity: FloatArray, step: float) -> FloatArray:
    """1 for rows (n, 6) at which a leg has slid some presliding distances since it reversed, else 0."""
    law = StickingFriction(platform, ()).law()
    least = _DISTANCES * law.static / law.stiffness
    return np.asarray(step * travel_since_reversal(velocity) > least, dtype=float)


@cache
@interrupts_held_back()
def _bristle_step(q: int) -> casadi.Function:
    """CasADi Function: ([z, ∂z/∂θ] (6, 1+q), v at both ends (6, 2), law (36) and h, ∂law/∂θ (30, q)) -> the former."""
    X, v, p, D = (casadi.SX.sym(*size) for size in (("X", 6, 1 + q), ("v", 6, 2), ("p", 37), ("D", 30, q)))
    fields = {name: symbols(p[6 * k : 6 * k + 6]) for k, name in enumerate((*_FIELDS, "is_lugre"))}
    law = Bristles(**fields, damping=np.zeros(6), viscous=np.zeros(6))
    h = np.array([[p[36]]], dtype=object) / _SUBSTEPS

    def after(velocity: Any, z: Any, decay: Any, step: Any) -> Any:
        """Exact for constant velocity and decay."""
        x = np.array([[casadi.fmax(exponent, _SMALL) for exponent in (decay * step).reshape(-1)]], dtype=object)
        share = np.array([[-casadi.expm1(-exponent) / exponent for exponent in x.reshape(-1)]], dtype=object)
        return z + (velocity - decay * z) * step * share

    z = casadi.SX.sym("z", 6)
    bent = symbols(z)
    for part in range(_SUBSTEPS):
        share = (part + 0.5) / _SUBSTEPS
        velocity = symbols((1 - share) * v[:, 0] + share * v[:, 1])
        middle = after(velocity, bent, bristle_decay(law, velocity, bent), h / 2)
        bent = after(velocity, bent, bristle_decay(law, velocity, middle), h)
    end = casadi.vertcat(*bent.reshape(-1))
    by_values = casadi.jtimes(end, casadi.vertcat(z, p[:30]), casadi.vertcat(X[:, 1:], D)) if q else casadi.SX(6, 0)
    whole = casadi.Function("whole", [z, X, v, p, D], [casadi.horzcat(end, by_values)])(X[:, 0], X, v, p, D)
    return casadi.Function("step", [X, v, p, D], [casadi.densify(casadi.cse(whole))])
