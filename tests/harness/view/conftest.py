"""The record, and its page in a browser, that the browser tests of the run page share."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from gough_stewart.harness.results.record import Record
from gough_stewart.harness.view.view import view_page
from gough_stewart.model.platform import Platform, load_preset
from tests.support.browser import Watched, open_report
from tests.support.records import waving_record


@pytest.fixture(scope="session")
def platform() -> Platform:
    """A platform with all limits."""
    return load_preset("motion_base")


@pytest.fixture(scope="session")
def record(platform: Platform) -> Record:
    """Half a second; few enough rows that every row is a frame."""
    return waving_record(platform)


@pytest.fixture(scope="session")
def report(record: Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of one record."""
    path = tmp_path_factory.mktemp("view") / "report.html"
    path.write_bytes(view_page([record], ["waves"]))
    return path


@pytest.fixture(scope="module")
def one(browser: Browser, report: Path) -> Iterator[Watched]:
    """That page at its beginning, not playing; whatever a module's tests do to it must cause no error or request."""
    found = open_report(browser, report, 0.0)
    yield found
    assert found.errors == []
    assert [address for address in found.requests if not address.startswith(report.as_uri())] == []
    found.page.close()
