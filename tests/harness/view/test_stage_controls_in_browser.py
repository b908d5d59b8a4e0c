"""The 3-D stage in a real browser: keys, fingers, the clock, and what it exports."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser

from gough_stewart.harness.results.record import Record
from gough_stewart.model.vectors import FloatArray
from tests.support.browser import Watched, until
from tests.support.stage import at, drawn, seek, seen, stage


def test_keys_turn_the_view_where_it_has_the_focus_and_step_elsewhere(one: Watched, record: Record) -> None:
    """Expected: 5° to a press in azimuth or height, a tenth of the distance, a move without a turn, and back home."""
    page = one.page
    page.select_option("#from", "corner")
    seek(page, record, 100)

    def view() -> tuple[float, float, float, FloatArray]:
        now = stage(page)
        offset = np.subtract(now["camera"], now["target"])
        distance = float(np.linalg.norm(offset))
        return np.arctan2(offset[1], offset[0]), np.arcsin(offset[2] / distance), distance, np.array(now["target"])

    home = view()
    page.focus("#view canvas")
    for key, azimuth, height, distance in (
        ("ArrowRight", 5, 0, 1), ("ArrowLeft", -5, 0, 1), ("ArrowUp", 0, 5, 1), ("ArrowDown", 0, -5, 1),
        ("+", 0, 0, 0.9), ("-", 0, 0, 1 / 0.9),
    ):  # fmt: skip
        before = view()
        page.keyboard.press(key)
        after = view()
        assert np.degrees(after[0] - before[0]) == pytest.approx(azimuth, abs=1e-6), key
        assert np.degrees(after[1] - before[1]) == pytest.approx(height, abs=1e-6), key
        assert after[2] / before[2] == pytest.approx(distance), key
    page.keyboard.press("Shift+ArrowRight")
    moved = view()
    right = np.array([-np.sin(home[0]), np.cos(home[0]), 0])
    step = moved[3] - home[3]
    assert step @ right == pytest.approx(np.linalg.norm(step))
    assert step @ right > 0
    assert moved[:3] == pytest.approx(home[:3])
    page.keyboard.press("Home")
    assert np.concatenate([view()[3], view()[:3]]) == pytest.approx(np.concatenate([home[3], home[:3]]))
    assert page.evaluate("GoughStewart.player.time") == record["time"][100]
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("GoughStewart.player.time") == record["time"][101]


@pytest.mark.parametrize("keys", [["ArrowDown"], ["Shift+ArrowDown", "ArrowDown"], ["ArrowDown", "-"]])
def test_the_camera_stays_above_the_floor(one: Watched, keys: list[str]) -> None:
    page = one.page
    page.focus("#view canvas")
    for _ in range(30):
        for key in keys:
            page.keyboard.press(key)
    now = stage(page)
    assert now["camera"][2] > now["ground"]
    assert now["target"][2] > now["ground"]
    page.keyboard.press("Home")


def test_the_picture_of_the_moment_is_saved(one: Watched, record: Record) -> None:
    """Expected: a PNG twice as wide as the view, blue where the plate is, with the moment in its name."""
    page = one.page
    seek(page, record, 60)
    with page.expect_download() as download:
        page.click("#picture")
    assert download.value.suggested_filename == "six sines 0.0600 s.png"
    with Image.open(download.value.path()) as picture:
        values = np.asarray(picture.convert("RGB"), dtype=float)
    box = page.locator("#view").bounding_box()
    assert box is not None
    assert values.shape[:2] == pytest.approx((2 * box["height"], 2 * box["width"]), abs=2)
    plate = drawn(page)
    inside = np.array(plate["position"]) + 0.3 * np.subtract(plate["legs"][0]["head"], plate["position"])
    red, _, blue = at(values, 2 * seen(page, inside[None]))[0]
    assert blue > red + 30


def test_a_finger_scrolls_the_page_up_and_down_and_turns_the_view_sideways(browser: Browser, report: Path) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 800}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(report.as_uri() + "#t=0")
    until(page, "GoughStewart.ready.picture")
    page.click(".stage-options > summary")
    assert page.is_visible(".by-touch")
    assert page.is_hidden(".by-mouse")
    page.evaluate("scrollTo(0, 0)")
    box = page.locator("#view").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    fingers = context.new_cdp_session(page)

    def swipe(dx: float, dy: float) -> None:
        fingers.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]})
        for share in np.linspace(0.1, 1, 10):
            point = {"x": x + share * dx, "y": y + share * dy}
            fingers.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [point]})
            page.wait_for_timeout(20)
        fingers.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    home = stage(page)["camera"]
    swipe(120, 0)
    turned = stage(page)["camera"]
    assert np.linalg.norm(np.subtract(turned, home)) > 0.1 * np.linalg.norm(home)
    assert page.evaluate("scrollY") == 0
    swipe(0, -120)
    until(page, "scrollY > 50")
    assert stage(page)["camera"] == pytest.approx(turned)
    context.close()
