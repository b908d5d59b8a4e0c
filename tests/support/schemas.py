"""The documents of an FMU against the schemas of the standard, which FMPy's wheel carries."""

from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

_SCHEMAS = Path(fmpy.__file__).parent / "schema"
_COMPANIONS = {
    "sources/buildDescription.xml": "fmi3/fmi3BuildDescription.xsd",
    "terminalsAndIcons/terminalsAndIcons.xml": "fmi3/fmi3TerminalsAndIcons.xsd",
}
_DOCUMENTS = {
    "2.0": {"modelDescription.xml": "fmi2/fmi2ModelDescription.xsd", **_COMPANIONS},
    "3.0": {"modelDescription.xml": "fmi3/fmi3ModelDescription.xsd", **_COMPANIONS},
}


def complaints_of_schemas(file: Any) -> dict[str, str]:
    """What the schemas say, by document; nothing of those that follow them."""
    found = {}
    for document, schema in _DOCUMENTS[file.version].items():
        checker = etree.XMLSchema(etree.parse(str(_SCHEMAS / schema)))
        checker.validate(etree.parse(str(file.folder / document)))
        found[document] = str(checker.error_log)
    return {document: text for document, text in found.items() if text}
