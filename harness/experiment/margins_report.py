"""The margins of a loop, from its linear analysis: numbers, what limits them, and their report with responses."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from gough_stewart.harness.control.linear import Mode, modes
from gough_stewart.harness.control.loop_transfer import LoopStructure
from gough_stewart.harness.control.margins import (
    ClassicalMargins,
    Margins,
    closed_loop,
    frequency_range,
    one_leg_open,
    response,
    sensitivities,
)
from gough_stewart.harness.control.pid import Gains
from gough_stewart.harness.control.state_space import StateSpace, control_system
from gough_stewart.harness.output.versions import versions
from gough_stewart.harness.report.chart import Axis, Chart, Mark, Series, Span, time_axis
from gough_stewart.harness.report.document import Note, Number, Report, Section, Verdict, settings_of
from gough_stewart.harness.report.notebook import to_html
from gough_stewart.harness.report.palette import Role
from gough_stewart.harness.report.quantities import ANGLE, DECIBEL, FREQUENCY, NUMBER, SHARE, TIME, Quantity
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.report.words import about, at_least, counted, listed, sentence

_SHOWN_MODES = 8
_ACTIONS = ("proportional", "derivative", "integral")
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
_LINEAR = (
    "Linear model at the first pose of the reference: without Coulomb friction, limits and quantisation, and of the "
    "nominal machine. `run` has these; `ensemble` has machines that differ."
)
_WORST = (
    "The sensors' own clock and jitter are modelled as their worst delay, a constant one: the loop is never later, and "
    "mostly earlier."
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
# Numbers that once were of something else, in requirements that may be as old, and what they are of.
RENAMED = {
    "margins.gain": "the same gain of all legs; the disk's guarantee for independent changes is margins.disk_gain",
    "margins.phase": "the same phase of all legs; the disk's guarantee for independent changes is margins.disk_phase",
    "margins.delay": "the same delay of all legs; that of one leg alone is margins.leg.delay",
}


@dataclass(frozen=True, eq=False, repr=False)
class LoopMargins(Margins):
    """Stability margins of an experiment's loop, from `margins`.

    Of the loop that runs: the machine with the controller that is designed on the believed platform.

    `legs` has for each leg, with the others closed, `gain_up` and `gain_down` (factors), `phase` [rad], `delay` [s] and
    `crossover` [Hz]; `common` has the same of one change of all legs. `disk` has what all legs may have independently
    of each other: `alpha`, `gain`, `phase` [rad] and `frequency` [Hz]. `sensitivity_peak` and `complementary_peak` are
    the largest σ(S) and σ(T).
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
    """What was set of the experiment's file, as `Experiment.changed`."""
    structure: LoopStructure | None = None
    """Of a machine whose legs give: the structural modes, each with `frequency`, `damping_ratio`, `held_frequency` and
    `gain`, and the largest `bandwidth` [Hz] of the controller with a disk margin of at least `disk`."""
    late: float = 0.0
    """What the sensors' own clock and jitter add to the delay at worst, as modelled in these margins [s]."""
    doubt: str = ""
    """What these margins leave out, so that a requirement on them cannot be told."""
    believed: Margins | None = None
    """Of the loop with the believed platform as machine, where that differs and is stable."""
    warnings: tuple[str, ...] = ()
    """What else is to be known of these margins, one sentence each."""

    @property
    def loop(self) -> Any:
        """The same as a python-control system."""
        return control_system(self.transfer)

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
        """How much gain, phase and delay the loop bears, and what limits it.

        Returns
        -------
        Report
            Verdict, numbers such as `margins.disk` and `margins.delay`, tables, and with `charts` the responses.
        """
        sections = [Section("Margins", (_legs(self), _together(self)))]
        sections.append(Section("Design", (*_gains(self), _modes(self), *_structure(self))))
        if charts:
            sections.append(Section("Responses", (*_responses(self), _step(self.transfer))))
        lag = f", lag of the drives {about(TIME, self.lag)}" if self.lag else ""
        late = f" and up to {about(_DELAY, self.late)} by the sensors' clock and jitter" if self.late else ""
        delay = f"delay of {counted(self.delay, 'sample')}{late}"
        return Report(
            self.title,
            _verdict(self),
            tuple(sections),
            study="margins",
            lead=f"sampled every {about(_DELAY, self.sample_time, 4)}, {delay}{lag}",
            settings=settings_of(self.changed),
            numbers=_numbers(self),
            notes=(
                *(Note(text, "warning") for text in self.warnings),
                Note(_LINEAR),
                *([Note(_WORST)] if self.late else []),
            ),
        )

    def as_dict(self) -> dict[str, Any]:
        """As plain types, as in margins.json; None for infinite or undefined values."""
        return {
            "title": self.title,
            "sample_time": self.sample_time,
            "delay": self.delay,
            "lag": self.lag,
            "late": self.late,
            "gains": None
            if self.gains is None
            else {
                **{name: np.asarray(getattr(self.gains, name)).tolist() for name in _ACTIONS},
                "derivative_filter": self.gains.filter_time,
            },
            "modes": [
                {
                    "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
                    "frequency": mode.frequency,
                    "damping_ratio": mode.damping_ratio,
                }
                for mode in self.modes
            ],
            "margins": Margins(*(getattr(self, part.name) for part in fields(Margins))).as_dict(),
            **({} if self.believed is None else {"believed": self.believed.as_dict()}),
            **({} if self.structure is None else {"structure": _plain_structure(self.structure)}),
        }


def decibels(factor: float) -> float:
    """A factor on a gain in dB."""
    return 20 * math.log10(factor) if 0 < factor < math.inf else math.inf


def _verdict(analysis: LoopMargins) -> Verdict:
    """How much gain, phase and delay the loop bears."""
    disk, common = analysis.disk, analysis.common
    numbers = {number.path: number for number in _numbers(analysis)}
    gain, guaranteed = (numbers[path].value for path in ("margins.gain", "margins.disk_gain"))
    alone = "any factor" if guaranteed is None else at_least(DECIBEL, guaranteed)
    bears = [
        "any gain" if gain is None else f"{at_least(DECIBEL, gain)} of gain",
        f"{at_least(ANGLE, common.phase)} of phase" if math.isfinite(common.phase) else "any phase",
        f"{at_least(_DELAY, common.delay)} of further delay" if math.isfinite(common.delay) else "any delay",
    ]
    text = sentence(
        [
            f"stable: with the same change of all legs it bears {listed(bears, 'or')}",
            f"each leg by itself may change by {alone} or {at_least(ANGLE, disk.phase)}",
            f"disk margin {disk.alpha:.2g} at {about(FREQUENCY, disk.frequency)}",
            analysis.doubt,
        ]
    )
    carried = tuple(numbers[f"margins.{name}"] for name in ("disk", "gain", "phase", "delay"))
    return Verdict(text, "marginal" if disk.alpha < FRAIL or analysis.doubt else "good", carried)


def _numbers(analysis: LoopMargins) -> tuple[Number, ...]:
    doubt, other = analysis.doubt, analysis.believed
    slowest, damping_ratio = analysis.modes[0].frequency, min(mode.damping_ratio for mode in analysis.modes)
    of_machine = (
        *_numbers_of_margins(analysis, "", doubt),
        Number("modes.slowest", "slowest mode", slowest, FREQUENCY, explanation="of the closed loop", doubt=doubt),
        Number("modes.damping_ratio", "least damping ratio", damping_ratio,
               explanation="of all modes of the closed loop", doubt=doubt),
    )  # fmt: skip
    believed = () if other is None else _numbers_of_margins(other, "believed ", doubt)
    return (*of_machine, *believed, *_numbers_of(analysis.structure))


def _numbers_of_margins(margins: Margins, whose: str, doubt: str) -> tuple[Number, ...]:
    """The numbers of the loop that runs, or of the "believed " one."""
    disk = margins.disk
    at_once = "which all legs may have at once, independently of each other"
    rows: dict[str, tuple[str, float | None, Quantity, str]] = {
        "disk": ("disk margin", disk.alpha, NUMBER, f"size of the changes {at_once}"),
        "disk_gain": ("gain of each leg", decibels(disk.gain[1]), DECIBEL, f"up or down, {at_once}"),
        "disk_phase": ("phase of each leg", disk.phase, ANGLE, f"lag or lead, {at_once}"),
    }
    alone = "with the loop open at this leg and closed at the others; the least of the legs"
    for where, legs, those, which in (
        ("", (margins.common,), "all legs", "the same for all legs"),
        ("leg.", margins.legs, "one leg", alone),
    ):
        up = min(decibels(leg.gain_up) for leg in legs)
        down = min(decibels(1 / leg.gain_down) if leg.gain_down > 0 else math.inf for leg in legs)
        rows |= {
            f"{where}gain": (f"gain of {those}", min(up, down), DECIBEL, f"up or down, {which}"),
            f"{where}gain_up": (f"gain of {those}, up", up, DECIBEL, which),
            f"{where}gain_down": (f"gain of {those}, down", down, DECIBEL, which),
            f"{where}phase": (f"phase of {those}", min(leg.phase for leg in legs), ANGLE, f"lag or lead, {which}"),
            f"{where}delay": (f"further delay of {those}", min(leg.delay for leg in legs), _DELAY, which),
        }
    crossover = max((leg.crossover for leg in margins.legs if math.isfinite(leg.crossover)), default=None)
    rows |= {
        "crossover": ("highest crossover", crossover, FREQUENCY, "where the gain of a leg's loop falls below 1"),
        "sensitivity_peak": ("peak of σ(S)", margins.sensitivity_peak, NUMBER, "largest amplification"),
        "complementary_peak": ("peak of σ(T)", margins.complementary_peak, NUMBER, "resonance"),
    }
    loop = "margins.believed" if whose else "margins"
    return tuple(
        Number(f"{loop}.{path}", f"{whose}{name}", value, quantity, explanation=explanation, doubt=doubt)
        for path, (name, value, quantity, explanation) in rows.items()
    )


def _numbers_of(structure: LoopStructure | None) -> tuple[Number, ...]:
    """Of legs that give."""
    if structure is None or not structure.modes:
        return ()
    first = structure.modes[0]
    gain = max((mode.gain for mode in structure.modes if not math.isnan(mode.gain)), default=None)
    bandwidth = None if structure.bandwidth is None or math.isnan(structure.bandwidth) else structure.bandwidth
    return (
        Number("structure.first_mode", "first structural mode", first.frequency, FREQUENCY,
               explanation="of the platform on its legs, with motors that are free"),
        Number("structure.damping_ratio", "its damping ratio", first.damping_ratio),
        Number("structure.gain", "gain of L at a structural mode", None if gain is None else decibels(gain), DECIBEL,
               explanation="largest singular value, of all modes; below 0 dB no phase makes a mode unstable"),
        Number("structure.bandwidth", "largest bandwidth", bandwidth, FREQUENCY,
               explanation=f"of this controller with a disk margin of at least {structure.disk:g}"),
    )  # fmt: skip


def _structure(analysis: LoopMargins) -> tuple[Table | Note, ...]:
    structure = analysis.structure
    if structure is None or not structure.modes:
        return ()
    columns = (
        Column("mode", explanation="of the platform on its legs, the slowest first"),
        Column("frequency", FREQUENCY, "with motors that are free: a resonance of the loop"),
        Column("damping ratio", Quantity("", "", digits=3)),
        Column("motors held", FREQUENCY, "the natural frequency with motors that hold"),
        Column("gain of L", DECIBEL, "largest singular value there; below 0 dB no phase makes the mode unstable"),
    )
    rows = tuple(
        (str(k), mode.frequency, mode.damping_ratio, mode.held_frequency, decibels(mode.gain))
        for k, mode in enumerate(structure.modes, 1)
    )
    return Table("Structural modes", columns, rows), *_allowed(structure)


def _allowed(structure: LoopStructure) -> tuple[Note, ...]:
    """What the first mode does to the bandwidth."""
    if structure.bandwidth is None:
        return ()
    first = about(FREQUENCY, structure.modes[0].frequency, 3)
    if math.isnan(structure.bandwidth):
        return (
            Note(
                f"With the first structural mode at {first}, this controller has no bandwidth with a disk margin of "
                f"{structure.disk:g}; a notch, more damping or stiffer legs may give one."
            ),
        )
    share = structure.bandwidth / structure.modes[0].frequency
    return (
        Note(
            f"This controller keeps a disk margin of {structure.disk:g} up to a bandwidth of "
            f"{about(FREQUENCY, structure.bandwidth, 3)}, {share:.2g} of the first structural mode at {first}."
        ),
    )


def _legs(analysis: LoopMargins) -> Table:
    columns = (
        Column("leg"),
        Column("gain", _FACTOR, "smallest factor on the gain at which the loop is stable"),
        Column("to", _FACTOR, "largest factor"),
        Column("phase", _PHASE, "largest lag or lead"),
        Column("delay", _DELAY, "the phase margin as time"),
        Column("crossover", replace(FREQUENCY, digits=3), "highest frequency at which the gain is 1"),
    )
    rows = tuple(
        (which, leg.gain_down, leg.gain_up, leg.phase, leg.delay, leg.crossover)
        for which, leg in (*((str(k), leg) for k, leg in enumerate(analysis.legs, 1)), ("all alike", analysis.common))
    )
    return Table("Margins, one leg at a time, and the same change of all", columns, rows)


def _together(analysis: LoopMargins) -> Table:
    disk = analysis.disk
    three = Quantity("", "", digits=3)
    rows: tuple[tuple[Cell, ...], ...] = (
        ("disk margin α", f"{three.text(disk.alpha)} at {replace(FREQUENCY, digits=3).text(disk.frequency)}"),
        ("gains of all legs, independently", f"× {disk.gain[0]:.3g} to {three.text(disk.gain[1])}"),
        ("phases of all legs, independently", f"± {_PHASE.text(disk.phase)}"),
        ("peak of σ(S)", Value(analysis.sensitivity_peak, three)),
        ("peak of σ(T)", Value(analysis.complementary_peak, three)),
    )
    return Table("Margins, independent changes of all legs at once", (Column("measure"), Column("value")), rows)


def _gains(analysis: LoopMargins) -> tuple[Table, ...]:
    if analysis.gains is None:
        return ()
    five = Quantity("", "", digits=5)
    parts = (analysis.gains.proportional, analysis.gains.derivative, analysis.gains.integral)
    columns = (Column("channel"), *(Column(name, five) for name in ("kp", "kd", "ki")))
    rows = zip(*(np.asarray(part).tolist() for part in parts), strict=True)
    return (Table("Gains", columns, tuple((str(k), *row) for k, row in enumerate(rows, 1))),)


def _modes(analysis: LoopMargins) -> Table:
    columns = (
        Column("mode", explanation="of the closed loop, the slowest first"),
        Column("frequency", FREQUENCY),
        Column("damping ratio", Quantity("", "", digits=3)),
        Column("eigenvalue [1/s]"),
    )
    rows = []
    for k, mode in enumerate(analysis.modes, 1):
        value = f"{mode.eigenvalue.real:.4g}" + (f" ± {mode.eigenvalue.imag:.4g}i" if mode.eigenvalue.imag else "")
        rows.append((str(k), mode.frequency, mode.damping_ratio, value))
    return Table("Modes of the closed loop", columns, tuple(rows), first_shown=_SHOWN_MODES)


def _responses(analysis: LoopMargins) -> tuple[Chart, ...]:
    L = analysis.transfer
    low, high = frequency_range(L)
    # the range begins far below the slowest pole, where curves are flat
    omega = np.geomspace(min(30 * low, high / 10), high * (1 - 1e-9), _POINTS)
    frequency = Axis("frequency", FREQUENCY, omega / (2 * math.pi), scale="log")
    everything = response(L, omega)
    loops = [one_leg_open(everything, k) for k in range(len(analysis.legs))]
    angles = []
    for loop in loops:
        angle = np.unwrap(np.angle(loop))
        angle -= 2 * math.pi * (angle[0] > math.radians(90.5))  # a loop that begins at 180° begins at −180°
        angles.append(np.where(np.abs(loop) > _BELOW, angle, np.nan))
    gain = tuple(Series(f"leg {k}", _GAIN, np.abs(loop), leg=k) for k, loop in enumerate(loops, 1))
    phase = tuple(Series(f"leg {k}", ANGLE, angle, leg=k) for k, angle in enumerate(angles, 1))
    sigma = []
    roles: tuple[Role, ...] = ("actual", "published")
    for matrices, name, role in zip(sensitivities(L, omega), ("S", "T"), roles, strict=True):
        singular = np.asarray(np.linalg.svd(matrices, compute_uv=False), dtype=float)
        sigma.append(Series(f"σ({name})", _GAIN, singular[:, 0], role, low=singular[:, -1], high=singular[:, 0]))
    one = (Mark(1.0, "gain of 1", role="neutral", tells=False),)
    legs = _first_mode(analysis, frequency.values)
    text = f"disk margin {analysis.disk.alpha:.3g} at"
    of_disk = (Mark(analysis.disk.frequency, text, "vertical", _margin_role(analysis)),)
    gain_margins, phase_margins = _margins_of_one(analysis, frequency.values, angles)
    alone = "one leg cut, the others closed"
    log = Axis("gain of L", _GAIN, scale="log")
    return (
        Chart(f"gain of L, {alone}", frequency, gain, y=log, marks=(*one, *legs), spans=gain_margins, group="bode"),
        Chart(f"phase of L, {alone}", frequency, phase, y=Axis("phase of L", ANGLE), group="bode",
              spans=phase_margins, marks=(Mark(-math.pi, "−180°", role="neutral", tells=False),)),
        Chart("singular values of S and T, all legs closed", frequency, tuple(sigma), marks=(*one, *of_disk),
              y=Axis("singular value", _GAIN, scale="log"), group="bode"),
    )  # fmt: skip


def _first_mode(analysis: LoopMargins, frequency: np.ndarray) -> tuple[Mark, ...]:
    """Where legs that give begin to resonate."""
    if analysis.structure is None or not analysis.structure.modes:
        return ()
    at = analysis.structure.modes[0].frequency
    return (Mark(at, "first structural mode", "vertical", "neutral"),) if at < frequency[-1] else ()


def _margin_role(analysis: LoopMargins) -> Role:
    return "marginal" if analysis.disk.alpha < FRAIL else "good"


def _margins_of_one(
    analysis: LoopMargins, frequency: np.ndarray, angles: Sequence[np.ndarray]
) -> tuple[tuple[Span, ...], tuple[Span, ...]]:
    """The least gain margins of all legs, from the gain of L to 1; the least phase margin, from the phase to ±180°."""
    legs, role = analysis.legs, _margin_role(analysis)
    gains: list[Span] = []
    up, down = min(legs, key=lambda leg: leg.gain_up), max(legs, key=lambda leg: leg.gain_down)
    for leg, factor, at in ((up, up.gain_up, up.gain_up_at), (down, down.gain_down, down.gain_down_at)):
        if frequency[0] <= at <= frequency[-1]:
            low, high = sorted((1.0, 1 / factor))
            size = DECIBEL.text(decibels(high / low))
            gains.append(
                Span(at, low, high, f"gain margin {size} at {about(FREQUENCY, at, 3)}, {_of_legs(legs, leg)}", role)
            )
    least = min(legs, key=lambda leg: leg.phase)
    if not frequency[0] <= least.phase_at <= frequency[-1]:
        return tuple(gains), ()
    angle = angles[legs.index(least)]
    known = np.isfinite(angle)
    phase = float(np.interp(math.log(least.phase_at), np.log(frequency[known]), angle[known]))
    # the odd multiple of 180° that is nearest
    low, high = sorted((phase, math.pi * (2 * round((phase / math.pi - 1) / 2) + 1)))
    text = f"phase margin {_PHASE.text(least.phase)} at {about(FREQUENCY, least.phase_at, 3)}, {_of_legs(legs, least)}"
    return tuple(gains), (Span(least.phase_at, low, high, text, role),)


def _of_legs(legs: Sequence[ClassicalMargins], one: ClassicalMargins) -> str:
    """Which leg; legs that are alike up to rounding are told as any."""
    alike = max(leg.phase for leg in legs) - min(leg.phase for leg in legs) < _ALIKE * one.phase
    return "any leg" if alike else f"leg {legs.index(one) + 1}"


def _step(L: StateSpace) -> Chart:
    """The share that is compensated of a step of force on each leg, until the slowest mode has decayed to e⁻⁶."""
    closed = closed_loop(L)
    end = 6 / min((-mode.eigenvalue.real for mode in modes(closed)), default=6.0)
    time = float(closed.dt) * np.arange(min(math.ceil(end / closed.dt) + 1, _LONGEST), dtype=float)
    # column k of the states answers to leg k
    states, values = np.zeros(closed.B.shape), np.empty((L.noutputs, len(time)))
    direct = np.diag(closed.D)
    for n in range(len(time)):
        values[:, n] = (closed.C * states.T).sum(axis=1) + direct
        states = closed.A @ states + closed.B
    # slow modes may hardly show: end soon after the response has settled
    moving = np.nonzero((np.abs(values - values[:, -1:]) > _SETTLED).any(axis=0))[0]
    shown = min(len(time), max(10, int(1.5 * (moving[-1] + 1)))) if moving.size else len(time)
    some = slice(0, shown, max(1, shown // _STEP_POINTS))
    return Chart(
        "a step of force on one leg: the share that the controller compensates",
        time_axis(time[some]),
        tuple(Series(f"leg {k}", SHARE, answer[some], leg=k) for k, answer in enumerate(values, 1)),
        y=Axis("share compensated", SHARE),
        marks=(Mark(1.0, "all of it", role="neutral", tells=False),),
        group="step",
    )


def margins_file(margins: LoopMargins) -> bytes:
    """The numbers as JSON, with the versions of the software."""
    return (json.dumps({**margins.as_dict(), "versions": versions()}, indent=2) + "\n").encode()


def _plain_structure(structure: LoopStructure) -> dict[str, Any]:
    """In plain types; None where there is none."""

    def number(value: float | None) -> float | None:
        return None if value is None or math.isnan(value) else value

    modes = [{name: number(value) for name, value in mode._asdict().items()} for mode in structure.modes]
    return {"modes": modes, "disk": structure.disk, "bandwidth": number(structure.bandwidth)}
