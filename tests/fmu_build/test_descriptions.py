"""Model descriptions and the other XML of the archives: schemas, FMPy's validation, dependencies, units."""

import numpy as np
import pytest
from fmpy.validation import validate_fmu
from lxml import etree

from gough_stewart.fmu_build import model_description
from gough_stewart.fmu_build.layout import Role
from gough_stewart.fmu_build.model_description import BY_NAME, UNITS
from gough_stewart.fmu_build.plant.component import plant_component, slot_dependencies
from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.model import interface
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.stepping import SteppingModel
from tests.support.fmu_plants import Fmu, plant
from tests.support.random_platforms import random_inputs, random_platform, random_state
from tests.support.schemas import complaints_of_schemas
from tests.support.uneven import INPUTS, STATE, UNEVEN


def test_fmpy_finds_no_problem(fmu: Fmu) -> None:
    assert validate_fmu(str(fmu.path)) == []


def test_every_document_follows_the_schema_of_the_standard(fmu: Fmu) -> None:
    assert complaints_of_schemas(fmu) == {}


def test_every_variable_of_the_table_is_there_with_its_meaning(fmu: Fmu) -> None:
    found = {v.name: v for v in fmu.description.modelVariables}
    for row in PLANT.described(fmu.version):
        v = row.variable
        names = row.scalar_names if fmu.version == "2.0" else (v.name,)
        for k, name in enumerate(names):
            declared = found.pop(name)
            assert declared.description == v.description
            assert declared.unit == v.unit
            assert declared.variability == v.variability
            assert declared.valueReference == (row.first + k if fmu.version == "2.0" else row.reference)
            assert declared.causality == ("independent" if row.role is Role.INDEPENDENT else v.causality)
            if fmu.version == "3.0":
                assert tuple(int(d.start) for d in declared.dimensions) == v.shape
    assert found == {}


def start_of(name: str) -> float:
    """What one element has to begin with, by its FMI 2.0 name: `base_points[2,3]` is the z of the second base joint."""
    variable, _, indices = name.rstrip("]").partition("[")
    home = {
        "position": UNEVEN.home_position,
        "orientation": UNEVEN.home_orientation,
        "actuator_force": UNEVEN.home_actuator_force,
    }
    value = home.get(variable, getattr(UNEVEN, variable, 0.0))
    at = tuple(int(index) - 1 for index in indices.split(",") if index)
    return float(value[at] if isinstance(value, np.ndarray) else value)


def test_start_values_are_those_of_the_platform_in_description_and_binary(fmu: Fmu) -> None:
    """Expected: the platform's own numbers, found by the indices in the names; rows of an array one after the other."""
    found = {v.name: v for v in fmu.description.modelVariables}
    seen = 0
    with plant(fmu) as p:
        for v in interface.VARIABLES:
            if (v.causality == "output" and not v.is_state) or v.causality == "local":
                continue
            expected = [start_of(name) for name in v.scalar_names]
            if fmu.version == "2.0":
                assert [float(found[name].start) for name in v.scalar_names] == expected
                assert p.fmu.getReal([found[name].valueReference for name in v.scalar_names]) == expected
            else:
                assert [float(text) for text in found[v.name].start.split()] == expected
                assert p.fmu.getFloat64([found[v.name].valueReference], nValues=len(expected)) == expected
            seen += len(set(expected))
    assert seen > 60  # numbers that differ


def test_every_result_goes_by_the_reference_in_the_description(fmu: Fmu) -> None:
    """Expected: the stepping model's element of that name."""
    model = SteppingModel(UNEVEN, integrator="scipy")
    model.set_many({**STATE._asdict(), **INPUTS._asdict()})
    found = {v.name: v.valueReference for v in fmu.description.modelVariables}
    with plant(fmu) as p:
        p.start({**STATE._asdict(), **INPUTS._asdict()})
        for v in interface.RESULTS:
            if fmu.version == "2.0":
                values = p.fmu.getReal([found[name] for name in v.scalar_names])
            else:
                values = p.fmu.getFloat64([found[v.name]], nValues=v.size)
            expected = [model.get(name) for name in v.scalar_names]
            assert values == pytest.approx(expected, rel=1e-9)
            assert len(set(values)) == len(values)


def test_units_have_the_dimensions_of_their_names() -> None:
    """Expected: N = kg m/s², J = N m, Hz = 1/s, and the rest read off the name."""
    bases: dict[str, dict[str, int]] = {
        "1": {},
        "Hz": {"s": -1},
        "N": {"kg": 1, "m": 1, "s": -2},
        "J": {"kg": 1, "m": 2, "s": -2},
    }
    for unit in UNITS:
        numerator, _, denominator = unit.name.partition("/")
        exponents: dict[str, int] = {}
        for part, sign in ((numerator, 1), (denominator, -1)):
            for factor in filter(None, part.strip("()").split(".")):
                symbol, power = (factor[:-1], 2) if factor.endswith("2") else (factor, 1)
                for base, exponent in bases.get(symbol, {symbol: 1}).items():
                    exponents[base] = exponents.get(base, 0) + sign * power * exponent
        assert {b: e for b, e in exponents.items() if e} == unit.exponents
    assert {v.unit for v in interface.VARIABLES} <= set(BY_NAME)


def test_display_units_show_degrees_and_millimetres() -> None:
    display = {unit.name: unit.display for unit in UNITS if unit.display is not None}
    name, factor = display["rad"]
    assert name == "deg"
    assert factor == pytest.approx(180 / np.pi, rel=1e-15)
    assert display["m"] == ("mm", 1000.0)


def numeric_dependencies() -> dict[int, set[int]]:
    """Slots of the inputs and states that change an unknown at random points: any difference counts."""
    rng, kernel = np.random.default_rng(4), Kernel()
    slots = [*range(12, 24), *range(12)]  # states, then inputs
    unknowns = [*range(137, 149), *range(12, 62)]  # derivatives, then results
    found: dict[int, set[int]] = {slot: set() for slot in unknowns}
    for _ in range(3):
        platform = random_platform(rng)
        p = parameter_vector(platform)
        z = np.concatenate([random_state(platform, rng).to_vector(), random_inputs(platform, rng).to_vector()])

        def values(z: np.ndarray, p: np.ndarray = p) -> np.ndarray:
            return np.concatenate([kernel.derivatives(z[:12], z[12:], p), kernel.outputs(z[:12], z[12:], p)])

        base = values(z)
        for k, known in enumerate(slots):
            changed = z.copy()
            changed[k] += 0.01 * max(1.0, abs(z[k]))
            # far above the rounding of what does not depend on it
            different = np.abs(values(changed) - base) > 1e-9 * (1 + np.abs(base))
            for slot, differs in zip(unknowns, different, strict=True):
                if differs:
                    found[slot].add(known)
    return found


def test_dependencies_are_those_that_differences_show() -> None:
    """Expected: no more and no less than what changes when a state or an input does."""
    component, knowns = plant_component(UNEVEN), (Role.INPUT, Role.STATE)
    declared = {
        slot: set(model_description.dependencies_of_slot(component, slot, knowns)) for slot in slot_dependencies()
    }
    assert declared == numeric_dependencies()


def test_the_descriptions_carry_these_dependencies(fmu: Fmu) -> None:
    component, knowns = plant_component(UNEVEN), (Role.INPUT, Role.STATE)
    for unknowns in (fmu.description.outputs, fmu.description.derivatives):
        for unknown in unknowns:
            if fmu.version == "2.0":
                expected = model_description.dependencies_of_slot(component, unknown.variable.valueReference, knowns)
            else:
                row = PLANT.by_name[unknown.variable.name]
                expected = model_description.dependencies_of_row(component, row, knowns)
            assert [v.valueReference for v in unknown.dependencies] == list(expected)
            assert list(unknown.dependenciesKind) == list(expected.values())


def test_constant_dependencies_have_constant_factors() -> None:
    """Expected: entries of the Jacobian that are the same at two random points."""
    rng, kernel = np.random.default_rng(8), Kernel()
    blocks = []
    for _ in range(2):
        platform = random_platform(rng)
        x, u = random_state(platform, rng).to_vector(), random_inputs(platform, rng).to_vector()
        j = kernel.jacobians(x, u, parameter_vector(platform))
        blocks.append(np.block([[j.B, j.A], [j.D, j.C]]))
    unknowns = [*range(137, 149), *range(12, 62)]
    constants = 0
    for slot, kinds in slot_dependencies().items():
        for known, kind in kinds.items():
            if known < 24 and kind == "constant":
                entries = {float(block[unknowns.index(slot), known]) for block in blocks}
                assert len(entries) == 1
                assert entries != {0.0}
                constants += 1
    assert constants >= 15  # twelve states that are outputs, three rates that are velocities


def test_terminals_name_variables_that_exist(fmu: Fmu) -> None:
    names = {v.name for v in fmu.description.modelVariables}
    root = etree.parse(str(fmu.folder / "terminalsAndIcons/terminalsAndIcons.xml")).getroot()
    members = [m.get("variableName") for m in root.iter("TerminalMemberVariable")]
    assert set(members) <= names
    forces = [m for m in members if m is not None and m.startswith("actuator_force")]
    assert len(forces) == (6 if fmu.version == "2.0" else 1)
    terminals = [t.get("name") for t in root.iter("Terminal")]
    assert "pose" in terminals


def test_the_experiment_is_the_papers_second(fmu: Fmu) -> None:
    experiment = fmu.description.defaultExperiment
    shown = [float(v) for v in (experiment.startTime, experiment.stopTime, experiment.tolerance, experiment.stepSize)]
    assert shown == [0.0, 1.0, 1e-8, 1e-3]


def test_declared_capabilities(fmu: Fmu) -> None:
    """Each is tried in test_capabilities.py; none is promised beside those."""
    root = etree.parse(str(fmu.folder / "modelDescription.xml")).getroot()
    promised = {
        kind: {name for element in root.iter(kind) for name, value in element.attrib.items() if value == "true"}
        for kind in ("ModelExchange", "CoSimulation")
    }
    if fmu.version == "2.0":
        both = {"canNotUseMemoryManagementFunctions", "canGetAndSetFMUstate", "canSerializeFMUstate"}
        both |= {"providesDirectionalDerivative"}
        exchange = set[str]()
        simulation = {"canHandleVariableCommunicationStepSize", "canInterpolateInputs"}
    else:
        both = {"canGetAndSetFMUState", "canSerializeFMUState"}
        both |= {"providesDirectionalDerivatives", "providesAdjointDerivatives"}
        exchange = {"needsCompletedIntegratorStep", "providesEvaluateDiscreteStates"}
        simulation = {"canHandleVariableCommunicationStepSize", "providesIntermediateUpdate"}
        simulation |= {"canReturnEarlyAfterIntermediateUpdate"}
    assert promised == {"ModelExchange": both | exchange, "CoSimulation": both | simulation}
    assert [e.get("maxOutputDerivativeOrder") for e in root.iter("CoSimulation")] == ["1"]


def test_the_guid_tells_versions_and_platforms_apart(fmu2: Fmu, fmu3: Fmu) -> None:
    from gough_stewart.fmu_build.builder import unit_of
    from gough_stewart.model.platform_toml import load_preset

    other = unit_of(plant_component(load_preset("motion_base")), "3.0").documents["modelDescription.xml"].decode()
    assert fmu2.token != fmu3.token
    assert fmu3.token not in other


def test_the_build_description_names_no_options_without_their_compiler(fmu: Fmu) -> None:
    """Expected: the standard's schema comments, as VDMCheck reads them."""
    tree = etree.parse(str(fmu.folder / "sources/buildDescription.xml"))
    (file_set,) = tree.iter("SourceFileSet")
    assert file_set.get("language") == "C11"
    assert "compilerOptions" not in file_set.attrib or "compiler" in file_set.attrib
    assert {each.get("name") for each in file_set} == {path.name for path in (fmu.folder / "sources").glob("*.c")}
