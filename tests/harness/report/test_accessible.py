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


def written(folder: Path, kind: str) -> Path:
    """The page of this kind, made once."""
    path = folder / f"{kind.replace(' ', '-')}.html"
    if not path.exists():
        path.write_bytes(PAGES[kind]())
    return path


@pytest.fixture
def opened(browser: Browser, folder: Path) -> Callable[..., Watched]:
    """A page of this kind, drawn; made once for all tests."""

    def open_page(kind: str, scheme: str = "light", width: int = 1000) -> Watched:
        found = watched(browser, width, 800)
        found.page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
        found.page.goto(written(folder, kind).as_uri() + "#t=0.1")
        until(found.page, DRAWN[kind])
        return found

    return open_page


# Each kind once; together they cover both themes at both widths. The evidence has every kind in all of them.
LOOKS = {
    "one run": ("dark", 1440),
    "three runs": ("light", 390),
    "ensemble": ("light", 1440),
    "identification": ("dark", 390),
    "workspace": ("dark", 1440),
    "volume": ("light", 390),
    "build": ("light", 390),
}


@pytest.mark.parametrize("kind", PAGES)
def test_axe_finds_nothing(opened: Open, kind: str) -> None:
    """Expected: no rule of axe is broken, and the scripts complain of nothing; headings go down one level at a time."""
    seen = opened(kind, *LOOKS[kind])
    assert violations(seen.page) == []
    assert seen.page.evaluate("[document.documentElement.lang, scrollX, document.documentElement.scrollWidth]") == [
        *("en", 0), LOOKS[kind][1],
    ]  # fmt: skip
    levels = seen.page.eval_on_selector_all("h1, h2, h3", "all => all.map((each) => Number(each.tagName[1]))")
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    assert seen.errors == []
    seen.page.close()


@pytest.mark.evidence
@pytest.mark.parametrize("kind", PAGES)
def test_axe_finds_nothing_in_any_theme_at_any_width(opened: Open, kind: str) -> None:
    """Expected: no rule of axe is broken, closed parts opened, at three widths, in light, dark and high contrast."""
    for scheme in ("light", "dark"):
        seen = opened(kind, scheme)
        seen.page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
        chosen = seen.page.locator("#theme").count()
        for width, theme in ((390, ""), (1000, "contrast" if chosen and scheme == "light" else ""), (1440, "")):
            seen.page.set_viewport_size({"width": width, "height": 800})
            if chosen:
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


def test_a_swipe_over_a_chart_scrolls_the_page_of_a_phone(browser: Browser, folder: Path) -> None:
    """Expected: 200 pixels up are some scrolling, nothing lies beyond 390 pixels, and paper is white in the dark."""
    context = browser.new_context(
        viewport={"width": 390, "height": 800}, has_touch=True, is_mobile=True, color_scheme="dark"
    )
    page = context.new_page()
    page.goto(written(folder, "ensemble").as_uri() + "#t=0.1")
    until(page, DRAWN["ensemble"])
    # tables that would be wider are cards, with the head of each value beside it
    tables = "[...document.querySelectorAll('.table .sideways')].filter((each) => each.checkVisibility())"
    assert page.evaluate(f"{tables}.length && {tables}.every((each) => each.scrollWidth <= each.clientWidth)")
    cells = "((row) => [...row.cells].slice(1).map((cell) => cell.dataset.head || cell.textContent))"
    heads, values = (
        page.evaluate(f"[...document.querySelectorAll('.stacked')].map((table) => {cells}(table.{part}.rows[0]))")
        for part in ("tHead", "tBodies[0]")
    )
    assert heads == values != []
    page.locator(".plot").first.scroll_into_view_if_needed()
    before, box = page.evaluate("scrollY"), page.locator(".plot").first.bounding_box()
    assert box is not None
    session, x, y = context.new_cdp_session(page), box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for k in range(11):
        points = [{"x": x, "y": y - 20 * k}]
        session.send("Input.dispatchTouchEvent", {"type": "touchMove" if k else "touchStart", "touchPoints": points})
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    until(page, f"scrollY > {before + 50}", 5)
    assert page.evaluate("GoughStewart.theme().dark")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert not page.evaluate("GoughStewart.theme().dark")
    page.emulate_media(media="print", color_scheme="dark")
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert ground in ("rgb(255, 255, 255)", "rgba(0, 0, 0, 0)")
    context.close()
