"""Stability of the loop that an exported controller will run in: eigenvalues and margins with the delay of its form.

The linear model is that of `margins`: at rest in a pose, without Coulomb friction, and without what an export
leaves out; the sensors' own clock and jitter are their worst delay. Judged are the machine of the experiment in the
first pose of its reference and along its motion, the machine after each change of its parameters, and all members of
`[ensemble]` in the first pose.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.margins import (
    Margins,
    closed_loop,
    frequency_of,
    loop_margins,
    remedy_of,
    sensitivities,
)
from gough_stewart.harness.errors import ControllerError, UnstableLoopError
from gough_stewart.harness.experiment.margins import transfer_of
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.overrides import experiment_with
from gough_stewart.harness.experiment.preparation import Prepared, platforms_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.choices import Part
from gough_stewart.harness.loop.loop import Loop
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# What runs the exported controller: a form, or the harness by `run --controller fmu3`.
Host = Literal["c", "fmu", "ssp", "run"]
# Called with the number of judged members, and of all.
MemberProgress = Callable[[int, int], None]
# Poses along the motion, of the nominal machine.
POSES = 25
NO_FEEDBACK = "there is no feedback"
_AT_ONCE = 256  # members drawn at a time
_FREQUENCIES = 16  # at which members are compared
# Keys of `[ensemble]` that change the linear loop around an exported controller.
_SEEN = (("plant",), ("platform",), ("loop", "delay"), ("loop", "jitter"), ("actuators", "lag"))


@dataclass(frozen=True)
class LoopAround:
    """The loop around an exported controller: how late its forces act there."""

    where: str
    least: int  # samples from measurement to force, at least
    fixed: int | None  # if it does not depend on the experiment
    has_drives: bool  # whether the machine is that of the experiment, with its lag and its changes
    own_lag: float | None = None  # of the drives that the controller carries, if it does [s]
    carries_sensors: bool = False  # with their clock, which otherwise is the machine's

    def delay_and_lag(self, experiment: Experiment) -> tuple[int, float]:
        """From measurement to force [samples], and the time constant of the drives [s]."""
        delay = max(self.least, experiment.loop.delay) if self.fixed is None else self.fixed
        lag = experiment.actuators.lag if self.has_drives else 0.0
        return delay, lag if self.own_lag is None else self.own_lag

    def delays(self, experiment: Experiment, loop: Loop) -> "Delays":
        """All of them, of the experiment of a member of the prepared loop."""
        jitter = experiment.loop.jitter if self.has_drives else 0.0
        with_jitter = replace(loop, timing=replace(loop.timing, jitter=jitter))
        late = with_jitter.worst_delay if self.has_drives or self.carries_sensors else 0.0
        return Delays(*self.delay_and_lag(experiment), late)


class Delays(NamedTuple):
    """What makes a loop late."""

    delay: int  # [samples]
    lag: float  # [s]
    late: float  # worst delay by the sensors' clock and jitter [s]


def output_delay_of(experiment: Experiment) -> int:
    """Of the controller's unit in an SSP [samples]: the experiment's, and the one that a unit cannot do without."""
    return max(1, experiment.loop.delay)


def loops_around(host: Host, experiment: Experiment, parts: Iterable[Part] = ()) -> tuple[LoopAround, ...]:
    """The loops that a form is made for; an FMU may meet a machine with its own delay, or a plant directly.

    One that carries the drives has their delay too, and there is no other loop for it.
    """
    lag = experiment.actuators.lag if "drives" in parts else None
    has_sensors, whole = "sensors" in parts, output_delay_of(experiment)
    if host == "ssp":
        return (
            LoopAround("in the SSP", 1, whole, has_drives=False, own_lag=lag, carries_sensors=has_sensors),
        )  # fmt: skip
    if host == "c":
        return (LoopAround("in C", 0, None, has_drives=True, own_lag=lag),)
    if host == "run":
        return (LoopAround("with the unit in the run", 1, None, has_drives=True, own_lag=lag),)
    if lag is not None:
        return (LoopAround("with the FMU", 1, whole, has_drives=True, own_lag=lag),)
    loops_of_unit = (
        LoopAround("with the FMU", 1, None, has_drives=True),
        LoopAround("with the FMU directly at a plant", 1, 1, has_drives=False, carries_sensors=has_sensors),
    )
    clocks = bool(experiment.loop.jitter or (experiment.sensors.sample_time and not has_sensors))
    loops = {(*around.delay_and_lag(experiment), clocks and around.has_drives) for around in loops_of_unit}
    return loops_of_unit if len(loops) > 1 else loops_of_unit[:1]


class Case(NamedTuple):
    """One linear loop, judged."""

    what: str
    delay: int  # [samples]
    lag: float  # [s]
    eigenvalue: complex  # z with the largest |z|
    frequency: float  # its frequency [Hz]
    late: float = 0.0  # worst delay by the sensors' clock and jitter [s]

    @property
    def loop(self) -> Delays:
        """What makes it late."""
        return Delays(self.delay, self.lag, self.late)

    @property
    def size(self) -> float:
        """|z|."""
        return abs(self.eigenvalue)


@dataclass(frozen=True)
class LoopStability:
    """The loop of an exported controller in its surroundings."""

    surroundings: LoopAround
    nominal: Case
    poses: int  # judged along the motion
    on_the_way: Case  # the worst of them
    changed: tuple[Case, ...]  # after each change of the machine
    members: int  # judged
    impossible: int  # members that cannot run
    unstable: int  # members
    worst: Case | None  # of the members
    margins: Margins | None  # of the nominal machine, if it is stable
    margins_of_worst: tuple[Case, Margins] | None  # the smallest of the members that look the least robust
    remedy: str  # for the nominal machine, if it is unstable

    @property
    def worst_of_all(self) -> Case:
        """The case that refuses the export: the nominal machine's if it is unstable, else the worst."""
        cases = [self.nominal, self.on_the_way, *self.changed, *([self.worst] if self.worst else [])]
        return self.nominal if self.nominal.size >= 1 else max(cases, key=lambda case: case.size)

    @property
    def known_margins(self) -> list[Margins]:
        """Of the nominal machine and of the least robust member, as far as they are known."""
        worst = None if self.margins_of_worst is None else self.margins_of_worst[1]
        return [margins for margins in (self.margins, worst) if margins is not None]

    @property
    def is_stable(self) -> bool:
        """Whether all cases are stable."""
        return self.worst_of_all.size < 1


@dataclass(frozen=True)
class StabilityReport:
    """What is known about the loops of an exported controller."""

    loops: tuple[LoopStability, ...] = ()
    reason: str = ""  # why none was judged

    @property
    def unstable(self) -> tuple[LoopStability, ...]:
        """The loops that are unstable."""
        return tuple(loop for loop in self.loops if not loop.is_stable)


def stability_of(
    experiment: Experiment,
    prepared: Prepared,
    hosts: Iterable[Host],
    *,
    parts: Iterable[Part] = (),
    margins: bool = True,
    progress: MemberProgress | None = None,
) -> dict[Host, StabilityReport]:
    """The loops that the controller of a prepared experiment will run in, as C, FMU or SSP.

    Parameters
    ----------
    parts
        Of the machine, which the controller carries.
    margins
        Compute stability margins, too.
    progress
        Called while members are judged.

    Raises
    ------
    ExperimentError
        An invalid `[ensemble]`.
    """
    hosts, parts = tuple(hosts), tuple(parts)
    try:
        form = prepared.linear_form()
        if form is None or form.doubt:
            reason = NO_FEEDBACK if prepared.controller is None else "an FMU has no linear form"
            return dict.fromkeys(hosts, StabilityReport(reason=reason if form is None else form.doubt))
        loops = _Loops(prepared, form.controller)
        around = {host: loops_around(host, experiment, parts) for host in hosts}
        judges = {s: _Judge(loops, experiment, s) for surroundings in around.values() for s in surroundings}
    except ControllerError as error:
        return dict.fromkeys(hosts, StabilityReport(reason=str(error)))
    for done, of_all, number, member in _members_of(experiment):
        # what surroundings have in common is judged once
        cases: dict[Delays, _Member | None] = {}
        for surroundings, judge in judges.items():
            if member is None:
                judge.add(None)
                continue
            at = surroundings.delays(member[1], prepared.loop)
            if at not in cases:
                cases[at] = loops.member(number, member[0], at)
            judge.add(cases[at])
        if progress is not None:
            progress(done, of_all)
    return {
        host: StabilityReport(tuple(judges[s].result(margins=margins) for s in surroundings))
        for host, surroundings in around.items()
    }


class _Member(NamedTuple):
    case: Case
    machine: Platform
    damping_ratio: float  # of its least damped mode
    peak: float  # of σ(S − T) on a coarse grid of frequencies


class _Loops:
    def __init__(self, prepared: Prepared, controller: LinearController) -> None:
        self._prepared, self._controller, self.loop = prepared, controller, prepared.loop
        self.machine, self.sample_time = prepared.machine, prepared.loop.timing.sample_time
        motion = prepared.motion
        assert motion is not None
        rows = np.unique(np.linspace(0, len(motion.position) - 1, POSES).round().astype(int))
        poses = np.concatenate([motion.position[rows], motion.orientation[rows]], axis=1)
        _, first = np.unique(poses, axis=0, return_index=True)
        self.poses = [(float(prepared.loop.timing.times[rows[k]]), poses[k]) for k in sorted(first)]
        self._margins: dict[tuple[Platform, Delays], Margins | None] = {}

    def transfer(self, machine: Platform, at: Delays, pose: FloatArray | None = None) -> Any:
        """L(z) of a machine, by default in the first pose of the reference."""
        p = self.poses[0][1] if pose is None else pose
        place = {"position": p[:3], "orientation": p[3:]}
        return transfer_of(self._prepared, machine, self._controller, **at._asdict(), **place)

    def case(self, what: str, machine: Platform, at: Delays, pose: FloatArray | None = None) -> Case:
        """The eigenvalues of a loop."""
        return self._case(what, at, closed_loop(self.transfer(machine, at, pose)).poles())

    def _case(self, what: str, at: Delays, z: Any) -> Case:
        worst = complex(z[np.abs(z).argmax()])
        return Case(what, at.delay, at.lag, worst, frequency_of(worst, self.sample_time), at.late)

    def member(self, number: int, machine: Platform, at: Delays) -> _Member | None:
        """The loop of a member, with signs of little robustness that take little time; None without a linear model."""
        try:
            L = self.transfer(machine, at)
            z = closed_loop(L).poles()
            S, T = sensitivities(L, np.geomspace(1 / 300, 0.99, _FREQUENCIES) * math.pi / self.sample_time)
        except GoughStewartError:
            return None
        s = np.log(z[np.abs(z) > 1e-9])
        damping = float(np.min(-s.real / np.abs(s), initial=1.0))
        peak = float(np.linalg.norm(S - T, 2, axis=(1, 2)).max())
        return _Member(self._case(f"member {number}", at, z), machine, damping, peak)

    def margins(self, machine: Platform, at: Delays) -> Margins | None:
        """Its margins; None if it is unstable."""
        key = (machine, at)
        if key not in self._margins:
            try:
                self._margins[key] = loop_margins(self.transfer(*key))
            except UnstableLoopError:
                self._margins[key] = None
        return self._margins[key]

    def after_changes(self) -> Iterator[tuple[float, Platform]]:
        """The machine from the time [s] of each change of its parameters on."""
        machine = self.machine
        for change in self._prepared.loop.changes:
            if change.parameters:
                machine = replace(machine, **dict(change.parameters))  # type: ignore[arg-type]
                yield change.time, machine


class _Judge:
    """Judges the loop in its surroundings: the experiment's own machine first, then members as they come."""

    def __init__(self, loops: _Loops, experiment: Experiment, around: LoopAround) -> None:
        self._loops, self._around, self._delay = loops, around, experiment.loop.delay
        self._at = around.delays(experiment, loops.loop)
        machine = loops.machine
        self._nominal = loops.case("the nominal machine in its first pose", machine, self._at)
        on_the_way = [
            loops.case(f"the nominal machine in its pose at {time:.3g} s", machine, self._at, pose)
            for time, pose in loops.poses[1:]
        ]
        self._on_the_way = max([self._nominal, *on_the_way], key=lambda case: case.size)
        self._changed = tuple(
            loops.case(f"the machine after its change at {time:g} s", changed, self._at)
            for time, changed in (loops.after_changes() if around.has_drives else ())
        )
        self._members = self._unstable = self._impossible = 0
        self._extremes: tuple[_Member, ...] = ()  # largest |z|, least damping, largest peak

    def add(self, member: _Member | None) -> None:
        """A member's loop; None if the member is impossible, or its machine has no linear model there."""
        if member is None:
            self._impossible += 1
            return
        self._members += 1
        self._unstable += member.case.size >= 1
        members = (*self._extremes, member)
        self._extremes = (
            max(members, key=lambda m: m.case.size),
            min(members, key=lambda m: m.damping_ratio),
            max(members, key=lambda m: m.peak),
        )

    def result(self, *, margins: bool) -> LoopStability:
        """What is known of it; margins of members are the smallest of the extremes', unknown if one is unstable."""
        loops, nominal = self._loops, self._nominal
        known: list[tuple[Case, Margins]] = []
        if margins and not self._unstable:
            candidates = [(m.case, loops.margins(m.machine, m.case.loop)) for m in self._extremes]
            known = [(case, known_margins) for case, known_margins in candidates if known_margins is not None]
        return LoopStability(
            surroundings=self._around,
            nominal=nominal,
            poses=len(loops.poses),
            on_the_way=self._on_the_way,
            changed=self._changed,
            members=self._members,
            impossible=self._impossible,
            unstable=self._unstable,
            worst=self._extremes[0].case if self._extremes else None,
            margins=loops.margins(loops.machine, self._at) if margins else None,
            margins_of_worst=min(known, key=lambda pair: pair[1].disk.alpha, default=None),
            remedy="" if nominal.size < 1 else self._remedy(),
        )

    def _remedy(self) -> str:
        loops, delay = self._loops, self._delay
        gains = remedy_of(loops.transfer(loops.machine, self._at))
        if self._at.delay == delay or loops.case("", loops.machine, self._at._replace(delay=delay)).size >= 1:
            return gains
        return f"it is stable {f'with the delay of {delay} samples' if delay else 'without delay'}; {gains}"


def _members_of(experiment: Experiment) -> Iterable[tuple[int, int, int, tuple[Platform, Experiment] | None]]:
    """How many are done, the number of all, a member's number, its machine and experiment; None if it is impossible.

    Nothing if no member has another linear loop than the nominal machine.
    """
    if experiment.ensemble is None:
        return
    # the end of a run at its stroke matters to no linear loop
    limits = experiment.limits.model_copy(update={"stroke": "warn"})
    members = Members(experiment.model_copy(update={"limits": limits}))
    if not any(row.place.path[: len(path)] == path for row in members.inputs for path in _SEEN):
        return
    for first in range(0, members.count, _AT_ONCE):
        last = min(first + _AT_ONCE, members.count)
        for k, values in enumerate(members.draws(first, last).values, first):
            try:
                of_member = experiment_with(members.nominal, values)
                yield k + 1, members.count, k, (platforms_of(of_member)[1], of_member)
            except GoughStewartError:
                yield k + 1, members.count, k, None
