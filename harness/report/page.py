"""One HTML page of a report: verdict, numbers and picture first, then charts and tables; works offline.

Texts and tables are HTML by `web/report.html`, so that they are there without a script; charts and scenes are data,
drawn by the scripts of `web/`.
"""

import html
from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any, NamedTuple
from urllib.parse import quote

from markupsafe import Markup

from gough_stewart.harness.report.chart import Chart
from gough_stewart.harness.report.document import Note, Number, Part, Report, Section
from gough_stewart.harness.report.glossary import explained, with_terms
from gough_stewart.harness.report.offline import TEMPLATES, asset, bokeh, bokeh_licence, document, three, three_licence
from gough_stewart.harness.report.packing import MOST_ROWS, Arrays
from gough_stewart.harness.report.page_data import chart_data, member_data, scene_data, surface_data
from gough_stewart.harness.report.palette import (
    DASHES,
    GROUND,
    INK,
    KINDS,
    ROLES,
    SIX_DASHES,
    THEMES,
    Theme,
    colour_of,
    colour_of_six,
)
from gough_stewart.harness.report.requirements import OUTCOMES
from gough_stewart.harness.report.scene import Scene, Surface
from gough_stewart.harness.report.table import Cell, Column, Table, Value, is_at_right
from gough_stewart.harness.report.words import with_minus

PAGE = "report.html"
_SCENE_SCRIPTS = (
    *("records.js", "colours.js", "shapes.js", "bodies.js", "motion.js", "orbit.js", "viewer.js", "scene.js"),
    *("drawn.js", "moment.js"),
)
_SURFACE_SCRIPTS = ("shapes.js", "orbit.js", "viewer.js", "surface.js")
_SCRIPTS = ("page.js", "arrays.js", "state.js", "tables.js", "members.js")
_MAP_SCRIPTS = ("heat.js",)
_CHART_SCRIPTS = ("lines.js", "figure.js", "legend.js", "own.js", "charts.js", "player.js")
_STYLES = ("page.css", "first.css", "charts.css", "stage.css", "print.css")
_SIGNS = {"good": "✓", "marginal": "!", "bad": "✗", "told": "→", "met": "✓", "missed": "✗", "open": "?"}
# Colours of nearness to a limit, from 0 in the middle to 1 at the limit, and beyond it. Lightness and the contrast of
# blue and yellow tell them apart without red and green (simulated as by Machado et al., IEEE Trans. Vis.
# Comput. Graph. 15 (2009), 1291-1298).
NEARNESS: dict[str, Any] = {
    "stops": [(0.0, "#6baed6"), (0.5, "#b8d0dc"), (0.8, "#f5b722"), (1.0, "#a50f15")],
    "beyond": "#5c1a7e",
}
THEME_OPTIONS = "".join(
    f'<option value="{value}">{text}</option>'
    for value, text in (("", "as the system"), ("light", "light"), ("dark", "dark"), ("contrast", "high contrast"))
)
# Largest number of values that stand beside the verdict.
_MOST_NUMBERS = 6


def page_of(report: Report) -> bytes:
    """The page; it loads nothing, and the same report gives the same bytes.

    Series of more than `packing.MOST_ROWS` rows are kept as blocks with their smallest and largest value, and the page
    says so.
    """
    arrays, charts = Arrays(), report.charts
    scenes = [part for part in report.parts() if isinstance(part, Scene)]
    surfaces = [part for part in report.parts() if isinstance(part, Surface)]
    is_solid = bool(scenes or surfaces)
    # a single chart over time among others needs no controls of time
    has_time = bool(scenes) or sum(c.is_over_time for c in charts) > 1 or bool(charts and charts[0].is_over_time)
    data = {
        "title": report.title,
        "changed": report.changed,
        "runs": report.runs,
        "palette": {theme: palette_of(theme) for theme in THEMES},
        "dashes": {role: DASHES.get(role, ()) for role in ROLES},
        "sixDashes": SIX_DASHES,
        "nearness": NEARNESS,
        "charts": [chart_data(chart, arrays, has_time=has_time) for chart in charts],
        "scenes": [scene_data(scene, arrays) for scene in scenes],
        "surfaces": [surface_data(surface, arrays) for surface in surfaces],
        "members": member_data(report, arrays),
        "arrays": arrays.packed,
    }
    body = TEMPLATES.get_template("report.html").render(
        report=report,
        charts=charts,
        scenes=scenes,
        surfaces=surfaces,
        first=None if is_solid else next((chart for chart in charts if not chart.detail), None),
        number_of={id(chart): k for k, chart in enumerate(charts)},
        has_time=has_time,
        has_members=bool(data["members"]),
        differences=_differences(report),
        themes=Markup(THEME_OPTIONS),
        signs=_SIGNS,
        outcomes=OUTCOMES,
        most_numbers=_MOST_NUMBERS,
        kept=_kept(charts),
        inside=[*(["three.js"] if is_solid else []), *(["Bokeh"] if charts else [])],
        licences=[*([three_licence()] if is_solid else []), *([bokeh_licence()] if charts else [])],
    )
    solid = _SCENE_SCRIPTS if scenes else _SURFACE_SCRIPTS if surfaces else ()
    maps = _MAP_SCRIPTS if surfaces or any(chart.kind == "heat" for chart in charts) else ()
    drawing = "\n".join(asset(name) for name in (*_SCRIPTS, *maps, *solid, *_CHART_SCRIPTS))
    # the scene first, so that it appears while the library of the charts is still loading
    scripts = [*([three()] if is_solid else []), drawing, *([bokeh(), "GoughStewart.charts();"] if charts else [])]
    return document(report.title, body, colours() + "".join(map(asset, _STYLES)), data, scripts)


def palette_of(theme: Theme) -> dict[str, Any]:
    """Ground, ink, and the colours of roles and of six."""
    return {
        "ground": GROUND[theme],
        "ink": INK[theme],
        "roles": {role: colour_of(role, theme) for role in ROLES},
        "six": [colour_of_six(k, theme) for k in range(6)],
        "kinds": KINDS[theme],
    }


def colours() -> str:
    """The colours of roles as custom properties, for light and dark, and for high contrast."""
    themes = "".join(f"--{role}: light-dark({colour_of(role, 'light')}, {colour_of(role, 'dark')}); " for role in ROLES)
    six = "".join(f"--six-{k}: light-dark({colour_of_six(k, 'light')}, {colour_of_six(k, 'dark')}); " for k in range(6))
    strong = "".join(f"--{role}: {colour_of(role, 'contrast')}; " for role in ROLES)
    strong += "".join(f"--six-{k}: {colour_of_six(k, 'contrast')}; " for k in range(6))
    return f":root {{ {themes}{six}}}\n:root[data-theme=contrast] {{ {strong}}}\n"


def to_html(report: Report) -> str:
    """A report in a notebook: the verdict, the tables but those of details, and the notes; all texts escaped."""
    macros: Any = TEMPLATES.get_template("notebook.html").module
    return str(macros.whole(report, lambda part: type(part).__name__))


def table_to_html(table: Table) -> str:
    """A table in a notebook; a unit that all numbers of a row share stands beside its first cell."""
    macros: Any = TEMPLATES.get_template("notebook.html").module
    return str(macros.table(table))


def _differences(report: Report) -> Table | None:
    """What differs between several runs; of a single one, what was set is in the head."""
    if not report.settings or len(report.runs) < 2:
        return None
    rows = tuple((setting.key, *setting.values) for setting in report.settings)
    return Table("What differs between the runs", tuple(map(Column, ("setting", *report.runs))), rows)


def _kept(charts: Sequence[Chart]) -> str:
    curves = [chart for chart in charts if chart.kind in ("line", "step")]
    rows = max((len(chart.x_of(series)) for chart in curves for series in chart.series), default=0)
    if rows > MOST_ROWS:
        block = -(-2 * rows // MOST_ROWS)
        return (
            f"Of more than {MOST_ROWS:,} rows, charts show the smallest and the largest value of each block of "
            f"{block} rows. "
        )
    return "Charts have all rows, rounded finer than a pixel. " if rows else ""


# Filters of the templates


class _Drawn(NamedTuple):
    """A part of a section that its place on the page draws, and whether it is opened if needed."""

    part: Part
    detail: bool


def _drawn(section: Section, first: Chart | None) -> list[_Drawn]:
    """The parts of a section that are not in the picture of the page."""
    parts = [part for part in section.parts if part is not first and not isinstance(part, Scene | Surface)]
    return [_Drawn(part, not isinstance(part, Note) and part.detail) for part in parts]


def _neighbours(parts: Iterable[Part]) -> list[tuple[str, list[Part]]]:
    """Parts in order; neighbours of a kind share a grid."""
    kinds: dict[type, str] = {Chart: "charts", Table: "tables"}
    return [(kind, list(some)) for kind, some in groupby(parts, key=lambda part: kinds.get(type(part), "notes"))]


def _titles(hidden: Sequence[_Drawn]) -> str:
    text = ", ".join(dict.fromkeys(shown.part.title for shown in hidden if isinstance(shown.part, Chart | Table)))
    return text if len(text) <= 120 else f"{text[:117].rpartition(', ')[0]} …"


def _sides(table: Table) -> list[bool]:
    texts = [table.texts(k) for k in range(len(table.rows))]
    columns = range(len(table.columns))
    return [k > 0 and is_at_right([row[k] for row in table.rows], [row[k] for row in texts]) for k in columns]


def _sort_value(cell: Cell) -> str:
    value = cell.value if isinstance(cell, Value) else cell
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return Markup(f' data-value="{float(value)!r}"') if is_number else ""  # type: ignore[arg-type]


def _split_unit(number: Number) -> tuple[str, str]:
    if not number.quantity.unit or number.value is None:
        return number.text, ""
    value, _, unit = number.text.rpartition(" ")
    return value, unit


def _link(file: str, text: str) -> Markup:
    """A link to a file in the page's folder, whose name may have marks of URLs; only the text of a path out of it."""
    is_inside = not file.startswith("/") and ".." not in file.split("/")
    shown = html.escape(text)
    return Markup(f'<a href="{quote(file)}">{shown}</a>' if is_inside else shown)


TEMPLATES.filters |= {
    "terms": with_terms,
    "explained": explained,
    "minus": with_minus,
    "id": id,
    "drawn": _drawn,
    "neighbours": _neighbours,
    "titles": _titles,
    "sides": _sides,
    "sort_value": _sort_value,
    "split_unit": _split_unit,
    "link": _link,
}
