"""The pytest plugin of the mutants: tells coverage which test runs; selects and orders tests, limits their time.

Loaded by name from its own folder, since the copy that is tested has a folder `tools` of its own. `MUTANTS_RESULT` is
the file of the outcome, `MUTANTS_PLAN` that of the tests to run, in their order, with their time limits in s.
"""

import faulthandler
import json
import os
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from coverage import Coverage

_RESULT = Path(os.environ["MUTANTS_RESULT"])
_LIMITS: dict[str, float] = json.loads(Path(os.environ["MUTANTS_PLAN"]).read_text("utf-8"))
_outcome: dict[str, Any] = {"seconds": {}, "fixtures": {}, "failed": "", "complaint": ""}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the planned tests, in their order; all without a plan."""
    if _LIMITS:
        rank = {name: k for k, name in enumerate(_LIMITS)}
        items[:] = sorted((item for item in items if item.nodeid in rank), key=lambda item: rank[item.nodeid])


def _name(name: str) -> str:
    """Tell coverage what runs, here and in processes that are started; returns what ran before."""
    before = os.environ.get("MUTANTS_TEST", "")
    os.environ["MUTANTS_TEST"] = name
    measured = Coverage.current()
    if measured is not None:
        measured.switch_context(name)
    return before


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[Any]) -> Generator[None, object, object]:
    """Name a fixture that several tests share by itself."""
    if fixturedef.scope == "function":
        return (yield)
    before = _name(f"{fixturedef.baseid}@{fixturedef.argname}")
    try:
        return (yield)
    finally:
        _name(before)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Name the test; end the process if it takes too long."""
    _name(item.nodeid)
    item.user_properties.append(("fixtures", getattr(item, "fixturenames", [])))
    if item.nodeid in _LIMITS:
        # what ends the process, by the clock or a crash, is a failure of this test
        _RESULT.write_text(json.dumps({**_outcome, "failed": item.nodeid, "complaint": "ended the process"}), "utf-8")
        faulthandler.dump_traceback_later(_LIMITS[item.nodeid], exit=True)
    try:
        return (yield)
    finally:
        faulthandler.cancel_dump_traceback_later()


def pytest_exception_interact(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Record a test that fails, or a module that cannot be imported."""
    _outcome.update(failed=report.nodeid, complaint=report.longreprtext)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Record time and fixtures, also of tests in workers."""
    seconds = _outcome["seconds"]
    seconds[report.nodeid] = round(seconds.get(report.nodeid, 0.0) + report.duration, 3)
    _outcome["fixtures"][report.nodeid] = dict(report.user_properties).get("fixtures", [])


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the outcome."""
    if not hasattr(session.config, "workerinput"):
        _RESULT.write_text(json.dumps(_outcome), "utf-8")
