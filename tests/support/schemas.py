"""The documents of an FMU against the schemas of the standard, which FMPy's wheel carries."""

from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

_SCHEMAS = Path(fmpy.__file__).parent / "schema"
_DOCUMENTS = {
    "modelDescription.xml": "fmi{0}/fmi{0}ModelDescription.xsd",
    "sources/buildDescription.xml": "fmi3/fmi3BuildDescription.xsd",
    "terminalsAndIcons/terminalsAndIcons.xml": "fmi3/fmi3TerminalsAndIcons.xsd",
}


def complaints_of_schemas(file: Any) -> dict[str, str]:
    """What the schemas say, by document; nothing of those that follow them."""
    found = {}
    for document, schema in _DOCUMENTS.items():
        checker = etree.XMLSchema(etree.parse(str(_SCHEMAS / schema.format(file.version[0]))))
        checker.validate(etree.parse(str(file.folder / document)))
        found[document] = str(checker.error_log)
    return {document: text for document, text in found.items() if text}
