"""The page of a workspace in a real browser: it loads in silence, and tells at the pointer what was computed."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from gough_stewart import evaluate_poses, load_preset, sweep
from gough_stewart.harness.report.page import page_of
from gough_stewart.harness.report.palette import INK
from gough_stewart.harness.workspace.workspace_report import workspace_report
from gough_stewart.model.workspace import Limit, Workspace
from tests.support.browser import Watched, until, watched


def _opened(browser: Browser, space: Workspace, path: Path, address: str = "") -> Watched:
    path.write_bytes(page_of(workspace_report(space)))
    found = watched(browser, 1440, 900)
    found.page.goto(path.as_uri() + address)
    until(found.page, "GoughStewart.ready.all === true")
    return found


@pytest.fixture(scope="module")
def volume(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Watched, Workspace]]:
    over = {"x": (-0.05, 0.07), "y": (-0.06, 0.05), "z": (0.11, 0.19)}
    space = sweep(load_preset("desktop_hexapod"), over, points=9)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gough_stewart.harness.workspace.isosurface._CELLS", 10)
        found = _opened(browser, space, tmp_path_factory.mktemp("volume") / "report.html")
    yield found, space
    found.page.close()


def _told(page: Watched, chart: int) -> list[str]:
    shown = (
        "[...document.querySelectorAll('figure.chart')].find((f) => f.dataset.chart === '%d').querySelector('.pointed')"
    )
    lines = f"[...{shown % chart}.children].map((each) => each.textContent)"
    found: list[str] = page.page.evaluate(f"{shown % chart}.hidden ? [] : {lines}")
    return found


def _expected(space: Workspace, index: tuple[int, ...]) -> list[str]:
    """By the pose alone, in the words of the page."""
    at = dict(space.fixed) | {name: values[k] for k, (name, values) in zip(index, space.swept.items(), strict=True)}
    pose = np.array([at[name] for name in ("x", "y", "z", "roll", "pitch", "yaw")])
    q = evaluate_poses(space.platform, pose[:3], pose[3:])
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
    return [text.replace("-", "−") for text in (place, Limit(int(q.limit)).text, *texts)]


def test_a_pose_under_the_pointer_tells_all_its_values_in_every_map(volume: tuple[Watched, Workspace]) -> None:
    """Expected: those of the pose by itself, of every result, in each map; arrows go to the next pose."""
    found, space = volume
    page = found.page
    for chart in (0, 2):
        plot = page.locator(f"figure.chart[data-chart='{chart}'] .plot")
        plot.scroll_into_view_if_needed()
        plot.focus()
        # from the middle of the grid
        for key, count in (("ArrowLeft", 1), ("ArrowUp", 2)):
            for _ in range(count):
                page.keyboard.press(key)
        level = page.evaluate("GoughStewart.sliceOf(GoughStewart.page.charts[0])")
        # the same poses for both maps: what one shows, the other continues
        index = (3, 6, level) if chart == 0 else (2, 8, level)
        assert _told(found, chart) == _expected(space, index)
    box = page.locator("figure.chart[data-chart='2'] .plot").bounding_box()
    assert box is not None
    at = page.evaluate(
        "(() => { const p = GoughStewart.panels.find((each) => each.chart === GoughStewart.page.charts[2]);"
        "const { data, view: { frame } } = p.figure;"
        "return [frame.x_scale.compute(data.x[5]), frame.y_scale.compute(data.rows[1])]; })()"
    )
    page.mouse.move(box["x"] + at[0], box["y"] + at[1])
    assert _told(found, 2) == _expected(space, (5, 1, level))
    assert _told(found, 0) == []
    assert found.errors == []


def test_a_slice_is_that_of_all_maps_of_the_sheet_and_of_the_link(volume: tuple[Watched, Workspace]) -> None:
    """Expected: the third coordinate of the grid; border and colours are those of its poses."""
    found, space = volume
    page = found.page
    page.locator("#slice").focus()
    page.keyboard.press("Home")
    z = space.swept["z"]
    assert page.locator(".slices output").text_content() == f"{1e3 * z[0]:.4g} mm"
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    assert page.locator(".slices output").text_content() == f"{1e3 * z[3]:.4g} mm"
    assert "slice=3" in page.evaluate("GoughStewart.link()")
    height = page.evaluate("GoughStewart.surface.height()")
    # the box is scaled to its longest side, 0.12 m, which becomes 1.9
    assert height == pytest.approx((z[3] - (z[0] + z[-1]) / 2) * 1.9 / 0.12)
    image = page.evaluate(
        "(() => { const { heat } = GoughStewart.panels[0].figure, { values, shape } = heat.map.image(3);"
        "return { values: [...values], shape, border: heat.map.border(3) }; })()"
    )
    rows, columns = image["shape"]
    pixels = np.array(image["values"]).reshape(rows, columns)
    times = rows // 9
    code = space.qualities.limit[..., 3].T
    # pixels at the points of the grid have the kind of their pose
    assert (pixels[times // 2 :: times, times // 2 :: times] == code).all()
    x, y = (1e3 * space.swept[name] for name in "xy")
    assert len(image["border"]["x0"]) > 8
    assert x[0] <= min(image["border"]["x0"]) <= max(image["border"]["x0"]) <= x[-1]
    assert y[0] <= min(image["border"]["y0"]) <= max(image["border"]["y0"]) <= y[-1]
    assert found.errors == []


def test_the_volume_is_drawn_with_all_its_triangles(volume: tuple[Watched, Workspace]) -> None:
    """Expected: WebGL draws the surface and the sheet; nothing is asked for but the page."""
    found, _ = volume
    until(found.page, "GoughStewart.surface !== undefined")
    drawn, triangles = found.page.evaluate("[GoughStewart.surface.pixels(), GoughStewart.surface.triangles]")
    assert triangles > 500
    assert drawn >= triangles + 2
    assert len(found.requests) == 1


def test_paper_is_light_names_the_slice_and_has_the_border_also_from_a_dark_page(
    volume: tuple[Watched, Workspace],
) -> None:
    """Expected: the ink of paper in each drawing, none of the dark page; the third coordinate in each key."""
    found, space = volume
    page = found.page
    page.emulate_media(color_scheme="dark")
    until(page, "GoughStewart.theme().dark")
    page.wait_for_timeout(200)
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    strokes = "[...document.querySelectorAll('.paper')].map((each) => each.innerHTML)"
    drawings = page.evaluate(strokes)
    assert len(drawings) == 7
    for drawing in drawings:
        assert INK["light"] in drawing
        assert INK["dark"] not in drawing
    level = page.evaluate("GoughStewart.sliceOf(GoughStewart.page.charts[0])")
    keys = page.eval_on_selector_all(".key", "all => all.map((each) => each.textContent)")
    assert all(f"at z {1e3 * space.swept['z'][level]:.4g} mm" in key for key in keys)
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    page.emulate_media(color_scheme="light")
    assert found.errors == []


def test_a_zoom_of_one_map_is_that_of_all_and_a_double_click_ends_it(browser: Browser, tmp_path: Path) -> None:
    """Expected: the box that the pointer has drawn, in millimetres; equal scales add to it on one side only."""
    found = _opened(
        browser, sweep(load_preset("desktop_hexapod"), {"x": None, "pitch": None}, points=9), tmp_path / "p.html"
    )
    page = found.page
    ends = (
        "GoughStewart.panels.filter((p) => p.figure).map(({ figure: { figure: f } }) => "
        "[f.x_range.start, f.x_range.end, f.y_range.start, f.y_range.end])"
    )
    whole = page.evaluate(ends)
    assert len(whole) == 7
    assert len({tuple(each) for each in whole}) == 1
    plot = page.locator(".plot").first
    box = plot.bounding_box()
    assert box is not None
    place = page.evaluate("GoughStewart.panels[0].figure.place()")

    def at(across: float, down: float) -> tuple[float, float]:
        left, top = box["x"] + place["left"], box["y"] + place["top"]
        return left + across * place["width"], top + down * place["height"]

    page.mouse.move(*at(0.25, 0.5))
    page.mouse.down()
    page.mouse.move(*at(0.5, 0.75), steps=4)
    page.mouse.up()
    x0, x1, y0, y1 = whole[0]
    expected = [x0 + 0.25 * (x1 - x0), x0 + 0.5 * (x1 - x0), y0 + 0.25 * (y1 - y0), y0 + 0.5 * (y1 - y0)]
    for shown in page.evaluate(ends):
        assert shown == pytest.approx(expected, abs=0.01 * (x1 - x0))
    page.mouse.dblclick(*at(0.4, 0.4))
    assert page.evaluate(ends) == whole
    assert found.errors == []
    page.close()
