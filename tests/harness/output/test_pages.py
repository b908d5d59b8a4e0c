"""Web files of rooms and wheels, and numbers packed for scripts."""

import base64
import re
from pathlib import Path

import numpy as np
import pytest

import gough_stewart.harness.output as room
from gough_stewart.harness.output.pages import asset, packed, place_of, plotly
from gough_stewart.model.errors import GoughStewartError

WEB = Path(room.__file__).parent / "web"


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
    assert asset("output", "page.css") != asset("workspace", "workspace.css")
    assert re.search(r"plotly\.js v\d", plotly()[:300])
    assert (place_of("plotly") / "package_data").is_dir()
    for name in ("no_such_package_here", "this"):  # the second is a module without a folder
        with pytest.raises(GoughStewartError, match=f"the package '{name}' is missing; install gough-stewart with"):
            place_of(name)
