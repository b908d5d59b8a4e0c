"""The record, and its page, that the browser tests of the run page share."""

from pathlib import Path

import pytest

import gough_stewart as gs
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
