"""One page of every kind that the harness makes, of small data."""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import gough_stewart as gs
from tests.harness.identify.machine_logs import Course, machine_log
from tests.support.commands import invoke
from tests.support.records import log_file, waving_record

_FEW = "--members 60 --workers 1 --set loop.duration=0.1 --set ensemble.worst=1"


def _of_command(words: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        done = invoke(*words.format(folder=folder).split(), "--report", "--out", f"{folder}/out")
        assert done.exit_code in (0, 3), done.output
        return Path(folder, "out", "report.html").read_bytes()


def _identification() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        log = log_file(machine_log(course=Course(duration=8.0)), f"{folder}/log.csv")
        names = "platform_mass,platform_com,leg_viscous_friction,leg_coulomb_friction"
        return _of_command(f"identify {log} --preset motion_base --estimate {names}")


def page_of_records(records: list[gs.Record], names: list[str]) -> bytes:
    """The page of `gs.view`."""
    with tempfile.TemporaryDirectory() as folder:
        return gs.view(records, f"{folder}/page.html", names=names).read_bytes()


def _runs(number: int) -> bytes:
    platform = gs.load_preset("motion_base")
    records = [waving_record(platform, rows=201, size=0.01 + 0.015 * k) for k in range(number)]
    return page_of_records(records, [f"run {k}" for k in range(1, number + 1)])


PAGES: Mapping[str, Callable[[], bytes]] = {
    "one run": lambda: _runs(1),
    "three runs": lambda: _runs(3),
    "ensemble": lambda: _of_command(f"ensemble heave_tolerances {_FEW}"),
    "identification": _identification,
    "workspace": lambda: _of_command("workspace --preset desktop_hexapod --over x,z --points 15"),
    "volume": lambda: _of_command("workspace --preset desktop_hexapod --over x,y,z --points 9"),
    "build": lambda: _of_command("build --preset motion_base"),
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
