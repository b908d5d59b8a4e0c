"""The charts of a page in a real browser, as a reader uses them: cursor, marked time, zoom, legs, link, paper."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from playwright.sync_api import Browser, Page

import gough_stewart as gs
from tests.harness.view.colour_vision import rgb_of
from tests.support import reports
from tests.support.axe import violations
from tests.support.browser import Watched, open_report, until
from tests.support.records import waving_record

PANEL = "GoughStewart.panels.find(each => each.chart.title === '{}')"
# Of a chart: the place of its plotted part on the screen, and what its lines hold.
BOX = """(() => {{ const panel = GoughStewart.panels.find(each => each.chart.title === '{}');
  const box = panel.plot.getBoundingClientRect(), place = panel.figure.place();
  return {{x: box.left + place.left, y: box.top + place.top, width: place.width, height: place.height}}; }})()"""
LINES = (
    PANEL
    + """.figure.parts.map(({{ series, source, glyphs }}) => {{
  const {{ made }} = glyphs.at(-1), {{ glyph }} = made;
  return {{ ...series, x: [...source.data.x], y: [...source.data.y], alpha: glyph.line_alpha.value,
    width: glyph.line_width.value, colour: glyph.line_color.value, dash: [...glyph.line_dash.value],
    offset: glyph.line_dash_offset.value, visible: made.visible }}; }})"""
)
ERROR, HOME, FORCE = "position error", "position from home", "actuator force"


def of_panel(page: Page, title: str, what: str) -> Any:
    return page.evaluate(PANEL.format(title) + what)


def lines(page: Page, title: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = page.evaluate(LINES.format(title))
    return found


def range_of(page: Page, title: str) -> Any:
    return of_panel(page, title, ".figure.figure.x_range.start"), of_panel(page, title, ".figure.figure.x_range.end")


def box_of(page: Page, title: str) -> dict[str, float]:
    """In view, drawn and at rest."""
    of_panel(page, title, ".host.scrollIntoView({block: 'center'})")
    until(page, f"{PANEL.format(title)}.figure !== null")
    page.wait_for_timeout(60)
    found: dict[str, float] = page.evaluate(BOX.format(title))
    return found


def drag(page: Page, box: dict[str, float], start: float, end: float) -> None:
    y = box["y"] + 0.5 * box["height"]
    page.mouse.move(box["x"] + start * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + end * box["width"], y, steps=4)
    page.mouse.up()


@pytest.fixture(scope="module")
def one(browser: Browser, report: Path) -> Iterator[Watched]:
    """The page of one record, where there is no WebGL."""
    with open_report(browser, report, "t=0", webgl=False) as found:
        yield found


@pytest.fixture(scope="module")
def three(
    browser: Browser, record: gs.Record, platform: gs.Platform, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Page]:
    """Of runs with another clock, size and end; the third is the first, moved by 1 mm along x."""
    other = waving_record(platform, rows=251, size=0.02, step=1.7e-3)
    moved = gs.Record(record.table.with_columns(**{"position[1]": record["position[1]"] + 1e-3}), record.metadata)
    path = tmp_path_factory.mktemp("charts") / "three.html"
    gs.view([record, other, moved], path, names=["long <b>%{x}", "short", "moved"])
    with open_report(browser, path, "t=0", webgl=False) as found:
        yield found.page


SPIKES = {2711: 170.0, 3407: -150.0}


@pytest.fixture(scope="module")
def many(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """Charts of all kinds of lines: a long one with two spikes, some that coincide, many, and over two frequencies."""
    time = np.linspace(0, 4, 4001)
    wave = 100 * np.sin(5 * time + 3)
    wave[[*SPIKES]] = [*SPIKES.values()]  # one row each
    slopes = np.array([1.0, 2.0, 1.0, 1.0, 3.0, 4.0])
    counts = {"actual": 14, "reference": 3, "neutral": 2, "good": 2}
    roles = [role for role, number in counts.items() for _ in range(number)]
    charts = [
        reports.chart("long", time, reports.series("leg 4", wave, quantity="force", leg=4)),
        reports.chart(
            "equal",
            time[::100],
            *(reports.series(f"leg {k}", slope * time[::100], leg=k) for k, slope in enumerate(slopes, 1)),
        ),
        reports.chart(
            "many",
            time[:5],
            *(reports.series(f"s{k}", time[:5] * (k + 1.3), role, "number") for k, role in enumerate(roles)),
        ),
        *(
            reports.chart(
                name,
                {"name": name, "quantity": "frequency", "values": ends, "scale": "log"},
                reports.series("L", [1.0, 1.0], quantity="number"),
            )
            for name, ends in (("short", [2.0, 100.0]), ("decades", [0.01, 1000.0]))
        ),
    ]
    path = tmp_path_factory.mktemp("charts") / "many.html"
    heads = ["leg", *(f"a long name of the column {k}" for k in range(1, 5))]
    rows = [[k, *np.arange(4.0)] for k in (1, 2)] + [["all", *np.arange(4.0)]]
    charts.append(reports.table("Legs", [{"name": head} for head in heads], rows))
    path.write_bytes(reports.page_of(reports.report(*charts)))
    with open_report(browser, path) as found:
        until(found.page, "GoughStewart.ready.all === true")
        yield found.page


@pytest.fixture(scope="module")
def again(browser: Browser, one: Watched, report: Path) -> Iterator[Page]:
    """The page opened by the address that the first one came to have, with dark colours."""
    one.page.evaluate("GoughStewart.player.seek(0.25), GoughStewart.pickLeg(3)")
    one.page.evaluate("GoughStewart.mark([0.2, 0.3]), GoughStewart.zoomTo([0.1, 0.4])")
    until(one.page, "location.hash.includes('zoom')")
    link = one.page.evaluate("location.hash.slice(1)")
    with open_report(browser, report, link, (1440, 900), webgl=False, color_scheme="dark") as found:
        until(found.page, "GoughStewart.ready.all === true")
        yield found.page


@pytest.fixture
def fresh(one: Watched) -> Page:
    """The page of one record as it was opened."""
    one.page.evaluate("document.activeElement.blur()")
    one.page.keyboard.press("Escape")
    one.page.evaluate("GoughStewart.player.pause(), GoughStewart.zoomTo(null), GoughStewart.player.seek(0)")
    return one.page


def test_without_webgl_the_page_says_so_and_the_rest_is_there(fresh: Page) -> None:
    assert "no 3-D graphics" in fresh.inner_text("#no-view")
    assert "Tracking error" in fresh.inner_text("main")
    fresh.click("#play")
    assert fresh.evaluate("GoughStewart.player.playing")


def test_the_cursor_is_in_all_charts(fresh: Page, record: gs.Record, platform: gs.Platform) -> None:
    """Expected: at the time's share of the width; values of the row beside the names."""
    for title in (ERROR, HOME):
        box = box_of(fresh, title)
        fresh.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 20)
        until(fresh, f"Math.abs(GoughStewart.shownTime() - {record['time'][150]}) < 0.0006")
        for other in (ERROR, HOME):
            place = fresh.evaluate(BOX.format(other))
            left = of_panel(fresh, other, ".cursor.getBoundingClientRect().left")
            assert left == pytest.approx(place["x"] + 0.3 * place["width"], abs=1.5)
    fresh.mouse.move(2, 2)
    until(fresh, "GoughStewart.shownTime() === 0")
    fresh.evaluate("time => GoughStewart.player.seek(time)", float(record["time"][200]))
    shown = of_panel(fresh, FORCE, ".items.map(each => each.value.textContent)")
    numbers = [float(text.replace("−", "-").split()[0]) for text in shown]
    assert numbers == pytest.approx(record["actuator_force"][200], rel=1e-3, abs=2e-3)
    # from home, with the reference in parentheses
    box_of(fresh, HOME)
    shown = [text for text in of_panel(fresh, HOME, ".items.map(each => each.value.textContent)") if text]
    pairs = [[float(part.strip("()").replace("−", "-")) for part in text.split()] for text in shown]
    for part, name in zip(zip(*pairs, strict=True), ("position", "reference.position"), strict=True):
        expected = 1e3 * (record[name][200] - platform.home_position)
        assert part == pytest.approx(expected, rel=1e-3, abs=2e-3)


def test_a_drag_marks_a_time_that_is_repeated_and_can_be_zoomed_to(fresh: Page) -> None:
    """Expected: from 20 to 60 % of 0.5 s in every chart; playing stays within; + zooms all to it, 0 goes back."""
    drag(fresh, box_of(fresh, HOME), 0.2, 0.6)
    assert fresh.evaluate("GoughStewart.state.region") == pytest.approx([0.1, 0.3], abs=0.003)
    until(fresh, "GoughStewart.panels.filter(p => p.figure && !p.region.hidden).length >= 3")
    fresh.keyboard.press("Space")
    times = []
    for _ in range(12):
        fresh.wait_for_timeout(60)
        times.append(fresh.evaluate("GoughStewart.player.time"))
    fresh.keyboard.press("Space")
    assert (min(times) >= 0.097, max(times) <= 0.303) == (True, True)
    assert any(after < before for before, after in pairwise(times))
    fresh.keyboard.press("+")
    until(fresh, "GoughStewart.state.zoom !== null")
    for title in (HOME, ERROR):
        box_of(fresh, title)
        assert range_of(fresh, title) == pytest.approx([0.1, 0.3], abs=0.003)
    fresh.keyboard.press("0")
    assert range_of(fresh, HOME) == (0, 0.5)
    fresh.keyboard.press("Escape")
    assert fresh.evaluate("GoughStewart.state.region") is None


def test_zooming_shows_every_row(many: Page) -> None:
    """Expected: of 4,001 rows the extremes of each part at first; zoomed, every row as it is, to the resolution."""
    box_of(many, "long")
    (first,) = lines(many, "long")
    assert len(first["y"]) < 3000
    assert (min(first["y"]), max(first["y"])) == pytest.approx((-150, 170), abs=1e-3)
    many.evaluate("GoughStewart.zoomTo([3.4, 3.41])")
    (zoomed,) = lines(many, "long")
    many.evaluate("GoughStewart.zoomTo(null)")
    inside = {round(1e3 * x): y for x, y in zip(zoomed["x"], zoomed["y"], strict=True) if 3.4 <= x + 1e-9 < 3.411}
    expected = {k: SPIKES.get(k, 100 * np.sin(5e-3 * k + 3)) for k in range(3400, 3411)}
    assert inside == pytest.approx(expected, abs=1e-3)


def test_a_picked_leg_stands_out_everywhere(fresh: Page) -> None:
    """Expected: by its key and by its name in a legend; all others step back."""
    box_of(fresh, FORCE)

    def wide(title: str) -> list[int]:
        found = [line for line in lines(fresh, title) if line["role"] == "actual"]
        assert all((line["alpha"] == 1) == (line["width"] > 2.5) for line in found)
        return [line["leg"] for line in found if line["width"] > 2.5]

    fresh.keyboard.press("4")
    assert (wide(FORCE), wide("length of legs")) == ([4], [4])
    assert fresh.input_value("#leg") == "4"
    fresh.keyboard.press("4")
    assert {line["alpha"] for line in lines(fresh, FORCE) if line["role"] == "actual"} == {1}
    assert fresh.input_value("#leg") == ""
    button = fresh.locator("figure.chart", has_text=FORCE).first.locator(".key button", has_text="leg 2").first
    button.click()
    assert (wide("length of legs"), button.get_attribute("aria-pressed")) == ([2], "true")
    fresh.keyboard.press("Escape")
    assert fresh.evaluate("GoughStewart.state.leg") is None


def test_the_link_holds_time_zoom_and_selection(again: Page) -> None:
    """Expected: the address of the page, opened again, shows the same."""
    state = again.evaluate("GoughStewart.state")
    assert [state[name] for name in ("time", "region", "zoom", "leg")] == [0.25, [0.2, 0.3], [0.1, 0.4], 3]
    assert not state["playing"]


def test_keys_move_through_time(fresh: Page, record: gs.Record) -> None:
    """Expected: frames one by one, a tenth of what is shown with Shift, the ends, and a time marked by brackets."""
    time = record["time"]
    for key, expected in (
        ("ArrowRight", time[1]), ("ArrowRight", time[2]), ("ArrowLeft", time[1]), ("End", 0.5), ("Home", 0.0),
        ("Shift+ArrowRight", 0.05), ("Shift+ArrowRight", 0.1),
    ):  # fmt: skip
        fresh.keyboard.press(key)
        assert fresh.evaluate("GoughStewart.player.time") == pytest.approx(expected, abs=1e-9)
    for keys, marked in (
        ("[", [0.1, 0.5]), ("Shift+ArrowRight ]", [0.1, 0.15]), ("Shift+ArrowLeft Shift+ArrowLeft [", [0.05, 0.15]),
        ("Escape ]", [0, 0.05]), ("Shift+ArrowRight Shift+ArrowRight", [0, 0.05]),
    ):  # fmt: skip
        for key in keys.split():
            fresh.keyboard.press(key)
        assert fresh.evaluate("GoughStewart.state.region") == pytest.approx(marked), keys
    # about the present time, which is 0.15 s
    fresh.evaluate("GoughStewart.mark(null)")
    for key, expected in (("+", [0.075, 0.325]), ("+", [0.1125, 0.2375]), ("-", [0.075, 0.325]), ("-", None)):
        fresh.keyboard.press(key)
        zoom = fresh.evaluate("GoughStewart.state.zoom")
        assert zoom == (None if expected is None else pytest.approx(expected)), key


def test_curves_that_coincide_are_all_seen(many: Page) -> None:
    """Expected: legs 1, 3 and 4 equal: three colours whose dashes take turns; leg 2, which is alone, is full."""
    found = lines(many, "equal")
    equal = [found[k] for k in (0, 2, 3)]
    dash = equal[0]["dash"][0]
    assert [line["dash"] for line in equal] == [[dash, 2 * dash]] * 3
    assert sorted(-line["offset"] for line in equal) == [0, dash, 2 * dash]
    assert len({line["colour"] for line in equal}) == 3
    assert [found[k]["dash"] for k in (1, 4, 5)] == [[], [], []]


def test_colour_tells_runs_and_dashes_tell_axes(three: Page) -> None:
    """Expected: of each run one colour, of each axis one dash; earlier runs are wider, so that they are seen."""
    box_of(three, HOME)
    found = [line for line in lines(three, HOME) if line["role"] == "actual"]
    assert len(found) == 9
    of_runs = [[line for line in found if line["run"] == run] for run in range(3)]
    assert [len({line["colour"] for line in run}) for run in of_runs] == [1, 1, 1]
    assert len({line["colour"] for line in found}) == 3
    dashes = [{tuple(line["dash"]) for line in found if line["component"] == axis} for axis in "xyz"]
    assert ([len(each) for each in dashes], len(set.union(*dashes))) == ([1, 1, 1], 3)
    widths = [run[0]["width"] for run in of_runs]
    assert widths[0] > widths[1] > widths[2]
    names = three.locator("figure.chart", has_text=HOME).first.locator(".key .run").all_inner_texts()
    assert names == ["long <b>%{x}", "short", "moved"]
    three.uncheck("#runs input >> nth=0")
    assert {line["run"] for line in lines(three, HOME) if line["visible"]} == {1, 2}
    three.check("#runs input >> nth=0")
    change = "position from home, difference"
    box_of(three, change)
    (x,) = (line for line in lines(three, change) if (line["run"], line["component"]) == (2, "x"))
    assert x["y"] == pytest.approx([1.0] * len(x["y"]), abs=1e-3)


def test_no_two_lines_look_the_same_and_short_logarithmic_axes_have_round_ticks(three: Page, many: Page) -> None:
    """Expected: of three runs, and of fourteen signals and three references, every pair of colour and dashes once."""
    until(three, "GoughStewart.ready.all === true")
    for page in (many, three):
        for title in page.evaluate("GoughStewart.panels.filter(p => p.figure?.isFunction).map(p => p.chart.title)"):
            shown = [line for line in lines(page, title) if line["visible"]]
            looks = {(line["colour"], tuple(line["dash"]), line["offset"]) for line in shown}
            assert len(looks) == len(shown), title
    short, long = many.evaluate(
        "GoughStewart.panels.slice(3).map((p) => p.figure.figure.xaxes[0].ticker.ticks).map((all) => all && [...all])"
    )
    assert 3 <= len(short) <= 7
    assert (short[0] >= 2, short[-1] <= 100, long) == (True, True, None)
    assert {str(tick / 10 ** np.floor(np.log10(tick))) for tick in short} <= {"1.0", "2.0", "3.0", "5.0", "7.0"}


def test_a_card_on_a_phone_says_what_its_number_is(many: Page) -> None:
    """Expected: "leg 1" of the first cell of a row, whose head has no place of its own; a text is as it is."""
    many.set_viewport_size({"width": 390, "height": 844})
    until(many, "document.querySelector('.stacked') !== null")
    names = "[...document.querySelectorAll('.stacked tbody th')]"
    before = many.evaluate(f"{names}.map((each) => [getComputedStyle(each, '::before').content, each.textContent])")
    many.set_viewport_size({"width": 1000, "height": 640})
    assert before == [['"leg "', "1"], ['"leg "', "2"], ["none", "all"]]


@pytest.mark.parametrize("width", [390, 1440])
def test_nothing_is_wider_than_the_page_titles_stand_clear_and_axe_finds_nothing(fresh: Page, width: int) -> None:
    """Expected: no two boxes of a chart's title, legend and plot share a point; a page as wide as its screen."""
    fresh.set_viewport_size({"width": width, "height": 844})
    until(fresh, "GoughStewart.ready.all")
    fresh.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    until(fresh, "GoughStewart.panels.every((panel) => panel.figure)")  # also those far below, so that paper has them
    fresh.wait_for_timeout(200)
    found = fresh.evaluate("""() => [...document.querySelectorAll('figure.chart')].map(chart => {
      const words = document.createRange();
      words.selectNodeContents(chart.querySelector('figcaption').firstElementChild);
      const parts = [words, ...chart.querySelectorAll('.key li, .plot')];
      return parts.map(part => part.getBoundingClientRect()).map(box => [box.left, box.right, box.top, box.bottom]);
    })""")
    wide = fresh.evaluate("document.documentElement.scrollWidth")
    assert width == 390 or violations(fresh) == []
    fresh.evaluate("document.querySelectorAll('details:not(.stage-options)').forEach(each => { each.open = false; })")
    fresh.set_viewport_size({"width": 1000, "height": 640})
    assert wide == width
    assert len(found) >= 9
    for boxes in map(np.array, found):
        left, right, top, bottom = boxes.T[:, :, None]
        apart = (right <= left.T) | (bottom <= top.T + 0.5)
        assert (apart | apart.T | np.eye(len(boxes), dtype=bool)).all()


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (390, 844)])
def test_the_first_screen_has_verdict_numbers_and_picture(fresh: Page, width: int, height: int) -> None:
    """Expected: all of them above the bar of time, which is at the lower edge; charts after."""
    fresh.evaluate("document.querySelector('.stage-options').open = false, scrollTo(0, 0)")
    fresh.set_viewport_size({"width": width, "height": height})
    places = (".verdict", ".numbers", "#view", ".bar", "figure.chart")
    boxes = [fresh.locator(each).first.bounding_box() for each in places]
    fresh.set_viewport_size({"width": 1000, "height": 640})
    fresh.evaluate("document.querySelector('.stage-options').open = true")
    verdict, numbers, picture, bar, chart = (each for each in boxes if each is not None)
    for part in (verdict, numbers, picture):
        assert 0 <= part["y"] <= min(bar["y"] + 1, height) - part["height"]
    assert bar["y"] + bar["height"] <= height + 1
    assert chart["y"] >= picture["y"] + picture["height"]


def test_paper_is_light_whole_and_without_controls(again: Page) -> None:
    """Expected: a drawing of each chart that is open, as wide as the paper, with dark letters; legends; no control."""
    page = again
    page.evaluate("GoughStewart.set({ leg: null, zoom: null, region: null })")
    shown = page.evaluate("GoughStewart.panels.filter(p => p.host.checkVisibility()).length")
    page.set_viewport_size({"width": 700, "height": 900})
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print", color_scheme="dark")
    drawings = page.locator(".paper svg:visible")
    assert drawings.count() == shown
    for box in (drawings.nth(k).bounding_box() for k in range(shown)):
        assert box is not None
        assert 500 < box["width"] <= 700
        assert box["height"] > 100
    letters, strokes = (
        page.eval_on_selector_all(f".paper svg {what}", f"all => all.map(each => getComputedStyle(each).{style})")
        for what, style in (("text", "fill"), ("[stroke]", "stroke"))
    )
    coloured = [each for each in letters if each.startswith("rgb")]
    assert coloured
    assert all(int(each.split("(")[1].split(",")[0]) < 120 for each in coloured)
    light, dark = (
        {f"rgb({', '.join(f'{255 * part:.0f}' for part in rgb_of(colour))})" for colour in palette}
        for palette in page.evaluate("['light', 'dark'].map((name) => GoughStewart.page.palette[name].six)")
    )
    assert light <= set(strokes)
    assert not (dark - light) & set(strokes)
    assert "time [s]" in (drawings.first.text_content() or "")
    controls = (".bar", "button.all", "select", ".cursor", ".stage-options")
    assert page.locator(", ".join(f"{each}:visible" for each in controls)).count() == 0
    assert page.locator(".key li:visible").count() > shown
    breaks = page.eval_on_selector_all(".chart, tr", "all => all.map(each => getComputedStyle(each).breakInside)")
    assert set(breaks) == {"avoid"}
    page.emulate_media(media="screen", color_scheme="dark")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert (page.locator(".paper").count(), page.evaluate("GoughStewart.theme().dark")) == (0, True)
    # a chart that is not drawn yet says so
    page.evaluate("GoughStewart.panels[0].figure = null, dispatchEvent(new Event('beforeprint'))")
    said = page.evaluate("GoughStewart.panels[0].paper.textContent")
    assert said == "This chart was not yet drawn: print once more."


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
            colour = rgb_of(fresh.evaluate(f"GoughStewart.page.palette.light.six[{leg}]"))
            assert (np.abs(picture - colour).max(axis=2) < 0.02).sum() > 20, f"leg {leg + 1}"


def test_a_chart_has_bokehs_tools_and_its_zoom_is_that_of_all_charts_over_time(fresh: Page) -> None:
    """Expected: of curves over time a drag that marks, pan, zoom, a line at the pointer, reset and save, no other."""
    box = box_of(fresh, HOME)
    zooms = ["PanTool", "BoxZoomTool", "WheelZoomTool", "ResetTool"]
    tools = of_panel(fresh, HOME, ".figure.figure.toolbar.tools.map(t => t.type)")
    assert tools == ["BoxSelectTool", *zooms, "CrosshairTool", "SaveTool"]
    toolbar = f"{PANEL.format(HOME)}.figure.figure.toolbar"
    fresh.evaluate(f"void ({toolbar}.active_drag = {toolbar}.tools[2])")  # the value would be all of Bokeh
    drag(fresh, box, 0.2, 0.6)
    until(fresh, "GoughStewart.state.zoom !== null")
    for title in (HOME, ERROR):
        box_of(fresh, title)
        assert range_of(fresh, title) == pytest.approx([0.1, 0.3], abs=0.003)
    fresh.evaluate(f"void ({toolbar}.active_drag = {toolbar}.tools[0])")
    box = box_of(fresh, HOME)
    fresh.mouse.dblclick(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    until(fresh, "GoughStewart.state.zoom === null")
    box_of(fresh, ERROR)
    assert range_of(fresh, ERROR) == (0, 0.5)


def test_any_signals_are_read_at_two_cursors_and_saved_as_rows(fresh: Page, record: gs.Record, tmp_path: Path) -> None:
    """Expected: of the record's rows from 0.1 s to 0.3 s, a length and a force, whose units have an axis each."""
    fresh.evaluate("document.querySelector('#own details').open = true")
    for name in ("length of legs: leg 3", "actuator force: leg 2"):
        fresh.select_option("#signals", label=name)
    until(fresh, "GoughStewart.panels.at(-1).figure?.figure.yaxes.length === 2")
    fresh.evaluate("GoughStewart.mark([0.1, 0.3])")
    rows = slice(100, 301)
    columns = {"length of legs: leg 3 [m]": record["leg_length"][rows, 2]}
    columns["actuator force: leg 2 [N]"] = record["actuator_force"][rows, 1]
    for k, (name, values) in enumerate(columns.items()):
        texts = fresh.locator("#own tbody tr").nth(k).locator("th, td").all_inner_texts()
        expected = [values[0], values[-1], values[-1] - values[0], values.min(), values.max(), values.mean()]
        assert texts[0] == name
        shown = [float(text.replace("−", "-")) for text in texts[1:]]
        assert shown == pytest.approx(expected, rel=1e-3, abs=2e-3 if k else 1e-5)
    with fresh.expect_download() as saved:
        fresh.get_by_role("button", name="save rows as CSV").click()
    saved.value.save_as(tmp_path / "rows.csv")
    head, *rows_of_file = (tmp_path / "rows.csv").read_text(encoding="utf-8").splitlines()
    assert head == ",".join(f'"{name}"' for name in ("time [s]", *columns))
    table = np.array([line.split(",") for line in rows_of_file], dtype=float)
    assert table[:, 0] == pytest.approx(record["time"][rows], abs=1e-9)
    for k, values in enumerate(columns.values()):
        assert table[:, k + 1] == pytest.approx(values, rel=1e-6, abs=1e-3 if k else 1e-6)
    fresh.get_by_role("button", name="empty").click()
    assert fresh.locator("#own figure").count() == 0


def test_words_are_explained_where_a_reader_points(fresh: Page) -> None:
    """Expected: by pointer and by keyboard; Escape hides it."""
    fresh.evaluate("scrollTo(0, 0)")
    term, tip = fresh.locator(".term:visible").first, fresh.locator("#tip")
    term.hover()
    assert tip.inner_text() == term.get_attribute("data-means")
    fresh.mouse.move(1, 1)
    assert tip.is_hidden()
    term.focus()
    assert tip.is_visible()
    assert term.get_attribute("aria-describedby") == "tip"
    fresh.keyboard.press("Escape")
    assert tip.is_hidden()


def test_each_chart_has_a_name_that_says_what_it_shows(fresh: Page, record: gs.Record, platform: gs.Platform) -> None:
    """Expected: title, axis, lines, extremes of the record to four digits, limits, and the share of rows at a limit."""
    box_of(fresh, FORCE)
    low, high = (f"{pick(record['actuator_force']):.4g}".replace("-", "−") for pick in (np.min, np.max))
    legs = "; ".join(f"leg {k}" for k in range(1, 7))
    shares = (record["flag.force_limited"] > 0, np.abs(record["leg_velocity"]) > platform.leg_velocity_max)
    force, speed = (f"{100 * each[:-1].any(axis=1).mean():.2g} %" for each in shares)
    limits = f"force at its limit, {force} of the time; leg speed beyond its limit, {speed} of the time"
    expected = f"Chart of actuator force over time [s]: {legs}; values from {low} to {high} N; {limits}."
    assert of_panel(fresh, FORCE, ".plot.getAttribute('aria-label')") == expected
