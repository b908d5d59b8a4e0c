"""Every pair of options of an export, in C, FMI and SSP, against a controller written from the documentation."""

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit
from allpairspy import AllPairs
from fmpy.ssp.simulation import simulate_ssp

import gough_stewart as gs
from gough_stewart import Experiment
from tests.harness.export.documented_controller import (
    DocumentedController,
    Sample,
    closed,
    function_law,
    linear_law,
    range_of_lengths,
    reference_rows,
    start_of,
)
from tests.harness.export.sampled_unit import Outputs, run_source, run_unit
from tests.support.arrays import FloatArray
from tests.support.covering import covering
from tests.support.documented_loop import motion_of
from tests.support.lagrangian import Pose, legs_along
from tests.support.uneven import UNEVEN

SAMPLE_TIME, N = 0.005, 24
DURATION = N * SAMPLE_TIME
TIMES: FloatArray = np.asarray(SAMPLE_TIME * np.arange(N), dtype=float)
LEG_GAINS: dict[str, Any] = {
    "kp": [1100.0, 1450.0, 900.0, 1250.0, 1600.0, 1000.0],
    "kd": [110.0, 140.0, 95.0, 125.0, 150.0, 105.0],
    "ki": [900.0, 1500.0, 700.0, 1100.0, 2000.0, 800.0],
}
TASK_GAINS: dict[str, Any] = {
    "kp": [6000.0, 7500.0, 9000.0, 5200.0, 4100.0, 3300.0],
    "kd": [520.0, 610.0, 700.0, 430.0, 390.0, 310.0],
    "ki": [5000.0, 8000.0, 9000.0, 4500.0, 3000.0, 2500.0],
}
ALONG = np.array([0.021, -0.017, 0.026, 0.031, -0.024, 0.035])
HOME = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
START = HOME + 0.3 * ALONG[::-1]
CONSTANT = np.array([3.0, -7.0, 11.0, -2.0, 5.0, -9.0])
MACHINE: dict[str, Any] = {"platform_mass": 13.9, "platform_com": [0.02, -0.07, 0.11], "leg_viscous_friction": 9.5}
FORMS = ("c", "c of floats", "fmu", "ssp")
OPTIONS: dict[str, list[Any]] = {
    "form": list(FORMS),
    "type": ["pid", "pd", "system", "function", "open_loop"],
    "waiting": [False, True],
    "faults": [False, True],
    "reference": ["sine", "point_to_point", "step"],
    "reference_from": ["inside", "inputs"],
    "space": ["leg", "task"],
    "derivative_on": ["error", "measurement"],
    "derivative_filter": [None, 0.009],
    "discretisation": ["tustin", "backward_diff", "zoh"],
    "anti_windup_time": [None, 0.06],
    "feedforward": ["gravity", "none", "computed_torque"],
    "delay": [0, 1, 3],
    "force_limit": [np.inf, 76.0],
    "rate_limit": [np.inf, 900.0],
    "safe_force": ["feedforward", "zero"],
    "frozen": [None, (5, 0.002)],
    "machine": ["as believed", "differs"],
    "start": [False, True],
    "around": [False, True],
    "fmi": ["2.0", "3.0"],
    # frequency, damping and depth
    "notch": [None, (31.0, 0.4, 0.15)],
}
OTHERS = ("system", "function", "open_loop")
# Without a meaning for those, which have the first of their values.
_OF_PID = ("derivative_on", "derivative_filter", "discretisation", "notch")


def _can_be(row: dict[str, Any]) -> bool:
    """Whether a row has a meaning, or so far as it goes may have one."""
    kind, form = row.get("type"), row.get("form")

    def differs(*names: str) -> bool:
        return any(row.get(name, OPTIONS[name][0]) != OPTIONS[name][0] for name in names)

    return not (
        (form == "ssp" and differs("reference_from", "waiting", "faults"))
        or (kind in OTHERS and differs(*_OF_PID))
        or (kind in (*OTHERS, "pd") and differs("anti_windup_time"))
        or (kind in ("function", "open_loop") and differs("space"))
        or (kind == "open_loop" and (differs("frozen") or row.get("feedforward") == "none"))
    )


def _rows_of(options: dict[str, list[Any]]) -> Iterator[dict[str, Any]]:
    rows = AllPairs(list(options.values()), filter_func=lambda row: _can_be(dict(zip(options, row, strict=False))))
    return (dict(zip(options, row, strict=True)) for row in rows)


def _rows() -> list[dict[str, Any]]:
    """Rows with every pair of values that can be; where the library leaves a pair out, one more row for it."""
    rows = list(_rows_of(OPTIONS))
    for a, b in combinations(OPTIONS, 2):
        for x, y in product(OPTIONS[a], OPTIONS[b]):
            if _can_be({a: x, b: y}) and not any((row[a], row[b]) == (x, y) for row in rows):
                turn = len(rows)
                rest = {name: [*v[turn % len(v) :], *v[: turn % len(v)]] for name, v in OPTIONS.items()}
                rows.append(next(_rows_of(rest | {a: [x], b: [y]})))
    return rows


ROWS = _rows()


def _controller(row: dict[str, Any]) -> tuple[dict[str, Any], Any]:
    """Its table, and what replaces it."""
    kind, known = row["type"], {"feedforward": row["feedforward"]}
    if kind == "open_loop":
        return {"type": kind, "force": CONSTANT.tolist(), **known}, None
    if kind == "system":
        return {"type": "open_loop", **known}, linear_law(SAMPLE_TIME, row["space"])
    if kind == "function":
        return {"type": "open_loop", **known}, function_law()
    gains = TASK_GAINS if row["space"] == "task" else LEG_GAINS
    table = known | {name: row[name] for name in ("type", "space", "derivative_on", "discretisation")}
    table |= {"proportional_gain": gains["kp"], "derivative_gain": gains["kd"]}
    if row["derivative_filter"]:
        table["derivative_filter"] = row["derivative_filter"]
    if row["notch"]:
        table["notch"] = dict(zip(("frequency", "damping", "depth"), row["notch"], strict=True))
    if kind == "pid":
        table["integral_gain"] = gains["ki"]
        if row["anti_windup_time"]:
            table["anti_windup_time"] = row["anti_windup_time"]
    return table, None


def _experiment(row: dict[str, Any], folder: Path) -> tuple[Experiment, Any]:
    gs.save_platform(UNEVEN, folder / "uneven.toml")
    change = {"position_change": ALONG[:3].tolist(), "orientation_change": ALONG[3:].tolist()}
    swing = {"position_amplitude": ALONG[:3].tolist(), "orientation_amplitude": ALONG[3:].tolist()}
    references = {
        "sine": {"type": "sine", **swing, "frequency": 2.3, "phase": 0.6},
        "point_to_point": {"type": "point_to_point", **change, "at": 0.03, "duration": 0.08},
        "step": {"type": "step", **change, "at": 0.03},
    }
    table, instead = _controller(row)
    values: dict[str, Any] = {
        "title": "options together",
        "platform": {"file": "uneven.toml"},
        "plant": {"tolerance": 1e-11},
        "reference": references[row["reference"]],
        "controller": table,
        "loop": {"duration": DURATION, "sample_time": SAMPLE_TIME, "delay": row["delay"]},
        "actuators": {"force_limit": row["force_limit"] if np.isfinite(row["force_limit"]) else "none"},
        "limits": {"reference": "warn"},
    }
    if np.isfinite(row["rate_limit"]):
        values["actuators"]["rate_limit"] = row["rate_limit"]
    if row["machine"] == "differs":
        values["plant"]["parameters"] = MACHINE
    if row["start"]:
        rest = {name: [0.0, 0.0, 0.0] for name in ("velocity", "angular_velocity")}
        values["start"] = {"position": START[:3].tolist(), "orientation": START[3:].tolist(), **rest}
    if row["around"]:  # the machine's, of which an export has nothing
        values["sensors"] = {"quantisation": {"leg_length": 4e-4}, "noise": {"leg_velocity": 1e-3}}
        values["actuators"]["lag"] = 0.012
        values["disturbance"] = [{"at": 0.035, "duration": 0.06, "force": [9.0, -14.0, 21.0]}]
    (folder / "options.toml").write_text(tomlkit.dumps(values))
    return gs.load_experiment(folder / "options.toml"), instead


def _written(row: dict[str, Any], folder: Path) -> list[Path]:
    """The files of a row's export."""
    experiment, instead = _experiment(row, folder)
    options: dict[str, Any] = {
        "reference": row["reference_from"],
        "safe_force": row["safe_force"],
        "controller": instead,
    }
    options |= {"forms": row["form"].split()[0], "fmi": [row["fmi"]], "frozen": row["frozen"], "allow_unstable": True}
    return gs.export(experiment, out=folder, **options)


def _options(row: dict[str, Any]) -> dict[str, Any]:
    gains = TASK_GAINS if row["space"] == "task" else LEG_GAINS
    shape = {"along": ALONG, "frequency": 2.3, "phase": 0.6, "at": 0.03, "move_duration": 0.08}
    times = {"sample_time": SAMPLE_TIME, "duration": DURATION, "constant_force": CONSTANT}
    # a unit cannot do without a sample
    delay = row["delay"] if row["form"].startswith("c") else max(1, row["delay"])
    ki = gains["ki"] if row["type"] == "pid" else [0.0] * 6
    return {**row, **gains, "ki": ki, **shape, **times, "own_delay": row["delay"], "delay": delay}


def _machine(row: dict[str, Any]) -> gs.Platform:
    return UNEVEN if row["machine"] == "as believed" else replace(UNEVEN, **MACHINE)


def _measured(row: dict[str, Any], pose: FloatArray, lengths: FloatArray) -> dict[str, FloatArray]:
    """What the row's controller measures, in the order of the interface."""
    if row["type"] == "open_loop":
        return {}
    return {"leg_length": lengths} if row["type"] != "function" else {"orientation": pose[3:], "leg_length": lengths}


def _seen(row: dict[str, Any], motion: Pose) -> tuple[list[dict[str, FloatArray]], FloatArray | None]:
    """Measurements and references of each sample: beside the motion, up to limits, and what happens to them."""
    k = np.arange(N)[:, None]
    lengths = legs_along(UNEVEN, motion)[0] + 0.05 * np.sin(0.4 * k + np.arange(6)) * [0.9, 1, 0.3, 0.7, 0.5, 1.1]
    angles = 0.1 * np.cos(0.3 * k + np.array([0.0, 0.9, 2.0]))
    reference = reference_rows(motion) if row["reference_from"] == "inputs" else None
    low, high = range_of_lengths(UNEVEN)
    lengths[16:23, 2] = lengths[16, 2]  # frozen, if that is watched
    if row["faults"]:
        lengths[3, 3], lengths[5, 1], lengths[6, 4] = low - 1e-3, high - 1e-3, low + 1e-3
        lengths[8, 5], lengths[9, 0], lengths[10] = high + 1e-3, high + 1e-3, 0.0
        if reference is not None:
            reference[0, 2], reference[12, 2], reference[13, 7], reference[14:16] = 9.0, 9.0, np.nan, 0.0
    if row["waiting"]:
        lengths[:2] = angles[:2] = 0.0
        if reference is not None:
            reference[:2] = 0.0
    poses = np.concatenate([np.zeros((N, 3)), angles], axis=1)
    return [_measured(row, *each) for each in zip(poses, lengths, strict=True)], reference


def _expected(row: dict[str, Any], seen: list[dict[str, FloatArray]], reference: FloatArray | None) -> list[Sample]:
    options = _options(row)
    q = START if row["start"] else motion_of(options, HOME)(np.zeros(1)).q[0]
    controller = DocumentedController(options, UNEVEN, start_of(options, UNEVEN, _machine(row), q))
    return [controller.sample(each, None if reference is None else reference[k]) for k, each in enumerate(seen)]


def _tolerance(row: dict[str, Any], largest: float) -> float:
    """What rounding makes of forces; of lengths relative to home, 0.2 µm times the gain at high frequencies."""
    if row["form"] != "c of floats":
        return 1e-6
    options = _options(row)
    fastest = options["derivative_filter"] or float((np.array(options["kd"]) / options["kp"]).min() / 20)
    gain = {
        "open_loop": 0.0,
        "function": 1e4,  # of whole lengths
        "system": 1e4,
    }.get(row["type"], float(np.max(options["kp"] + np.array(options["kd"]) / fastest)))
    return 2e-7 * gain + 3e-6 * largest


def _assert_samples(row: dict[str, Any], found: Outputs, expected: list[Sample]) -> None:
    force, limited, status, bad = (
        np.array([getattr(each, name) for each in expected]) for name in ("force", "limited", "status", "bad_time")
    )
    np.testing.assert_allclose(found.force, force, rtol=0, atol=_tolerance(row, float(np.abs(force).max())))
    np.testing.assert_array_equal(found.limited, limited)
    np.testing.assert_array_equal(found.status, status)
    np.testing.assert_allclose(found.bad_time, bad, rtol=1e-6, atol=1e-12)


def _at_faults(row: dict[str, Any]) -> dict[str, Any]:
    """What a row has for faults together: a law that rests in each space, and a force that is safe."""
    law, safe = (row["type"], row["space"]), (row["safe_force"], row["feedforward"] == "none")
    is_system = row["type"] == "system"
    return {"law": is_system and law, "law at faults": row["faults"] and law, "force": row["faults"] and safe}


def _of(*forms: str, often: int | None = None) -> pytest.MarkDecorator:
    """The rows of some forms that hold every value, or the first ones; the others with the evidence."""
    rows = [row for row in ROWS if row["form"] in forms]
    always = covering([{**row, **_at_faults(row)} for row in rows]) if often is None else range(often)
    marked = [
        pytest.param(row, id="-".join(map(str, row.values())), marks=() if k in always else pytest.mark.evidence)
        for k, row in enumerate(rows)
    ]
    return pytest.mark.parametrize("row", marked)


@_of("c", "c of floats")
def test_a_client_in_c_gets_what_the_documentation_says(row: dict[str, Any], tmp_path: Path) -> None:
    """Expected: the controller written from the docs; compiled by another compiler than the harness uses."""
    motion = motion_of(_options(row), HOME)(TIMES)
    seen, reference = _seen(row, motion)
    files = _written(row, tmp_path)
    assert [file.name for file in files] == ["options_controller.c", "options_controller.h", "example_main.c"]
    measured = np.array([np.concatenate([np.zeros(0), *each.values()]) for each in seen])
    real = "float" if row["form"] == "c of floats" else "double"
    found = run_source(files[0], measured, reference, real=real)
    _assert_samples(row, found, _expected(row, seen, reference))
    _assert_example(row, files[2].read_text(), motion)


@_of("fmu", often=3)
def test_an_importer_gets_what_the_documentation_says(row: dict[str, Any], tmp_path: Path) -> None:
    """Expected: forces of a sample at the next one, from a start time of 7.3 s; FMPy, both versions."""
    motion = motion_of(_options(row), HOME)(TIMES)
    seen, reference = _seen(row, motion)
    (file,) = _written(row, tmp_path)
    inputs: list[dict[str, FloatArray]] = [dict(each) for each in seen]
    if reference is not None:
        names = ("position", "orientation", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
        for each, values in zip(inputs, reference, strict=True):
            each |= {f"reference_{name}": part for name, part in zip(names, np.split(values, 6), strict=True)}
    found, begun = run_unit(file, inputs, SAMPLE_TIME, 7.3, 3 if row["start"] else 1)
    _assert_samples(row, found, _expected(row, seen, reference))
    _assert_values(row, begun)


@_of("ssp", often=2)
def test_an_importer_of_the_loop_gets_what_the_documentation_says(row: dict[str, Any], tmp_path: Path) -> None:
    """Expected: the loop of the written controller around a Lagrangian's plant; FMPy, whose first inputs are zeros."""
    (file,) = _written(row, tmp_path)
    result = simulate_ssp(str(file), stop_time=DURATION - SAMPLE_TIME / 2, step_size=SAMPLE_TIME)
    start = START if row["start"] else None
    lengths, forces = closed(_options(row), UNEVEN, _machine(row), start, lambda q, legs: _measured(row, q, legs))
    for name, expected, tolerance in (("controller.actuator_force", forces, 2e-4), ("plant.leg_length", lengths, 2e-8)):
        if name == "plant.leg_length" and row["type"] == "open_loop":
            continue  # nothing is measured, so nothing is connected
        found = np.transpose([result[f"{name}[{k}]"] for k in range(1, 7)])
        np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


def _assert_example(row: dict[str, Any], program: str, motion: Pose) -> None:
    """Expected: the inputs of a platform at rest in the first reference, and those at home."""
    first = Pose(motion.q[:1], 0 * motion.rate[:1], 0 * motion.acceleration[:1])
    home = Pose(HOME[None], 0 * first.rate, 0 * first.rate)
    measured, at_home = (_measured(row, each.q[0], legs_along(UNEVEN, each)[0][0]) for each in (first, home))
    # C has no empty arrays
    expected = {"MEASURED": [np.concatenate([*of.values(), np.zeros(1)]) for of in (measured, at_home)]}
    if row["reference_from"] == "inputs":
        rates = reference_rows(motion)[0, 6:]
        expected["REFERENCE"] = [np.append(first.q[0], rates), np.append(HOME, 0 * rates)]
    for name, values in expected.items():
        (text,) = re.findall(rf"#define {name} \{{(.*)\}}", program)
        pairs = np.array([[float(x) for x in pair.split(", ")] for pair in re.findall(r"FROM\(([^)]*)\)", text)])
        np.testing.assert_allclose(pairs.T, values, rtol=1e-9, atol=1e-12, err_msg=name)


def _assert_values(row: dict[str, Any], begun: Any) -> None:
    """Expected: no limit is 0; the feedforward is for the loop's delay, the unit's own is one sample; start forces."""
    options, limits = _options(row), [row[name] for name in ("force_limit", "rate_limit")]
    found = [begun[name][0] for name in ("delay", "output_delay", "force_limit", "force_rate_limit")]
    assert found == [options["delay"], 1, *(limit if np.isfinite(limit) else 0 for limit in limits)]
    q = START if row["start"] else motion_of(options, HOME)(np.zeros(1))[0][0]
    for name in ("start_force", "actuator_force"):
        np.testing.assert_allclose(begun[name], start_of(options, UNEVEN, _machine(row), q), rtol=1e-9)
