"""The 3-D stage of a page in a real browser: it plays in silence, shows what the record says, and obeys its reader."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from gough_stewart import Record
from tests.harness.view.colour_vision import rgb_of
from tests.support.arrays import FloatArray
from tests.support.axe import violations
from tests.support.browser import Watched, open_report, until
from tests.support.records import Floats, waving_record


def drawn(page: Page, run: int = 0) -> dict[str, Any]:
    found: dict[str, Any] = page.evaluate("GoughStewart.player.drawn()")[run]
    return found


def stage(page: Page) -> dict[str, Any]:
    found: dict[str, Any] = page.evaluate(
        "(({ground, sun, camera, target}) => ({ground, sun, camera, target}))(GoughStewart.player.stage())"
    )
    return found


def seek(page: Page, record: Record, row: int) -> None:
    page.evaluate(
        "time => { GoughStewart.player.pause(); GoughStewart.player.seek(time); }", float(record["time"][row])
    )


def pixels(page: Page) -> FloatArray:
    """The view at rest (height, width, 3)."""
    until(page, "GoughStewart.player.stage().still")
    picture = Image.open(io.BytesIO(page.locator("#view").screenshot()))
    return np.asarray(picture.convert("RGB"), dtype=float)


def seen(page: Page, points: FloatArray) -> FloatArray:
    """Where on the view points of the room are seen (n, 2) [pixels]: column, row."""
    return np.array(page.evaluate("points => points.map(GoughStewart.player.stage().seen)", points.tolist()))


def at(picture: FloatArray, places: FloatArray) -> FloatArray:
    columns, rows = np.round(places).astype(int).T
    return np.asarray(picture[rows, columns])


# Later, the external force draws an arrow over the platform.
QUIET_ROW = 60
# Drawn in software, pixels are what costs.
SIZE = (460, 480)


@pytest.fixture(scope="module")
def playing(browser: Browser, report: Path) -> Iterator[Watched]:
    """The page of one record, which plays at first."""
    with open_report(browser, report, size=SIZE) as found:
        yield found


@pytest.fixture
def one(playing: Watched) -> Watched:
    """The same, at rest."""
    playing.page.evaluate("GoughStewart.player.pause()")
    return playing


def scrub(page: Page, time: float) -> None:
    """As a hand on the slider does it."""
    page.evaluate(
        "time => { const slider = document.getElementById('time'); slider.value = time;"
        " slider.dispatchEvent(new Event('input')); }",
        time,
    )
    page.evaluate("new Promise(requestAnimationFrame)")


def of_first_chart(page: Page, share: float) -> list[float]:
    """Where a share of the width of its plotted part is on the screen."""
    found: list[float] = page.evaluate(
        """share => { const [{ plot, figure }] = GoughStewart.panels, place = figure.place();
        const box = plot.getBoundingClientRect();
        return [box.left + place.left + share * place.width, box.top + place.top + 40]; }""",
        share,
    )
    return found


def rotation(orientation: Floats) -> Floats:
    return np.asarray(Rotation.from_euler("xyz", np.array(orientation)).as_matrix())


def test_the_page_plays_by_itself_in_silence(playing: Watched, report: Path) -> None:
    """Expected: time goes on at the speed of the clock, as far as frames come; no complaint, no request."""
    found, page = playing, playing.page
    marks = [f"performance.getEntriesByName('{name}')[0].startTime" for name in ("curves", "first-picture")]
    chart, picture = page.evaluate(f"[{', '.join(marks)}]")
    assert chart < picture
    assert page.evaluate("GoughStewart.player.playing")
    page.select_option("#speed", "0.05")
    before = page.evaluate("[GoughStewart.player.time, performance.now()]")
    until(page, f"GoughStewart.player.time !== {before[0]}")
    page.wait_for_timeout(400)
    after = page.evaluate("[GoughStewart.player.time, performance.now()]")
    assert 0 < (after[0] - before[0]) % 0.5 <= 0.05 * (after[1] - before[1]) / 1000 + 0.02
    page.click("#play")
    stopped = page.evaluate("GoughStewart.player.time")
    page.wait_for_timeout(60)
    assert page.evaluate("GoughStewart.player.time") == stopped
    assert (found.errors, found.requests) == ([], [report.as_uri()])
    # the policy: a script that is not the page's own does not run, a form does not leave
    page.evaluate(
        "document.body.append(Object.assign(document.createElement('script'), {textContent: 'window.foreign = true'}))"
    )
    page.evaluate(
        "() => { const form = document.createElement('form');"
        " Object.assign(form, {action: 'http://127.0.0.1:9/', method: 'post'});"
        " document.body.append(form); form.submit(); }"
    )
    for _ in range(200):
        if len(found.errors) >= 2:
            break
        page.wait_for_timeout(20)
    assert page.evaluate("window.foreign === undefined")
    assert ["Content Security Policy" in error for error in found.errors] == [True, True]
    found.errors.clear()


@pytest.mark.parametrize("row", [0, 137, 500])
def test_the_moment_shown_is_that_of_the_row(one: Watched, record: gs.Record, platform: gs.Platform, row: int) -> None:
    """Expected: position and R of the row, legs from B_i to P_i and of its length, parts along them; clock, table."""
    scrub(one.page, record["time"][row])
    shown = drawn(one.page)
    position, orientation = record["position"][row], record["orientation"][row]
    assert shown["position"] == pytest.approx(position, abs=1e-9)
    assert np.array(shown["rotation"]) == pytest.approx(rotation(orientation), abs=1e-9)
    assert shown["reference"] == pytest.approx(record["reference.position"][row], abs=1e-9)
    scene: Any = next(part for part in record.report().parts() if type(part).__name__ == "Scene")
    legs = gs.leg_geometry(platform, position, orientation)
    for k, leg in enumerate(shown["legs"]):
        B, u = platform.base_points[k], legs.direction[k]
        P = B + record["leg_length"][row, k] * u
        ends = {"foot": B, "head": P, "sleeveEnd": B + scene.lower * u, "rodEnd": P - scene.upper * u}
        for end, point in ends.items():
            assert leg[end] == pytest.approx(point, abs=1e-6), (k, end)
    assert one.page.inner_text("#clock").startswith(f"{record['time'][row]:.3f}")
    said = one.page.inner_text("#now").replace("−", "-")
    for number in (f"{position[0]:.4f}", f"{record['leg_length'][row, 5]:.4f}"):
        assert number.removeprefix("-") in said
    if row < 500:
        one.page.evaluate("time => GoughStewart.player.seek(time)", float(record["time"][row : row + 2].mean()))
        assert drawn(one.page)["position"] == pytest.approx(record["position"][row : row + 2].mean(axis=0), abs=1e-12)


def test_legs_change_colour_with_force_and_with_nearness(one: Watched, record: gs.Record) -> None:
    """Expected: pushing legs are more red than blue, pulling ones the other way round; plain legs are all alike."""
    page, force = one.page, record["actuator_force"]
    row = int(np.abs(force).min(axis=1).argmax())
    scrub(page, record["time"][row])
    page.select_option("#colour", "force")
    reds = [leg["colour"][0] > leg["colour"][2] for leg in drawn(page)["legs"]]
    assert reds == (force[row] > 0).tolist()
    page.select_option("#colour", "nearness")
    # the force of some leg is at its limit at some row: there it is dark red
    at_limit, leg = np.argwhere(np.abs(force) > 99.9)[0]
    scrub(page, record["time"][at_limit])
    red, green, _ = drawn(page)["legs"][leg]["colour"]
    assert red > 3 * green
    # and within rounding of the limit it is the same
    shades = page.evaluate("[1, 1 + 1e-12].map(GoughStewart.gradient(GoughStewart.page.nearness.stops))")
    assert shades[0] == shades[1]
    page.select_option("#colour", "plain")
    assert len({tuple(leg["colour"]) for leg in drawn(page)["legs"]}) == 1


def test_a_time_under_the_pointer_in_a_chart_is_that_of_the_scene(one: Watched, record: gs.Record) -> None:
    """Expected: at 30 % of the width that of 0.15 s; elsewhere the time at which it stands."""
    page = one.page
    seek(page, record, 0)
    page.locator("figure.chart").first.scroll_into_view_if_needed()
    until(page, "GoughStewart.panels[0].figure !== null")
    page.mouse.move(*of_first_chart(page, 0.3))
    until(page, "Math.abs(GoughStewart.shownTime() - 0.15) < 0.002")
    assert drawn(page)["position"] == pytest.approx(record["position"][150], abs=1e-3)
    page.mouse.move(2, 2)
    until(page, "GoughStewart.shownTime() === 0")
    assert drawn(page)["position"] == pytest.approx(record["position"][0], abs=1e-9)


def test_a_leg_is_picked_by_a_click_and_the_others_step_back(one: Watched) -> None:
    page = one.page

    def colours() -> list[list[float]]:
        return [leg["colour"] for leg in drawn(page)["legs"]]

    page.evaluate("scrollTo(0, 0)")
    plain, leg = colours(), drawn(page)["legs"][4]
    ((x, y),) = seen(page, (np.array(leg["foot"]) + leg["head"])[None] / 2)
    view = page.locator("#view").bounding_box()
    assert view is not None
    page.mouse.click(view["x"] + x, view["y"] + y)
    assert page.evaluate("GoughStewart.state.leg") == 5
    page.evaluate("new Promise(requestAnimationFrame)")
    changed = [one != other for one, other in zip(plain, colours(), strict=True)]
    page.keyboard.press("Escape")
    assert changed == [True] * 4 + [False, True]
    assert page.evaluate("GoughStewart.state.leg") is None


@pytest.mark.parametrize("by", ["left", "right", "wheel"])
def test_dragging_and_the_wheel_change_the_view(one: Watched, by: Literal["left", "right", "wheel"]) -> None:
    """Expected: the same scene, seen from a camera that has turned about its target, moved with it, or come nearer."""
    before, pose, box = stage(one.page), drawn(one.page), one.page.locator("#view").bounding_box()
    assert box is not None
    one.page.mouse.move(box["x"] + 200, box["y"] + 150)
    if by == "wheel":
        one.page.mouse.wheel(0, -300)
        one.page.wait_for_timeout(60)
    else:
        one.page.mouse.down(button=by)
        one.page.mouse.move(box["x"] + 330, box["y"] + 170, steps=4)
        one.page.mouse.up(button=by)
    after = stage(one.page)
    assert drawn(one.page) == pose
    offsets = [np.subtract(each["camera"], each["target"]) for each in (before, after)]
    nearer = np.linalg.norm(offsets[1]) < 0.99 * np.linalg.norm(offsets[0])
    turned = not np.allclose(offsets[1] / np.linalg.norm(offsets[1]), offsets[0] / np.linalg.norm(offsets[0]))
    moved = not np.allclose(before["target"], after["target"])
    assert {"wheel": nearer, "left": turned, "right": moved} == {
        **dict.fromkeys(("wheel", "left", "right"), False), by: True,
    }  # fmt: skip


def test_keys_turn_the_view_where_it_has_the_focus_and_step_elsewhere(one: Watched, record: gs.Record) -> None:
    """Expected: 5° to a press in azimuth or height, a tenth of the distance, a move without a turn, and back home."""
    page = one.page
    page.select_option("#from", "corner")
    seek(page, record, 100)

    def view() -> tuple[float, float, float, Floats]:
        now = stage(page)
        offset = np.subtract(now["camera"], now["target"])
        distance = float(np.linalg.norm(offset))
        return np.arctan2(offset[1], offset[0]), np.arcsin(offset[2] / distance), distance, np.array(now["target"])

    page.focus("#view canvas")
    page.keyboard.press("Home")
    home = view()
    for key, azimuth, height, distance in (
        ("ArrowRight", 5, 0, 1), ("ArrowLeft", -5, 0, 1), ("ArrowUp", 0, 5, 1), ("ArrowDown", 0, -5, 1),
        ("+", 0, 0, 0.9), ("-", 0, 0, 1 / 0.9),
    ):  # fmt: skip
        before = view()
        page.keyboard.press(key)
        after = view()
        turned = np.degrees(np.subtract(after[:2], before[:2]))
        assert (*turned, after[2] / before[2]) == pytest.approx((azimuth, height, distance), abs=1e-6), key
    page.keyboard.press("Shift+ArrowRight")
    moved = view()
    step = moved[3] - home[3]
    assert step @ [-np.sin(home[0]), np.cos(home[0]), 0] == pytest.approx(np.linalg.norm(step)) != 0
    assert moved[:3] == pytest.approx(home[:3])
    for keys in (["ArrowDown"], ["Shift+ArrowDown", "ArrowDown"], ["ArrowDown", "-"]):
        for key in 12 * keys:
            page.keyboard.press(key)
        now = stage(page)
        assert min(now["camera"][2], now["target"][2]) > now["ground"]
        page.keyboard.press("Home")
    assert np.concatenate([view()[3], view()[:3]]) == pytest.approx(np.concatenate([home[3], home[:3]]))
    assert page.evaluate("GoughStewart.player.time") == record["time"][100]
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("GoughStewart.player.time") == record["time"][101]


@pytest.mark.parametrize("factor", [2, 50])
def test_motion_is_drawn_larger_from_home(one: Watched, record: gs.Record, platform: gs.Platform, factor: int) -> None:
    """Expected: p₀ + f (p - p₀), exp(f log(R R₀ᵀ)) R₀ by SciPy, legs from B to the drawn P; numbers as before."""
    page, row = one.page, 137
    seek(page, record, row)
    numbers = page.inner_text("#now")
    page.select_option("#motion", str(factor))
    assert page.inner_text("#enlarged") == f"motion drawn {factor} times larger"
    assert page.inner_text("#now") == numbers
    shown = drawn(page)
    home, R0 = platform.home_position, rotation(platform.home_orientation)
    for name, position, turned in (("", "position", "rotation"), ("reference.", "reference", "referenceRotation")):
        turn = Rotation.from_matrix(rotation(record[f"{name}orientation"][row]) @ R0.T)
        assert shown[position] == pytest.approx(home + factor * (record[f"{name}position"][row] - home), abs=1e-9)
        R = Rotation.from_rotvec(factor * turn.as_rotvec()).as_matrix() @ R0
        assert np.array(shown[turned]) == pytest.approx(R, abs=1e-9)
    for path, name in (("path", "position"), ("referencePath", "reference.position")):
        assert np.array(shown[path]) == pytest.approx(home + factor * (record[name] - home), abs=1e-5)
    for leg, B, b in zip(shown["legs"], platform.base_points, platform.platform_points, strict=True):
        assert leg["foot"] == pytest.approx(B, abs=1e-6)
        assert leg["head"] == pytest.approx(np.array(shown["position"]) + np.array(shown["rotation"]) @ b, abs=1e-5)
    page.select_option("#motion", "1")
    assert page.is_hidden("#enlarged")
    assert drawn(page)["position"] == pytest.approx(record["position"][row], abs=1e-9)


def test_the_picture_of_the_moment_is_saved(one: Watched, record: gs.Record) -> None:
    """Expected: a PNG twice as wide as the view, blue where the plate is, with the moment in its name."""
    page = one.page
    seek(page, record, QUIET_ROW)
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


def test_the_path_is_seen_where_the_plate_would_hide_it(one: Watched, record: gs.Record) -> None:
    """Expected: on nine of ten points of the path, another picture with the path than without; also under the plate."""
    page = one.page
    seek(page, record, QUIET_ROW)
    for box in ("#frames", "#ghost"):
        page.uncheck(box)
    places = seen(page, record["position"][::25])
    with_path = pixels(page)
    page.uncheck("#trail")
    without = pixels(page)
    near = np.array([[dx, dy] for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
    changed = [np.abs(at(with_path, place + near) - at(without, place + near)).max() > 8 for place in places]
    assert np.mean(changed) >= 0.9
    for box in ("#trail", "#frames", "#ghost"):
        page.check(box)


def test_runs_lie_over_each_other_in_their_colours_and_can_be_hidden(
    browser: Browser, record: gs.Record, platform: gs.Platform, tmp_path: Path
) -> None:
    """Expected: each at its own pose in its colour, its plate lighter; shadows where the sun's ray meets the base."""
    other = waving_record(platform, rows=251, size=0.02, step=1.7e-3)
    path = gs.view([record, other], tmp_path / "page.html", names=["run 0", "run 1"])
    with open_report(browser, path, "t=0", SIZE) as found:
        check_two_runs(found.page, record, other, platform)


def check_two_runs(page: Page, record: gs.Record, other: gs.Record, platform: gs.Platform) -> None:
    scrub(page, 0.45)
    for run, (each, row) in enumerate(((record, 450), (other, 250))):
        shown, colour = drawn(page, run), rgb_of(page.evaluate(f"GoughStewart.page.palette.light.six[{run}]"))
        assert shown["position"] == pytest.approx(each["position"][row], abs=1e-9)
        for part in (*(leg["colour"] for leg in shown["legs"]), shown["pathColour"]):
            assert part == pytest.approx(colour, abs=1e-6)
        to_white = (np.array(shown["colour"]) - colour) / (1 - colour)
        assert to_white == pytest.approx(np.full(3, to_white.mean()))
    scrub(page, record["time"][200])
    for key, time in (("ArrowRight", other["time"][118]), ("ArrowRight", record["time"][201])):
        page.keyboard.press(key)
        assert page.evaluate("GoughStewart.player.time") == time
    seek(page, record, 0)
    for box in ("ghost", "frames", "trail"):
        page.uncheck(f"#{box}")
    sun, middle = np.array(stage(page)["sun"]), record["position"][0]
    place = seen(page, (middle - sun * (middle[2] - platform.base_points[:, 2].mean()) / sun[2])[None])
    with_machines = at(pixels(page), place)
    for run in (0, 1):
        page.uncheck(f"#runs input >> nth={run}")
    assert with_machines.mean() < 0.8 * at(pixels(page), place).mean()


def test_fingers_scroll_the_page_turn_the_view_and_tap_times(browser: Browser, report: Path) -> None:
    """Expected: sideways over the view it turns, up it scrolls; a tap on a chart at 60 % of 0.5 s is 0.3 s."""
    context = browser.new_context(
        viewport={"width": 390, "height": 640}, has_touch=True, is_mobile=True, reduced_motion="reduce"
    )
    page = context.new_page()
    page.goto(report.as_uri())
    until(page, "GoughStewart.ready.picture && GoughStewart.ready.curves")
    assert page.evaluate("[GoughStewart.state.playing, GoughStewart.state.time]") == [False, 0]
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    page.click(".stage-options > summary")
    assert (page.is_visible(".by-touch"), page.is_hidden(".by-mouse")) == (True, True)
    page.evaluate("scrollTo(0, 0)")
    box = page.locator("#view").bounding_box()
    assert box is not None
    fingers = context.new_cdp_session(page)

    def swipe(x: float, y: float, dx: float, dy: float) -> None:
        for k in range(11):
            points = [{"x": x + k / 10 * dx, "y": y + k / 10 * dy}]
            kind = "touchMove" if k else "touchStart"
            fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
            page.wait_for_timeout(16)
        fingers.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    home = stage(page)["camera"]
    swipe(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, 120, 0)
    turned = stage(page)["camera"]
    assert np.linalg.norm(np.subtract(turned, home)) > 0.1 * np.linalg.norm(home)
    assert page.evaluate("scrollY") == 0
    swipe(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, 0, -120)
    until(page, "scrollY > 50")
    assert stage(page)["camera"] == pytest.approx(turned)
    plot = page.locator("figure.chart .plot").first
    plot.scroll_into_view_if_needed()
    page.wait_for_timeout(200)
    box, before = plot.bounding_box(), page.evaluate("scrollY")
    assert box is not None
    swipe(box["x"] + 150, box["y"] + box["height"] / 2, 0, -150)
    until(page, f"scrollY > {before + 80}")
    page.wait_for_timeout(200)
    assert page.evaluate("[GoughStewart.player.time, GoughStewart.state.region]") == [0, None]
    page.touchscreen.tap(*of_first_chart(page, 0.6))
    until(page, "Math.abs(GoughStewart.player.time - 0.3) < 0.005")
    page.keyboard.press("Space")
    until(page, "GoughStewart.player.playing && GoughStewart.state.time !== 0.3")
    context.close()


def test_the_dark_stage_prints_light(one: Watched) -> None:
    """Expected: dark corners on a dark screen; on paper a picture with light ones instead, and no controls."""
    page = one.page
    page.evaluate("scrollTo(0, 0)")
    page.emulate_media(color_scheme="dark")
    until(page, "document.documentElement.dataset.theme === 'dark'")
    assert pixels(page)[[5, 5], [5, -5]].max() < 60
    assert violations(page) == []
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    assert (page.is_hidden("#view"), page.is_hidden("#play")) == (True, True)
    printed = np.asarray(Image.open(io.BytesIO(page.locator("#printed").screenshot())).convert("RGB"), dtype=float)
    assert printed[[5, 5], [5, -5]].min() > 200
    # the blue of the plate is in the picture
    assert ((printed[..., 2] - printed[..., 0]) > 60).sum() > 500
    page.emulate_media(media="screen", color_scheme="light")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
