"""The reproduction's report: one plain record, written as JSON, as Markdown, and as terminal tables."""

import json
import re
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from gough_stewart.harness.paper.agreement import Row
from gough_stewart.harness.paper.open_loop import Trajectory
from gough_stewart.harness.paper.readings import Reading
from gough_stewart.harness.report.document import Note, Number, Report, Section, Verdict
from gough_stewart.harness.report.quantities import ANGLE, ANGULAR_VELOCITY, NUMBER, POSITION, VELOCITY, Quantity
from gough_stewart.harness.report.table import Column, Table, Value
from gough_stewart.harness.report.versions import versions
from gough_stewart.harness.report.words import sentence
from gough_stewart.harness.results.record import Record, platform_of
from gough_stewart.harness.results.run_charts import run_charts, scenes, shown
from gough_stewart.model.formulations.cases import OpenLoopCase
from gough_stewart.model.formulations.kane import KaneTrajectory
from gough_stewart.model.kinematics import conditioning
from gough_stewart.model.state import State


def record(
    case: OpenLoopCase,
    run: Trajectory,
    agreement: list[Row],
    readings: list[Reading],
    weight: dict[str, float] | None,
    drift: dict[str, KaneTrajectory],
) -> dict[str, Any]:
    """The content of the report as plain types. `readings` and `weight` are for the paper's own platform only."""
    first, last = (State.from_vector(run.states[k]) for k in (0, -1))
    states = State.from_vector(run.states)
    return {
        "case": {
            "title": case.title,
            "platform": case.platform.name,
            "source": case.platform.source,
            "duration": case.duration,
            "actuator_force": case.actuator_force.tolist(),
            "start": {name: value.tolist() for name, value in first._asdict().items()},
        },
        "result": {
            "end": {name: value.tolist() for name, value in last._asdict().items()},
            "leg_length_end": run["leg_length"][-1].tolist(),
            "largest_condition_number": float(
                conditioning(case.platform, states.position, states.orientation).condition_number.max()
            ),
            "friction_work": float(run.friction_work[-1]),
            "actuator_work": float((run["leg_length"][-1] - run["leg_length"][0]) @ case.actuator_force),
        },
        "agreement": [{**asdict(row), "holds": row.holds} for row in agreement],
        "drift": {
            label: {
                "steps": len(kane.time) - 1,
                "closure_gap_end": float(kane.position_violation[-1]),
                "slip_end": float(kane.velocity_violation[-1]),
            }
            for label, kane in drift.items()
        },
        "readings": [asdict(reading) for reading in readings],
        "published_forces": weight,
        "versions": versions(),
    }


def to_json(report: dict[str, Any]) -> bytes:
    """Indented JSON."""
    return (json.dumps(report, indent=2, ensure_ascii=False) + "\n").encode()


def to_markdown(report: dict[str, Any]) -> bytes:
    """The report as a Markdown page."""
    case, result = report["case"], report["result"]
    parts = [
        f"# {_escaped(_capital(case['title']))}",
        f"Platform {_escaped(case['platform'])} ({_escaped(case['source'])}).",
        f"Constant actuator forces {_numbers(case['actuator_force'], 6)} N over {case['duration']:.6g} s.",
        _markdown_table(
            ["", "start", "end"],
            [
                [f"{name} [{unit}]", _numbers(case["start"][name]), _numbers(result["end"][name])]
                for name, unit in _STATE_UNITS.items()
            ],
        ),
        f"Leg lengths at the end: {_numbers(result['leg_length_end'])} m. Largest condition number of the leg "
        f"Jacobian: {result['largest_condition_number']:.3g}. Work of the actuators: "
        f"{result['actuator_work']:.6g} J, lost in friction: {result['friction_work']:.6g} J.",
        "## Agreement of the formulations",
        "Formulations that share only parameters and vector algebra: task space (traced kernel and NumPy), "
        "Kane's equations as in the paper, Newton–Euler from free bodies. The paper: “This example has been verified "
        "by the Newton–Euler approach.”",
        _markdown_table(
            ["comparison", "measured", "bound", "unit", ""],
            [
                [r["what"], f"{r['measured']:.2e}", f"{r['bound']:.0e}", r["unit"], _verdict(r["holds"])]
                for r in report["agreement"]
            ],
        ),
        "## Drift of the constraints",
        "Kane's DAE at the integrator's own steps, with and without Baumgarte's terms (`drift.png`). Absolute "
        "tolerances equal the relative ones; 1e-3 is ode45's default.",
        _markdown_table(
            ["run", "steps", "closure gap at the end [m]", "slip at the end [m/s, rad/s]"],
            [
                [label, d["steps"], f"{d['closure_gap_end']:.2e}", f"{d['slip_end']:.2e}"]
                for label, d in report["drift"].items()
            ],
        ),
        *_markdown_readings(report),
        "## Versions",
        ", ".join(f"{name} {number}" for name, number in report["versions"].items()),
        "## Files",
        "`open_loop.csv` has `time` and every output and local of the interface; `figure-4.png` to `figure-7.png` "
        "show the same numbers in the layout of the paper's figures; `comparison.json` has the numbers of this page. "
        "The `.fmu` files are the plant for other simulators, built for this machine with the platform of this case.",
    ]
    return ("\n\n".join(parts) + "\n").encode()


def _agreement_table(report: dict[str, Any]) -> Table:
    """The comparisons with their bounds."""
    two = replace(NUMBER, digits=2)
    columns = (Column("comparison"), Column("measured", two), Column("bound", two), Column("unit"), Column(""))
    rows = tuple((r["what"], r["measured"], r["bound"], r["unit"], _verdict(r["holds"])) for r in report["agreement"])
    return Table("Agreement of the formulations", columns, rows)


def _motion_table(case: dict[str, Any], result: dict[str, Any]) -> Table:
    """The state at the start and at the end, component by component."""
    rows = tuple(
        (component, Value(start, quantity), Value(end, quantity))
        for name, (components, quantity) in _STATE.items()
        for component, start, end in zip(components, case["start"][name], result["end"][name], strict=True)
    )
    heads = (Column(""), Column("start"), Column(f"after {case['duration']:.4g} s"))
    return Table(_capital(case["title"]), heads, rows, group_ends=(2, 5, 8))


def _drift_table(drift: dict[str, Any]) -> Table:
    two = replace(NUMBER, digits=2)
    columns = (Column("run"), Column("closure gap [m]", two), Column("slip [m/s, rad/s]", two))
    rows = tuple((label, each["closure_gap_end"], each["slip_end"]) for label, each in drift.items())
    return Table("Drift of Kane's DAE without and with Baumgarte", columns, rows)


def report_of_case(content: dict[str, Any], record: Record | None = None) -> Report:
    """What the reproduction found: whether the formulations agree, what the published forces do, what that means.

    With a `record` of the case also its signals over time and the platform in motion.
    """
    case, result = content["case"], content["result"]
    tables = [_motion_table(case, result), _agreement_table(content), _drift_table(content["drift"])]
    if content["readings"]:
        tables.append(_readings_table(content["readings"]))
    sections = [Section("The case", tuple(tables))]
    if record is not None and (drawn := shown(record, platform_of(record), "case")) is not None:
        first, others = run_charts([drawn])
        sections = [Section("Motion", tuple(scenes([drawn]))), *sections, first, others]
    notes = [Note(weight_sentence(content["published_forces"])), Note(_advice(content))] if content["readings"] else []
    start, end = (case["start"]["position"][2], result["end"]["position"][2])
    numbers = [
        Number("case.height.start", "height at the start", start, POSITION),
        Number("case.height.end", "height at the end", end, POSITION),
        Number("case.leg_length.end", "longest leg at the end", max(result["leg_length_end"]), POSITION),
        *_agreements(content),
    ]
    verdict = verdict_of_case(content)
    return Report(
        _capital(case["title"]),
        verdict,
        tuple(sections),
        study="reproduce",
        lead=f"platform {case['platform']}, constant forces for {case['duration']:.6g} s",
        numbers=tuple(numbers),
        notes=tuple(notes),
    )


def _advice(content: dict[str, Any]) -> str:
    """What follows for a reader of the paper."""
    longest = max(content["result"]["leg_length_end"])
    return (
        "For a reader of the paper: its example checks equations, and its figures 4 to 7 serve for that. It is no "
        f"motion about a pose at rest, and hardly one of a machine: the longest leg ends at {longest:.3g} m."
    )


def verdict_of_case(content: dict[str, Any]) -> Verdict:
    """Whether all agree, and how far the platform rises under the published forces, in which readings of the scan."""
    case, result, rows = content["case"], content["result"], content["agreement"]
    held = sum(row["holds"] for row in rows)
    start, end = case["start"]["position"][2], result["end"]["position"][2]
    agree = f"{'all' if held == len(rows) else held} {'' if held == len(rows) else f'of {len(rows)} '}comparisons"
    agree = f"{agree} of the formulations and FMUs are within their bounds"
    moves = "rises" if end > start else "sinks"
    forces = "the published forces" if content["readings"] else "the constant forces of the case"
    text = f"under {forces} the platform {moves} from {start:.4g} m to {end:.3g} m in {case['duration']:.3g} s"
    heights = [each["height"] for each in content["readings"] if each["height"] is not None]
    if heights:
        others = [height > start for height in heights]
        every = "every reading" if all(others) else f"{sum(others)} of {len(others)} readings"
        text += f", in {every} of the scan that is possible ({min(heights):.3g} to {max(heights):.3g} m)"
    weight = content["published_forces"]
    static = None
    if weight is not None:
        most, least = max(case["actuator_force"]), min(case["actuator_force"])
        static = f"they are {least:.3g} and {most:.3g} N where {weight['static_leg_force']:.3g} N would hold it"
    numbers = (
        Number("case.height.start", "height at the start", start, POSITION),
        Number("case.height.end", "height at the end", end, POSITION, *_ends(heights)),
    )
    return Verdict(sentence([text, static, agree]), "good" if held == len(rows) else "bad", numbers)


def _ends(values: list[float]) -> tuple[float | None, float | None]:
    return min(values, default=None), max(values, default=None)


def _agreements(content: dict[str, Any]) -> list[Number]:
    """Each comparison with its bound."""
    return [
        Number(
            f"agreement.{k}", row["what"], row["measured"], limit=row["bound"], margin=row["bound"] - row["measured"]
        )
        for k, row in enumerate(content["agreement"], 1)
    ]


def _readings_table(readings: list[dict[str, Any]]) -> Table:
    angle, length = replace(ANGLE, digits=3), Quantity("m", "m", digits=3)
    columns = (
        Column("decided"),
        Column("other reading"),
        Column("height at the end", POSITION),
        Column("position changes by", length),
        Column("angles change by", angle),
    )
    rows = tuple(
        (f"{r['point']}: {r['decided']}", r["other"], r["height"], r["position_change"], r["orientation_change"])
        for r in readings
    )
    return Table("What the scan leaves open, and the effect of another reading after 1 s", columns, rows)


# Characters that CommonMark treats as markup within a line.
_MARKED = re.compile(r"[\\`*_{}\[\]<>#|~&$]")
_XYZ = ("x", "y", "z")
_STATE: dict[str, tuple[tuple[str, ...], Quantity]] = {
    "position": (_XYZ, POSITION),
    "orientation": (("roll", "pitch", "yaw"), ANGLE),
    "velocity": (tuple(f"velocity, {axis}" for axis in _XYZ), VELOCITY),
    "angular_velocity": (tuple(f"angular velocity, {axis}" for axis in _XYZ), ANGULAR_VELOCITY),
}
_STATE_UNITS = {"position": "m", "orientation": "rad", "velocity": "m/s", "angular_velocity": "rad/s"}


def _markdown_readings(report: dict[str, Any]) -> list[str]:
    if not report["readings"]:
        return []
    rows = [
        [
            r["point"],
            r["decided"],
            r["other"],
            _change(r["position_change"]),
            _change(r["orientation_change"]),
            r["remark"],
        ]
        for r in report["readings"]
    ]
    return [
        "## What the scan of the paper leaves open",
        "Largest change of a component of the final pose if one point is read otherwise (the whole case run again):",
        _markdown_table(["point", "decided", "other reading", "position [m]", "angles [rad]", "remark"], rows),
        weight_sentence(report["published_forces"]),
    ]


def weight_sentence(weight: dict[str, float]) -> str:
    """Why the platform rises under the published forces."""
    return (
        "The published forces are far from equilibrium. At zero yaw each actuator holds "
        f"{weight['static_leg_force']:.2f} N (the base joints carry most of the lower parts), while the even legs' "
        f"49.5 N is the axial share of the weight of all bodies, {weight['share_of_total_weight']:.2f} N. So the "
        "platform rises throughout the second, under every reading above."
    )


def _markdown_table(head: list[str], rows: list[list[Any]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def _escaped(text: str) -> str:
    """A user's text with Markdown, HTML and line ends escaped."""
    return _MARKED.sub(r"\\\g<0>", " ".join(text.split()))


def _numbers(values: list[float], digits: int = 9) -> str:
    return "(" + ", ".join(f"{value:.{digits}g}" for value in np.asarray(values) + 0.0) + ")"


def _change(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _verdict(holds: bool) -> str:
    return "ok" if holds else "MISSED"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
