"""The page of a live loop in Chromium: it runs offline, shows what the machine says, and does what a hand asks."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

import gough_stewart as gs
from tests.support.axe import violations
from tests.support.browser import Watched, until, watched

SLIDE = """([id, share]) => {
    const slider = document.getElementById(id);
    slider.value = Number(slider.min) + share * (slider.max - slider.min);
    slider.dispatchEvent(new Event("input"));
}"""
HIDE = """hidden => {
    Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
    document.dispatchEvent(new Event("visibilitychange"));
}"""
CONTROLS = "button, input, select, summary, a[href], [tabindex='0']"
NAME = "(control) => control.id || control.getAttribute('aria-label') || control.textContent.trim()"
COLOURED = """(() => {
    const canvas = document.querySelector(".plot-live canvas"), pen = canvas.getContext("2d");
    const { data } = pen.getImageData(0, 0, canvas.width, canvas.height);
    return data.some((value, k) => k % 4 === 2 && data[k + 1] && Math.abs(value - data[k - 2]) > 40);
})()"""
ABOVE = "(id) => document.getElementById(id).getBoundingClientRect().bottom"


@contextmanager
def opened(browser: Browser, file: Path, name: str, size: tuple[int, int], fragment: str = "") -> Iterator[Watched]:
    """The page of an experiment, once it has a picture; it must complain of nothing, and ask for nothing."""
    if not file.exists():
        gs.export(name, {"sensors.quantisation": {}}, forms="page", out=file.parent)[0].rename(file)
    found = watched(browser, *size)
    found.page.goto(file.as_uri() + fragment)
    until(found.page, "GoughStewart.live && GoughStewart.ready.picture")
    yield found
    assert found.errors == []
    assert [url for url in found.requests if not url.startswith(("file:", "blob:"))] == []
    found.page.close()


def put(page: Page, label: str, value: object) -> None:
    """A number in the field with this label."""
    field = f"[aria-label='{label}, as a number']"
    page.fill(field, str(value))
    page.press(field, "Tab")


def shown(page: Page, label: str) -> str:
    """What the field with this label has."""
    return page.input_value(f"[aria-label='{label}, as a number']")


def later(page: Page, seconds: float) -> list[float]:
    """The newest row after some time, by no clock; it pauses."""
    if page.evaluate("GoughStewart.live.playing"):
        page.click("#play")
    step = page.evaluate("GoughStewart.page.live.plantStep")
    row = "rows => GoughStewart.live.some(rows).then(() => GoughStewart.live.last)"
    return list(map(float, page.evaluate(row, round(seconds / step))))


def clock(page: Page) -> float:
    """Time of the newest row [s]."""
    return float(page.evaluate("GoughStewart.live.last?.[0] ?? 0"))


def assert_margins(page: Page, settings: dict[str, Any]) -> None:
    """Expected: phase and delay of all legs as `gs.margins` has them, in the table, to the digits that it shows."""
    theirs = gs.margins("heave_step", {"sensors.quantisation": {}, **settings})
    until(page, f"Math.abs(GoughStewart.tune.margins?.[6] - {theirs.legs[0].phase}) < 1e-4")
    for k, leg in enumerate(theirs.legs, 1):
        cells = page.locator(f"#leg-margins tr:nth-child({k}) td").all_inner_texts()
        assert float(cells[1].removesuffix("°")) == pytest.approx(np.rad2deg(leg.phase), rel=6e-3)
        assert float(cells[2].removesuffix(" ms")) == pytest.approx(1000 * leg.delay, rel=6e-3)


def test_a_loop_is_played_with(browser: Browser, tmp_path: Path) -> None:  # noqa: PLR0915 - a session, in order
    """A session on a screen: it plays, waits, is dragged, tuned, loaded, broken, crashes, and is taken home."""
    file = tmp_path / "heave.html"
    with opened(browser, file, "heave_step", (1440, 900)) as found:
        page = found.page
        # it moves by itself, by the clock; margins are seen without scrolling; nothing is out of reach
        until(page, "GoughStewart.live.last?.[0] > 0.1")
        page.evaluate(HIDE, True)
        page.wait_for_timeout(150)
        stands = clock(page)
        page.wait_for_timeout(250)
        assert clock(page) == stands
        page.evaluate(HIDE, False)
        until(page, f"GoughStewart.live.last[0] > {stands}")
        later(page, 0.1)  # pictures take the time of what follows
        assert_margins(page, {})
        assert page.evaluate(ABOVE, "margins") <= 900
        assert violations(page) == []
        seen = set(
            page.evaluate(
                f'[...document.querySelectorAll("{CONTROLS}")].filter((c) => c.checkVisibility()).map({NAME})'
            )
        )
        page.evaluate("() => { document.activeElement.blur(); scrollTo(0, 0); }")
        reached = set()
        for _ in range(len(seen) + 10):
            page.keyboard.press("Tab")
            reached.add(page.evaluate(f"({NAME})(document.activeElement)"))
        assert len(seen) > 40
        assert seen <= reached

        # a pad, a number and a key move the reference; the platform follows
        page.click("#restart")
        box = page.locator("#pad-1").bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 4)
        page.mouse.up()
        assert page.inner_text("#follows") == "your hand"
        put(page, "x", "NaN")
        assert page.inner_text("#said").startswith("x is 'NaN'; expected a number from")
        put(page, "y", "120")
        page.locator("#view canvas").focus()
        page.keyboard.press("d")
        reach, home = page.evaluate("[GoughStewart.page.live.reach, GoughStewart.page.live.home]")
        last = later(page, 6)
        assert np.subtract(last[1:4], home[:3]) == pytest.approx([reach[0] / 20, 0.12, reach[2] / 2], abs=0.01)

        # settings: what is not possible is said, and undone
        put(page, "bandwidth", 3)
        put(page, "delay", 2)
        assert_margins(page, {"controller.bandwidth": 3, "loop.delay": 2})
        put(page, "bandwidth", 0)
        assert page.inner_text("#tune-said") == "bandwidth is '0'; expected a number above 0 of Hz"
        put(page, "bandwidth", 3)
        put(page, "filter", 0.1)
        until(page, "document.getElementById('tune-said').textContent !== ''")
        assert "faster than half a sample" in page.inner_text("#tune-said")
        assert (shown(page, "filter"), shown(page, "bandwidth")) == ("auto", "3")

        # loads, a push that ends, faults in words; all by keys
        carried = sum(later(page, 1)[13:19])
        page.focus("#payload")
        page.keyboard.press("End")
        page.keyboard.press("Home")
        page.evaluate(SLIDE, ["payload", 0.3])
        assert 1.1 < sum(later(page, 2)[13:19]) / carried < 1.4
        inputs = "GoughStewart.engine.ask('state', 'state').then((state) => state.inputs[6])"
        page.focus("#push-x")
        page.keyboard.down("Enter")
        assert page.evaluate(inputs) > 0
        later(page, 0.1)
        page.keyboard.up("Enter")
        assert page.evaluate(inputs) == 0
        page.click("[aria-label='frozen encoder, leg 5']")
        page.click("[aria-label='failed actuator, leg 3']")
        assert later(page, 0.02)[15] == 0
        assert page.inner_text("#limits") == "the actuator of leg 3 has failed; the encoder of leg 5 is frozen"
        page.click("[aria-label='failed actuator, leg 3']")
        page.click("[aria-label='frozen encoder, leg 5']")

        # a step by key, then the download, which runs
        page.locator("#view canvas").focus()
        page.keyboard.press("t")
        assert "its response follows in 3 s" in page.inner_text("#said")
        later(page, 3.1)
        until(page, "document.getElementById('said').textContent.includes('rise time')")
        with page.expect_download() as download:
            page.click("#download")
        with zipfile.ZipFile(download.value.path()) as archive:
            assert archive.testzip() is None
            archive.extractall(tmp_path / "home")
        theirs, again = gs.read_record(tmp_path / "home"), gs.run(tmp_path / "home" / "experiment.toml")
        assert theirs.table.height > 12000
        assert np.abs(again["position"][: theirs.table.height] - theirs["position"]).max() < 1e-9
        link = page.evaluate("GoughStewart.download.link()")

        # a crash: its cause, and a restart that keeps its rows
        put(page, "force limit", 500)
        later(page, 0.1)
        assert page.inner_text("#limits").startswith("leg 1 at 100 % of its force for 0.1 s")
        page.click("#restart")
        page.select_option("#speed", "fast")
        until(page, "GoughStewart.live.over !== null")
        assert page.inner_text("#limits").startswith("leg 1 below its stroke; leg 2 below")
        assert page.inner_text("#over-text").startswith("At ")
        page.click("#tune-back")
        page.click("#over-restart")
        until(page, "GoughStewart.live.over === null && GoughStewart.live.last?.[0] > 0.1")
        with page.expect_download() as download:
            page.click("#download-crash")
        with zipfile.ZipFile(download.value.path()) as archive:
            assert b'"status": "diverged"' in archive.read("metadata.json")
    with opened(browser, file, "", (900, 600), link[link.index("#") :]) as other:
        page = other.page
        assert (shown(page, "bandwidth"), shown(page, "y")) == ("3", "120")
        assert float(page.input_value("#payload")) > 0
        page.evaluate("history.replaceState(null, '', '#%7Bnot'); GoughStewart.download.restore()")
        assert "cannot be read" in page.inner_text("#download-said")


def test_an_open_loop_on_a_phone_has_its_forces_by_hand(browser: Browser, tmp_path: Path) -> None:
    """Expected: it stands until it is told, with what the file's forces do; these at first, then a field's."""
    with opened(browser, tmp_path / "open.html", "paper_open_loop", (390, 844)) as found:
        page = found.page
        assert page.inner_text("#play") == "▶ play"
        assert clock(page) == 0
        assert "They are ours, not the paper's" in page.inner_text("#behind")
        page.locator(".plot-live canvas").first.scroll_into_view_if_needed()
        until(page, COLOURED)
        assert not any(page.evaluate("[...GoughStewart.records[0].external_force]"))  # nobody pushes
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert later(page, 0.1)[13:19] == [55, 49.5, 55, 49.5, 55, 49.5]
        put(page, "leg 2", "51")
        assert later(page, 0.1)[14] == 51
        assert violations(page) == []
