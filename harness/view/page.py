"""A self-contained page that shows runs: 3-D animation, charts, tables; works offline."""

import html
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.pages import asset, document, plotly
from gough_stewart.harness.output.tables import Sheet, to_html
from gough_stewart.harness.output.three import three, three_licence
from gough_stewart.harness.results.metrics import finite_part, metrics
from gough_stewart.harness.results.outcome import is_sound, outcome_of, outcome_text
from gough_stewart.harness.results.record import Record, machine_of, platform_of
from gough_stewart.harness.results.scene import FRAMES, frame_rows
from gough_stewart.harness.results.tables import metrics_sheets
from gough_stewart.harness.view.charts import chart_of, points_of
from gough_stewart.harness.view.comparison import comparison_table
from gough_stewart.harness.view.scene import NEARNESS, packed_scene
from gough_stewart.harness.view.tables import limits_sheet, parameters_sheet, run_sheet, versions_sheet
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.platform import Platform

PAGE = "report.html"
MOST_RECORDS = len(COLOURS)
# Larger values cannot be displayed [SI units].
_LARGEST = 1e9
_DRAWN = ("position", "orientation", "leg_length", "leg_velocity", "actuator_force", "external_force")
_SCRIPTS = (
    *("data.js", "colours.js", "shapes.js", "bodies.js", "motion.js", "orbit.js", "viewer.js", "scene.js", "drawn.js"),
    *("picture.js", "video.js", "moment.js", "lines.js", "charts.js", "player.js"),
)


def view_page(records: Sequence[Record], names: Sequence[str], more: Sequence[Sheet] = ()) -> bytes:
    """Create the page of one record, or of several overlaid; the same records give the same bytes.

    Frames and curves are reduced for display (`scene.FRAMES` and `charts.POINTS` for all records together), and the
    page states it; tables use all rows. Rows from the first one that is not finite are left out.

    Parameters
    ----------
    records
        Records of runs, or read from files.
    names
        Name of each record.
    more
        Further tables to show.

    Raises
    ------
    RecordError
        There is no record, more than `MOST_RECORDS`, or one without a finite row, its platform, or a column that is
        drawn.
    """
    if not 1 <= len(records) <= MOST_RECORDS:
        raise RecordError(f"{len(records)} records; expected 1 to {MOST_RECORDS} of them on a page")
    shown = [_shown(record, name) for record, name in zip(records, names, strict=True)]
    frames = max(FRAMES // len(records), 101)
    data = {
        "scenes": [packed_scene(each.finite, each.platform, each.name, frames) for each in shown],
        "chart": chart_of([each.finite for each in shown], [each.platform for each in shown]),
        "colours": COLOURS,
        "nearness": NEARNESS,
    }
    one = len(records) == 1
    title = str(records[0].metadata.get("title", names[0])) if one else " · ".join(names)
    body = Template(asset("view", "view.html")).substitute(
        title=html.escape(title),
        lead=html.escape(_lead(records[0], shown[0].believed) if one else "several runs overlaid"),
        records=_heads(shown),
        tables=_tables(shown, more),
        footer=html.escape(_footer(shown, frames)),
        licences=html.escape(three_licence()),
    )
    # the view first, so that it appears while plotly.js is still loading
    scripts = [
        three(),
        "\n".join([asset("output", "page.js"), *(asset("view", name) for name in _SCRIPTS)]),
        plotly(),
        "GoughStewart.charts();",
    ]
    return document(title, body, asset("view", "view.css") + asset("view", "stage.css"), data, scripts)


def names_of(paths: Sequence[Path]) -> list[str]:
    """Names for the records of these files: the names of their folders if those differ, otherwise their paths."""
    folders = [path.absolute() if path.is_dir() else path.absolute().parent for path in paths]
    names = [folder.name for folder in folders]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]


class _Shown(NamedTuple):
    """A record on the page."""

    record: Record
    finite: Record  # its rows that can be drawn
    platform: Platform  # the machine's own
    believed: Platform
    name: str


def _shown(record: Record, name: str) -> _Shown:
    if not record.metadata.get("outcome"):
        raise RecordError(f"{name}: the metadata have no outcome; expected what `gough-stewart run` writes")
    try:
        platform, believed = machine_of(record), platform_of(record)
        finite = finite_part(record)
        sizes = [np.abs(finite[column]).max(axis=1) for column in _DRAWN]
    except GoughStewartError as error:
        raise RecordError(f"{name}: {error}") from error
    small = np.max(sizes, axis=0) < _LARGEST
    rows = finite.table.height if small.all() else int(small.argmin())
    if not rows:
        raise RecordError(f"{name}: no row with finite values; there is nothing to show")
    return _Shown(record, Record(finite.table.head(rows), record.metadata), platform, believed, name)


def _lead(record: Record, platform: Platform) -> str:
    metadata = record.metadata
    description = (metadata.get("experiment") or {}).get("description") or platform.source
    parts = [f"platform {platform.name}", *([f"plant {metadata['plant']}"] if metadata.get("plant") else [])]
    return " — ".join(filter(None, [description, ", ".join(parts)]))


def _heads(shown: Sequence[_Shown]) -> str:
    """One line per record, with a box to hide it if there are several, and how it ended if that is not sound."""
    heads = []
    for k, each in enumerate(shown):
        outcome, ended = outcome_of(each.record), ""
        if not is_sound(outcome):
            ended = f' <span class="ended">{html.escape(outcome_text(outcome))}</span>'
        if len(shown) > 1:
            box = f'<input type="checkbox" data-record="{k}" checked> '
            swatch = f'<span class="swatch" style="background:{COLOURS[k]}"></span>'
            heads.append(f'<label class="record">{box}{swatch}{html.escape(each.name)}{ended}</label>')
        elif ended:
            heads.append(f'<p class="record">{ended}</p>')
    return "".join(heads)


def _tables(shown: Sequence[_Shown], more: Sequence[Sheet]) -> str:
    parts = ["<h2>Results</h2>", _sheets(more)] if more else []
    found = [metrics(each.record) for each in shown]
    if len(shown) == 1:
        parts += [
            "<h2>Metrics</h2>",
            _sheets(_of_run(shown[0], found[0])),
            "<details><summary>Run, parameters, versions</summary>",
            _sheets(_of_circumstances(shown[0]), "sheets wide"),
            "</details>",
        ]
        return "".join(parts)
    table = comparison_table([each.finite for each in shown], found, [each.name for each in shown])
    parts += ["<h2>Metrics</h2>", f'<div class="sheets">{_scrolling("Runs side by side", table)}</div>']
    for k, each in enumerate(shown):
        swatch = f'<span class="swatch" style="background:{COLOURS[k]}"></span>'
        parts += [
            f"<details><summary>{swatch} {html.escape(each.name)}: all metrics, run, parameters, versions</summary>",
            _sheets(_of_run(each, found[k])),
            _sheets(_of_circumstances(each), "sheets wide"),
            "</details>",
        ]
    return "".join(parts)


def _of_run(shown: _Shown, found: dict[str, Any]) -> list[Sheet]:
    limits = limits_sheet(shown.finite, shown.platform)
    return [*metrics_sheets(found), *([limits] if limits else [])]


def _of_circumstances(shown: _Shown) -> list[Sheet]:
    record, believed = shown.record, shown.believed
    return [run_sheet(record, believed), parameters_sheet(shown.platform, believed), versions_sheet(record)]


def _sheets(sheets: Sequence[Sheet], kind: str = "sheets") -> str:
    return f'<div class="{kind}">' + "".join(_scrolling(sheet.title, to_html(sheet)) for sheet in sheets) + "</div>"


def _scrolling(title: str, table: str) -> str:
    """A table that scrolls sideways on narrow pages, also by keyboard."""
    return f'<div role="group" aria-label="{html.escape(title)}" tabindex="0">{table}</div>'


def _footer(shown: Sequence[_Shown], frames: int) -> str:
    rows = [(len(frame_rows(each.finite.table.height, frames)), each.record.table.height) for each in shown]
    frames_shown = ", ".join(f"{frames} of {height} rows" for frames, height in rows)
    return (
        f"The animation shows {frames_shown}, interpolated linearly; curves keep the smallest and the largest value "
        f"in each of {points_of(len(shown)) // 2} intervals of time, so no peak is lost. "
        "Tables use all rows. Made by gough-stewart; includes three.js and plotly.js."
    )
