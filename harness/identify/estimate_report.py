"""What an identification found, as a report: how well the parameters are known, and whether the model fits the log."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gough_stewart.harness.control.linear_controller import linear_of
from gough_stewart.harness.control.loop_margins import loop_margins
from gough_stewart.harness.errors import UnstableLoopError
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.margins import judged
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.regressor import unit_of
from gough_stewart.harness.report.chart import Axis, Chart, Mark, Series, time_axis
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
)
from gough_stewart.harness.report.quantities import (
    ANGLE,
    DECIBEL,
    FORCE,
    FREQUENCY,
    NOTHING,
    NUMBER,
    SHARE,
    Quantity,
    counted,
    listed,
    of_unit,
    percent,
    sentence,
)
from gough_stewart.harness.report.terminal import text_of
from gough_stewart.harness.results.metrics import metrics
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.run_report import run_numbers
from gough_stewart.harness.section import plain
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.platform import Platform

# A parameter whose interval is at most this share of its scale counts as well known.
WELL_KNOWN = 0.05
_LONG = 100  # letters of a cause that is told whole
_FEW = 3  # parameters, and shifts, that are told one by one
_TWO, _SHARE = replace(NUMBER, digits=2), replace(SHARE, digits=2)
# Residuals of a length are micrometres.
_MICROMETRE = Quantity("m", "µm", 1e6)
_HALF_WIDTH = Column("± %", _TWO, "half of the 95 % confidence interval")
# Errors and feedback of a run, and margins of the loop with the machine, with their units.
_MEASURES = {
    "position error, RMS": _MICROMETRE,
    "position error, peak": _MICROMETRE,
    "orientation error, RMS": ANGLE,
    "leg length error, RMS": _MICROMETRE,
    "feedback's share of the force, RMS": FORCE,
}
_MARGINS = {
    "disk margin α": replace(NUMBER, digits=3),
    "gain of each leg, up or down": DECIBEL,
    "phase of each leg, either way": ANGLE,
    "crossover": FREQUENCY,
}


def estimate_report(estimate: Estimate, platform: str, more: Sequence[Table] = (), *, charts: bool = True) -> Report:
    """The report of an estimate of a platform; `more` has further tables, such as an experiment before and after."""
    sections = [Section("Parameters", (*estimate_tables(estimate), *more))]
    if charts:
        sections.append(Section("Fit", tuple(_charts(estimate))))
    notes = [Note(text) for text in estimate.notes]
    notes += [Note(_brief(text), "warning") for text in estimate.alarms]
    right = "the model is" if estimate.method == "geometry" else "model and force gain are"
    return Report(
        f"Parameters of {platform}",
        estimate_verdict(estimate),
        tuple(sections),
        study="identify",
        lead=f"method {estimate.method}; intervals of 95 % if {right} right",
        numbers=_numbers(estimate),
        notes=tuple(notes),
    )


def estimate_verdict(estimate: Estimate) -> Verdict:
    """Whether the values are valid, how well they are known, what the log does not tell, whether the model fits."""
    numbers, names, diagnosis = _numbers(estimate)[: _FEW + 1], estimate.names, estimate.diagnosis
    if estimate.alarms:
        return Verdict(sentence(map(_brief, estimate.alarms)), "bad", numbers)

    def value(k: int) -> str:
        """As in platform_mass 1216.9 ± 0.4 kg."""
        quantity = _quantity_of(names[k])
        shown = quantity.factor * float(half[k])
        # the half width in two digits, and as many decimals of the value
        places = 1 - math.floor(math.log10(shown)) if shown > 0 else 3
        number = f"{quantity.factor * estimate.values[k]:.{max(0, places)}f}"
        return f"{names[k]} {number} ± {round(shown, places):g} {quantity.unit_text}".rstrip()

    half = estimate.half_width
    known = [k for k in range(len(names)) if math.isfinite(estimate.standard_errors[k])]
    shares = {k: half[k] / max(abs(estimate.values[k]), estimate.scale[k]) for k in known}
    well = [k for k, share in shares.items() if share <= WELL_KNOWN]
    parts: list[str | None] = []
    if not known:
        parts.append(f"none of the {counted(len(names), 'parameter')} is known")
    elif len(names) <= _FEW:
        parts.append(listed([value(k) for k in known]))
    else:
        all_names = counted(len(names), "parameter")
        parts.append(f"{len(well)} of {all_names} are known to {percent(WELL_KNOWN)} or better")
        parts.append(f"least known: {value(max(shares, key=lambda k: shares[k]))}")
    for what, elements in (
        ("not excited by this motion", estimate.not_excited),
        ("at the bound of what is possible", estimate.at_bound),
        ("without an interval", estimate.without_interval),
    ):
        if len(elements) > _FEW:
            parts.append(f"{what}: {listed(list(elements[:_FEW]), 'and')} and {len(elements) - _FEW} more")
        elif elements:
            parts.append(f"{what}: {listed(list(elements))}")
    is_tested = diagnosis is not None and diagnosis.test is not None
    parts.append("the residuals are those of noise" if is_tested else "whether the model fits the log is not tested")
    if diagnosis is not None:
        # what no residual shows, by the example that moves an estimate most
        moved = [(*diagnosis.moved(unseen)[0], unseen.name) for unseen in diagnosis.unseen]
        name, shift, size, error = max(moved, key=lambda row: row[2], default=("", 0.0, 0.0, ""))
        if size >= 1:
            amount = f"{shift:+.2g} {unit_of(name)}".rstrip()
            parts.append(
                f"no residual shows what is wrong alike for all legs: {error}, {name} would be off by {amount}"
            )
    if estimate.validation is not None:
        v = estimate.validation
        parts.append(f"rows kept for validation are off by {v.rms:.3g} N, {v.expected:.3g} N are expected")
    status: Status = "good" if len(well) == len(names) and is_tested else "marginal"
    return Verdict(sentence(parts), status, numbers)


def _brief(alarm: str) -> str:
    """An alarm without a long list of values, which tables and notes have."""
    said, likely, cause = alarm.partition(". Most likely: ")
    return f"{said}{likely}{cause.partition(': ')[0] if len(cause) > _LONG else cause}"


def _numbers(estimate: Estimate) -> tuple[Number, ...]:
    rows = zip(estimate.names, estimate.values.tolist(), estimate.interval.tolist(), strict=True)
    told = "with its interval of 95 % confidence"
    numbers = [
        Number(f"parameters.{name}", name, value, _quantity_of(name), low, high, explanation=told)
        for name, value, (low, high) in rows
    ]
    condition = estimate.condition_number if math.isfinite(estimate.condition_number) else None
    return (*numbers, Number("condition_number", "condition number of the regressor", condition))


def _quantity_of(name: str, digits: int = 6) -> Quantity:
    unit = unit_of(name)
    return replace(of_unit(unit) if unit else NUMBER, digits=digits)


def _p(value: float | None) -> Cell:
    """A p value; what is smaller is not known better, and none is 0."""
    return "< 1e-6" if value is not None and value < 1e-6 else value


def estimate_tables(estimate: Estimate) -> list[Table]:
    """Parameters with their intervals; identifiability; residuals; whether the model fits."""
    parameters: list[tuple[Cell, ...]] = []
    half = estimate.half_width
    for name, value, before, spread in zip(estimate.names, estimate.values, estimate.nominal, half, strict=True):
        first: list[Cell] = [name, Value(float(before), _quantity_of(name, 5))]
        shown = Value(float(value), _quantity_of(name))
        if name in estimate.not_excited:
            parameters.append((*first, "not excited", None, None))
        elif name in estimate.at_bound:
            parameters.append((*first, shown, "at its bound", None))
        elif name in estimate.without_interval:
            parameters.append((*first, shown, "unobservable", None))
        else:
            share = float(100 * spread / abs(value)) if value else None
            parameters.append((*first, shown, Value(float(spread), _quantity_of(name, 2)), share))
    width = Column("±", None, "half of the 95 % confidence interval")
    heads = (Column(""), Column("before"), Column("estimate"), width)
    relative = replace(_HALF_WIDTH, explanation="the same as a share of the value")
    combinations = tuple(
        (estimate.combination(k), float(100 / sigma) if k < estimate.rank else "unobservable")
        for k, sigma in enumerate(estimate.singular_values)
    )
    title = f"Identifiability; condition number {estimate.condition_number:.3g}"

    residuals = estimate.residuals
    quantity = _MICROMETRE if residuals.unit == "m" else of_unit(residuals.unit)
    legs = []
    for k, rms in enumerate(residuals.rms.tolist()):
        aside = None if residuals.validation_rms is None else float(residuals.validation_rms[k])
        of_signal = rms / float(residuals.signal_rms[k]) if residuals.signal_rms[k] > 0 else None
        white = None if residuals.whiteness is None else float(residuals.whiteness[k])
        legs.append((f"{residuals.quantity} {k + 1}", rms, aside, of_signal, _p(white)))
    of_residuals = (
        Column("residual"),
        Column("fitted", quantity, "RMS over the rows of the fit"),
        Column("validation", quantity, "RMS over rows that were left out of the fit"),
        Column("of signal", replace(SHARE, digits=3), "RMS of the residual over that of the signal"),
        Column("p of whiteness", _TWO, "small if residuals follow each other, which noise does not"),
    )
    tables = [
        Table("Parameters, with 95 % intervals", (*heads, relative), tuple(parameters)),
        Table(title, (Column("combination, relative to scale"), _HALF_WIDTH), combinations),
        Table("Residuals", of_residuals, tuple(legs)),
    ]
    diagnosis = estimate.diagnosis
    if diagnosis is None:
        return tables
    if diagnosis.test is not None:
        title = f"What the residuals contain; all tests p = {diagnosis.test.combined:.2g}"
        columns = (Column("tested"), Column("p value", _TWO, "probability of such residuals if the model is right"))
        tables.append(Table(title, columns, tuple((name, _p(p)) for name, p in diagnosis.test.p_values.items())))
    if diagnosis.findings:
        others = "" if len(diagnosis.findings) == 1 else "; the log does not tell which"
        title = f"Diagnosis: {diagnosis.cause or 'no cause is sure'}{others}"
        # what a hypothesis explains is not known better than to whole percent
        shares = [(finding.text, finding.improvement) for finding in diagnosis.findings]
        found = tuple((text, round(share, 2) if math.isfinite(share) else share) for text, share in shares)
        tables.append(Table(title, (Column(""), Column("misfit explained", _SHARE)), found))
    if diagnosis.unseen:
        rows = []
        for unseen in diagnosis.unseen:
            shifts = [(name, shift, size) for name, shift, size in diagnosis.moved(unseen) if size >= 0.1]
            text = ", ".join(f"{name} {shift:+.2g} {unit_of(name)}".rstrip() for name, shift, _ in shifts[:_FEW])
            size = shifts[0][2] if shifts else None
            rows.append((unseen.name, text or "less than a tenth of their errors", size))
        sizes = Column("standard errors", _TWO, "of the first")
        heads_of_shifts = (Column(""), Column("estimates would be off by"), sizes)
        tables.append(Table("What no residual shows, since estimates absorb it", heads_of_shifts, tuple(rows)))
    return tables


def _charts(estimate: Estimate) -> list[Chart]:
    """Changes of the parameters, of their scale; correlation of their errors; measured, fitted and residual signals."""
    charts, names = [], estimate.names
    change = (estimate.values - estimate.nominal) / estimate.scale
    half = estimate.half_width / estimate.scale
    if np.isfinite(change).any():
        series = Series("change from nominal", SHARE, change, "actual", low=change - half, high=change + half)
        axis, size = Axis("parameter", labels=names), Axis("change", SHARE)
        title = "change of the parameters, of their scale"
        charts.append(Chart(title, axis, (series,), "bars", y=size, group="parameters"))
    if len(names) > 1 and np.isfinite(estimate.correlation).any():
        axis = Axis("parameter", NUMBER, np.arange(len(names), dtype=float), names)
        series = Series("correlation", NUMBER, estimate.correlation)
        other = replace(axis, name="with parameter")
        charts.append(Chart("correlation of the estimates", axis, (series,), "heat", y=other, group="parameters"))

    details = estimate.details
    if "time" not in details:
        return charts
    unit, channel = of_unit(estimate.residuals.unit), estimate.residuals.quantity
    fine = _MICROMETRE if estimate.residuals.unit == "m" else unit
    time, measured, fitted, before = (
        np.asarray(details[name], dtype=float) for name in ("time", "measured", "fitted", "before")
    )
    for k in range(measured.shape[1]):
        both = (Series("measured", unit, measured[:, k], "measured"), Series("fitted", unit, fitted[:, k], "nominal"))
        charts.append(Chart(f"{channel} {k + 1}", time_axis(time), both, group="fit"))
    # what was left out of the fit, to validate it
    aside = tuple(
        Mark(float(end), f"validates {word}", "vertical", "neutral")
        for span in details["validating"]
        for word, end in zip(("from", "to"), span, strict=True)
    )
    for title, model in (("identified", fitted), ("nominal", before)):
        rest = tuple(
            Series(f"{channel} {k + 1}", fine, column, "error", leg=k + 1 if k < 6 else None)
            for k, column in enumerate((measured - model).T)
        )
        axis = Axis("residual", fine)
        name = f"residuals, {title} platform"
        charts.append(Chart(name, time_axis(time), rest, marks=aside, y=axis, group="residuals"))
    return charts


@dataclass(frozen=True, eq=False, repr=False)
class Compared:
    """An experiment before and after: the machine is the same, the nominal model changes."""

    before: Record
    after: Record
    experiments: tuple[Experiment, Experiment]

    def __repr__(self) -> str:
        """The table, as text."""
        return text_of([self.table])

    @property
    def numbers(self) -> tuple[Number, ...]:
        """The metrics of the run after the identification."""
        return run_numbers(metrics(self.after))

    @property
    def table(self) -> Table:
        """Errors, feedback and margins side by side."""
        errors = []
        for record in (self.before, self.after):
            position, feedback = record["error.position"], record["controller.force"] - record["controller.feedforward"]
            vectors = (position, record["error.orientation"], record["error.leg_length"], feedback)
            of_position, *others = (float(np.sqrt((values**2).sum(axis=1).mean())) for values in vectors)
            peak = float(np.linalg.norm(position, axis=1).max())
            errors.append(dict(zip(_MEASURES, (of_position, peak, *others), strict=True)))
        margins = [_margins_of(experiment) for experiment in self.experiments]
        rows: list[tuple[Cell, ...]] = [
            (name, *(Value(values[name], quantity) for values in errors)) for name, quantity in _MEASURES.items()
        ]
        for name, quantity in _MARGINS.items():
            rows.append((name, *(m if isinstance(m, str) else Value(m[name], quantity) for m in margins)))
        title = f"{self.experiments[0].title}: before and after"
        return Table(title, (Column(""), Column("before"), Column("after")), tuple(rows))


def before_and_after(experiment: Experiment | Path | str, nominal: Platform, found: Platform) -> Compared:
    """Run an experiment designed with the nominal platform, then designed with the identified one.

    The machine is the same in both: `[plant]` of the experiment with the nominal platform. Margins are those of the
    real loop: the controller from each design, with the linear model of the machine.

    Parameters
    ----------
    experiment
        A TOML file, the name of a shipped experiment, or an `Experiment`.
    nominal, found
        Platforms before and after an identification.

    Returns
    -------
    Compared
        `before` and `after`, the records of both runs, and their `experiments`; displays errors, feedback forces and
        margins side by side.

    Raises
    ------
    ExperimentError, ReachError
        As `run`.

    See Also
    --------
    identify, run, margins

    Examples
    --------
    >>> nominal = gs.load_preset("liu2000")
    >>> from dataclasses import replace
    >>> heavier = replace(nominal, platform_mass=14.0)
    >>> experiment = gs.load_experiment("heave_step", {"loop.duration": 0.3, "plant.parameters.platform_mass": 14.0})
    >>> gs.before_and_after(experiment, nominal, heavier).after["position"].shape
    (301, 3)
    """
    chosen = load_experiment(experiment)

    def designed(**platforms: Platform) -> Experiment:
        numbers = {
            f"{key}.parameters": {name: value for name, value in plain(platform.as_dict()).items() if name in TABLE}
            for key, platform in platforms.items()
        }
        return load_experiment(chosen, numbers)

    machine = prepare(designed(platform=nominal)).machine
    before, after = (designed(platform=platform, plant=machine) for platform in (nominal, found))
    return Compared(run(before), run(after), (before, after))


def _margins_of(experiment: Experiment) -> dict[str, float] | str:
    """The margins by their names; in words if there are none."""
    prepared = prepare(experiment)
    controller = linear_of(prepared.controller)
    if controller is None:
        return NOTHING
    try:
        loop = judged(prepared, prepared.machine, controller, loop_margins)
    except UnstableLoopError:
        return "unstable"
    if loop.doubt:
        return "inconclusive"
    disk, crossover = loop.margins.disk, max(leg.crossover for leg in loop.margins.legs)
    # the two gains of a disk margin are inverse to each other
    numbers = (disk.alpha, float(20 * np.log10(disk.gain[1])), float(disk.phase), crossover)
    return dict(zip(_MARGINS, numbers, strict=True))
