"""One page of every kind that the harness makes, of small data."""

from collections.abc import Callable, Mapping

import numpy as np

from gough_stewart import identify, load_preset, sweep
from gough_stewart.harness.identify.report import estimate_report
from gough_stewart.harness.plants.unit_report import unit_report
from gough_stewart.harness.report.page import page_of
from gough_stewart.harness.view.view import view_page
from gough_stewart.harness.workspace.workspace_report import workspace_report
from tests.support.ensembles import ensemble_of
from tests.support.machine_logs import NOMINAL, Course, machine_log
from tests.support.records import waving_record

_UNITS = ("gough_stewart_fmi2.fmu", "gough_stewart_fmi3.fmu")


def _ensemble() -> bytes:
    outcome, cause = ["completed"] * 300, list[str | None]([None] * 300)
    outcome[17], cause[17] = "diverged", "the platform is 1.2 m from its reference; the bound is 0.05 m"
    members = ensemble_of(np.random.default_rng(2).normal(size=(300, 4)), outcome, cause)
    pages = {17: "worst/member-17/report.html", 5: ""}
    return page_of(members.report(worst=pages))


def _identification() -> bytes:
    names = ["platform_mass", "platform_com", "leg_viscous_friction", "leg_coulomb_friction"]
    return page_of(estimate_report(identify(machine_log(course=Course(duration=8.0)), NOMINAL, names), NOMINAL.name))


def _runs(number: int) -> bytes:
    platform = load_preset("motion_base")
    records = [waving_record(platform, rows=201, size=0.01 + 0.015 * k) for k in range(number)]
    return view_page(records, [f"run {k}" for k in range(1, number + 1)])


def _workspace(*over: str) -> bytes:
    points = 15 if len(over) == 2 else 9
    return page_of(workspace_report(sweep(load_preset("desktop_hexapod"), dict.fromkeys(over), points=points)))


PAGES: Mapping[str, Callable[[], bytes]] = {
    "one run": lambda: _runs(1),
    "three runs": lambda: _runs(3),
    "ensemble": _ensemble,
    "identification": _identification,
    "workspace": lambda: _workspace("x", "z"),
    "volume": lambda: _workspace("x", "y", "z"),
    "build": lambda: page_of(unit_report(load_preset("motion_base"), ["2.0", "3.0"], ["native"], _UNITS, None)),
}
# What is true when a page has drawn everything.
DRAWN: Mapping[str, str] = {
    "one run": "GoughStewart.ready.picture && GoughStewart.ready.curves",
    "three runs": "GoughStewart.ready.picture && GoughStewart.ready.curves",
    "ensemble": "GoughStewart.ready.all === true",
    "identification": "GoughStewart.ready.all === true",
    "workspace": "GoughStewart.ready.all === true",
    "volume": "GoughStewart.ready.all === true && GoughStewart.surface !== undefined",
    "build": "GoughStewart.ready.picture",
}
