"""The page inside the FMU: complete against the variable table, well-formed, and self-contained."""

import html
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart.fmu_build.formulas import mathml
from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.fmu_build.plant.drawing import drawing_svg
from gough_stewart.fmu_build.plant.layout import plant_layout
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset, preset_names
from gough_stewart.model.state import State
from gough_stewart.model.variant import Variant
from tests.support.fmu_plants import Fmu, plant
from tests.support.uneven import UNEVEN

XHTML = "{http://www.w3.org/1999/xhtml}"
VERSIONS = ["2.0", "3.0"]


@pytest.fixture(scope="module", params=[(p, v) for p in preset_names() for v in VERSIONS], ids="-".join)
def preset_and_version(request: pytest.FixtureRequest) -> tuple[Platform, str]:
    name, version = request.param
    return load_preset(name), version


def page_of(platform: Platform, version: str, **options: Any) -> bytes:
    return plant_component(platform, is_in_a_system=True, **options).documents(version)["documentation/index.html"]


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
    rows = table_of(page_of(platform, version))
    variables = [row.variable for row in plant_layout(Variant.of(platform)).described(version)]
    assert [row[0].split()[0] for row in rows] == [v.name for v in variables]
    assert [row[3] for row in rows] == [v.unit for v in variables]
    assert [row[5] for row in rows] == [v.description for v in variables]


def test_start_values_are_those_of_the_platform(preset_and_version: tuple[Platform, str]) -> None:
    """Expected: the platform's own numbers; one number stands for an array of equal ones."""
    platform, _ = preset_and_version
    rows = {row[0].split()[0]: row[4] for row in table_of(page_of(*preset_and_version))}
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


def test_nothing_is_fetched_and_nothing_runs(preset_and_version: tuple[Platform, str]) -> None:
    page = page_of(*preset_and_version)
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
    page = page_of(load_preset("liu2000"), "2.0").decode()
    source = (Path(interface.__file__).parent / "task_space.md").read_text()
    formulas = re.findall(r"\$\$(.+?)\$\$|\$([^$\n]+)\$", source, re.S)
    assert page.count("<math ") == len(formulas) > 30
    for block, inline in formulas:
        assert (mathml(block, "block") if block else mathml(inline, "inline")) in page
    assert not re.search(r"\$|\\[a-z]|\*\*|<p>#", page)


def test_texts_of_a_platform_are_escaped() -> None:
    named = replace(load_preset("liu2000"), name='<b>&"mine"</b>', source="<script>alert(1)</script>")
    page = page_of(named, "3.0")
    assert b"<script" not in page
    assert '<b>&"mine"</b>' in text_of(page)


def test_it_says_what_an_importer_has_to_know(preset_and_version: tuple[Platform, str]) -> None:
    """Expected: constants of the model's integrator, and the names of the standard's version."""
    platform, version = preset_and_version
    text = text_of(page_of(platform, version))
    prefix = f"fmi{version[0]}"
    scheme = "Dormand–Prince" if platform.leg_friction_model == 0 else "ETDRK4"
    for words in (
        *(f"{prefix}Discard", f"{prefix}Error", f"FMI {version}", platform.name),
        *("from 1e-13 to 1e-2, by default 1e-8", "20,000 internal steps", scheme, "fixed_step_size"),
        *("logStatusDiscard", "logAll", "are not enforced", "16(1), 2000"),
    ):
        assert words in text
    other = "fmi3" if version == "2.0" else "fmi2"
    assert other not in text


@pytest.mark.parametrize("version", VERSIONS)
def test_the_page_goes_from_the_model_to_its_source(version: str) -> None:
    """Expected: what it is, how it is defined, how it behaves, how it is used."""
    page = page_of(UNEVEN, version)
    root = ET.fromstring(page)
    assert root.findtext("{*}head/{*}title") == f"Gough–Stewart platform, FMI {version}"
    assert [each.text for each in root.find("{*}body") or () if re.search(r"h\d$", each.tag)] == [
        "Gough–Stewart platform",
        *("Model", "Frames and signs", "Variables", "Task-space equations", "Legs", "Platform", "Energies"),
        *("Behaviour", "Limits and failures", "Example with FMPy", "Source"),
    ]
    assert drawing_svg(UNEVEN) in page.decode()
    # the style of formulas and that of the page
    style = root.findtext("{*}head/{*}style") or ""
    assert ".formula {" in style
    assert ".numbers {" in style


def test_each_version_is_told_what_it_can_do() -> None:
    """Expected: functions, modes and derivatives of the standard's two versions; the rest is the same."""
    old, new = (text_of(page_of(UNEVEN, version)) for version in VERSIONS)
    tunable = (
        "platform_mass, platform_com, platform_inertia, leg_viscous_friction, leg_coulomb_friction,"
        " leg_friction_velocity, gravity, leg_viscous_friction_factor, leg_coulomb_friction_factor."
    )
    own = {
        old: (
            "or change linearly if their first derivative is set by fmi2SetRealInputDerivatives;",
            "(between communication steps in Co-Simulation, in event and continuous-time mode in Model Exchange)",
            "Exact directional derivatives with respect to inputs, states and parameters",
            "fmi2LastSuccessfulTime is the start of the step, and fmi2Terminated is true. The importer",
            "(fmi2ExitInitializationMode), and results or derivatives that are not finite where FMI 2.0",
            "fmi2CompletedIntegratorStep requests termination",
            "FMI 2.0 has scalars only: elements have indices from 1, row by row, as shown in the first column."
            " Matrices of joints have one row per leg.",
        ),
        new: (
            "The intermediate-update callback is called after every internal step.",
            "(in step mode in Co-Simulation, in event mode in Model Exchange)",
            "Exact directional and adjoint derivatives with respect to",
            "lastSuccessfulTime is the start of the step. The importer",
            "(fmi3ExitInitializationMode). A pose beyond",
            "fmi3CompletedIntegratorStep requests termination",
            "Arrays are listed row by row. Matrices of joints have one row per leg.",
        ),
    }
    for text, other in ((old, new), (new, old)):
        for words in own[text]:
            assert words in text
            assert words not in other
        assert f"in Model Exchange): {tunable}" in text
        assert "or more than 20,000 internal steps (1,000,000 fixed ones)." in text
        assert "from 1e-13 to 1e-2, by default 1e-8;" in text


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"actuator_force": np.full(6, 1.0)},
        {"start": State(UNEVEN.home_position, np.zeros(3), np.zeros(3), np.full(3, 0.1))},
    ],
)
def test_only_a_unit_with_all_the_platforms_start_values_is_said_to_stand_still(options: dict[str, Any]) -> None:
    """Expected: other forces break the balance, and so does another pose or motion."""
    assert text_of(page_of(UNEVEN, "3.0", **options)).count("the platform stands still") == (not options)


def test_the_example_of_the_page_runs_as_it_stands(
    fmu: Fmu, fmu_folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the pose that the unit reaches step by step under 5 % more than the static forces."""
    monkeypatch.chdir(fmu_folder)
    code = example_of(page_of(UNEVEN, fmu.version))
    found: dict[str, Any] = {}
    exec(code, found)
    said = capsys.readouterr().out.splitlines()[-1]
    shown = np.array([float(number) for number in said.strip("[]").split()])
    forces = np.array([float(f"{force:.6g}") for force in 1.05 * UNEVEN.home_actuator_force])
    with plant(fmu) as p:
        p.start({"actuator_force": forces})
        for k in range(50):
            p.step(k * 0.01, 0.01)
        pose = p.get("position")
        length = p.get("leg_length")[0]
    assert shown == pytest.approx(pose[2:] if fmu.version == "2.0" else pose, rel=1e-6)
    last = found["result"][-1]
    assert last["time"] == pytest.approx(0.5)
    assert len(found["result"]) == 51
    assert (last["leg_length[1]"] if fmu.version == "2.0" else last["leg_length"][0]) == pytest.approx(length, rel=1e-6)
    assert f'"platform_mass": {UNEVEN.platform_mass!r}' in code
