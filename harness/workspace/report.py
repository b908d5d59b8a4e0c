"""What a sweep of the workspace found, as a report: how far the platform reaches, and what keeps it from more."""

import numpy as np

from gough_stewart.harness.report.document import Axis, Chart, Note, Number, Report, Section, Series, Verdict
from gough_stewart.harness.report.quantities import SHARE, of_unit
from gough_stewart.harness.report.words import counted, listed, percent, sentence
from gough_stewart.harness.workspace.display import (
    fixed_text,
    is_through_home,
    limits_met,
    results_of,
    shown_coordinate,
    swept_text,
)
from gough_stewart.harness.workspace.explained import notices
from gough_stewart.harness.workspace.tables import quantity_of, size_text, workspace_tables
from gough_stewart.model.workspace_grid import COORDINATES, Workspace


def workspace_report(workspace: Workspace, *, charts: bool = True) -> Report:
    """The report of a sweep."""
    sections = [Section("Workspace", tuple(workspace_tables(workspace)))]
    if charts:
        sections.append(Section("Maps", tuple(_maps(workspace))))
    return Report(
        f"Workspace of {workspace.platform.name}",
        workspace_verdict(workspace),
        tuple(sections),
        study="workspace",
        lead=f"{swept_text(workspace)}; at {fixed_text(workspace)}",
        numbers=_numbers(workspace),
        notes=tuple(Note(text, "warning") for text in notices(workspace)),
    )


def workspace_verdict(workspace: Workspace) -> Verdict:
    """How far the platform reaches along each coordinate, the share of the grid, and the limit that keeps off most."""
    reached = workspace.qualities.reachable
    share = float(reached.mean())
    numbers = _numbers(workspace)[:1]
    if not reached.any():
        return Verdict(
            sentence([f"reaches none of {counted(reached.size, 'pose')} of this grid", _most(workspace)]),
            "bad",
            numbers,
        )
    ends = []
    for axis, (name, values) in enumerate(workspace.swept.items()):
        others = tuple(k for k in range(reached.ndim) if k != axis)
        rows = np.flatnonzero(reached.any(axis=others))
        shown = shown_coordinate(workspace, name)
        low, high = (float(values[rows[k]]) for k in (0, -1))
        whole = " or more" if rows[0] == 0 or rows[-1] == len(values) - 1 else ""
        ends.append(f"{name} {shown.text(low, 3)} to {shown.text(high, 3)}{whole}")
    size = size_text(workspace).partition("(")[2]
    area = size.partition("), ")[2]
    parts = [f"reaches {listed(ends)}", f"{percent(share)} of the grid{f', {area}' if area else ''}", _most(workspace)]
    return Verdict(sentence(parts), "told" if share < 1 else "good", numbers)


def _most(workspace: Workspace) -> str | None:
    """The limit that most poses of the grid pass."""
    code = workspace.qualities.limit
    met = {limit: float((code == limit).mean()) for limit in limits_met(workspace)}
    if not met:
        return None
    first = max(met, key=lambda limit: met[limit])
    return f"{first.text} keeps it from {percent(met[first])}"


def _numbers(workspace: Workspace) -> tuple[Number, ...]:
    reached = workspace.qualities.reachable
    made = [
        Number("reachable", "share of the grid that can be reached", float(reached.mean()), SHARE,
               explanation="of the swept poses; the ranges decide what it is a share of")
    ]  # fmt: skip
    if reached.any():
        for result in results_of(workspace):
            values = np.where(reached, result.values, np.nan)
            quantity = quantity_of(result.shown)
            worst = float(np.nanmax(values) if result.is_best_low else np.nanmin(values))
            made.append(Number(f"worst.{result.name}", f"worst {result.title}", worst, quantity,
                               explanation="over all poses that can be reached"))  # fmt: skip
    return tuple(made)


def _maps(workspace: Workspace) -> list[Chart]:
    """Each result over the first two coordinates; of a volume, in the slice nearest to home."""
    names = list(workspace.swept)
    if len(names) < 2:
        return []
    level, of_slice = _slice(workspace, names)
    reached = workspace.qualities.reachable[level]
    axes = [Axis(name, of_unit(COORDINATES[name]), workspace.swept[name]) for name in names[:2]]
    charts = []
    for result in results_of(workspace):
        values = np.where(reached, result.values[level], np.nan)
        quantity = quantity_of(result.shown)
        series = Series(result.title, quantity, values.T)
        charts.append(Chart(f"{result.title}{of_slice}", axes[0], (series,), "heat", y=axes[1], group="maps"))
    return charts


def _slice(workspace: Workspace, names: list[str]) -> tuple[tuple[slice | int, ...], str]:
    if len(names) == 2:
        return (slice(None), slice(None)), ""
    name = names[2]
    values = workspace.swept[name]
    place = min(range(len(values)), key=lambda k: not is_through_home(workspace, {name: float(values[k])}))
    if not is_through_home(workspace, {name: float(values[place])}):
        place = len(values) // 2
    text = shown_coordinate(workspace, name).text(float(values[place]), 3)
    return (slice(None), slice(None), place), f", at {name} {text}"
