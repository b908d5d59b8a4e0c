"""The energy balance of what a plant did, with losses by an integration of their own.

From each state that the plant reached, the motion over the next step is integrated again, with the losses as an added
state, by the laws that papers print. The plant's own states give the stored energy and, since forces are constant over
a step, the work. So what a scheme wins or loses within a step is seen, whatever it knows of the step's inside.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from gough_stewart import Platform
from gough_stewart.model.dynamics import leg_damping
from gough_stewart.model.friction import law_of_bristles
from gough_stewart.model.interface import LUGRE, Variant, size_of
from gough_stewart.model.kernel import Kernel, parameter_vector
from tests.support.arrays import FloatArray

_NO_INPUTS = np.zeros(12)


class Balance(NamedTuple):
    """Over all steps [J]."""

    gap: float  # the largest |ΔE + losses − work| up to any step
    throughput: float  # Σ |work| of each actuator, force and step
    losses: float


class _Machine:
    """A platform's equations, with what is stored and lost by the laws that papers print."""

    def __init__(self, platform: Platform) -> None:
        self.platform, self.variant = platform, Variant.of(platform)
        self.kernel, self.p = Kernel(self.variant), parameter_vector(platform, self.variant)
        self.law = law_of_bristles(self.variant, platform)

    def outputs(self, x: FloatArray, name: str) -> FloatArray:
        """Six results of this name."""
        at = self.variant.columns.index(f"{name}[1]")
        return self.kernel.outputs(x, _NO_INPUTS, self.p)[at : at + 6].copy()

    def stored(self, x: FloatArray) -> float:
        """Kinetic and potential energy, with that of springs and bristles."""
        y = self.kernel.outputs(x, _NO_INPUTS, self.p)
        found = sum(float(y[self.variant.columns.index(name)]) for name in ("kinetic_energy", "potential_energy"))
        return found + (0.5 * float((self.law.stiffness * x[12:18] ** 2).sum()) if self.variant.bristles else 0.0)

    def paths(self, x: FloatArray) -> FloatArray:
        """What the inputs act along (12,): the torque's is not needed, it is 0."""
        lengths = x[-12:-6] if self.variant.springs else self.outputs(x, "leg_length")
        return np.concatenate([lengths, x[:3], np.zeros(3)])

    def lost(self, x: FloatArray) -> float:
        """Friction less what bends the bristles, and dampers [W]."""
        rates = self.outputs(x, "leg_velocity")
        v = x[-6:] if self.variant.springs else rates
        damping = leg_damping(self.platform) if self.variant.springs else 0.0
        return float((damping * (v - rates) ** 2).sum() + self._friction(v, x))

    def _friction(self, v: FloatArray, x: FloatArray) -> float:
        law, own = self.law, self.platform
        if not self.variant.bristles:
            return float((v * (law.viscous * v + law.coulomb * np.tanh(v / own.leg_friction_velocity))).sum())
        z, at_breakaway = x[12:18], law.breakaway
        at_sliding = (law.coulomb + (law.static - law.coulomb) * np.exp(-((v / law.stribeck_velocity) ** 2))) / (
            law.stiffness
        )
        size, middle, width = np.abs(z), (at_sliding + at_breakaway) / 2, at_sliding - at_breakaway
        share = np.where(size >= at_sliding, 1.0, 0.5 + 0.5 * np.sin(np.pi * (size - middle) / width))
        share = np.where((v * z <= 0) | (size <= at_breakaway), 0.0, share)
        share = np.ones(6) if own.leg_friction_model == LUGRE else share
        bent = v * (1 - share * z * np.sign(v) / at_sliding)
        return float((law.stiffness * z * (v - bent) + law.damping * bent * v + law.viscous * v * v).sum())

    def with_losses(self, u: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Rates of (x, losses)."""
        return lambda x: np.append(self.kernel.derivatives(x[:-1], u, self.p), self.lost(x[:-1]))


def energy_balance(
    platform: Platform, states: FloatArray, inputs: FloatArray, step: float, tolerance: float = 1e-12
) -> Balance:
    """Of states (n + 1, N) at the ends of steps [s] with constant inputs (n, 12) without a torque."""
    machine = _Machine(platform)
    assert states.shape[1] == size_of(machine.variant.states)
    assert not inputs[:, 9:].any()
    sizes = np.append(machine.variant.scales, 1.0)
    stored, paths = [machine.stored(x) for x in states], [machine.paths(x) for x in states]
    gap, worst, throughput, losses = 0.0, 0.0, 0.0, 0.0
    method: Literal["LSODA", "DOP853"] = "LSODA" if machine.variant.bristles else "DOP853"
    for k, u in enumerate(inputs):
        start, rates = np.append(states[k], 0.0), machine.with_losses(u)
        solved = solve_ivp(lambda _t, x: rates(x), (0.0, step), start, method, rtol=tolerance, atol=tolerance * sizes)  # noqa: B023 - used only within this step
        end = solved.y[:, -1]
        works = u * (paths[k + 1] - paths[k])
        losses += float(end[-1])
        throughput += float(np.abs(works).sum())
        gap += stored[k + 1] - stored[k] + float(end[-1] - works.sum())
        worst = max(worst, abs(gap))
    return Balance(worst, throughput, losses)
