"""A page of an identification for the browser: tables, intervals, correlation, fit and residuals; works offline."""

import html
from collections.abc import Sequence
from string import Template
from typing import Any

import numpy as np

from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.tables import sheets_of
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.display_resolution import least_span
from gough_stewart.harness.output.pages import asset, document, packed, plotly
from gough_stewart.harness.output.tables import Sheet, to_html
from gough_stewart.model.platform import Platform


def identification_page(estimate: Estimate, nominal: Platform, more: Sequence[Sheet] = ()) -> bytes:
    """Create the page; `more` has further tables, such as an experiment before and after."""
    title = f"Parameters of {nominal.name}"
    body = Template(asset("identify", "identify.html")).substitute(
        title=html.escape(title),
        lead=html.escape(f"method {estimate.method}"),
        remarks=_remarks(estimate),
        tables="".join(f"<div>{to_html(sheet)}</div>" for sheet in (*more, *sheets_of(estimate))),
        footer=html.escape(
            "Intervals hold 95 % of the time if the model structure is right and the forces are calibrated. Made by "
            "gough-stewart; includes plotly.js."
        ),
    )
    scripts = [plotly(), asset("output", "page.js") + asset("identify", "identify.js")]
    style = asset("output", "panels.css") + asset("identify", "identify.css")
    return document(title, body, style, _data(estimate), scripts)


def _remarks(estimate: Estimate) -> str:
    """Alarms, then notes, as a list."""
    lines = [f'<li class="alarm"><strong>Alarm:</strong> {html.escape(alarm)}</li>' for alarm in estimate.alarms]
    lines += [f"<li>{html.escape(note)}</li>" for note in estimate.notes]
    return f'<ul class="remarks">{"".join(lines)}</ul>' if lines else ""


def _data(estimate: Estimate) -> dict[str, Any]:
    half = estimate.values - estimate.interval[:, 0]
    scale = 100 / estimate.scale
    data: dict[str, Any] = {
        "names": list(estimate.names),
        "change": _numbers((estimate.values - estimate.nominal) * scale),
        "half": _numbers(half * scale),
        "correlation": [_numbers(row) for row in estimate.correlation],
        "time": None,
    }
    found = estimate.details
    if "time" not in found:
        return data
    return data | {
        "time": packed(found["time"], "f4"),
        "channels": found["measured"].shape[1],
        "measured": packed(found["measured"], "f8"),
        "fitted": packed(found["fitted"], "f8"),
        "before": packed(found["before"], "f8"),
        "aside": [list(span) for span in found["validating"]],
        "quantity": estimate.residuals.quantity,
        "unit": estimate.residuals.unit,
        "least": least_span(estimate.residuals.unit, float(np.nanmax(np.abs(found["measured"])))),
        "colours": list(COLOURS),
    }


def _numbers(values: Any) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]
