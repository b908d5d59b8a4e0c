"""What was set of an experiment's file stands beside the title of every study, in every renderer."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.report.chart import Axis, Chart, Series
from gough_stewart.harness.report.document import Report, Section, Setting, Verdict, settings_of
from gough_stewart.harness.report.figures import figures
from gough_stewart.harness.report.page import page_of
from gough_stewart.harness.report.quantities import LENGTH
from gough_stewart.harness.report.terminal import text_of

GIVEN: dict[str, Any] = {"controller.bandwidth": "3.5 Hz", "loop.delay": 2}
# As in the shipped file: 2 Hz, one sample.
EXPECTED = {"controller.bandwidth": (("3.5 Hz",), "2 Hz"), "loop.delay": (("2",), "1")}


def _ensemble() -> Report:
    few = {**GIVEN, "loop.duration": 0.05, "ensemble.worst": 0}
    found = gs.ensemble("heave_tolerances", few, members=3, workers=1)
    return found.report(charts=False)


STUDIES: dict[str, Callable[[], Report]] = {
    "margins": lambda: gs.margins("heave_step", GIVEN).report(charts=False),
    "check": lambda: gs.check("heave_step", GIVEN).report(charts=False),
    "run": lambda: gs.run("heave_step", {**GIVEN, "loop.duration": 0.05}).report(charts=False),
    "ensemble": _ensemble,
}


@pytest.mark.parametrize("study", STUDIES)
def test_every_study_names_what_was_set_and_what_the_file_has(study: str) -> None:
    found = {each.key: (each.values, each.default) for each in STUDIES[study]().settings}
    assert {key: found[key] for key in EXPECTED} == EXPECTED


def test_a_key_set_to_what_the_file_has_is_not_told() -> None:
    # the shipped file has a delay of one sample and a bandwidth of 2 Hz
    report = gs.margins("heave_step", {"loop.delay": 1, "controller.bandwidth": "2.5 Hz"}).report(charts=False)
    assert [each.key for each in report.settings] == ["controller.bandwidth"]


def test_settings_stand_beside_the_title() -> None:
    chart = Chart("x", Axis("t", values=np.arange(3.0)), (Series("x", LENGTH, np.arange(3.0)),))
    changed: dict[str, dict[str, Any]] = {
        "loop.delay": {"value": 2, "file": 1},
        "sensors.noise": {"value": {"a": 0.25}, "file": None},
    }
    report = Report("heave", Verdict("v", "told"), (Section("s", (chart,)),), settings=settings_of(changed))
    assert text_of(report).splitlines()[1:3] == ["heave", "set: loop.delay = 2 (file: 1), sensors.noise = a 0.25"]
    assert '<p class="lead">set: loop.delay = 2 (file: 1), sensors.noise = a 0.25</p>' in page_of(report).decode()
    assert b"heave (loop.delay = 2, sensors.noise = a 0.25)" in figures(report, ("svg",))["x.svg"]
    several = Report("heave", report.verdict, settings=(Setting("loop.delay", ("2", "3")),), runs=("a", "b"))
    assert several.changed == ""
    assert "What differs between the runs" in page_of(several).decode()
