"""The manifest of FMI-LS-REF by its own schema, from clones of modelica/fmi-ls-ref (main) and modelica/fmi-standard."""

import os
import re
import shutil
import zipfile
from pathlib import Path

import pytest
from lxml import etree

from gough_stewart import build


@pytest.mark.evidence
@pytest.mark.skipif("FMI_STANDARDS" not in os.environ, reason="FMI_STANDARDS names no folder with clones")
def test_the_manifest_is_valid(tmp_path: Path) -> None:
    """Expected: the schema takes it, and is not one that takes anything."""
    place, beside = Path(os.environ["FMI_STANDARDS"]), tmp_path / "schema"
    # schemas by their names in the clones, wherever this one expects them
    shutil.copytree(place / "fmi-standard/schema", beside)
    text = (place / "fmi-ls-ref/schema/fmi3LayeredStandardReferenceManifest.xsd").read_text(encoding="utf-8")
    (beside / "manifest.xsd").write_text(re.sub(r'schemaLocation="https://[^"]*/', 'schemaLocation="', text))
    schema = etree.XMLSchema(etree.parse(str(beside / "manifest.xsd")))
    for path in build(tmp_path / "built"):
        with zipfile.ZipFile(path) as archive:
            manifest = archive.read("extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml")
        schema.assertValid(etree.fromstring(manifest))
        assert not schema.validate(etree.fromstring(manifest.replace(b'role="result"', b'role="outcome"')))
