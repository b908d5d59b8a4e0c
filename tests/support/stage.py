"""What the 3-D stage of a run page shows, in a browser: poses in the scene, and pixels."""

import io
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import Page

from gough_stewart import Record
from tests.support.arrays import FloatArray
from tests.support.browser import until


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
