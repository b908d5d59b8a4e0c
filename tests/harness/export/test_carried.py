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
from gough_stewart import Experiment, UnstableLoopError
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.export.choices import Part, carried
from gough_stewart.harness.export.design import designed
from gough_stewart.harness.export.notes import Notes, left_out, notes_of
from gough_stewart.harness.export.stability import Host, stability_of
from gough_stewart.harness.loop.run import Run
from gough_stewart.harness.plants import signals
from tests.harness.export.test_controllers import PD
from tests.harness.export.test_controllers import PID as UNFED
from tests.harness.export.test_controllers import SINE as UNFADED
from tests.support.arrays import FloatArray
from tests.support.commands import invoke
from tests.support.exported import Exported, run_in_python, uneven_experiment
from tests.support.exported_loop import EXPORTED
from tests.support.sampled_unit import run_unit

SINE: dict[str, Any] = {**UNFADED, "fade_in": 0.0, "phase": 0.6, "orientation_amplitude": [0.04, 0.05, -0.06]}
PID: dict[str, Any] = {**UNFED, "anti_windup_time": 0.05, "feedforward": "computed_torque"}
LOOP: dict[str, Any] = {"duration": 0.15, "sample_time": 0.0015, "plant_step": 0.0005, "delay": 2}
ACTUATORS: dict[str, Any] = {"force_limit": 90.0, "rate_limit": 9e3, "lag": 0.0021}
SENSORS: dict[str, Any] = {"quantisation": {"leg_length": 2e-4}, "sample_time": 0.001}
TASK = {**PD, "space": "task"}
PARTS: tuple[Part, ...] = ("drives", "sensors")
Row = tuple[dict[str, Any], tuple[Part, ...]]
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
    "sensors alone, at their own clock": ({"actuators": {"force_limit": 90.0}}, ("sensors",)),
    "sensors alone, at the samples": (
        {"actuators": {"force_limit": 90.0}, "sensors": {"quantisation": {"leg_length": 3e-4}}},
        ("sensors",),
    ),
    "drives without a limit, feedforward alone": (
        {
            "controller": {"type": "open_loop", "feedforward": "gravity"},
            "actuators": {"rate_limit": 2e3},
            "reference": {**SINE, "frequency": 9.0},
        },
        ("drives",),
    ),
}


def made(tables: Mapping[str, Any]) -> Experiment:
    tables = {"reference": SINE, "controller": PID, "loop": LOOP, "actuators": ACTUATORS, "sensors": SENSORS, **tables}
    return uneven_experiment(**tables)


def steps_of(experiment: Experiment, parts: tuple[Part, ...]) -> tuple[int, int]:
    """Rows of a run from step to step of the exported code, and rows of the delay."""
    step = experiment.loop.plant_step or experiment.loop.sample_time
    in_sample = round(experiment.loop.sample_time / step)
    is_fine = "drives" in parts or experiment.sensors.sample_time is not None
    return 1 if is_fine else in_sample, in_sample * experiment.loop.delay


def true_signals(run: Run, names: list[str]) -> FloatArray:
    return run.results[:, signals.positions(names) if names else []]


def forces_of(code: Exported, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Forces and flags of every step, and which of them the rate limit affects."""
    code.start()
    found = [code.step(row) for row in rows]
    return np.array([each[0] for each in found]), np.array([each[1] for each in found])


@pytest.mark.parametrize("name", ROWS)
def test_c_gives_the_forces_that_act_in_a_run(name: str) -> None:
    """Expected: the run's own rows, whose true signals the code is fed with, the delay later; 1e-9 of the largest.

    A delay is the same before the drives, where the run has it, and behind them.
    """
    tables, parts = ROWS[name]
    experiment = made(tables)
    run = run_in_python(experiment)
    code = Exported(designed(experiment, parts=parts))
    every, late = steps_of(experiment, parts)
    true = true_signals(run, [v.name for v in code.designed.measured])[:-1:every]
    force, limited = forces_of(code, true)
    expected = run.inputs[:-1:every, :6]
    n = late // every
    expected, force, limited = expected[n:], force[: len(force) - n], limited[: len(limited) - n]
    assert np.ptp(expected, axis=0).min() > 1.5
    assert np.abs(force - expected).max() < 1e-9 * np.abs(expected).max()
    of_rows = run.force_limited[run.sample_of_row][: len(run.inputs) - 1 : every][: len(limited)]
    np.testing.assert_array_equal(limited, of_rows)
    if "force_limit" in tables.get("actuators", ACTUATORS):
        assert limited.any()


def test_settings_of_drives_and_sensors_are_live() -> None:
    """Expected: a run with the new values from the start; and what is set to 0 is not there."""
    code = Exported(designed(made({}), parts=PARTS))
    for lag, rate, limit, step in ((0.006, 4e3, 70.0, 5e-4), (0.0, 0.0, 0.0, 0.0)):
        values = {"force_limit": limit or "none", "lag": lag, **({"rate_limit": rate} if rate else {})}
        experiment = made(
            {"actuators": values, "sensors": {"quantisation": {"leg_length": step}, "sample_time": 0.001}}
        )
        run = run_in_python(experiment)
        for name, value in (("force_lag", lag), ("force_rate_limit", rate), ("force_limit", limit)):
            code.parameters[name] = value
        code.parameters["leg_length_quantisation"] = step
        # an open force limit changes the excess alone, and starts from the same forces
        force, _ = forces_of(code, true_signals(run, ["leg_length"])[:-1])
        expected = run.inputs[6:-1, :6]
        assert np.abs(force[:-6] - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("name", "value"),
    [("force_lag", -1e-3), ("force_lag", np.inf), ("leg_length_quantisation", -1e-6),
     ("leg_length_quantisation", 1e-16), ("leg_length_quantisation", np.nan), ("force_rate_limit", 1e-4)],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(name: str, value: float) -> None:
    """Expected: the number of the parameter in the struct."""
    code = Exported(designed(made({}), parts=PARTS))
    code.parameters[name] = value
    assert code.prepare() == 1 + [s.variable.name for s in code.designed.settings].index(name)


def test_signals_have_quantisers_of_their_own() -> None:
    """Expected: a CasADi function of two signals hears each rounded to its own step, by hand."""
    sizes = {"orientation": 3, "leg_length": 6}
    s = {name: casadi.SX.sym(name, size) for name, size in sizes.items()}
    out = 1e3 * s["leg_length"] + casadi.vertcat(1e4 * s["orientation"], casadi.SX.zeros(3))
    law = casadi.Function("law", list(s.values()), [out], list(s), ["actuator_force"])
    steps = {"leg_length": 0.004, "orientation": 0.03}
    experiment = made(
        {"controller": {"type": "open_loop"}, "actuators": {"force_limit": "none"}, "sensors": {"quantisation": steps}}
    )
    code = Exported(designed(experiment, law, parts=("sensors",)))
    rng = np.random.default_rng(5)
    rows = np.hstack([rng.uniform(-0.2, 0.2, (30, 3)), rng.uniform(2.6, 3.2, (30, 6))])
    force, _ = forces_of(code, rows)
    angle, length = (q * np.rint(part / q) for q, part in ((0.03, rows[:, :3]), (0.004, rows[:, 3:])))
    expected = 1e3 * length + 1e4 * np.hstack([angle, 0 * angle])
    assert np.abs(force - expected).max() < 1e-9 * np.abs(expected).max()


# --- units and systems -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Experiment, list[Path], list[str]]:
    """The units of a loop with everything, and the warnings."""
    experiment, said = made({}), list[str]()
    files = gs.export(experiment, forms=["fmu"], parts=["drives", "sensors"], out=tmp_path_factory.mktemp("units"),
                      warn=said.append, allow_unstable=True)  # fmt: skip
    return experiment, files, said


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("parts_of_step", [1, 2])
def test_units_give_the_forces_that_act_in_a_run(
    written: tuple[Experiment, list[Path], list[str]], version: int, parts_of_step: int
) -> None:
    """Expected: the run's rows; all of the delay is the unit's. By FMPy, in steps of the plant and in half of them."""
    experiment, files, _ = written
    run = run_in_python(experiment)
    (path,) = (file for file in files if f"fmi{version}" in file.name)
    true = true_signals(run, ["leg_length"])[:-1]
    inputs = [{"leg_length": row} for row in true]
    outputs, begun = run_unit(path, inputs, 0.0005, 0.0, parts_of_step, ["rate_limited"])
    assert begun["output_delay"] == 2
    # outputs are those of the next row
    assert np.abs(outputs.force[:-1] - run.inputs[1:-1, :6]).max() < 1e-9 * np.abs(run.inputs[:, :6]).max()
    assert np.abs(run.inputs[:-1, :6] - run.inputs[0, :6]).max() > 10
    np.testing.assert_array_equal(begun["rate_limited"][:-1], run.rate_limited[1:-1])
    commanded = run.force_limited[run.sample_of_row][:-1]
    np.testing.assert_array_equal(outputs.limited[5:], commanded[: len(commanded) - 5])


def test_a_unit_takes_its_steps_by_itself(written: tuple[Experiment, list[Path], list[str]]) -> None:
    """Expected: for inputs that stay, the forces of short communication steps, at the ends of longer ones."""
    _, files, _ = written
    (path,) = (file for file in files if "fmi3" in file.name)
    lengths = np.array([2.81, 2.92, 2.77, 2.88, 2.97, 2.84])
    short, *others = (
        run_unit(path, [{"leg_length": lengths}] * round(0.06 / step), step, 1.7)[0].force
        for step in (0.0005, 0.003, 0.0025)
    )
    assert np.abs(np.diff(short, axis=0)).max() > 1
    for n, force in zip((6, 5), others, strict=True):
        np.testing.assert_array_equal(force, short[n - 1 :: n])


def test_a_loop_of_the_harness_refuses_a_unit_with_parts(written: tuple[Experiment, list[Path], list[str]]) -> None:
    """Expected: its drives would act twice; what is wrong, and what to do."""
    experiment, files, _ = written
    table = {"type": "fmu", "file": str(files[0]), "parameters": {"output_delay": 1}}
    with pytest.raises(
        gs.GoughStewartError, match="carries drives or sensors of its machine, which the loop has as well"
    ):
        gs.run(experiment, {"controller": table})


def test_a_unit_says_what_it_carries(written: tuple[Experiment, list[Path], list[str]]) -> None:
    """Expected: outputs, live parameters with units, and the clock, in the description; the rest in its page."""
    _, files, said = written
    (path,) = (file for file in files if "fmi2" in file.name)
    description = fmpy.read_model_description(str(path))
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
    with zipfile.ZipFile(path) as archive:
        page = archive.read("documentation/index.html").decode()
    assert "their means over each step of 0.5 ms" in page
    assert "measurements are read every 1 ms, and quantised" in page
    assert "Nothing of the experiment is left out." in page
    assert "3 in a sample" in page
    assert not any("without" in text for text in said)


def test_an_ssp_with_its_parts_is_the_loop_of_the_harness(tmp_path: Path) -> None:
    """Expected: a run with drives and encoders, but for flips of an encoder; a run without them is another one.

    The machine is what is believed, and the reference rests at first, as FMPy's first sample is one of zeros.
    """
    settings = {
        **EXPORTED, "loop.duration": 0.12, "loop.plant_step": 0.001, "reference.at": 0.02,
        "actuators": {"rate_limit": 2e5, "lag": 0.004}, "limits.reference": "warn",
        "sensors.quantisation": {"leg_length": 1e-6},
    }  # fmt: skip
    names = [f"leg_length[{k}]" for k in range(1, 7)]
    (ssp,) = gs.export("heave_step", settings, forms="ssp", parts=PARTS, out=tmp_path)
    result = simulate_ssp(str(ssp), stop_time=0.1195, step_size=0.001)
    found = np.stack([result[f"plant.{name}"] for name in names], axis=1)
    # FMPy's rows are of the ends of steps
    run, other = (
        gs.run("heave_step", each).table.select(names).to_numpy()[1:]
        for each in (settings, {**settings, "actuators": {}, "sensors.quantisation": {}})
    )
    assert np.abs(found - run).max() < 2e-8
    assert np.abs(other - run).max() > 2e-5
    with zipfile.ZipFile(ssp) as archive:
        text = archive.read("SystemStructure.ssd").decode()
    assert 'baseStepSize="0.001"' in text
    assert text.count('name="force_lag"') == 1
    assert "Nothing of the experiment is left out." in text


# --- what is said, judged and refused --------------------------------------------------------------------------------


def test_what_is_carried_is_not_left_out() -> None:
    """Expected: by part, beside noise and what varies."""
    experiment = gs.load_experiment("heave_step", {
        "actuators": {"lag": 0.002, "rate_limit": 1e5}, "loop.jitter": 0.0005, "loop.plant_step": 0.0005,
        "sensors": {"noise": {"leg_length": 1e-5}, "quantisation": {"leg_length": 1e-5}, "sample_time": 0.002},
        "ensemble.actuators.lag": {"uniform": [0.001, 0.002]},
    })  # fmt: skip
    drives, sensors = ["actuators.rate_limit", "actuators.lag"], ["sensors.quantisation", "sensors.sample_time"]
    rest = ["loop.jitter", "sensors.noise"]
    assert sorted(left_out(experiment, "c")) == sorted([*drives, *sensors, *rest])
    assert sorted(left_out(experiment, "c", ("drives",))) == sorted([*sensors, *rest, "ensemble.actuators.lag"])
    assert sorted(left_out(experiment, "ssp", PARTS)) == sorted([*rest, "ensemble.actuators.lag"])


def judged(settings: dict[str, Any], host: Host, parts: tuple[Part, ...]) -> tuple[Any, Notes]:
    """The loops of a form that carries these parts, and what is said of it."""
    experiment = gs.load_experiment("heave_step", {"loop.duration": 0.05, **settings})
    prepared = prepare(experiment)
    report = stability_of(experiment, prepared, (host,), parts=parts, margins=False)[host]
    return report.loops, notes_of(experiment, host, report, carried(parts, prepared))


def test_the_loop_of_an_ssp_with_drives_is_judged_with_their_lag(tmp_path: Path) -> None:
    """Expected: a lag that makes the loop unstable refuses the export with the drives, and not without them.

    Members with other lags have the carried one, since a form holds one; those in C without drives have their own.
    """
    settings = {"controller.bandwidth": 8, "actuators.lag": 0.03}
    (loop,), notes = judged(settings, "ssp", ())
    assert (loop.nominal.loop.lag, loop.is_stable) == (0.0, True)
    assert "The lag of the drives" not in " ".join(notes.inside)
    with pytest.raises(UnstableLoopError, match=r"in the SSP the closed loop is unstable .* a lag of 30 ms"):
        gs.export("heave_step", settings, forms="ssp", parts="drives", out=tmp_path / "with")
    ensemble = {"ensemble.actuators.lag": {"choice": [0.001, 0.002]}, "ensemble.members": 6}
    members = {"controller.bandwidth": 3, "actuators.lag": 0.004, **ensemble}
    for parts, lags in (((), {0.001, 0.002}), (PARTS, {0.004})):
        (loop,), notes = judged(members, "c", parts)
        assert loop.worst.loop.lag in lags
        assert ("The lag of the drives was part of it" in " ".join(notes.inside)) == bool(parts)


def test_an_fmu_with_drives_has_one_loop_with_the_whole_delay() -> None:
    """Expected: the delay of the experiment, and no second loop directly at a plant."""
    settings = {"loop.delay": 3, "actuators.lag": 0.002, "controller.bandwidth": 2}
    loops, notes = judged(settings, "fmu", ("drives",))
    assert [(loop.surroundings.where, loop.nominal.loop) for loop in loops] == [("with the FMU", (3, 0.002, 0.0))]
    assert notes.inside[0].startswith("Drives: the forces are those that act")
    assert notes.inside[1].startswith("Delay: forces act 3 samples after their measurement (output_delay = 3)")
    loops, notes = judged(settings, "fmu", ("sensors",))
    assert [loop.nominal.loop for loop in loops] == [(3, 0.002, 0.0), (1, 0.0, 0.0)]
    assert notes.inside[1].startswith("Delay: the unit outputs the forces of a sample one sample later")


def test_readings_later_than_the_samples_are_in_the_judged_delay() -> None:
    """Expected: of readings each 4 ms a sample of 1 ms has one at most 3 ms old; an SSP without sensors reads at it."""
    settings = {"sensors.sample_time": 0.004, "sensors.quantisation": {}}
    cases: list[tuple[Host, Part, float]] = [("ssp", "sensors", 0.003), ("ssp", "drives", 0), ("c", "drives", 0.003)]
    for form, part, late in cases:
        loops, _ = judged(settings, form, (part,))
        assert [loop.nominal.loop.late for loop in loops] == [pytest.approx(late)], (form, part)


@pytest.mark.parametrize(
    ("parts", "settings", "message"),
    [
        ("drive", {}, "no part 'drive'; did you mean 'drives'?"),
        (3, {}, "parts is 3; expected one or more of drives, sensors, manual"),
        (
            "drives",
            {"loop.duration": 0.06, "loop.sample_time": 0.02, "loop.plant_step": 1e-5, "controller.bandwidth": 0.2},
            "drives run at the plant_step of 1e-05 s, 2000 times in a sample of 0.02 s; expected at most 1000 times",
        ),
    ],
)
def test_parts_that_cannot_be_are_refused(parts: Any, settings: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(gs.GoughStewartError, match=re.escape(message)):
        gs.export("heave_step", settings, forms="c", parts=parts, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_command_takes_parts(tmp_path: Path) -> None:
    """Expected: the settings in the header, and what is still left out on the terminal."""
    options = ["--as", "c", "--with", "sensors, drives", "--set", "actuators.lag=3 ms", "--set", "loop.jitter=0"]
    done = invoke("export", "heave_step", *options, "--out", str(tmp_path))
    assert done.exit_code == 0, done.output
    header = (tmp_path / "heave_step_controller.h").read_text()
    for text in ("controller_real force_lag; /* [s] time constant of the drives; 0: none */", "STEPS_A_SAMPLE = 1 ",
                 "controller_real leg_length_quantisation; /* [m]", "At each step:"):  # fmt: skip
        assert text in header
    wrong = invoke("export", "heave_step", "--with", "gears", "--out", str(tmp_path))
    assert wrong.exit_code == 2
    assert "no part 'gears'" in wrong.output
