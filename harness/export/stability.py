"""Stability of the loop that an exported controller will run in: eigenvalues and margins with the delay of its form.

The linear model is that of `margins`: at rest in a pose, without Coulomb friction, and without what an export
leaves out; the sensors' own clock and jitter are their worst delay. Judged are the machine of the experiment in the
first pose of its reference and along its motion, the machine after each change of its parameters, and all members of
`[ensemble]` in the first pose.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np

from gough_stewart.harness.control.linear_controller import LinearController
from gough_stewart.harness.control.loop_margins import (
    DiskMargin,
    Margins,
    closed_loop,
    disk_margin,
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


class Delays(NamedTuple):
    """What makes a loop late."""

    delay: int  # from measurement to force [samples]
    lag: float  # of the drives [s]
    late: float = 0.0  # worst delay by the sensors' clock and jitter [s]


@dataclass(frozen=True)
class LoopAround:
    """The loop around an exported controller: how late its forces act there."""

    where: str
    least: int  # samples from measurement to force, at least
    fixed: int | None = None  # if it does not depend on the experiment
    has_machine: bool = True  # whether it is that of the experiment, with its drives, jitter and changes
    own_lag: float | None = None  # of the drives that the controller carries, if it does [s]
    carries_sensors: bool = False  # with their clock, which otherwise is the machine's

    def delays(self, experiment: Experiment, loop: Loop) -> Delays:
        """Of the experiment of a member of the prepared loop."""
        delay = max(self.least, experiment.loop.delay) if self.fixed is None else self.fixed
        lag = experiment.actuators.lag if self.has_machine else 0.0
        jitter = experiment.loop.jitter if self.has_machine else 0.0
        with_jitter = replace(loop, timing=replace(loop.timing, jitter=jitter))
        late = with_jitter.worst_delay if self.has_machine or self.carries_sensors else 0.0
        return Delays(delay, lag if self.own_lag is None else self.own_lag, late)


def output_delay_of(experiment: Experiment) -> int:
    """Of the controller's unit in an SSP [samples]: the experiment's, and the one that a unit cannot do without."""
    return max(1, experiment.loop.delay)


def loops_around(host: Host, experiment: Experiment, loop: Loop, parts: Iterable[Part] = ()) -> tuple[LoopAround, ...]:
    """The loops that a form is made for; an FMU may meet a machine with its own delay, or a plant directly.

    One that carries the drives has their delay too, and there is no other loop for it.
    """
    lag, whole = experiment.actuators.lag if "drives" in parts else None, output_delay_of(experiment)
    alone = {"has_machine": False, "carries_sensors": "sensors" in parts}
    if host == "ssp":
        return (LoopAround("in the SSP", 1, whole, own_lag=lag, **alone),)
    if host == "c":
        return (LoopAround("in C", 0, own_lag=lag),)
    if host == "run":
        return (LoopAround("with the unit in the run", 1, own_lag=lag),)
    if lag is not None:
        return (LoopAround("with the FMU", 1, whole, own_lag=lag),)
    loops_of_unit = LoopAround("with the FMU", 1), LoopAround("with the FMU directly at a plant", 1, 1, **alone)
    clocks = bool(experiment.loop.jitter or (experiment.sensors.sample_time and "sensors" not in parts))
    distinct = {(*s.delays(experiment, loop)[:2], clocks and s.has_machine) for s in loops_of_unit}
    return loops_of_unit[: len(distinct)]


class Case(NamedTuple):
    """One linear loop, judged."""

    what: str
    loop: Delays
    eigenvalue: complex  # z with the largest |z|
    frequency: float  # its frequency [Hz]

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
    changed: tuple[Case, ...] = ()  # after each change of the machine
    members: int = 0  # judged
    impossible: int = 0  # members that cannot run
    unstable: int = 0  # members
    worst: Case | None = None  # of the members
    margins: Margins | None = None  # of the nominal machine, if it is stable
    margins_of_worst: tuple[Case, Margins] | None = None  # the smallest of the members that look the least robust
    remedy: str = ""  # for the nominal machine, if it is unstable

    @property
    def worst_of_all(self) -> Case:
        """The case that refuses the export: the nominal machine's if it is unstable, else the worst."""
        cases = [self.nominal, self.on_the_way, *self.changed, *([self.worst] if self.worst else [])]
        return self.nominal if self.nominal.size >= 1 else max(cases, key=lambda case: case.size)

    @property
    def disk(self) -> DiskMargin | None:
        """The least margin of the nominal machine and of the least robust member, as far as they are known."""
        worst = None if self.margins_of_worst is None else self.margins_of_worst[1]
        known = [margins.disk for margins in (self.margins, worst) if margins is not None]
        return min(known, key=lambda disk: disk.alpha, default=None)

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
    """The loops that the controller of a prepared experiment will run in, as C, FMU or SSP."""
    hosts, parts, loop = tuple(hosts), tuple(parts), prepared.loop
    around = {host: loops_around(host, experiment, loop, parts) for host in hosts}
    try:
        form = prepared.linear_form()
        if form is None or form.doubt:
            reason = NO_FEEDBACK if prepared.controller is None else "an FMU has no linear form"
            return dict.fromkeys(hosts, StabilityReport(reason=reason if form is None else form.doubt))
        linear = _LinearLoops(prepared, form.controller)
        surroundings = dict.fromkeys(place for loops in around.values() for place in loops)
        found = {place: linear.without_members(place, experiment) for place in surroundings}
    except ControllerError as error:
        return dict.fromkeys(hosts, StabilityReport(reason=str(error)))

    # members, of which what surroundings have in common is judged once
    members = {place: list[_Member]() for place in surroundings}
    count = 0
    for count, of_all, number, member in _members_of(experiment):
        cases = dict[Delays, _Member | None]()
        for place, of_place in members.items():
            at = None if member is None else place.delays(member[1], loop)
            if member is not None and at is not None and at not in cases:
                cases[at] = linear.member(number, member[0], at)
            if at is not None and (judged := cases[at]) is not None:
                of_place.append(judged)
        if progress is not None:
            progress(count, of_all)

    def whole(place: LoopAround) -> LoopStability:
        nominal, extremes = found[place], least_robust(members[place])
        unstable, of_worst = sum(member.case.size >= 1 for member in members[place]), None
        if margins and extremes and not unstable:
            member = min(extremes, key=lambda m: linear.disk_alpha(m.machine, m.case.loop))
            of_member = linear.margins(member.machine, member.case.loop)
            of_worst = None if of_member is None else (member.case, of_member)
        return replace(
            nominal,
            members=len(members[place]),
            impossible=count - len(members[place]),
            unstable=unstable,
            worst=extremes[0].case if extremes else None,
            margins=linear.margins(prepared.machine, nominal.nominal.loop) if margins else None,
            margins_of_worst=of_worst,
        )

    return {host: StabilityReport(tuple(map(whole, loops))) for host, loops in around.items()}


class _Member(NamedTuple):
    case: Case
    machine: Platform
    damping_ratio: float  # of its least damped mode
    peak: float  # of σ(S − T) on a coarse grid of frequencies


def least_robust(members: Sequence[_Member]) -> tuple[_Member, ...]:
    """Members that look it, by each sign: the largest |z|, the least damping, the largest peak."""
    if not members:
        return ()
    return (
        max(members, key=lambda m: m.case.size),
        min(members, key=lambda m: m.damping_ratio),
        max(members, key=lambda m: m.peak),
    )


class _LinearLoops:
    """The linear loops of a prepared experiment's controller around machines."""

    def __init__(self, prepared: Prepared, controller: LinearController) -> None:
        self._prepared, self._controller = prepared, controller
        motion, timing = prepared.motion, prepared.loop.timing
        assert motion is not None
        rows = np.unique(np.linspace(0, len(motion.position) - 1, POSES).round().astype(int))
        poses = np.concatenate([motion.position[rows], motion.orientation[rows]], axis=1)
        _, first = np.unique(poses, axis=0, return_index=True)
        self._poses = [(float(timing.times[rows[k]]), poses[k]) for k in sorted(first)]
        self.margins = cache(self._margins)
        self.disk_alpha = cache(lambda machine, at: disk_margin(self._transfer(machine, at)).alpha)  # of stable loops

    def _transfer(self, machine: Platform, at: Delays, pose: FloatArray | None = None) -> Any:
        """L(z) of a machine, by default in the first pose of the reference."""
        p = self._poses[0][1] if pose is None else pose
        return transfer_of(self._prepared, machine, self._controller, **at._asdict(), pose=(p[:3], p[3:]))

    def _case(self, what: str, at: Delays, z: Any) -> Case:
        worst = complex(z[np.abs(z).argmax()])
        return Case(what, at, worst, frequency_of(worst, self._prepared.loop.timing.sample_time))

    def _margins(self, machine: Platform, at: Delays) -> Margins | None:
        """Its margins; None if it is unstable."""
        try:
            return loop_margins(self._transfer(machine, at))
        except UnstableLoopError:
            return None

    def without_members(self, place: LoopAround, experiment: Experiment) -> LoopStability:
        """The loop of the experiment's own machine: in its first pose, along its motion, after its changes."""
        machine, at = self._prepared.machine, place.delays(experiment, self._prepared.loop)

        def judged(what: str, machine: Platform, at: Delays, pose: FloatArray | None = None) -> Case:
            return self._case(what, at, closed_loop(self._transfer(machine, at, pose)).poles())

        nominal = judged("the nominal machine in its first pose", machine, at)
        on_the_way = [
            judged(f"the nominal machine in its pose at {time:.3g} s", machine, at, pose)
            for time, pose in self._poses[1:]
        ]
        changed = []
        for change in self._prepared.loop.changes if place.has_machine else ():
            if change.parameters:
                machine = replace(machine, **dict(change.parameters))  # type: ignore[arg-type]
                changed.append(judged(f"the machine after its change at {change.time:g} s", machine, at))
        remedy = ""
        if nominal.size >= 1:
            remedy, delay = remedy_of(self._transfer(self._prepared.machine, at)), experiment.loop.delay
            # the sample that a unit adds to a loop without delay
            if at.delay > delay and judged("", self._prepared.machine, at._replace(delay=delay)).size < 1:
                remedy = f"it is stable without delay; {remedy}"
        worst = max([nominal, *on_the_way], key=lambda case: case.size)
        return LoopStability(place, nominal, len(self._poses), worst, tuple(changed), remedy=remedy)

    def member(self, number: int, machine: Platform, at: Delays) -> _Member | None:
        """The loop of a member, with signs of little robustness that take little time; None without a linear model."""
        try:
            L = self._transfer(machine, at)
            z = closed_loop(L).poles()
            frequencies = np.geomspace(1 / 300, 0.99, _FREQUENCIES) * math.pi / self._prepared.loop.timing.sample_time
            S, T = sensitivities(L, frequencies)
        except GoughStewartError:
            return None
        s = np.log(z[np.abs(z) > 1e-9])
        damping = float(np.min(-s.real / np.abs(s), initial=1.0))
        peak = float(np.linalg.norm(S - T, 2, axis=(1, 2)).max())
        return _Member(self._case(f"member {number}", at, z), machine, damping, peak)


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
