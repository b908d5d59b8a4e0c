"""What a sweep of the workspace found, as a report: how far the platform reaches, and what keeps it from more."""

from dataclasses import replace

import numpy as np

from gough_stewart.harness.report.chart import Axis, Chart, Map, Series
from gough_stewart.harness.report.document import Note, Number, Part, Report, Section, Verdict
from gough_stewart.harness.report.quantities import NUMBER, SHARE
from gough_stewart.harness.report.scene import Surface
from gough_stewart.harness.report.words import counted, listed, percent, sentence
from gough_stewart.harness.workspace.display import (
    clearance,
    fixed_text,
    is_through_home,
    limits_met,
    results_of,
    shown_coordinate,
    swept_text,
)
from gough_stewart.harness.workspace.explained import notices
from gough_stewart.harness.workspace.isosurface import surface_of
from gough_stewart.harness.workspace.tables import quantity_of, size_text, workspace_tables
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import Limit, Workspace

# The group of the maps, and the name of their figure.
FIGURES = ("maps",)
_NOTES = {
    "condition_number": "Of the leg Jacobian, with angles as displacements of the joints. 1 is best; it is infinite at "
    "a singular pose.",
    "payload": "The largest point mass at the platform frame's origin that the actuators hold at rest.",
    "force_margin": "The largest force at the platform frame's origin, in any direction, that the actuators hold at "
    "rest.",
    "largest_speed": "The largest speed in any direction, turning included, at which no leg is faster than its limit.",
    "translational_stiffness": "Force at the platform frame's origin over the displacement along it, in the softest "
    "direction, with motors that hold.",
    "translational_stiffness_max": "The same in the stiffest direction.",
    "rotational_stiffness": "Torque over the rotation about it, about the softest axis, with motors that hold.",
    "rotational_stiffness_max": "The same about the stiffest axis.",
    "first_mode": "The lowest natural frequency of the platform on its legs, with motors that hold.",
    "leg_length_margin": "Of the leg that is nearest to an end of its stroke; negative beyond.",
    "joint_angle_margin": "Of the joint that is nearest to its largest angle; negative beyond.",
}


def workspace_report(workspace: Workspace, *, surface: bool = True) -> Report:
    """The report of a sweep, with maps of all results.

    Parameters
    ----------
    surface
        Of a volume, also the surface around it, which takes seconds.
    """
    platform, maps = workspace.platform, list[Part](_maps(workspace))
    if surface and len(workspace.shape) == 3:
        maps = [*filter(None, [_surface(workspace)]), *maps]
    source = (Note(f"{platform.name}: {platform.source}"),) if platform.source else ()
    return Report(
        f"Workspace of {platform.name}",
        workspace_verdict(workspace),
        (Section("Maps", tuple(maps)), Section("Workspace", (*workspace_tables(workspace), *source))),
        study="workspace",
        lead=f"{swept_text(workspace)}; at {fixed_text(workspace)}",
        numbers=_numbers(workspace),
        notes=tuple(Note(text, "warning") for text in notices(workspace)),
    )


def workspace_verdict(workspace: Workspace) -> Verdict:
    """How far the platform reaches along each coordinate, the share of the grid, and the limit that keeps off most."""
    reached = workspace.qualities.reachable
    share = float(reached.mean())
    # margins end at the border
    numbers = tuple(each for each in _numbers(workspace) if not each.path.endswith("_margin") or "force" in each.path)
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
    return f"{percent(met[first])} of it is out of reach because of {first.text}"


def _numbers(workspace: Workspace) -> tuple[Number, ...]:
    reached = workspace.qualities.reachable
    made = [
        Number("reachable", "share of the grid that can be reached", float(reached.mean()), SHARE,
               explanation=f"{int(reached.sum())} of {counted(reached.size, 'pose')}; the ranges decide what it is a "
               "share of")
    ]  # fmt: skip
    if reached.any():
        for result in results_of(workspace):
            values = np.where(reached, result.values, np.nan)
            quantity = quantity_of(result.shown)
            worst = float(np.nanmax(values) if result.is_best_low else np.nanmin(values))
            made.append(Number(f"worst.{result.name}", f"{result.title} at the worst pose", worst, quantity,
                               explanation=f"Over all poses that can be reached. {_NOTES[result.name]}"))  # fmt: skip
    return tuple(made)


def _maps(workspace: Workspace) -> list[Chart]:
    """What limits each pose, then each result, over the first two coordinates; of a volume in slices of the third."""
    names = list(workspace.swept)
    axes = [Axis(name, quantity_of(shown_coordinate(workspace, name)), workspace.swept[name]) for name in names]
    slices = axes[2] if len(axes) == 3 else None
    first = 0 if slices is None else _level(workspace, names[2])
    others = workspace.fixed if slices is None else {**workspace.fixed, names[2]: float(slices.values[first])}
    home = workspace.home
    point = tuple(home[name] for name in names[:2]) if is_through_home(workspace, others) else ()
    inside = _by_rows(clearance(workspace))
    whole = Map(inside, slices=slices, first=first, point=point, point_name="home" if point else "")

    def chart(title: str, series: Series, of: Map, note: str = "") -> Chart:
        return Chart(title, axes[0], (series,), "heat", y=axes[1], group=FIGURES[0], map=of, note=note)

    kinds = tuple(limit.text for limit in Limit)
    limits = Series("limit", NUMBER, _by_rows(workspace.qualities.limit.astype(float)))
    charts = [chart("reachable region", limits, replace(whole, classes=kinds))]
    # of a region that no pose is in, there is nothing to show
    for result in results_of(workspace) if workspace.qualities.reachable.any() else ():
        series = Series(result.title, quantity_of(result.shown), _by_rows(result.values))
        of = replace(whole, scale="log" if result.logarithmic else "linear")
        charts.append(chart(result.title, series, of, _NOTES[result.name]))
    return charts


def _by_rows(values: FloatArray) -> FloatArray:
    """An array of the grid as a heat map has it: slices, then rows of the second coordinate."""
    return np.asarray(np.swapaxes(values, 0, 1) if values.ndim == 2 else np.transpose(values, (2, 1, 0)))


def _level(workspace: Workspace, name: str) -> int:
    """The slice nearest to home."""
    return int(np.abs(workspace.swept[name] - workspace.home[name]).argmin())


def _surface(workspace: Workspace) -> Surface | None:
    """The surface around the volume, with the condition number there; None around nothing."""
    found = surface_of(workspace)
    if found is None:
        return None
    condition = next(result for result in results_of(workspace) if result.name == "condition_number")
    return Surface(
        "the volume that can be reached",
        tuple(workspace.swept),
        tuple(quantity_of(shown_coordinate(workspace, name)) for name in workspace.swept),
        np.array([values[0] for values in workspace.swept.values()]),
        np.array([values[-1] for values in workspace.swept.values()]),
        found.vertices,
        found.triangles.astype(float),
        10**found.colour,
        condition.title,
        quantity_of(condition.shown),
        "log",
    )
