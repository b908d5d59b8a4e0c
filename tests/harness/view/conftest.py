"""The records, and their pages in a browser, that the browser tests of the run page share."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

import gough_stewart as gs
from tests.support.browser import Watched, open_report
from tests.support.records import waving_record


@pytest.fixture(scope="session")
def platform() -> gs.Platform:
    """A platform with all limits."""
    return gs.load_preset("motion_base")


@pytest.fixture(scope="session")
def record(platform: gs.Platform) -> gs.Record:
    """Half a second; few enough rows that every row is a frame."""
    return waving_record(platform)


@pytest.fixture(scope="session")
def report(record: gs.Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of one record."""
    return gs.view(record, tmp_path_factory.mktemp("view") / "report.html", names=["waves"])


@pytest.fixture(scope="module")
def one(browser: Browser, report: Path) -> Iterator[Watched]:
    """That page at its beginning, not playing; whatever a module's tests do to it must cause no error or request."""
    found = open_report(browser, report, 0.0)
    yield found
    assert found.errors == []
    assert [address for address in found.requests if not address.startswith(report.as_uri())] == []
    found.page.close()


@pytest.fixture(scope="module")
def three(
    browser: Browser, record: gs.Record, platform: gs.Platform, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Page]:
    """Of runs with another clock, size and end; the third is the first, moved by 1 mm along x."""
    other = waving_record(platform, rows=251, size=0.02, step=1.7e-3)
    moved = gs.Record(record.table.with_columns(**{"position[1]": record["position[1]"] + 1e-3}), record.metadata)
    path = tmp_path_factory.mktemp("charts") / "three.html"
    found = open_report(browser, gs.view([record, other, moved], path, names=["long <b>%{x}", "short", "moved"]), 0.0)
    yield found.page
    assert found.errors == []
    found.page.close()


@pytest.fixture
def opened(browser: Browser, tmp_path: Path) -> Iterator[Callable[..., Page]]:
    """Opens the page of records, drawn and standing at its beginning."""
    pages = []

    def open_page(*records: gs.Record) -> Page:
        path = gs.view(records, tmp_path / "page.html", names=[f"run {k}" for k in range(len(records))])
        pages.append(open_report(browser, path, 0.0))
        return pages[-1].page

    yield open_page
    for found in pages:
        assert found.errors == []
        found.page.close()
