"""Fixtures of the tests that look at pages in a browser."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from tests.support.browser import CHROMIUM, chromium


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium, if there is one; started once."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here; `make evidence` insists on it")
    with chromium() as started:
        yield started
