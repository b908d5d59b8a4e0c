"""Documents in a unit's archive, against the table of variables, the platform, the unit itself and the standards."""

import csv
import html
import re
import zipfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import metadata
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from fmpy.util import read_csv
from fmpy.validation import validate_fmu
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.fmu_plants import STATES, Fmu, plant
from tests.support.lagrangian import FloatArray
from tests.support.plain_motion import trajectory
from tests.support.schemas import complaints_of_schemas
from tests.support.uneven import MOVING, UNEVEN

ROOT = Path(__file__).parents[2]
PACKAGE = metadata("gough-stewart")
TABLE = {v.name: v for v in gs.VARIABLES}
INPUTS = ("actuator_force", "external_force", "external_torque")
# Whose names are to be escaped, and whose z axis points at the viewer of its picture.
ODD = replace(
    *(UNEVEN,),
    name='<b>&"mine"</b>',
    source="<script>alert(1)</script>",
    home_orientation=np.radians([66.0, -0.0, 35]),
    **dict.fromkeys(("leg_length_min", "leg_length_max", "joint_angle_max", "actuator_force_max")),
)
PLATFORMS = {"uneven": UNEVEN, "odd": ODD, "desktop_hexapod": gs.load_preset("desktop_hexapod")}


@pytest.fixture(scope="module", params=PLATFORMS)
def pictured(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[gs.Platform, Fmu]:
    """A platform with its unit, FMI 3.0."""
    platform = PLATFORMS[request.param]
    return platform, Fmu(gs.build(tmp_path_factory.mktemp("pictured"), platform=platform, fmi=["3.0"])[0])


def xml(fmu: Fmu, place: str = "modelDescription.xml") -> ET.Element:
    return ET.parse(fmu.folder / place).getroot()


def test_every_document_follows_the_standard(any_fmu: Fmu) -> None:
    """Expected: the schemas of the standard, and FMPy's validation beyond them."""
    assert validate_fmu(str(any_fmu.path)) == []
    assert complaints_of_schemas(any_fmu) == {}


def test_declared_capabilities_are_those_that_are_tested(fmu: Fmu) -> None:
    """Each is tried in test_capabilities.py; none is promised beside those."""
    states = "FMUstate" if fmu.is_fmi2 else "FMUState"
    both, exchange = {f"canGetAndSet{states}", f"canSerialize{states}"}, set[str]()
    steps = {"canHandleVariableCommunicationStepSize"}
    if fmu.is_fmi2:
        both |= {"canNotUseMemoryManagementFunctions", "providesDirectionalDerivative"}
        steps |= {"canInterpolateInputs"}
    else:
        both |= {"providesDirectionalDerivatives", "providesAdjointDerivatives"}
        exchange |= {"needsCompletedIntegratorStep", "providesEvaluateDiscreteStates"}
        steps |= {"providesIntermediateUpdate", "canReturnEarlyAfterIntermediateUpdate"}
    for kind, own in (("ModelExchange", exchange), ("CoSimulation", steps)):
        (element,) = xml(fmu).iter(kind)
        assert {name for name, value in element.items() if value == "true"} == both | own
    assert element.get("maxOutputDerivativeOrder") == "1"


def starts_of(platform: gs.Platform) -> dict[str, Any]:
    """What a unit begins with, by name; 0 else."""
    home = {name: getattr(platform, f"home_{name}") for name in ("position", "orientation", "actuator_force")}
    return {name: home.get(name, getattr(platform, name, 0.0)) for name in TABLE}


DISPLAYED = {"m": "mm", "rad": "deg", "m/s": "mm/s", "rad/s": "deg/s", "rad/s2": "deg/s2"}


def test_variables_are_those_of_the_table_element_by_element(fmu: Fmu) -> None:
    """Expected: the table of variables; starts by the platform's own numbers, in the description and the binary."""
    derivatives = {f"der({name})" for name in STATES}
    with plant(fmu) as p:
        begun = p.everything()
    assert set(fmu.variables) == set(TABLE) | derivatives | {"fixed_step_size"} | (set() if fmu.is_fmi2 else {"time"})
    elements = xml(fmu).find("ModelVariables") or ()
    written = {e.get("name"): {**e.attrib, **(e[0].attrib if fmu.is_fmi2 else {})} for e in elements}
    for name, v in TABLE.items():
        whole = fmu.variables[name]
        assert whole.shape == v.shape
        has_start = v.causality in ("input", "parameter") or v.is_state
        value = np.broadcast_to(np.asarray(starts_of(UNEVEN)[name], dtype=float), v.shape)
        if has_start:
            assert np.array_equal(begun[name], value), name
            text = " ".join(declared.start for declared in whole.declared)
            assert [float(number) for number in text.split()] == value.ravel().tolist(), name
        for declared in whole.declared:
            assert (declared.description, declared.unit) == (v.description, v.unit)
            assert (declared.causality, declared.variability) == (v.causality, v.variability)
            assert (declared.start is not None) == has_start
            assert declared.min == (None if v.lower_bound is None else "0")
            attributes = written[declared.name]  # FMPy has defaults
            assert attributes.get("initial") == ("exact" if v.is_state else None)
            assert ("nominal" in attributes) == v.is_state
            assert attributes.get("displayUnit") == DISPLAYED.get(v.unit)
            is_between = not fmu.is_fmi2 and v.causality in ("input", "output")
            assert attributes.get("intermediateUpdate") == ("true" if is_between else None)
    by_name = {v.name: v for v in fmu.description.modelVariables}
    for name in derivatives:
        for declared in fmu.variables[name].declared:
            assert declared.derivative is by_name[declared.name.removeprefix("der(").removesuffix(")")]
            unit = declared.derivative.unit
            assert declared.unit == f"{unit}/s" if "/s" not in unit else f"{unit}2"


Shown = dict[str, dict[str, bool]]


@pytest.fixture(scope="module")
def shown(fmus: dict[str, Fmu]) -> Shown:
    """By unknown, what changes it at three random points, and whether always in proportion."""
    rng, fmu = np.random.default_rng(4), fmus["2.0"]
    unknowns = [v for v in fmu.description.modelVariables if v.causality in ("output", "local")]
    knowns = [v for v in fmu.description.modelVariables if v.start and v.name != "fixed_step_size"]
    quotients = np.zeros((3, len(knowns), len(unknowns)))
    references = [v.valueReference for v in unknowns]
    for point in quotients:
        with plant(fmu) as p:
            for name, value in MOVING.items():
                p.set(name, value + rng.uniform(-0.1, 0.1, value.shape))
            p.set("leg_friction_velocity", 0.3)
            base = np.array(p.fmu.getReal(references))
            for known, row in zip(knowns, point, strict=True):
                (value,) = p.fmu.getReal([known.valueReference])
                step = 0.01 * max(0.1, abs(value))
                p.fmu.setReal([known.valueReference], [value + step])
                change = np.array(p.fmu.getReal(references)) - base
                p.fmu.setReal([known.valueReference], [value])
                row[:] = np.where(np.abs(change) > 1e-9 * (1 + np.abs(base)), change / step, 0)
    constant = np.ptp(quotients, axis=0) < 1e-8 * np.abs(quotients).max(axis=0)
    return {
        v.name: {known.name: bool(constant[j, k]) for j, known in enumerate(knowns) if quotients[:, j, k].any()}
        for k, v in enumerate(unknowns)
    }


def whole_of(name: str) -> str:
    return re.sub(r"\[[\d,]+\]", "", name)


def test_dependencies_are_those_that_differences_show(fmu: Fmu, shown: Shown) -> None:
    """Expected: no more, no less; initial unknowns depend on parameters, too."""
    description = fmu.description
    causality = {v.name: v.causality for v in description.modelVariables}
    expected = shown
    if not fmu.is_fmi2:
        expected = {}
        for unknown, knowns in shown.items():
            whole = expected.setdefault(whole_of(unknown), {})
            for known, is_constant in knowns.items():
                whole[whole_of(known)] = whole.get(whole_of(known), True) and is_constant
    constants = 0
    for unknown in (*description.outputs, *description.derivatives, *description.initialUnknowns):
        is_initial = any(unknown is initial for initial in description.initialUnknowns)
        changing = expected[unknown.variable.name]
        names = {k for k in changing if is_initial or causality[k] != "parameter"}
        assert {known.name for known in unknown.dependencies} == names, unknown.variable.name
        references = [known.valueReference for known in unknown.dependencies]
        assert references == sorted(references)
        for known, kind in zip(unknown.dependencies, unknown.dependenciesKind, strict=True):
            assert kind == "dependent" or changing[known.name], (unknown.variable.name, known.name)
            constants += kind == "constant"
    assert constants >= (15 if fmu.is_fmi2 else 5)  # states that are outputs, rates that are velocities
    states = [name for name in expected if whole_of(name) in STATES]
    outputs = {name for name, kind in causality.items() if kind == "output"}
    assert {u.variable.name for u in description.outputs} == outputs
    derivatives = {name for name in expected if name.startswith("der(")}
    assert {u.variable.name for u in description.derivatives} == derivatives
    assert {u.variable.name for u in description.initialUnknowns} == (outputs | derivatives) - set(states)


def test_terminals_join_the_actuators_the_pose_and_the_load(fmus: dict[str, Fmu]) -> None:
    """Expected: by name, in the order of use; in FMI 2.0 a terminal for each leg."""
    scalars, root = (xml(fmus[version], "terminalsAndIcons/terminalsAndIcons.xml") for version in ("2.0", "3.0"))
    legs = [[member.get("variableName") for member in terminal] for terminal in scalars.iter("Terminal")][:6]
    assert legs == [[f"{name}[{k}]" for name in ("actuator_force", "leg_length", "leg_velocity")] for k in range(1, 7)]
    found = {(t.get("name"), t.get("description")): [m.get("variableName") for m in t] for t in root.iter("Terminal")}
    assert found == {
        ("actuators", "the six actuators"): ["actuator_force", "leg_length", "leg_velocity"],
        ("pose", "pose and its rates"): list(STATES),
        ("external_wrench", "load at Op"): list(INPUTS[1:]),
    }
    assert {t.get("matchingRule") for t in root.iter("Terminal")} == {"plug"}
    assert {m.get("variableKind") for m in root.iter("TerminalMemberVariable")} == {"signal"}
    (box,) = root.iter("Icon")
    assert dict(box.attrib) == {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}


def test_the_archive_is_complete_portable_and_of_no_day(fmu: Fmu) -> None:
    """Expected: names of the standard, relative, with slashes; Unix permissions; one date; no place of the build."""
    with zipfile.ZipFile(fmu.path) as archive:
        entries = archive.infolist()
        contents = {entry.filename: archive.read(entry) for entry in entries}
    assert entries[0].filename == "modelDescription.xml"
    assert {(e.create_system, e.date_time, e.compress_type) for e in entries} == {
        (3, (1980, 1, 1, 0, 0, 0), zipfile.ZIP_DEFLATED)
    }
    for entry in entries:
        assert not re.match(r"[/.]|.*\\", entry.filename)
        assert oct(entry.external_attr >> 16) == ("0o755" if entry.filename.startswith("binaries/") else "0o644")
    assert not any(str(Path.home()).encode() + b"/" in content for content in contents.values())
    assert contents["documentation/licenses/license.txt"].decode() == (ROOT / "LICENSE").read_text()
    notice = contents["documentation/licenses/fmi-headers.txt"].decode()
    assert notice.startswith("Copyright")
    assert "Modelica Association" in notice
    assert ("model.png" in contents) == fmu.is_fmi2
    sources = {PurePosixPath(name).name for name in contents if name.startswith("sources/")}
    compiled = {name for name in sources if name.endswith(".c")}
    assert {f"fmi{fmu.version[0]}{part}.h" for part in ("Functions", "FunctionTypes")} < sources
    build = xml(fmu, "sources/buildDescription.xml")
    (file_set,) = build.iter("SourceFileSet")
    assert {file.get("name") for file in file_set} == compiled
    assert file_set.get("language") == "C11"
    assert "compilerOptions" not in file_set.attrib or "compiler" in file_set.attrib
    assert [b.get("modelIdentifier") for b in build.iter("BuildConfiguration")] == ["gough_stewart"]
    assert (f"fmi{'3' if fmu.is_fmi2 else '2'}.c" in compiled) is False


def columns(fmu: Fmu, case: str, kind: str) -> dict[str, FloatArray]:
    """Whole variables (rows, n) of a file in the form of the cross-check."""
    table, found = read_csv(fmu.folder / f"extra/gough_stewart/{case}/gough_stewart_{kind}.csv"), dict[str, list[Any]]()
    for name in table.dtype.names:
        found.setdefault(name.split("[")[0], []).append(np.atleast_1d(table[name]).reshape(len(table), -1))
    return {name: np.concatenate(parts, axis=1) for name, parts in found.items()}


@pytest.mark.parametrize("case", ["open_loop", "varying_inputs"])
def test_reference_results_are_those_of_the_lagrangian_under_the_documented_inputs(fmu: Fmu, case: str) -> None:
    """Expected: leg k pushes with its static force ± 10 %, k periods of it; or the paper's case by Froude's rule."""
    results, inputs, start = (columns(fmu, case, kind) for kind in ("ref", "in", "start"))
    options = dict(
        csv.reader((fmu.folder / f"extra/gough_stewart/{case}/gough_stewart_ref.opt").read_text().splitlines())
    )
    assert "SciPy's DOP853 at tolerance 1e-12" in (fmu.folder / "extra/gough_stewart/README.txt").read_text()
    paper = gs.load_preset("liu2000")
    lengths = [gs.leg_geometry(p, p.home_position, p.home_orientation).length.mean() for p in (UNEVEN, paper)]
    root = np.sqrt(lengths[0] / lengths[1])
    time = results["time"][:, 0]
    np.testing.assert_allclose(time, np.arange(101) * root / 100, rtol=1e-12, atol=1e-15)
    assert {name: float(text) for name, text in options.items()} == pytest.approx(
        {"StartTime": 0.0, "StopTime": root, "StepSize": root / 100, "RelTol": 1e-8, "OutputIntervalLength": root / 100}
    )
    hold = np.asarray(UNEVEN.home_actuator_force)
    share = (np.arange(101) / 100)[:, None]
    if case == "open_loop":
        expected = np.tile([*hold * np.array([55 / 49.5, 1] * 3), *np.zeros(6)], (101, 1))
        begin = [*UNEVEN.home_position, *(UNEVEN.home_orientation - [0, 0, 0.1]), 0, 0.2 * root, 0, 0, 0.1 / root, 0]
    else:
        weight, size = UNEVEN.platform_mass * 9.81, np.sqrt((UNEVEN.platform_points**2).sum() / 6)
        wrench = weight * np.array([0.05, -0.03, 0.1, 0.01 * size, 0.02 * size, -0.01 * size])
        forces = hold * (1 + np.sin(2 * np.pi * share * np.arange(1, 7)) / 10)
        # sin² a = (1 − cos 2a)/2
        expected = np.concatenate([forces, wrench * (1 - np.cos(2 * np.pi * share)) / 2], axis=1)
        begin = [*UNEVEN.home_position, *UNEVEN.home_orientation, *np.zeros(6)]
    u = np.concatenate([inputs[name] for name in INPUTS], axis=1)
    np.testing.assert_allclose(u, expected, rtol=1e-12, atol=1e-10)
    x = np.concatenate([start[name][0] for name in STATES])
    np.testing.assert_allclose(x, begin, rtol=1e-12, atol=1e-15)
    assert set(results) - {"time"} == {v.name for v in gs.VARIABLES if v.causality == "output"}
    found, rows = np.concatenate([results[name] for name in STATES], axis=1), [0]
    for k in range(20):  # linear between rows, so that the integration begins anew at each
        x = trajectory(UNEVEN, x, lambda t: np.array([np.interp(t, time, column) for column in u.T]), time[k : k + 2])[
            -1
        ]
        rows.append(k + 1)
        assert found[k + 1] == pytest.approx(x, abs=2e-10)


def page_of(fmu: Fmu) -> str:
    return (fmu.folder / "documentation/index.html").read_text()


def test_the_pages_table_has_every_variable_with_its_numbers(fmu: Fmu) -> None:
    """Expected: six digits of the platform's numbers, one for equal ones, rows of a matrix; the contract's limits."""
    body = ET.fromstring(page_of(fmu)).find(".//{*}tbody")
    assert body is not None
    rows = {}
    for row in body:
        cells = [" ".join(" ".join(cell.itertext()).split()).replace("−", "-") for cell in row]
        rows[cells[0].split()[0]] = cells
    assert list(rows) == [whole_of(name) for name in fmu.variables]
    for name, v in TABLE.items():
        _, shape, causality, unit, start, description = rows[name]
        assert shape == (" × ".join(map(str, v.shape)) or "scalar")
        assert causality == (f"{v.variability} parameter" if v.causality == "parameter" else v.causality)
        assert (unit, description) == (v.unit, v.description)
        value = np.broadcast_to(np.asarray(starts_of(UNEVEN)[name], dtype=float), v.shape).ravel()
        if v.causality not in ("input", "parameter") and not v.is_state:
            assert start == ""
        elif len(set(value)) == 1:
            assert start == f"{value[0]:.6g}"
        else:
            assert start.split() == [f"{x + 0.0:.6g}" for x in value], name
    page = " ".join("".join(ET.fromstring(page_of(fmu)).itertext()).split())
    tunable = ", ".join(name for name, whole in fmu.variables.items() if whole.declared[0].variability == "tunable")
    a, b = ("between communication steps", "event and continuous-time") if fmu.is_fmi2 else ("in step mode", "event")
    when = f"({a} in Co-Simulation, in {b} mode in Model Exchange): {tunable}."
    limits = ("from 1e-13 to 1e-2, by default 1e-8;", "than 20,000 internal steps (1,000,000 fixed ones)")
    for words in (when, *limits, "by Kutta’s 3/8 rule of order 4 with", "the platform stands still."):
        assert words in page, words
    first = rows["platform_points"][0]
    last = " platform_points[1,1] … platform_points[6,3]" if fmu.is_fmi2 else ""
    assert first == f"platform_points{last}"


def test_the_example_of_the_page_runs_as_it_stands(
    fmu: Fmu, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the pose that the unit reaches step by step under 5 % more than the static forces."""
    monkeypatch.chdir(fmu.path.parent)
    found = re.search(r"<pre><code>(.*?)</code></pre>", page_of(fmu), re.S)
    assert found
    names: dict[str, Any] = {}
    exec(html.unescape(found[1]), names)
    said = capsys.readouterr().out.splitlines()[-1]
    shown_pose = np.array([float(number) for number in said.strip("[]").split()])
    with plant(fmu) as p:
        p.start({"actuator_force": [float(f"{force:.6g}") for force in 1.05 * UNEVEN.home_actuator_force]})
        for k in range(50):
            p.do_step(k * 0.01, 0.01)
        pose, length = p.get("position"), p.get("leg_length")[0]
    assert shown_pose == pytest.approx(pose[2:] if fmu.is_fmi2 else pose, rel=1e-6)
    assert len(names["result"]) == 51
    last = names["result"][-1]
    assert last["time"] == pytest.approx(0.5)
    assert (last["leg_length[1]"] if fmu.is_fmi2 else last["leg_length"][0]) == pytest.approx(length, rel=1e-6)


SVG = "{http://www.w3.org/2000/svg}"
# A view from 24° above the ground at an azimuth of −55°, by SciPy's rotations.
VIEW = Rotation.from_euler("zx", [-35.0, -66.0], degrees=True)


def points_of(element: ET.Element) -> FloatArray:
    return np.array([[float(number) for number in place.split(",")] for place in element.attrib["points"].split()])


def dots_of(svg: ET.Element) -> list[tuple[FloatArray, float, str]]:
    """Centre, radius and colour of the lines without a length."""
    lines = [(points_of(line), line.attrib) for line in svg.iter(f"{SVG}polyline")]
    return [(p[0], float(look["stroke-width"]) / 2, look["stroke"]) for p, look in lines if (p[0] == p[-1]).all()]


def pictures_of(fmu: Fmu) -> Iterator[ET.Element]:
    """The icon, then the drawing on the page."""
    yield ET.parse(fmu.folder / "terminalsAndIcons/icon.svg").getroot()
    yield from ET.parse(fmu.folder / "documentation/index.html").getroot().iter(f"{SVG}svg")


def joints_of(platform: gs.Platform) -> tuple[FloatArray, FloatArray]:
    turn = Rotation.from_euler("xyz", platform.home_orientation)
    return platform.base_points, platform.home_position + turn.apply(np.array(platform.platform_points))


def test_joints_and_axes_are_where_rotations_have_them(pictured: tuple[gs.Platform, Fmu]) -> None:
    """Expected: dots of all joints in the view; the tip of z_p along the third column of R; names of the notation."""
    platform, fmu = pictured
    seen = VIEW.apply(np.concatenate(joints_of(platform)))[:, :2] * [1, -1]
    icon, drawing = pictures_of(fmu)
    for svg in (icon, drawing):
        dots = np.array([centre for centre, _, _ in dots_of(svg)])
        assert dots.shape == (12, 2)
        scale = np.ptp(dots[:, 0]) / np.ptp(seen[:, 0])
        np.testing.assert_allclose(dots - dots[0], scale * (seen - seen[0]), atol=0.02)
        # legs are drawn from the farthest to the nearest, by where their two parts meet
        feet = [points_of(line)[0] for line in svg.iter(f"{SVG}polyline") if line.get("stroke") == "#8A6D3B"]
        legs = [int(np.hypot(*(dots[:6] - foot).T).argmin()) for foot in feet]
        base, top = joints_of(platform)
        towards_viewer = VIEW.apply(base + 0.54 * (top - base))[:, 2]
        assert sorted(legs) == list(range(6))
        assert (np.diff(towards_viewer[legs]) > -1e-9).all()
        width, height = (float(number) for number in svg.attrib["viewBox"].split()[2:])
        drawn = np.concatenate([points_of(element) for element in svg.iter() if "points" in element.attrib])
        assert ((drawn >= 0) & (drawn <= [width, height])).all()
    texts = {"".join(text.itertext()) for text in drawing.iter(f"{SVG}text")}
    assert texts >= {"X0", "Y0", "Z0", "xp", "yp", "zp", "Op", "Bi", "Pi", "ui", "leg_length", "actuator_force > 0"}
    tips = np.array([points_of(area)[0] for area in drawing.iter(f"{SVG}polygon")][2:])
    assert len(tips) == 11 - (platform is ODD)  # an axis towards the viewer has no arrow
    if platform is UNEVEN:
        column = Rotation.from_euler("xyz", platform.home_orientation).apply([0, 0, 1])
        origin, axis = (VIEW.apply(np.array(vector))[:2] * [1, -1] for vector in (platform.home_position, column))
        away = tips - (dots[0] + scale * (origin - seen[0]))
        across = np.abs(away[:, 0] * axis[1] - away[:, 1] * axis[0]) / np.hypot(*axis)
        assert (across < 0.03).sum() == 1


def test_the_head_names_model_package_licence_and_experiment(fmu: Fmu) -> None:
    """Expected: pyproject.toml through the installed metadata, and the names that users type."""
    root = xml(fmu)
    assert dict(root.attrib) == {
        **{"fmiVersion": fmu.version, "modelName": "GoughStewart", "variableNamingConvention": "structured"},
        **{"description": PACKAGE["Summary"], "version": PACKAGE["Version"], "license": "BSD-3-Clause"},
        **{"copyright": "the gough-stewart authors", "generationTool": f"gough-stewart {PACKAGE['Version']}"},
        **({"guid": fmu.token, "numberOfEventIndicators": "0"} if fmu.is_fmi2 else {"instantiationToken": fmu.token}),
    }
    assert [len(part) for part in fmu.token.strip("{}").split("-")] == [8, 4, 4, 4, 12]
    assert fmu.token.startswith("{") == fmu.is_fmi2
    (experiment,) = root.iter("DefaultExperiment")
    assert experiment.attrib == {"startTime": "0", "stopTime": "1", "tolerance": "1e-08", "stepSize": "0.001"}
    categories = [category.get("name") for category in root.iter("Category")]
    assert categories == ["logStatusWarning", "logStatusDiscard", "logStatusError", "logAll"]


def test_units_have_the_dimensions_of_their_names_and_are_shown_in_degrees_and_millimetres(fmu: Fmu) -> None:
    """Expected: N = kg m/s², J = N m, and the rest read off the name."""
    bases: dict[str, dict[str, int]] = {"1": {}, "N": {"kg": 1, "m": 1, "s": -2}, "J": {"kg": 1, "m": 2, "s": -2}}
    units = {unit.get("name", ""): unit for unit in xml(fmu).iter("Unit")}
    assert set(units) == {v.unit for v in fmu.description.modelVariables if v.unit}
    for name, unit in units.items():
        expected = Counter[str]()
        for part, sign in zip(name.partition("/")[::2], (1, -1), strict=True):
            for factor in filter(None, part.split(".")):
                symbol, power = (factor[:-1], 2) if factor.endswith("2") else (factor, 1)
                for base, exponent in bases.get(symbol, {symbol: 1}).items():
                    expected[base] += sign * power * exponent
        (exponents,) = unit.iter("BaseUnit")
        assert {base: int(n) for base, n in exponents.items()} == {b: n for b, n in expected.items() if n}, name
        displays = {display.get("name"): float(display.get("factor", 1)) for display in unit.iter("DisplayUnit")}
        scale = 1000 if name[0] == "m" else 180 / np.pi
        assert displays == ({DISPLAYED[name]: pytest.approx(scale, rel=1e-15)} if name in DISPLAYED else {})
