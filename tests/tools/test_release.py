"""Licences of what is shipped, as packages write them: known ones pass, an unknown one anywhere is a complaint."""

import sys
import tomllib
from importlib.metadata import distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.support.reports import page_of, report
from tools.release.licences import Licence, of_install, of_page, of_wheel

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("name", "is_known"),
    [
        ("BSD-3-Clause", True),
        ("MIT AND Python-2.0", True),
        ("GPL-2.0-only OR MIT", True),
        ("(GPL-2.0-only OR AGPL-3.0) AND MIT", False),
        ("(GPL-2.0-only OR MIT) AND MIT", True),
        ("MIT License; GNU General Public License v3 (GPLv3)", False),
        ("Apache Software License; BSD License", True),
        ("UNKNOWN", False),
        ("", False),
    ],
)
def test_all_licences_that_hold_have_to_be_known_and_one_of_alternatives(name: str, is_known: bool) -> None:
    assert Licence("theirs 1.2", name).is_known is is_known


def test_all_that_a_plain_install_brings_has_a_known_licence() -> None:
    """Expected: nothing else; the dependencies of pyproject.toml and theirs, as far as they are here."""
    licences = {found.part.partition(" ")[0].lower().replace("_", "-"): found for found in of_install(sys.executable)}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    waiting, seen = list(project["dependencies"]), set[str]()
    while waiting:
        need = Requirement(waiting.pop())
        name = need.name.lower().replace("_", "-")
        is_needed = need.marker is None or need.marker.evaluate({"extra": ""})
        if name in seen | {"setuptools", "pip"} or not is_needed:
            continue
        seen.add(name)
        assert licences[name].is_known, licences[name]
        waiting += distribution(name).requires or []
    assert {"numpy", "control", "fmpy"} <= seen
    assert len(seen) > 20


def test_files_of_the_wheel_are_the_projects_own_unless_they_say_otherwise() -> None:
    files = {
        "gough_stewart/a.py": b"pattern = 'Copyright (c)'\n",
        "gough_stewart/b.js": b"// nothing here\n",
        "gough_stewart/theirs.js": b"/* Copyright (c) 2020 Somebody */\n",
        "gough_stewart/c.h": b"/* SPDX-License-Identifier: GPL-2.0 */\n",
        "gough_stewart/font.woff2": b"\0",
        "gough_stewart/prebuilt/unit.so": b"\x7fELF",
        "gough_stewart-1.dist-info/licenses/LICENSE": b"Copyright (c) 2026, the developers",
    }
    found = list(of_wheel(files))
    unknown = [each.part.partition(":")[0].partition(" (")[0] for each in found if not each.is_known]
    assert unknown == [f"gough_stewart/{name}" for name in ("theirs.js", "c.h", "font.woff2")]
    assert [each.part for each in found if each.is_known] == ["gough_stewart/prebuilt/unit.so (compiled)"]
    # and of this project itself
    own = {
        path.relative_to(ROOT).as_posix(): path.read_bytes()
        for folder in ("model", "fmu_build", "harness", "gough_stewart")
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and not {"__pycache__", "prebuilt"} & set(path.parts)
    }
    assert len(own) > 200
    assert list(of_wheel(own)) == []


def test_libraries_of_a_page_are_known_by_their_notices() -> None:
    """Expected: a notice in another form, or of another library, is not passed over."""
    page = page_of(report())
    assert all(each.is_known for each in of_page(page))
    text = b"<script>/*! numbro.js v3 | MIT license */ x /* a comment */ /** @license theirs 1.0 */</script>"
    assert list(of_page(text)) == [
        Licence("numbro.js (in the page)", "MIT"),
        Licence("page: /** @license theirs 1.0 */", ""),
    ]
    assert [each.is_known for each in of_page(b"<!-- theirs\nCopyright 2020\nSomebody -->")] == [False]
