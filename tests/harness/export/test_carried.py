"""Exported controllers that carry drives and sensors, against runs; unequal clocks, six different legs."""

import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import casadi
import fmpy
import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp

import gough_stewart as gs
from tests.harness.export.sampled_unit import run_unit
from tests.support.exported import PD, Exported, source_of, uneven_experiment, words_of
from tests.support.exported import PID as UNFED
from tests.support.exported import SINE as UNFADED
from tests.support.exported_loop import EXPORTED

SINE: dict[str, Any] = {**UNFADED, "fade_in": 0.0, "phase": 0.6, "orientation_amplitude": [0.04, 0.05, -0.06]}
PID: dict[str, Any] = {**UNFED, "anti_windup_time": 0.05, "feedforward": "computed_torque"}
LOOP: dict[str, Any] = {"duration": 0.15, "sample_time": 0.0015, "plant_step": 0.0005, "delay": 2}
ACTUATORS: dict[str, Any] = {"force_limit": 90.0, "rate_limit": 9e3, "lag": 0.0021}
SENSORS: dict[str, Any] = {"quantisation": {"leg_length": 2e-4}, "sample_time": 0.001}
TASK = {**PD, "space": "task"}
PARTS: Any = ("drives", "sensors")
Row = tuple[dict[str, Any], tuple[str, ...]]
AT_ONCE = {"force_limit": 90.0}
ROWS: dict[str, Row] = {
    "readings faster than samples": ({}, PARTS),
    "readings slower than samples, no lag": (
        {"sensors": {**SENSORS, "sample_time": 0.004}, "actuators": {**ACTUATORS, "lag": 0.0}},
        PARTS,
    ),
    "one clock, no rate limit, no delay": (
        {
            "loop": {**LOOP, "plant_step": 0.0015, "delay": 0},
            "sensors": {"quantisation": {"leg_length": 1e-4}},
            "actuators": {"lag": 0.005},
            "controller": TASK,
        },
        PARTS,
    ),
    "drives alone": ({"sensors": {}}, ("drives",)),
    "sensors alone, at their own clock": ({"actuators": AT_ONCE}, ("sensors",)),
    "sensors alone, at the samples": (
        {"actuators": AT_ONCE, "sensors": {"quantisation": {"leg_length": 3e-4}}},
        ("sensors",),
    ),
    "drives without a limit, feedforward alone": (
        {"controller": {"type": "open_loop", "feedforward": "gravity"}, "actuators": {"rate_limit": 2e3}},
        ("drives",),
    ),
}


def made(tables: Mapping[str, Any]) -> gs.Experiment:
    tables = {"reference": SINE, "controller": PID, "loop": LOOP, "actuators": ACTUATORS, "sensors": SENSORS, **tables}
    return uneven_experiment(**tables)


@pytest.mark.parametrize("name", ROWS)
def test_c_gives_the_forces_that_act_in_a_run(name: str) -> None:
    """Expected: the run's own rows, whose true signals the code is fed with, the delay later; 1e-9 of the largest."""
    tables, parts = ROWS[name]
    experiment = made(tables)
    record, code, loop = gs.run(experiment), Exported(source_of(experiment, parts=parts)), experiment.loop
    # rows of a run from step to step of the exported code, and steps of the delay
    in_sample = round(loop.sample_time / (loop.plant_step or loop.sample_time))
    every = 1 if "drives" in parts or experiment.sensors.sample_time is not None else in_sample
    n = in_sample * loop.delay // every
    true = record["leg_length"][:-1][::every]
    force, limited = code.steps(true if code.sizes["N_MEASURED"] else true[:, :0])
    expected = record["actuator_force"][:-1:every][n:]
    assert np.ptp(expected, axis=0).min() > 1.5
    assert np.abs(force[: len(expected)] - expected).max() < 1e-9 * np.abs(expected).max()
    np.testing.assert_array_equal(limited, record["flag.force_limited"][:-1:every])
    if "force_limit" in tables.get("actuators", ACTUATORS):
        assert limited.any()


def test_settings_of_drives_and_sensors_are_live_and_bounded() -> None:
    """Expected: a run with the new values from the start, and what is set to 0 is not there; a refusal's number."""
    code = Exported(source_of(made({}), parts=PARTS))
    for lag, rate, limit, step in ((0.006, 4e3, 70.0, 5e-4), (0.0, 0.0, 0.0, 0.0)):
        values = {"force_limit": limit or "none", "lag": lag, **({"rate_limit": rate} if rate else {})}
        sensors = {"quantisation": {"leg_length": step}, "sample_time": 0.001}
        record = gs.run(made({"actuators": values, "sensors": sensors}))
        for name, value in (("force_lag", lag), ("force_rate_limit", rate), ("force_limit", limit)):
            code.parameters[name] = value
        code.parameters["leg_length_quantisation"] = step
        # an open force limit changes the excess alone, and starts from the same forces
        force, _ = code.steps(record["leg_length"][:-1])
        expected = record["actuator_force"][6:-1]
        assert np.abs(force[:-6] - expected).max() < 1e-9 * np.abs(expected).max()
    for name, bad in (
        *(("force_lag", value) for value in (-1e-3, np.inf)),
        *(("leg_length_quantisation", value) for value in (-1e-6, 1e-16, np.nan)),
        ("force_rate_limit", 1e-4),
    ):
        good = code.parameters[name].copy()
        code.parameters[name] = bad
        assert code.prepare() == 1 + code.names.index(name)
        code.parameters[name] = good


def test_a_first_reading_is_taken_when_it_comes() -> None:
    """Expected: at its sample, the forces of a controller without a sensors' clock, which is 8 steps here."""
    slow = made({"actuators": AT_ONCE, "sensors": {**SENSORS, "sample_time": 0.004}})
    code, at_once = Exported(source_of(slow, parts="sensors")).start(), Exported(source_of(slow)).start()
    forces = [code.step(np.full(6, 3.0 * (k > 0)))[0] for k in range(4)]
    expected = [at_once.step(lengths)[0] for lengths in (np.zeros(6), np.full(6, 3.0))]
    np.testing.assert_allclose([forces[2], forces[3]], expected, rtol=1e-12)


def test_signals_have_quantisers_of_their_own() -> None:
    """Expected: a CasADi function of two signals hears each rounded to its own step, by hand."""
    sizes = {"orientation": 3, "leg_length": 6}
    s = {name: casadi.SX.sym(name, size) for name, size in sizes.items()}
    out = 1e3 * s["leg_length"] + casadi.vertcat(1e4 * s["orientation"], casadi.SX.zeros(3))
    law = casadi.Function("law", list(s.values()), [out], list(s), ["actuator_force"])
    steps = {"leg_length": 0.004, "orientation": 0.03}
    around = {"actuators": {"force_limit": "none"}, "sensors": {"quantisation": steps}}
    code = Exported(source_of(made({"controller": {"type": "open_loop"}, **around}), law, parts="sensors"))
    rng = np.random.default_rng(5)
    rows = np.hstack([rng.uniform(-0.2, 0.2, (30, 3)), rng.uniform(2.6, 3.2, (30, 6))])
    angle, length = (q * np.rint(part / q) for q, part in ((0.03, rows[:, :3]), (0.004, rows[:, 3:])))
    expected = 1e3 * length + 1e4 * np.hstack([angle, 0 * angle])
    assert np.abs(code.steps(rows)[0] - expected).max() < 1e-9 * np.abs(expected).max()


def page_of(archive: Path) -> str:
    """The documentation of a unit or a system, in one line."""
    with zipfile.ZipFile(archive) as files:
        return " ".join(files.read("documentation/index.html").decode().split())


Written = tuple[gs.Record, list[Path], list[str]]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """The run of a loop with everything, its units, and the warnings."""
    experiment, said = made({}), list[str]()
    files = gs.export(experiment, parts=PARTS, out=tmp_path_factory.mktemp("units"), warn=said.append,
                      allow_unstable=True)  # fmt: skip
    return gs.run(experiment), files, said


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("parts_of_step", [1, 2])
def test_units_give_the_forces_that_act_in_a_run(written: Written, version: int, parts_of_step: int) -> None:
    """Expected: the run's rows; all of the delay is the unit's. By FMPy, in steps of the plant and in half of them."""
    record, files, _ = written
    inputs, acting = [{"leg_length": row} for row in record["leg_length"][:-1]], record["actuator_force"]
    outputs, begun = run_unit(files[version - 2], inputs, 0.0005, 0.0, parts_of_step, ["rate_limited"])
    assert begun["output_delay"] == 2
    # outputs are those of the next row
    assert np.abs(outputs.force[:-1] - acting[1:-1]).max() < 1e-9 * np.abs(acting).max()
    assert np.abs(acting[:-1] - acting[0]).max() > 10
    np.testing.assert_array_equal(begun["rate_limited"][:-1], record["flag.rate_limited"][1:-1])
    np.testing.assert_array_equal(outputs.limited[5:], record["flag.force_limited"][:-6])


def test_a_unit_takes_its_steps_by_itself(written: Written) -> None:
    """Expected: for inputs that stay, the forces of short communication steps, at the ends of longer ones."""
    lengths = np.array([2.81, 2.92, 2.77, 2.88, 2.97, 2.84])
    short, *others = (
        run_unit(written[1][1], [{"leg_length": lengths}] * round(0.06 / step), step, 1.7)[0].force
        for step in (0.0005, 0.003, 0.0025)
    )
    assert np.abs(np.diff(short, axis=0)).max() > 1
    for n, force in zip((6, 5), others, strict=True):
        np.testing.assert_array_equal(force, short[n - 1 :: n])


def test_a_loop_of_the_harness_refuses_a_unit_with_parts(written: Written) -> None:
    """Expected: its drives would act twice; what is wrong, and what to do."""
    table = {"type": "fmu", "file": str(written[1][0]), "parameters": {"output_delay": 1}}
    with pytest.raises(gs.GoughStewartError, match="carries drives or sensors of its machine, which the loop has as"):
        gs.run(made({}), {"controller": table})


def test_a_unit_says_what_it_carries(written: Written) -> None:
    """Expected: outputs, live parameters with units, and the clock, in the description; the rest in its page."""
    _, files, said = written
    description = fmpy.read_model_description(str(files[0]))
    variables = {v.name: v for v in description.modelVariables}
    assert description.defaultExperiment.stepSize == "0.0005"
    assert variables["rate_limited[6]"].causality == "output"
    for name, start, unit in (
        ("force_lag", "0.0021", "s"),
        ("leg_length_quantisation", "0.0002", "m"),
        ("force_rate_limit", "9000.0", "N/s"),
    ):
        v = variables[name]
        assert (v.start, v.unit or v.declaredType.unit, v.variability) == (start, unit, "tunable")
    page = page_of(files[0])
    assert "their means over each step of 0.5 ms" in page
    assert "measurements are read every 1 ms, and quantised" in page
    assert "Nothing of the experiment is left out." in page
    assert "3 in a sample" in page
    assert not any("without" in text for text in said)


def test_an_ssp_with_its_parts_is_the_loop_of_the_harness(tmp_path: Path) -> None:
    """Expected: a run with drives and encoders, but for flips of an encoder; a run without them is another one."""
    settings = {
        **EXPORTED, "loop.duration": 0.12, "loop.plant_step": 0.001, "reference.at": 0.02,
        "actuators": {"rate_limit": 2e5, "lag": 0.004}, "limits.reference": "warn",
        "sensors.quantisation": {"leg_length": 1e-6},
    }  # fmt: skip
    (ssp,) = gs.export("heave_step", settings, forms="ssp", parts=PARTS, out=tmp_path)
    result = simulate_ssp(str(ssp), stop_time=0.1195, step_size=0.001)
    found = np.stack([result[f"plant.leg_length[{k}]"] for k in range(1, 7)], axis=1)
    # FMPy's rows are of the ends of steps
    run, other = (
        gs.run("heave_step", each)["leg_length"][1:]
        for each in (settings, {**settings, "actuators": {}, "sensors.quantisation": {}})
    )
    assert np.abs(found - run).max() < 2e-8
    assert np.abs(other - run).max() > 2e-5
    with zipfile.ZipFile(ssp) as archive:
        text = archive.read("SystemStructure.ssd").decode()
    assert 'baseStepSize="0.001"' in text
    assert text.count('name="force_lag"') == 1
    assert "Nothing of the experiment is left out." in text


def test_what_is_carried_is_not_left_out_and_the_loop_with_drives_is_judged_with_their_lag(tmp_path: Path) -> None:
    """Expected: by part, beside noise and what varies; of members the carried lag; one loop of a unit with drives."""
    settings = {
        "controller.bandwidth": 2, "loop.delay": 2, "actuators.rate_limit": 1e5, "actuators.lag": 0.004,
        "loop.duration": 0.05,
        "sensors": {"noise": {"leg_length": 1e-5}, "quantisation": {"leg_length": 1e-5}, "sample_time": 0.002},
        "ensemble": {"members": 1, "actuators.lag": {"choice": [0.001, 0.002]}},
    }  # fmt: skip
    drives = {"actuators.rate_limit", "actuators.lag"}
    sensors = {"sensors.quantisation", "sensors.sample_time"}
    whole, alone, late = (2, 0.004, 0.001), (1, 0.0, 0.0), (2, 0.004, 0.0)
    cases: list[tuple[Any, Any, set[str], list[Any], set[float]]] = [
        ("c", "drives", {*sensors, "sensors.noise", "ensemble.actuators.lag"}, [whole], {0.004}),
        ("fmu", PARTS, {"sensors.noise", "ensemble.actuators.lag"}, [whole], {0.004}),
        ("fmu", "sensors", {*drives, "sensors.noise"}, [whole, (1, 0.0, 0.001)], {0.0, 0.001, 0.002}),
        ("ssp", "drives", {*sensors, "sensors.noise", "ensemble.actuators.lag"}, [late], {0.004}),
        ("fmu", (), {*drives, *sensors, "sensors.noise"}, [whole, alone], {0.0, 0.001, 0.002}),
    ]
    for k, (form, parts, missing, delays, lags) in enumerate(cases):
        loops, said = list[Any](), list[str]()
        options: dict[str, Any] = {"fmi": ["2.0"], "allow_unstable": True, "parts": parts, "warn": said.append}
        out = tmp_path / str(k)
        files = gs.export("heave_step", settings, forms=form, out=out, stability=loops.extend, **options)
        text = words_of(files[1]) if form == "c" else page_of(files[0])
        (without,) = [line for line in said if " is without " in line]
        assert set(without.partition(" is without ")[2].partition(": it ")[0].split(", ")) == missing, (form, parts)
        assert sorted(tuple(loop.nominal.loop) for loop in loops) == [pytest.approx(d) for d in sorted(delays)]
        assert {loop.worst.loop.lag for loop in loops} <= lags
        assert ("Drives: the forces are those that act" in text) == ("drives" in parts)
        assert ("The lag of the drives was part of it" in text) == ("drives" in parts)
        assert ("(output_delay = 2)" in text) == (form != "c" and "drives" in parts)


def test_a_count_of_steps_starts_anew_at_a_multiple_of_both_clocks() -> None:
    """Expected: samples of 3 steps and readings of 8; below 2²⁴, up to which a float has all whole numbers."""
    tables, parts = ROWS["readings slower than samples, no lag"]
    found = re.search(r"^#define STEPS_OF_TURN (\d+)$", source_of(made(tables), parts=parts).read_text(), re.M)
    assert found is not None
    assert int(found[1]) % 24 == 0
    assert 2**22 < int(found[1]) < 2**24
