"""The sampled loop written a second time, from docs/loop.md alone: an expectation for what its options do together.

Plant, legs and inverse dynamics are those of `tests.support.lagrangian`, integrated by Runge and Kutta's method in many
small steps; motions, controllers and drives are stated here as formulas of one channel. Nothing of the harness is used.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter

from gough_stewart import Platform
from tests.support.lagrangian import Pose, equations_at, forces_along, legs_along

FloatArray = NDArray[np.float64]


class Documented(SimpleNamespace):
    """What a run should record, (n, 6) with a row per plant step; `wanted` of the motion by the nominal platform."""

    # What acts from the row on: rate of the twist, force, wrench; `target` of the drives, `reached` after its step.
    # Of the latest sample: `command` before the limits, `feedforward`, `injection`, `reading` of leg lengths.


def simulate(
    options: Mapping[str, Any],
    believed: Platform,
    machine: Callable[[float], Platform],
    start: FloatArray | None,
    readings: FloatArray | None = None,
    samples: Sequence[int] | None = None,
) -> Documented:
    """Run the loop of some options: SI numbers under the names of the experiment file, without their tables."""
    # `machine` is simulated at each time, from rest in a pose (6,) or the reference's; `readings` of noisy lengths are
    # of each row (n, 6); jitter delays the rows `samples` of the controller's samples
    options = with_gains(options, believed)
    T, h, duration = options["sample_time"], options["plant_step"], options["duration"]
    every, steps = round(T / h), round(duration / h)
    sample_of = {row: j for j, row in enumerate(range(0, steps, every) if samples is None else samples)}
    home = np.concatenate([believed.home_position, believed.home_orientation])
    motion = motion_of(options, home if options["about"] is None else options["about"])
    q, rate = (each[0] for each in motion(np.zeros(1))[:2])
    J_first = jacobian(believed, q)
    if start is not None:
        q, rate = start.copy(), np.zeros(6)
    held = static_forces(machine(0.0), q)
    limit, change = options["force_limit"], options["rate_limit"] * T
    drive = _Drive(np.clip(held, -limit, limit), h, options["rate_limit"], options["lag"])
    line = [drive.force] * options["delay"]
    law: PidLaw | None = None
    excess, planned = np.zeros(6), drive.force
    command, reading, used, planned_force, injected = (np.zeros(6) for _ in range(5))
    rows: list[dict[str, FloatArray]] = []
    force = drive.force
    for k in range(steps + 1):
        machine_now, wrench = machine(k * h), options["disturbance"](k * h)
        length, velocity = (each[0] for each in legs_along(machine_now, Pose(q[None], rate[None], rate[None])))
        if k in sample_of if options["sensor_time"] is None else k % round(options["sensor_time"] / h) == 0:
            step = options["quantisation"]
            reading = np.round(length / step) * step if step else length
        if readings is not None:
            reading = readings[k]
        if k in sample_of:
            used = reading
            # a late sample takes itself to be in time
            nominal = sample_of[k] * T
            at, ahead = (motion(np.array([nominal + later])) for later in (0.0, (options["delay"] + 0.5) * T))
            J, aim = jacobian(believed, at.q[0]), legs_along(believed, at)[0][0]
            law = law or PidLaw(options, J, aim, reading)
            planned_force, injected = feedforward(options, believed, ahead), options["injection"](nominal, J_first)
            command = law.force(J, aim, reading, excess) + planned_force + injected
            clipped = np.clip(command, -limit, limit)
            # the anti-windup hears what force and rate limits leave of this command after one sample
            planned = planned + np.clip(clipped - planned, -change, change)
            excess = planned - command
            line.append(clipped)
            target = line.pop(0)
        if k < steps:
            force = drive.step(target)
        acceleration = _rate_of_twist(q, rate, accelerations(machine_now, q, rate, force, wrench))
        rows.append(
            {
                **{"pose": q, "twist": twist_of_rates(q) @ rate, "acceleration": acceleration},
                **{"leg_length": length, "leg_velocity": velocity, "actuator_force": force, "wrench": wrench},
                **{"target": target, "reached": drive.r, "command": command, "feedforward": planned_force},
                **{"injection": injected, "reading": used},
            }
        )
        if k < steps:
            q, rate = stepped(machine_now, q, rate, force, wrench, h)
    wanted = motion(h * np.arange(steps + 1))
    wanted_length, wanted_velocity = legs_along(believed, wanted)
    return Documented(
        **{name: np.array([row[name] for row in rows]) for name in rows[0]},
        wanted=wanted.q,
        wanted_twist=np.array([twist_of_rates(q) @ rate for q, rate in zip(*wanted[:2], strict=True)]),
        wanted_acceleration=np.array([_rate_of_twist(*each) for each in zip(*wanted, strict=True)]),
        wanted_length=wanted_length,
        wanted_velocity=wanted_velocity,
    )


def motion_of(options: Mapping[str, Any], home: FloatArray) -> Callable[[FloatArray], Pose]:
    """A sine, a quintic from rest to rest, or a step along (6,); scaled: pose₀ + a (pose(t/s) − pose₀)."""
    slower, larger = options.get("scales", (1.0, 1.0))
    along = larger * options["along"]
    kind = options["reference"]

    def at(real_time: FloatArray) -> Pose:
        time = real_time / slower
        if kind == "sine":
            w, phase = 2 * np.pi * options["frequency"], options["phase"]
            s = np.sin(w * time + phase), w * np.cos(w * time + phase), -(w**2) * np.sin(w * time + phase)
        elif kind == "point_to_point":
            D = options["move_duration"]
            tau = np.clip((time - options["at"]) / D, 0.0, 1.0)
            s = (
                10 * tau**3 - 15 * tau**4 + 6 * tau**5,
                (30 * tau**2 - 60 * tau**3 + 30 * tau**4) / D,
                (60 * tau - 180 * tau**2 + 120 * tau**3) / D**2,
            )
        else:
            # a row at the time of the jump has the value after it
            s = (time >= options["at"] - 1e-9).astype(float), 0 * time, 0 * time
        q, rate, acceleration = (np.outer(each / slower**k, along) for k, each in enumerate(s))
        return Pose(home + q, rate, acceleration)

    return at


def with_gains(options: Mapping[str, Any], believed: Platform) -> dict[str, Any]:
    """The options with kp = m ω², kd = 2 ζ m ω, ki = kp/Ti; m of the heaviest mode of the legs, or of each axis."""
    if options["bandwidth"] is None:
        return dict(options)
    home = np.concatenate([believed.home_position, believed.home_orientation])
    at_rest = np.tile(home, (7, 1)), np.zeros((7, 6))
    needed = forces_along(believed, Pose(*at_rest, np.vstack([np.zeros(6), np.eye(6)])))
    # F = K q̈ + F₀, and L̈ = J E q̈ at rest, with E from rates of angles to twists
    K = (needed[1:] - needed[0]).T
    J, E = jacobian(believed, home), twist_of_rates(home)
    of_legs = K @ np.linalg.inv(J @ E)
    of_axes = J.T @ K @ np.linalg.inv(E)
    heaviest = np.full(6, np.linalg.eigvalsh((of_legs + of_legs.T) / 2).max())
    m = np.diag(of_axes) if options["space"] == "task" else heaviest
    w = 2 * np.pi * options["bandwidth"]
    kp = m * w**2
    ki = kp / options["integral_time"] if options["type"] == "pid" else 0 * kp
    return {**options, "kp": kp, "kd": 2 * options["damping_ratio"] * m * w, "ki": ki}


class PidLaw:
    """Six PID channels, of axes or legs: w = kp e + kd s/(Tf s + 1) v + x, ẋ = ki e + excess/Tt; v = e, or −y."""

    # of axes e = J⁻¹ (L_r − L), y = Σ J⁻¹ ΔL, F = J⁻ᵀ w, and the excess of forces is Jᵀ times that; of legs J is 1

    def __init__(self, options: Mapping[str, Any], J: FloatArray, wanted: FloatArray, measured: FloatArray) -> None:
        self.options, self.T = options, options["sample_time"]
        self.kp, self.kd, self.ki = (np.array(options[name]) for name in ("kp", "kd", "ki"))
        # of the fastest channel: the shortest kd / (20 kp)
        self.Tf = options["derivative_filter"] or float((self.kd / self.kp).min() / 20)
        with np.errstate(divide="ignore", invalid="ignore"):
            own = np.sqrt((self.kp / self.ki) * (self.kd / self.kp))
        self.Tt = np.full(6, options["anti_windup_time"]) if options["anti_windup_time"] else own
        self.moved, self.x, self.w = np.zeros((3, 6))
        self.settle(J, wanted, measured)

    def settle(self, J: FloatArray, wanted: FloatArray, measured: FloatArray) -> None:
        """Let derivative and notch rest in a measurement, as at first and after a gap; the integral stays."""
        self.last = measured.copy()
        self.v = self._inputs(J, wanted, measured)[1]
        self.d, self.z = np.zeros(6), self.Tf * self.v
        self.notch = _Notch(self.options["notch"], self.T) if self.options.get("notch") else None

    def _of_channels(self, J: FloatArray) -> FloatArray:
        return J if self.options["space"] == "task" else np.eye(6)

    def _inputs(self, J: FloatArray, wanted: FloatArray, measured: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The errors, and what is differentiated."""
        of_channels = self._of_channels(J)
        self.moved = self.moved + _solved(of_channels, measured - self.last)
        self.last = measured.copy()
        e = _solved(of_channels, wanted - measured)
        return e, e if self.options["derivative_on"] == "error" else -self.moved

    def force(self, J: FloatArray, wanted: FloatArray, measured: FloatArray, excess: FloatArray) -> FloatArray:
        """Forces (6,)."""
        T, Tf, kd, method = self.T, self.Tf, self.kd, self.options["discretisation"]
        e, v = self._inputs(J, wanted, measured)
        of_channels = self._of_channels(J)
        back = np.where(self.ki > 0, of_channels.T @ excess / np.where(self.ki > 0, self.Tt, 1.0), 0.0)
        w = self.ki * e + back
        if method == "tustin":
            self.d = ((2 * Tf - T) * self.d + 2 * kd * (v - self.v)) / (2 * Tf + T)
            self.x = self.x + T / 2 * (w + self.w)
        elif method == "backward_diff":
            self.d = (Tf * self.d + kd * (v - self.v)) / (Tf + T)
            self.x = self.x + T * w
        else:  # inputs held over the sample: the states move after they were used
            self.d = kd / Tf * (v - self.z / Tf)
            self.z = np.exp(-T / Tf) * self.z + Tf * (1 - np.exp(-T / Tf)) * v
            self.x = self.x + T * self.w
        self.v, self.w = v, w
        u = self.kp * e + self.d + self.x
        at_once = {"tustin": T / 2, "backward_diff": T, "zoh": 0.0}[method] * back
        return _solved(of_channels.T, u if self.notch is None else self.notch(u, u - at_once))


class _Notch:
    """(s² + 2 d ζ ω s + ω²) / (s² + 2 ζ ω s + ω²) by s = K (1 − z⁻¹)/(1 + z⁻¹), K = ω/tan(ω T/2)."""

    # begins at rest in its first input, without what limits have cut off of that

    def __init__(self, values: tuple[float, float, float], T: float) -> None:
        frequency, damping, depth = values
        w = 2 * np.pi * frequency
        K = w / np.tan(w * T / 2)
        self.b, self.a = (
            np.array([K**2 + 2 * g * w * K + w**2, 2 * w**2 - 2 * K**2, K**2 - 2 * g * w * K + w**2])
            for g in (depth * damping, damping)
        )
        self.past: FloatArray | None = None  # inputs and outputs of the last two samples (2, 2, 6)

    def __call__(self, u: FloatArray, unlimited: FloatArray) -> FloatArray:
        b, a = self.b, self.a
        if self.past is None:  # its gain at rest is 1
            self.past = np.array([[unlimited] * 2] * 2)
        (u1, u2), (y1, y2) = self.past
        y = np.asarray((b[0] * u + b[1] * u1 + b[2] * u2 - a[1] * y1 - a[2] * y2) / a[0])
        self.past = np.array([[u, u1], [y, y1]])
        return y


def feedforward(options: Mapping[str, Any], believed: Platform, ahead: Pose) -> FloatArray:
    """Of the nominal model at the middle of the interval over which the force acts."""
    if options["feedforward"] == "none":
        return np.zeros(6)
    if options["feedforward"] == "gravity":
        return static_forces(believed, ahead.q[0])
    return np.asarray(forces_along(believed, ahead)[0] + friction_of(believed, legs_along(believed, ahead)[1][0]))


class _Drive:
    """A rate limit and a first-order lag, by many small steps of their differential equations."""

    PARTS = 4000

    def __init__(self, start: FloatArray, h: float, rate: float, lag: float) -> None:
        self.r, self.f, self.force = start.copy(), start.copy(), start.copy()
        self.h, self.rate, self.lag = h, rate, lag

    def step(self, target: FloatArray) -> FloatArray:
        """The mean force over a plant step."""
        if not np.isfinite(self.rate) and self.lag == 0:
            return target
        dt = self.h / self.PARTS
        t = dt * np.arange(self.PARTS + 1)[:, None]
        left = np.zeros(6)
        if np.isfinite(self.rate):
            left = np.maximum(np.abs(target - self.r) - self.rate * t, 0.0)
        r = np.broadcast_to(target - np.sign(target - self.r) * left, (self.PARTS + 1, 6))
        self.r = r[-1].copy()
        if self.lag == 0:
            return np.asarray(((r[1:] + r[:-1]) / 2).mean(axis=0))
        # exact for an input that is constant over a small step
        decay = np.exp(-dt / self.lag)
        later = lfilter([1 - decay], [1, -decay], (r[1:] + r[:-1]) / 2, axis=0, zi=decay * self.f[None])[0]
        f = np.vstack([self.f, later])
        self.f = f[-1].copy()
        return np.asarray(((f[1:] + f[:-1]) / 2).mean(axis=0))


def friction_of(machine: Platform, velocity: FloatArray) -> FloatArray:
    """As documented: c_i L̇ + C_i tanh(L̇/v_s)."""
    viscous = machine.leg_viscous_friction * machine.leg_viscous_friction_factor
    coulomb = machine.leg_coulomb_friction * machine.leg_coulomb_friction_factor
    return np.asarray(viscous * velocity + coulomb * np.tanh(velocity / machine.leg_friction_velocity))


def static_forces(machine: Platform, q: FloatArray) -> FloatArray:
    rest = np.zeros((1, 6))
    return np.asarray(forces_along(machine, Pose(q[None], rest, rest))[0])


def jacobian(machine: Platform, q: FloatArray) -> FloatArray:
    """∂L̇/∂(v, ω): lengths' rates for six unit rates of the pose, with the angles' rates turned into ω."""
    rates = np.eye(6)
    by_angles = legs_along(machine, Pose(np.tile(q, (6, 1)), rates, rates))[1].T
    return np.asarray(by_angles @ np.linalg.inv(twist_of_rates(q)))


def twist_of_rates(q: FloatArray) -> FloatArray:
    """(6, 6): velocity and ω from the rates of position, roll, pitch, yaw about the fixed axes X, Y, Z."""
    pitch, yaw = q[4], q[5]
    about_x = [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)]
    E = np.eye(6)
    E[3:, 3:] = np.transpose([about_x, [-np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    return E


def _rate_of_twist(q: FloatArray, rate: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Linear and angular acceleration (6,): E q̈ + Ė q̇, with Ė by a central difference."""
    d = 1e-5
    change = (twist_of_rates(q + d * rate) - twist_of_rates(q - d * rate)) / (2 * d)
    return np.asarray(twist_of_rates(q) @ acceleration + change @ rate)


def accelerations(
    machine: Platform, q: FloatArray, rate: FloatArray, force: FloatArray, wrench: FloatArray
) -> FloatArray:
    """q̈ (6,) from M q̈ + h = (∂L/∂q)ᵀ (F − friction) + Eᵀ w, with E of `twist_of_rates`."""
    M, h, by_angles = equations_at(machine, q, rate)
    sliding_force = force - friction_of(machine, by_angles @ rate)
    return _solved(M, by_angles.T @ sliding_force + twist_of_rates(q).T @ wrench - h)


def stepped(
    machine: Platform, q: FloatArray, rate: FloatArray, force: FloatArray, wrench: FloatArray, h: float
) -> tuple[FloatArray, FloatArray]:
    """Pose and rates after a plant step, forces held, in parts of about 0.5 ms."""
    parts = max(1, round(h / 5e-4))
    dt = h / parts
    x = np.concatenate([q, rate])

    def slope(x: FloatArray) -> FloatArray:
        return np.concatenate([x[6:], accelerations(machine, x[:6], x[6:], force, wrench)])

    for _ in range(parts):
        a = slope(x)
        b = slope(x + dt / 2 * a)
        c = slope(x + dt / 2 * b)
        d = slope(x + dt * c)
        x = x + dt / 6 * (a + 2 * b + 2 * c + d)
    return x[:6], x[6:]


def _solved(A: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(A, b), dtype=float)


@dataclass
class DocumentedLoop:
    """The loop of some options at rest in a pose, opened at the actuators: u = −L u."""

    options: Mapping[str, Any]
    jacobian: FloatArray  # ∂L̇/∂(v, ω) (6, 6)
    plant: tuple[FloatArray, FloatArray, FloatArray]  # x⁺ = A x + B u, lengths C x; with the lags of the drives
    channel: tuple[FloatArray, ...]  # b, p, d, i, each (6,): kp + b (z − 1)/(z − p) + d + i/(z − 1)

    def response(self, omega: FloatArray) -> FloatArray:
        """L (n, 6, 6) at frequencies [rad/s]: J⁻ᵀ K(z) J⁻¹ C (z − A)⁻¹ B z⁻ᵈ, without J in leg space."""
        A, B, C = self.plant
        z = np.exp(1j * omega * self.options["sample_time"])[:, None]
        poles, modes = np.linalg.eig(A)
        P = ((C @ modes)[None] / (z - poles)[:, None]) @ np.linalg.solve(modes, B)
        b, p, d, i = self.channel
        with np.errstate(divide="ignore", invalid="ignore"):
            integral = np.where(i > 0, d + i / (z - 1), 0.0)
        K = (self.options["kp"] + b * (z - 1) / (z - p) + integral)[:, :, None] * np.eye(6)
        if self.options["space"] == "task":
            inverse = np.linalg.inv(self.jacobian)
            K = inverse.T @ K @ inverse
        return np.asarray(K @ P * (z ** -self.options["delay"])[:, :, None])

    def poles(self, factors: FloatArray) -> FloatArray:
        """Eigenvalues z of the closed loop, with factors (6,) on the forces of the six legs."""
        (A, B, C), (b, p, d, i) = self.plant, self.channel
        n, delay, task = len(A), self.options["delay"], self.options["space"] == "task"
        inverse = np.linalg.inv(self.jacobian) if task else np.eye(6)
        on = np.flatnonzero(i > 0)
        # states: plant, filters, integrators, commands on their way
        f, x, w = n, n + 6, n + 6 + len(on)
        whole = np.zeros((w + 6 * delay, w + 6 * delay))
        seen = np.zeros((6, len(whole)))
        seen[:, :n] = -inverse @ C
        force = (np.asarray(self.options["kp"]) + b + np.where(i > 0, d, 0.0))[:, None] * seen
        force[:, f:x] += np.diag(b * (p - 1))
        force[on, x + np.arange(len(on))] += 1.0
        force = factors[:, None] * (inverse.T @ force)
        whole[:n, :n] = A
        whole[f:x] = seen
        whole[f:x, f:x] += np.diag(p)
        whole[x:w] = i[on, None] * seen[on]
        whole[x:w, x:w] += np.eye(len(on))
        if delay:
            whole[w : w + 6] = force
            whole[w + 6 :, w:-6] = np.eye(6 * (delay - 1))
            whole[:n, -6:] += B
        else:
            whole[:n] += B @ force
        return np.asarray(np.linalg.eigvals(whole))


def linear(options: Mapping[str, Any], believed: Platform, q: FloatArray) -> DocumentedLoop:
    """The loop at rest about a pose q (6,), with its drives, by differences of the Lagrangian's accelerations."""
    machine = replace(believed, leg_coulomb_friction=0.0)
    held, h = static_forces(machine, q), 1e-5

    def slope(of: Callable[[FloatArray], FloatArray], size: float, n: int) -> FloatArray:
        return np.stack([(of(size * e) - of(-size * e)) / (2 * size) for e in np.eye(n)], axis=1)

    def rates(x: FloatArray) -> FloatArray:
        return accelerations(machine, q + x[:6], x[6:], held, np.zeros(6))

    A, B = np.zeros((12, 12)), np.zeros((12, 6))
    A[:6, 6:], A[6:] = np.eye(6), slope(rates, h, 12)
    B[6:] = slope(lambda u: accelerations(machine, q, np.zeros(6), held + u, np.zeros(6)), 1.0, 6)
    C = np.zeros((6, 12))
    C[:, :6] = slope(lambda x: legs_along(machine, Pose((q + x)[None], *np.zeros((2, 1, 6))))[0][0], h, 6)
    T, tau = options["sample_time"], options["lag"]
    if tau > 0:
        A = np.block([[A, B], [np.zeros((6, 12)), -np.eye(6) / tau]])
        B = np.vstack([np.zeros((12, 6)), np.eye(6) / tau])
        C = np.hstack([C, np.zeros((6, 6))])
    n = len(A)
    held_over = expm(np.block([[A, B], [np.zeros((6, n + 6))]]) * T)
    kp, kd, ki = (np.array(options[name]) for name in ("kp", "kd", "ki"))
    Tf = options["derivative_filter"] or float((kd / kp).min() / 20)
    b, p, share = {
        "tustin": (2 * kd / (2 * Tf + T), (2 * Tf - T) / (2 * Tf + T), 0.5),
        "backward_diff": (kd / (Tf + T), Tf / (Tf + T), 1.0),
        "zoh": (kd / Tf, np.exp(-T / Tf), 0.0),
    }[options["discretisation"]]
    channel = (b, np.full(6, p), share * ki * T, ki * T)
    return DocumentedLoop(options, jacobian(machine, q), (held_over[:n, :n], held_over[:n, n:], C), channel)
