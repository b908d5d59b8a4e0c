"""What an identification found, as a report: how well the parameters are known, and whether the model fits the log."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gough_stewart.harness.identify.causes import Diagnosis
from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.lack_of_fit import LackOfFit
from gough_stewart.harness.identify.names import unit_of
from gough_stewart.harness.report.chart import Axis, Chart, Mark, Series, time_axis
from gough_stewart.harness.report.document import Note, Number, Report, Section, Status, Verdict
from gough_stewart.harness.report.quantities import NUMBER, SHARE, Quantity, of_unit
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.report.words import counted, listed, percent, sentence

# A parameter whose interval is at most this share of its scale counts as well known.
WELL_KNOWN = 0.05
# Letters of a cause that is told whole.
_LONG = 100
# So few parameters are told one by one.
_FEW = 3
_TWO, _SHARE = replace(NUMBER, digits=2), replace(SHARE, digits=2)
# So many estimates that an error moves most are told.
_SHIFTS = 3
# Residuals of a length are micrometres.
_MICROMETRE = Quantity("m", "µm", 1e6)
_HALF_WIDTH = Column("± %", _TWO, "half of the 95 % confidence interval")


def estimate_report(estimate: Estimate, platform: str, more: Sequence[Table] = (), *, charts: bool = True) -> Report:
    """The report of an estimate of a platform; `more` has further tables, such as an experiment before and after."""
    sections = [Section("Parameters", (*estimate_tables(estimate), *more))]
    if charts:
        sections.append(Section("Fit", (*_parameter_charts(estimate), *_signal_charts(estimate))))
    notes = [Note(text) for text in estimate.notes]
    notes += [Note(_brief(text), "warning") for text in estimate.alarms]
    return Report(
        f"Parameters of {platform}",
        estimate_verdict(estimate),
        tuple(sections),
        study="identify",
        lead=f"method {estimate.method.replace('_', ' ')}; intervals of 95 % if model and force gain are right",
        numbers=_numbers(estimate),
        notes=tuple(notes),
    )


def estimate_verdict(estimate: Estimate) -> Verdict:
    """Whether the values are valid, how well they are known, what the log does not tell, whether the model fits."""
    numbers = _numbers(estimate)[: _FEW + 1]
    if estimate.alarms:
        return Verdict(sentence(map(_brief, estimate.alarms)), "bad", numbers)
    known = [k for k in range(len(estimate.names)) if math.isfinite(estimate.standard_errors[k])]
    half = estimate.values - estimate.interval[:, 0]
    shares = {k: half[k] / max(abs(estimate.values[k]), estimate.scale[k]) for k in known}
    well = [k for k, share in shares.items() if share <= WELL_KNOWN]
    parts: list[str | None] = []
    if not known:
        parts.append(f"none of the {counted(len(estimate.names), 'parameter')} is known")
    elif len(estimate.names) <= _FEW:
        parts.append(listed([_value(estimate, k) for k in known]))
    else:
        worst = max(shares, key=lambda k: shares[k])
        parts.append(
            f"{len(well)} of {counted(len(estimate.names), 'parameter')} are known to {percent(WELL_KNOWN)} or better"
        )
        parts.append(f"least known: {_value(estimate, worst)}")
    if estimate.not_excited:
        parts.append(f"not excited by this motion: {_some(estimate.not_excited)}")
    if estimate.at_bound:
        parts.append(f"at the bound of what is possible: {_some(estimate.at_bound)}")
    if estimate.without_interval:
        parts.append(f"without an interval: {_some(estimate.without_interval)}")
    is_tested = estimate.diagnosis is not None and estimate.diagnosis.test is not None
    parts.append("the residuals are those of noise" if is_tested else "whether the model fits the log is not tested")
    if estimate.diagnosis is not None and estimate.diagnosis.unseen_text:
        parts.append(estimate.diagnosis.unseen_text)
    if estimate.validation is not None:
        v = estimate.validation
        parts.append(f"rows kept for validation are off by {v.rms:.3g} N, {v.expected:.3g} N are expected")
    is_whole = len(well) == len(estimate.names) and is_tested
    status: Status = "good" if is_whole else "marginal"
    return Verdict(sentence(parts), status, numbers)


def _brief(alarm: str) -> str:
    """An alarm without a long list of values, which tables and notes have."""
    said, likely, cause = alarm.partition(". Most likely: ")
    return f"{said}{likely}{cause.partition(': ')[0] if len(cause) > _LONG else cause}"


def _some(names: Sequence[str]) -> str:
    if len(names) <= _FEW:
        return listed(list(names))
    return f"{listed(list(names[:_FEW]), 'and')} and {len(names) - _FEW} more"


def _value(estimate: Estimate, k: int) -> str:
    """As in platform_mass 1216.9 ± 0.4 kg."""
    quantity = _quantity_of(estimate.names[k])
    shown = quantity.factor * float(estimate.values[k] - estimate.interval[k, 0])
    # as many decimals as the half width has in two digits
    decimals = max(0, 1 - math.floor(math.log10(shown))) if shown > 0 else 3
    value = f"{quantity.factor * estimate.values[k]:.{decimals}f}"
    return f"{estimate.names[k]} {value} ± {shown:.2g} {quantity.unit_text}".rstrip()


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


def _residual_quantity(estimate: Estimate) -> Quantity:
    unit = estimate.residuals.unit
    return _MICROMETRE if unit == "m" else of_unit(unit)


def estimate_tables(estimate: Estimate) -> list[Table]:
    """Parameters with their intervals; identifiability; residuals; whether the model fits."""
    tables = [_parameters(estimate), _identifiability(estimate), _residuals(estimate)]
    diagnosis = estimate.diagnosis
    if diagnosis is not None:
        if diagnosis.test is not None:
            tables.append(_tests(diagnosis.test))
        if diagnosis.findings:
            tables.append(_findings(diagnosis))
        if diagnosis.unseen:
            tables.append(_unseen(diagnosis))
    return tables


def _parameters(estimate: Estimate) -> Table:
    rows: list[tuple[Cell, ...]] = []
    half = estimate.values - estimate.interval[:, 0]
    for name, value, before, spread in zip(estimate.names, estimate.values, estimate.nominal, half, strict=True):
        first: list[Cell] = [name, Value(float(before), _quantity_of(name, 5))]
        shown = Value(float(value), _quantity_of(name))
        if name in estimate.not_excited:
            rows.append((*first, "not excited", None, None))
        elif name in estimate.at_bound:
            rows.append((*first, shown, "at its bound", None))
        elif name in estimate.without_interval:
            rows.append((*first, shown, "unobservable", None))
        else:
            share = float(100 * spread / abs(value)) if value else None
            rows.append((*first, shown, Value(float(spread), _quantity_of(name, 2)), share))
    columns = (
        Column(""),
        Column("before"),
        Column("estimate"),
        Column("±", None, "half of the 95 % confidence interval"),
        replace(_HALF_WIDTH, explanation="the same as a share of the value"),
    )
    return Table("Parameters, with 95 % intervals", columns, tuple(rows))


def _identifiability(estimate: Estimate) -> Table:
    rows = tuple(
        (estimate.combination(k), float(100 / sigma) if k < estimate.rank else "unobservable")
        for k, sigma in enumerate(estimate.singular_values)
    )
    title = f"Identifiability; condition number {estimate.condition_number:.3g}"
    return Table(title, (Column("combination, relative to scale"), _HALF_WIDTH), rows)


def _residuals(estimate: Estimate) -> Table:
    residuals, quantity = estimate.residuals, _residual_quantity(estimate)
    columns = (
        Column("residual"),
        Column("fitted", quantity, "RMS over the rows of the fit"),
        Column("validation", quantity, "RMS over rows that were left out of the fit"),
        Column("of signal", replace(SHARE, digits=3), "RMS of the residual over that of the signal"),
        Column("p of whiteness", _TWO, "small if residuals follow each other, which noise does not"),
    )
    rows = []
    for k, rms in enumerate(residuals.rms.tolist()):
        aside = None if residuals.validation_rms is None else float(residuals.validation_rms[k])
        share = rms / float(residuals.signal_rms[k]) if residuals.signal_rms[k] > 0 else None
        white = None if residuals.whiteness is None else float(residuals.whiteness[k])
        rows.append((f"{residuals.quantity} {k + 1}", rms, aside, share, _p(white)))
    return Table("Residuals", columns, tuple(rows))


def _tests(test: LackOfFit) -> Table:
    title = f"What the residuals contain; all tests p = {test.combined:.2g}"
    value = Column("p value", _TWO, "probability of such residuals if the model is right")
    return Table(title, (Column("tested"), value), tuple((name, _p(p)) for name, p in test.p_values.items()))


def _p(value: float | None) -> Cell:
    """A p value; what is smaller is not known better, and none is 0."""
    return "< 1e-6" if value is not None and value < 1e-6 else value


def _findings(diagnosis: Diagnosis) -> Table:
    others = "" if len(diagnosis.findings) == 1 else "; the log does not tell which"
    # what a hypothesis explains is not known better than to whole percent
    shares = [(finding.text, finding.improvement) for finding in diagnosis.findings]
    rows = tuple((text, round(share, 2) if math.isfinite(share) else share) for text, share in shares)
    title = f"Diagnosis: {diagnosis.cause or 'no cause is sure'}{others}"
    return Table(title, (Column(""), Column("misfit explained", _SHARE)), rows)


def _unseen(diagnosis: Diagnosis) -> Table:
    columns = (Column(""), Column("estimates would be off by"), Column("standard errors", _TWO, "of the first"))
    rows = []
    for unseen in diagnosis.unseen:
        shifts = [(name, shift, size) for name, shift, size in diagnosis.moved(unseen) if size >= 0.1]
        text = ", ".join(f"{name} {shift:+.2g} {unit_of(name)}".rstrip() for name, shift, _ in shifts[:_SHIFTS])
        rows.append((unseen.name, text or "less than a tenth of their errors", shifts[0][2] if shifts else None))
    return Table("What no residual shows, since estimates absorb it", columns, tuple(rows))


def _parameter_charts(estimate: Estimate) -> list[Chart]:
    """By how much each estimate differs from nominal, of its scale, and how the estimates' errors go together."""
    charts, names = [], estimate.names
    change = (estimate.values - estimate.nominal) / estimate.scale
    half = (estimate.values - estimate.interval[:, 0]) / estimate.scale
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
    return charts


def _signal_charts(estimate: Estimate) -> list[Chart]:
    """Measured and fitted signals of each channel, and their difference."""
    details = estimate.details
    if "time" not in details:
        return []
    quantity, channel, fine = (
        of_unit(estimate.residuals.unit),
        estimate.residuals.quantity,
        _residual_quantity(estimate),
    )
    time, measured, fitted = (np.asarray(details[name], dtype=float) for name in ("time", "measured", "fitted"))
    charts = []
    for k in range(measured.shape[1]):
        both = (
            Series("measured", quantity, measured[:, k], "measured"),
            Series("fitted", quantity, fitted[:, k], "nominal"),
        )
        charts.append(Chart(f"{channel} {k + 1}", time_axis(time), both, group="fit"))
    # what was left out of the fit, to validate it
    aside = tuple(
        Mark(float(end), f"validates {word}", "vertical", "neutral")
        for span in details["validating"]
        for word, end in zip(("from", "to"), span, strict=True)
    )
    for title, model in (("identified", fitted), ("nominal", np.asarray(details["before"], dtype=float))):
        rest = tuple(
            Series(f"{channel} {k + 1}", fine, column, "error", leg=k + 1 if k < 6 else None)
            for k, column in enumerate((measured - model).T)
        )
        name, axis = f"residuals, {title} platform", Axis("residual", fine)
        charts.append(Chart(name, time_axis(time), rest, marks=aside, y=axis, group="residuals"))
    return charts
