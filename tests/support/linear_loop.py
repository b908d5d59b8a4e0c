"""The loop transfer of a PID in leg space around a linearised platform, frequency by frequency from its formulas.

Sampled with a hold, an actuator lag and a delay; u = −L u. Nothing but the linearised platform is the package's.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm

import gough_stewart as gs
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True)
class LinearLoop:
    """Platform at a pose, gains of six legs, and what delays them."""

    platform: gs.Platform
    position: FloatArray
    orientation: FloatArray
    kp: FloatArray
    kd: FloatArray
    ki: FloatArray
    sample_time: float
    delay: int
    lag: float
    derivative_filter: float

    def plant(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x⁺ = A x + B u, L = C x: exact for forces held over a sample, with the lag as six more states."""
        linear = gs.linearise(
            self.platform, position=self.position, orientation=self.orientation, outputs=("leg_length",)
        )
        B = np.asarray(linear.B)[:, :6]
        n = len(B)
        whole = np.zeros((n + 12, n + 12))
        whole[:n, :n] = linear.A
        if self.lag:
            whole[:n, n : n + 6] = B
            whole[n : n + 6, n : n + 6], whole[n : n + 6, n + 6 :] = -np.eye(6) / self.lag, np.eye(6) / self.lag
        else:
            whole[:n, n + 6 :] = B
        over = expm(whole * self.sample_time)
        C = np.hstack([np.asarray(linear.C), np.zeros((6, 6))])
        return over[: n + 6, : n + 6], over[: n + 6, n + 6 :], C

    def __call__(self, z: Any) -> Any:
        """L (n, 6, 6) at these z (n,)."""
        z = np.atleast_1d(z)
        A, B, C = self.plant()
        T = self.sample_time
        s = 2 / T * (z - 1) / (z + 1)  # Tustin
        filtered = s / (self.derivative_filter * s + 1)
        K = self.kp + self.kd * filtered[:, None] + self.ki / s[:, None]
        G = C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(z), *B.shape)))
        return K[:, :, None] * G * z[:, None, None] ** -self.delay

    def at(self, frequency: Any) -> Any:
        """L (n, 6, 6) at frequencies [Hz]."""
        return self(np.exp(2j * np.pi * np.asarray(frequency) * self.sample_time))


def seen(L: Any, a: FloatArray, b: FloatArray) -> Any:
    """L of one channel with the others closed, from forces a (6,) to the measure b (6,): 1/(b S a) − 1."""
    return 1 / (np.linalg.solve(np.eye(6) + L, a) @ b) - 1
