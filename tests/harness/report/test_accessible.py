"""Every page for every reader: axe finds nothing, a phone need not scroll sideways."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.support.axe import violations
from tests.support.browser import WITHOUT_WEBGL, Watched, until, watched
from tests.support.pages import DRAWN, PAGES

Open = Callable[..., Watched]


@pytest.fixture(scope="module")
def opened(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Open:
    """A page of this kind, drawn; made once for all tests."""
    folder = tmp_path_factory.mktemp("pages")

    def open_page(kind: str, scheme: str = "light", width: int = 1000) -> Watched:
        path: Path = folder / f"{kind.replace(' ', '-')}.html"
        if not path.exists():
            path.write_bytes(PAGES[kind]())
        found = watched(browser, width, 800)
        found.page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
        if kind == "three runs":  # the stage is looked at in tests/harness/view
            found.page.add_init_script(WITHOUT_WEBGL)
        found.page.goto(path.as_uri() + "#t=0.1")
        until(found.page, DRAWN[kind])
        return found

    return open_page


# Together they cover both themes at both widths; those outside of ALWAYS are evidence, which has every kind in all.
ALWAYS = ("three runs", "workspace")
LOOKS = {
    "three runs": ("light", 390),
    "ensemble": ("light", 1440),
    "identification": ("dark", 390),
    "workspace": ("dark", 1440),
    "volume": ("light", 390),
    "build": ("light", 390),
}


@pytest.mark.parametrize("kind", [pytest.param(k, marks=() if k in ALWAYS else pytest.mark.evidence) for k in LOOKS])
def test_axe_finds_nothing(opened: Open, kind: str) -> None:
    """Expected: no rule of axe is broken, and the scripts complain of nothing; headings go down one level at a time.

    On a phone, tables that would be wider are cards, with the head of each value beside it.
    """
    scheme, width = LOOKS[kind]
    seen = opened(kind, scheme, width)
    assert violations(seen.page) == []
    page = "[document.documentElement.lang, scrollX, document.documentElement.scrollWidth]"
    assert seen.page.evaluate(page) == ["en", 0, width]
    levels = seen.page.eval_on_selector_all("h1, h2, h3", "all => all.map((each) => Number(each.tagName[1]))")
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    if width == 390:
        tables = "[...document.querySelectorAll('.table .sideways')].filter((each) => each.checkVisibility())"
        assert seen.page.evaluate(f"{tables}.every((each) => each.scrollWidth <= each.clientWidth)")
        cells = "((row) => [...row.cells].slice(1).map((cell) => cell.dataset.head ?? cell.textContent))"
        heads, values = (
            seen.page.evaluate(f"[...document.querySelectorAll('.stacked')].map((t) => {cells}(t.{part}.rows[0]))")
            for part in ("tHead", "tBodies[0]")
        )
        assert heads == values
        assert heads or kind in ("volume", "build")
    assert seen.errors == []
    seen.page.close()


@pytest.mark.evidence
@pytest.mark.parametrize("kind", PAGES)
def test_axe_finds_nothing_in_any_theme_at_any_width(opened: Open, kind: str) -> None:
    """Expected: no rule of axe is broken, closed parts opened, at three widths, in light, dark and high contrast."""
    for scheme in ("light", "dark"):
        seen = opened(kind, scheme)
        seen.page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
        for width, theme in ((390, ""), (1000, "contrast" if scheme == "light" else ""), (1440, "")):
            seen.page.set_viewport_size({"width": width, "height": 800})
            seen.page.select_option("#theme", theme)
            seen.page.wait_for_timeout(50)
            assert violations(seen.page) == [], (scheme, width, theme)
        seen.page.close()


def test_axe_sees_what_is_wrong(browser: Browser) -> None:
    """Expected: a picture without a text, and grey letters on grey."""
    seen = watched(browser)
    seen.page.set_content("<main><h1 style='color:#777;background:#888'>grey words</h1><img src='data:,'></main>")
    found = " ".join(violations(seen.page))
    assert "image-alt" in found
    assert "color-contrast" in found
    seen.page.close()
