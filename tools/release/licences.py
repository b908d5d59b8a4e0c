"""The licences of everything that the wheel, an install and the pages carry; an unknown one is a complaint."""

import re
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import Distribution
from pathlib import Path, PurePosixPath
from typing import NamedTuple

# SPDX identifiers that may be shipped or installed beside a program under the BSD licence.
KNOWN = frozenset(
    {
        *(
            "MIT",
            "BSD-2-Clause",
            "BSD-3-Clause",
            "Apache-2.0",
            "ISC",
            "0BSD",
            "Zlib",
            "PSF-2.0",
            "MPL-2.0",
            "Unlicense",
        ),
        *("LGPL-2.1", "LGPL-3.0", "LGPL-3.0-only", "LGPL-3.0-or-later", "MIT-CMU", "HPND", "CC0-1.0", "Python-2.0"),
        *("CNRI-Python", "BSL-1.0", "Apache-2.0 WITH LLVM-exception", "GPL-3.0-or-later WITH GCC-exception-3.1"),
    }
)
# What packages write in free text instead, by its beginning.
_WORDS = (
    ("mit-cmu", "MIT-CMU"),
    ("hpnd", "HPND"),
    ("mit", "MIT"),
    ("apache", "Apache-2.0"),
    ("bsd 2", "BSD-2-Clause"),
    ("bsd-2", "BSD-2-Clause"),
    ("bsd", "BSD-3-Clause"),
    ("3-clause bsd", "BSD-3-Clause"),
    ("simplified bsd", "BSD-2-Clause"),
    ("new bsd", "BSD-3-Clause"),
    ("modified bsd", "BSD-3-Clause"),
    ("isc", "ISC"),
    ("lgpl", "LGPL-3.0"),
    ("gnu lesser general public license v3", "LGPL-3.0"),
    ("gnu lesser", "LGPL-3.0"),
    ("mozilla public license 2.0", "MPL-2.0"),
    ("mpl-2.0", "MPL-2.0"),
    ("psf", "PSF-2.0"),
    ("python software foundation", "PSF-2.0"),
    ("historical permission notice", "HPND"),
    ("unlicense", "Unlicense"),
    ("the unlicense", "Unlicense"),
    ("zlib", "Zlib"),
)
_CLASSIFIER = "License :: OSI Approved :: "
# Kinds of files that are written in this project.
_OWN = frozenset({".py", ".pyi", ".typed", ".c", ".h", ".toml", ".md", ".csv", ".js", ".css", ".html", ""})
# A notice of somebody else's rights in a text.
_NOTICE = re.compile(rb"^.*(?:@license|SPDX-License-Identifier|copyright(?: \(c\)| \xc2\xa9)).*$", re.I | re.M)
# Libraries whose notices the pages carry, by a text in the notice; bokeh contains others.
LIBRARIES: Mapping[str, tuple[str, str]] = {
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
    """Of a part; `spdx` is "" where it is not known."""

    part: str
    spdx: str

    @property
    def is_known(self) -> bool:
        """Whether it may be shipped."""
        return bool(self.spdx) and all(word in KNOWN for word in _parts(self.spdx))


def _parts(expression: str) -> list[str]:
    """The licences of an SPDX expression of which all hold; of alternatives, one that is known is enough."""
    found = []
    for each in re.split(r"\s+AND\s+", expression.replace("(", "").replace(")", "")):
        choices = re.split(r"\s+OR\s+", each)
        found.append(next((choice for choice in choices if choice in KNOWN), choices[0]))
    return found


def licence_of(distribution: Distribution) -> Licence:
    """Of an installed package, from its metadata: expression, classifier, or free text."""
    metadata = distribution.metadata
    name = f"{metadata['Name']} {metadata['Version']}"
    expression = (metadata.get_all("License-Expression") or [""])[0]
    if expression:
        return Licence(name, str(expression))
    classifiers = [
        c.removeprefix(_CLASSIFIER) for c in metadata.get_all("Classifier") or () if c.startswith(_CLASSIFIER)
    ]
    for text in (*classifiers, (metadata.get_all("License") or [""])[0].strip()):
        found = _spdx(text)
        if found:
            return Licence(name, found)
    return Licence(name, _by_text(distribution))


def _by_text(distribution: Distribution) -> str:
    """From the text of the licence itself, of a package whose metadata say nothing."""
    for file in distribution.files or ():
        if re.match(r"(licen[cs]e|copying)", file.name, re.I) and file.suffix in ("", ".txt", ".md", ".rst"):
            text = " ".join(Path(str(file.locate())).read_text(encoding="utf-8", errors="replace").split())
            if "Permission is hereby granted, free of charge" in text:
                return "MIT"
            if "Redistribution and use in source and binary forms" in text:
                return "BSD-3-Clause" if "Neither the name" in text else "BSD-2-Clause"
    return ""


def _spdx(text: str) -> str:
    if text in KNOWN:
        return text
    plain = text.lower().removeprefix("the ").strip()
    return next((spdx for words, spdx in _WORDS if plain.startswith(words)), "")


def of_wheel(names: Iterable[str], contents: Mapping[str, bytes]) -> Iterator[Licence]:
    """Of the files in the wheel: the project's own, unless a notice in one says otherwise.

    Compiled files are of the project's C, and of the run-time library of the compiler.
    """
    for name in names:
        path = PurePosixPath(name)
        if ".dist-info" in path.parts[0]:
            continue
        if "prebuilt" in path.parts:
            yield Licence(f"{name} (compiled)", "BSD-3-Clause AND MIT AND Apache-2.0 WITH LLVM-exception")
        elif path.suffix not in _OWN:
            yield Licence(f"{name} (a kind of file that is not known)", "")
        else:
            notices = [m[0].decode(errors="replace").strip() for m in _NOTICE.finditer(contents[name])]
            strange = [text for text in notices if not _is_code(text)]
            if strange:
                yield Licence(f"{name}: {strange[0][:80]}", "")


def _is_code(text: str) -> bool:
    """Whether a line looks for notices instead of being one: a pattern, a key, a text of an attribute."""
    return any(mark in text for mark in ('"', "'", "`"))


def of_page(page: bytes) -> Iterator[Licence]:
    """Of the libraries in a page, by the notices in its comments; each has to be there to the letter."""
    for match in re.finditer(rb"/\*[!*][^*]*(?:\*(?!/)[^*]*)*\*/|<!--.*?-->", page, re.S):
        text = match[0].decode(errors="replace")
        if not re.search(r"licen[cs]e|copyright", text, re.I):
            continue
        plain = " ".join(text.split())
        known = [(name, spdx) for name, (words, spdx) in LIBRARIES.items() if words in plain.lower()]
        yield Licence(f"{known[0][0]} (in the page)", known[0][1]) if known else Licence(f"page: {plain[:90]}", "")
