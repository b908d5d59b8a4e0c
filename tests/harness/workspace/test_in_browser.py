"""The page of a workspace in a real browser: it loads in silence, and tells at the pointer what was computed."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser
from scipy.interpolate import RegularGridInterpolator

import gough_stewart as gs
from tests.support.browser import Watched, open_report, until
from tests.support.commands import invoke

PRESET = "desktop_hexapod"
OVER = {"x": (-0.12, 0.14), "y": (-0.13, 0.12), "z": (0.09, 0.21)}
LIMITS = ("reachable", "pitch at ±90°", "beyond a singular pose", "a leg too short", "a leg too long",
          "angle of a base joint", "angle of a platform joint")  # fmt: skip
FIGURES = "GoughStewart.panels.filter((p) => p.figure)"


@pytest.fixture(scope="module")
def space() -> Any:
    return gs.sweep(gs.load_preset(PRESET), OVER, points=9)


@pytest.fixture(scope="module")
def volume(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    over = ",".join(f"{name}={low}:{high}" for name, (low, high) in OVER.items())
    folder = tmp_path_factory.mktemp("volume")
    words = ("--preset", PRESET, "--over", over, "--points", "9", "--report", "--out", str(folder))
    assert invoke("workspace", *words).exit_code == 0
    with open_report(browser, folder / "report.html", size=(1000, 640)) as found:
        until(found.page, "GoughStewart.ready.all === true")
        yield found


def told(volume: Watched, chart: int) -> list[str]:
    shown = (
        "[...document.querySelectorAll('figure.chart')].find((f) => f.dataset.chart === '%d').querySelector('.pointed')"
    )
    lines = f"[...{shown % chart}.children].map((each) => each.textContent)"
    found: list[str] = volume.page.evaluate(f"{shown % chart}.hidden ? [] : {lines}")
    return found


def expected(space: Any, index: tuple[int, ...]) -> list[str]:
    """By the pose alone, in the words of the page."""
    at = dict(space.fixed) | {name: values[k] for k, (name, values) in zip(index, space.swept.items(), strict=True)}
    pose = np.array([at[name] for name in ("x", "y", "z", "roll", "pitch", "yaw")])
    q = gs.evaluate_poses(space.platform, pose[:3], pose[3:])
    numbers = (
        ("condition number", q.condition_number, ""),
        ("largest payload", q.payload, "kg"),
        ("force margin", q.force_margin, "N"),
        ("largest speed", 1e3 * np.asarray(q.largest_speed), "mm/s"),
        ("stroke left", 1e3 * np.asarray(q.leg_length_margin), "mm"),
        ("joint angle left", np.degrees(np.asarray(q.joint_angle_margin)), "deg"),
    )
    texts = [f"{name} {float(f'{float(np.asarray(value)):.4g}'):g} {unit}".strip() for name, value, unit in numbers]
    place = ", ".join(f"{name} {1e3 * at[name]:.4g} mm" for name in space.swept)
    return [text.replace("-", "−") for text in (place, LIMITS[int(q.limit)], *texts)]


def test_a_pose_under_the_pointer_tells_all_its_values_in_every_map(volume: Watched, space: Any) -> None:
    """Expected: those of the pose by itself, of every result, in each map; arrows go to the next pose."""
    page = volume.page
    for chart in (0, 2):
        plot = page.locator(f"figure.chart[data-chart='{chart}'] .plot")
        plot.scroll_into_view_if_needed()
        plot.focus()
        # from the middle of the grid
        for key in ("ArrowLeft", "ArrowUp", "ArrowUp"):
            page.keyboard.press(key)
        level = page.evaluate("GoughStewart.sliceOf(GoughStewart.page.charts[0])")
        # the same poses for both maps: what one shows, the other continues
        index = (3, 6, level) if chart == 0 else (2, 8, level)
        assert told(volume, chart) == expected(space, index)
    box = page.locator("figure.chart[data-chart='2'] .plot").bounding_box()
    assert box is not None
    at = page.evaluate(
        "(() => { const p = GoughStewart.panels.find((each) => each.chart === GoughStewart.page.charts[2]);"
        "const { data, view: { frame } } = p.figure;"
        "return [frame.x_scale.compute(data.x[5]), frame.y_scale.compute(data.rows[1])]; })()"
    )
    page.mouse.move(box["x"] + at[0], box["y"] + at[1])
    assert told(volume, 2) == expected(space, (5, 1, level))
    assert told(volume, 0) == []


def test_a_slice_is_that_of_all_maps_of_the_sheet_and_of_the_link(volume: Watched, space: Any) -> None:
    """Expected: the third coordinate of the grid; border and colours are those of its poses; the surface is drawn."""
    page, z = volume.page, space.swept["z"]
    page.locator("#slice").focus()
    page.keyboard.press("Home")
    assert page.locator(".slices output").text_content() == f"{1e3 * z[0]:.4g} mm"
    for _ in range(4):
        page.keyboard.press("ArrowRight")
    assert page.locator(".slices output").text_content() == f"{1e3 * z[4]:.4g} mm"
    assert "slice=4" in page.evaluate("GoughStewart.link()")
    # the box is scaled to its longest side, 0.26 m, which becomes 1.9
    assert page.evaluate("GoughStewart.surface.height()") == pytest.approx((z[4] - (z[0] + z[-1]) / 2) * 1.9 / 0.26)
    image = page.evaluate(
        "(() => { const { heat } = GoughStewart.panels[0].figure, { values, shape } = heat.map.image(4);"
        "return { values: [...values], shape, border: heat.map.border(4), field: [...heat.map.inside] }; })()"
    )
    rows, columns = image["shape"]
    pixels, times = np.array(image["values"]).reshape(rows, columns), rows // 9
    # pixels at the points of the grid have the kind of their pose
    assert (pixels[times // 2 :: times, times // 2 :: times] == space.qualities.limit[..., 4].T).all()
    x, y = (1e3 * space.swept[name] for name in "xy")
    border = np.array([image["border"]["y"], image["border"]["x"]]).T
    ends = border[np.isfinite(border).all(axis=1)]
    assert len(ends) == 2 * len(border) / 3 > 16
    assert (ends >= (y[0], x[0])).all()
    assert (ends <= (y[-1], x[-1])).all()
    # by linear interpolation along the edges of cells
    field = np.array(image["field"]).reshape(9, 9, 9)[4]
    assert np.abs(RegularGridInterpolator((y, x), field)(ends)).max() < 1e-6 * np.abs(field).max()
    drawn, triangles = page.evaluate("[GoughStewart.surface.pixels(), GoughStewart.surface.triangles]")
    assert triangles > 500
    assert drawn >= triangles + 2


def test_paper_is_the_same_from_a_dark_page_and_names_the_slice(volume: Watched, space: Any) -> None:
    """Expected: seven drawings, of a light and of a dark page alike; the third coordinate in each key."""
    page, drawings = volume.page, []
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        until(page, f"GoughStewart.theme().dark === {'true' if scheme == 'dark' else 'false'}")
        page.wait_for_timeout(200)
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
        papers = page.evaluate("[...document.querySelectorAll('.paper')].map((each) => each.innerHTML)")
        # names of clip paths are drawn at random
        drawings.append([re.sub(r'(id="|url\(#)\w+', "", paper) for paper in papers])
        level = page.evaluate("GoughStewart.sliceOf(GoughStewart.page.charts[0])")
        keys = page.eval_on_selector_all(".key", "all => all.map((each) => each.textContent)")
        assert all(f"at z {1e3 * space.swept['z'][level]:.4g} mm" in key for key in keys)
        page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert len(drawings[0]) == 7
    assert drawings[0] == drawings[1]
    page.emulate_media(color_scheme="light")


def test_a_zoom_of_one_map_is_that_of_all_and_a_double_click_ends_it(volume: Watched) -> None:
    """Expected: the box that the pointer has drawn, in millimetres; with one scale it has the shape of the maps."""
    page = volume.page
    sides = "[f.x_range.start, f.x_range.end, f.y_range.start, f.y_range.end]"
    ends = f"{FIGURES}.map(({{ figure: {{ figure: f }} }}) => {sides})"
    plot = page.locator(".chart.heat .plot").first
    plot.scroll_into_view_if_needed()
    whole = page.evaluate(ends)
    assert len(whole) == 7
    box = plot.bounding_box()
    assert box is not None
    place = page.evaluate("GoughStewart.panels[0].figure.place()")

    def at(across: float, down: float) -> tuple[float, float]:
        left, top = box["x"] + place["left"], box["y"] + place["top"]
        return left + across * place["width"], top + down * place["height"]

    page.mouse.move(*at(0.4, 0.4))
    page.mouse.down()
    page.mouse.move(*at(0.6, 0.6), steps=4)
    page.mouse.up()
    x0, x1, y0, y1 = whole[0]
    zoomed = [x0 + 0.4 * (x1 - x0), x0 + 0.6 * (x1 - x0), y0 + 0.4 * (y1 - y0), y0 + 0.6 * (y1 - y0)]
    for shown, before in zip(page.evaluate(ends), whole, strict=True):
        assert shown[::2] < shown[1::2]
        scale = (shown[1] - shown[0]) / (before[1] - before[0])
        # no less than the box; maps of another shape show more on one side
        assert 0.19 < scale < 0.4
        middle = [(shown[0] + shown[1]) / 2, (shown[2] + shown[3]) / 2]
        assert middle == pytest.approx([(zoomed[0] + zoomed[1]) / 2, (zoomed[2] + zoomed[3]) / 2], abs=1)
    assert page.evaluate(ends)[0] == pytest.approx(zoomed, abs=0.01 * (x1 - x0))
    page.mouse.dblclick(*at(0.5, 0.5))
    assert page.evaluate(ends) == whole
