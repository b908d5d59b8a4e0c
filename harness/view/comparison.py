"""Metrics of several runs side by side."""

from collections.abc import Sequence
from html import escape
from typing import Any

from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.tables import quantity_text
from gough_stewart.harness.results.metric_folds import METRICS, metric_of, shown_metric
from gough_stewart.harness.results.metrics import flattened
from gough_stewart.harness.results.outcome import is_sound, outcome_text
from gough_stewart.harness.results.record import Record

_BEST = '<span class="best">★</span> '


def comparison_table(records: Sequence[Record], metrics: Sequence[dict[str, Any]], names: Sequence[str]) -> str:
    """A table with one column per run, in HTML.

    The best values of a row are marked if all runs have the same reference and duration, all completed, and no loop
    oscillates or grows by itself.
    """
    flat = [flattened(each) for each in metrics]
    paths = dict.fromkeys(path for each in flat for path in each)
    heads = "".join(
        f'<th scope="col"><span class="swatch" style="background:{COLOURS[k]}"></span>{escape(name)}</th>'
        for k, name in enumerate(names)
    )
    outcomes = "".join(f"<td>{escape(outcome_text(each['outcome']))}</td>" for each in metrics)
    rows = [f'<tr><th scope="row">outcome</th>{outcomes}</tr>']
    marks = _same_task(records) and all(is_sound(each["outcome"]) for each in metrics)
    for path in (metric.path for metric in METRICS if metric.is_compared and metric.path in paths):
        rows.append(_row(path, [each.get(path) for each in flat], marks))
    note = ' <span class="unit">★ best of the row</span>' if marks else ""
    caption = f"<caption>Runs side by side{note}</caption>"
    head = f"<thead><tr><td></td>{heads}</tr></thead>"
    return f'<table class="comparison">{caption}{head}<tbody>{"".join(rows)}</tbody></table>'


def best(path: str, values: Sequence[float | None]) -> set[int]:
    """Indices of the best values of a metric, as displayed; none if all are equal or the metric is not ranked."""
    better = metric_of(path).better
    sign = 1.0 if better == "larger" else -1.0
    known = {k: abs(value) if sign < 0 else value for k, value in enumerate(values) if value is not None}
    if better is None or len(known) < 2:
        return set()
    most = max(sign * value for value in known.values())
    unit = shown_metric(path).unit
    texts = {k: quantity_text(value, unit) for k, value in known.items()}
    top = {texts[k] for k, value in known.items() if sign * value == most}
    found = {k for k, text in texts.items() if text in top}
    return found if len(found) < len(known) else set()


def _row(path: str, values: Sequence[float | None], marks: bool) -> str:
    shown = shown_metric(path)
    scaled = [None if value is None else shown.factor * value for value in values]
    tops = best(path, scaled) if marks else set()
    cells = (
        f"<td>{_BEST if k in tops else ''}{escape(quantity_text(value, shown.unit))}</td>"
        for k, value in enumerate(scaled)
    )
    unit = f' <span class="unit">{escape(shown.unit)}</span>' if shown.unit else ""
    return f'<tr><th scope="row">{escape(shown.text)}{unit}</th>{"".join(cells)}</tr>'


def _same_task(records: Sequence[Record]) -> bool:
    first = records[0].metadata
    return all(
        each.metadata.get("duration") == first.get("duration")
        and (each.metadata.get("experiment") or {}).get("reference") == (first.get("experiment") or {}).get("reference")
        for each in records
    )
