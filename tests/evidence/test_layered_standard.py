"""The manifest of FMI-LS-REF by its own schema, which is read from clones of the two standards.

`git clone` modelica/fmi-ls-ref and modelica/fmi-standard into the folder that the environment variable FMI_STANDARDS
names; without it the test is skipped. Take the main branch of fmi-ls-ref: the schema of the tag v1.0.0-beta.1
has an import without a namespace, which XML Schema does not allow.
"""

import os
import re
import shutil
import zipfile
from pathlib import Path

import pytest
from lxml import etree

from gough_stewart import build

pytestmark = pytest.mark.evidence
MANIFEST = "extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml"
SCHEMA = "fmi-ls-ref/schema/fmi3LayeredStandardReferenceManifest.xsd"


def test_the_manifest_is_valid(tmp_path: Path) -> None:
    place = os.environ.get("FMI_STANDARDS")
    if place is None:
        pytest.skip("FMI_STANDARDS is not set to a folder with clones of modelica/fmi-ls-ref and modelica/fmi-standard")
    # schemas by their names in the clones, wherever this one expects them
    beside = tmp_path / "schema"
    shutil.copytree(Path(place) / "fmi-standard/schema", beside)
    text = (Path(place) / SCHEMA).read_text(encoding="utf-8")
    (beside / "manifest.xsd").write_text(re.sub(r'schemaLocation="https://[^"]*/', 'schemaLocation="', text))
    schema = etree.XMLSchema(etree.parse(str(beside / "manifest.xsd")))
    for path in build(tmp_path / "built"):
        with zipfile.ZipFile(path) as archive:
            manifest = archive.read(MANIFEST)
        schema.assertValid(etree.fromstring(manifest))
        # the schema is not one that takes anything
        wrong = manifest.replace(b'role="result"', b'role="outcome"')
        assert not schema.validate(etree.fromstring(wrong))
