"""What a page carries for its scripts, unpacked here by the rules of harness/report/packing.py."""

import base64
import json
import zlib
from typing import Any

import lxml.html
import numpy as np

from tests.support.arrays import FloatArray


def elements(page: bytes, path: str) -> list[Any]:
    """What an XPath expression finds on the page."""
    found: Any = lxml.html.fromstring(page.decode()).xpath(path)
    return list(found)


def data_of(page: bytes) -> dict[str, Any]:
    """What the page's scripts are given."""
    (element,) = elements(page, "//script[@id='data']")
    found: dict[str, Any] = json.loads(element.text)
    return found


def unpacked(packed: dict[str, Any]) -> FloatArray:
    """The numbers of an array of a page."""
    n = packed["n"]
    if packed["k"] == "even":
        return np.linspace(packed["a"], packed["b"], n)
    data = zlib.decompress(base64.b64decode(packed["d"]))
    if packed["k"] == "f8":
        return np.frombuffer(bytes(np.frombuffer(data, np.uint8).reshape(8, n).T), "<f8")
    zigzag = np.frombuffer(bytes(np.frombuffer(data, np.uint8).reshape(4, n).T), "<u4").astype(np.int64)
    steps = np.where(zigzag % 2, -(zigzag + 1) // 2, zigzag // 2)
    for _ in range(packed["o"]):
        steps = np.cumsum(steps)
    values = packed["a"] + packed["s"] * steps
    gaps = packed.get("g", [])
    for start, end in zip(gaps[::2], gaps[1::2], strict=True):
        values[start:end] = np.nan
    return np.asarray(values)
