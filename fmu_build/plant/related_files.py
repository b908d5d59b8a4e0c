"""The manifest of FMI-LS-REF, a layered standard that tells the roles of related files in an FMU.

Its version is a beta, without a role for inputs: the reference results are listed, and each description names the files
of inputs and start values beside them.
"""

from collections.abc import Iterable

from lxml import etree

from gough_stewart.fmu_build import model_description as shared
from gough_stewart.fmu_build.plant.reference_results import FOLDER

NAME, VERSION = "org.fmi-standard.fmi-ls-ref", "1.0.0-beta.1"
MANIFEST = f"extra/{NAME}/fmi-ls-manifest.xml"
_NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"
_DESCRIPTION = "Layered Standard providing information on related files included in an FMU."


def related_files(cases: Iterable[str], identifier: str) -> dict[str, bytes]:
    """The manifest by its path in the archive, for the reference results of cases, by name."""
    root = etree.Element("fmiReferences", nsmap={"fmi-ls": _NAMESPACE})
    for key, value in (("name", NAME), ("version", VERSION), ("description", _DESCRIPTION)):
        root.set(f"{{{_NAMESPACE}}}fmi-ls-{key}", value)
    for case in cases:
        stem = f"{FOLDER}/{case}/{identifier}"
        text = (
            f"Reference results of {case}; inputs, start values and experiment are in _in.csv, _start.csv and _ref.opt"
        )
        _add(root, "text/csv", f"{stem}_ref.csv", "result", text)
    _add(root, "text/plain", f"{FOLDER}/README.txt", "document", "How to use the reference results")
    _add(root, "text/html", "documentation/index.html", "document", "Variables, equations and behaviour")
    return {MANIFEST: shared.to_bytes(root)}


def _add(root: etree._Element, kind: str, path: str, role: str, description: str) -> None:
    # relative to the manifest
    etree.SubElement(root, "Related", type=kind, source=f"../../{path}", role=role, description=description)
