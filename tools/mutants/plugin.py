"""The pytest plugin of a trial: order of the tests, time limits, results.

The environment variable `MUTANTS_PLAN` has the path of a JSON file: `first` are the tests to run first, `skipped` those
to leave out, `limits` the time limits in s by name, `limit` that of all others, `result` the file to write.
"""

import faulthandler
import json
import os
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

_PLAN: dict[str, Any] = json.loads(Path(os.environ["MUTANTS_PLAN"]).read_text(encoding="utf-8"))
_seconds: dict[str, float] = {}
_setups: list[float] = [0.0]
_passed: list[str] = []
_failed: list[str] = []
_complaints: list[str] = []
_skipped: dict[str, str] = {}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put tests that are likely to detect the mutant first; leave out tests that have run already."""
    done = set(_PLAN["skipped"])
    items[:] = [item for item in items if item.nodeid not in done]
    rank = {name: k for k, name in enumerate(_PLAN["first"])}
    items.sort(key=lambda item: rank.get(item.nodeid, len(rank)))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """End the process if a test takes too long; the watchdog also catches loops in compiled code."""
    faulthandler.dump_traceback_later(_PLAN["limits"].get(item.nodeid, _PLAN["limit"]), exit=True)
    try:
        return (yield)
    finally:
        faulthandler.cancel_dump_traceback_later()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Record time and outcome."""
    _seconds[report.nodeid] = _seconds.get(report.nodeid, 0.0) + report.duration
    if report.when == "setup":
        _setups.append(report.duration)
    if report.when == "call" and report.passed:
        _passed.append(report.nodeid)
    if report.skipped:
        _skipped[report.nodeid] = str(report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr)
    if report.failed:
        _failed.append(report.nodeid)
        _complaints.append(report.longreprtext)


def pytest_sessionfinish() -> None:
    """Write the results."""
    result = {"seconds": _seconds, "longest_setup": max(_setups), "complaints": _complaints}
    result |= {"passed": _passed, "failed": _failed, "skipped": _skipped}
    Path(_PLAN["result"]).write_text(json.dumps(result), encoding="utf-8")
