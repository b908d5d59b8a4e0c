"""What a page says and carries for its scripts, unpacked here by the rules of harness/report/packing.py."""

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


def words_of(element: Any) -> str:
    """The text of an element, with hyphens for minus signs."""
    return " ".join(element.text_content().replace("−", "-").split())


def verdict_of(page: bytes) -> tuple[str, str]:
    """The kind of verdict, as good or told, and its words."""
    (element,) = elements(page, "//p[starts-with(@class, 'verdict ')]")
    return element.get("class").split()[1], words_of(element).partition(": ")[2]


def rows_below(page: bytes, heading: str) -> dict[str, tuple[str, ...]]:
    """Of the first table below a heading or with that caption: the cells of each row by its first one."""
    where = f"//h2[.='{heading}']/following::table[1]//tr | //table[caption='{heading}']//tr"
    return {words_of(row[0]): tuple(map(words_of, row[1:])) for row in elements(page, where)}


def data_of(page: bytes) -> dict[str, Any]:
    """What the page's scripts are given."""
    (element,) = elements(page, "//script[@id='data']")
    return dict(json.loads(element.text))


def charts_of(page: bytes) -> dict[str, dict[str, Any]]:
    """The charts by title, with arrays instead of their numbers; values are in SI units."""
    data = data_of(page)
    charts = {}
    for chart in data["charts"]:
        x = unpacked(data["arrays"][chart["x"]["values"]])
        series = []
        for one in chart["series"]:
            names = one.keys() & {"x", "values", "low", "high"}
            series.append({"x": x, **one, **{name: unpacked(data["arrays"][one[name]]) for name in names}})
        charts[chart["title"]] = {**chart, "series": series}
    return charts


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
    values = np.asarray(packed["a"] + packed["s"] * steps)
    for start, end in np.reshape(packed.get("g", []), (-1, 2)).astype(int):
        values[start:end] = np.nan
    return values
