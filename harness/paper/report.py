"""The reproduction's report: one plain record, written as JSON, as Markdown, and as terminal tables."""

import json
import re
from dataclasses import asdict
from typing import Any

import numpy as np

from gough_stewart.harness.output.tables import Named, Sheet
from gough_stewart.harness.output.versions import versions
from gough_stewart.harness.paper.agreement import Row
from gough_stewart.harness.paper.open_loop import Trajectory
from gough_stewart.harness.paper.readings import Reading
from gough_stewart.model.formulations.cases import OpenLoopCase
from gough_stewart.model.formulations.kane_simulation import KaneTrajectory
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
        "show the same numbers in the layout of the paper's figures; `report.json` has this page as data. The `.fmu` "
        "files are the plant for other simulators, built for this machine with the platform of this case.",
    ]
    return ("\n\n".join(parts) + "\n").encode()


def agreement_sheet(report: dict[str, Any]) -> Sheet:
    """The comparisons, for the terminal and for a page."""
    sheet = Sheet("Agreement of the formulations", ("comparison", "measured", "bound", ""))
    for r in report["agreement"]:
        sheet.add(Named(r["what"], r["unit"]), f"{r['measured']:.1e}", f"{r['bound']:.0e}", _verdict(r["holds"]))
    return sheet


def report_sheets(report: dict[str, Any]) -> list[Sheet]:
    """The tables, for the terminal."""
    case, result = report["case"], report["result"]
    motion = Sheet(_capital(case["title"]), ("", "start", f"after {case['duration']:.4g} s"))
    for name, unit in _STATE_UNITS.items():
        ends = (_numbers(part[name], 5) for part in (case["start"], result["end"]))
        motion.add(Named(name, unit), *ends)
    drift = Sheet("Drift of Kane's DAE without and with Baumgarte", ("run", "closure gap m", "slip m/s, rad/s"))
    for label, d in report["drift"].items():
        drift.add(label, f"{d['closure_gap_end']:.1e}", f"{d['slip_end']:.1e}")
    sheets = [motion, agreement_sheet(report), drift]
    if report["readings"]:
        title = "What the scan leaves open, and the effect of another reading after 1 s"
        readings = Sheet(title, ("decided", "other reading", "position m", "angles rad"))
        for r in report["readings"]:
            changes = (_change(r[f"{name}_change"]) for name in ("position", "orientation"))
            readings.add(Named(f"{r['point']}:", r["decided"]), r["other"], *changes)
        sheets.append(readings)
    return sheets


# Characters that CommonMark treats as markup within a line.
_MARKED = re.compile(r"[\\`*_{}\[\]<>#|~&$]")
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
