"""An estimate as tables."""

import math
from dataclasses import replace

from gough_stewart.harness.identify.causes import Diagnosis
from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.lack_of_fit import LackOfFit
from gough_stewart.harness.identify.names import unit_of
from gough_stewart.harness.report.quantities import NUMBER, SHARE, Quantity, of_unit
from gough_stewart.harness.report.table import Cell, Column, Table, Value

_TWO, _SHARE = replace(NUMBER, digits=2), replace(SHARE, digits=2)
# Of what is known very well, also less than a thousandth of a percent is told.
_PERCENT = "± %"
# So many estimates that an error moves most are told.
_SHIFTS = 3
# Residuals of a length are micrometres.
_MICROMETRE = Quantity("m", "µm", 1e6)


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


def quantity_of(name: str, digits: int = 6) -> Quantity:
    """How a parameter is written."""
    unit = unit_of(name)
    return replace(of_unit(unit) if unit else NUMBER, digits=digits)


def residual_quantity(estimate: Estimate) -> Quantity:
    """How its residuals are written."""
    unit = estimate.residuals.unit
    return _MICROMETRE if unit == "m" else of_unit(unit)


def _parameters(estimate: Estimate) -> Table:
    rows: list[tuple[Cell, ...]] = []
    half = estimate.values - estimate.interval[:, 0]
    for k, name in enumerate(estimate.names):
        value, spread = float(estimate.values[k]), float(half[k])
        first: list[Cell] = [name, Value(float(estimate.nominal[k]), quantity_of(name, 5))]
        found = Value(value, quantity_of(name))
        if name in estimate.not_excited:
            rows.append((*first, "not excited", None, None))
        elif name in estimate.at_bound:
            rows.append((*first, found, "at its bound", None))
        else:
            share = 100 * spread / abs(value) if value else None
            rows.append((*first, found, Value(spread, quantity_of(name, 2)), share))
    columns = (
        Column(""),
        Column("before"),
        Column("estimate"),
        Column("±", None, "half of the 95 % confidence interval"),
        Column(_PERCENT, _TWO, "the same as a share of the value"),
    )
    return Table("Parameters, with 95 % intervals", columns, tuple(rows))


def _identifiability(estimate: Estimate) -> Table:
    columns = (
        Column("combination, relative to scale"),
        Column(_PERCENT, _TWO, "half of the 95 % confidence interval"),
    )
    rows = tuple(
        (estimate.combination(k), float(100 / sigma) if k < estimate.rank else "unobservable")
        for k, sigma in enumerate(estimate.singular_values)
    )
    return Table(f"Identifiability; condition number {estimate.condition_number:.3g}", columns, rows)


def _residuals(estimate: Estimate) -> Table:
    found, quantity = estimate.residuals, residual_quantity(estimate)
    columns = (
        Column("residual"),
        Column("fitted", quantity, "RMS over the rows of the fit"),
        Column("validation", quantity, "RMS over rows that were left out of the fit"),
        Column("of signal", replace(SHARE, digits=3), "RMS of the residual over that of the signal"),
        Column("p of whiteness", _TWO, "small if residuals follow each other, which noise does not"),
    )
    rows = []
    for k, rms in enumerate(found.rms):
        aside = None if found.validation_rms is None else float(found.validation_rms[k])
        share = float(rms / found.signal_rms[k]) if found.signal_rms[k] > 0 else None
        white = None if found.whiteness is None else float(found.whiteness[k])
        rows.append((f"{found.quantity} {k + 1}", float(rms), aside, share, _p(white)))
    return Table("Residuals", columns, tuple(rows))


def _tests(test: LackOfFit) -> Table:
    title = f"What the residuals contain; all tests p = {test.combined:.2g}"
    value = Column("p value", _TWO, "probability of such residuals if the model is right")
    return Table(title, (Column("tested"), value), tuple((name, _p(p)) for name, p in test.p_values.items()))


def _p(value: float | None) -> Cell:
    """A p value; what is smaller is not known better, and none is 0."""
    return "< 1e-6" if value is not None and value < 1e-6 else value


def _findings(diagnosis: Diagnosis) -> Table:
    others = "" if len(diagnosis.findings) == 1 else ", between which the log does not tell"
    columns = (Column(""), Column("misfit explained", _SHARE))
    rows = tuple((finding.text, _rounded(finding.improvement)) for finding in diagnosis.findings)
    return Table(f"Diagnosis: {diagnosis.cause or 'no cause is sure'}{others}", columns, rows)


def _unseen(diagnosis: Diagnosis) -> Table:
    columns = (Column(""), Column("estimates would be off by"), Column("standard errors", _TWO, "of the first"))
    rows = []
    for unseen in diagnosis.unseen:
        shifts = [(name, shift, size) for name, shift, size in diagnosis.moved(unseen) if size >= 0.1]
        text = ", ".join(f"{name} {shift:+.2g} {unit_of(name)}".rstrip() for name, shift, _ in shifts[:_SHIFTS])
        rows.append((unseen.name, text or "less than a tenth of their errors", shifts[0][2] if shifts else None))
    return Table("What no residual shows, since estimates absorb it", columns, tuple(rows))


def _rounded(share: float) -> float:
    """To whole percent: what a hypothesis explains is not known better."""
    return round(share, 2) if math.isfinite(share) else share
