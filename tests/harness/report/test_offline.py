"""The frame of all pages: what is put in comes out, and nothing else may run or load."""

import base64
import hashlib
import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import lxml.html
import pytest

from gough_stewart import GoughStewartError
from gough_stewart.harness.report import offline
from gough_stewart.harness.report.offline import bokeh, bokeh_licence, document, three, three_licence
from gough_stewart.harness.report.versions import versions

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
    """Expected: what was given, read by a parser of HTML; scripts keep order."""
    assert page.startswith(b"<!doctype html>\n")
    assert one(page, "//head/title/text()") == "a <b> & $c"
    assert one(page, "//body/main/h1/text()") == "body & $x"
    assert one(page, "//head/style/text()") == "h1 { color: red; }"
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


def test_three_js_is_cut_out_of_its_page_whole() -> None:
    """Expected: the notice and one line, a module that closes as it opens, without what trimesh's page adds."""
    notice, script = three().split("*/\n")
    assert (notice[:3], notice.count("\n")) == ("/**", 4)
    assert (script[:10], script[-4:]) == ("!function(", "}));")
    assert all(part in script for part in ("REVISION=e", 'const e="140"'))
    assert not any(part in script for part in ("\n", "</script", "trimesh"))


def test_the_licences_of_the_libraries_go_along() -> None:
    """Expected: the holders of the copyrights of three.js and BokehJS, and the terms of the MIT and BSD licences."""
    for text, parts in (
        (three_licence(), ("2010-2022 Three.js Authors", "Permission is hereby granted")),
        (bokeh_licence(), ("Bokeh Contributors", "Redistribution and use in source and binary forms")),
    ):
        assert all(part in text for part in parts)


def test_a_wheel_that_has_its_script_elsewhere_is_refused_by_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Expected: the package, its version, and one that would do; also if the page in the archive has another script."""
    for name in ("no_such_package_here", "this"):  # the second is a module without a folder
        with pytest.raises(GoughStewartError, match=f"the package '{name}' is missing; install gough-stewart with"):
            offline._folder(name)
    monkeypatch.setattr(offline, "_folder", lambda _package: tmp_path)
    with pytest.raises(GoughStewartError, match=rf"bokeh {version('bokeh')} has no bokeh\.min\.js or .* in server"):
        bokeh.__wrapped__()
    (tmp_path / "resources/templates").mkdir(parents=True)
    for _ in range(2):
        with pytest.raises(GoughStewartError, match=rf"trimesh {version('trimesh')} has no three\.js.*5\.2\.0"):
            three.__wrapped__()
        with ZipFile(tmp_path / "resources/templates/viewer.zip", "w") as archive:
            archive.writestr("viewer.html.template", "<script>\nlet x = 0;\n</script>")


def test_versions_are_those_of_the_installed_packages_and_the_machine() -> None:
    """Expected: by `importlib.metadata` and `platform`, Python first, the machine last; nobody's copy is shared."""
    names = ["gough-stewart", "numpy", "scipy", "casadi", "control", "fmpy", "ziglang", "polars", "matplotlib"]
    found = versions()
    expected = {"python": platform.python_version(), **{name: version(name) for name in names}}
    assert list(found.items()) == [*expected.items(), ("machine", f"{platform.system()} {platform.machine()}")]
    found["numpy"] = "another"
    assert versions()["numpy"] == version("numpy")
