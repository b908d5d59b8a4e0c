"""The frame of all pages: what is put in comes out, and nothing else may run or load."""

import base64
import hashlib
import json
import re
from pathlib import Path
from typing import Any

import lxml.html
import numpy as np
import pytest

import gough_stewart.harness.output as room
from gough_stewart.harness.output.pages import asset, document, packed, place_of, plotly
from gough_stewart.model.errors import GoughStewartError

WEB = Path(room.__file__).parent / "web"
SCRIPTS = ("let a = 1;\r\nlet b = 2;\rlet c = 'ü <b>';", "a + b;")


@pytest.fixture(scope="module")
def page() -> bytes:
    data = {"text": "</script><b>ü", "numbers": [1, 2.5, None], "t": True}
    return document("a <b> & $c", "<main><h1>body &amp; $x</h1></main>", "h1 { color: red; }", data, SCRIPTS)


def elements(page: bytes, path: str) -> list[Any]:
    found: Any = lxml.html.fromstring(page.decode()).xpath(path)
    return list(found)


def one(page: bytes, path: str) -> Any:
    (found,) = elements(page, path)
    return found


def test_every_part_has_its_place(page: bytes) -> None:
    """Expected: what was given, read by a parser of HTML; the style follows that of all pages, scripts keep order."""
    assert page.startswith(b"<!doctype html>\n")
    assert one(page, "//head/title/text()") == "a <b> & $c"
    assert one(page, "//body/main/h1/text()") == "body & $x"
    common = (WEB / "page.css").read_text("utf-8")
    assert one(page, "//head/style/text()") == common + "h1 { color: red; }"
    element = one(page, "//script[@id='data' and @type='application/json']")
    assert json.loads(element.text) == {"text": "</script><b>ü", "numbers": [1, 2.5, None], "t": True}
    assert element.text == '{"text":"\\u003c/script>\\u003cb>ü","numbers":[1,2.5,null],"t":true}'
    scripts = elements(page, "//script[not(@id)]/text()")
    assert scripts == ["let a = 1;\nlet b = 2;\nlet c = 'ü <b>';", "a + b;"]


def test_the_policy_admits_only_these_scripts(page: bytes) -> None:
    """Expected: by CSP 3, the SHA-256 of each script's text as a browser reads it; all that is not named is refused."""
    policy = one(page, "//meta[@http-equiv='Content-Security-Policy']/@content")
    directives = {what: sources for what, *sources in (each.split() for each in policy.split(";"))}
    texts = ["let a = 1;\nlet b = 2;\nlet c = 'ü <b>';", "a + b;"]
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts]
    assert directives == {
        "default-src": ["'none'"],
        "script-src": [f"'sha256-{each}'" for each in hashes],
        "style-src": ["'unsafe-inline'"],
        "img-src": ["data:", "blob:"],
        "base-uri": ["'none'"],
        "form-action": ["'none'"],
    }


def test_data_must_be_finite_and_names_need_not_be_utf_8() -> None:
    """Expected: JSON has no NaN; a byte that is no text, as in the name of a folder, becomes a question mark."""
    with pytest.raises(ValueError, match="not JSON compliant"):
        document("t", "", "", [float("nan")], [])
    assert b"<title>caf?</title>" in document("caf\udce9", "", "", [], [])


@pytest.mark.parametrize(("kind", "size"), [("f8", 8), ("f4", 4), ("i4", 4), ("i1", 1)])
def test_numbers_are_packed_row_by_row_little_end_first(kind: str, size: int) -> None:
    """Expected: the same numbers, read back one by one from their bytes; a transposed array is read by its rows."""
    values = np.array([[1.0, -2.0, 3.0], [4.0, 5.0, -6.0]]).T
    found = packed(values, kind)
    assert found.keys() == {"dtype", "bdata"}
    assert found["dtype"] == kind
    raw = base64.b64decode(found["bdata"])
    parts = [raw[k : k + size] for k in range(0, len(raw), size)]
    if kind[0] == "i":
        read = [float(int.from_bytes(part, "little", signed=True)) for part in parts]
    else:
        read = [float(np.frombuffer(part, f"<{kind}")[0]) for part in parts]
    assert read == [1, 4, -2, 5, 3, -6]


def test_all_bits_are_kept_by_default_and_what_is_too_large_for_single_precision_is_infinite() -> None:
    found = packed(np.array([0.1, 1e300]))
    assert (found["dtype"], np.frombuffer(base64.b64decode(found["bdata"])).tolist()) == ("f8", [0.1, 1e300])
    # warnings are errors in these tests
    single = np.frombuffer(base64.b64decode(packed(np.array([-1e300, 1.0]), "f4")["bdata"]), "<f4")
    assert single.tolist() == [-np.inf, 1.0]


def test_files_of_the_rooms_and_of_wheels_are_found() -> None:
    assert asset("output", "page.js") == (WEB / "page.js").read_text("utf-8")
    assert "workspace" not in asset("output", "page.html") != asset("workspace", "workspace.html")
    assert re.search(r"plotly\.js v\d", plotly()[:300])
    assert (place_of("plotly") / "package_data").is_dir()
    for name in ("no_such_package_here", "this"):  # the second is a module without a folder
        with pytest.raises(GoughStewartError, match=f"the package '{name}' is missing; install gough-stewart with"):
            place_of(name)
