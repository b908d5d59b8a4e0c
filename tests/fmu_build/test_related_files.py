"""The manifest of FMI-LS-REF 1.0.0-beta.1: what it lists is there, and what has a role is listed.

Expected: names and roles of the layered standard, whose schema `tests/evidence/test_layered_standard.py` reads.
"""

import posixpath
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

from tests.support.fmu_plants import Fmu

PLACE = "extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml"
NAMESPACE = "{http://fmi-standard.org/fmi-ls-manifest}"
KINDS = {"result": "text/csv", "document": None}


def test_the_manifest_lists_all_reference_results_with_their_inputs_beside(fmu: Fmu) -> None:
    root = ElementTree.parse(fmu.folder / PLACE).getroot()
    assert root.tag == "fmiReferences"
    assert root.attrib == {
        f"{NAMESPACE}fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
        f"{NAMESPACE}fmi-ls-version": "1.0.0-beta.1",
        f"{NAMESPACE}fmi-ls-description": "Layered Standard providing information on related files included in an FMU.",
    }
    listed: dict[str, list[str]] = {}
    for each in root:
        assert each.tag == "Related"
        assert set(each.attrib) == {"type", "source", "role", "description"}
        path = posixpath.normpath(str(PurePosixPath(PLACE).parent / each.attrib["source"]))
        assert (fmu.folder / path).is_file(), path
        assert KINDS[each.attrib["role"]] in (None, each.attrib["type"])
        assert each.attrib["type"] == {"csv": "text/csv", "txt": "text/plain", "html": "text/html"}[path.split(".")[-1]]
        listed.setdefault(each.attrib["role"], []).append(path)
        if each.attrib["role"] == "result":
            names = {file.name for file in (fmu.folder / path).parent.iterdir()}
            for suffix in ("_in.csv", "_start.csv", "_ref.opt"):
                assert suffix in each.attrib["description"]
                assert any(name.endswith(suffix) for name in names)
    results = {str(file.relative_to(fmu.folder)) for file in fmu.folder.glob("extra/**/*_ref.csv")}
    assert len(results) == 2
    assert set(map(Path, listed["result"])) == set(map(Path, results))
    assert listed["document"] == ["extra/gough_stewart/README.txt", "documentation/index.html"]
