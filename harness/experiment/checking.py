"""Whether a platform can follow the motion of an experiment, what the motion needs, and how it would fit."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import polars

from gough_stewart.harness.errors import ExperimentError, MotionError
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.overrides import Settings
from gough_stewart.harness.experiment.preparation import (
    limited_platform,
    nominal_platform,
    reference_motion,
    timing_of,
)
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.loop import Timing
from gough_stewart.harness.motion.limits.needs import (
    LEGS,
    OF_LIMIT,
    Needs,
    leg_tables,
    needs_along,
    summary_tables,
)
from gough_stewart.harness.motion.limits.reach import factor_near, scale_that_fits
from gough_stewart.harness.motion.limits.shares import (
    DYNAMIC,
    LABELS,
    OPTIONAL,
    Peak,
    Shares,
    loads_of_legs,
    shares_along,
)
from gough_stewart.harness.motion.motion import Motion, Reference, slower
from gough_stewart.harness.motion.references import Sine
from gough_stewart.harness.report.chart import Chart, Mark, Series, strip_of, time_axis
from gough_stewart.harness.report.document import (
    Cell,
    Column,
    Note,
    Number,
    Report,
    Section,
    Status,
    Table,
    Value,
    Verdict,
    settings_of,
)
from gough_stewart.harness.report.page import to_html
from gough_stewart.harness.report.palette import Role
from gough_stewart.harness.report.quantities import fine, fineness_of, listed, number_text, of_unit, percent, sentence
from gough_stewart.harness.results.metric_folds import AXES
from gough_stewart.harness.section import plain, readable_json
from gough_stewart.model.dynamics import LARGEST_CONDITION_NUMBER
from gough_stewart.model.kinematics import condition_number_bound, jacobian_of_legs, leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.installed import versions
from gough_stewart.model.units import number
from gough_stewart.model.vectors import first_of_largest

Fit = Literal["time", "amplitude"]
FILES = ("check.json", "needs.csv")
_DIGITS = 9
_ROUNDING = 1e-9
# Combinations of phases, phases of one axis, and rows of a period, of which the worst is looked for.
_COMBINATIONS, _MOST_PHASES, _ROWS_OF_PERIOD = 1024, 24, 60
# A motion that needs more of a limit is done with little room.
_NEAR = 0.9
# Larger shares would flatten the others; tables have them.
_HIGHEST = 2.0
# Of strips one above the other.
_STRIPS: tuple[Role, ...] = ("bad", "marginal", "published", "measured", "neutral")
_OF_LEG = {
    "stroke": "stroke",
    "joint_angle_max": "joint angle",
    "leg_velocity_max": "speed",
    "leg_acceleration_max": "acceleration",
    "actuator_force_max": "force",
    "actuator_power_max": "power",
}
# The keys that a payload changes.
_OF_PAYLOAD = tuple(f"platform.parameters.platform_{name}" for name in ("mass", "com", "inertia"))

# All numbers that a check may have.
PATHS = tuple(f"limits.{name}" for name in LABELS)


def absent_numbers(experiment: Experiment) -> dict[str, str]:
    """The paths of limits that the platform of an experiment does not state, and what would state each."""
    force_limit = experiment.actuators.force_limit
    platform = limited_platform(nominal_platform(experiment, experiment.platform), force_limit)
    absent = {}
    for name in OPTIONAL:
        parameters = ("leg_length_min", "leg_length_max") if name == "stroke" else (name,)
        if all(getattr(platform, parameter) is None for parameter in parameters):
            keys = [f"platform.parameters.{parameter}" for parameter in parameters]
            if name == "actuator_force_max" and force_limit == "none":
                keys = ["actuators.force_limit"]
            absent[f"limits.{name}"] = f"no limit of the {LABELS[name]} is stated; set {' or '.join(keys)}"
    return absent


@dataclass(frozen=True, eq=False, repr=False)
class MotionCheck:
    """The share of every limit that a motion uses, and its actuator requirements; from `check`."""

    experiment: Experiment
    """The experiment."""
    platform: Platform
    """The nominal model, with the force limit of the experiment's actuators."""
    shares: Shares
    """Shares of every limit at every row of the run; see `shares_along`."""
    needs: Needs
    """What the motion needs of each leg, whatever limits are stated; see `needs_along`."""
    _reference: Reference
    _motion: Motion
    _timing: Timing
    payload: str = ""
    """What the platform carries besides its own mass, such as "300 kg at 0.5 m"; "" for nothing."""

    @property
    def title(self) -> str:
        """Title of the experiment."""
        return self.experiment.title

    @property
    def within(self) -> bool:
        """Whether the motion respects all limits that the platform states; `not_stated` lists the others."""
        return self.shares.within

    @property
    def not_stated(self) -> tuple[str, ...]:
        """Names of the limits that the platform does not state, so that they were not checked."""
        return tuple(name for name in OPTIONAL if name not in self.shares.of)

    @property
    def margin(self) -> float:
        """The share of the dynamic limits that the reference reserves for the controller; 0 if it reserves none."""
        return float(getattr(self.experiment.reference, "margin", 0.0))

    @property
    def keeps_margin(self) -> bool:
        """Whether the motion leaves its margin of leg velocity, leg acceleration, force and power."""
        used = max((self.shares.peak(name).share for name in DYNAMIC if name in self.shares.of), default=0.0)
        return used <= (1 - self.margin) * (1 + _ROUNDING)

    @cached_property
    def time_factor(self) -> float | None:
        """The time scale at which the motion fits and leaves its margin, 1 if it does already; None if none does."""
        worst, total = self.experiment.limits.condition_number, None if self.margin else self.shares.total
        return scale_that_fits(self._less_margin, self._motion, None, worst, total)

    @cached_property
    def amplitude_factor(self) -> float | None:
        """The amplitude scale at which the motion fits and leaves its margin, 1 if it does; None if none does."""
        worst, total = self.experiment.limits.condition_number, None if self.margin else self.shares.total
        return scale_that_fits(self._less_margin, self._motion, self._reference.centre, worst, total)

    @cached_property
    def worst_phases(self) -> "tuple[WorstPhases, ...] | None":
        """The phases of the axes of a sine that need most of the legs; None of other motions, or of one axis.

        Returns
        -------
        tuple
            Stroke, speed, force and power with the phases as given, with the worst ones, and these.
        """
        reference = self._reference
        if not isinstance(reference, Sine):
            return None
        amplitudes = np.concatenate([reference.position_amplitude, reference.orientation_amplitude])
        moving = np.flatnonzero(amplitudes).tolist()
        if len(moving) < 2:
            return None
        # even, so that opposite phases are on the grid
        steps = min(_MOST_PHASES, max(4, 2 * int(_COMBINATIONS ** (1 / (len(moving) - 1)) / 2)))
        shifts = [2 * math.pi * k / steps for k in range(steps)]
        period = reference.time_scale / reference.frequency
        time = reference.time_scale * reference.fade_in + np.arange(_ROWS_OF_PERIOD) / _ROWS_OF_PERIOD * period
        grid = [*product(shifts, repeat=len(moving) - 1)]
        motions = [reference(time)]
        for phases_of_others in grid:
            phases = np.zeros(6)
            phases[moving[1:]] = phases_of_others
            parts = {"position_phase": tuple(phases[:3]), "orientation_phase": tuple(phases[3:])}
            motions.append(reference.model_copy(update=parts)(time))
        motion = Motion(*(np.concatenate(parts) for parts in zip(*motions, strict=True)))
        with np.errstate(all="ignore"):  # a leg of length 0 has no direction
            legs = leg_geometry(self.platform, motion.position, motion.orientation)
            regular = condition_number_bound(jacobian_of_legs(legs, scaled=True)) < LARGEST_CONDITION_NUMBER
            loads = loads_of_legs(self.platform, motion, legs, regular, ("velocity", "force", "power"))
            by_motion = {
                "stroke": ("m", np.asarray(legs.length)),
                "speed": ("m/s", np.abs(loads["velocity"])),
                "force": ("N", np.abs(loads["force"])),
                "power": ("W", np.maximum(loads["power"], 0.0)),
            }
        worst = []
        for need, (unit, values) in by_motion.items():
            rows = values.reshape(len(motions), _ROWS_OF_PERIOD, 6)
            largest = np.ptp(rows, axis=1) if need == "stroke" else rows.max(axis=1)
            at, leg = (int(k) for k in np.unravel_index(first_of_largest(largest[1:].ravel()), largest[1:].shape))
            names = [axis for axis, _, _ in AXES]
            by_axis = {names[moving[0]]: 0.0, **dict(zip((names[k] for k in moving[1:]), grid[at], strict=True))}
            worst.append(WorstPhases(need, unit, float(largest[0].max()), float(largest[1:].max()), leg + 1, by_axis))
        return tuple(worst)

    def settings_that_fit(self, fit: Fit) -> dict[str, float]:
        """Settings that make the motion fit with its margin; empty if it fits already.

        A slower motion needs a longer run: `loop.duration` grows with `reference.time_scale`.

        Returns
        -------
        dict
            Values by key, as for `load_experiment`.

        Raises
        ------
        MotionError
            No scale of the chosen kind makes the motion fit.
        """
        if self.within and self.keeps_margin:
            return {}
        factor = self.time_factor if fit == "time" else self.amplitude_factor
        if factor is None:
            largest = self.shares.largest
            raise MotionError(
                f"{self.experiment.where}: no {fit}_scale makes the motion fit; {largest.limit} is at "
                f"{100 * largest.share:.4g} % at {largest.time:.6g} s. Move it elsewhere, or try the other scale"
            )
        choice = self.experiment.reference
        if choice is None:  # a checked experiment has a reference
            return {}
        if fit == "amplitude":
            return {"reference.amplitude_scale": _rounded(choice.amplitude_scale * factor, math.floor)}
        clocks, worst = self._timing, self.experiment.limits.condition_number

        def slower_clocks(factor: float) -> Timing:
            """Of a run that much longer, in whole plant steps within the recording, if it is one."""
            steps, end = math.ceil(clocks.steps * factor - 1e-9), factor * self._reference.defined_until
            if steps * clocks.plant_step > end:
                steps = math.floor(end / clocks.plant_step)
            return Timing(float(f"{steps * clocks.plant_step:.12g}"), clocks.sample_time, clocks.plant_step)

        def largest_share_if_slower(factor: float) -> float:
            times = slower_clocks(factor).times
            motion = slower(self._reference(times / factor), factor)
            return float(shares_along(self._less_margin, times, motion, worst).total.max())

        scale = _rounded(choice.time_scale * factor_near(largest_share_if_slower, factor), math.ceil)
        return {"reference.time_scale": scale, "loop.duration": slower_clocks(scale / choice.time_scale).duration}

    def fitted(self, fit: Fit) -> "MotionCheck":
        """The check of the experiment with `settings_that_fit`; its `experiment` is ready to run.

        Returns
        -------
        MotionCheck
            Within all limits and its margin.

        Raises
        ------
        MotionError
            No scale of the chosen kind makes the motion fit.
        """
        return check(self.experiment, self.settings_that_fit(fit))

    def report(self, *, charts: bool = True) -> "Report":
        """Whether the motion can be done, which limit is nearest and when, and what would fit if it cannot.

        Returns
        -------
        Report
            Verdict, largest shares by the paths `limits.NAME`, tables, and with `charts` the shares over time.
        """
        needs = [*summary_tables(self.shares, self.needs)]
        if self.worst_phases is not None:
            rows: list[tuple[Cell, ...]] = []
            for row in self.worst_phases:
                quantity = replace(of_unit({"m": "mm", "m/s": "mm/s"}.get(row.unit, row.unit)), digits=3)
                phases = ", ".join(f"{axis} {math.degrees(phase):.0f}°" for axis, phase in row.phases.items())
                rows.append((row.need, Value(row.as_given, quantity), Value(row.worst, quantity), str(row.leg), phases))
            heads = tuple(Column(name) for name in ("", "as given", "worst", "leg", "phases"))
            note = "Over a grid of the phases between the axes, in one period after the motion has faded in."
            needs.append(Table("Worst over the phases of the axes", heads, tuple(rows), note=note))
        sections = [Section("Needs and limits", tuple(needs))]
        if charts:  # the largest share of each limit over all legs; the one that is used most first
            shares, time = self.shares, self.shares.time
            names = sorted(shares.of, key=lambda name: -shares.peak(name).share)
            series = (
                Series(LABELS[name], OF_LIMIT, np.minimum(shares.over_time[name], 10 * _HIGHEST)) for name in names
            )
            beyond = (
                strip_of(f"{LABELS[name]} beyond its limit", time, shares.over_time[name] > 1, role)
                for name, role in zip(names, _STRIPS, strict=False)
            )
            strips, limit = tuple(strip for strip in beyond if strip is not None), (Mark(1.0, "limit"),)
            chart = Chart(
                "share of each limit", time_axis(time), tuple(series), marks=limit, strips=strips, group="shares"
            )
            sections.append(Section("Over time", (chart,)))
        sections.append(Section("Each leg", tuple(leg_tables(self.shares, self.needs))))

        # the verdict: what is used most, and when: "leg 3 needs 92 % of its speed at 4.2 s"; and what would fit
        peak = self.shares.largest
        at = f"at {peak.time:.4g} s"
        if peak.limit == "side":
            need = f"it leads through a singular pose {at}" if peak.share > 1 else f"no singular pose {at}"
        elif peak.limit not in _OF_LEG:
            need = f"the {LABELS[peak.limit]} is at {percent(peak.share)} of its limit {at}"
        elif not math.isfinite(peak.share):
            need = f"leg {peak.leg} has no finite {_OF_LEG[peak.limit]} {at}"
        else:
            need = f"leg {peak.leg} needs {percent(peak.share)} of its {_OF_LEG[peak.limit]} {at}"
        status: Status = "marginal" if self.within else "bad"
        if self.within and self.keeps_margin:
            said = ["can be done", need]
            status = "marginal" if peak.share > _NEAR else "good"
            if not any(name in self.shares.of for name in _OF_LEG):  # only singular poses have been checked
                said[0] += " as far as is known: the platform states no limit of its legs"
                status = "told"
        else:
            slow, small = self.time_factor, self.amplitude_factor
            fits = [] if slow is None else [f"{slow:.4g} times as long (--fit time)"]
            fits += [] if small is None else [f"{small:.4g} times as large (--fit amplitude)"]
            ways = f"it fits {listed(fits, 'or')}" if fits else "no slower and no smaller motion fits"
            but = f"can be done, but not with its margin of {percent(self.margin)}"
            said = [but if self.within else "cannot be done", need, ways]
        duration = float(self.shares.time[-1] - self.shares.time[0])
        unchecked = listed([LABELS[name] for name in self.not_stated])
        changed, of_payload = self.experiment.changed, _OF_PAYLOAD if self.payload else ()
        loaded = f" with a payload of {self.payload}" if self.payload else ""
        report = Report(
            self.title,
            Verdict(sentence(said), status, (_number(peak),)),
            tuple(sections),
            study="check",
            lead=f"platform {self.platform.name}{loaded}, nominal model, no external forces, {duration:.6g} s",
            settings=settings_of({key: values for key, values in changed.items() if key not in of_payload}),
            numbers=tuple(_number(self.shares.peak(name)) for name in self.shares.of),
            notes=(Note(f"Not checked, as the platform states no limit: {unchecked}."),) if unchecked else (),
        )
        return fine(report, fineness_of(self.platform))

    def __repr__(self) -> str:
        """Title, verdict, largest share of each limit, and needs of the most loaded leg, one line each."""
        lines = [f"Motion: {self.experiment.title}, of platform {self.platform.name}"]
        lines.append(f"  {self.report(charts=False).verdict.text}")
        for name in self.shares.of:
            peak = self.shares.peak(name)
            of_leg = "" if peak.leg is None else f", leg {peak.leg}"
            lines.append(f"  {LABELS[name]:16}  {percent(peak.share, 4):>8} at {peak.time:.6g} s{of_leg}")
        most = {name: number_text(plain(float(np.abs(need.of_leg).max()))) for name, need in self.needs.of.items()}
        texts = (
            f"stroke {most['stroke']} m",
            f"speed {most['leg_velocity_peak']} m/s (RMS {most['leg_velocity_rms']})",
            f"force {most['actuator_force_peak']} N (RMS {most['actuator_force_rms']})",
            f"power {most['motoring_power_peak']} W (RMS {most['actuator_power_rms']})",
            f"regenerated {most['regenerated_power_peak']} W",
        )
        return "\n".join([*lines, f"  needs: {', '.join(texts)}"])

    def _repr_html_(self) -> str:
        """The tables, for a notebook."""
        return to_html(self.report(charts=False))

    @cached_property
    def _less_margin(self) -> Platform:
        """The platform with its dynamic limits less the margin."""
        stated = {name: getattr(self.platform, name) for name in DYNAMIC if self.margin}
        # rounding of a plan at its margin is not beyond it
        unreserved = (1 - self.margin) * (1 + _ROUNDING)
        return replace(self.platform, **{name: unreserved * most for name, most in stated.items() if most is not None})


class WorstPhases(NamedTuple):
    """What a sine on several axes needs of a leg at most, over the phases between its axes."""

    need: str
    unit: str
    as_given: float
    worst: float
    leg: int  # from 1
    phases: dict[str, float]  # by axis, against the first one [rad]


def _rounded(scale: float, to: Callable[[float], int]) -> float:
    """To nine digits, on the side that fits."""
    unit = 10.0 ** (math.floor(math.log10(abs(scale))) + 1 - _DIGITS)
    return math.copysign(float(f"{to(abs(scale) / unit) * unit:.{_DIGITS}g}"), scale)


def check(
    experiment: Experiment | Path | str,
    settings: Settings = (),
    *,
    payload: float | str | None = None,
    payload_height: float | str = 0.0,
) -> MotionCheck:
    """Check a motion against all limits of its platform, and compute its actuator requirements, without a run.

    Stroke, joint angles, distance from singular poses, leg velocity, leg acceleration, and force and power by inverse
    dynamics of the nominal model without external forces, at every row of the run.

    Parameters
    ----------
    experiment
        A TOML file, the name of a shipped experiment, or an `Experiment`.
    settings
        Keys of the experiment to change, as in `load_experiment`.
    payload, payload_height
        A point mass [kg] that the platform carries, and its height [m] above the platform's origin, in its axes.
        Numbers, or strings with a unit; they become parameters of the experiment's platform.

    Returns
    -------
    MotionCheck
        The shares of the limits at every row, the requirements of each leg, whether all limits are respected
        (`within`), and scales that make the motion fit.

    Raises
    ------
    ExperimentError
        The experiment has no reference, or cannot be read.

    See Also
    --------
    run, margins, sweep

    Examples
    --------
    >>> motion = gs.check("pitch_sine", {"reference.frequency": 4})
    >>> motion.within, motion.time_factor, motion.shares.largest.limit
    >>> motion.needs["actuator_force_peak"], motion.needs["actuator_force_rms"]  # of each leg [N]
    >>> slower = motion.fitted("time")
    >>> record = gs.run(slower.experiment, {"loop.duration": 0.1})
    """
    experiment_checked = load_experiment(experiment, settings)
    nominal, load = nominal_platform(experiment_checked, experiment_checked.platform), ""
    try:
        mass, above = number(0.0 if payload is None else payload, "kg"), number(payload_height, "m")
    except ValueError as error:
        raise MotionError(f"payload of {payload} at a height of {payload_height}: {error}") from None
    if payload is None and above:
        raise MotionError(f"payload_height is {payload_height}, but there is no payload; expected its mass, too")
    if payload is not None:  # mass, centre of mass, and inertia about it
        if mass <= 0:
            raise MotionError(f"payload is {mass:g} kg at a height of {above:g} m; expected a mass > 0")
        places = [np.asarray(nominal.platform_com), np.array([0.0, 0.0, above])]
        masses = [float(nominal.platform_mass), mass]
        com = np.average(places, axis=0, weights=masses)
        inertia = np.array(nominal.platform_inertia, dtype=float)
        for m, place in zip(masses, places, strict=True):
            arm = place - com
            inertia += m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        keys = dict(zip(_OF_PAYLOAD, (sum(masses), com.tolist(), inertia.tolist()), strict=True))
        experiment_checked = load_experiment(experiment_checked, keys)
        nominal = nominal_platform(experiment_checked, experiment_checked.platform)
        load = f"{mass:g} kg at {above:g} m"
    platform = limited_platform(nominal, experiment_checked.actuators.force_limit)
    timing = timing_of(experiment_checked, experiment_checked.loop)
    if experiment_checked.reference is None:
        raise ExperimentError(experiment_checked.where, "reference", "is missing; add one, so that there is a motion")
    reference, motion = reference_motion(experiment_checked, experiment_checked.reference, platform, timing)
    shares = shares_along(platform, timing.times, motion, experiment_checked.limits.condition_number)
    needs = needs_along(platform, timing.times, motion)
    return MotionCheck(experiment_checked, platform, shares, needs, reference, motion, timing, load)


def _number(peak: Peak) -> Number:
    share = plain(peak.share)
    return Number(
        f"limits.{peak.limit}",
        LABELS[peak.limit] + ("" if peak.leg is None else f", leg {peak.leg}"),
        share,
        OF_LIMIT,
        limit=1.0,
        margin=None if share is None else 1 - share,
        explanation=f"largest share of the limit along the motion, at {peak.time:.6g} s",
    )


def check_files(result: MotionCheck) -> dict[str, bytes]:
    """The largest share of every limit, its time, and all needs by file name; None for what is not finite."""
    limits = {}
    for name, share in result.shares.of.items():
        peaks = [result.shares.peak(name, leg) for leg in LEGS] if share.ndim == 2 else [result.shares.peak(name)]
        used, times = [peak.share for peak in peaks], [peak.time for peak in peaks]
        limits[name] = {"share": used, "time": times} if share.ndim == 2 else {"share": used[0], "time": times[0]}
    numbers = {
        "title": result.experiment.title,
        "platform": result.platform.name,
        "within": result.within,
        "margin": result.margin,
        "keeps_margin": result.keeps_margin,
        "not_stated": list(result.not_stated),
        "largest": result.shares.largest._asdict(),
        "time_factor": result.time_factor,
        "amplitude_factor": result.amplitude_factor,
        "limits": limits,
        "needs": {name: {"unit": need.unit, "of_leg": need.of_leg} for name, need in result.needs.of.items()},
        "needs_notes": list(result.needs.notes),
        **({} if result.worst_phases is None else {"worst_phases": [row._asdict() for row in result.worst_phases]}),
        "versions": versions(),
    }
    columns = {f"{name} [{need.unit}]": need.of_leg for name, need in result.needs.of.items()}
    return {
        "check.json": readable_json(plain(numbers)),
        "needs.csv": polars.DataFrame({"leg": LEGS, **columns}).fill_nan(None).write_csv().encode(),
    }
