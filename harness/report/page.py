"""One HTML page of a report: verdict, numbers and picture first, then charts and tables; works offline.

Texts and tables are HTML, so that they are there without a script; charts and scenes are data, drawn by `web/`.
"""

import html
from collections.abc import Iterable, Sequence
from typing import Any

from gough_stewart.harness.report.chart import Chart
from gough_stewart.harness.report.document import Note, Number, Part, Report, Requirement, Section
from gough_stewart.harness.report.glossary import explained, with_terms
from gough_stewart.harness.report.libraries import bokeh, bokeh_licence, three, three_licence
from gough_stewart.harness.report.offline import asset, document
from gough_stewart.harness.report.packing import MOST_ROWS, Arrays
from gough_stewart.harness.report.page_data import chart_data, is_over_time, member_data, scene_data, surface_data
from gough_stewart.harness.report.page_tables import link, table_html
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
from gough_stewart.harness.report.table import Column, Table
from gough_stewart.harness.report.words import with_minus

PAGE = "report.html"
_SCENE_SCRIPTS = (
    *("records.js", "colours.js", "shapes.js", "bodies.js", "motion.js", "orbit.js", "viewer.js", "scene.js"),
    *("drawn.js", "moment.js"),
)
_SURFACE_SCRIPTS = ("shapes.js", "orbit.js", "viewer.js", "surface.js")
_SCRIPTS = ("page.js", "arrays.js", "state.js", "tables.js", "terms.js", "members.js", "marked.js")
_CHART_SCRIPTS = (
    "reduce.js",
    "lines.js",
    "heat.js",
    "figure.js",
    "legend.js",
    "pointer.js",
    "charts.js",
    "player.js",
    "print.js",
)
_STYLES = ("page.css", "first.css", "charts.css", "stage.css", "print.css")
_SIGNS = {"good": "✓", "marginal": "!", "bad": "✗", "told": "→", "met": "✓", "missed": "✗", "open": "?"}
_SAID = {"good": "good", "marginal": "marginal", "bad": "bad", "told": "result"}
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
# What is known of the members that a reader marks in a chart.
_MARKED = '<section id="marked" class="part" aria-live="polite" hidden></section>'
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
    # a single chart over time among others needs no controls of time
    has_time = bool(scenes) or sum(map(is_over_time, charts)) > 1 or bool(charts and is_over_time(charts[0]))
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
    is_solid = bool(scenes or surfaces)
    first = None if is_solid else next((chart for chart in charts if not chart.detail), None)
    body = _Body(charts, first)
    main = "".join(
        [
            _head(report),
            '<main id="main">',
            _first(report, body, scenes, surfaces, first),
            asset("bar.html") if has_time else "",
            _settings(report),
            _MARKED if data["members"] else "",
            *(body.section(section) for section in report.sections),
            _files(report),
            "</main>",
            _footer(charts, is_solid),
        ]
    )
    solid = _SCENE_SCRIPTS if scenes else _SURFACE_SCRIPTS if surfaces else ()
    own = [asset(name) for name in (*_SCRIPTS, *solid, *_CHART_SCRIPTS)]
    # the scene first, so that it appears while the library of the charts is still loading
    scripts = [*([three()] if is_solid else []), "\n".join(own)]
    scripts += [bokeh(), "GoughStewart.charts();"] if charts else []
    style = "".join(asset(name) for name in _STYLES)
    return document(report.title, main, colours() + style, data, scripts)


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
    both = "".join(f"--{role}: light-dark({colour_of(role, 'light')}, {colour_of(role, 'dark')}); " for role in ROLES)
    six = "".join(f"--six-{k}: light-dark({colour_of_six(k, 'light')}, {colour_of_six(k, 'dark')}); " for k in range(6))
    strong = "".join(f"--{role}: {colour_of(role, 'contrast')}; " for role in ROLES)
    strong += "".join(f"--six-{k}: {colour_of_six(k, 'contrast')}; " for k in range(6))
    return f":root {{ {both}{six}}}\n:root[data-theme=contrast] {{ {strong}}}\n"


# The HTML


def _head(report: Report) -> str:
    study = f'<p class="study">{html.escape(report.study)}</p>' if report.study else ""
    leads = [report.lead, f"set: {report.changed}" if report.changed else ""]
    lead = "".join(f'<p class="lead">{with_terms(each)}</p>' for each in leads if each)
    theme = f'<label class="theme">colours <select id="theme" autocomplete="off">{THEME_OPTIONS}</select></label>'
    return f"<header>{theme}<div>{study}<h1>{html.escape(report.title)}</h1>{lead}</div></header>"


def _first(
    report: Report, body: "_Body", scenes: Sequence[Scene], surfaces: Sequence[Surface], first: Chart | None
) -> str:
    verdict = report.verdict
    said = f'<span class="sign" aria-hidden="true">{_SIGNS[verdict.status]}</span>'
    said += f'<span class="unseen">{_SAID[verdict.status]}: </span>{with_terms(verdict.text)}'
    numbers = "".join(map(_number, verdict.numbers[:_MOST_NUMBERS]))
    parts = [
        f'<p class="verdict {verdict.status}">{said}</p>',
        f'<dl class="numbers">{numbers}</dl>' if numbers else "",
        _requirements(report.requirements),
        *(
            _note(note)
            for note in report.notes
            if note.text.casefold() not in verdict.text.casefold() or note.kind == "note"
        ),
    ]
    if scenes:
        parts.append(
            '<div id="now" class="sideways" role="region" aria-label="values at this time" tabindex="0"></div>'
        )
    if scenes or surfaces:
        picture = asset("stage.html" if scenes else "surface.html")
    else:
        picture = body.chart(first) if first is not None else ""
    alone = "" if picture else " alone"
    return (
        f'<section class="first{alone}" aria-label="verdict"><div class="answer">{"".join(parts)}</div>'
        f'{picture and f"""<div class="picture">{picture}</div>"""}</section>'
    )


def _number(number: Number) -> str:
    state = ' class="missed"' if number.margin is not None and number.margin < 0 else ""
    small = f"<small>{html.escape(with_minus(number.remark))}</small>" if number.remark else ""
    has_unit = number.quantity.unit and number.value is not None
    value, _, own = number.text.rpartition(" ") if has_unit else (number.text, "", "")
    unit = f' <span class="unit">{html.escape(own)}</span>' if has_unit else ""
    value = html.escape(with_minus(value))
    name = explained(number.name, number.explanation)
    return f"<div{state}><dt>{name}</dt><dd><b>{value}</b>{unit}{small}</dd></div>"


def _requirements(requirements: Sequence[Requirement]) -> str:
    if not requirements:
        return ""
    items = []
    for each in requirements:
        sign = f'<span class="sign" aria-hidden="true">{_SIGNS[each.status]}</span>'
        said = f"<b>{OUTCOMES[each.status]}</b>: {html.escape(each.text)}; {html.escape(each.found)}"
        items.append(f'<li class="{each.status}">{sign}{said}</li>')
    return f'<ul class="requirements" aria-label="requirements">{"".join(items)}</ul>'


def _note(note: Note) -> str:
    sign = '<span class="sign" aria-hidden="true">!</span>' if note.kind == "warning" else ""
    return f'<p class="note {note.kind}">{sign}{with_terms(note.text)}</p>'


def _settings(report: Report) -> str:
    """What differs between several runs; of a single one, what was set is in the head."""
    if not report.settings or len(report.runs) < 2:
        return ""
    rows = tuple((each.key, *each.values) for each in report.settings)
    table = Table("What differs between the runs", tuple(map(Column, ("setting", *report.runs))), rows)
    return f'<section class="part">{table_html(table)}</section>'


def _files(report: Report) -> str:
    if not report.files:
        return ""
    items = "".join(f"<li>{link(each.name, each.name)} {html.escape(each.what)}</li>" for each in report.files)
    return f'<section class="part"><details><summary>Files</summary><ul class="files">{items}</ul></details></section>'


class _Body:
    """Sections as HTML; charts by their number."""

    def __init__(self, charts: Sequence[Chart], first: Chart | None) -> None:
        self._number = {id(chart): k for k, chart in enumerate(charts)}
        self._first = first

    def section(self, section: Section) -> str:
        """A section, with what is only opened if needed at its end."""
        parts = [part for part in section.parts if part is not self._first and not isinstance(part, Scene | Surface)]
        if not parts:
            return ""
        shown = self._parts(part for part in parts if section.detail or not getattr(part, "detail", False))
        hidden = [part for part in parts if not section.detail and getattr(part, "detail", False)]
        title = f"<h2>{html.escape(section.title)}</h2>"
        if section.detail:
            return (
                f'<section class="part"><details><summary>{html.escape(section.title)}</summary>{shown}</details>'
                "</section>"
            )
        more = ""
        if hidden:
            named = ", ".join(dict.fromkeys(part.title for part in hidden if isinstance(part, Chart | Table)))
            named = named if len(named) <= 120 else f"{named[:117].rpartition(', ')[0]} …"
            more = f"<details><summary>More: {html.escape(named)}</summary>{self._parts(hidden)}</details>"
        return f'<section class="part">{title if shown else ""}{shown}{more}</section>'

    def chart(self, chart: Chart) -> str:
        """The frame of a chart, which a script fills."""
        note = f'<p class="hint">{with_terms(chart.note)}</p>' if chart.note else ""
        k, level = self._number[id(chart)], "h2" if chart is self._first else "h3"
        # a map has no axis for its values
        named = chart.series[0].quantity.headed(chart.title) if chart.map is not None else chart.title
        title = f"<{level}>{with_terms(named)}</{level}>"
        return (
            f'<figure class="chart {chart.kind}" data-chart="{k}"><figcaption>{title}<ul class="key"></ul></figcaption>'
            f'<div class="plot"></div>{note}</figure>'
        )

    def _parts(self, parts: Iterable[Part]) -> str:
        """Parts in order; neighbours of a kind share a grid."""
        found, kind = [], ""
        for part in parts:
            here = "charts" if isinstance(part, Chart) else "tables" if isinstance(part, Table) else "notes"
            if here != kind:
                found += ["</div>" if kind else "", f'<div class="{here}">']
                kind = here
            found.append(
                self.chart(part)
                if isinstance(part, Chart)
                else table_html(part)
                if isinstance(part, Table)
                else _note(part)
                if isinstance(part, Note)
                else ""
            )
        return "".join(found) + ("</div>" if kind else "")


def _footer(charts: Sequence[Chart], scene: bool) -> str:
    rows = max(
        (len(chart.x_of(each)) for chart in charts if chart.kind in ("line", "step") for each in chart.series),
        default=0,
    )
    kept = (
        f"Of more than {MOST_ROWS:,} rows, charts show the smallest and the largest value of each block of "
        f"{-(-2 * rows // MOST_ROWS)} rows. "
        if rows > MOST_ROWS
        else "Charts have all rows, rounded finer than a pixel. "
        if rows
        else ""
    )
    inside = [*(["three.js"] if scene else []), *(["Bokeh"] if charts else [])]
    includes = f"; includes {' and '.join(inside)}" if inside else ""
    licences = "\n\n".join([*([three_licence()] if scene else []), *([bokeh_licence()] if charts else [])])
    details = (
        f"<details><summary>Licences of what is inside</summary><pre>{html.escape(licences)}</pre></details>"
        if inside
        else ""
    )
    return f"<footer>{kept}Made by gough-stewart{includes}.{details}</footer>"
