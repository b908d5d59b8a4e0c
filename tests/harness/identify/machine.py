"""Logs of machines that are not the model: forces by Newton–Euler, friction and sensors of their own.

Nothing here is what an identification inverts: thirteen free bodies give the forces, encoders read lengths of joints
that are not where the platform's file says, friction may be LuGre's bristles instead of a smooth sign.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.interpolate import make_interp_spline

from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.motion.excitation import Excitation
from gough_stewart.harness.motion.motion import Motion, Reference
from gough_stewart.model.dynamics import mass_matrix
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.kinematics import leg_geometry, leg_jacobian
from gough_stewart.model.platform import Platform, load_preset
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray

RATE = 1000.0
# Frictionless forces are smooth but for the ends of the fades: between those, at this rate, splines are exact to 1e-7.
_COARSE = 25.0
Friction = Callable[[FloatArray, float], FloatArray]

NOMINAL = load_preset("motion_base")
TRUE = replace(
    NOMINAL,
    platform_mass=1516.9,
    platform_com=np.array([0.05, -0.03, 0.21]),
    platform_inertia=np.array([[380.0, 12.0, -20.0], [12.0, 410.0, 8.0], [-20.0, 8.0, 690.0]]),
    leg_viscous_friction=560.0,
    leg_coulomb_friction=130.0,
)


def excitation(duration: float, seed: int = 3) -> Excitation:
    """Some motion in all coordinates, of no optimum."""
    rng = np.random.default_rng(seed)
    rows = [(0.05 * rng.standard_normal((5, 3))).tolist() for _ in range(4)]
    return Excitation(
        frequency=0.15,
        duration=duration,
        position_sine=rows[0],
        position_cosine=rows[1],
        orientation_sine=rows[2],
        orientation_cosine=rows[3],
    )


def smooth_sign(viscous: float, coulomb: float, velocity: float = 1e-3) -> Friction:
    """The friction that the model has."""
    return lambda v, _step: viscous * v + coulomb * np.tanh(v / velocity)


def lugre(viscous: float, coulomb: float, stiffness: float = 2e6) -> Friction:
    """Bristles: ż = v − σ0 |v| z/F_c, F = σ0 z + c v [Canudas de Wit et al., IEEE TAC 40(3), 1995]."""

    def force(v: FloatArray, step: float) -> FloatArray:
        z = np.zeros(6)
        found = np.empty_like(v)
        for k, now in enumerate(v):
            decay = np.exp(-stiffness * np.abs(now) * step / coulomb)
            z = z * decay + np.sign(now) * coulomb / stiffness * (1 - decay)
            found[k] = stiffness * z + viscous * now
        return found

    return force


@cache
def _prescribed(machine: Platform, duration: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Time, leg lengths, leg velocities, frictionless forces of the excitation about the nominal home pose."""
    reference = excitation(duration).about(NOMINAL)
    time = np.arange(0.0, duration, 1 / RATE)
    length, velocity = legs(machine, reference, time)
    return time, length, velocity, smooth_forces(machine, reference, time, [0.0, 1.0, duration - 1.0, duration])


def smooth_forces(machine: Platform, reference: Reference, time: FloatArray, breaks: list[float]) -> FloatArray:
    """Frictionless forces at dense times, from coarse ones by splines that break where the motion's jerk jumps."""
    found = np.empty((len(time), 6))
    for start, end in pairwise(breaks):
        coarse = np.linspace(start, end, round((end - start) * _COARSE) + 1)
        # from inside, since accelerations at the break may belong to the other side
        force = frictionless_forces(machine, reference(np.clip(coarse, start + 1e-9, end - 1e-9)))
        here = (time >= start - 1e-9) & (time <= end + 1e-9)
        found[here] = make_interp_spline(coarse, force, k=5)(time[here])
    return found


def legs(machine: Platform, reference: Reference, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lengths, and their velocities by differences of lengths either side."""
    around = [reference(time + e) for e in (0.0, 1e-6, -1e-6)]
    at, after, before = (np.asarray(leg_geometry(machine, m.position, m.orientation).length) for m in around)
    return at, (after - before) / 2e-6


def frictionless_forces(machine: Platform, motion: Motion) -> FloatArray:
    """Forces with which thirteen free bodies have the motion's accelerations: where Newton–Euler says so."""
    smooth = replace(machine, leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    n = len(motion.position)
    R, none = matrix_from_orientation(motion.orientation), np.zeros((n, 3))
    wanted = np.hstack([motion.acceleration, motion.angular_acceleration])
    # steps of any mass matrix lead there; where they end Newton–Euler alone decides
    M = mass_matrix(smooth, motion.position, motion.orientation)
    J = leg_jacobian(smooth, motion.position, motion.orientation)
    F = np.zeros((n, 6))
    for _ in range(3):
        found = newton_euler.solve(smooth, motion.position, R, motion.velocity, motion.angular_velocity, F, none, none)
        error = wanted - np.hstack([found.linear, found.angular])
        F = F + np.linalg.solve(np.swapaxes(J, 1, 2), (M @ error[..., None]))[..., 0]
    assert np.abs(error).max() < 1e-8
    return F


def machine_log(
    machine: Platform = TRUE,
    *,
    duration: float = 20.0,
    friction: Friction | None = None,
    encoder: float = 1e-6,
    force_noise: float = 0.01,
    seed: int = 0,
) -> Log:
    """What the machine records: encoders quantised and noisy, forces with noise, a share of each leg's RMS."""
    time, length, velocity, force = _prescribed(machine, duration)
    law = friction or smooth_sign(
        machine.leg_viscous_friction, machine.leg_coulomb_friction, machine.leg_friction_velocity
    )
    force = force + law(velocity, 1 / RATE)
    rng = np.random.default_rng(seed)
    if encoder:
        length = encoder * np.rint((length + encoder * rng.standard_normal(length.shape)) / encoder)
    noise = force_noise * np.sqrt((force**2).mean(axis=0))
    return Log(length, time, force + noise * rng.standard_normal(force.shape), where="machine")
