"""The charts of a page in a real browser, as a reader uses them: cursor, marked time, zoom, legs, link, paper."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from playwright.sync_api import Browser, Page

from gough_stewart.harness.report.chart import Axis, Chart, Series, time_axis
from gough_stewart.harness.report.document import Report, Section, Verdict
from gough_stewart.harness.report.page import page_of
from gough_stewart.harness.report.palette import THEMES, Role, colour_of_six
from gough_stewart.harness.report.quantities import FREQUENCY, NUMBER
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.view.view import view_page
from gough_stewart.model.platform import Platform
from tests.support.browser import Watched, open_report, until
from tests.support.records import waving_record

# Of a chart: the place of its plotted part on the screen, its range of time, and what its lines hold.
PLACE = """title => { const p = GoughStewart.panels.find(each => each.chart.title === title);
  p.host.scrollIntoView({block: 'center'}); return Boolean(p.figure); }"""
BOX = """title => { const p = GoughStewart.panels.find(each => each.chart.title === title);
  const box = p.plot.getBoundingClientRect(), place = p.figure.place();
  return {x: box.left + place.left, y: box.top + place.top, width: place.width, height: place.height}; }"""
RANGE = """title => { const p = GoughStewart.panels.find(each => each.chart.title === title);
  return [p.figure.figure.x_range.start, p.figure.figure.x_range.end]; }"""
LINES = """title => { const p = GoughStewart.panels.find(each => each.chart.title === title);
  return p.figure.parts.map(({ series, source, glyphs }) => ({ ...series, x: [...source.data.x], y: [...source.data.y],
    alpha: glyphs.at(-1).made.glyph.line_alpha.value, width: glyphs.at(-1).made.glyph.line_width.value,
    colour: glyphs.at(-1).made.glyph.line_color.value, dash: [...glyphs.at(-1).made.glyph.line_dash.value],
    offset: glyphs.at(-1).made.glyph.line_dash_offset.value, visible: glyphs.at(-1).made.visible })); }"""
SHOWN = "() => GoughStewart.panels.filter(p => p.host.checkVisibility()).map(p => p.chart.title)"
ERROR, HOME, FORCE = "position error", "position from home", "actuator force"


def lines(page: Page, title: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = page.evaluate(LINES, title)
    return found


def box_of(page: Page, title: str) -> dict[str, float]:
    """In view, drawn and at rest."""
    page.evaluate(PLACE, title)
    until(page, f"GoughStewart.panels.find(each => each.chart.title === '{title}').figure !== null")
    page.wait_for_timeout(60)
    found: dict[str, float] = page.evaluate(BOX, title)
    return found


def drag(page: Page, box: dict[str, float], start: float, end: float) -> None:
    y = box["y"] + 0.5 * box["height"]
    page.mouse.move(box["x"] + start * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + end * box["width"], y, steps=4)
    page.mouse.up()


@pytest.fixture
def fresh(one: Watched) -> Page:
    """The page of one record as it was opened."""
    one.page.evaluate("document.activeElement.blur()")
    one.page.keyboard.press("Escape")
    one.page.evaluate("GoughStewart.player.pause(), GoughStewart.zoomTo(null), GoughStewart.player.seek(0)")
    return one.page


def test_the_cursor_is_in_all_charts_and_in_the_scene(fresh: Page, record: Record) -> None:
    """Expected: at the time's share of the width; values of the row beside the names; the scene at the same time."""
    for title in (ERROR, HOME):
        box = box_of(fresh, title)
        fresh.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 20)
        row = 150
        until(fresh, f"Math.abs(GoughStewart.shownTime() - {record['time'][row]}) < 0.0006")
        for other in (ERROR, HOME):
            place = fresh.evaluate(BOX, other)
            left = fresh.evaluate(
                f"GoughStewart.panels.find(p => p.chart.title === '{other}').cursor.getBoundingClientRect().left"
            )
            assert left == pytest.approx(place["x"] + 0.3 * place["width"], abs=1.5)
        near = fresh.evaluate("GoughStewart.player.drawn()")[0]["position"]
        assert near == pytest.approx(record["position"][row], abs=1e-3)
    fresh.mouse.move(2, 2)
    until(fresh, "GoughStewart.shownTime() === 0")
    fresh.evaluate("time => GoughStewart.player.seek(time)", float(record["time"][200]))
    shown = fresh.evaluate(
        f"GoughStewart.panels.find(p => p.chart.title === '{FORCE}').items.map(each => each.value.textContent)"
    )
    numbers = [float(text.replace("−", "-").split()[0]) for text in shown]
    assert numbers == pytest.approx(record["actuator_force"][200], rel=1e-3, abs=2e-3)


def test_a_drag_marks_a_time_that_is_repeated_and_can_be_zoomed_to(fresh: Page) -> None:
    """Expected: from 20 to 60 % of 0.5 s in every chart; playing stays within; + zooms all to it, 0 goes back."""
    drag(fresh, box_of(fresh, HOME), 0.2, 0.6)
    assert fresh.evaluate("GoughStewart.state.region") == pytest.approx([0.1, 0.3], abs=0.003)
    until(fresh, "GoughStewart.panels.filter(p => p.figure && p.isTime !== false && !p.region.hidden).length >= 3")
    fresh.keyboard.press("Space")
    times = []
    for _ in range(12):
        fresh.wait_for_timeout(60)
        times.append(fresh.evaluate("GoughStewart.player.time"))
    fresh.keyboard.press("Space")
    assert min(times) >= 0.097
    assert max(times) <= 0.303
    assert any(after < before for before, after in pairwise(times))
    fresh.keyboard.press("+")
    until(fresh, "GoughStewart.state.zoom !== null")
    for title in (HOME, ERROR):
        box_of(fresh, title)
        assert fresh.evaluate(RANGE, title) == pytest.approx([0.1, 0.3], abs=0.003)
    fresh.keyboard.press("0")
    assert fresh.evaluate(RANGE, HOME) == [0, 0.5]
    fresh.keyboard.press("Escape")
    assert fresh.evaluate("GoughStewart.state.region") is None


def test_zooming_shows_the_rows_of_the_record(browser: Browser, platform: Platform, tmp_path: Path) -> None:
    """Expected: of 4,001 rows the extremes of each part at first; zoomed, every row as it is, to the resolution."""
    smooth = waving_record(platform, rows=4001)
    spiked = smooth["actuator_force"][:, 3].copy()
    spiked[[2711, 3407]] = 170.0, -150.0  # one row each
    record = Record(smooth.table.with_columns(**{"actuator_force[4]": spiked}), smooth.metadata)
    path = tmp_path / "long.html"
    path.write_bytes(view_page([record], ["long"]))
    page = open_report(browser, path, 0.0).page
    box_of(page, FORCE)
    first = lines(page, FORCE)[3]
    column = record["actuator_force"][:, 3]
    assert len(first["y"]) < 3000
    assert (min(first["y"]), max(first["y"])) == pytest.approx((column.min(), column.max()), abs=1e-3)
    page.evaluate("GoughStewart.zoomTo([3.1, 3.25])")
    zoomed = lines(page, FORCE)[3]
    inside = [(x, y) for x, y in zip(zoomed["x"], zoomed["y"], strict=True) if 3.1 - 1e-9 <= x <= 3.25 + 1e-9]
    rows = slice(3100, 3251)
    assert [x for x, _ in inside] == pytest.approx(record["time"][rows], abs=1e-9)
    assert [y for _, y in inside] == pytest.approx(column[rows], abs=1e-3)
    page.close()


def test_a_picked_leg_stands_out_everywhere(fresh: Page) -> None:
    """Expected: by its key, by its name in a legend, and by a click on it in the view; all others step back."""
    box_of(fresh, FORCE)

    def wide(title: str) -> list[int]:
        found = lines(fresh, title)
        assert all((line["alpha"] == 1) == (line["width"] > 2.5) for line in found if line["role"] == "actual")
        return [line["leg"] for line in found if line["role"] == "actual" and line["width"] > 2.5]

    fresh.keyboard.press("4")
    assert (wide(FORCE), wide("length of legs")) == ([4], [4])
    plain = [leg["colour"] for leg in fresh.evaluate("GoughStewart.player.drawn()")[0]["legs"]]
    assert fresh.input_value("#leg") == "4"
    fresh.keyboard.press("4")
    before = [leg["colour"] for leg in fresh.evaluate("GoughStewart.player.drawn()")[0]["legs"]]
    assert plain[3] == before[3]
    assert all(plain[k] != before[k] for k in (0, 1, 2, 4, 5))
    button = fresh.locator("figure.chart", has_text=FORCE).first.locator(".key button", has_text="leg 2").first
    button.click()
    assert wide("length of legs") == [2]
    assert button.get_attribute("aria-pressed") == "true"
    fresh.keyboard.press("Escape")
    fresh.evaluate("scrollTo(0, 0)")
    fresh.wait_for_timeout(100)
    leg = fresh.evaluate(
        "() => { const {foot, head} = GoughStewart.player.drawn()[0].legs[4], {seen} = GoughStewart.player.stage();"
        " return seen(foot.map((x, k) => 0.5 * x + 0.5 * head[k])); }"
    )
    view = fresh.locator("#view").bounding_box()
    assert view is not None
    fresh.mouse.click(view["x"] + leg[0], view["y"] + leg[1])
    assert fresh.evaluate("GoughStewart.state.leg") == 5
    fresh.keyboard.press("Escape")
    assert fresh.evaluate("GoughStewart.state.leg") is None


def test_the_link_holds_time_zoom_and_selection(fresh: Page, browser: Browser, report: Path) -> None:
    """Expected: the address of the page, opened again, shows the same; the browser changes it without a step back."""
    fresh.evaluate("GoughStewart.player.seek(0.25)")
    fresh.keyboard.press("3")
    fresh.evaluate("GoughStewart.mark([0.2, 0.3]), GoughStewart.zoomTo([0.1, 0.4])")
    until(fresh, "location.hash.includes('zoom')")
    address = fresh.evaluate("location.hash")
    page = browser.new_page(viewport={"width": 1000, "height": 640})
    page.goto(report.as_uri() + address)
    until(page, "GoughStewart.ready.picture && GoughStewart.ready.curves")
    found = page.evaluate(
        "(({ time, region, zoom, leg, playing }) => [time, region, zoom, leg, playing])(GoughStewart.state)"
    )
    assert found == [0.25, [0.2, 0.3], [0.1, 0.4], 3, False]
    page.close()


def test_keys_move_through_time(fresh: Page, record: Record) -> None:
    """Expected: frames one by one, a tenth of what is shown with Shift, the ends, and a time marked by brackets."""
    time = record["time"]
    for key, expected in (
        ("ArrowRight", time[1]), ("ArrowRight", time[2]), ("ArrowLeft", time[1]), ("End", 0.5), ("Home", 0.0),
        ("Shift+ArrowRight", 0.05), ("Shift+ArrowRight", 0.1),
    ):  # fmt: skip
        fresh.keyboard.press(key)
        assert fresh.evaluate("GoughStewart.player.time") == pytest.approx(expected, abs=1e-9)
    fresh.keyboard.press("[")
    fresh.keyboard.press("Shift+ArrowRight")
    fresh.keyboard.press("]")
    assert fresh.evaluate("GoughStewart.state.region") == pytest.approx([0.1, 0.15])


def test_curves_that_coincide_are_all_seen(browser: Browser, platform: Platform, tmp_path: Path) -> None:
    """Expected: legs 1, 3 and 4 equal: three colours whose dashes take turns; leg 2, which is alone, is full."""
    rows = 40
    force = 100 + np.arange(rows) * np.array([1.0, 2.0, 1.0, 1.0, 3.0, 4.0])[:, None]
    record = waving_record(platform, rows=rows)
    names = {f"actuator_force[{k + 1}]": force[k] for k in range(6)}
    path = tmp_path / "equal.html"
    path.write_bytes(view_page([Record(record.table.with_columns(**names), record.metadata)], ["equal"]))
    page = open_report(browser, path, 0.0).page
    box_of(page, FORCE)
    found = lines(page, FORCE)
    equal = [found[k] for k in (0, 2, 3)]
    dash, gap = equal[0]["dash"]
    assert [line["dash"] for line in equal] == [[dash, 2 * dash]] * 3
    assert gap == 2 * dash
    assert sorted(-line["offset"] for line in equal) == [0, dash, 2 * dash]
    assert len({line["colour"] for line in equal}) == 3
    assert [found[k]["dash"] for k in (1, 4, 5)] == [[], [], []]
    page.close()


@pytest.fixture(scope="module")
def three_path(record: Record, platform: Platform, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another clock, another size, a shorter time; the third is the first, moved by 1 mm along x."""
    other = waving_record(platform, rows=251, size=0.02, step=1.7e-3)
    moved = Record(record.table.with_columns(**{"position[1]": record["position[1]"] + 1e-3}), record.metadata)
    path = tmp_path_factory.mktemp("charts") / "three.html"
    path.write_bytes(view_page([record, other, moved], ["long <b>%{x}", "short", "moved"]))
    return path


@pytest.fixture
def three(browser: Browser, three_path: Path) -> Iterator[Watched]:
    found = open_report(browser, three_path, 0.0)
    yield found
    assert found.errors == []
    found.page.close()


def test_colour_tells_runs_and_dashes_tell_axes(three: Watched) -> None:
    """Expected: of each run one colour, of each axis one dash; earlier runs are wider, so that they are seen.

    A run that is hidden has no curve. The moved run differs from the first by 1 mm.
    """
    page = three.page
    box_of(page, HOME)
    found = [line for line in lines(page, HOME) if line["role"] == "actual"]
    assert len(found) == 9
    colours = [{line["colour"] for line in found if line["run"] == run} for run in range(3)]
    assert [len(each) for each in colours] == [1, 1, 1]
    assert len(set.union(*colours)) == 3
    dashes = [{tuple(line["dash"]) for line in found if line["component"] == axis} for axis in "xyz"]
    assert [len(each) for each in dashes] == [1, 1, 1]
    assert len(set.union(*dashes)) == 3
    widths = [next(line["width"] for line in found if line["run"] == run) for run in range(3)]
    assert widths[0] > widths[1] > widths[2]
    names = page.locator("figure.chart", has_text=HOME).first.locator(".key .run").all_inner_texts()
    assert names == ["long <b>%{x}", "short", "moved"]
    page.uncheck("#runs input >> nth=0")
    assert {line["run"] for line in lines(page, HOME) if line["visible"]} == {1, 2}
    box_of(page, "position from home, difference")
    x = next(
        line for line in lines(page, "position from home, difference") if (line["run"], line["component"]) == (2, "x")
    )
    assert x["y"] == pytest.approx([1.0] * len(x["y"]), abs=1e-3)


@pytest.mark.parametrize("width", [390, 768, 1440])
def test_nothing_is_wider_than_the_page_and_titles_stand_clear(fresh: Page, width: int) -> None:
    """Expected: no two boxes of a chart's title, legend and plot share a point; a page as wide as its screen."""
    fresh.set_viewport_size({"width": width, "height": 844})
    until(fresh, "GoughStewart.ready.all")
    fresh.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    fresh.wait_for_timeout(200)
    found = fresh.evaluate("""() => [...document.querySelectorAll('figure.chart')].map(chart => {
      const words = document.createRange();
      words.selectNodeContents(chart.querySelector('figcaption').firstElementChild);
      const parts = [words, ...chart.querySelectorAll('.key li, .plot')];
      return parts.map(part => part.getBoundingClientRect()).map(box => [box.left, box.right, box.top, box.bottom]);
    })""")
    wide = fresh.evaluate("document.documentElement.scrollWidth")
    fresh.evaluate("document.querySelectorAll('details:not(.stage-options)').forEach(each => { each.open = false; })")
    fresh.set_viewport_size({"width": 1000, "height": 640})
    assert wide == width
    assert len(found) >= 9
    for parts in found:
        for k, (left, right, top, bottom) in enumerate(parts):
            for other_left, other_right, other_top, other_bottom in parts[:k]:
                apart = (
                    right <= other_left or other_right <= left or bottom <= other_top + 0.5 or other_bottom <= top + 0.5
                )
                assert apart, parts


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (390, 844)])
def test_the_first_screen_has_verdict_numbers_and_picture(fresh: Page, width: int, height: int) -> None:
    """Expected: all of them above the bar of time, which is at the lower edge; charts after."""
    page = fresh
    page.evaluate("document.querySelector('.stage-options').open = false, scrollTo(0, 0)")
    page.set_viewport_size({"width": width, "height": height})
    until(page, "document.querySelector('#view canvas').clientWidth <= innerWidth")
    tops = [
        page.locator(each).first.bounding_box()
        for each in (".verdict", ".numbers", "#view canvas", ".bar", "figure.chart")
    ]
    page.set_viewport_size({"width": 1000, "height": 640})
    page.evaluate("document.querySelector('.stage-options').open = true")
    verdict, numbers, picture, bar, chart = (each for each in tops if each is not None)
    for part in (verdict, numbers, picture):
        assert part["y"] >= 0
        assert part["y"] + part["height"] <= min(bar["y"] + 1, height)
    assert bar["y"] + bar["height"] <= height + 1
    assert chart["y"] >= picture["y"] + picture["height"]


def test_fingers_scroll_the_page_over_a_chart_and_a_tap_goes_to_its_time(browser: Browser, report: Path) -> None:
    """Expected: a swipe up by 150 pixels scrolls down, time and range stay; a tap at 60 % of 0.5 s is 0.3 s."""
    context = browser.new_context(viewport={"width": 390, "height": 800}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(report.as_uri() + "#t=0.0")
    until(page, "GoughStewart.ready.picture && GoughStewart.ready.curves")
    box, before = box_of(page, ERROR), page.evaluate("scrollY")
    session = context.new_cdp_session(page)
    point = {"x": box["x"] + 150, "y": box["y"] + 80}
    session.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [point]})
    for k in range(1, 11):
        moved = {**point, "y": point["y"] - 15 * k}
        session.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [moved]})
        page.wait_for_timeout(16)
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    until(page, f"scrollY > {before + 80}")
    page.wait_for_timeout(200)
    assert page.evaluate("GoughStewart.player.time") == 0
    assert page.evaluate("GoughStewart.state.region") is None
    box = box_of(page, ERROR)
    page.touchscreen.tap(box["x"] + 0.6 * box["width"], box["y"] + 40)
    until(page, "Math.abs(GoughStewart.player.time - 0.3) < 0.005")
    context.close()


def test_paper_is_light_whole_and_without_controls(browser: Browser, report: Path) -> None:
    """Expected: a drawing of each chart that is open, as wide as the paper, with dark letters; legends; no control."""
    page = browser.new_page(color_scheme="dark", viewport={"width": 1440, "height": 900})
    page.goto(report.as_uri() + "#t=0.1")
    until(page, "GoughStewart.ready.all === true")
    shown = page.evaluate(SHOWN)
    page.set_viewport_size({"width": 700, "height": 900})
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print", color_scheme="dark")
    drawings = page.locator(".paper svg:visible")
    assert drawings.count() == len(shown)
    for k in range(drawings.count()):
        box = drawings.nth(k).bounding_box()
        assert box is not None
        assert 500 < box["width"] <= 700
        assert box["height"] > 100
    letters = page.eval_on_selector_all(
        ".paper svg text", "all => all.map(each => getComputedStyle(each).fill).filter(each => each.startsWith('rgb'))"
    )
    assert letters
    assert all(int(each.split("(")[1].split(",")[0]) < 120 for each in letters)
    strokes = page.eval_on_selector_all(
        ".paper svg [stroke]", "all => [...new Set(all.map(each => getComputedStyle(each).stroke))]"
    )
    light, dark = (
        {f"rgb({', '.join(str(int(colour_of_six(k, theme)[i : i + 2], 16)) for i in (1, 3, 5))})" for k in range(6)}
        for theme in THEMES[:2]
    )
    assert light <= set(strokes)
    assert not (dark - light) & set(strokes)
    assert "time [s]" in drawings.first.text_content()  # type: ignore[operator]
    assert (
        page.locator(
            ".bar:visible, button.all:visible, select:visible, .cursor:visible, .stage-options:visible"
        ).count()
        == 0
    )
    assert page.locator(".key li:visible").count() > len(shown)
    breaks = page.eval_on_selector_all(".chart, tr", "all => all.map(each => getComputedStyle(each).breakInside)")
    assert set(breaks) == {"avoid"}
    page.emulate_media(media="screen", color_scheme="dark")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.locator(".paper").count() == 0
    assert page.evaluate("GoughStewart.theme().dark")
    page.close()


def test_a_chart_that_is_not_drawn_yet_says_so_on_paper(fresh: Page) -> None:
    """Expected: one sentence in place of the chart, which goes with the paper."""
    fresh.evaluate("() => { globalThis.kept = GoughStewart.panels[0].figure; GoughStewart.panels[0].figure = null; }")
    fresh.evaluate("dispatchEvent(new Event('beforeprint'))")
    said = fresh.evaluate("GoughStewart.panels[0].paper.textContent")
    seen = fresh.evaluate("GoughStewart.panels[0].paper.isConnected")
    fresh.evaluate("dispatchEvent(new Event('afterprint'))")
    fresh.evaluate("() => { GoughStewart.panels[0].figure = globalThis.kept; }")
    assert said == "This chart was not yet drawn: print once more."
    assert seen
    assert fresh.locator(".paper").count() == 0


@pytest.mark.parametrize(("scheme", "name"), [("dark", "dark"), ("light", "contrast")])
def test_forced_colours_have_the_theme_of_their_ground(fresh: Page, scheme: Any, name: str) -> None:
    """Expected: colours for a dark ground on one, else those of high contrast."""
    fresh.emulate_media(color_scheme=scheme, forced_colors="active")
    found = fresh.evaluate("GoughStewart.theme().name")
    fresh.emulate_media(color_scheme="light", forced_colors="none")
    assert found == name


def test_a_chart_is_saved_as_a_picture(fresh: Page, tmp_path: Path) -> None:
    """Expected: by Bokeh's button and by key the pixels of the chart, with the colours of all legs in it."""
    box = box_of(fresh, FORCE)
    host = fresh.locator("figure.chart", has=fresh.get_by_role("heading", name="actuator force", exact=True))
    fresh.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    with fresh.expect_download() as by_button:
        host.get_by_title("Save").click()
    host.locator(".plot").focus()
    with fresh.expect_download() as by_key:
        fresh.keyboard.press("s")
    size = host.locator(".plot").bounding_box()
    assert size is not None
    for download in (by_button.value, by_key.value):
        assert download.suggested_filename == "actuator force.png"
        download.save_as(tmp_path / "saved.png")
        picture = imread(tmp_path / "saved.png")[..., :3]
        assert picture.shape[:2] == pytest.approx((size["height"], size["width"]), abs=1)
        for leg in range(6):
            colour = np.array([int(colour_of_six(leg)[k : k + 2], 16) for k in (1, 3, 5)]) / 255
            assert (np.abs(picture - colour).max(axis=2) < 0.02).sum() > 20, f"leg {leg + 1}"


def test_a_chart_has_only_the_tools_that_it_uses(fresh: Page) -> None:
    """Expected: of curves over time a drag that marks, pan, zoom, a line at the pointer, reset and save."""
    box_of(fresh, FORCE)
    tools = fresh.evaluate(
        f"GoughStewart.panels.find(p => p.chart.title === '{FORCE}').figure.figure.toolbar.tools.map(t => t.type)"
    )
    zooms = ["PanTool", "BoxZoomTool", "WheelZoomTool", "ResetTool"]
    assert tools == ["BoxSelectTool", *zooms, "CrosshairTool", "SaveTool"]


def test_bokehs_zoom_is_that_of_all_charts_over_time(fresh: Page) -> None:
    """Expected: its box over a fifth to three fifths of 0.5 s; its reset shows the whole again."""
    box = box_of(fresh, HOME)
    toolbar = f"GoughStewart.panels.find(p => p.chart.title === '{HOME}').figure.figure.toolbar"
    fresh.evaluate(f"{toolbar}.active_drag = {toolbar}.tools.find(t => t.type === 'BoxZoomTool')")
    drag(fresh, box, 0.2, 0.6)
    until(fresh, "GoughStewart.state.zoom !== null")
    for title in (HOME, ERROR):
        box_of(fresh, title)
        assert fresh.evaluate(RANGE, title) == pytest.approx([0.1, 0.3], abs=0.003)
    fresh.evaluate(f"{toolbar}.active_drag = {toolbar}.tools.find(t => t.type === 'BoxSelectTool')")
    box = box_of(fresh, HOME)
    fresh.mouse.dblclick(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    until(fresh, "GoughStewart.state.zoom === null")
    box_of(fresh, ERROR)
    assert fresh.evaluate(RANGE, ERROR) == [0, 0.5]


def test_no_two_lines_of_a_chart_look_the_same(browser: Browser, three_path: Path, tmp_path: Path) -> None:
    """Expected: of three runs, and of fourteen signals and three references, every pair of colour and dashes once."""
    time = np.linspace(0, 1, 5)
    counts: dict[Role, int] = {"actual": 14, "reference": 3, "neutral": 2, "good": 2}
    roles = [role for role, count in counts.items() for _ in range(count)]
    series = tuple(Series(f"s{k}", NUMBER, time * (k + 1.3), role) for k, role in enumerate(roles))
    path = tmp_path / "many.html"
    path.write_bytes(
        page_of(Report("m", Verdict("v", "told"), (Section("a", (Chart("m", time_axis(time), series),)),)))
    )
    for file in (path, three_path):
        page = open_report(browser, file).page
        until(page, "GoughStewart.ready.all === true")
        for title in page.evaluate("GoughStewart.panels.filter(p => p.figure?.isFunction).map(p => p.chart.title)"):
            looks = [
                (line["colour"], tuple(line["dash"]), line["offset"]) for line in lines(page, title) if line["visible"]
            ]
            assert len(set(looks)) == len(looks), title
        page.close()


def test_any_signals_are_read_at_two_cursors_and_saved_as_rows(fresh: Page, record: Record, tmp_path: Path) -> None:
    """Expected: of the record's rows from 0.1 s to 0.3 s, a length and a force, whose units have an axis each."""
    fresh.evaluate("document.querySelector('#own details').open = true")
    for name in ("length of legs: leg 3", "actuator force: leg 2"):
        fresh.select_option("#signals", label=name)
    until(fresh, "GoughStewart.panels.at(-1).figure?.figure.yaxes.length === 2")
    fresh.evaluate("GoughStewart.mark([0.1, 0.3])")
    rows = slice(100, 301)
    columns = {"length of legs: leg 3 [m]": record["leg_length"][:, 2]}
    columns["actuator force: leg 2 [N]"] = record["actuator_force"][:, 1]
    for k, (name, values) in enumerate(columns.items()):
        texts = fresh.locator("#own tbody tr").nth(k).locator("th, td").all_inner_texts()
        assert texts[0] == name
        marked = values[rows]
        expected = [marked[0], marked[-1], marked[-1] - marked[0], marked.min(), marked.max(), marked.mean()]
        shown = [float(text.replace("−", "-")) for text in texts[1:]]
        assert shown == pytest.approx(expected, rel=1e-3, abs=2e-3 if k else 1e-5)
    with fresh.expect_download() as saved:
        fresh.get_by_role("button", name="save rows as CSV").click()
    saved.value.save_as(tmp_path / "rows.csv")
    head, *lines_of_file = (tmp_path / "rows.csv").read_text(encoding="utf-8").splitlines()
    assert head == ",".join(f'"{name}"' for name in ("time [s]", *columns))
    table = np.array([line.split(",") for line in lines_of_file], dtype=float)
    assert table[:, 0] == pytest.approx(record["time"][rows], abs=1e-9)
    for k, values in enumerate(columns.values()):
        assert table[:, k + 1] == pytest.approx(values[rows], rel=1e-6, abs=1e-3 if k else 1e-6)
    fresh.get_by_role("button", name="empty").click()
    assert fresh.locator("#own figure").count() == 0


def test_words_are_explained_where_a_reader_points(fresh: Page) -> None:
    """Expected: by pointer and by keyboard; Escape hides it."""
    fresh.evaluate("scrollTo(0, 0)")
    term = fresh.locator(".term:visible").first
    term.hover()
    assert fresh.locator("#tip").inner_text() == term.get_attribute("data-means")
    fresh.mouse.move(1, 1)
    assert fresh.locator("#tip").is_hidden()
    term.focus()
    assert fresh.locator("#tip").is_visible()
    assert term.get_attribute("aria-describedby") == "tip"
    fresh.keyboard.press("Escape")
    assert fresh.locator("#tip").is_hidden()


def test_each_chart_has_a_name_that_says_what_it_shows(fresh: Page, record: Record, platform: Platform) -> None:
    """Expected: title, axis, lines, the smallest and largest value of the record's columns, to four digits, and limits.

    The share of the time at a limit is that of the rows with its flag, but the last.
    """
    box_of(fresh, FORCE)
    name = fresh.evaluate(f"GoughStewart.panels.find(p => p.chart.title === '{FORCE}').plot.getAttribute('aria-label')")
    low, high = (f"{pick(record['actuator_force']):.4g}".replace("-", "−") for pick in (np.min, np.max))
    legs = "; ".join(f"leg {k}" for k in range(1, 7))
    shares = (record["flag.force_limited"] > 0, np.abs(record["leg_velocity"]) > platform.leg_velocity_max)
    force, speed = (f"{100 * each[:-1].any(axis=1).mean():.2g} %" for each in shares)
    limits = f"force at its limit, {force} of the time; leg speed beyond its limit, {speed} of the time"
    assert name == f"Chart of actuator force over time [s]: {legs}; values from {low} to {high} N; {limits}."


def test_short_logarithmic_axes_have_round_ticks(browser: Browser, tmp_path: Path) -> None:
    """Expected: from 2 to 100 Hz round numbers of one digit, at most seven; over more decades powers of ten."""
    charts = [
        Chart(title, Axis(title, FREQUENCY, np.array(ends), scale="log"), (Series("L", NUMBER, np.ones(2)),))
        for title, ends in (("short", [2.0, 100.0]), ("long", [0.01, 1000.0]))
    ]
    path = tmp_path / "ticks.html"
    path.write_bytes(page_of(Report("ticks", Verdict("v", "told"), (Section("a", tuple(charts)),))))
    page = open_report(browser, path).page
    until(page, "GoughStewart.ready.all === true")
    short, long = page.evaluate(
        "GoughStewart.panels.map((p) => p.figure.figure.xaxes[0].ticker.ticks).map((all) => all && [...all])"
    )
    assert 3 <= len(short) <= 7
    assert short[0] >= 2
    assert short[-1] <= 100
    assert {str(tick / 10 ** np.floor(np.log10(tick))) for tick in short} <= {"1.0", "2.0", "3.0", "5.0", "7.0"}
    assert long is None
    page.close()


def test_charts_of_a_part_that_is_opened_are_all_drawn(fresh: Page) -> None:
    """Expected: also those far below the window, so that paper has them."""
    until(fresh, "GoughStewart.ready.all === true")
    fresh.evaluate("document.querySelectorAll('main details').forEach((each) => { each.open = true; })")
    until(fresh, "GoughStewart.panels.every((panel) => panel.figure)")
    fresh.evaluate("document.querySelectorAll('main details').forEach((each) => { each.open = false; })")
