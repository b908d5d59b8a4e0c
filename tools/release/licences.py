"""The licences of everything that the wheel, an install and the pages carry; an unknown one is a complaint."""

import json
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import NamedTuple

# What may be shipped or installed beside a program under the BSD licence: SPDX identifiers, and names in classifiers.
KNOWN = frozenset(
    (
        *("MIT", "MIT License", "MIT-CMU", "BSD", "BSD License", "BSD-2-Clause", "BSD-3-Clause", "0BSD", "ISC", "HPND"),
        *("ISC License (ISCL)", "Apache-2.0", "Apache Software License", "Apache-2.0 WITH LLVM-exception", "Zlib"),
        *("PSF-2.0", "Python Software Foundation License", "Python-2.0", "CNRI-Python", "BSL-1.0", "CC0-1.0"),
        *("MPL-2.0", "Mozilla Public License 2.0 (MPL 2.0)", "Unlicense", "The Unlicense (Unlicense)"),
        *("LGPL-3.0-only", "LGPL-3.0-or-later", "GNU Lesser General Public License v3 or later (LGPLv3+)"),
        "GPL-3.0-or-later WITH GCC-exception-3.1",
    )
)
# Packages whose metadata say nothing, by the text of their licence.
_BY_TEXT = {"FMPy": "BSD-2-Clause"}
# Kinds of files that are written in this project.
_OWN = frozenset(
    (".py", ".pyi", ".typed", ".c", ".h", ".in", ".toml", ".md", ".csv", ".js", ".css", ".html", ".xml", ".svg", "")
)
# A notice of somebody else's rights in a text; in quotes, it is code that looks for notices.
_NOTICE = re.compile(
    rb"""^[^"'`\n]*(?:@license|SPDX-License-Identifier|copyright(?: \(c\)| \xc2\xa9))[^"'`\n]*$""", re.I | re.M
)
# Libraries whose notices the pages carry, by a text in the notice; bokeh contains others.
_LIBRARIES: Mapping[str, tuple[str, str]] = {
    "three.js": ("three.js authors", "MIT"),
    "numbro.js": ("numbro.js", "MIT"),
    "jQuery Mousewheel": ("jquery mousewheel", "MIT"),
    "Tabler Icons": ("tabler icons", "MIT"),
    "native-promise-only": ("native promise only", "MIT"),
    "MapLibre GL": ("maplibre-gl", "BSD-3-Clause"),
    "buffer": ("the buffer module from node.js", "MIT"),
    "ieee754": ("ieee754", "BSD-3-Clause"),
    "is-buffer": ("determine if an object is a buffer", "MIT"),
    "pad-left": ("pad-left", "MIT"),
    "repeat-string": ("repeat-string", "MIT"),
    "bokeh": ("bokeh", "BSD-3-Clause"),
}


class Licence(NamedTuple):
    """Of a part; `name` is "" or UNKNOWN where it is not known."""

    part: str
    name: str

    @property
    def is_known(self) -> bool:
        """Whether it may be shipped: all licences that hold; of alternatives, one is enough."""
        parts = re.split(r" AND |; ", self.name)
        return all(any({choice, choice.strip("()")} & KNOWN for choice in part.split(" OR ")) for part in parts)


def of_install(python: str) -> Iterator[Licence]:
    """Of the packages in an environment, from their metadata."""
    command = [sys.executable, "-m", "piplicenses", "--python", python, "--from=mixed", "--format=json"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    for package in json.loads(listed):
        yield Licence(f"{package['Name']} {package['Version']}", _BY_TEXT.get(package["Name"], package["License"]))


def of_wheel(contents: Mapping[str, bytes]) -> Iterator[Licence]:
    """Of the files in the wheel: the project's own, unless a notice in one says otherwise.

    Compiled files are of the project's C, and of the run-time library of the compiler.
    """
    for name, content in contents.items():
        path = PurePosixPath(name)
        if ".dist-info" in path.parts[0]:
            continue
        if "prebuilt" in path.parts:
            yield Licence(f"{name} (compiled)", "BSD-3-Clause AND MIT AND Apache-2.0 WITH LLVM-exception")
        elif path.suffix not in _OWN:
            yield Licence(f"{name} (a kind of file that is not known)", "")
        elif notice := _NOTICE.search(content):
            yield Licence(f"{name}: {notice[0].decode(errors='replace').strip()[:80]}", "")


def of_page(page: bytes) -> Iterator[Licence]:
    """Of the libraries in a page, by the notices in its comments; each has to be there to the letter."""
    for match in re.finditer(rb"/\*[!*][^*]*(?:\*(?!/)[^*]*)*\*/|<!--.*?-->", page, re.S):
        plain = " ".join(match[0].decode(errors="replace").split())
        if re.search(r"licen[cs]e|copyright", plain, re.I):
            known = [(name, spdx) for name, (words, spdx) in _LIBRARIES.items() if words in plain.lower()]
            yield Licence(f"{known[0][0]} (in the page)", known[0][1]) if known else Licence(f"page: {plain[:90]}", "")
