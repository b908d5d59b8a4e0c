"""The page of a record in a real browser: it loads in silence, plays, scrubs, and shows what the record says."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.run_charts import leg_parts
from gough_stewart.harness.view.view import view_page
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform, load_preset
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.browser import Watched, open_report, until, watched
from tests.support.records import waving_record


def drawn(page: Page, record: int = 0) -> dict[str, Any]:
    """What is in the scene, in metres and world axes."""
    page.evaluate("new Promise(requestAnimationFrame)")
    found: dict[str, Any] = page.evaluate("GoughStewart.player.drawn()")[record]
    return found


def scrub(page: Page, time: float) -> None:
    """As a hand on the slider does it."""
    page.evaluate(
        "time => { const slider = document.getElementById('time'); slider.value = time;"
        " slider.dispatchEvent(new Event('input')); }",
        time,
    )


def test_the_page_plays_by_itself_in_silence(browser: Browser, report: Path) -> None:
    """Expected: time goes on at the speed of the clock, as far as frames come; no complaint, no request.

    Chromium draws in software here: the first chart comes before the first picture, which holds everything up.
    """
    found = open_report(browser, report)
    page = found.page
    marks = [f"performance.getEntriesByName('{name}')[0].startTime" for name in ("curves", "first-picture")]
    chart, picture = page.evaluate(f"[{', '.join(marks)}]")
    assert chart < picture
    assert page.evaluate("GoughStewart.player.playing")
    page.select_option("#speed", "0.05")
    before = page.evaluate("[GoughStewart.player.time, performance.now()]")
    until(page, f"GoughStewart.player.time !== {before[0]}")
    page.wait_for_timeout(600)
    after = page.evaluate("[GoughStewart.player.time, performance.now()]")
    assert 0 < (after[0] - before[0]) % 0.5 <= 0.05 * (after[1] - before[1]) / 1000 + 0.02
    page.click("#play")
    stopped = page.evaluate("GoughStewart.player.time")
    page.wait_for_timeout(200)
    assert page.evaluate("GoughStewart.player.time") == stopped
    assert found.errors == []
    assert found.requests == [report.as_uri()]
    page.close()


@pytest.mark.parametrize("row", [0, 1, 137, 250, 499, 500])
def test_the_pose_shown_is_the_pose_of_the_row(one: Watched, record: Record, platform: Platform, row: int) -> None:
    """Expected: position and R of the row, joints where kinematics has them, legs from B_i to P_i and of its length."""
    scrub(one.page, record["time"][row])
    shown = drawn(one.page)
    position, orientation = record["position"][row], record["orientation"][row]
    assert shown["position"] == pytest.approx(position, abs=1e-9)
    assert np.array(shown["rotation"]) == pytest.approx(matrix_from_orientation(orientation), abs=1e-9)
    assert shown["reference"] == pytest.approx(record["reference.position"][row], abs=1e-9)
    legs = leg_geometry(platform, position, orientation)
    lower, upper = leg_parts(record["leg_length"], platform)
    for k, leg in enumerate(shown["legs"]):
        B, P, u = platform.base_points[k], position + legs.arm[k], legs.direction[k]
        for end, point in (("foot", B), ("head", P), ("sleeveEnd", B + lower * u), ("rodEnd", P - upper * u)):
            assert leg[end] == pytest.approx(point, abs=1e-6), (k, end)
        assert np.linalg.norm(np.subtract(leg["head"], leg["foot"])) == pytest.approx(record["leg_length"][row, k])


def test_between_two_frames_is_a_straight_line(one: Watched, record: Record) -> None:
    """Expected: the mean of both positions at half time."""
    one.page.evaluate("time => GoughStewart.player.seek(time)", float(record["time"][100:102].mean()))
    assert drawn(one.page)["position"] == pytest.approx(record["position"][100:102].mean(axis=0), abs=1e-12)


def test_the_clock_and_the_table_tell_the_moment(one: Watched, record: Record) -> None:
    scrub(one.page, record["time"][200])
    assert one.page.inner_text("#clock").startswith("0.2")
    said = one.page.inner_text("#now").replace("−", "-")
    for number in (f"{record['position'][200, 0]:.4f}", f"{record['leg_length'][200, 5]:.4f}"):
        assert number in said


def test_legs_change_colour_with_force_and_with_nearness(one: Watched, record: Record) -> None:
    """Expected: pushing legs are more red than blue, pulling ones the other way round; plain legs are all alike."""
    page = one.page
    row = int(np.abs(record["actuator_force"]).min(axis=1).argmax())
    scrub(page, record["time"][row])
    page.select_option("#colour", "force")
    for leg, force in zip(drawn(page)["legs"], record["actuator_force"][row], strict=True):
        assert (leg["colour"][0] > leg["colour"][2]) == (force > 0)
    page.select_option("#colour", "nearness")
    # the force of some leg is at its limit at some row: there it is dark red
    at_limit = np.argwhere(np.abs(record["actuator_force"]) > 99.9)[0]
    scrub(page, record["time"][at_limit[0]])
    red, green, _ = drawn(page)["legs"][at_limit[1]]["colour"]
    assert red > 3 * green
    page.select_option("#colour", "plain")
    assert len({tuple(leg["colour"]) for leg in drawn(page)["legs"]}) == 1


@pytest.mark.parametrize("by", ["left", "right", "wheel"])
def test_dragging_and_the_wheel_change_the_view(one: Watched, by: Literal["left", "right", "wheel"]) -> None:
    """Expected: another picture of the same scene, turned, moved, and nearer."""
    view = one.page.locator("#view")
    before, pose = view.screenshot(), drawn(one.page)
    box = view.bounding_box()
    assert box is not None
    one.page.mouse.move(box["x"] + 200, box["y"] + 150)
    if by == "wheel":
        one.page.mouse.wheel(0, -300)
    else:
        one.page.mouse.down(button=by)
        one.page.mouse.move(box["x"] + 330, box["y"] + 170, steps=4)
        one.page.mouse.up(button=by)
    assert drawn(one.page) == pose
    one.page.wait_for_timeout(100)
    assert view.screenshot() != before


def test_records_lie_over_each_other_and_can_be_hidden(browser: Browser, record: Record, tmp_path: Path) -> None:
    """Expected: each at its own pose of the moment, also where one has ended.

    Arrows go to the next row of either, and a hidden record leaves the scene.
    """
    other = waving_record(load_preset("motion_base"), rows=251, size=0.02, step=1.7e-3)
    path = tmp_path / "both.html"
    path.write_bytes(view_page([record, other], ["long", "short"]))
    found = open_report(browser, path, 0.45)
    page = found.page
    for k, (each, row) in enumerate(((record, 450), (other, 250))):
        assert drawn(page, k)["position"] == pytest.approx(each["position"][row], abs=1e-9)
    scrub(page, record["time"][200])
    for key, time in (("ArrowRight", other["time"][118]), ("ArrowRight", record["time"][201])):
        page.keyboard.press(key)
        assert page.evaluate("GoughStewart.player.time") == time
    view = page.locator("#view")
    both = view.screenshot()
    page.uncheck("#runs input >> nth=0")
    assert view.screenshot() != both
    assert found.errors == []
    page.close()


def test_the_policy_stops_other_scripts_and_forms(browser: Browser, report: Path) -> None:
    """Expected: a script that is not the page's own does not run, a form does not leave; both are complained of."""
    found = watched(browser)
    found.page.goto(report.as_uri())
    found.page.evaluate(
        "document.body.append(Object.assign(document.createElement('script'), {textContent: 'window.foreign = true'}))"
    )
    found.page.evaluate(
        "() => { const form = document.createElement('form');"
        " Object.assign(form, {action: 'http://127.0.0.1:9/', method: 'post'});"
        " document.body.append(form); form.submit(); }"
    )
    for _ in range(200):
        if len(found.errors) >= 2:
            break
        found.page.wait_for_timeout(20)
    assert found.page.evaluate("window.foreign === undefined")
    assert [error for error in found.errors if "Content Security Policy" in error] == found.errors
    assert len(found.errors) == 2
    assert [address for address in found.requests if not address.startswith("file:")] == []
    found.page.close()


def test_without_webgl_curves_and_tables_are_still_there(browser: Browser, report: Path) -> None:
    page = browser.new_page()
    page.add_init_script(
        "const own = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...more) {"
        "  return kind.includes('webgl') ? null : own.call(this, kind, ...more); };"
    )
    page.goto(report.as_uri())
    until(page, "GoughStewart.ready.curves")
    assert "no 3-D graphics" in page.inner_text("#no-view")
    page.locator("figure.chart").first.scroll_into_view_if_needed()
    until(page, "GoughStewart.panels[0].figure !== null")
    assert "Tracking error" in page.inner_text("main")
    page.click("#play")
    page.close()


def test_a_reader_who_wants_no_motion_gets_none(browser: Browser, report: Path) -> None:
    """Expected: the animation stands at its start, until it is asked to play."""
    page = browser.new_page(reduced_motion="reduce")
    page.goto(report.as_uri())
    until(page, "GoughStewart.ready.picture")
    page.wait_for_timeout(200)
    assert page.evaluate("[GoughStewart.state.playing, GoughStewart.state.time]") == [False, 0]
    page.keyboard.press("Space")
    until(page, "GoughStewart.state.time > 0")
    page.close()
