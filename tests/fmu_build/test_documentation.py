"""The page inside the FMU: complete against the variable table, well-formed, and self-contained."""

import ast
import html
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gough_stewart.fmu_build.formulas import mathml
from gough_stewart.fmu_build.plant.documentation import documentation_page
from gough_stewart.fmu_build.plant.layout import PLANT, plant_layout
from gough_stewart.model import interface
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset, preset_names
from gough_stewart.model.variant import Variant

XHTML = "{http://www.w3.org/1999/xhtml}"
VERSIONS = ["2.0", "3.0"]


@pytest.fixture(scope="module", params=[(p, v) for p in preset_names() for v in VERSIONS], ids="-".join)
def preset_and_version(request: pytest.FixtureRequest) -> tuple[Platform, str]:
    name, version = request.param
    return load_preset(name), version


def text_of(page: bytes) -> str:
    return " ".join("".join(ET.fromstring(page).itertext()).split())


def table_of(page: bytes) -> list[list[str]]:
    """Cells of the variable table; lines of a cell are apart by blanks."""
    body = ET.fromstring(page).find(f".//{XHTML}tbody")
    assert body is not None
    return [[" ".join(cell.itertext()).replace("−", "-") for cell in row] for row in body]


def example_of(page: bytes) -> str:
    found = re.search(r"<pre><code>(.*?)</code></pre>", page.decode(), re.S)
    assert found
    return html.unescape(found[1])


def test_every_variable_has_its_line(preset_and_version: tuple[Platform, str]) -> None:
    """Expected: name, unit and description of the layout, in its order."""
    platform, version = preset_and_version
    rows = table_of(documentation_page(platform, version))
    variables = [row.variable for row in plant_layout(Variant.of(platform)).described(version)]
    assert [row[0].split()[0] for row in rows] == [v.name for v in variables]
    assert [row[3] for row in rows] == [v.unit for v in variables]
    assert [row[5] for row in rows] == [v.description for v in variables]


def test_start_values_are_those_of_the_platform(preset_and_version: tuple[Platform, str]) -> None:
    """Expected: the platform's own numbers; one number stands for an array of equal ones."""
    platform, _ = preset_and_version
    rows = {row[0].split()[0]: row[4] for row in table_of(documentation_page(*preset_and_version))}
    for name in ("base_points", "platform_points", "platform_inertia", "platform_com", "leg_upper_com", "gravity"):
        value = np.array(getattr(platform, name))
        shown = np.array([float(t) for t in rows[name].split()])
        expected = value.ravel() if shown.size > 1 else value.ravel()[:1]
        np.testing.assert_allclose(shown, expected, rtol=1e-5)
    assert rows["leg_length"] == rows["acceleration"] == ""
    # in balance: all of the weight is held by the vertical parts of the forces, equal for legs that are alike
    held = np.array([float(t) for t in rows["actuator_force"].split()])
    assert held.size in (1, 6)
    assert (held > 0).all()


def test_only_fmi_2_names_elements() -> None:
    """Expected: first and last scalar of each array, from the layout."""
    old, new = (table_of(documentation_page(load_preset("liu2000"), v)) for v in VERSIONS)
    for row, two, three in zip(PLANT.described("2.0"), old, new, strict=False):
        names = row.scalar_names
        assert three[0] == row.variable.name
        if row.variable.shape:
            assert names[0] in two[0]
            assert names[-1] in two[0]


def test_nothing_is_fetched_and_nothing_runs(preset_and_version: tuple[Platform, str]) -> None:
    page = documentation_page(*preset_and_version)
    for element in ET.fromstring(page).iter():
        assert element.tag.split("}")[-1] not in {"script", "link", "img", "iframe", "object", "embed"}
        assert not {"src", "href", "onload", "onclick"} & set(element.attrib)
    # namespaces are names, not places
    places = set(re.findall(rb"https?://[^\"'<\s]+", page))
    names = {b"http://www.w3.org/1999/xhtml", b"http://www.w3.org/2000/svg", b"http://www.w3.org/1998/Math/MathML"}
    assert places == names
    assert b"url(" not in page
    assert b"@import" not in page


def test_the_equations_are_those_of_the_page_beside_the_code() -> None:
    """Expected: every formula of model/task_space.md, as the site draws it; nothing of LaTeX or Markdown is left."""
    page = documentation_page(load_preset("liu2000"), "2.0").decode()
    source = (Path(interface.__file__).parent / "task_space.md").read_text()
    formulas = re.findall(r"\$\$(.+?)\$\$|\$([^$\n]+)\$", source, re.S)
    assert page.count("<math ") == len(formulas) > 30
    for block, inline in formulas:
        assert (mathml(block, "block") if block else mathml(inline, "inline")) in page
    assert not re.search(r"\$|\\[a-z]|\*\*|<p>#", page)


def test_texts_of_a_platform_are_escaped() -> None:
    named = replace(load_preset("liu2000"), name='<b>&"mine"</b>', source="<script>alert(1)</script>")
    page = documentation_page(named, "3.0")
    assert b"<script" not in page
    assert '<b>&"mine"</b>' in text_of(page)


def test_the_same_platform_gives_the_same_bytes(preset_and_version: tuple[Platform, str]) -> None:
    assert documentation_page(*preset_and_version) == documentation_page(*preset_and_version)


def test_it_says_what_an_importer_has_to_know(preset_and_version: tuple[Platform, str]) -> None:
    """Expected: constants of the model's integrator, and the names of the standard's version."""
    platform, version = preset_and_version
    text = text_of(documentation_page(platform, version))
    prefix = f"fmi{version[0]}"
    scheme = "Dormand–Prince" if platform.leg_friction_model == 0 else "ETDRK4"
    for words in (
        *(f"{prefix}Discard", f"{prefix}Error", f"FMI {version}", platform.name),
        *("from 10−13 to 10−2, by default 10−8", "20,000 internal steps", scheme, "fixed_step_size"),
        *("logStatusDiscard", "logAll", "are not enforced", "16(1), 2000"),
    ):
        assert words in text
    other = "fmi3" if version == "2.0" else "fmi2"
    assert other not in text


@pytest.mark.parametrize("version", VERSIONS)
def test_the_example_is_python_for_this_version(version: str) -> None:
    """Expected: 5 % above the static forces; names of the version."""
    platform = load_preset("motion_base")
    code = example_of(documentation_page(platform, version))
    assigned = next(node for node in ast.parse(code).body if isinstance(node, ast.Assign))
    hold = static_leg_forces(platform, platform.home_position, platform.home_orientation)
    np.testing.assert_allclose(ast.literal_eval(assigned.value), 1.05 * hold, rtol=1e-5)
    assert f'"gough_stewart_fmi{version[0]}.fmu"' in code
    assert ("actuator_force[{i}]" in code) == (version == "2.0")


def test_another_version_is_refused() -> None:
    with pytest.raises(ValueError, match=r"'1\.0'; expected '2\.0' or '3\.0'"):
        documentation_page(load_preset("liu2000"), "1.0")
