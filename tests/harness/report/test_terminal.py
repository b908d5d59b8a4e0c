"""A report in a terminal: what comes first, what is left to the page, and tables as wide as there is room for."""

import re
from dataclasses import replace
from io import StringIO

from rich.console import Console

from gough_stewart.harness.report.document import Note, Number, Report, Section, Setting, Verdict
from gough_stewart.harness.report.quantities import FORCE, LENGTH
from gough_stewart.harness.report.requirements import with_requirements
from gough_stewart.harness.report.table import Column, Table, Value
from gough_stewart.harness.report.terminal import show, text_of
from tests.harness.report.test_document import whole_report


def _report() -> Report:
    legs = Table(
        "Legs",
        (Column(""), *(Column(str(leg)) for leg in range(1, 7))),
        (
            ("peak error", *(Value(1e-4 * leg, LENGTH) for leg in range(1, 7))),
            ("peak force", *(Value(101.5 * leg, FORCE) for leg in range(1, 7))),
        ),
        group_ends=(0,),
        note="over the whole run",
    )
    shown = Table(
        "Causes", (Column("cause"), Column("peak", LENGTH)), (("a", 1e-3), ("b", -2.5e-3), ("c", 3e-3)), first_shown=2
    )
    hidden = Table("Versions", (Column(""),), (("python",),), detail=True)
    peak = Number("tracking.position.norm_peak", "peak error", 8e-4, LENGTH, 7e-4, 9e-4, limit=1e-3, margin=2e-4)
    force = Number("force.peak", "peak force", 609.0, FORCE, limit=600.0, margin=-9.0)
    return with_requirements(
        Report(
            "heave",
            Verdict("Follows within 0.8 mm; a leg needs 609 N of its 600 N", "bad", (peak, force)),
            (
                Section("Tables", (legs, shown, hidden, Note("A sentence."))),
                Section("More", (Table("Parameters", (Column(""),), (("mass",),)),), detail=True),
            ),
            numbers=(peak, force),
            notes=(Note("of ten runs"), Note("beyond its stroke", "warning")),
        ),
        ["tracking.position.norm_peak <= 1 mm", "force.peak < 0.6 kN", "force.peak >= 0"],
    )


def test_the_verdict_is_the_first_line_then_its_numbers_then_requirements_then_tables() -> None:
    lines = text_of(_report(), 120).splitlines()
    follows = "Follows within 0.8 mm; a leg needs 609 N of its 600 N"
    assert lines[0] == f"Missed: force.peak < 0.6 kN (609 N, 9 N beyond). {follows}"
    assert "set: " not in "\n".join(lines)
    changed = replace(_report(), settings=(Setting("loop.delay", ("2",), "1"), Setting("a.b", ("3 Hz",))))
    assert text_of(changed, 120).splitlines()[2] == "set: loop.delay = 2 (file: 1), a.b = 3 Hz"
    assert [re.sub(r"\s+", " ", line.strip()) for line in lines[1:8]] == [
        "heave",
        "peak error 0.8 mm 0.7 to 0.9 mm, limit 1 mm, 0.2 mm left",
        "peak force 609 N limit 600 N, 9 N beyond",
        "",
        "met tracking.position.norm_peak <= 1 mm 0.8 mm, 0.2 mm left",
        "missed force.peak < 0.6 kN 609 N, 9 N beyond",
        "met force.peak >= 0 609 N, 609 N left",
    ]
    assert lines[9] == "Legs"
    text = "\n".join(lines)
    assert all(each in text for each in ("over the whole run", "… 1 more on the page", "A sentence.", "of ten runs"))
    # what the page shows on demand, and what goes to the error stream
    assert not any(each in text for each in ("Versions", "Parameters", "beyond its stroke"))


def _cells(text: str) -> list[list[str]]:
    rows = [line for line in text.splitlines() if line.startswith(("│", "┃"))]
    return [[cell.strip() for cell in re.split("[│┃]", row)[1:-1]] for row in rows]


def test_a_unit_stands_once_beside_the_name_or_in_the_head() -> None:
    cells = _cells(text_of(_report(), 120))
    assert cells == [
        ["", "1", "2", "3", "4", "5", "6"],
        ["peak error mm", "0.1", "0.2", "0.3", "0.4", "0.5", "0.6"],
        ["peak force N", "101.5", "203", "304.5", "406", "507.5", "609"],
        ["cause", "peak [mm]"],
        ["a", "1"],
        ["b", "-2.5"],
    ]


def test_without_a_terminal_the_verdict_is_one_line_without_colours() -> None:
    report = _report()
    for force in (False, True):
        out = StringIO()
        console = Console(file=out, width=30, force_terminal=force, color_system="standard" if force else None)
        show(report, console)
        first = out.getvalue().splitlines()[0]
        assert first.startswith("\x1b[1;31mMissed: " if force else "Missed: ")
        assert (first == report.verdict.text) is not force
        assert ("\x1b[" in out.getvalue()) is force


def test_every_part_of_a_report_can_be_printed() -> None:
    assert text_of(whole_report()).startswith("Follows within 0.8 mm\n")
