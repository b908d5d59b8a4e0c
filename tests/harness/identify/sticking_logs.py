"""Logs of a machine whose friction sticks: forces of a Lagrangian, bristles by small steps of the published law."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.interpolate import make_interp_spline

from gough_stewart import Log, Platform
from tests.harness.identify.machine_logs import MACHINE, Swing
from tests.support.arrays import FloatArray
from tests.support.lagrangian import forces_along, legs_along

RATE = 500.0  # of logs [Hz]
_COARSE = 100.0
_PARTS = 8  # steps of the bristles in a sample
# Each leg has its own friction; their mean is 1.
LEGS = np.array([1.0, 1.2, 0.9, 1.1, 1.1, 0.7])


@dataclass(frozen=True)
class Law:
    """What the fit must find; `is_lugre` leaves out the elastic range, an infinite stiffness presliding."""

    coulomb: float = 100.0  # mean of the legs [N]
    static: float = 150.0
    stribeck_velocity: float = 5e-3  # [m/s]
    stiffness: float = 1e7  # [N/m]
    damping: float = 4e4  # [N s/m]
    breakaway_share: float = 0.8
    is_lugre: bool = False

    def rate(self, z: FloatArray, v: FloatArray) -> FloatArray:
        """Rate ż of Dupont et al. (2002), eqs. (8)–(11), or of Canudas de Wit et al. (1995), eq. (3), for six legs."""
        ss, ba = self._level(v) / self.stiffness, self.breakaway_share * self.coulomb * LEGS / self.stiffness
        size = np.abs(z)
        blend = 0.5 + 0.5 * np.sin(np.pi * (size - (ss + ba) / 2) / (ss - ba))
        alpha = np.where(size <= ba, 0.0, np.where(size >= ss, 1.0, blend))
        alpha = np.where(np.sign(z) == np.sign(v), alpha, 0.0)
        if self.is_lugre:
            alpha = np.ones(6)
        return v - alpha * np.abs(v) * z / ss

    def _level(self, v: FloatArray) -> FloatArray:
        """g(v) [N]."""
        return LEGS * (self.coulomb + (self.static - self.coulomb) * np.exp(-((v / self.stribeck_velocity) ** 2)))

    def bent(self, velocity: FloatArray, step: float) -> FloatArray:
        """Deflections (n, 6) [m] for velocities (n, 6) that are linear from row to row, unbent at first."""
        z, found, h = np.zeros(6), np.zeros_like(velocity), step / _PARTS
        for k in range(len(velocity) - 1):
            for part in range(_PARTS):
                v = velocity[k] + (velocity[k + 1] - velocity[k]) * (part + 0.5) / _PARTS
                z = z + h * self.rate(z + h / 2 * self.rate(z, v), v)
            found[k + 1] = z
        return found

    def force(self, velocity: FloatArray, step: float) -> FloatArray:
        """Friction but for its viscous part (n, 6) [N]."""
        if np.isinf(self.stiffness):
            return np.asarray(np.sign(velocity) * self._level(velocity))
        z = self.bent(velocity, step)
        return np.asarray(self.stiffness * z + self.damping * np.gradient(z, step, axis=0))


# Slow enough that legs take a tenth of a second to break away, with many reversals.
SLOW = Swing(seed=5, frequency=0.1, size=0.003)


def sticking_log(
    law: Law = Law(), swing: Swing = SLOW, duration: float = 10.0, *, noise: float = 0.003, seed: int = 0
) -> Log:
    """What the machine records: forces with noise, a share of each leg's RMS, and encoders of 0.3 µm."""
    time, length, force = _exact(law, swing, duration)
    rng = np.random.default_rng(seed)
    force = force + noise * np.sqrt((force**2).mean(axis=0)) * rng.standard_normal(force.shape)
    return Log(length + 3e-7 * rng.standard_normal(length.shape), time, force, where="machine")


@cache
def _exact(law: Law, swing: Swing, duration: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    machine: Platform = replace(MACHINE, leg_coulomb_friction=0.0)
    time = np.arange(round(duration * RATE)) / RATE
    coarse = np.arange(-0.05, duration + 0.05 + 1 / _COARSE, 1 / _COARSE)
    smooth = make_interp_spline(coarse, forces_along(machine, swing.along(machine, coarse, duration)), k=5)(time)
    length, velocity = legs_along(machine, swing.along(machine, time, duration))
    return time, length, smooth + machine.leg_viscous_friction * velocity + law.force(velocity, 1 / RATE)
