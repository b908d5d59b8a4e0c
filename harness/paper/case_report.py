"""The report of a reproduction: whether the formulations agree, what the published forces do, and what that means."""

from dataclasses import replace
from typing import Any

from gough_stewart.harness.report.document import Column, Note, Number, Report, Section, Table, Value, Verdict
from gough_stewart.harness.report.quantities import (
    ANGLE,
    ANGULAR_VELOCITY,
    NUMBER,
    POSITION,
    VELOCITY,
    Quantity,
    sentence,
)
from gough_stewart.harness.results.record import Record, platform_of
from gough_stewart.harness.results.run_charts import run_charts, scenes, shown

_TWO_DIGITS = replace(NUMBER, digits=2)
_XYZ = ("x", "y", "z")
_STATE: dict[str, tuple[tuple[str, ...], Quantity]] = {
    "position": (_XYZ, POSITION),
    "orientation": (("roll", "pitch", "yaw"), ANGLE),
    "velocity": (tuple(f"velocity, {axis}" for axis in _XYZ), VELOCITY),
    "angular_velocity": (tuple(f"angular velocity, {axis}" for axis in _XYZ), ANGULAR_VELOCITY),
}


def case_report(content: dict[str, Any], record: Record | None = None) -> Report:
    """The report of the numbers in comparison.json.

    With a `record` of the case also its signals over time and the platform in motion.
    """
    case, result = content["case"], content["result"]
    title, start, end = case["title"][:1].upper() + case["title"][1:], case["start"], result["end"]
    sections = [Section("The case", tuple(_tables(content, title)))]
    if record is not None and (drawn := shown(record, platform_of(record), "case")) is not None:
        first, others = run_charts([drawn])
        sections = [Section("Motion", tuple(scenes([drawn]))), *sections, first, others]
    longest = max(result["leg_length_end"])
    notes = []
    if content["readings"]:
        weight = content["published_forces"]
        notes = [
            "The published forces are far from equilibrium. At zero yaw each actuator holds "
            f"{weight['static_leg_force']:.2f} N (the base joints carry most of the lower parts), while the even legs' "
            f"49.5 N is the axial share of the weight of all bodies, {weight['share_of_total_weight']:.2f} N. So the "
            "platform rises throughout the second, under every reading above.",
            "For a reader of the paper: its example checks equations, and its figures 4 to 7 serve for that. It is no "
            f"motion about a pose at rest, and hardly one of a machine: the longest leg ends at {longest:.3g} m.",
        ]
    bounds = [
        Number(
            f"agreement.{k}", row["what"], row["measured"], limit=row["bound"], margin=row["bound"] - row["measured"]
        )
        for k, row in enumerate(content["agreement"], 1)
    ]
    return Report(
        title,
        _verdict(content),
        tuple(sections),
        study="reproduce",
        lead=f"platform {case['platform']}, constant forces for {case['duration']:.6g} s",
        numbers=(
            Number("case.height.start", "height at the start", start["position"][2], POSITION),
            Number("case.height.end", "height at the end", end["position"][2], POSITION),
            Number("case.leg_length.end", "longest leg at the end", longest, POSITION),
            *bounds,
        ),
        notes=tuple(map(Note, notes)),
    )


def _verdict(content: dict[str, Any]) -> Verdict:
    """Whether all agree, and how far the platform rises under the published forces, in which readings of the scan."""
    case, rows, weight = content["case"], content["agreement"], content["published_forces"]
    held = sum(row["holds"] for row in rows)
    count = "all" if held == len(rows) else f"{held} of {len(rows)}"
    agree = f"{count} comparisons of the formulations and FMUs are within their bounds"
    start, end = case["start"]["position"][2], content["result"]["end"]["position"][2]
    forces = "the published forces" if content["readings"] else "the constant forces of the case"
    moves = f"{'rises' if end > start else 'sinks'} from {start:.4g} m to {end:.3g} m in {case['duration']:.3g} s"
    text = f"under {forces} the platform {moves}"
    heights = [reading["height"] for reading in content["readings"] if reading["height"] is not None]
    if heights:
        higher = sum(height > start for height in heights)
        readings = "every reading" if higher == len(heights) else f"{higher} of {len(heights)} readings"
        text += f", in {readings} of the scan that is possible ({min(heights):.3g} to {max(heights):.3g} m)"
    static = None
    if weight is not None:
        most, least = max(case["actuator_force"]), min(case["actuator_force"])
        static = f"they are {least:.3g} and {most:.3g} N where {weight['static_leg_force']:.3g} N would hold it"
    low, high = min(heights, default=None), max(heights, default=None)
    numbers = (
        Number("case.height.start", "height at the start", start, POSITION),
        Number("case.height.end", "height at the end", end, POSITION, low, high),
    )
    return Verdict(sentence([text, static, agree]), "good" if held == len(rows) else "bad", numbers)


def _tables(content: dict[str, Any], title: str) -> list[Table]:
    """The state at the start and at the end, the comparisons, the drift, and what the scan leaves open."""
    case, end = content["case"], content["result"]["end"]
    states = tuple(
        (component, Value(first, quantity), Value(last, quantity))
        for name, (components, quantity) in _STATE.items()
        for component, first, last in zip(components, case["start"][name], end[name], strict=True)
    )
    heads: tuple[Column, ...] = (Column(""), Column("start"), Column(f"after {case['duration']:.4g} s"))
    tables = [Table(title, heads, states, group_ends=(2, 5, 8))]
    heads = (
        Column("comparison"), Column("measured", _TWO_DIGITS), Column("bound", _TWO_DIGITS), Column("unit"), Column(""),
    )  # fmt: skip
    compared = tuple(
        (row["what"], row["measured"], row["bound"], row["unit"], "ok" if row["holds"] else "MISSED")
        for row in content["agreement"]
    )
    tables.append(Table("Agreement of the formulations", heads, compared))
    heads = (Column("run"), Column("closure gap [m]", _TWO_DIGITS), Column("slip [m/s, rad/s]", _TWO_DIGITS))
    drift = tuple((label, run["closure_gap_end"], run["slip_end"]) for label, run in content["drift"].items())
    tables.append(Table("Drift of Kane's DAE without and with Baumgarte", heads, drift))
    if content["readings"]:
        heads = (
            Column("decided"),
            Column("other reading"),
            Column("height at the end", POSITION),
            Column("position changes by", Quantity("m", "m", digits=3)),
            Column("angles change by", replace(ANGLE, digits=3)),
        )
        readings = tuple(
            (f"{r['point']}: {r['decided']}", r["other"], r["height"], r["position_change"], r["orientation_change"])
            for r in content["readings"]
        )
        tables.append(Table("What the scan leaves open, and the effect of another reading after 1 s", heads, readings))
    return tables
