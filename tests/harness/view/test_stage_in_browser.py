"""The 3-D stage in a real browser: poses, colours, shadows, paths, paper."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser
from scipy.spatial.transform import Rotation

from gough_stewart.harness.report.palette import colour_of_six
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.view.view import view_page
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.browser import Watched, open_report, until
from tests.support.colour_vision import rgb_of
from tests.support.records import waving_record
from tests.support.stage import at, drawn, pixels, seek, seen, stage

# Later, the external force draws an arrow over the platform.
QUIET_ROW = 60


@pytest.fixture(scope="module")
def two(
    browser: Browser, platform: Platform, record: Record, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Watched]:
    """The page of two records of one platform."""
    other = waving_record(platform, size=0.02)
    path = tmp_path_factory.mktemp("stages") / "report.html"
    path.write_bytes(view_page([record, other], ["waves", "ripples"]))
    found = open_report(browser, path, 0.0)
    yield found
    assert found.errors == []
    found.page.close()


@pytest.mark.parametrize("factor", [2, 10, 50])
def test_motion_is_drawn_larger_from_home(one: Watched, record: Record, platform: Platform, factor: int) -> None:
    """Expected: p₀ + f (p - p₀), exp(f log(R R₀ᵀ)) R₀ by SciPy, legs from B to the drawn P; numbers as before."""
    page, row = one.page, 137
    seek(page, record, row)
    numbers = page.inner_text("#now")
    page.select_option("#motion", str(factor))
    assert page.inner_text("#enlarged") == f"motion drawn {factor} times larger"
    assert page.inner_text("#now") == numbers
    shown = drawn(page)
    home, R0 = platform.home_position, matrix_from_orientation(platform.home_orientation)
    for name, position, rotation in (("", "position", "rotation"), ("reference.", "reference", "referenceRotation")):
        turn = Rotation.from_matrix(matrix_from_orientation(record[f"{name}orientation"][row]) @ R0.T)
        assert shown[position] == pytest.approx(home + factor * (record[f"{name}position"][row] - home), abs=1e-9)
        R = Rotation.from_rotvec(factor * turn.as_rotvec()).as_matrix() @ R0
        assert np.array(shown[rotation]) == pytest.approx(R, abs=1e-9)
    for path, name in (("path", "position"), ("referencePath", "reference.position")):
        assert np.array(shown[path]) == pytest.approx(home + factor * (record[name] - home), abs=1e-5)
    for leg, B, b in zip(shown["legs"], platform.base_points, platform.platform_points, strict=True):
        assert leg["foot"] == pytest.approx(B, abs=1e-6)
        assert leg["head"] == pytest.approx(np.array(shown["position"]) + np.array(shown["rotation"]) @ b, abs=1e-5)
    page.select_option("#motion", "1")
    assert page.is_hidden("#enlarged")
    assert drawn(page)["position"] == pytest.approx(record["position"][row], abs=1e-9)


def test_colour_tells_the_run(two: Watched) -> None:
    """Expected: legs and path in the run's colour; a plate of the same hue, lighter: on the line from it to white."""
    assert two.page.input_value("#colour") == "run"
    for run in (0, 1):
        shown, colour = drawn(two.page, run), rgb_of(colour_of_six(run))
        for leg in shown["legs"]:
            assert leg["colour"] == pytest.approx(colour, abs=1e-6)
        assert shown["pathColour"] == pytest.approx(colour, abs=1e-6)
        to_white = (np.array(shown["colour"]) - colour) / (1 - colour)
        assert to_white == pytest.approx(np.full(3, to_white.mean()))


def test_the_platform_and_the_base_throw_shadows(two: Watched, record: Record, platform: Platform) -> None:
    """Expected: darker than without machines where the sun's ray through the plate's middle meets the base.

    The floor is darker close behind the base, as the sun sees it, than farther off.
    """
    page, row = two.page, 0
    seek(page, record, row)
    for box in ("ghost", "frames", "trail"):
        page.uncheck(f"#{box}")
    sun, middle = np.array(stage(page)["sun"]), record["position"][row]
    shadow = middle - sun * (middle[2] - platform.base_points[:, 2].mean()) / sun[2]
    place = seen(page, shadow[None])
    with_machines = at(pixels(page), place)
    for run in (0, 1):
        page.uncheck(f"#runs input >> nth={run}")
    without = at(pixels(page), place)
    assert with_machines.mean() < 0.8 * without.mean()
    # of the base's edges, the one whose outward normal goes most with the rays
    page.select_option("#from", "top")
    from_middle = platform.base_points[:, :2] - platform.base_points[:, :2].mean(axis=0)
    size = np.linalg.norm(from_middle, axis=1).max()
    corners = platform.base_points[np.argsort(np.arctan2(from_middle[:, 1], from_middle[:, 0])), :2]
    sides = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([sides[:, 1], -sides[:, 0]]) / np.linalg.norm(sides, axis=1)[:, None]
    best = int((normals @ sun[:2]).argmax())
    along, normal = corners[best] + sides[best] / 2, normals[best]
    picture = pixels(page)
    line = [[*(along + share * size * normal), stage(page)["ground"]] for share in np.linspace(0.05, 0.5, 60)]
    light = at(picture, seen(page, np.array(line))).mean(axis=1)
    assert light[:15].min() < np.median(light[30:]) - 10
    for run in (0, 1):
        page.check(f"#runs input >> nth={run}")
    for box in ("ghost", "frames", "trail"):
        page.check(f"#{box}")
    page.select_option("#from", "corner")


def test_the_path_is_seen_where_the_plate_would_hide_it(one: Watched, record: Record) -> None:
    """Expected: on nine of ten points of the path, another picture with the path than without; also under the plate."""
    page = one.page
    seek(page, record, QUIET_ROW)
    page.uncheck("#frames")
    page.uncheck("#ghost")
    places = seen(page, record["position"][::25])
    with_path = pixels(page)
    page.uncheck("#trail")
    without = pixels(page)
    page.check("#trail")
    near = np.array([[dx, dy] for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
    changed = [np.abs(at(with_path, place + near) - at(without, place + near)).max() > 8 for place in places]
    assert np.mean(changed) >= 0.9
    page.check("#frames")
    page.check("#ghost")


def test_the_dark_stage_prints_light(browser: Browser, report: Path) -> None:
    """Expected: dark corners on a dark screen; on paper a picture with light ones instead, and no controls."""
    page = browser.new_page(color_scheme="dark", viewport={"width": 1000, "height": 640})
    page.goto(report.as_uri() + "#t=0")
    until(page, "GoughStewart.ready.picture")
    assert pixels(page)[[5, 5], [5, -5]].max() < 60
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    assert page.is_hidden("#view")
    assert page.is_hidden("#play")
    printed = np.asarray(Image.open(io.BytesIO(page.locator("#printed").screenshot())).convert("RGB"), dtype=float)
    assert printed[[5, 5], [5, -5]].min() > 200
    # the blue of the plate is in the picture
    assert ((printed[..., 2] - printed[..., 0]) > 60).sum() > 500
    page.close()
