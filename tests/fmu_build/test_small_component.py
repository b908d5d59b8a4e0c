"""A small component with one variable of each kind: its documents and tables, whole, as read against the standard.

Two inputs, two states, a result of another size, a local, a matrix, tunable and fixed parameters, a setting of the
unit, and a parameter that was added after time. The documents are written as outlines: a line for each element, a dot
for each level.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from gough_stewart.fmu_build.build import unit_of
from gough_stewart.fmu_build.component import (
    Icon,
    Layout,
    Role,
    Sources,
    UnitComponent,
    UnitTerminal,
    laid_out,
    terminals_of,
)
from gough_stewart.fmu_build.documents import (
    UNITS,
    build_description,
    model_description,
    package_metadata,
    terminals_and_icons,
)
from gough_stewart.fmu_build.documents import rendered as page_of
from gough_stewart.fmu_build.sources import layout_number, model_header, model_source, places, start_source
from gough_stewart.model.interface import Variable

LAYOUT = laid_out(
    [
        Variable("force", (2,), "N", "input", "continuous", "forces & more"),
        Variable("angle", (2,), "rad", "output", "continuous", "two angles", is_state=True, nominal=0.02),
        Variable("length", (3,), "m", "output", "continuous", "three lengths"),
        Variable("energy", (), "J", "local", "continuous", "energy"),
        Variable("table", (2, 3), "m", "parameter", "fixed", "a table"),
        Variable("mass", (), "kg", "parameter", "tunable", "a mass", lower_bound="> 0"),
        Variable("setting", (), "s", "parameter", "fixed", "of the unit", lower_bound=">= 0"),
    ],
    {"angle": "rad/s"},
    [Variable("gain", (2,), "N/m", "parameter", "tunable", "added later")],
)
STARTS = {
    "force": np.array([1.5, -2]),
    "angle": np.array([0.1, 0.2]),
    "table": np.arange(6.0).reshape(2, 3) / 8,
    "mass": np.array(7.0),
    "setting": np.array(0.25),
    "gain": np.array([3.0, 4e-9]),
}
SMALL = UnitComponent(
    identifier="small",
    name="Small\x01",
    description="a small <component>",
    file_stem="small_one",
    layout=LAYOUT,
    starts=STARTS,
    dependencies={
        16: {2: "dependent", 3: "constant"},
        17: {0: "dependent", 1: "dependent", 3: "dependent", 14: "dependent"},
        2: {2: "constant"},
        3: {3: "constant"},
        4: {2: "constant", 8: "dependent"},
        5: {2: "constant", 3: "constant"},
        6: {3: "dependent", 20: "constant"},
        7: {1: "dependent"},
    },
    experiment={"startTime": "0.5", "stopTime": "2", "tolerance": "1e-05"},
    code=Sources({"own.c": "int own;"}, {"own.h": "own"}),
    icon=Icon(b"png", b"svg"),
    terminals=lambda version: (
        UnitTerminal("first", "1st", {"a": "b", "c": version}),
        UnitTerminal("second", "2nd", {}),
    ),
    documents=lambda version: {"x/y": version.encode()},
    settings=frozenset({"setting"}),
    saved_form="third",
)


def outline(document: bytes) -> list[str]:
    """Words of all elements in order, with a dot before the tag for each level."""

    def words(element: ET.Element, depth: int) -> Iterator[str]:
        yield "." * depth + element.tag
        for name, value in element.attrib.items():
            yield from f"{name}={value}".split(" ")
        for each in element:
            yield from words(each, depth + 1)

    return list(words(ET.fromstring(document), 0))


OUTLINE_2 = """
fmiModelDescription fmiVersion=2.0 modelName=Small� description=a small <component> version=0.2.0 copyright=the
    gough-stewart authors license=BSD-3-Clause generationTool=gough-stewart 0.2.0
    variableNamingConvention=structured guid=TOKEN numberOfEventIndicators=0
.ModelExchange modelIdentifier=small canNotUseMemoryManagementFunctions=true canGetAndSetFMUstate=true
     canSerializeFMUstate=true providesDirectionalDerivative=true
..SourceFiles
...File name=b.c
...File name=a.c
.CoSimulation modelIdentifier=small canNotUseMemoryManagementFunctions=true canGetAndSetFMUstate=true
     canSerializeFMUstate=true providesDirectionalDerivative=true canHandleVariableCommunicationStepSize=true
     canInterpolateInputs=true maxOutputDerivativeOrder=1
..SourceFiles
...File name=b.c
...File name=a.c
.UnitDefinitions
..Unit name=N
...BaseUnit kg=1 m=1 s=-2
..Unit name=m
...BaseUnit m=1
...DisplayUnit name=mm factor=1000.0
..Unit name=rad
...BaseUnit rad=1
...DisplayUnit name=deg factor=57.29577951308232
..Unit name=rad/s
...BaseUnit s=-1 rad=1
...DisplayUnit name=deg/s factor=57.29577951308232
..Unit name=J
...BaseUnit kg=1 m=2 s=-2
..Unit name=kg
...BaseUnit kg=1
..Unit name=s
...BaseUnit s=1
..Unit name=N/m
...BaseUnit kg=1 s=-2
.LogCategories
..Category name=logStatusWarning description=minor problems; the reason for terminating Model Exchange
..Category name=logStatusDiscard description=rejected values and steps not completed, with quantity, value and time
..Category name=logStatusError description=invalid calls, with what was expected; always logged
..Category name=logAll description=all messages
.DefaultExperiment startTime=0.5 stopTime=2 tolerance=1e-05
.ModelVariables
..ScalarVariable name=force[1] valueReference=0 description=forces & more causality=input variability=continuous
...Real unit=N start=1.5
..ScalarVariable name=force[2] valueReference=1 description=forces & more causality=input variability=continuous
...Real unit=N start=-2.0
..ScalarVariable name=angle[1] valueReference=2 description=two angles causality=output variability=continuous
      initial=exact
...Real unit=rad displayUnit=deg start=0.1 nominal=0.02
..ScalarVariable name=angle[2] valueReference=3 description=two angles causality=output variability=continuous
      initial=exact
...Real unit=rad displayUnit=deg start=0.2 nominal=0.02
..ScalarVariable name=length[1] valueReference=4 description=three lengths causality=output variability=continuous
...Real unit=m displayUnit=mm
..ScalarVariable name=length[2] valueReference=5 description=three lengths causality=output variability=continuous
...Real unit=m displayUnit=mm
..ScalarVariable name=length[3] valueReference=6 description=three lengths causality=output variability=continuous
...Real unit=m displayUnit=mm
..ScalarVariable name=energy valueReference=7 description=energy causality=local variability=continuous
...Real unit=J
..ScalarVariable name=table[1,1] valueReference=8 description=a table causality=parameter variability=fixed
...Real unit=m displayUnit=mm start=0.0
..ScalarVariable name=table[1,2] valueReference=9 description=a table causality=parameter variability=fixed
...Real unit=m displayUnit=mm start=0.125
..ScalarVariable name=table[1,3] valueReference=10 description=a table causality=parameter variability=fixed
...Real unit=m displayUnit=mm start=0.25
..ScalarVariable name=table[2,1] valueReference=11 description=a table causality=parameter variability=fixed
...Real unit=m displayUnit=mm start=0.375
..ScalarVariable name=table[2,2] valueReference=12 description=a table causality=parameter variability=fixed
...Real unit=m displayUnit=mm start=0.5
..ScalarVariable name=table[2,3] valueReference=13 description=a table causality=parameter variability=fixed
...Real unit=m displayUnit=mm start=0.625
..ScalarVariable name=mass valueReference=14 description=a mass causality=parameter variability=tunable
...Real unit=kg min=0 start=7.0
..ScalarVariable name=setting valueReference=15 description=of the unit causality=parameter variability=fixed
...Real unit=s min=0 start=0.25
..ScalarVariable name=der(angle[1]) valueReference=16 description=time derivative of angle causality=local
      variability=continuous
...Real unit=rad/s displayUnit=deg/s derivative=3
..ScalarVariable name=der(angle[2]) valueReference=17 description=time derivative of angle causality=local
      variability=continuous
...Real unit=rad/s displayUnit=deg/s derivative=4
..ScalarVariable name=gain[1] valueReference=19 description=added later causality=parameter variability=tunable
...Real unit=N/m start=3.0
..ScalarVariable name=gain[2] valueReference=20 description=added later causality=parameter variability=tunable
...Real unit=N/m start=4e-09
.ModelStructure
..Outputs
...Unknown index=3 dependencies=3 dependenciesKind=constant
...Unknown index=4 dependencies=4 dependenciesKind=constant
...Unknown index=5 dependencies=3 dependenciesKind=constant
...Unknown index=6 dependencies=3 4 dependenciesKind=constant constant
...Unknown index=7 dependencies=4 dependenciesKind=dependent
..Derivatives
...Unknown index=17 dependencies=3 4 dependenciesKind=dependent constant
...Unknown index=18 dependencies=1 2 4 dependenciesKind=dependent dependent dependent
..InitialUnknowns
...Unknown index=5 dependencies=3 9 dependenciesKind=constant dependent
...Unknown index=6 dependencies=3 4 dependenciesKind=constant constant
...Unknown index=7 dependencies=4 20 dependenciesKind=dependent constant
...Unknown index=17 dependencies=3 4 dependenciesKind=dependent constant
...Unknown index=18 dependencies=1 2 4 15 dependenciesKind=dependent dependent dependent dependent
"""
OUTLINE_3 = """
fmiModelDescription fmiVersion=3.0 modelName=Small� description=a small <component> version=0.2.0 copyright=the
    gough-stewart authors license=BSD-3-Clause generationTool=gough-stewart 0.2.0
    variableNamingConvention=structured instantiationToken=TOKEN
.ModelExchange modelIdentifier=small canGetAndSetFMUState=true canSerializeFMUState=true
     providesDirectionalDerivatives=true providesAdjointDerivatives=true needsCompletedIntegratorStep=true
     providesEvaluateDiscreteStates=true
.CoSimulation modelIdentifier=small canGetAndSetFMUState=true canSerializeFMUState=true
     providesDirectionalDerivatives=true providesAdjointDerivatives=true canHandleVariableCommunicationStepSize=true
     maxOutputDerivativeOrder=1 providesIntermediateUpdate=true canReturnEarlyAfterIntermediateUpdate=true
.UnitDefinitions
..Unit name=N
...BaseUnit kg=1 m=1 s=-2
..Unit name=m
...BaseUnit m=1
...DisplayUnit name=mm factor=1000.0
..Unit name=rad
...BaseUnit rad=1
...DisplayUnit name=deg factor=57.29577951308232
..Unit name=rad/s
...BaseUnit s=-1 rad=1
...DisplayUnit name=deg/s factor=57.29577951308232
..Unit name=J
...BaseUnit kg=1 m=2 s=-2
..Unit name=kg
...BaseUnit kg=1
..Unit name=s
...BaseUnit s=1
..Unit name=N/m
...BaseUnit kg=1 s=-2
.LogCategories
..Category name=logStatusWarning description=minor problems; the reason for terminating Model Exchange
..Category name=logStatusDiscard description=rejected values and steps not completed, with quantity, value and time
..Category name=logStatusError description=invalid calls, with what was expected; always logged
..Category name=logAll description=all messages
.DefaultExperiment startTime=0.5 stopTime=2 tolerance=1e-05
.ModelVariables
..Float64 name=force valueReference=0 description=forces & more causality=input variability=continuous
      intermediateUpdate=true unit=N start=1.5 -2.0
...Dimension start=2
..Float64 name=angle valueReference=1 description=two angles causality=output variability=continuous initial=exact
      nominal=0.02 intermediateUpdate=true unit=rad displayUnit=deg start=0.1 0.2
...Dimension start=2
..Float64 name=length valueReference=2 description=three lengths causality=output variability=continuous
      intermediateUpdate=true unit=m displayUnit=mm
...Dimension start=3
..Float64 name=energy valueReference=3 description=energy causality=local variability=continuous unit=J
..Float64 name=table valueReference=4 description=a table causality=parameter variability=fixed unit=m
      displayUnit=mm start=0.0 0.125 0.25 0.375 0.5 0.625
...Dimension start=2
...Dimension start=3
..Float64 name=mass valueReference=5 description=a mass causality=parameter variability=tunable unit=kg min=0
      start=7.0
..Float64 name=setting valueReference=6 description=of the unit causality=parameter variability=fixed unit=s min=0
      start=0.25
..Float64 name=der(angle) valueReference=7 description=time derivative of angle causality=local
      variability=continuous unit=rad/s displayUnit=deg/s derivative=1
...Dimension start=2
..Float64 name=time valueReference=8 description=simulation time causality=independent variability=continuous unit=s
..Float64 name=gain valueReference=9 description=added later causality=parameter variability=tunable unit=N/m
      start=3.0 4e-09
...Dimension start=2
.ModelStructure
..Output valueReference=1 dependencies=1 dependenciesKind=constant
..Output valueReference=2 dependencies=1 dependenciesKind=dependent
..ContinuousStateDerivative valueReference=7 dependencies=0 1 dependenciesKind=dependent dependent
..InitialUnknown valueReference=2 dependencies=1 4 9 dependenciesKind=dependent dependent constant
..InitialUnknown valueReference=7 dependencies=0 1 5 dependenciesKind=dependent dependent dependent
"""

BUILD = """
fmiBuildDescription fmiVersion=3.0
.BuildConfiguration modelIdentifier=small
..SourceFileSet language=C11
...SourceFile name=b.c
...SourceFile name=a.c
..Library name=m external=true description=C mathematical library
"""
TERMINALS = """
fmiTerminalsAndIcons fmiVersion=3.0
.GraphicalRepresentation
..CoordinateSystem x1=-100 y1=-100 x2=100 y2=100 suggestedScalingFactorTo_mm=0.1
..Icon x1=-100 y1=-100 x2=100 y2=100
.Terminals
..Terminal name=first matchingRule=plug description=1st
...TerminalMemberVariable variableName=b memberName=a variableKind=signal
...TerminalMemberVariable variableName=2.0 memberName=c variableKind=signal
..Terminal name=second matchingRule=plug description=2nd
"""


@pytest.mark.parametrize(("fmi_version", "expected"), [("2.0", OUTLINE_2), ("3.0", OUTLINE_3)])
def test_the_description_is_what_the_standard_asks_for(fmi_version: str, expected: str) -> None:
    """Expected: read word by word against FMI 2.0.4 and FMI 3.0.1; derivatives and indices counted by hand."""
    document = model_description(SMALL, fmi_version, "TOKEN", ("b.c", "a.c"))
    assert outline(document) == expected.replace("0.2.0", package_metadata()["Version"]).split()
    assert document.startswith(b"<?xml version='1.0' encoding='UTF-8'?>\n<fmiModelDescription ")


@pytest.mark.parametrize("fmi_version", ["2.0", "3.0"])
def test_a_component_without_states_is_sampled_and_cannot_be_integrated(fmi_version: str) -> None:
    """Expected: no Model Exchange, no derivatives of any kind; time and the rest as before."""
    layout = laid_out([LAYOUT.by_name["force"].variable, LAYOUT.by_name["energy"].variable], {})
    sampled = replace(SMALL, layout=layout, dependencies={})
    words = outline(model_description(sampled, fmi_version, "TOKEN", ("b.c",)))
    assert ".ModelExchange" not in words
    assert ".CoSimulation" in words
    assert not any(re.search("Derivative|exact|nominal|Outputs", word) for word in words)
    assert "..Unknown" not in words


def test_build_description_and_terminals_have_each_name_in_its_place() -> None:
    """Expected: the schemas of FMI 3.0, by hand."""
    assert outline(build_description(SMALL, ("b.c", "a.c"))) == BUILD.split()
    assert outline(terminals_and_icons(SMALL, "2.0")) == TERMINALS.split()


def test_groups_of_terminals_that_are_empty_are_left_out() -> None:
    """Expected: by names; six actuators with a variable of six elements each."""
    six = [Variable(name, (6,), "N", "input", "continuous", "") for name in ("f", "g")]
    layout = laid_out([*six, Variable("h", (2,), "m", "output", "continuous", "")], {})
    groups = [("none", "nothing", ()), ("some", "something", ("h", "f"))]
    assert terminals_of(layout, "3.0", iter(("f", "g")), groups) == (
        UnitTerminal("actuators", "the six actuators", {"f": "f", "g": "g"}),
        UnitTerminal("some", "something", {"h": "h", "f": "f"}),
    )
    old = terminals_of(layout, "2.0", iter(("f", "g")), groups)
    assert old[3] == UnitTerminal("actuator_4", "actuator of leg 4", {"f": "f[4]", "g": "g[4]"})
    assert [each.name for each in old] == [*(f"actuator_{leg}" for leg in range(1, 7)), "some"]
    names = ["h[1]", "h[2]", *(f"f[{k}]" for k in range(1, 7))]
    assert old[-1] == UnitTerminal("some", "something", dict(zip(names, names, strict=True)))


def numbers_of(text: str, name: str) -> list[float]:
    """Elements of an array in C."""
    found = re.search(rf"\b{name}\[\w*\] = {{(.*?)}};", text, re.S)
    assert found
    return [float(each) for each in found[1].replace("\n", " ").split(",") if each.strip()]


def started(component: UnitComponent) -> dict[str, list[float]]:
    """The vectors of the block of start values in C, in the order of its members."""
    members = re.findall(r"^    double (\w+)\[(\d+)\];$", model_header(component), re.M)
    text = start_source(component, ("two", "three"))
    assert '"two", "three"' in text
    vectors = re.findall(r"^    \{\n(.*?)\n    \},$", text, re.M | re.S)
    found = [[float(each) for each in vector.split(",") if each.strip()] for vector in vectors]
    assert [len(each) for each in found] == [int(size) for _, size in members]
    return dict(zip([name for name, _ in members], found, strict=True))


def test_the_tables_in_c_have_slots_sizes_and_starts() -> None:
    """Expected: counted by hand; `gain` is behind time, so only its start value is among the parameters."""
    small = replace(SMALL, options={"IS_SLOW": 1, "LEAST": 0.75})
    header = dict(re.findall(r"^#define (\w+) (\S+)$", model_header(small), re.M))
    of_start = {name: header.pop(name) for name, text in list(header.items()) if text.startswith("START.")}
    assert of_start == {
        "DEFAULT_TOLERANCE": "START.tolerance[0]",
        "START_INPUTS": "START.inputs",
        "START_STATES": "START.states",
        "START_PARAMETERS": "START.parameters",
        "START_SETTING": "START.settings[0]",
        "IS_SLOW": "START.options[0]",
        "LEAST": "START.options[1]",
    }
    assert {name: float(text) for name, text in header.items()} == {
        **{"N_INPUTS": 2, "N_STATES": 2, "N_OUTPUTS": 5, "N_RESULTS": 6, "N_PARAMETERS": 9},
        **{"N_SLOTS": 21, "N_VARIABLES": 10, "FIRST_INPUT": 0, "FIRST_STATE": 2, "FIRST_RESULT": 2},
        **{"FIRST_PARAMETER": 8, "FIRST_DERIVATIVE": 16, "TIME": 18},
        "LARGEST_NUMBER": 1e30,
        "SCALAR_REFERENCE": 10000,
    }
    source = model_source(SMALL)
    rows = re.findall(r"^    \{(.*)\},$", source, re.M)
    assert rows == [
        '"force", "N", 0, 2, 0, INPUT, ANY',
        '"angle", "rad", 2, 2, 0, STATE, ANY',
        '"length", "m", 4, 3, 0, RESULT, ANY',
        '"energy", "J", 7, 1, 0, RESULT, ANY',
        '"table", "m", 8, 6, 3, FIXED_PARAMETER, ANY',
        '"mass", "kg", 14, 1, 0, TUNABLE_PARAMETER, POSITIVE',
        '"setting", "s", 15, 1, 0, FIXED_PARAMETER, NOT_NEGATIVE',
        '"der(angle)", "rad/s", 16, 2, 0, DERIVATIVE, ANY',
        '"time", "s", 18, 1, 0, INDEPENDENT, ANY',
        '"gain", "N/m", 19, 2, 0, TUNABLE_PARAMETER, ANY',
    ]
    assert numbers_of(source, "VARIABLE_OF_SLOT") == [0, 0, 1, 1, 2, 2, 2, 3, *[4] * 6, 5, 6, 7, 7, 8, 9, 9]
    vectors = {
        "tolerance": [1e-5],
        "options": [1, 0.75],
        "inputs": [1.5, -2],
        "states": [0.1, 0.2],
        "parameters": [0, 0.125, 0.25, 0.375, 0.5, 0.625, 7, 3, 4e-9],
        "settings": [SMALL.starts["setting"].item()],
    }
    assert started(small) == vectors
    assert started(replace(SMALL, experiment={}))["tolerance"] == [1e-8]
    assert numbers_of(source, "NOMINAL_STATES") == [0.02, 0.02]
    without = model_source(replace(SMALL, layout=laid_out([LAYOUT.by_name["energy"].variable], {})))
    assert numbers_of(without, "NOMINAL_STATES") == [0]
    assert started(replace(SMALL, layout=laid_out([LAYOUT.by_name["energy"].variable], {})))["inputs"] == [0]
    assert places("Q", LAYOUT.rows[2:5]) == {"Q_LENGTH": 0, "Q_ENERGY": 3, "Q_TABLE": 4}


def test_the_number_of_a_layout_has_64_bits_of_names_shapes_roles_and_form() -> None:
    """Expected: another number where any of them is another, and none that does not fit."""
    variables = [Variable("a", (2,), "m", "parameter", "fixed", ""), Variable("b", (), "m", "input", "continuous", "")]
    others = [
        replace(variables[0], name="c"),
        replace(variables[0], shape=(3,)),
        replace(variables[0], variability="tunable"),
    ]
    layouts = [laid_out([first, variables[1]], {}) for first in (variables[0], *others)]
    numbers = {layout_number(replace(SMALL, layout=layout)) for layout in layouts}
    numbers |= {layout_number(replace(SMALL, layout=layouts[0], saved_form="other"))}
    assert len(numbers) == 5
    assert all(2**32 < number < 2**64 for number in numbers)
    same = laid_out([replace(variables[0], description="other", unit="s"), variables[1]], {})
    assert layout_number(replace(SMALL, layout=same)) in numbers


def test_rows_have_their_slots_roles_and_names() -> None:
    """Expected: by hand."""
    assert [(row.variable.name, row.reference, row.first, row.role) for row in LAYOUT.rows] == [
        ("force", 0, 0, Role.INPUT),
        ("angle", 1, 2, Role.STATE),
        ("length", 2, 4, Role.RESULT),
        ("energy", 3, 7, Role.RESULT),
        ("table", 4, 8, Role.FIXED_PARAMETER),
        ("mass", 5, 14, Role.TUNABLE_PARAMETER),
        ("setting", 6, 15, Role.FIXED_PARAMETER),
        ("der(angle)", 7, 16, Role.DERIVATIVE),
        ("time", 8, 18, Role.INDEPENDENT),
        ("gain", 9, 19, Role.TUNABLE_PARAMETER),
    ]
    rate = LAYOUT.by_name["der(angle)"]
    assert rate.scalar_names == ("der(angle[1])", "der(angle[2])")
    assert (rate.variable.unit, rate.variable.shape, rate.derivative_of) == ("rad/s", (2,), "angle")
    assert [row.variable.name for row in LAYOUT.outputs()] == ["angle", "length"]
    assert [row.variable.name for row in LAYOUT.in_order] == [row.variable.name for row in LAYOUT.rows[:8]]


def test_units_come_from_force_to_the_rarer_ones_with_their_dimensions() -> None:
    """Expected: SI, written out; degrees of a radian by π."""
    degrees = 180 / np.pi
    expected = [
        ("N", "kg m s-2", None),
        ("N.m", "kg m2 s-2", None),
        ("m", "m", ("mm", 1000)),
        ("rad", "rad", ("deg", degrees)),
        ("m/s", "m s-1", ("mm/s", 1000)),
        ("rad/s", "s-1 rad", ("deg/s", degrees)),
        ("m/s2", "m s-2", None),
        ("rad/s2", "s-2 rad", ("deg/s2", degrees)),
        ("J", "kg m2 s-2", None),
        ("kg", "kg", None),
        ("kg.m2", "kg m2", None),
        ("N.s/m", "kg s-1", None),
        ("s", "s", None),
        ("N/m", "kg s-2", None),
        ("N/(m.s)", "kg s-3", None),
        ("1", "", None),
        ("N/s", "kg m s-3", None),
        ("Hz", "s-1", None),
    ]
    assert [unit.name for unit in UNITS] == [name for name, _, _ in expected]
    for unit, (name, bases, display) in zip(UNITS, expected, strict=True):
        found = " ".join(f"{base}{power if power != 1 else ''}" for base, power in unit.exponents.items())
        assert found == bases, name
        assert (unit.display is None) == (display is None), name
        if unit.display is not None and display is not None:
            assert unit.display[0] == display[0]
            assert unit.display[1] == pytest.approx(display[1], rel=1e-15)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_the_table_of_the_page_has_a_row_for_each_variable(version: str) -> None:
    """Expected: shapes, causalities and starts by hand; matrices line by line, equal numbers once, six digits."""
    starts = STARTS | {"gain": np.array([2.0, 2.0]), "mass": np.array(1 / 3), "angle": np.array([-0.0, -1e-9])}
    page = ET.fromstring(
        page_of(
            "loop.html",
            title="A & B",
            notes=("<1",),
            fmi_version=version,
            rows=LAYOUT.described(version),
            starts=starts,
        )
    )
    assert page.findtext("{*}head/{*}title") == "A & B"
    rows = []
    for row in page.iterfind(".//{*}tbody/{*}tr"):
        cells = ["".join(cell.itertext()) for cell in row]
        lines = [row[4].text or "", *((each.tail or "") for each in row[4])]
        rows.append([*cells[:4], lines, cells[5]])
    expected = [
        ["force", "2", "input", "N", ["1.5 −2"], "forces & more"],
        ["angle", "2", "output", "rad", ["0 −1e−09"], "two angles"],
        ["length", "3", "output", "m", [""], "three lengths"],
        ["energy", "scalar", "local", "J", [""], "energy"],
        ["table", "2 × 3", "fixed parameter", "m", ["0 0.125 0.25", "0.375 0.5 0.625"], "a table"],
        ["mass", "scalar", "tunable parameter", "kg", ["0.333333"], "a mass"],
        ["setting", "scalar", "fixed parameter", "s", ["0.25"], "of the unit"],
        ["der(angle)", "2", "local", "rad/s", [""], "time derivative of angle"],
        ["time", "scalar", "independent", "s", [""], "simulation time"],
        ["gain", "2", "tunable parameter", "N/m", ["2"], "added later"],
    ]
    if version == "2.0":
        del expected[8]
        last = {"force": "[2]", "angle": "[2]", "length": "[3]", "table": "[2,3]", "gain": "[2]"}
        for each in expected:
            name = str(each[0])
            if name in last:
                first = "[1,1]" if name == "table" else "[1]"
                each[0] = f"{name}{name}{first} … {name}{last[name]}"
        expected[7][0] = "der(angle)der(angle[1]) … der(angle[2])"
    assert rows == expected
    head = [each.text for each in page.iterfind(".//{*}th")]
    assert head == ["name", "shape", "causality", "unit", "start", "description"]
    said = page.findtext(".//{*}p") or ""
    assert ("scalars only" in said) == (version == "2.0")
    assert ("Arrays are listed row by row." in said) == (version == "3.0")
    assert page.findtext(".//{*}ul/{*}li") == "<1"


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_unit_of_any_component_has_its_files(version: str) -> None:
    """Expected: names by the standard; the component's own code and documents beside those of every unit."""
    unit = unit_of(SMALL, version)
    other = "3" if version == "2.0" else "2"
    names = set(unit.documents)
    assert {"x/y", "modelDescription.xml", "sources/own.c", "sources/own.h", "sources/model.h"} <= names
    assert {"sources/model.c", "sources/start.c", f"sources/fmi{version[0]}.c"} <= names
    assert unit.documents["x/y"] == version.encode()
    assert unit.documents["terminalsAndIcons/icon.png"] == b"png"
    assert unit.documents["terminalsAndIcons/icon.svg"] == b"svg"
    assert unit.documents.get("model.png") == (b"png" if version == "2.0" else None)
    assert not any(f"fmi{other}" in name for name in names)
    assert "sources/stateless.c" not in names
    sampled = replace(SMALL, layout=laid_out([LAYOUT.by_name["force"].variable], {}), dependencies={})
    assert "sources/stateless.c" in unit_of(sampled, version).documents
    assert (unit.fmi_version, unit.library) == (version, "small")
    # whatever is in the unit changes its token
    token = unit.token
    assert f'"{token}"' in unit.sources.units["start.c"]
    angle = SMALL.layout.by_name["angle"]
    changed_angle = replace(angle, variable=replace(angle.variable, nominal=0.03))
    for changed in (
        replace(SMALL, layout=Layout((*SMALL.layout.rows[:1], changed_angle, *SMALL.layout.rows[2:]))),
        replace(SMALL, code=Sources({"own.c": "int our;"}, {"own.h": "own"})),
        replace(SMALL, code=Sources({"own.c": "int own;"}, {"own.h": "our"})),
        replace(SMALL, code=Sources({"one.c": "int own;"}, {"own.h": "own"})),
    ):
        assert unit_of(changed, version).token != token
