"""What an identification found, as a report: how well the parameters are known, and whether the model fits the log."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.tables import estimate_tables, quantity_of, residual_quantity
from gough_stewart.harness.report.chart import Axis, Chart, Mark, Series, time_axis
from gough_stewart.harness.report.document import Note, Number, Report, Section, Status, Verdict
from gough_stewart.harness.report.quantities import NUMBER, SHARE, of_unit
from gough_stewart.harness.report.table import Table
from gough_stewart.harness.report.words import counted, listed, percent, sentence

# A parameter whose interval is at most this share of its scale counts as well known.
WELL_KNOWN = 0.05
# Letters of a cause that is told whole.
_LONG = 100
# So few parameters are told one by one.
_FEW = 3


def estimate_report(found: Estimate, platform: str, more: Sequence[Table] = (), *, charts: bool = True) -> Report:
    """The report of an estimate of a platform; `more` has further tables, such as an experiment before and after."""
    sections = [Section("Parameters", (*estimate_tables(found), *more))]
    if charts:
        drawn = [_parameters(found), _correlation(found), *_fit(found)]
        sections.append(Section("Fit", tuple(chart for chart in drawn if chart is not None)))
    notes = [Note(text) for text in found.notes]
    notes += [Note(_brief(text), "warning") for text in found.alarms]
    return Report(
        f"Parameters of {platform}",
        estimate_verdict(found),
        tuple(sections),
        study="identify",
        lead=f"method {found.method.replace('_', ' ')}; intervals of 95 % if model and force gain are right",
        numbers=_numbers(found),
        notes=tuple(notes),
    )


def estimate_verdict(found: Estimate) -> Verdict:
    """Whether the values are valid, how well they are known, what the log does not tell, whether the model fits."""
    numbers = _numbers(found)
    if found.alarms:
        return Verdict(sentence(map(_brief, found.alarms)), "bad", numbers[: _FEW + 1])
    known = [k for k in range(len(found.names)) if math.isfinite(found.standard_errors[k])]
    shares = {k: _half(found, k) / max(abs(found.values[k]), found.scale[k]) for k in known}
    well = [k for k, share in shares.items() if share <= WELL_KNOWN]
    parts: list[str | None] = []
    if not known:
        parts.append(f"none of the {counted(len(found.names), 'parameter')} is known")
    elif len(found.names) <= _FEW:
        parts.append(listed([_value(found, k) for k in known]))
    else:
        worst = max(shares, key=lambda k: shares[k])
        parts.append(
            f"{len(well)} of {counted(len(found.names), 'parameter')} are known to {percent(WELL_KNOWN)} or better"
        )
        parts.append(f"least known: {_value(found, worst)}")
    if found.not_excited:
        parts.append(f"not excited by this motion: {_some(found.not_excited)}")
    if found.at_bound:
        parts.append(f"at the bound of what is possible: {_some(found.at_bound)}")
    if found.diagnosis is not None and found.diagnosis.test is not None:
        parts.append("the residuals are those of noise")
    else:
        parts.append("whether the model fits the log is not tested")
    if found.diagnosis is not None and found.diagnosis.unseen_text:
        parts.append(found.diagnosis.unseen_text)
    is_whole = len(well) == len(found.names) and found.diagnosis is not None and found.diagnosis.test is not None
    status: Status = "good" if is_whole else "marginal"
    return Verdict(sentence(parts), status, numbers[: _FEW + 1])


def _brief(alarm: str) -> str:
    """An alarm without a long list of values, which tables and notes have."""
    what, likely, cause = alarm.partition(". Most likely: ")
    return f"{what}{likely}{cause.partition(': ')[0] if len(cause) > _LONG else cause}"


def _some(names: Sequence[str]) -> str:
    return (
        listed(list(names))
        if len(names) <= _FEW
        else f"{listed(list(names[:_FEW]), 'and')} and {len(names) - _FEW} more"
    )


def _half(found: Estimate, k: int) -> float:
    return float(found.values[k] - found.interval[k, 0])


def _value(found: Estimate, k: int) -> str:
    """As in platform_mass 1216.9 ± 0.4 kg."""
    quantity, half = quantity_of(found.names[k]), _half(found, k)
    shown = quantity.factor * half
    # as many decimals as the half width has in two digits
    decimals = max(0, 1 - math.floor(math.log10(shown))) if shown > 0 else 3
    value = f"{quantity.factor * found.values[k]:.{decimals}f}"
    return f"{found.names[k]} {value} ± {shown:.2g} {quantity.unit_text}".rstrip()


def _numbers(found: Estimate) -> tuple[Number, ...]:
    made = []
    for k, name in enumerate(found.names):
        low, high = found.interval[k].tolist()
        made.append(
            Number(f"parameters.{name}", name, float(found.values[k]), quantity_of(name), low, high,
                   explanation="with its interval of 95 % confidence")
        )  # fmt: skip
    condition = found.condition_number if math.isfinite(found.condition_number) else None
    made.append(Number("condition_number", "condition number of the regressor", condition))
    return tuple(made)


def _parameters(found: Estimate) -> Chart | None:
    """By how much each estimate differs from the nominal value, with its interval, relative to its scale."""
    change = (found.values - found.nominal) / found.scale
    half = (found.values - found.interval[:, 0]) / found.scale
    if not np.isfinite(change).any():
        return None
    series = Series("change from nominal", SHARE, change, "actual", low=change - half, high=change + half)
    axis = Axis("parameter", labels=tuple(found.names))
    return Chart(
        "change of the parameters, of their scale", axis, (series,), "bars", y=Axis("change", SHARE), group="parameters"
    )


def _correlation(found: Estimate) -> Chart | None:
    """How the estimates' errors go together, from −1 to 1."""
    names, n = tuple(found.names), len(found.names)
    if n < 2 or not np.isfinite(found.correlation).any():
        return None
    axis, series = (
        Axis("parameter", NUMBER, np.arange(n, dtype=float), names),
        Series("correlation", NUMBER, found.correlation),
    )
    return Chart(
        "correlation of the estimates",
        axis,
        (series,),
        "heat",
        y=replace(axis, name="with parameter"),
        group="parameters",
    )


def _fit(found: Estimate) -> list[Chart]:
    """Measured and fitted signals of each channel, and their difference."""
    details = found.details
    if "time" not in details:
        return []
    quantity, what = of_unit(found.residuals.unit), found.residuals.quantity
    time, measured, fitted = (np.asarray(details[name], dtype=float) for name in ("time", "measured", "fitted"))
    fine = residual_quantity(found)
    charts = []
    for k in range(measured.shape[1]):
        both = (
            Series("measured", quantity, measured[:, k], "measured"),
            Series("fitted", quantity, fitted[:, k], "nominal"),
        )
        charts.append(Chart(f"{what} {k + 1}", time_axis(time), both, group="fit"))
    # what was left out of the fit, to validate it
    aside = [
        Mark(float(end), f"validates {word}", "vertical", "neutral")
        for span in details["validating"]
        for word, end in zip(("from", "to"), span, strict=True)
    ]
    for title, model in (("identified", fitted), ("nominal", np.asarray(details["before"], dtype=float))):
        rest = tuple(
            Series(f"{what} {k + 1}", fine, measured[:, k] - model[:, k], "error", leg=k + 1 if k < 6 else None)
            for k in range(measured.shape[1])
        )
        name = f"residuals, {title} platform"
        charts.append(
            Chart(name, time_axis(time), rest, marks=tuple(aside), y=Axis("residual", fine), group="residuals")
        )
    return charts
