"""The charts of a page in a real browser: what is drawn, chosen, compared, touched, printed and read aloud."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from gough_stewart.harness.results.record import Record
from gough_stewart.harness.view.page import view_page
from gough_stewart.model.platform import Platform
from tests.support.browser import Watched, open_report, until
from tests.support.records import waving_record

# Names, colours, dashes and values of the curves of a panel, as plotly.js has them.
CURVES = """name => [...document.querySelector(`[data-signal="${name}"] .plot`).data].map(
  ({ name, line, x, y }) => ({ name, ...line, x: [...x], y: [...y] }))"""
PANELS = "() => [...document.querySelectorAll('.panel')].map(panel => panel.dataset.signal)"
# Whether pictures are as wide as their places.
FITS = """[...document.querySelectorAll('.plot')].every(plot => Math.abs(
  plot.getBoundingClientRect().width - plot.querySelector('.main-svg').getBoundingClientRect().width) < 1)"""
DRAWN = "path => path.getAttribute('d').split('L').length"


@pytest.fixture(scope="module")
def other(platform: Platform) -> Record:
    """Another clock, another size, a shorter time."""
    return waving_record(platform, rows=251, size=0.02, step=1.7e-3)


@pytest.fixture(scope="module")
def three_path(record: Record, other: Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The third is the first, moved by 1 mm along x."""
    moved = Record(
        record.table.with_columns(**{"position[1]": record["position[1]"] + 1e-3}),
        record.metadata,
    )
    path = tmp_path_factory.mktemp("charts") / "three.html"
    path.write_bytes(view_page([record, other, moved], ["long <b>%{x}", "short", "moved"]))
    return path


@pytest.fixture
def three(browser: Browser, three_path: Path) -> Iterator[Watched]:
    found = open_report(browser, three_path, 0.0)
    yield found
    assert found.errors == []
    found.page.close()


def curves(page: Page, signal: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = page.evaluate(CURVES, signal)
    return found


def plot_area(page: Page, signal: str) -> dict[str, float]:
    page.locator(f'[data-signal="{signal}"]').scroll_into_view_if_needed()
    box = page.locator(f'[data-signal="{signal}"] .nsewdrag').bounding_box()
    assert box is not None
    return {"x": box["x"], "y": box["y"], "width": box["width"], "height": box["height"]}


def test_a_curve_is_drawn_through_all_of_its_points(one: Watched, record: Record) -> None:
    """Expected: as many corners as the record has rows, in the curve's path."""
    lines = one.page.locator('[data-signal="position from home"] .scatterlayer .js-line')
    assert lines.first.evaluate(DRAWN) == record.table.height


def test_the_cursor_follows_and_a_click_on_a_curve_goes_to_its_time(one: Watched) -> None:
    """Expected: in each panel it lies at the time's share of the width; a click at 70 % of 0.5 s is 0.35 s."""
    page = one.page
    for signal in ("position from home", "error.position"):
        box = plot_area(page, signal)
        for time in (0.0, 0.2, 0.5):
            page.evaluate("time => GoughStewart.player.seek(time)", time)
            left = page.locator(f'[data-signal="{signal}"] .cursor').evaluate("e => e.getBoundingClientRect().left")
            assert left == pytest.approx(box["x"] + time / 0.5 * box["width"], abs=1.5)
        page.mouse.click(box["x"] + 0.7 * box["width"], box["y"] + 0.5 * box["height"])
        until(page, "Math.abs(GoughStewart.player.time - 0.35) < 0.004")


def test_a_drag_zooms_all_panels_and_a_double_click_shows_all_again(one: Watched) -> None:
    """Expected: from 20 to 60 % of 0.5 s in every panel; the cursor is gone where its time is; then all, as before."""
    page, ranges = one.page, "() => [...document.querySelectorAll('.plot')].map(plot => plot.layout.xaxis.range)"
    before = page.evaluate("() => [...document.querySelectorAll('.plot')].map(plot => plot.layout.yaxis.range)")
    page.evaluate("GoughStewart.player.seek(0.45)")
    box = plot_area(page, "position from home")
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 0.5 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"], steps=4)
    page.mouse.up()
    until(page, "document.querySelectorAll('.plot')[8].layout.xaxis.range[0] > 0.05")
    for low, high in page.evaluate(ranges):
        assert (low, high) == pytest.approx((0.1, 0.3), abs=0.005)
    assert page.locator(".cursor").first.is_hidden()
    page.mouse.dblclick(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    until(page, "document.querySelectorAll('.plot')[8].layout.xaxis.range[0] === 0")
    assert page.evaluate(ranges) == [[0, 0.5]] * 9
    assert page.evaluate("() => [...document.querySelectorAll('.plot')].map(plot => plot.layout.yaxis.range)") == before


def test_no_button_offers_to_send_the_data_away(one: Watched) -> None:
    titles = one.page.eval_on_selector_all(".modebar-btn", "buttons => buttons.map(b => b.dataset.title)")
    # releases of plotly.js differ in the case of letters
    assert {title.lower() for title in titles} == {"download plot as a png", "pan", "reset axes", "zoom"}


def test_a_signal_of_the_record_can_be_put_on_a_chart_and_taken_off(one: Watched, record: Record) -> None:
    """Expected: a panel with the column's own values, and a list that offers each signal once and by its group."""
    page = one.page
    before = page.evaluate(PANELS)
    groups = page.eval_on_selector_all("#add-chart optgroup", "groups => groups.map(g => g.label)")
    assert groups == ["pose", "errors", "actuators", "legs", "reference", "disturbance", "flags"]
    page.select_option("#add-chart", "external_force")
    until(page, "document.querySelectorAll('.panel').length === 10")
    assert page.evaluate(PANELS) == [*before, "external_force"]
    shown = curves(page, "external_force")
    assert [curve["name"] for curve in shown] == ["x, z", "y"]
    assert shown[1]["y"] == record["external_force[2]"].tolist()
    assert page.locator("#add-chart option[value=external_force]").is_disabled()
    page.click('[data-signal="external_force"] .remove')
    assert page.evaluate(PANELS) == before
    assert page.locator("#add-chart option[value=external_force]").is_enabled()


def test_legs_axes_and_lines_can_be_chosen(one: Watched, record: Record) -> None:
    """Expected: the curve of the leg or axis alone; a click on a key hides its line."""
    page = one.page
    page.select_option("#legs-shown", "4")
    page.select_option("#axes-shown", "1")
    until(page, "document.querySelector('[data-signal=leg_velocity] .plot').data.length === 1")
    (force,) = curves(page, "actuator_force")
    assert force["y"] == pytest.approx(record["actuator_force[5]"], rel=1e-6)
    assert [c["name"] for c in curves(page, "orientation from home")] == ["pitch", "reference"]
    page.select_option("#legs-shown", "")
    page.select_option("#axes-shown", "")
    until(page, "document.querySelector('[data-signal=leg_velocity] .plot').data.length === 6")
    key = page.locator('[data-signal="error.position"] .key button', has_text="y")
    key.click()
    until(page, """document.querySelector('[data-signal="error.position"] .plot').data.length === 2""")
    assert [c["name"] for c in curves(page, "error.position")] == ["x", "z"]
    assert key.get_attribute("aria-pressed") == "false"
    # the key alone hears the space bar; the animation stands still
    key.press("Space")
    until(page, """document.querySelector('[data-signal="error.position"] .plot').data.length === 3""")
    assert not page.evaluate("GoughStewart.player.playing")


def test_what_rests_fills_no_panel_and_coinciding_legs_are_one_line(
    browser: Browser, platform: Platform, tmp_path: Path
) -> None:
    """Expected: noise of 1e-11 m in a panel of 0.001 mm and 12 % of air, about it; names of legs in ranges."""
    rows = 40
    noise = 1e-11 * np.random.default_rng(1).normal(size=(rows, 3))
    force = 100 + np.arange(rows) * np.array([1.0, 2.0, 1.0, 1.0, 3.0, 3.0])[:, None]
    record = waving_record(platform, rows=rows)
    names = {f"position[{k + 1}]": platform.home_position[k] + 0.005 + noise[:, k] for k in range(3)}
    names |= {f"reference.position[{k + 1}]": np.full(rows, platform.home_position[k] + 0.005) for k in range(3)}
    names |= {f"actuator_force[{k + 1}]": force[k] for k in range(6)}
    names |= {f"leg_velocity[{k + 1}]": force[0] / 1e3 for k in range(6)}
    path = tmp_path / "rests.html"
    path.write_bytes(view_page([Record(record.table.with_columns(**names), record.metadata)], ["rests"]))
    page = open_report(browser, path, 0.0).page
    low, high = page.evaluate(
        """document.querySelector('[data-signal="position from home"] .plot').layout.yaxis.range"""
    )
    assert (low, high) == pytest.approx((5 - 0.56e-3, 5 + 0.56e-3), abs=1e-7)
    keys = {
        signal: page.locator(f'[data-signal="{signal}"] .key button').all_inner_texts()
        for signal in ("position from home", "actuator_force", "leg_velocity")
    }
    assert keys == {
        "position from home": ["x, y, z", "reference"],
        "actuator_force": ["legs 1, 3, 4", "leg 2", "legs 5, 6"],
        "leg_velocity": ["legs 1–6"],
    }
    page.close()


def test_colour_tells_runs_and_dashes_tell_axes(three: Watched) -> None:
    """Expected: of each run one colour, its swatch's; of each axis one dash; a run that is hidden has no curve."""
    page = three.page
    colours = page.evaluate("GoughStewart.page.colours")
    shown = [curve for curve in curves(page, "position from home") if "reference" not in curve["name"]]
    assert len(shown) == 9
    for k, name in enumerate(("long &lt;b>%&#123;x}", "short", "moved")):
        assert {curve["color"] for curve in shown if curve["name"].endswith(f"· {name}")} == {colours[k]}
    dashes = {axis: {c["dash"] for c in shown if c["name"].startswith(f"{axis} ")} for axis in "xyz"}
    assert [len(each) for each in dashes.values()] == [1, 1, 1]
    assert len(set.union(*dashes.values())) == 3
    page.uncheck("input[data-record='0']")
    until(page, """document.querySelector('[data-signal="error.position"] .plot').data.length === 6""")
    assert {c["color"] for c in curves(page, "error.position")} == set(colours[1:3])


def test_runs_are_compared_by_their_difference(three: Watched, record: Record, other: Record) -> None:
    """Expected: what a straight line between the rows of either gives, on the times of both; of the moved run 1 mm."""
    page = three.page
    page.select_option("#difference", "1")
    until(page, "document.querySelector('h3').textContent.includes('difference from short')")
    z = [c for c in curves(page, "position from home") if c["name"].startswith("z")]
    assert [c["name"] for c in z] == ["z · long &lt;b>%&#123;x} − short", "z · moved − short"]
    time = np.array(z[0]["x"])
    assert time[-1] == pytest.approx(other["time"][-1])
    one, two = (np.interp(time, each["time"], each["position[3]"]) for each in (record, other))
    assert np.array(z[0]["y"]) == pytest.approx(1e3 * (one - two), abs=1e-4)
    page.select_option("#difference", "2")
    until(page, "document.querySelector('h3').textContent.includes('difference from moved')")
    x = next(c for c in curves(page, "position from home") if c["name"].startswith("x · long"))
    assert x["y"] == pytest.approx([-1.0] * len(x["y"]), abs=1e-6)
    page.select_option("#difference", "")
    until(page, "!document.querySelector('h3').textContent.includes('difference')")


@pytest.mark.parametrize("width", [390, 768, 1400])
def test_titles_keys_and_plots_stand_clear_of_each_other(one: Watched, width: int) -> None:
    """Expected: no two of their boxes share a point, nor does anything make the page wider than the screen."""
    page = one.page
    page.set_viewport_size({"width": width, "height": 640})
    until(page, FITS)
    page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    # the words of a title and the samples of a key, not the lines that they stand in
    found = page.evaluate("""() => [...document.querySelectorAll('.panel')].map(panel => {
      const words = document.createRange();
      words.selectNodeContents(panel.querySelector('h3'));
      const parts = [words, ...panel.querySelectorAll('.key li, .remove, .plot')];
      return parts.map(part => part.getBoundingClientRect()).map(box => [box.left, box.right, box.top, box.bottom]);
    })""")
    wide = page.evaluate("document.documentElement.scrollWidth")
    page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = false; })")
    page.set_viewport_size({"width": 1000, "height": 640})
    assert wide == width
    assert len(found) == 9
    for parts in found:
        assert len(parts) > 2
        for k, (left, right, top, bottom) in enumerate(parts):
            assert right > left
            assert bottom > top
            for other_left, other_right, other_top, other_bottom in parts[:k]:
                apart = right <= other_left or other_right <= left or bottom <= other_top or other_bottom <= top
                assert apart, parts


def test_fingers_scroll_the_page_over_a_chart_and_a_tap_goes_to_its_time(browser: Browser, report: Path) -> None:
    """Expected: a swipe up by 150 pixels scrolls down, time and range stay; a tap at 60 % of 0.5 s is 0.3 s."""
    context = browser.new_context(viewport={"width": 390, "height": 800}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(report.as_uri() + "#t=0.0")
    until(page, "GoughStewart.ready.picture && GoughStewart.ready.curves")
    chart = page.locator('[data-signal="error.position"] .plot')
    chart.scroll_into_view_if_needed()
    box, before = chart.bounding_box(), page.evaluate("scrollY")
    assert box is not None
    session = context.new_cdp_session(page)
    point = {"x": box["x"] + 150, "y": box["y"] + 120}
    session.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [point]})
    for k in range(1, 11):
        moved = {**point, "y": point["y"] - 15 * k}
        session.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [moved]})
        page.wait_for_timeout(16)
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    until(page, f"scrollY > {before + 80}")
    page.wait_for_timeout(200)
    assert page.evaluate("GoughStewart.player.time") == 0
    assert page.evaluate("document.querySelector('.plot').layout.xaxis.range") == [0, 0.5]
    left, width = page.evaluate("(({ l, w }) => [l, w])(document.querySelector('.plot')._fullLayout._size)")
    box = chart.bounding_box()
    assert box is not None
    page.touchscreen.tap(box["x"] + left + 0.6 * width, box["y"] + 90)
    until(page, "Math.abs(GoughStewart.player.time - 0.3) < 0.005")
    context.close()


def test_charts_follow_the_colour_scheme_and_are_light_on_paper(one: Watched) -> None:
    """Expected: the panels' letters are light in the dark and dark on paper, where no control is left and all fits."""
    page = one.page
    red = "Number(/[0-9]+/.exec(getComputedStyle(document.querySelector('.xtick text')).fill)[0])"
    assert page.evaluate(red) < 80
    page.emulate_media(color_scheme="dark")
    until(page, f"{red} > 180")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print", color_scheme="dark")
    until(page, f"{red} < 80")
    until(page, "document.querySelector('.plot .main-svg').clientWidth <= 680")
    assert page.locator(".panel:visible").count() == 9
    assert page.locator(".choices:visible, .remove:visible, .cursor:visible, .modebar-container:visible").count() == 0
    breaks = page.eval_on_selector_all(
        ".panel, .sheets tr", "all => all.map(each => getComputedStyle(each).breakInside)"
    )
    assert set(breaks) == {"avoid"}
    page.emulate_media(media="screen", color_scheme="light")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    until(page, FITS)
    assert page.evaluate(red) < 80


def test_each_chart_has_a_name_that_says_what_it_shows(one: Watched, record: Record) -> None:
    """Expected: title, lines, and the smallest and largest value of the record's columns, to 0.001 N."""
    names = one.page.eval_on_selector_all(
        ".panel [role=img]", "all => all.map(each => each.getAttribute('aria-label'))"
    )
    assert len(names) == 9
    (force,) = [name for name in names if "actuator force" in name]
    low, high = (f"{pick(record['actuator_force']):.3f}".replace("-", "−") for pick in (np.min, np.max))
    legs = "; ".join(f"leg {k}" for k in range(1, 7))
    assert force == f"Chart of actuator force over time from 0 to 0.5 s: {legs}; values from {low} to {high} N."
