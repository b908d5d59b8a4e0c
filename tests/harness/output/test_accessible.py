"""Every page for every reader: axe finds nothing, a phone need not scroll sideways, and a swipe scrolls the page."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.support.axe import violations
from tests.support.browser import Watched, until, watched
from tests.support.pages import DRAWN, PAGES

Open = Callable[..., Watched]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pages")


@pytest.fixture
def opened(browser: Browser, folder: Path) -> Callable[..., Watched]:
    """A page of this kind, drawn; made once for all tests."""

    def open_page(kind: str, scheme: str = "light", width: int = 1000) -> Watched:
        path = folder / f"{kind.replace(' ', '-')}.html"
        if not path.exists():
            path.write_bytes(PAGES[kind]())
        found = watched(browser, width, 800)
        found.page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
        found.page.goto(path.as_uri() + "#t=0.1")
        until(found.page, DRAWN[kind])
        return found

    return open_page


@pytest.mark.parametrize("kind", PAGES)
def test_axe_finds_nothing_in_the_light_and_in_the_dark(opened: Open, kind: str) -> None:
    """Expected: no rule of axe is broken, and the scripts complain of nothing; headings go down one level at a time."""
    for scheme in ("light", "dark"):
        seen = opened(kind, scheme)
        assert violations(seen.page) == [], scheme
        assert seen.page.evaluate("document.documentElement.lang") == "en"
        levels = seen.page.eval_on_selector_all("h1, h2, h3", "all => all.map((each) => Number(each.tagName[1]))")
        assert levels[0] == 1
        assert all(after <= before + 1 for before, after in pairwise(levels))
        assert seen.errors == []
        seen.page.close()


def test_axe_sees_what_is_wrong(browser: Browser) -> None:
    """Expected: a picture without a text, and grey letters on grey."""
    seen = watched(browser)
    seen.page.set_content("<main><h1 style='color:#777;background:#888'>grey words</h1><img src='data:,'></main>")
    found = " ".join(violations(seen.page))
    assert "image-alt" in found
    assert "color-contrast" in found
    seen.page.close()
