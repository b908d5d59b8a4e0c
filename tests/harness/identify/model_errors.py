"""Logs by a Lagrangian with one known error of model or instruments, each a function of a draw; the rest is right."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import gough_stewart as gs
from gough_stewart import Log, Platform, leg_jacobian
from tests.harness.identify.machine_logs import NAMES, Course, Sensing, Swing, exchanged, machine_log, random_machine
from tests.support.arrays import FloatArray
from tests.support.lagrangian import legs_along

FEW = ("platform_mass", "leg_viscous_friction", "leg_coulomb_friction")


@dataclass(frozen=True)
class Designed(Swing):
    """The motion of the shipped experiment `excitation`, which `excite` has designed, faster."""

    frequency: float = 0.15

    def coefficients(self, machine: Platform) -> FloatArray:  # noqa: ARG002
        """As in the experiment's file, 0.5 to 0.9 of its size."""
        reference: Any = gs.load_experiment("excitation").reference
        size = np.random.default_rng(self.seed).uniform(0.5, 0.9)
        return np.asarray(size * np.array(reference.coefficients))


@dataclass(frozen=True)
class Case:
    """One draw: a machine, a motion, a size and noise of its own."""

    kind: str
    seed: int
    size: float | None = None  # share of the normal size; drawn if none
    designed: bool = False
    names: tuple[str, ...] = FEW
    duration: float = 10.0  # [s]

    @property
    def rng(self) -> np.random.Generator:
        """Random numbers of this draw's error."""
        return np.random.default_rng([self.seed, 51])


@dataclass
class Made:
    """A machine and how it records, as an error has left them."""

    machine: Platform
    course: Course
    rng: np.random.Generator
    factor: float
    sensing: Sensing = field(default_factory=Sensing)
    after: Callable[[Log], Log] = lambda log: log
    # what is true: names of hypotheses, and their causes
    names: set[str] = field(default_factory=set)
    causes: set[str] = field(default_factory=set)
    # by name of a hypothesis, the true values of its parameters
    truth: dict[str, FloatArray] = field(default_factory=dict)

    def size(self, low: float, high: float) -> float:
        """A size of either sign, of the normal range times the factor."""
        return float(self.factor * self.rng.uniform(low, high) * self.rng.choice([-1, 1]))

    def leg(self) -> int:
        """A leg, from 0."""
        return int(self.rng.integers(6))

    def change(self, **values: Any) -> None:
        """Change the machine."""
        self.machine = replace(self.machine, **values)

    def alone(self, leg: int, value: float, others: float = 0.0) -> tuple[float, ...]:
        """Values of the six legs, of which one differs."""
        return tuple(value if k == leg else others for k in range(6))

    def force(self, change: Callable[[FloatArray, Log], FloatArray]) -> None:
        """Change what is recorded of the forces."""
        self.after = lambda log: replace(log, actuator_force=change(np.array(log.actuator_force), log))


def _payload(m: Made) -> None:
    mass, at = abs(m.size(40, 200)), m.rng.uniform((-0.4, -0.4, 0.0), (0.4, 0.4, 0.6))
    p = m.machine
    total = p.platform_mass + mass
    com = (p.platform_mass * p.platform_com + mass * at) / total
    J = p.platform_inertia + _about(p.platform_mass, p.platform_com - com) + _about(mass, at - com)
    m.change(platform_mass=total, platform_com=com, platform_inertia=J)


def _about(mass: float, r: FloatArray) -> FloatArray:
    return np.asarray(mass * (r @ r * np.eye(3) - np.outer(r, r)))


def _com(m: Made) -> None:
    direction = m.rng.standard_normal(3)
    shift = m.size(0.015, 0.08) * direction / np.linalg.norm(direction)
    m.truth["platform_com of the platform's file"] = m.machine.platform_com + shift
    m.change(platform_com=m.machine.platform_com + shift)


def _inertia(m: Made) -> None:
    more = sum((_about(abs(m.size(10, 60)), m.rng.normal(scale=0.8, size=3)) for _ in range(3)), np.zeros((3, 3)))
    m.change(platform_inertia=m.machine.platform_inertia + more)


def _com_and_inertia(m: Made) -> None:
    _com(m)
    m.truth.clear()
    _inertia(m)


def _armature(m: Made) -> None:
    m.change(leg_armature=m.machine.leg_armature + m.size(30, 150))


def _leg_friction(m: Made) -> None:
    leg = m.leg()
    viscous, coulomb = (np.array(getattr(m.machine, f"leg_{kind}_friction_factor")) for kind in ("viscous", "coulomb"))
    viscous[leg] *= 1 + m.size(0.1, 0.4)
    coulomb[leg] *= 1 + m.size(0.1, 0.4)
    m.change(leg_viscous_friction_factor=viscous / viscous.mean(), leg_coulomb_friction_factor=coulomb / coulomb.mean(),
             leg_viscous_friction=m.machine.leg_viscous_friction * viscous.mean(),
             leg_coulomb_friction=m.machine.leg_coulomb_friction * coulomb.mean())  # fmt: skip
    m.names = {f"friction of leg {leg + 1}", "friction of all legs"}
    m.names |= {"viscous friction of all legs", "Coulomb friction of all legs"}


def _gain(m: Made) -> None:
    leg, size = m.leg(), m.size(0.005, 0.03)
    m.sensing = replace(m.sensing, force_gain=m.alone(leg, 1 + size, 1.0))
    m.names, m.causes = {f"gain of leg {leg + 1}"}, {f"force sensor of leg {leg + 1}"}
    m.truth[f"gain of leg {leg + 1}"] = np.array([1 + size])


def _offset(m: Made) -> None:
    leg, size = m.leg(), m.size(15, 60)
    m.sensing = replace(m.sensing, force_offset=m.alone(leg, size))
    m.names, m.causes = {f"force offset of leg {leg + 1}"}, {f"force sensor of leg {leg + 1}"}
    m.truth[f"force offset of leg {leg + 1}"] = np.array([size])


def _delay(m: Made) -> None:
    delay = abs(m.size(0.3e-3, 3e-3))
    m.sensing = replace(m.sensing, delay=delay)
    m.truth["delay of all forces"] = np.array([delay])


def _leg_delay(m: Made) -> None:
    leg, delay = m.leg(), abs(m.size(0.3e-3, 3e-3))
    machine, course, seed = m.machine, m.course, 7 + m.leg()
    late = machine_log(machine, course, replace(m.sensing, delay=delay, force_noise=0.0), seed=seed).actuator_force
    right = machine_log(machine, course, replace(m.sensing, force_noise=0.0), seed=seed).actuator_force
    assert late is not None
    assert right is not None
    m.force(lambda force, _log: force + (late - right) * (np.arange(6) == leg))
    m.names, m.causes = {f"delay of the force of leg {leg + 1}"}, {"timing of the forces"}
    m.truth[f"delay of the force of leg {leg + 1}"] = np.array([delay])


def _encoder_offset(m: Made) -> None:
    leg, size = m.leg(), m.size(0.5e-3, 3e-3)
    m.sensing = replace(m.sensing, length_offset=m.alone(leg, size))
    m.names, m.causes = {f"offset of the encoder of leg {leg + 1}"}, {f"joints and encoder of leg {leg + 1}"}
    m.truth[f"offset of the encoder of leg {leg + 1}"] = np.array([size])


def _encoder_scale(m: Made) -> None:
    leg, size = m.leg(), m.size(0.001, 0.006)
    m.after = lambda log: replace(log, leg_length=log.leg_length * np.array(m.alone(leg, 1 + size, 1.0)))
    m.names, m.causes = {f"scale of the encoder of leg {leg + 1}"}, {f"joints and encoder of leg {leg + 1}"}
    m.truth[f"scale of the encoder of leg {leg + 1}"] = np.array([size])


def _leg_joints(m: Made) -> None:
    leg, which = m.leg(), m.rng.choice(["base", "platform"])
    points = np.array(getattr(m.machine, f"{which}_points"))
    direction = m.rng.standard_normal(3)
    points[leg] += m.size(0.5e-3, 3e-3) * direction / np.linalg.norm(direction)
    m.change(**{f"{which}_points": points})
    m.names = {f"{which} joint of leg {leg + 1}", f"joints of leg {leg + 1}"}
    m.causes = {f"joints and encoder of leg {leg + 1}"}


def _tilt(m: Made) -> None:
    tilt = np.radians([m.size(0.1, 0.6), m.size(0.1, 0.6)])
    m.course = replace(m.course, base_tilt=tuple(tilt.tolist()))
    m.truth["tilt of the base"] = tilt


def _stribeck(m: Made) -> None:
    size, velocity = abs(m.size(0.2, 0.6)), m.rng.uniform(0.02, 0.06)
    m.course = replace(m.course, static_friction=size, stribeck_velocity=velocity)
    m.truth["friction that falls as a leg begins to slide"] = np.array(
        [size * m.machine.leg_coulomb_friction, velocity]
    )


def _swapped(m: Made) -> None:
    a, b = sorted(m.rng.choice(6, 2, replace=False).tolist())
    m.after = lambda log: exchanged(log, a, b)
    m.names = {f"forces of legs {a + 1} and {b + 1} exchanged"}


def _drift(m: Made) -> None:
    if m.rng.uniform() < 0.5:
        leg = m.leg()
        drifts = np.array(m.alone(leg, m.size(15, 60)))
        m.names, m.causes = {f"drift of leg {leg + 1}"}, {f"force sensor of leg {leg + 1}"}
    else:
        drifts = np.array([m.size(15, 60) for _ in range(6)])
        m.names = {"drifts of all legs"}
    m.force(lambda force, log: force + np.linspace(-0.5, 0.5, len(log))[:, None] * drifts)


def _clipping(m: Made) -> None:
    share, rng = 1 - m.factor * m.rng.uniform(0.05, 0.2), m.rng
    noise, m.sensing = m.sensing.force_noise, replace(m.sensing, force_noise=0.0)

    def clip(force: FloatArray, _log: Log) -> FloatArray:
        level = share * np.abs(force).max()
        return np.asarray(np.clip(force, -level, level) + _noise(rng, force, noise))

    m.force(clip)
    m.names |= {f"force of leg {leg} clipped" for leg in range(1, 7)}


def _noise(rng: np.random.Generator, force: FloatArray, share: float) -> FloatArray:
    return np.asarray(share * np.sqrt((force**2).mean(axis=0)) * rng.standard_normal(force.shape))


def _rows_lost(m: Made) -> None:
    number, at = max(1, round(abs(m.size(1, 5)))), m.rng.uniform(0.25, 0.75)

    def lose(log: Log) -> Log:
        first = round(at * len(log))
        force = np.delete(np.array(log.actuator_force), slice(first, first + number), axis=0)
        return replace(log.rows(slice(0, len(force))), actuator_force=force)

    m.after = lose


def _coloured(m: Made) -> None:
    m.sensing = replace(m.sensing, coloured=m.rng.uniform(1.5, 4.0))


def _all_joints(m: Made) -> None:
    size = abs(m.size(0.5e-3, 3e-3)) / np.sqrt(3)
    for which in ("base_points", "platform_points"):
        m.change(**{which: getattr(m.machine, which) + size * m.rng.standard_normal((6, 3))})


def _cable(m: Made) -> None:
    stiffness, foot = abs(m.size(200, 2000)), m.rng.uniform(-1.0, 1.0, 3)

    def pulled(force: FloatArray, log: Log) -> FloatArray:
        pose = m.course.swing.along(m.machine, np.asarray(log.time), m.course.duration).q
        stretch = pose[:, :3] - pose[0, :3]
        wrench = np.concatenate([stiffness * stretch, stiffness * np.cross(foot, stretch)], axis=1)
        J = leg_jacobian(m.machine, pose[:, :3], pose[:, 3:])
        return force + np.linalg.solve(np.swapaxes(J, 1, 2), wrench[..., None])[..., 0]

    m.force(pulled)


def _soft_clipping(m: Made) -> None:
    share = m.factor * m.rng.uniform(0.02, 0.1)
    m.force(lambda force, _log: force * (1 - share * (force / np.abs(force).max()) ** 2))


def _jitter(m: Made) -> None:
    rng, size = m.rng, abs(m.size(0.05e-3, 0.3e-3))

    def shake(log: Log) -> Log:
        late = size * rng.standard_normal((len(log), 1))
        velocity = np.gradient(log.leg_length, 1e-3, axis=0)
        return replace(log, leg_length=log.leg_length + late * velocity)

    m.after = shake


def _clock(m: Made) -> None:
    size = m.size(0.003, 0.024)
    m.after = lambda log: replace(log, time=np.asarray(log.time) * (1 + size))


def _quadratic(m: Made) -> None:
    size = abs(m.size(100, 800))

    def dragged(force: FloatArray, log: Log) -> FloatArray:
        pose = m.course.swing.along(m.machine, np.asarray(log.time), m.course.duration)
        velocity = legs_along(m.machine, pose)[1]
        return force + size * velocity * np.abs(velocity)

    m.force(dragged)


MASS, LAW = {"payload, centre of mass or inertia"}, {"law of friction"}
# Of a payload all three are not what the file has; of a small one only some show.
_OF_FILE = {f"{name} of the platform's file" for name in ("platform_com", "platform_inertia")}
_OF_FILE |= {"payload, or several of the platform's masses"}
# Of each kind how it is made, names of hypotheses and causes that are true of it (more by the draw itself), and whether
# some hypothesis holds it.
KINDS: dict[str, tuple[Callable[[Made], None], set[str], set[str]]] = {
    "nothing": (lambda _made: None, set(), set()),
    "payload": (_payload, _OF_FILE, MASS),
    "com": (_com, {"platform_com of the platform's file"}, MASS),
    "inertia": (_inertia, {"platform_inertia of the platform's file"}, MASS),
    "com and inertia": (_com_and_inertia, _OF_FILE, MASS),
    "armature": (_armature, {"leg_armature of the platform's file"}, {"armature or clock"}),
    "friction of a leg": (_leg_friction, set(), {"friction of the legs"}),
    "gain of a leg": (_gain, set(), set()),
    "offset of a leg": (_offset, set(), set()),
    "delay of a leg": (_leg_delay, set(), set()),
    "delay of all": (_delay, {"delay of all forces"}, {"timing of the forces"}),
    "encoder's offset": (_encoder_offset, set(), set()),
    "encoder's scale": (_encoder_scale, set(), set()),
    "joints of a leg": (_leg_joints, set(), set()),
    "tilt": (_tilt, {"tilt of the base"}, {"tilt of the base"}),
    "stribeck": (_stribeck, {"friction that falls as a leg begins to slide"}, LAW),
    "swapped": (_swapped, set(), set()),
    "drift": (_drift, set(), {"force sensors"}),
    "clipping": (_clipping, {"forces clipped"}, {"range of the force sensors"}),
    "rows lost": (_rows_lost, {"rows lost in the forces"}, {"timing of the forces"}),
    "coloured noise": (_coloured, {"coloured noise"}, {"coloured noise"}),
    "all joints": (_all_joints, set(), set()),
    "cable": (_cable, set(), set()),
    "soft clipping": (_soft_clipping, set(), set()),
    "jitter": (_jitter, set(), set()),
    "clock": (_clock, {"clock of the log"}, {"armature or clock"}),
    "quadratic friction": (_quadratic, {"quadratic friction"}, LAW),
}
OF_MASSES = ("payload", "com", "inertia", "com and inertia", "armature")


def made(case: Case) -> tuple[Platform, Log, Made]:
    """What the fit believes, the log, and what is true."""
    machine, file = random_machine(case.seed)
    # all that is not estimated is right
    right = {name: getattr(machine, name) for name in ("platform_com", "platform_inertia", "leg_armature")}
    believed = replace(file, **(right if set(case.names) == set(FEW) else {}))
    swing = (Designed if case.designed else Swing)(seed=case.seed)
    factor = 1.0 if case.size is None else case.size
    change, names, causes = KINDS[case.kind]
    result = Made(machine, Course(swing, case.duration), case.rng, factor)
    while True:
        try:
            change(result)
            break
        except gs.GoughStewartError:
            continue
    result.names |= names
    result.causes |= causes
    # the machine's joints may be wrong, its home is what the file says
    log = result.after(machine_log(result.machine, result.course, result.sensing, seed=case.seed))
    return believed, log, result


def drawn(kind: str, seed: int, size: float | None = None) -> Case:
    """A draw of a kind: half of the motions are designed; half of the logs have all estimated."""
    names = FEW if kind in OF_MASSES or seed % 4 < 2 else NAMES
    return Case(kind, seed, size, bool(seed % 2), names)
