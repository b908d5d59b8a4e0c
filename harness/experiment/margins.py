"""The margins of an experiment's loop on the linear model: numbers, what limits them, and their report."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from gough_stewart.harness.control.controllers import PD, PID, ControllerChoice
from gough_stewart.harness.control.linear import (
    MOST_STATES,
    LoopStructure,
    Mode,
    feedback_part,
    held_plant,
    loop_transfer,
    modes,
    structural_modes,
    structure_of,
)
from gough_stewart.harness.control.linear_controller import LinearController
from gough_stewart.harness.control.loop_margins import (
    ClassicalMargins,
    DiskMargin,
    Margins,
    closed_loop,
    disk_margin,
    frequency_range,
    is_stable,
    loop_margins,
    one_leg_open,
    response,
    sensitivities,
)
from gough_stewart.harness.control.pid import Gains
from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.harness.errors import ControllerError, UnstableLoopError
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.overrides import Settings
from gough_stewart.harness.experiment.preparation import Prepared, platforms_of, prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.report.chart import Axis, Chart, Mark, Series, Span, time_axis
from gough_stewart.harness.report.document import (
    Cell,
    Column,
    Note,
    Number,
    Report,
    Section,
    Table,
    Value,
    Verdict,
    settings_of,
)
from gough_stewart.harness.report.page import to_html
from gough_stewart.harness.report.palette import Role
from gough_stewart.harness.report.quantities import (
    ANGLE,
    DECIBEL,
    FREQUENCY,
    NUMBER,
    SHARE,
    TIME,
    Quantity,
    about,
    at_least,
    counted,
    listed,
    sentence,
)
from gough_stewart.harness.results.run_report import Robustness
from gough_stewart.harness.section import plain
from gough_stewart.model.interface import RIGID
from gough_stewart.model.platform import Platform

Kind = TypeVar("Kind")

_SHOWN_MODES = 8
_POINTS = 500
# Of step responses, at most.
_STEP_POINTS = 500
_LONGEST = 10_000
_SETTLED = 0.01
# A loop with a smaller disk margin is little robust; one half is a usual requirement.
FRAIL = 0.4
_ALIKE = 1e-3
# At negligible gain the phase has no meaning.
_BELOW = 1e-4
_DELAY = Quantity("s", "ms", 1e3, "delay", digits=3)
_PHASE = replace(ANGLE, digits=3)
_FACTOR = Quantity("", "", digits=3, name="factor on the gain")
_GAIN = Quantity("1", "1", name="gain")
_THREE = Quantity("", "", digits=3)
_FREQUENCY = replace(FREQUENCY, digits=3)
_LINEAR = (
    "Linear model at the first pose of the reference: without Coulomb friction, limits and quantisation, and of the "
    "nominal machine. `run` has these; `ensemble` has machines that differ."
)
_WORST = (
    "The sensors' own clock and jitter are modelled as their worst delay, a constant one: the loop is never later, and "
    "mostly earlier."
)
_NUMERICAL = (
    "The controller is linearised numerically, at rest in the first pose of the reference: by small changes of its "
    "measurements and of what it remembers."
)

_OF_MARGINS = (
    *("disk", "disk_gain", "disk_phase"),
    *("gain", "gain_up", "gain_down", "phase", "delay"),
    *("leg.gain", "leg.gain_up", "leg.gain_down", "leg.phase", "leg.delay"),
    *("crossover", "sensitivity_peak", "complementary_peak"),
)
# All numbers of an analysis.
PATHS = (
    *(f"{loop}.{name}" for loop in ("margins", "margins.believed") for name in _OF_MARGINS),
    *("modes.slowest", "modes.damping_ratio"),
    *("structure.first_mode", "structure.damping_ratio", "structure.gain", "structure.bandwidth"),
)
# What only some experiments have, by the beginnings of paths, and what gives it.
_ONLY_SOME = {
    "margins.believed": "the machine is the platform of the design; set plant.parameters, in which it differs",
    "structure": "the legs are rigid; set platform.parameters.leg_stiffness",
}
# Numbers that once were of something else, in requirements that may be as old, and what they are of.
RENAMED = {
    "margins.gain": "the same gain of all legs; the disk's guarantee for independent changes is margins.disk_gain",
    "margins.phase": "the same phase of all legs; the disk's guarantee for independent changes is margins.disk_phase",
    "margins.delay": "the same delay of all legs; that of one leg alone is margins.leg.delay",
}


def absent_numbers(experiment: Experiment) -> dict[str, str]:
    """The paths of numbers that the margins of an experiment do not have, and what would give each."""
    kind = experiment.controller.type
    if kind in ("open_loop", "fmu"):
        why = "an open loop has no margins" if kind == "open_loop" else "an FMU has no transfer function"
        return dict.fromkeys(PATHS, f"{why}; choose an experiment with another controller")
    believed, machine = platforms_of(experiment)
    missing = [
        *(["margins.believed"] if machine == believed else []),
        *([] if machine.leg_stiffness > 0 else ["structure"]),
    ]
    return {path: _ONLY_SOME[name] for name in missing for path in PATHS if path.startswith(name)}


@dataclass(frozen=True, eq=False, repr=False)
class LoopMargins(Margins):
    """Stability margins of an experiment's loop, from `margins`.

    They are those of the loop that runs: the machine under the controller designed on the believed platform.

    `legs` has for each leg, with the others closed, `gain_up` and `gain_down` (factors), `phase` [rad], `delay` [s] and
    `crossover` [Hz]; `common` has the same for one change applied to all legs. `disk` has what is guaranteed for
    independent simultaneous changes of all legs: `alpha`, `gain`, `phase` [rad] and `frequency` [Hz].
    `sensitivity_peak` and `complementary_peak` are the largest σ(S) and σ(T).
    """

    title: str
    """Title of the experiment."""
    sample_time: float
    """[s]"""
    delay: int
    """[samples]"""
    lag: float
    """Of the actuators [s]."""
    gains: Gains | None
    """Gains of a PD or PID."""
    modes: tuple[Mode, ...]
    """Modes of the closed loop, slowest first."""
    transfer: StateSpace
    """Loop transfer L (6×6) at the actuators, u = −L u, as matrices."""
    changed: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Keys of the experiment that were changed, as `Experiment.changed`."""
    structure: LoopStructure | None = None
    """Of a machine with elastic legs: the structural modes, each with `frequency`, `damping_ratio`, `held_frequency`
    and `gain`, and the largest `bandwidth` [Hz] of the controller with a disk margin of at least `disk`."""
    late: float = 0.0
    """What the sensors' own clock and jitter add to the delay at worst, as modelled in these margins [s]."""
    doubt: str = ""
    """What these margins leave out, so that a requirement on them is inconclusive."""
    believed: Margins | None = None
    """Of the loop with the believed platform as machine, where that differs and is stable."""
    warnings: tuple[str, ...] = ()
    """What else is to be known of these margins, one sentence each."""
    is_numerical: bool = False
    """Whether the controller is linearised numerically: one in Python, or a CasADi function."""

    @property
    def loop(self) -> Any:
        """The loop transfer L as a python-control system."""
        from control import ss

        return ss(*self.transfer.blocks, self.transfer.dt)

    def __repr__(self) -> str:
        """The margins of all legs at once, the smallest of one leg, and the slowest mode, one line each."""
        disk, all_legs, slowest = self.disk, self.common, self.modes[0]
        phase, delay = min(leg.phase for leg in self.legs), min(leg.delay for leg in self.legs)
        up, down = min(leg.gain_up for leg in self.legs), max(leg.gain_down for leg in self.legs)
        return "\n".join(
            [
                f"Margins: {self.title}",
                f"  all legs at once   disk margin {disk.alpha:.3g} at {disk.frequency:.3g} Hz: gains × "
                f"{disk.gain[0]:.3g} to {disk.gain[1]:.3g}, phases ± {np.degrees(disk.phase):.3g}°",
                f"  all legs alike     gain × {all_legs.gain_down:.3g} to {all_legs.gain_up:.3g}, phase "
                f"{np.degrees(all_legs.phase):.3g}°, delay {1000 * all_legs.delay:.3g} ms",
                f"  one leg at a time  gain × {down:.3g} to {up:.3g}, phase {np.degrees(phase):.3g}°, delay "
                f"{1000 * delay:.3g} ms",
                f"  slowest mode       {slowest.frequency:.3g} Hz, damping ratio {slowest.damping_ratio:.3g}",
            ]
        )

    def _repr_html_(self) -> str:
        return to_html(self.report(charts=False))

    def report(self, *, charts: bool = True) -> Report:
        """Report the gain, phase and delay margins, and what limits them.

        Returns
        -------
        Report
            Verdict, numbers such as `margins.disk` and `margins.delay`, tables, and with `charts` the responses.
        """
        sections = [*_tables(self)]
        if charts:
            sections.append(Section("Responses", _responses(self)))
        doubt, structure = self.doubt, self.structure
        numbers = _numbers_of_margins(self, "", doubt)
        numbers += (
            Number("modes.slowest", "slowest mode", self.modes[0].frequency, FREQUENCY,
                   explanation="of the closed loop", doubt=doubt),
            Number("modes.damping_ratio", "least damping ratio", min(mode.damping_ratio for mode in self.modes),
                   explanation="of all modes of the closed loop", doubt=doubt),
        )  # fmt: skip
        if self.believed is not None:
            numbers += _numbers_of_margins(self.believed, "believed ", doubt)
        if structure is not None and structure.modes:
            first = structure.modes[0]
            gain = max((mode.gain for mode in structure.modes if not math.isnan(mode.gain)), default=None)
            numbers += (
                Number("structure.first_mode", "first structural mode", first.frequency, FREQUENCY,
                       explanation="of the platform on its legs, with motors that are free"),
                Number("structure.damping_ratio", "its damping ratio", first.damping_ratio),
                Number("structure.gain", "gain of L at a structural mode",
                       None if gain is None else decibels(gain), DECIBEL,
                       explanation="largest singular value, of all modes; below 0 dB no phase makes a mode unstable"),
                Number("structure.bandwidth", "largest bandwidth", structure.bandwidth, FREQUENCY,
                       explanation=f"of this controller with a disk margin of at least {structure.disk:g}"),
            )  # fmt: skip
        disk, common = self.disk, self.common
        by_path = {number.path: number for number in numbers}
        gain, guaranteed = (by_path[path].value for path in ("margins.gain", "margins.disk_gain"))
        alone = "any factor" if guaranteed is None else at_least(DECIBEL, guaranteed)
        bears = [
            "any gain" if gain is None else f"{at_least(DECIBEL, gain)} of gain",
            f"{at_least(ANGLE, common.phase)} of phase" if math.isfinite(common.phase) else "any phase",
            f"{at_least(_DELAY, common.delay)} of further delay" if math.isfinite(common.delay) else "any delay",
        ]
        text = sentence(
            [
                f"stable: with the same change of all legs it bears {listed(bears, 'or')}",
                f"each leg independently may change by {alone} or {at_least(ANGLE, disk.phase)}",
                f"disk margin {disk.alpha:.2g} at {about(FREQUENCY, disk.frequency)}",
                self.doubt,
            ]
        )
        carried = tuple(by_path[f"margins.{name}"] for name in ("disk", "gain", "phase", "delay"))
        lag = f", lag of the drives {about(TIME, self.lag)}" if self.lag else ""
        late = f" and up to {about(_DELAY, self.late)} by the sensors' clock and jitter" if self.late else ""
        delay = f"delay of {counted(self.delay, 'sample')}{late}"
        return Report(
            self.title,
            Verdict(text, "marginal" if disk.alpha < FRAIL or self.doubt else "good", carried),
            tuple(sections),
            study="margins",
            lead=f"sampled every {about(_DELAY, self.sample_time, 4)}, {delay}{lag}"
            + (", controller linearised numerically" if self.is_numerical else ""),
            settings=settings_of(self.changed),
            numbers=tuple(numbers),
            notes=(
                *(Note(text, "warning") for text in self.warnings),
                Note(_LINEAR),
                *([Note(_WORST)] if self.late else []),
                *([Note(_NUMERICAL)] if self.is_numerical else []),
            ),
        )

    def as_dict(self) -> dict[str, Any]:
        """The margins as plain types, as in margins.json, with None for infinite or undefined values."""
        gains, structure, actions = self.gains, self.structure, ("proportional", "derivative", "integral")
        numbers: dict[str, Any] = {
            "title": self.title,
            "sample_time": self.sample_time,
            "delay": self.delay,
            "lag": self.lag,
            "late": self.late,
            **({"controller": "linearised numerically"} if self.is_numerical else {}),
            "gains": gains
            and {name: np.asarray(getattr(gains, name)).tolist() for name in actions}
            | {"derivative_filter": gains.filter_time},
            "modes": [
                {**mode._asdict(), "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag]} for mode in self.modes
            ],
            "margins": Margins(*(getattr(self, part.name) for part in fields(Margins))).as_dict(),
        }
        if self.believed is not None:
            numbers["believed"] = self.believed.as_dict()
        if structure is not None:
            of_modes = [plain(mode._asdict()) for mode in structure.modes]
            numbers["structure"] = {**structure._asdict(), "modes": of_modes, "bandwidth": plain(structure.bandwidth)}
        return numbers


def margins(experiment: Experiment | Path | str, settings: Settings = (), *, controller: Any = None) -> LoopMargins:
    """Gains, closed-loop modes and stability margins of an experiment's loop, on the linear model.

    The loop that runs: the machine under the controller that is designed on the believed platform, linearised at the
    first pose of the reference; sampled, delayed and lagged as in the experiment, with the sensors' own clock and
    jitter as their worst delay. For each leg with the others closed, and for one change of all legs: gain, phase [rad]
    and delay [s]; for independent changes of all legs the disk margin.

    Parameters
    ----------
    experiment
        A TOML file, the name of a shipped experiment, or an `Experiment`.
    settings
        Keys of the experiment to change, as in `load_experiment`.
    controller
        Replaces the experiment's: a discrete python-control system, a `LinearController`, or any other but an FMU,
        which is linearised numerically at rest in the first pose of the reference.

    Returns
    -------
    LoopMargins
        `legs` and `disk`, the margins of each leg and of all at once; peaks of S and T; `gains`, `modes` and the `loop`
        transfer as a python-control system.

    Raises
    ------
    ControllerError
        The controller is an FMU, does not answer to small changes, or there is none.
    UnstableLoopError
        The loop is unstable in the linear model.
    ExperimentError, ReachError
        The experiment cannot run as written, or its reference is out of the platform's reach.

    See Also
    --------
    frf, check, run

    Examples
    --------
    >>> margins = gs.margins("heave_step", {"loop.delay": 2})
    >>> margins.disk.alpha, min(leg.phase for leg in margins.legs)
    """
    chosen = load_experiment(experiment, settings)
    # the loop at rest has its margins however fast its reference is
    prepared = prepare(load_experiment(chosen, {"limits.reference": "warn"}), controller)
    form = prepared.linear_form()
    if form is None:
        why = "an open loop has no margins" if prepared.controller is None else "an FMU has no transfer function"
        raise ControllerError(f"{chosen.where}: controller: {why}; choose an experiment with another controller")
    linear = form.controller
    actuators, machine, believed = prepared.loop.actuators, prepared.machine, prepared.platform
    sample_time = prepared.loop.timing.sample_time
    choice = chosen.controller if controller is None else None
    of_believed, warnings = None, tuple[str, ...]()
    if machine != believed:
        try:
            of_believed = judged(prepared, believed, linear, loop_margins).margins
        except UnstableLoopError:
            warnings = ("with the believed platform as machine the loop would be unstable",)
    try:
        L, of_machine, doubt, warning = judged(prepared, machine, linear, loop_margins)
        late = 0.0 if doubt else prepared.loop.worst_delay
    except UnstableLoopError as error:
        if form.doubt:
            raise ControllerError(
                f"{chosen.where}: controller: {form.doubt}, so there are no margins: {error}"
            ) from None
        moved = _what_moved_it(prepared, linear, choice)
        if of_believed is not None:
            moved.append(
                "it is stable with the believed platform as machine, with a disk margin of "
                f"{of_believed.disk.alpha:.3g}"
            )
        raise UnstableLoopError("; ".join([str(error), *moved]), error.eigenvalue) from None
    if form.doubt:
        doubt, warning = "; ".join(filter(None, [form.doubt, doubt])), "; ".join(filter(None, [form.doubt, warning]))
    family = None
    if isinstance(choice, PD | PID) and (bandwidth := choice.bandwidth) is not None:

        def with_bandwidth(bandwidth: float, choice: PD | PID = choice) -> StateSpace:
            law = choice.model_copy(update={"bandwidth": bandwidth}).controller(believed, sample_time)
            return transfer_of(prepared, machine, law)

        family = bandwidth, with_bandwidth
    return LoopMargins(
        **vars(of_machine),
        title=chosen.title,
        sample_time=sample_time,
        delay=actuators.delay,
        lag=actuators.lag,
        gains=chosen.controller.gains(believed) if controller is None else None,
        modes=tuple(modes(closed_loop(L))),
        transfer=L,
        changed=chosen.changed,
        structure=structure_of(machine, L, family, FRAIL, prepared.pose),
        late=late,
        doubt=doubt,
        believed=of_believed,
        warnings=(*warnings, *([warning] if doubt else [])),
        is_numerical=form.is_numerical,
    )


class Judged(NamedTuple, Generic[Kind]):
    """A stable loop."""

    transfer: StateSpace
    margins: Kind
    doubt: str = ""  # what the margins leave out, so that a requirement on them is inconclusive
    warning: str = ""  # that, and why


def disk_of(L: StateSpace) -> DiskMargin:
    """The disk margin alone, in a fraction of the time of all margins; what would stabilise a loop is left out."""
    if not is_stable(L):
        raise UnstableLoopError("the closed loop is unstable", math.nan)
    return disk_margin(L)


def judged(
    prepared: Prepared, plant: Platform, controller: LinearController, margins_of: Callable[[StateSpace], Kind]
) -> Judged[Kind]:
    """Margins of an experiment's loop around a plant, which is its machine or another; it may be unstable.

    With the worst delay of the sensors' own clock and of jitter, by which the loop is never later. If it is unstable
    with that, although it is not by its eigenvalues over a period of both clocks, margins are of the loop without.
    """
    late = prepared.loop.worst_delay
    try:
        L = transfer_of(prepared, plant, controller)
        return Judged(L, margins_of(L))
    except (UnstableLoopError, ControllerError) as error:
        if not late:
            raise
        why = "the loop is unstable" if isinstance(error, UnstableLoopError) else str(error)
    radius = radius_of(prepared, plant, controller)
    if radius >= 1:
        raise UnstableLoopError(
            f"the closed loop is unstable (|z| = {radius:.6g} at a sample, expected below 1)", radius
        )
    L = transfer_of(prepared, plant, controller, late=0.0)
    left_out = f"without up to {1e3 * late:.4g} ms of delay by the sensors' clock and jitter"
    return Judged(L, margins_of(L), left_out, f"the margins are {left_out}: with it, {why}")


def radius_of(prepared: Prepared, plant: Platform, controller: LinearController) -> float:
    """The largest |z| of a sample of an experiment's loop, with the sensors' own clock, exactly, and without jitter.

    Lifted: x⁺ = M x over the least common multiple of both clocks; the root of M's largest |eigenvalue| for as many
    samples as there are. Refuses too many states.
    """
    loop, timing, where = prepared.loop, prepared.loop.timing, prepared.pose
    a_sample = timing.steps_a_sample
    a_reading = loop.steps_a_reading or a_sample
    step, period = math.gcd(a_sample, a_reading), math.lcm(a_sample, a_reading)
    P = held_plant(plant, controller, step * timing.plant_step, where, lag=loop.actuators.lag, side=loop.sensors.side)
    K = feedback_part(prepared.platform, controller, where)
    sizes = len(P.A), len(P.C), len(K.A), *[6] * (loop.actuators.delay + 1)
    if sum(sizes) > MOST_STATES:
        raise ControllerError(
            f"the loop over a period of both clocks has {sum(sizes)} states; expected at most {MOST_STATES}"
        )
    x, reading, memory, *forces = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
    for k in range(0, period, step):
        if k % a_reading == 0:
            reading = P.C @ x
        if k % a_sample == 0:
            forces = [*forces[1:], -(K.C @ memory + K.D @ reading)]
            memory = K.A @ memory + K.B @ reading
        x = P.A @ x + P.B @ forces[0]
    M = np.concatenate([x, reading, memory, *forces])
    return float(np.abs(np.linalg.eigvals(M)).max()) ** (a_sample / period) if np.isfinite(M).all() else math.inf


def robustness_of(experiment: Experiment) -> Robustness | None:
    """The disk margin of an experiment's loop as `margins` has it: 0 of an unstable loop, None if it has none."""
    try:
        prepared = prepare(load_experiment(experiment, {"limits.reference": "warn"}))
        form = prepared.linear_form()
        if form is None:
            return None
        try:
            _, disk, doubt, _ = judged(prepared, prepared.machine, form.controller, disk_of)
        except UnstableLoopError:
            return None if form.doubt else Robustness(0.0, math.nan, (1.0, 1.0))
    except ControllerError:
        return None
    return Robustness(disk.alpha, disk.frequency, disk.gain, "; ".join(filter(None, (form.doubt, doubt))))


def transfer_of(prepared: Prepared, plant: Platform, controller: LinearController, **replaced: Any) -> StateSpace:
    """L(z) of an experiment's loop around a plant, its platform or a machine, with a controller for its platform.

    In the first pose of the reference, or with `replaced` arguments of `loop_transfer`, `sample_time` among them.
    """
    loop, drives = prepared.loop, prepared.loop.actuators
    usual: dict[str, Any] = {
        "pose": prepared.pose,
        "sample_time": loop.timing.sample_time,
        "delay": drives.delay,
        "lag": drives.lag,
        "late": loop.worst_delay,
    }
    return loop_transfer(plant, controller, believed=prepared.platform, side=loop.sensors.side, **usual | replaced)


def _what_moved_it(prepared: Prepared, controller: LinearController, choice: ControllerChoice | None) -> list[str]:
    """Other changes that would stabilise a loop, each alone: rigid legs, no delay, no lag, a shorter sample time."""
    machine, sample_time = prepared.machine, prepared.loop.timing.sample_time
    delay, lag, late = prepared.loop.actuators.delay, prepared.loop.actuators.lag, prepared.loop.worst_delay

    def is_stable_with(plant: Platform = machine, law: LinearController = controller, **replaced: Any) -> bool:
        try:
            return is_stable(transfer_of(prepared, plant, law, **replaced))
        except ControllerError:  # too many states
            return False

    remedies = []
    if machine.leg_stiffness > 0 and is_stable_with(machine.with_parameters(RIGID)):
        free, _ = structural_modes(machine, prepared.pose)
        first = f", whose first structural mode is at {free[0].frequency:.3g} Hz" if free else ""
        remedies.append(
            f"it is stable on rigid legs: those of {machine.leg_stiffness:g} N/m{first}, limit the bandwidth"
        )
    for name, value, words in (
        ("delay", delay, f"the delay of {delay} samples"),
        ("lag", lag, f"the actuators' lag of {lag:g} s"),
        ("late", late, f"the delay of up to {1e3 * late:.4g} ms by the sensors' clock and jitter"),
    ):
        without: dict[str, Any] = {name: 0}
        if value and is_stable_with(**without):
            remedies.append(f"it is stable without {words}")
    for part in (2, 4, 8, 16):
        # a controller from a file is made for its own sample time
        shorter = sample_time / part
        faster = choice.controller(prepared.platform, shorter) if isinstance(choice, PD | PID) else None
        if isinstance(faster, LinearController) and is_stable_with(law=faster, sample_time=shorter):
            remedies.append(f"it is stable at a sample_time of {shorter:g} s")
            break
    return remedies


def decibels(factor: float) -> float:
    """A factor on a gain in dB."""
    return 20 * math.log10(factor) if 0 < factor < math.inf else math.inf


def _numbers_of_margins(margins: Margins, whose: str, doubt: str) -> list[Number]:
    """The numbers of the loop that runs, or of the "believed " one."""
    disk, at_once = margins.disk, "which all legs may have at once, independently of each other"
    values: list[tuple[str, float | None, Quantity, str]] = [
        ("disk margin", disk.alpha, NUMBER, f"size of the changes {at_once}"),
        ("gain of each leg", decibels(disk.gain[1]), DECIBEL, f"up or down, {at_once}"),
        ("phase of each leg", disk.phase, ANGLE, f"lag or lead, {at_once}"),
    ]
    alone = "with the loop open at this leg and closed at the others; the least of the legs"
    for legs, those, which in (
        ((margins.common,), "all legs", "the same for all legs"),
        (margins.legs, "one leg", alone),
    ):
        up = min(decibels(leg.gain_up) for leg in legs)
        down = min(decibels(1 / leg.gain_down) if leg.gain_down > 0 else math.inf for leg in legs)
        values += [
            (f"gain of {those}", min(up, down), DECIBEL, f"up or down, {which}"),
            (f"gain of {those}, up", up, DECIBEL, which),
            (f"gain of {those}, down", down, DECIBEL, which),
            (f"phase of {those}", min(leg.phase for leg in legs), ANGLE, f"lag or lead, {which}"),
            (f"further delay of {those}", min(leg.delay for leg in legs), _DELAY, which),
        ]
    crossover = max((leg.crossover for leg in margins.legs if math.isfinite(leg.crossover)), default=None)
    values += [
        ("highest crossover", crossover, FREQUENCY, "where the gain of a leg's loop falls below 1"),
        ("peak of σ(S)", margins.sensitivity_peak, NUMBER, "largest amplification"),
        ("peak of σ(T)", margins.complementary_peak, NUMBER, "resonance"),
    ]
    loop = "margins.believed" if whose else "margins"
    return [
        Number(f"{loop}.{path}", f"{whose}{name}", value, quantity, explanation=explanation, doubt=doubt)
        for path, (name, value, quantity, explanation) in zip(_OF_MARGINS, values, strict=True)
    ]


def _tables(analysis: LoopMargins) -> tuple[Section, Section]:
    """Margins of one leg at a time and of all at once; gains, modes, and what the structure does to the bandwidth."""
    heads = (
        Column("leg"),
        Column("gain", _FACTOR, "smallest factor on the gain at which the loop is stable"),
        Column("to", _FACTOR, "largest factor"),
        Column("phase", _PHASE, "largest lag or lead"),
        Column("delay", _DELAY, "the phase margin as time"),
        Column("crossover", _FREQUENCY, "highest frequency at which the gain is 1"),
    )
    alone = tuple(
        (which, leg.gain_down, leg.gain_up, leg.phase, leg.delay, leg.crossover)
        for which, leg in (*((str(k), leg) for k, leg in enumerate(analysis.legs, 1)), ("all alike", analysis.common))
    )
    disk = analysis.disk
    together: tuple[tuple[Cell, ...], ...] = (
        ("disk margin α", f"{_THREE.text(disk.alpha)} at {_FREQUENCY.text(disk.frequency)}"),
        ("gains of all legs, independently", f"× {disk.gain[0]:.3g} to {_THREE.text(disk.gain[1])}"),
        ("phases of all legs, independently", f"± {_PHASE.text(disk.phase)}"),
        ("peak of σ(S)", Value(analysis.sensitivity_peak, _THREE)),
        ("peak of σ(T)", Value(analysis.complementary_peak, _THREE)),
    )
    of_margins = Section(
        "Margins",
        (
            Table("Margins, one leg at a time, and the same change of all", heads, alone),
            Table(
                "Independent changes of all legs at once", (Column("measure"), Column("value")), together, beside=True
            ),
        ),
    )

    parts: list[Table | Note] = []
    if (gains := analysis.gains) is not None:
        five = Quantity("", "", digits=5)
        actions = (gains.proportional, gains.derivative, gains.integral)
        columns = (Column("channel"), *(Column(name, five) for name in ("kp", "kd", "ki")))
        rows = zip(*(np.asarray(action).tolist() for action in actions), strict=True)
        parts.append(Table("Gains", columns, tuple((str(k), *row) for k, row in enumerate(rows, 1))))
    columns = (
        Column("mode", explanation="of the closed loop, the slowest first"),
        Column("frequency", FREQUENCY),
        Column("damping ratio", _THREE),
        Column("eigenvalue [1/s]"),
    )
    of_modes = []
    for k, mode in enumerate(analysis.modes, 1):
        value = f"{mode.eigenvalue.real:.4g}" + (f" ± {mode.eigenvalue.imag:.4g}i" if mode.eigenvalue.imag else "")
        of_modes.append((str(k), mode.frequency, mode.damping_ratio, value))
    parts.append(Table("Modes of the closed loop", columns, tuple(of_modes), first_shown=_SHOWN_MODES))
    structure = analysis.structure
    if structure is None or not structure.modes:
        return of_margins, Section("Design", tuple(parts))
    columns = (
        Column("mode", explanation="of the platform on its legs, the slowest first"),
        Column("frequency", FREQUENCY, "with motors that are free: a resonance of the loop"),
        Column("damping ratio", _THREE),
        Column("motors held", FREQUENCY, "the natural frequency with motors that hold"),
        Column("gain of L", DECIBEL, "largest singular value there; below 0 dB no phase makes the mode unstable"),
    )
    structural = tuple(
        (str(k), mode.frequency, mode.damping_ratio, mode.held_frequency, decibels(mode.gain))
        for k, mode in enumerate(structure.modes, 1)
    )
    parts.append(Table("Structural modes", columns, structural))
    first, bandwidth = structure.modes[0].frequency, structure.bandwidth
    first_mode = f"the first structural mode at {about(FREQUENCY, first, 3)}"
    if bandwidth is not None and math.isnan(bandwidth):
        text = (
            f"With {first_mode}, this controller has no bandwidth with a disk margin of {structure.disk:g}; a notch, "
            "more damping or stiffer legs may give one."
        )
        parts.append(Note(text))
    elif bandwidth is not None:
        text = (
            f"This controller keeps a disk margin of {structure.disk:g} up to a bandwidth of "
            f"{about(FREQUENCY, bandwidth, 3)}, {bandwidth / first:.2g} of {first_mode}."
        )
        parts.append(Note(text))
    return of_margins, Section("Design", tuple(parts))


def _responses(analysis: LoopMargins) -> tuple[Chart, ...]:
    """Gain and phase of each leg's loop with the least margins of all legs, and the singular values of S and T."""
    L, legs = analysis.transfer, analysis.legs
    low, high = frequency_range(L)
    # the range begins far below the slowest pole, where curves are flat
    omega = np.geomspace(min(30 * low, high / 10), high * (1 - 1e-9), _POINTS)
    frequency = Axis("frequency", FREQUENCY, omega / (2 * math.pi), scale="log")
    everything, gain, phase = response(L, omega), list[Series](), list[Series]()
    for k in range(len(legs)):
        loop = one_leg_open(everything, k)
        angle = np.unwrap(np.angle(loop))
        angle -= 2 * math.pi * (angle[0] > math.radians(90.5))  # a loop that begins at 180° begins at −180°
        gain.append(Series(f"leg {k + 1}", _GAIN, np.abs(loop), leg=k + 1))
        phase.append(Series(f"leg {k + 1}", ANGLE, np.where(np.abs(loop) > _BELOW, angle, np.nan), leg=k + 1))
    sigma = list[Series]()
    roles: tuple[Role, ...] = ("actual", "published")
    for matrices, name, color in zip(sensitivities(L, omega), ("S", "T"), roles, strict=True):
        singular = np.asarray(np.linalg.svd(matrices, compute_uv=False), dtype=float)
        sigma.append(Series(f"σ({name})", _GAIN, singular[:, 0], color, low=singular[:, -1], high=singular[:, 0]))

    # the least gain margins, from the gain of L to 1; the least phase margin, from the phase to ±180°
    role: Role = "marginal" if analysis.disk.alpha < FRAIL else "good"
    shown, gains, phases = frequency.values, list[Span](), list[Span]()

    def which(leg: ClassicalMargins) -> str:
        # legs that are alike up to rounding are told as any
        spread = max(one_leg.phase for one_leg in legs) - min(one_leg.phase for one_leg in legs)
        return "any leg" if spread < _ALIKE * leg.phase else f"leg {legs.index(leg) + 1}"

    up, down = min(legs, key=lambda leg: leg.gain_up), max(legs, key=lambda leg: leg.gain_down)
    for leg, factor, at in ((up, up.gain_up, up.gain_up_at), (down, down.gain_down, down.gain_down_at)):
        if shown[0] <= at <= shown[-1]:
            low, high = sorted((1.0, 1 / factor))
            size = DECIBEL.text(decibels(high / low))
            gains.append(Span(at, low, high, f"gain margin {size} at {about(FREQUENCY, at, 3)}, {which(leg)}", role))
    least = min(legs, key=lambda leg: leg.phase)
    if shown[0] <= least.phase_at <= shown[-1]:
        angle = phase[legs.index(least)].values
        has_phase = np.isfinite(angle)
        there = float(np.interp(math.log(least.phase_at), np.log(shown[has_phase]), angle[has_phase]))
        # the odd multiple of 180° that is nearest
        low, high = sorted((there, math.pi * (2 * round((there / math.pi - 1) / 2) + 1)))
        text = f"phase margin {_PHASE.text(least.phase)} at {about(FREQUENCY, least.phase_at, 3)}, {which(least)}"
        phases.append(Span(least.phase_at, low, high, text, role))

    # the share that is compensated of a step of force on each leg, until the slowest mode has decayed to e⁻⁶
    closed = closed_loop(L)
    end = 6 / min((-mode.eigenvalue.real for mode in modes(closed)), default=6.0)
    time = float(closed.dt) * np.arange(min(math.ceil(end / closed.dt) + 1, _LONGEST), dtype=float)
    # column k of the states answers to leg k
    states, values = np.zeros(closed.B.shape), np.empty((len(L.C), len(time)))
    direct = np.diag(closed.D)
    for n in range(len(time)):
        values[:, n] = (closed.C * states.T).sum(axis=1) + direct
        states = closed.A @ states + closed.B
    # slow modes may hardly show: end soon after the response has settled
    moving = np.nonzero((np.abs(values - values[:, -1:]) > _SETTLED).any(axis=0))[0]
    n_shown = min(len(time), max(10, int(1.5 * (moving[-1] + 1)))) if moving.size else len(time)
    rows = slice(0, n_shown, max(1, n_shown // _STEP_POINTS))
    step = Chart(
        "a step of force on one leg: the share that the controller compensates",
        time_axis(time[rows]),
        tuple(Series(f"leg {k}", SHARE, answer[rows], leg=k) for k, answer in enumerate(values, 1)),
        y=Axis("share compensated", SHARE),
        marks=(Mark(1.0, "all of it", role="neutral", tells=False),),
        group="step",
    )

    unity = (Mark(1.0, "gain of 1", role="neutral", tells=False),)
    resonances = [mode.frequency for mode in analysis.structure.modes[:1]] if analysis.structure is not None else []
    at_modes = [Mark(at, "first structural mode", "vertical", "neutral") for at in resonances if at < shown[-1]]
    of_disk = Mark(analysis.disk.frequency, f"disk margin {analysis.disk.alpha:.3g} at", "vertical", role)
    alone, log = "one leg cut, the others closed", Axis("gain of L", _GAIN, scale="log")
    return (
        Chart(f"gain of L, {alone}", frequency, tuple(gain), y=log, marks=(*unity, *at_modes), spans=tuple(gains),
              group="bode"),
        Chart(f"phase of L, {alone}", frequency, tuple(phase), y=Axis("phase of L", ANGLE), group="bode",
              spans=tuple(phases), marks=(Mark(-math.pi, "−180°", role="neutral", tells=False),)),
        Chart("singular values of S and T, all legs closed", frequency, tuple(sigma), marks=(*unity, of_disk),
              y=Axis("singular value", _GAIN, scale="log"), group="bode"),
        step,
    )  # fmt: skip
