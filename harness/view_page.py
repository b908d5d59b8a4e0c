"""One self-contained page that shows runs: 3-D animation, curves, tables; works without a network."""

import html
import json
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.metrics import finite_part, metrics
from gough_stewart.harness.metrics_tables import metrics_sheets
from gough_stewart.harness.pages import as_json, asset, library, plotly
from gough_stewart.harness.plotting import COLOURS
from gough_stewart.harness.record import Record
from gough_stewart.harness.tables import Sheet, to_html
from gough_stewart.harness.view_charts import DASHES, POINTS, chart_of
from gough_stewart.harness.view_scene import FRAMES, frame_rows, scene_of
from gough_stewart.harness.view_tables import limits_sheet, parameters_sheet, run_sheet, versions_sheet
from gough_stewart.model.platform import Platform

PAGE = "report.html"
MOST_RECORDS = len(COLOURS)
_SCRIPTS = ("data.js", "colours.js", "bodies.js", "scene.js", "charts.js", "player.js")


def view_page(records: Sequence[Record], names: Sequence[str], more: Sequence[Sheet] = ()) -> bytes:
    """The page of one record, or of several laid over each other; the same bytes for the same records.

    Frames and curves are thinned out for display (`view_scene.FRAMES`, `view_charts.POINTS` for all records together),
    which the page says; its tables are of all rows. Rows from the first on that is not finite are left out.

    Parameters
    ----------
    records
        From runs, or read from their files.
    names
        What to call each of them.
    more
        Tables to show besides.

    Raises
    ------
    RecordError
        No record, more than `MOST_RECORDS`, or one without a single finite row or without its platform.
    """
    if not 1 <= len(records) <= MOST_RECORDS:
        raise RecordError(f"{len(records)} records; expected 1 to {MOST_RECORDS} of them on a page")
    shown = [_finite(record, name) for record, name in zip(records, names, strict=True)]
    platforms = [_platform(record, name) for record, name in zip(records, names, strict=True)]
    frames = max(FRAMES // len(records), 101)
    scenes = [scene_of(*each, frames) for each in zip(shown, platforms, names, strict=True)]
    data = {
        "scenes": scenes,
        "chart": chart_of(shown, platforms, names),
        "colours": COLOURS[: len(records)],
    }
    titles = [str(record.metadata.get("title", name)) for record, name in zip(records, names, strict=True)]
    title = titles[0] if len(records) == 1 else " · ".join(names)
    page = Template(asset("view.html")).substitute(
        title=html.escape(title),
        style=asset("view.css"),
        lead=html.escape(_lead(records[0]) if len(records) == 1 else "several runs laid over each other"),
        records=_heads(records, names),
        tables=_tables(shown, records, platforms, names, more),
        footer=html.escape(_footer(records, scenes, frames)),
        data=as_json(data),
        licences=_licences().replace("<", "‹"),
        viewer=library("meshcat", "viewer/dist/main.min.js"),
        code="\n".join(asset(name) for name in _SCRIPTS),
        plots=plotly(),
    )
    return page.encode()


def names_of(paths: Sequence[Path]) -> list[str]:
    """What to call the records of these files: their folders' names where those differ, their paths otherwise."""
    folders = [path.absolute() if path.is_dir() else path.absolute().parent for path in paths]
    names = [folder.name for folder in folders]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]


def _finite(record: Record, name: str) -> Record:
    finite = finite_part(record)
    if not finite.table.height:
        raise RecordError(f"{name}: no row with finite values; there is nothing to show")
    return finite


def _platform(record: Record, name: str) -> Platform:
    try:
        return Platform(**record.metadata["platform"])
    except (KeyError, TypeError) as error:
        raise RecordError(f"{name}: the metadata hold no platform ({error}); expected what `run` writes") from error


def _lead(record: Record) -> str:
    experiment = record.metadata.get("experiment") or {}
    said = experiment.get("description") or record.metadata["platform"].get("source", "")
    plant = record.metadata.get("plant")
    return f"{said} — platform {record.metadata['platform']['name']}" + (f", plant {plant}" if plant else "")


def _heads(records: Sequence[Record], names: Sequence[str]) -> str:
    """A line for each record, with a box to hide it if there are several; and how it ended, if not as wanted."""
    heads = []
    for k, (record, name) in enumerate(zip(records, names, strict=True)):
        outcome, several = record.metadata["outcome"], len(records) > 1
        ended = ""
        if outcome["status"] != "completed":
            said = f"{outcome['status']} at {outcome['time']:.6g} s: {outcome['cause']}"
            ended = f' <span class="ended">{html.escape(said)}</span>'
        if several:
            box = f'<input type="checkbox" data-record="{k}" checked> '
            swatch = f'<span class="swatch" style="background:{COLOURS[k]}"></span>'
            dashes = "" if DASHES[k] == "solid" else f' stroke-dasharray="{DASHES[k].replace("px", "")}"'
            line = f'<svg width="44" height="8"><path d="M0 4H44" stroke="#555" stroke-width="2"{dashes}/></svg>'
            heads.append(f'<label class="record">{box}{swatch}{line}{html.escape(name)}{ended}</label>')
        elif ended:
            heads.append(f'<p class="record">{ended}</p>')
    return "".join(heads)


def _tables(
    shown: Sequence[Record],
    records: Sequence[Record],
    platforms: Sequence[Platform],
    names: Sequence[str],
    more: Sequence[Sheet],
) -> str:
    parts = ["<h2>Results</h2>", _sheets(more)] if more else []
    for finite, record, platform, name in zip(shown, records, platforms, names, strict=True):
        heading = "Metrics" if len(records) == 1 else html.escape(name)
        limits = limits_sheet(finite, platform)
        parts += [
            f"<h2>{heading}</h2>",
            _sheets([*metrics_sheets(metrics(record)), *([limits] if limits else [])]),
            "<details><summary>Run, parameters, versions</summary>",
            _sheets([run_sheet(record), parameters_sheet(platform), versions_sheet(record)], "sheets wide"),
            "</details>",
        ]
    return "".join(parts)


def _sheets(sheets: Sequence[Sheet], kind: str = "sheets") -> str:
    return f'<div class="{kind}">' + "".join(f"<div>{to_html(sheet)}</div>" for sheet in sheets) + "</div>"


def _footer(records: Sequence[Record], scenes: Sequence[dict[str, Any]], frames: int) -> str:
    shown = ", ".join(
        f"{len(frame_rows(scene['rows'], frames))} of {record.table.height} rows"
        for record, scene in zip(records, scenes, strict=True)
    )
    return (
        f"The animation shows {shown} and straight lines between them; curves keep the smallest and the largest value "
        f"of each of {max(POINTS // len(records), 100) // 2} stretches of time, so no peak is lost. "
        "Tables are of all rows. Made by gough-stewart with three.js (MeshCat) and plotly.js inside."
    )


def _licences() -> str:
    """What the licences of MeshCat and of what is built into it want to go along; plotly.js carries its own."""
    built_in = json.loads(library("meshcat", "viewer/dist/main.min.js.THIRD_PARTY_LICENSES.json"))
    texts = [f"{each['name']} {each['version']}\n\n{each['licenseText']}" for each in built_in]
    return "\n\n".join(["MeshCat\n\n" + library("meshcat", "viewer/LICENSE"), *texts])
