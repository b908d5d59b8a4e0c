"""A controller written by hand in C as a unit: what its description says is what an importer finds.

The C here is not that of exported controllers, so what is tested is the unit around it. Expected: literal values, and
the formula that the C computes, in NumPy.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from gough_stewart.fmu_build.build import build_units, uncompiled_unit
from gough_stewart.fmu_build.component import Icon, Sources, UnitComponent
from gough_stewart.fmu_build.controller import ControllerParameter, SampledController, controller_component
from gough_stewart.harness.plants.unit import FmuFile
from gough_stewart.model.parameters import Variable
from gough_stewart.model.vectors import FloatArray
from tests.support.fmu_plants import DISCARD, Plant, refused
from tests.support.sampled_unit import run_unit
from tests.support.schemas import complaints_of_schemas

HEADER = """
#ifndef CONTROLLER_H
#define CONTROLLER_H
enum { CONTROLLER_N_MEASURED = 9, CONTROLLER_FORCE_NOT_FINITE = 3 };
typedef struct { double sample_time, gain[6], force_limit, start_force[6], rate_limit; } controller_parameters;
typedef struct { double twice; } controller_coefficients;
typedef struct { double samples, input_status, input_bad_time; } controller_memory;
#ifdef ALONE
#define REFERENCE
#define WANTED(k) 0
#else
#define REFERENCE const double *reference,
#define WANTED(k) reference[k]
#endif
int controller_prepare(const controller_parameters *p, controller_coefficients *c);
void controller_start(const controller_parameters *p, controller_memory *m);
void controller_step(const controller_parameters *p, const controller_coefficients *c, controller_memory *m,
    const double *measured, REFERENCE double *force, unsigned char *limited);
#endif
"""
SOURCE = """
#include "controller.h"
#include <math.h>
int controller_prepare(const controller_parameters *p, controller_coefficients *c)
{
    int k;
    c->twice = 2;
    if (!(p->sample_time < 1)) return 1;
    for (k = 0; k < 6; ++k) if (p->gain[k] > 5000) return 2;
    if (p->rate_limit < p->force_limit) return 5;
    return 0;
}
void controller_start(const controller_parameters *p, controller_memory *m)
{
    (void)p;
    m->samples = m->input_status = m->input_bad_time = 0;
}
void controller_step(const controller_parameters *p, const controller_coefficients *c, controller_memory *m,
    const double *measured, REFERENCE double *force, unsigned char *limited)
{
    int k;
    m->samples += 1;
    m->input_status = measured[2] > 3 ? 2 : 0;
    m->input_bad_time = measured[2] > 3 ? m->input_bad_time + p->sample_time : 0;
    for (k = 0; k < 6; ++k) {
        double free = p->gain[k] * (measured[3 + k] - c->twice) + 10 * (k + 1) * (WANTED(k % 3) - measured[k % 3])
            + (k - 2.5) * WANTED(3 + (k + 1) % 3) + m->samples;
        force[k] = fmax(-p->force_limit, fmin(free, p->force_limit));
        limited[k] = fabs(free) > p->force_limit;
    }
}
"""
T, LIMIT = 0.003, 45.0
GAIN = np.array([31.0, 42.0, 27.0, 55.0, 38.0, 46.0])
START_FORCE = np.array([5.0, -7.0, 11.0, 2.0, -3.0, 13.0])
POSITION = Variable("position", (3,), "m", "output", "continuous", "of Op", is_state=True)
VELOCITY = Variable("velocity", (3,), "m/s", "output", "continuous", "of Op, too", is_state=True)
LEG_LENGTH = Variable("leg_length", (6,), "m", "output", "continuous", "from joint to joint")


def _parameter(name: str, value: Any, unit: str, text: str, bound: Any = None, **options: Any) -> ControllerParameter:
    value = np.asarray(value, dtype=float)
    variability = "fixed" if name == "sample_time" else "tunable"
    variable = Variable(name, value.shape, unit, "parameter", variability, text, lower_bound=bound)  # type: ignore[arg-type]
    return ControllerParameter(variable, value, **options)


def _icon(text: str) -> Icon:
    return Icon(
        b"\x89PNG\r\n\x1a\n" + text.encode(), f"<svg xmlns='http://www.w3.org/2000/svg'><!--{text}--></svg>".encode()
    )


CONTROLLER = SampledController(
    title="two <signals> & more",
    sample_time=T,
    stop_time=0.75,
    measured=(POSITION, LEG_LENGTH),
    reference=(POSITION, VELOCITY),
    parameters=(
        _parameter("sample_time", T, "s", "from sample to sample", "> 0", expected="less than a second"),
        _parameter("gain", GAIN, "N/m", "of each leg", ">= 0", expected='at most 5 kN/m, and no quote "'),
        _parameter("force_limit", LIMIT, "N", "largest force", "> 0", is_none_at_zero=True),
        _parameter("start_force", START_FORCE, "N", "before the first sample"),
        _parameter("rate_limit", np.inf, "N/s", "largest rate", "> 0", is_none_at_zero=True, expected="enough"),
    ),
    code=Sources({"controller.c": SOURCE}, {"controller.h": HEADER}),
    icon=_icon("mine"),
    notes=("first: a < b", "second"),
)
ALONE = replace(
    CONTROLLER,
    title="alone",
    reference=(),
    code=Sources({"controller.c": SOURCE}, {"controller.h": f"#define ALONE\n{HEADER}"}),
    output_delay=15,
    notes=(),
)


def forces(sample: int, position: FloatArray, lengths: FloatArray, wanted: FloatArray, speed: FloatArray) -> FloatArray:
    """What the C gives for a sample before the limit (6,)."""
    k = np.arange(6)
    free = GAIN * (lengths - 2) + 10 * (k + 1) * (wanted - position)[k % 3] + (k - 2.5) * speed[(k + 1) % 3]
    return np.asarray(free + sample + 1)


class Units(dict[str, FmuFile]):
    """By FMI version."""

    component: UnitComponent


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Units]:
    folder = tmp_path_factory.mktemp("controller")
    component = controller_component(CONTROLLER, "by_hand")
    found = Units({file.version: file for file in map(FmuFile, build_units(component, folder))})
    found.component = component
    yield found
    for file in found.values():
        file.close()


@pytest.fixture(params=["2.0", "3.0"])
def unit(request: pytest.FixtureRequest, units: Units) -> Iterator[Plant]:
    """An instance, not yet initialised."""
    with Plant(units[request.param]) as one:
        yield one


def inputs(n: int) -> list[dict[str, FloatArray]]:
    """Six and more different everything; the third position is too high in samples 5, 6 and 9."""
    rng = np.random.default_rng(3)
    rows = []
    for k in range(n):
        position, wanted, speed = rng.uniform(-1, 1, (3, 3)) + 1.5
        position[2] = 3.25 if k in (5, 6, 9) else 2.75
        reference = {"reference_position": wanted, "reference_velocity": speed}
        rows.append({"position": position, "leg_length": rng.uniform(1.4, 3.9, 6), **reference})
    return rows


# --- behaviour -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_inputs_reach_the_c_and_forces_flags_and_reports_come_back(units: Units, version: str) -> None:
    """Expected: the formula; each sample's forces at the next, from 7.3 s, in two parts, and all start values."""
    rows = inputs(12)
    found, begun = run_unit(units[version].path, rows, T, 7.3, parts=2)
    free = np.array([forces(k, *row.values()) for k, row in enumerate(rows)])
    np.testing.assert_allclose(found.force, np.clip(free, -LIMIT, LIMIT), rtol=1e-12)
    np.testing.assert_array_equal(found.limited, np.abs(free) > LIMIT)
    assert 0.2 < found.limited.mean() < 0.8
    assert found.limited.any(axis=0).all()
    np.testing.assert_array_equal(found.status, [2 if k in (5, 6, 9) else 0 for k in range(12)])
    np.testing.assert_allclose(found.bad_time, T * np.array([0, 0, 0, 0, 0, 1, 2, 0, 0, 1, 0, 0]))
    expected: dict[str, Any] = {
        **{name: np.zeros(value.shape) for name, value in rows[0].items()},
        **{"actuator_force": START_FORCE, "force_limited": np.zeros(6), "input_status": 0, "input_bad_time": 0},
        **{"sample_time": T, "gain": GAIN, "force_limit": LIMIT, "start_force": START_FORCE, "rate_limit": 0},
        **{"time": 7.3, "output_delay": 1},
    }
    if version == "2.0":
        del expected["time"]
    assert set(begun) == set(expected)
    for name, value in expected.items():
        np.testing.assert_array_equal(begun[name], np.ravel(value), err_msg=name)


def test_a_unit_without_reference_delays_by_its_own_samples(tmp_path: Path) -> None:
    """Expected: 15 samples of start forces, then the formula; a delay of 16 is refused."""
    component = controller_component(ALONE)
    (path,) = build_units(component, tmp_path, fmi="2.0")
    rows = [{name: row[name] for name in ("position", "leg_length")} for row in inputs(20)]
    found, begun = run_unit(path, rows, T, -0.25)
    free = np.array(
        [forces(k, row["position"], row["leg_length"], np.zeros(3), np.zeros(3)) for k, row in enumerate(rows)]
    )
    np.testing.assert_array_equal(found.force[:14], np.tile(START_FORCE, (14, 1)))
    np.testing.assert_array_equal(found.limited[:14], np.zeros((14, 6)))
    np.testing.assert_allclose(found.force[14:], np.clip(free, -LIMIT, LIMIT)[:6], rtol=1e-12)
    np.testing.assert_array_equal(found.limited[14:], (np.abs(free) > LIMIT)[:6])
    np.testing.assert_array_equal(found.status, [2 if k in (5, 6, 9) else 0 for k in range(20)])
    assert begun["output_delay"] == 15
    assert path.name == "controller_fmi2.fmu"
    with FmuFile(path) as file, Plant(file) as unit:
        assert refused(unit.set, "output_delay", 16.0) == DISCARD
        assert "expected a whole number of samples from 1 to 15" in unit.take_messages()


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("sample_time", 2.0, "sample_time = 2 s rejected; expected less than a second"),
        ("gain", [1, 2, 3, 5001, 5, 6], 'gain = 1 2 3 5001 5 6 N/m rejected; expected at most 5 kN/m, and no quote "'),
        ("rate_limit", 44.0, "rate_limit = 44 N/s rejected; expected enough"),
    ],
)
def test_what_the_c_refuses_is_told_in_its_own_words(unit: Plant, name: str, value: Any, message: str) -> None:
    unit.set(name, value)
    with pytest.raises(Exception, match="ExitInitializationMode"):
        unit.initialise()
    assert message in unit.take_messages()


def test_no_limit_is_0_in_the_unit_and_none_in_the_c(unit: Plant) -> None:
    """Expected: without a limit the formula itself; a limit below 0 is refused, and so is a negative gain."""
    unit.set("force_limit", 0.0)
    unit.initialise()
    (row,) = inputs(1)
    for name, value in row.items():
        unit.set(name, 40 * value)
    unit.do_step(0.0, T)
    expected = forces(0, *(40 * value for value in row.values()))
    np.testing.assert_allclose(unit.get("actuator_force"), expected, rtol=1e-12)
    assert np.abs(expected).max() > 1000
    assert unit.get("force_limit") == 0
    for name in ("force_limit", "rate_limit"):
        assert refused(unit.set, name, -1.0) == DISCARD
        assert f"{name} = -1 N{'/s' * (name == 'rate_limit')} rejected; expected a value >= 0" in unit.take_messages()
    assert refused(unit.set, "gain", np.array([1, 1, 1, 1, 1, -1.0])) == DISCARD


# --- description -----------------------------------------------------------------------------------------------------

REPORT = "inputs of the last sample: 0 good, 1 out of range, 2 frozen; unless they are good, the forces are safe ones"
BAD_TIME = "for how long the inputs have not been good; 0 while they are"
DELAY = "samples from the inputs to the forces that they determine, a whole number from 1 to 12"
# name, size, causality, variability, unit, description, start; in the order of their value references
VARIABLES: list[tuple[str, int, str, str, str | None, str, Any]] = [
    ("position", 3, "input", "continuous", "m", "of Op", np.zeros(3)),
    ("leg_length", 6, "input", "continuous", "m", "from joint to joint", np.zeros(6)),
    ("reference_position", 3, "input", "continuous", "m", "reference: of Op", np.zeros(3)),
    ("reference_velocity", 3, "input", "continuous", "m/s", "reference: of Op, too", np.zeros(3)),
    ("actuator_force", 6, "output", "continuous", "N", "force of each actuator, positive extends the leg", None),
    ("force_limited", 6, "output", "continuous", None, "1 if the force limit is active, else 0", None),
    ("sample_time", 1, "parameter", "fixed", "s", "from sample to sample", T),
    ("gain", 6, "parameter", "tunable", "N/m", "of each leg", GAIN),
    ("force_limit", 1, "parameter", "tunable", "N", "largest force; 0: no limit", LIMIT),
    ("start_force", 6, "parameter", "tunable", "N", "before the first sample", START_FORCE),
    ("rate_limit", 1, "parameter", "tunable", "N/s", "largest rate; 0: no limit", 0),
    ("time", 1, "independent", "continuous", "s", "", None),
    ("output_delay", 1, "parameter", "fixed", None, DELAY, 1),
    ("input_status", 1, "output", "continuous", None, REPORT, None),
    ("input_bad_time", 1, "output", "continuous", "s", BAD_TIME, None),
]


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_every_variable_is_described_with_all_that_was_given(units: Units, version: str) -> None:
    description = units[version].description
    found = {v.name: v for v in description.modelVariables}
    references = 0
    for name, size, causality, variability, unit, text, start in VARIABLES:
        scalars = [f"{name}[{k + 1}]" for k in range(size)] if version == "2.0" and size > 1 else [name]
        starts = [] if start is None else np.ravel(start).tolist()
        if (name, version) == ("time", "2.0"):  # not a variable there, but its place is kept
            scalars, references = [], references + 1
        for k, scalar in enumerate(scalars):
            v = found.pop(scalar)
            shown = (v.causality, v.variability, v.unit, int(v.valueReference))
            assert shown == (causality, variability, unit, references), scalar
            assert name == "time" or v.description == text
            of_it = starts if version == "3.0" else starts[k : k + 1]
            assert [float(value) for value in (v.start or "").split()] == of_it or name == "time", scalar
            references += 1
    assert found == {}
    experiment = description.defaultExperiment
    assert [float(getattr(experiment, f"{name}Time")) for name in ("start", "stop")] == [0.0, 0.75]
    assert float(experiment.stepSize) == T
    assert description.modelName == "GoughStewartController"
    assert description.coSimulation.modelIdentifier == "gough_stewart_controller"
    assert description.modelExchange is None
    assert description.description == "Controller of a Gough–Stewart platform: two <signals> & more"
    assert units[version].path.name == f"by_hand_fmi{version[0]}.fmu"
    assert complaints_of_schemas(units[version]) == {}


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_forces_depend_on_start_forces_at_the_start_and_on_nothing_later(units: Units, version: str) -> None:
    """Expected: leg by leg, of the kind constant."""
    description = units[version].description
    assert all(u.dependencies == [] for u in description.outputs)
    found = {u.variable.name: u for u in description.initialUnknowns}
    names = [f"actuator_force[{k}]" for k in range(1, 7)] if version == "2.0" else ["actuator_force"]
    for name in names:
        assert [v.name for v in found[name].dependencies] == [name.replace("actuator", "start")]
        assert found[name].dependenciesKind == ["constant"]
    assert all(u.dependencies == [] for name, u in found.items() if name not in names)


def _terminals(text: bytes) -> dict[str, tuple[str, dict[str, str]]]:
    root = ET.fromstring(text)
    return {
        terminal.get("name", ""): (
            terminal.get("description", ""),
            {m.get("memberName", ""): m.get("variableName", "") for m in terminal if m.get("memberName")},
        )
        for terminal in root.iter()
        if terminal.tag.rpartition("}")[2] == "Terminal"
    }


def test_terminals_hold_the_actuators_the_measured_pose_and_the_reference() -> None:
    """Expected: members by name; what is measured of the legs belongs to the actuators."""
    place = "terminalsAndIcons/terminalsAndIcons.xml"
    component = controller_component(CONTROLLER)
    found = {version: _terminals(uncompiled_unit(component, version)[1][place]) for version in ("2.0", "3.0")}
    assert found["3.0"] == {
        "actuators": ("the six actuators", {"actuator_force": "actuator_force", "leg_length": "leg_length"}),
        "pose": ("pose and its rates", {"position": "position"}),
        "reference": (
            "reference of the platform",
            {name: name for name in ("reference_position", "reference_velocity")},
        ),
    }
    scalars = uncompiled_unit(replace(component, has_scalars_only=True), "3.0")[1][place]
    assert _terminals(scalars) == found["2.0"]  # for importers without arrays
    leg = {"actuator_force": "actuator_force[4]", "leg_length": "leg_length[4]"}
    assert found["2.0"]["actuator_4"] == ("actuator of leg 4", leg)
    assert list(found["2.0"]) == [*(f"actuator_{k}" for k in range(1, 7)), "pose", "reference"]
    assert set(found["2.0"]["pose"][1].values()) == {f"position[{k}]" for k in (1, 2, 3)}
    alone = _terminals(uncompiled_unit(controller_component(ALONE), "3.0")[1][place])
    assert list(alone) == ["actuators", "pose"]
