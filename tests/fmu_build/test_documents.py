"""What a unit's documents say, element by element, on an uneven platform; expected values are written out by hand.

The documents come from `unit_of`, which compiles nothing.
"""

import io
import json
import re
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import replace
from functools import cache
from importlib.metadata import metadata
from pathlib import Path

import casadi
import numpy as np
import pytest

from gough_stewart.fmu_build import cache as source_state
from gough_stewart.fmu_build import codegen
from gough_stewart.fmu_build import documents as model_description
from gough_stewart.fmu_build.build import UncompiledUnit, chosen_versions, file_name, number_of_steps, to_zip, unit_of
from gough_stewart.fmu_build.component import Kind, UnitComponent, laid_out
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.formulas import mathml, to_html
from gough_stewart.fmu_build.libraries import lanes_sources
from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.fmu_build.plant.reference_results import reference_cases, reference_files
from gough_stewart.fmu_build.sources import standard_license
from gough_stewart.fmu_build.targets import BY_NAME, chosen_targets, native
from gough_stewart.model import interface
from gough_stewart.model.interface import Variable
from tests.support.random_platforms import random_state
from tests.support.uneven import UNEVEN

VERSIONS = ("2.0", "3.0")
PACKAGE = metadata("gough-stewart")
START = random_state(UNEVEN, np.random.default_rng(9))
FORCES = np.array([11.0, -22.0, 33.0, -44.0, 55.0, -66.0])


@cache
def component() -> UnitComponent:
    """The uneven plant with a start state, forces and options of its own; its runs of references are left out."""
    return plant_component(
        UNEVEN, start=START, actuator_force=FORCES, tolerance=3e-7, fixed_step_size=2e-3, is_in_a_system=True
    )


@cache
def unit(version: str) -> UncompiledUnit:
    return unit_of(component(), version)


def xml(version: str, name: str = "modelDescription.xml") -> ET.Element:
    return ET.fromstring(unit(version).documents[name])


# --- modelDescription.xml ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", VERSIONS)
def test_the_head_names_model_package_and_licence(version: str) -> None:
    """Expected: pyproject.toml through the installed metadata, and the names that users type."""
    root = xml(version)
    expected = {
        "fmiVersion": version,
        "modelName": "GoughStewart",
        "description": PACKAGE["Summary"],
        "version": PACKAGE["Version"],
        "copyright": "the gough-stewart authors",
        "license": "BSD-3-Clause",
        "generationTool": f"gough-stewart {PACKAGE['Version']}",
        "variableNamingConvention": "structured",
    }
    token = root.get("guid" if version == "2.0" else "instantiationToken", "")
    expected |= {"guid": token, "numberOfEventIndicators": "0"} if version == "2.0" else {"instantiationToken": token}
    assert dict(root.attrib) == expected
    assert token in unit(version).sources.units["start.c"]
    assert [len(part) for part in token.strip("{}").split("-")] == [8, 4, 4, 4, 12]
    assert token.startswith("{") == (version == "2.0")
    experiment = root.find("DefaultExperiment")
    assert experiment is not None
    assert dict(experiment.attrib) == {"startTime": "0", "stopTime": "1", "tolerance": "3e-07", "stepSize": "0.001"}
    categories = {each.get("name"): each.get("description") for each in root.iter("Category")}
    assert list(categories) == ["logStatusWarning", "logStatusDiscard", "logStatusError", "logAll"]
    assert "rejected values" in (categories["logStatusDiscard"] or "")
    assert "always logged" in (categories["logStatusError"] or "")


@pytest.mark.parametrize("version", VERSIONS)
def test_units_and_display_units_are_in_the_document(version: str) -> None:
    """Expected: exponents and factors by hand."""
    units = {each.get("name"): each for each in xml(version).iter("Unit")}

    def bases(name: str) -> dict[str, str]:
        return dict(units[name][0].attrib)

    assert bases("N.s/m") == {"kg": "1", "s": "-1"}
    assert bases("rad/s2") == {"rad": "1", "s": "-2"}
    assert bases("kg.m2") == {"kg": "1", "m": "2"}
    shown = {name: dict(each[1].attrib) for name, each in units.items() if len(each) > 1}
    assert {name: each["name"] for name, each in shown.items()} == {
        "m": "mm",
        "rad": "deg",
        "m/s": "mm/s",
        "rad/s": "deg/s",
        "rad/s2": "deg/s2",
    }
    assert float(shown["rad/s2"]["factor"]) == pytest.approx(57.29577951308232, rel=1e-15)
    assert float(shown["m/s"]["factor"]) == 1000.0
    assert "N/m" not in units  # units of controllers are not in use here


def scalars(version: str) -> dict[str, dict[str, str]]:
    """Attributes by name; in FMI 2.0 with those of `Real`."""
    return {
        each.get("name", ""): {**each.attrib, **(each[0].attrib if version == "2.0" else {})}
        for each in xml(version).find("ModelVariables")  # type: ignore[union-attr]
    }


@pytest.mark.parametrize("version", VERSIONS)
def test_variables_have_their_units_bounds_starts_and_states(version: str) -> None:
    """Expected: the platform's numbers, and the rules of the standard for states and bounds."""
    found = scalars(version)
    starts = interface.start_values(interface.VARIABLES, UNEVEN) | START._asdict()
    starts |= {"actuator_force": FORCES, "fixed_step_size": np.array(2e-3)}
    for v in interface.VARIABLES:
        for k, name in enumerate(v.scalar_names if version == "2.0" else [v.name]):
            own, attributes = starts.get(v.name), found[name]
            text = None if own is None else [repr(float(x)) for x in np.ravel(own)]
            expected = None if text is None else text[k] if version == "2.0" else " ".join(text)
            assert attributes.get("start") == expected, name
            assert attributes.get("min") == (None if v.lower_bound is None else "0"), name
            assert "max" not in attributes
            assert attributes.get("initial") == ("exact" if v.is_state else None)
            assert ("nominal" in attributes) == v.is_state
            assert attributes.get("displayUnit") == {"m": "mm", "rad": "deg", "m/s": "mm/s", "rad/s": "deg/s"}.get(
                v.unit, "deg/s2" if v.unit == "rad/s2" else None
            )
            if version == "3.0":
                assert attributes.get("intermediateUpdate") == ("true" if v.causality in ("input", "output") else None)


@pytest.mark.parametrize("version", VERSIONS)
def test_derivatives_name_their_states_element_by_element(version: str) -> None:
    """Expected: der(x[k]) refers to x[k], by its place in the list in FMI 2.0 and by its reference in FMI 3.0."""
    found = scalars(version)
    names = list(found)
    derivatives = {name: each["derivative"] for name, each in found.items() if "derivative" in each}
    assert len(derivatives) == (12 if version == "2.0" else 4)
    for name, at in derivatives.items():
        state = name.removeprefix("der(").removesuffix(")")
        by_reference = {each["valueReference"]: key for key, each in found.items()}
        assert (names[int(at) - 1] if version == "2.0" else by_reference[at]) == state
    units = {name: found[name]["unit"] for name in derivatives}
    assert units["der(position[2])" if version == "2.0" else "der(position)"] == "m/s"
    assert units["der(velocity[2])" if version == "2.0" else "der(velocity)"] == "m/s2"
    assert units["der(angular_velocity[3])" if version == "2.0" else "der(angular_velocity)"] == "rad/s2"


@pytest.mark.parametrize("version", VERSIONS)
def test_initial_unknowns_are_results_and_derivatives_and_depend_on_parameters(version: str) -> None:
    """Expected: states are known; lengths depend on the joints and the pose and not on a mass or a velocity."""
    names = list(scalars(version))
    by_reference = {each["valueReference"]: name for name, each in scalars(version).items()}
    tag = "InitialUnknowns/Unknown" if version == "2.0" else "InitialUnknown"
    structure = xml(version).find("ModelStructure")
    assert structure is not None

    def name_of(text: str) -> str:
        return names[int(text) - 1] if version == "2.0" else by_reference[text]

    key = "index" if version == "2.0" else "valueReference"
    found = {
        name_of(each.get(key, "")): {name_of(known) for known in each.get("dependencies", "").split()}
        for each in structure.findall(tag)
    }
    assert not any(name.startswith(("position", "velocity", "joint_force")) for name in found)
    if version == "2.0":
        assert len(found) == 12 + 6 + 6 + 3 + 3
        pose = {f"{name}[{k}]" for name in ("position", "orientation") for k in (1, 2, 3)}
        joints = {f"{name}[4,{k}]" for name in ("base_points", "platform_points") for k in (1, 2, 3)}
        assert found["leg_length[4]"] == pose | joints
        assert "platform_mass" in found["acceleration[1]"]
    else:
        assert found["leg_length"] == {"position", "orientation", "base_points", "platform_points"}


# --- the smaller documents -----------------------------------------------------------------------------------------

POSE = ("position", "orientation", "velocity", "angular_velocity")
WRENCH = ("external_force", "external_torque")


@pytest.mark.parametrize("version", VERSIONS)
def test_terminals_join_a_legs_own_variables_the_pose_and_the_load(version: str) -> None:
    """Expected: written out by names."""
    root = xml(version, "terminalsAndIcons/terminalsAndIcons.xml")
    assert root.get("fmiVersion") == "3.0"
    found = {
        each.get("name"): (
            each.get("description"),
            each.get("matchingRule"),
            {m.get("memberName"): m.get("variableName") for m in each},
        )
        for each in root.iter("Terminal")
    }
    axes = (1, 2, 3)
    if version == "2.0":
        of_leg = ("actuator_force", "leg_length", "leg_velocity")
        expected = {
            f"actuator_{leg}": (f"actuator of leg {leg}", {name: f"{name}[{leg}]" for name in of_leg})
            for leg in range(1, 7)
        }
        groups = {
            name: {f"{v}[{k}]": f"{v}[{k}]" for v in group for k in axes}
            for name, group in (("pose", POSE), ("external_wrench", WRENCH))
        }
    else:
        arrays = ("actuator_force", "leg_length", "leg_velocity")
        expected = {"actuators": ("the six actuators", {name: name for name in arrays})}
        groups = {"pose": {v: v for v in POSE}, "external_wrench": {v: v for v in WRENCH}}
    expected["pose"] = ("pose and its rates", groups["pose"])
    expected["external_wrench"] = ("load at Op", groups["external_wrench"])
    assert found == {name: (text, "plug", members) for name, (text, members) in expected.items()}
    assert {m.get("variableKind") for m in root.iter("TerminalMemberVariable")} == {"signal"}
    (box,) = root.iter("Icon")
    assert dict(box.attrib) == {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}


@pytest.mark.parametrize("version", VERSIONS)
def test_sources_licences_and_pictures_are_in_their_places(version: str) -> None:
    documents = unit(version).documents
    build = ET.fromstring(documents["sources/buildDescription.xml"])
    compiled = [each.get("name") for each in build.iter("SourceFile")]
    assert compiled == sorted(n.removeprefix("sources/") for n in documents if n.endswith(".c"))
    assert ("fmi2.c" in compiled, "fmi3.c" in compiled) == (version == "2.0", version == "3.0")
    assert "stateless.c" not in compiled
    (configuration,) = build.iter("BuildConfiguration")
    assert configuration.get("modelIdentifier") == "gough_stewart"
    licence = (Path(__file__).parents[2] / "LICENSE").read_text()
    assert documents["documentation/licenses/license.txt"].decode() == licence
    assert documents["documentation/licenses/fmi-headers.txt"].decode() == standard_license(version)
    assert standard_license(version).startswith("Copyright")
    assert "Modelica Association" in standard_license(version)
    assert documents["terminalsAndIcons/icon.png"][:8] == b"\x89PNG\r\n\x1a\n"
    assert b"<svg" in documents["terminalsAndIcons/icon.svg"]
    assert ("model.png" in documents) == (version == "2.0")
    headers = {n for n in documents if n.startswith(f"sources/fmi{version[0]}") and n.endswith(".h")}
    assert len(headers) == 3


def test_an_archive_has_the_description_first_and_only_binaries_are_executable() -> None:
    """Expected: Unix permissions, one date, and the contents; independent of the order in which they are given."""
    contents = {"sources/b.c": b"b", "modelDescription.xml": b"<x/>", "binaries/x86_64-linux/a.so": b"so", "a.txt": b""}
    packed = to_zip(contents)
    assert to_zip(dict(reversed(contents.items()))) == packed
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        found = archive.infolist()
        assert {each.filename: archive.read(each) for each in found} == contents
    assert [each.filename for each in found] == [
        "modelDescription.xml",
        "a.txt",
        "binaries/x86_64-linux/a.so",
        "sources/b.c",
    ]
    assert [oct(each.external_attr >> 16) for each in found] == ["0o644", "0o644", "0o755", "0o644"]
    assert {(each.create_system, each.date_time, each.compress_type) for each in found} == {
        (3, (1980, 1, 1, 0, 0, 0), zipfile.ZIP_DEFLATED)
    }
    assert [file_name("2.0"), file_name("3.0", "own")] == ["gough_stewart_fmi2.fmu", "own_fmi3.fmu"]


def test_versions_targets_and_steps_are_counted_without_duplicates() -> None:
    assert chosen_versions(["3.0", "2.0", "3.0"]) == ("2.0", "3.0")
    assert [target.name for target in chosen_targets(["aarch64-darwin", "x86_64-linux", "aarch64-darwin"])] == [
        "x86_64-linux",
        "aarch64-darwin",
    ]
    assert number_of_steps("3.0", "all") == 1 + 5
    assert number_of_steps(VERSIONS, ["x86_64-windows", "x86_64-linux"]) == 2 * (1 + 2)
    for wrong in ([], ["2"]):
        with pytest.raises(BuildError, match=r"expected 2\.0 or 3\.0"):
            chosen_versions(wrong)


def test_each_target_has_the_flags_of_its_linker() -> None:
    """Expected: position-independent code on Linux, a relative name in a Mach-O library, nothing on Windows."""
    flags = {name: target.flags_of("unit") for name, target in BY_NAME.items()}
    assert flags == {
        "x86_64-linux": ("-fPIC",),
        "aarch64-linux": ("-fPIC",),
        "x86_64-windows": (),
        "x86_64-darwin": ("-Wl,-install_name,@rpath/unit.dylib",),
        "aarch64-darwin": ("-Wl,-install_name,@rpath/unit.dylib",),
    }


@pytest.mark.parametrize(
    ("machine", "system", "name"),
    [
        ("AMD64", "Windows", "x86_64-windows"),
        ("arm64", "Darwin", "aarch64-darwin"),
        ("aarch64", "Linux", "aarch64-linux"),
    ],
)
def test_machines_are_known_by_their_systems_own_names(
    machine: str, system: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platform.machine", lambda: machine)
    monkeypatch.setattr("platform.system", lambda: system)
    assert native() is BY_NAME[name]


# --- formulas and text ---------------------------------------------------------------------------------------------


def test_text_between_formulas_code_and_bold_is_kept_in_order() -> None:
    """Expected: by hand; text is escaped once, and no part is said twice."""
    found = to_html("# A <b>\n\nif $x$ & `b<c`, **so $y$ then**, end >\n\n$$ z = 1 $$\n\nlast")
    x, y, z = mathml("x", "inline"), mathml("y", "inline"), mathml("z = 1", "block")
    assert found == (
        "<h2>A &lt;b&gt;</h2>\n"
        f"<p>if {x} &amp; <code>b&lt;c</code>, <strong>so {y} then</strong>, end &gt;</p>\n"
        f'<div class="formula">{z}</div>\n'
        "<p>last</p>"
    )
    assert 'display="inline"' in x
    assert 'display="block"' in z


def test_only_a_block_between_double_dollars_is_a_formula_by_itself() -> None:
    """Expected: text before or behind it makes a paragraph; headings by their number of signs."""
    assert to_html("$$x$$ and more").startswith("<p>")
    assert to_html("see $$x$$").startswith("<p>see ")
    assert to_html("### third\n\n\n\n# first\nand more") == "<h4>third</h4>\n<p># first\nand more</p>"
    matrix = mathml(r"\begin{bmatrix} a & b \end{bmatrix}", "block")
    assert re.search(r'<mrow class="matrix"><mtable>.*</mtable></mrow>', matrix)
    assert "&#x0005B;" not in matrix


def test_a_formula_that_browsers_do_not_show_is_refused() -> None:
    with pytest.raises(ValueError, match="no MathML for"):
        mathml(r"\unknowncommand x", "inline")


@pytest.mark.parametrize("version", VERSIONS)
def test_the_table_of_the_page_has_every_variable_with_its_numbers(version: str) -> None:
    """Expected: six digits of the platform's numbers; the page has the namespace of XML."""
    page = ET.fromstring(unit(version).documents["documentation/index.html"])
    body = page.find(".//{*}tbody")
    assert body is not None
    rows = {
        "".join(row[0][0].itertext()): ["".join(cell.itertext()) for cell in row] + [cell_lines(row[4])] for row in body
    }
    names = {v.name for v in interface.VARIABLES} | {f"der({v.name})" for v in interface.VARIABLES if v.is_state}
    assert set(rows) == names | {"fixed_step_size"} | ({"time"} if version == "3.0" else set())
    joints = rows["platform_points"]
    first = "platform_pointsplatform_points[1,1] … platform_points[6,3]" if version == "2.0" else "platform_points"
    assert joints[:4] == [first, "6 × 3", "fixed parameter", "m"]
    assert joints[6] == [" ".join(f"{x + 0.0:.6g}".replace("-", "−") for x in row) for row in UNEVEN.platform_points]
    assert joints[5] == interface.BY_NAME["platform_points"].description
    assert rows["actuator_force"][6] == ["11 −22 33 −44 55 −66"]
    assert rows["fixed_step_size"][1:5] == ["scalar", "fixed parameter", "s", "0.002"]
    assert rows["gravity"][2] == f"{interface.BY_NAME['gravity'].variability} parameter"
    assert rows["external_force"][6] == ["0"]  # three equal numbers are one
    assert rows["leg_length"][2:5] == ["output", "m", ""]
    assert version == "2.0" or rows["time"][1:5] == ["scalar", "independent", "s", ""]
    text = " ".join("".join(page.itertext()).split())
    assert UNEVEN.name in text
    assert "the platform stands still" not in text  # its start values are others
    own = plant_component(UNEVEN).documents(version)["documentation/index.html"].decode()
    assert "the platform stands still" in " ".join(own.split())


def cell_lines(cell: ET.Element) -> list[str]:
    return "\n".join([cell.text or "", *(each.tail or "" for each in cell)]).replace("\n\n", "\n").split("\n")


def test_the_source_of_a_platform_is_named_once_if_it_has_one() -> None:
    pages = {
        source: plant_component(replace(UNEVEN, source=source), is_in_a_system=True)
        .documents("3.0")["documentation/index.html"]
        .decode()
        for source in ("A & B 1999", "")
    }
    assert "</b> (A &amp; B 1999);" in " ".join(pages["A & B 1999"].split())
    assert "</b>;" in " ".join(pages[""].split())


# --- reference results ---------------------------------------------------------------------------------------------


def test_reference_files_carry_times_inputs_starts_and_outputs_column_by_column() -> None:
    """Expected: the numbers that are passed in, by name; one case starts as the paper, one at home."""
    cases = reference_cases(UNEVEN)
    rng = np.random.default_rng(3)
    runs = tuple((case, rng.normal(size=(len(case.time), interface.size_of(interface.RESULTS)))) for case in cases)
    files = {version: reference_files(runs, "own", version) for version in VERSIONS}
    for case, values in runs:
        stem = f"extra/gough_stewart/{case.name}/own"
        tables = {kind: read_csv(files["2.0"][f"{stem}_{kind}.csv"].decode()) for kind in ("in", "ref", "start")}
        for k, name in enumerate(n for v in interface.INPUTS for n in v.scalar_names):
            assert tables["in"][name] == case.inputs[:, k].tolist()
        at = {name: k for k, name in enumerate(n for v in interface.RESULTS for n in v.scalar_names)}
        outputs = [n for v in interface.OUTPUTS for n in v.scalar_names]
        assert list(tables["ref"]) == ["time", *outputs]
        for name in outputs:
            assert tables["ref"][name] == values[:, at[name]].tolist()
        for name, value in case.start._asdict().items():
            assert [tables["start"][f"{name}[{k}]"] for k in (1, 2, 3)] == [[x] for x in value]
        for kind, table in tables.items():
            assert table["time"] == case.time.tolist()[: 1 if kind == "start" else None]
        arrays = files["3.0"][f"{stem}_in.csv"].decode().splitlines()
        assert arrays[0] == '"time","actuator_force","external_force","external_torque"'
        assert [float(x) for x in arrays[-1].split(",")[1].split()] == case.inputs[-1, :6].tolist()
        options = dict(line.split(", ") for line in files["3.0"][f"{stem}_ref.opt"].decode().splitlines())
        step = case.time[1] - case.time[0]
        assert {name: float(text) for name, text in options.items()} == {
            "StartTime": 0.0,
            "StopTime": pytest.approx(case.time[-1]),
            "StepSize": pytest.approx(step),
            "RelTol": 1e-8,
            "OutputIntervalLength": pytest.approx(step),
        }
    first, second = cases
    assert np.ptp(first.inputs, axis=0).max() == 0
    assert (np.ptp(second.inputs[:, :6], axis=0) > 0.1 * np.abs(UNEVEN.home_actuator_force)).all()
    np.testing.assert_array_equal(second.start.position, UNEVEN.home_position)
    np.testing.assert_array_equal(second.start.orientation, UNEVEN.home_orientation)
    assert (np.abs(second.inputs[len(second.time) // 2, 6:]) > 0).all()
    assert "own_start.csv" in files["2.0"]["extra/gough_stewart/README.txt"].decode()


def read_csv(text: str) -> dict[str, list[float]]:
    head, *lines = text.splitlines()
    names = json.loads(f"[{head}]")
    columns = zip(*([float(x) for x in line.split(",")] for line in lines), strict=True)
    return {name: list(column) for name, column in zip(names, columns, strict=True)}


# --- caches and vectors --------------------------------------------------------------------------------------------


def test_the_state_of_the_sources_depends_on_every_file_and_on_no_compiled_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: one digest as long as nothing but `__pycache__` changes; content, name and folder count."""
    package = tmp_path / "package"
    for name in ("a.py", "c/unit/b.c", "__pycache__/a.pyc", "c/__pycache__/x.pyc"):
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(name)
    monkeypatch.setattr("importlib.resources.files", lambda _package: package)

    def state() -> str:
        return source_state.state_of_texts.__wrapped__()

    first = state()
    for name in ("__pycache__/a.pyc", "c/__pycache__/x.pyc"):
        (package / name).write_text("other")
    assert state() == first
    (package / "c/unit/b.c").write_text("c/unit/d.c")
    changed = state()
    (package / "c/unit/b.c").rename(package / "c/unit/e.c")
    renamed = state()
    (package / "c/unit/e.c").rename(package / "c/e.c")
    assert len({first, changed, renamed, state()}) == 4


def test_the_vector_library_has_its_files_and_sizes() -> None:
    """Expected: the kernel's numbers of states, inputs and results; one declaration that ends before its body."""
    units, headers = lanes_sources()
    assert {"lanes.c", "conditioning.c", "legs.c"} <= set(units)
    assert {"lanes.h", "elementary.h", "conditioning.h", "internal.h", "plant_table.h", "lanes_kernel.h"} < set(headers)
    table = headers["lanes_table.h"]
    sizes = {
        words[1]: words[2] for words in map(str.split, table.splitlines()) if words[:1] == ["#define"] and words[2:]
    }
    expected = {"N_STATES": 12, "N_INPUTS": 12, "N_RESULTS": 50, "N_SIGNALS": 24}
    assert {name: int(sizes[name]) for name in expected} == expected
    assert table.count("void kernel_legs(") == 1
    declaration = table[table.index("void kernel_legs(") : table.index("INTERNAL_END")]
    assert "{" not in declaration
    assert declaration.strip().endswith(");")
    assert "#include" in units["legs.c"]
    assert "void kernel_legs(" in units["legs.c"]
    assert "condition" in units["conditioning.c"]


def test_rows_in_order_end_before_time_and_what_was_added_later_follows_it() -> None:
    """Expected: names and slots by hand."""
    force = Variable("force", (2,), "N", "input", "continuous", "")
    later = Variable("later", (), "s", "parameter", "fixed", "")
    layout = laid_out([force], {}, [later])
    assert [(row.variable.name, row.reference, row.first) for row in layout.rows] == [
        ("force", 0, 0),
        ("time", 1, 2),
        ("later", 2, 3),
    ]
    assert [row.variable.name for row in layout.in_order] == ["force"]
    assert [row.variable.name for row in layout.described("2.0")] == ["force", "later"]
    assert layout.n_slots == 4


def test_a_variable_depends_constantly_only_if_every_element_does() -> None:
    """Expected: of three elements, one dependent; of another known, none."""
    first = {name: PLANT.by_name[name].first for name in ("acceleration", "velocity", "position", "external_force")}
    slots: dict[int, dict[int, Kind]] = {
        first["acceleration"]: {first["velocity"]: "constant", first["position"] + 1: "constant"},
        first["acceleration"] + 1: {first["velocity"] + 2: "dependent", first["position"]: "constant"},
        first["acceleration"] + 2: {first["velocity"] + 1: "constant", first["external_force"]: "dependent"},
    }
    changed = replace(component(), dependencies=slots)
    document = ET.fromstring(model_description.model_description(changed, "3.0", "", ()))
    reference = str(PLANT.by_name["acceleration"].reference)
    (output,) = (element for element in document.iter("Output") if element.get("valueReference") == reference)
    names = [PLANT.rows[int(number)].variable.name for number in output.attrib["dependencies"].split()]
    assert names == ["external_force", "position", "velocity"]
    assert output.attrib["dependenciesKind"].split() == ["dependent", "constant", "dependent"]


def test_infinity_has_the_type_of_the_arithmetic() -> None:
    x = casadi.SX.sym("x")
    function = casadi.Function("f", [x], [casadi.vertcat(x, casadi.inf)], ["x"], ["y"])
    assert "((float)HUGE_VAL)" in codegen.function_source(function, "void ", codegen.Types("float"))
    assert "HUGE_VAL" in (text := codegen.function_source(function))
    assert "(double)HUGE_VAL" not in text
