"""The licences of what is shipped: known ones pass, and an unknown one anywhere is a complaint.

Expected: licences as packages write them, by hand; `make release-check` runs the whole on what it has built.
"""

import sys
import tomllib
from email.message import Message
from importlib.metadata import Distribution, distribution
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from packaging.requirements import Requirement

from gough_stewart.harness.report.document import Report, Verdict
from gough_stewart.harness.report.page import page_of
from tools.release.__main__ import pythons
from tools.release.licences import Licence, licence_of, of_page, of_wheel

ROOT = Path(__file__).parents[2]
MIT = "Permission is hereby granted, free of charge, to any person"
BSD = "Redistribution and use in source and binary forms, with or without\nmodification"


def package(folder: Path, text: str = "", **metadata: str | list[str]) -> Distribution:
    """One with these metadata, and a text of its licence."""
    message = Message()
    for key, value in {"Name": "theirs", "Version": "1.2", **metadata}.items():
        for each in [value] if isinstance(value, str) else value:
            message[key.replace("_", "-")] = each
    (folder / "LICENSE.txt").write_text(text)
    file = SimpleNamespace(name="LICENSE.txt", suffix=".txt", locate=lambda: folder / "LICENSE.txt")
    return cast(Distribution, SimpleNamespace(metadata=message, files=[file]))


@pytest.mark.parametrize(
    ("metadata", "text", "expected", "is_known"),
    [
        ({"License_Expression": "BSD-3-Clause"}, "", "BSD-3-Clause", True),
        ({"License_Expression": "MIT AND Python-2.0"}, "", "MIT AND Python-2.0", True),
        ({"License_Expression": "GPL-2.0-only OR MIT"}, "", "GPL-2.0-only OR MIT", True),
        ({"License_Expression": "(GPL-2.0-only OR AGPL-3.0) AND MIT"}, "", "(GPL-2.0-only OR AGPL-3.0) AND MIT", False),
        ({"License_Expression": "GPL-3.0-only"}, MIT, "GPL-3.0-only", False),
        ({"Classifier": ["Topic :: Software", "License :: OSI Approved :: MIT License"]}, "", "MIT", True),
        ({"Classifier": "License :: OSI Approved :: BSD License", "License": "see file"}, "", "BSD-3-Clause", True),
        ({"Classifier": "License :: OSI Approved :: GNU General Public License v3 (GPLv3)"}, "", "", False),
        ({"License": "Apache License, Version 2.0"}, "", "Apache-2.0", True),
        ({"License": "GNU Lesser General Public License v3 or later (LGPLv3+)"}, "", "LGPL-3.0", True),
        ({"License": "Proprietary"}, "All rights reserved", "", False),
        ({}, MIT, "MIT", True),
        ({}, f"{BSD} are permitted", "BSD-2-Clause", True),
        ({}, f"{BSD} are permitted. Neither the name of theirs nor", "BSD-3-Clause", True),
        ({}, "", "", False),
    ],
)
def test_a_package_has_the_licence_of_its_metadata_or_of_its_text(
    metadata: dict[str, Any], text: str, expected: str, is_known: bool, tmp_path: Path
) -> None:
    found = licence_of(package(tmp_path, text, **metadata))
    assert found == Licence("theirs 1.2", expected)
    assert found.is_known is is_known


def test_all_that_a_plain_install_brings_has_a_known_licence() -> None:
    """Expected: nothing else; the dependencies of pyproject.toml and theirs, as far as they are here."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    waiting, seen = list(project["dependencies"]), set[str]()
    while waiting:
        need = Requirement(waiting.pop())
        if need.name.lower() in seen or (need.marker is not None and not need.marker.evaluate({"extra": ""})):
            continue
        seen.add(need.name.lower())
        found = distribution(need.name)
        assert licence_of(found).is_known, licence_of(found)
        waiting += found.requires or []
    assert {"numpy", "control", "casadi"} & seen
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
    found = list(of_wheel(files, files))
    assert [each.part.partition(":")[0].partition(" (")[0] for each in found if not each.is_known] == [
        "gough_stewart/theirs.js",
        "gough_stewart/c.h",
        "gough_stewart/font.woff2",
    ]
    assert [each.part for each in found if each.is_known] == ["gough_stewart/prebuilt/unit.so (compiled)"]
    # and of this project itself
    own = {
        path.relative_to(ROOT).as_posix(): path.read_bytes()
        for folder in ("model", "fmu_build", "harness", "gough_stewart")
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and not {"__pycache__", "prebuilt"} & set(path.parts)
    }
    assert len(own) > 200
    assert list(of_wheel(own, own)) == []


def test_libraries_of_a_page_are_known_by_their_notices() -> None:
    """Expected: a notice in another form, or of another library, is not passed over."""
    page = page_of(Report("nothing", Verdict("There is nothing", "told")))
    assert all(each.is_known for each in of_page(page))
    text = b"<script>/*! numbro.js v3 | MIT license */ x /* a comment */ /** @license theirs 1.0 */</script>"
    assert list(of_page(text)) == [
        Licence("numbro.js (in the page)", "MIT"),
        Licence("page: /** @license theirs 1.0 */", ""),
    ]
    assert [each.is_known for each in of_page(b"<!-- theirs\nCopyright 2020\nSomebody -->")] == [False]


def test_only_supported_interpreters_are_found_and_this_one_is() -> None:
    found = pythons()
    assert f"{sys.version_info.major}.{sys.version_info.minor}" in found
    assert all(tuple(map(int, version.split("."))) >= (3, 11) for version in found)
    assert list(found) == sorted(found, key=lambda version: int(version.split(".")[1]))
