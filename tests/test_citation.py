"""CITATION.cff: versions as in pyproject.toml and the changelog; all that the Citation File Format 1.2.0 requires."""

import re
import tomllib
from pathlib import Path

import yaml  # type: ignore[import-untyped]

ROOT = Path(__file__).parent.parent


def test_the_citation_is_of_this_version_with_all_that_the_format_requires() -> None:
    found = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert found["cff-version"] == "1.2.0"
    assert {"message", "title", "authors", "type"} <= set(found)
    assert found["title"].startswith(project["name"])
    assert found["version"] == project["version"]
    assert found["license"] == project["license"]
    assert found["keywords"] == project["keywords"]
    license_text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert all(author["name"] in license_text for author in found["authors"])
    (paper,) = found["references"]
    assert {"type", "title", "authors"} <= set(paper)
    names = [author["family-names"] for author in paper["authors"]]
    assert f"{names[0]}, {names[1]} & {names[2]} ({paper['year']})" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_changelog_has_this_version_or_changes_that_are_not_released() -> None:
    """Expected: versions descend; the date of the release is in the citation when the changelog has it."""
    found = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    headings = re.findall(r"^## \[(.+?)\](?: - (\S+))?$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    released = {version: date for version, date in headings if version != "Unreleased"}
    numbers = [tuple(map(int, version.split("."))) for version in released]
    assert numbers == sorted(numbers, reverse=True)
    own = tuple(map(int, found["version"].split(".")))
    if found["version"] in released:
        assert str(found["date-released"]) == released[found["version"]]
        assert own == numbers[0]
    else:
        assert headings[0][0] == "Unreleased"
        assert "date-released" not in found
        assert own > numbers[0]
