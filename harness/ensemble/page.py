"""A page of an ensemble for the browser: bands, histograms, dependence, sensitivity, worst members; works offline."""

import html
from collections.abc import Mapping, Sequence
from string import Template
from typing import Any

import numpy as np
import polars

from gough_stewart.harness.ensemble.columns import MEMBER, OUTCOME
from gough_stewart.harness.ensemble.report import failure_table, quantile_table, worst_table
from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.ensemble.sensitivity import Sensitivity
from gough_stewart.harness.ensemble.statistics import counted, failures, finite, left_out
from gough_stewart.harness.ensemble.tables import shown_input, shown_signal
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.display_resolution import least_span
from gough_stewart.harness.output.pages import asset, document, packed, plotly
from gough_stewart.harness.output.tables import Sheet, to_html
from gough_stewart.harness.report.sheets import sheet_of
from gough_stewart.harness.results.bands import MOST_MEMBERS, QUANTILES
from gough_stewart.harness.results.metric import Shown
from gough_stewart.harness.results.metric_folds import shown_metric
from gough_stewart.model.vectors import FloatArray

PAGE = "report.html"
# Points in a chart that a browser can still move smoothly.
_MOST_POINTS = 10_000
_MARKS = ((0.05, "5 %"), (0.5, "50 %"), (0.95, "95 %"))
_MOST_BARS = 15


def ensemble_page(
    ensemble: Ensemble,
    by: str,
    worst: Mapping[int, str],
    sensitivities: Sequence[Sensitivity] = (),
    more: Sequence[Sheet] = (),
) -> bytes:
    """Create the page; it loads nothing, and the same ensemble gives the same bytes.

    Parameters
    ----------
    by
        The metric shown first, which also ranks the worst members.
    worst
        Worst members, with the address of each one's own page relative to this one; "" for none.
    sensitivities
        Sensitivities by metric.
    more
        Further tables, shown before the others.
    """
    n = ensemble.members.height
    seed = f"seed {ensemble.metadata['seed']}, " if "seed" in ensemble.metadata else ""
    lead = f"{n} members, {seed}sampling {ensemble.metadata.get('sampling', 'random').replace('_', ' ')}"
    body = Template(asset("ensemble", "ensemble.html")).substitute(
        title=html.escape(ensemble.title),
        lead=html.escape(lead),
        hint=html.escape(_hint(n, left_out(ensemble.members))),
        tables="".join(_in_box(to_html(sheet)) for sheet in more) + _tables(ensemble, by, worst),
        footer="Made by gough-stewart; includes plotly.js.",
    )
    scripts = [plotly(), asset("output", "page.js") + asset("ensemble", "ensemble.js")]
    data = _data(ensemble, by, sensitivities)
    style = asset("output", "panels.css") + asset("ensemble", "ensemble.css")
    return document(f"{ensemble.title}: ensemble", body, style, data, scripts)


def _hint(n: int, without: int) -> str:
    parts = ["Bands: median, 25 to 75 %, 5 to 95 %, and extremes of the members still running."]
    if without:
        parts.append(
            f"Quantiles of metrics leave out the {without} members that did not complete; margins count for all."
        )
    if n > MOST_MEMBERS:
        error = 100 * np.sqrt(0.05 * 0.95 / MOST_MEMBERS)
        parts.append(
            f"Quantiles are over the first {MOST_MEMBERS} members (the 5 % line is at {5 - error:.1f} to "
            f"{5 + error:.1f} % of all members), extremes over all."
        )
    if n > _MOST_POINTS:
        parts.append(f"Points and histograms show the first {_MOST_POINTS} members, tables all.")
    return " ".join(parts)


def _tables(ensemble: Ensemble, by: str, worst: Mapping[int, str]) -> str:
    names = [name for name in ensemble.metrics if len(counted(ensemble.members, name))]
    sheets = [to_html(sheet_of(quantile_table(ensemble.members, names)))]
    if failures(ensemble.members):
        sheets.append(to_html(sheet_of(failure_table(ensemble.members))))
    if worst:
        sheets.insert(0, _linked(to_html(sheet_of(worst_table(ensemble, list(worst), by))), worst))
    return "".join(map(_in_box, sheets))


def _linked(table: str, worst: Mapping[int, str]) -> str:
    """Make the numbers of members links to their pages."""
    for member, address in worst.items():
        if address:
            cell = f'<th scope="row">{member}</th>'
            link = f'<th scope="row"><a href="{html.escape(address)}">{member}, in 3-D</a></th>'
            table = table.replace(cell, link, 1)
    return table


def _data(ensemble: Ensemble, by: str, sensitivities: Sequence[Sensitivity]) -> dict[str, Any]:
    first = ensemble.members.head(_MOST_POINTS)
    some = Ensemble(first, ensemble.bands, ensemble.metadata)
    names = [name for name in ensemble.metrics if len(finite(ensemble.values(name)))]
    signals = list(dict.fromkeys(ensemble.bands["signal"].to_list()))
    time = ensemble.bands["time"].unique().sort().to_numpy()
    return {
        "colours": COLOURS,
        "by": by,
        "member": packed(first[MEMBER].to_numpy(), "i4"),
        "completed": packed((first[OUTCOME] == "completed").to_numpy().astype(int), "i1"),
        "metrics": [_metric(ensemble, some, name) for name in names],
        "inputs": [
            {**_named(shown_input(name), name, some.values(name)), "values": packed(some.values(name), "f4")}
            for name in ensemble.varied
            if len(finite(some.values(name)))
        ],
        "time": packed(time, "f4"),
        "signals": [_signal(ensemble, column) for column in signals],
        "sensitivity": {found.metric: _sensitivity(found) for found in sensitivities},
    }


def _named(shown: Shown, name: str, values: FloatArray) -> dict[str, Any]:
    """How to display a quantity, and the least span of an axis for these values [display unit]."""
    largest = float(np.abs(finite(values)).max(initial=0.0))
    return {"name": name, "text": shown.text, "unit": shown.unit, "least": least_span(shown.unit or "1", largest)}


def _metric(ensemble: Ensemble, some: Ensemble, name: str) -> dict[str, Any]:
    shown = shown_metric(name)
    values = counted(ensemble.members, name)
    levels = np.quantile(values, [level for level, _ in _MARKS]) if len(values) else ()
    return {
        **_named(shown, name, shown.factor * some.values(name)),
        "values": packed(shown.factor * some.values(name), "f4"),
        "marks": [
            {"value": float(shown.factor * value), "text": text}
            for value, (_, text) in zip(levels, _MARKS, strict=False)
        ],
    }


def _signal(ensemble: Ensemble, column: str) -> dict[str, Any]:
    part, shown = ensemble.bands.filter(polars.col("signal") == column), shown_signal(column)
    lines = {name: shown.factor * part[name].fill_null(np.nan).to_numpy() for name in ("lowest", *QUANTILES, "highest")}
    extremes = np.concatenate([lines["lowest"], lines["highest"]])
    return {**_named(shown, column, extremes), **{name: packed(line, "f4") for name, line in lines.items()}}


def _sensitivity(found: Sensitivity) -> dict[str, Any]:
    order = found.order[:_MOST_BARS]
    bars = [("alone" if found.total is not None else "β", found.main, found.main_confidence)]
    if found.total is not None and found.total_confidence is not None:
        bars.append(("in total", found.total, found.total_confidence))
    return {
        "remark": found.remark,
        "axis": "share of the variance" if found.total is not None else "standardised regression coefficient β",
        "inputs": [found.inputs[k] for k in order],
        "bars": [
            {"name": name, "values": _plain(values[order]), "confidence": _plain(confidence[order])}
            for name, values, confidence in bars
        ],
    }


def _plain(values: FloatArray) -> list[float | None]:
    """The values with None for NaN, which JSON lacks."""
    return [float(value) if np.isfinite(value) else None for value in values]


def _in_box(table: str) -> str:
    return f"<div>{table}</div>"
