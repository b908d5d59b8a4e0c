"""Controllers exported in single precision against the harness; no arithmetic in double is left in them.

Tolerances are lengths times gains: what rounding of a length relative to home, at most 0.5 m or 3e-8 m, makes of a
force through the gain at high frequencies, kp + kd/Tf.
"""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import casadi
import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gough_stewart as gs
from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.export import symbols
from gough_stewart.harness.export.write import controller_sources
from gough_stewart.harness.export.design import Designed, designed
from gough_stewart.harness.export.laws import PidLaw
from gough_stewart.harness.export.relative import change_of_lengths, home_of
from gough_stewart.harness.motion.limits.reach import legs_of
from gough_stewart.model.kinematics import leg_geometry
from tests.harness.export.test_controllers import CASES, CIRCLE, HOLD, PD, PID, SINE, often, systems
from tests.harness.export.test_toolchains import M4F, STRICT
from tests.support.exported import (
    Exported,
    commanded,
    compiled,
    measured_by,
    run_in_python,
    uneven_experiment,
    write_sources,
)
from tests.support.uneven import UNEVEN

LENGTH = 2e-7  # [m]
FORCE = 3e-6  # of the largest: the physics of the feedforward


def tolerance(made: Designed, expected: np.ndarray, gain: float = 1e4) -> float:
    if isinstance(made.law, PidLaw):
        gains = made.law.gains
        gain = float((np.asarray(gains.proportional) + np.asarray(gains.derivative) / gains.filter_time).max())
    return LENGTH * gain + FORCE * float(np.abs(expected).max())


# legs and task space, tables of gains, both discretisations, limits; the others take their time
OFTEN = ("PD along a scaled motion", "PID in task space at its rate limit")


@pytest.mark.parametrize("case", often(CASES, OFTEN))
def test_forces_are_those_of_the_harness(case: str) -> None:
    """Expected: what the Python loop commanded. Gains of the platform are not larger than of legs."""
    experiment = uneven_experiment(**CASES[case])
    made, run = designed(experiment), run_in_python(experiment)
    expected = commanded(run, made)
    exported = Exported(made, single=True)
    forces = exported.forces(measured_by(run, made))
    assert exported.status == 0
    assert np.abs(forces - expected).max() < tolerance(made, expected)


@pytest.mark.parametrize("name", often(systems(), ("references and measurements of the pose", "errors in task space")))
def test_a_discrete_system_gives_the_forces_of_the_harness(name: str) -> None:
    """Expected: the harness; also where references and measurements have gains of their own, so whole ones count."""
    experiment = uneven_experiment(
        reference=SINE,
        controller={**PD, "feedforward": "gravity"},
        actuators={"force_limit": 90.0},
        limits={"position_error": 1e3},
        loop={"duration": 0.06, "sample_time": 0.0015, "plant_step": 0.0005},
    )
    controller = systems()[name]
    made, run = designed(experiment, controller), run_in_python(experiment, controller)
    expected = commanded(run, made)
    forces = Exported(made, single=True).forces(measured_by(run, made))
    assert np.abs(forces - expected).max() < 2e-4 * np.abs(expected).max()


@pytest.mark.parametrize(
    "name", often(("fastest_path", "recorded_ride", "excitation"), ("fastest_path", "recorded_ride"))
)
def test_motions_that_are_no_formula_give_the_forces_of_the_harness(name: str) -> None:
    whole = load_experiment(name, {"loop.duration": 0.4})
    experiment = whole.model_copy(update={"change": [], "injection": None})
    made, run = designed(experiment), run_in_python(experiment)
    expected = commanded(run, made)
    forces = Exported(made, single=True).forces(measured_by(run, made))
    assert np.abs(forces - expected).max() < tolerance(made, expected)


@pytest.mark.parametrize("start", [10**6, 10**9, 2**32 - 5, 10**11])
@pytest.mark.parametrize("reference", [SINE, CIRCLE])
def test_phases_stay_right_for_months(reference: dict[str, Any], start: int) -> None:
    """Expected: the motion in double precision at that time, whose own phases are right to 1e-16 of all turns.

    A float alone has no digit of the phase left after a million samples.
    """
    made = designed(uneven_experiment(reference=reference, controller={**PD, "feedforward": "gravity"}))
    exported = Exported(made, single=True).start()
    exported.step(made.first_measured)
    exported.set_samples(start)
    assert made.reference is not None
    plain = Exported(made).start()
    plain.step(made.first_measured)
    plain.set_samples(start)
    rounding = 1e-15 * start * made.sample_time * 2 * np.pi * 5  # [rad], of the double
    for k in range(5):
        at = made.reference(np.array([(start + k) * made.sample_time]))
        lengths = legs_of(UNEVEN, at).leg_length[0]
        expected, _ = plain.step(lengths)
        force, _ = exported.step(lengths)
        assert np.abs(force - expected).max() < tolerance(made, expected) + 0.1 * rounding * 2e4


@pytest.mark.parametrize("change", [-1e-5, 1e-5])
def test_another_sample_time_than_the_designed_one_has_no_part_of_it(change: float) -> None:
    """Expected: the motion in double precision after a hundred million samples of a shorter, and of a longer time.

    What a float leaves out of the designed sample time would be 5 ms by then.
    """
    made = designed(uneven_experiment(reference=CIRCLE, controller={**PD, "feedforward": "gravity"}))
    exported, plain = Exported(made, single=True), Exported(made)
    for each in (exported, plain):
        each.parameters["sample_time"] = np.float32(made.sample_time + change)
        each.start().step(made.first_measured)
        each.set_samples(10**8)
    T = float(np.float32(made.sample_time + change))
    assert made.reference is not None
    lengths = legs_of(UNEVEN, made.reference(np.array([10**8 * T]))).leg_length[0]
    expected, _ = plain.step(lengths)
    force, _ = exported.step(lengths)
    assert np.abs(force - expected).max() < tolerance(made, expected)


@pytest.mark.parametrize("leg", range(6))
def test_one_measurement_on_a_bus_of_zeros_is_a_fault(leg: int) -> None:
    """Expected: five lengths of 0 are out of range, also at the first sample; only six mean that none has arrived."""
    made = designed(uneven_experiment(reference=HOLD, controller={**PID, "feedforward": "gravity"}))
    row = np.where(np.arange(6) == leg, made.first_measured, 0.0)
    for single in (True, False):
        exported = Exported(made, single=single).start()
        exported.step(np.zeros(6))
        assert exported.status == 0
        exported.step(row)
        assert exported.status == 1


def test_small_steps_of_an_integral_add_up() -> None:
    """Expected: the controller in double precision; steps are less than half of what a float of the sum resolves."""
    made = designed(uneven_experiment(reference=HOLD, controller=PID))
    exported, plain = Exported(made, single=True).start(), Exported(made).start()
    for error, samples in ((0.1, 2000), (1e-6, 40000)):
        measured = made.first_measured - error
        for _ in range(samples):
            force, _ = exported.step(measured)
            expected, _ = plain.step(measured)
    step = np.array(PID["integral_gain"]) * 1e-6 * made.sample_time
    legs = step > 0
    assert (step < np.spacing(expected.astype(np.float32)) / 2)[legs].all()
    assert (np.abs(force - expected) < 0.1 * 40000 * step)[legs].all()


def test_a_reference_that_comes_in_is_relative_to_home() -> None:
    """Expected: the forces of the reference inside, but for what an extrapolation leaves out."""
    experiment = uneven_experiment(reference=CIRCLE, controller=PD)
    made, run = designed(experiment, reference="inputs"), run_in_python(experiment)
    inside = designed(experiment).reference
    assert inside is not None
    expected = commanded(run, made)
    rows = np.concatenate(inside(np.arange(len(expected)) * made.sample_time), axis=1)
    forces = Exported(made, single=True).forces(measured_by(run, made), rows)
    assert np.abs(forces - expected).max() < tolerance(designed(experiment), expected)


def test_a_bus_of_zeros_waits_and_later_is_a_fault() -> None:
    """Expected: zeros less home are start forces first, and then the feedforward with the status of a bad input."""
    made = designed(uneven_experiment(reference=HOLD, controller={**PID, "feedforward": "gravity"}))
    exported, plain = Exported(made, single=True).start(), Exported(made).start()
    for row in (np.zeros(6), made.first_measured, np.zeros(6), made.first_measured + 1e-3, np.full(6, np.nan)):
        force, _ = exported.step(row)
        expected, _ = plain.step(row)
        np.testing.assert_allclose(force, expected, rtol=1e-5, atol=1e-2)
        assert exported.status == plain.status
        assert exported.bad_time == pytest.approx(plain.bad_time)


def test_a_function_computes_from_whole_signals() -> None:
    """Expected: the same function called with numbers; whole lengths of 3 m have a resolution of 0.24 µm."""
    length, reference = casadi.SX.sym("leg_length", 6), casadi.SX.sym("reference_leg_length", 6)
    time = casadi.SX.sym("time")
    force = 500 * (reference - length) + 3 * length**2 + casadi.sin(time)
    names = ["time", "leg_length", "reference_leg_length"]
    law = casadi.Function("law", [time, length, reference], [force], names, ["actuator_force"])
    made = designed(uneven_experiment(reference=CIRCLE, controller={**PD, "feedforward": "none"}), law)
    exported = Exported(made, single=True).start()
    assert made.reference is not None
    for k in range(20):
        at = made.reference(np.array([k * made.sample_time]))
        wanted = legs_of(UNEVEN, at).leg_length[0]
        measured = wanted + 0.01 * np.arange(6)
        expected = np.asarray(law(k * made.sample_time, measured, wanted)).ravel()
        found, _ = exported.step(measured)
        assert np.abs(found - expected).max() < 500 * 5e-7 + 1e-6 * np.abs(expected).max()


POSES = st.tuples(*[st.floats(-0.3, 0.3)] * 6)


@given(POSES)
@settings(max_examples=30)
def test_changes_of_lengths_are_differences_of_lengths(pose: tuple[float, ...]) -> None:
    """Expected: leg lengths by the geometry, at the pose and at home."""
    home = home_of(UNEVEN)
    symbol, platform = casadi.SX.sym("pose", 6), symbols.platform_symbols()
    formula = change_of_lengths(symbols.parameters_of(platform), home, symbol)
    values = [UNEVEN.base_points.ravel(), UNEVEN.platform_points.ravel()]
    f = casadi.Function("f", [symbol, platform["base_points"], platform["platform_points"]], [formula])
    found = np.asarray(f(pose, *values)).ravel()
    at = home.pose + np.array(pose)
    np.testing.assert_allclose(
        found, leg_geometry(UNEVEN, at[:3], at[3:]).length - home.leg_length, rtol=1e-9, atol=1e-14
    )


SHIPPED = ("saturation", "pitch_sine", "fastest_path", "recorded_ride", "circle from inputs", "circle", "excitation")


@pytest.mark.parametrize("name", often(SHIPPED, ("pitch_sine", "fastest_path", "circle from inputs")))
def test_a_cortex_m4f_computes_without_software_arithmetic(name: str, tmp_path: Path) -> None:
    """Expected: no call of the compiler's runtime, whose functions for double are named __aeabi_d…; no warning."""
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("arm-none-eabi-gcc is not installed")
    experiment, _, inputs = name.partition(" from ")
    made = designed(load_experiment(experiment), None, "inputs" if inputs else "inside")
    write_sources(controller_sources(made, real="float"), tmp_path)
    compiled(["arm-none-eabi-gcc", *M4F, *STRICT, "-std=c99", "-O1", "-c", "controller.c"], tmp_path)
    symbols_of = subprocess.run(
        ["arm-none-eabi-nm", "--undefined-only", "controller.o"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    called = {line.split()[-1] for line in symbols_of.splitlines()}
    assert not {each for each in called if each.startswith("__aeabi_") and "mem" not in each}
    assert called - {"memset", "memcpy"} <= {
        f"{each}f" for each in ("sin", "cos", "tanh", "floor", "fma", "fmin", "fmax", "atan2", "hypot", "remainder")
    } | {"sqrtf"} | {each for each in called if "mem" in each}
    compiled(
        [
            "arm-none-eabi-g++",
            *M4F,
            "-Wall",
            "-Wextra",
            "-Werror",
            "-pedantic",
            "-x",
            "c++",
            "-std=c++11",
            "-fsyntax-only",
            "controller.c",
        ],
        tmp_path,
    )


def test_the_header_states_the_deviation_that_was_measured(tmp_path: Path) -> None:
    """Expected: the largest difference of the forces from the harness, measured again with another compiler."""
    files = gs.export("saturation", {"loop.duration": 0.3}, forms="c", real="float", out=tmp_path)
    header = " ".join(files[1].read_text().split())
    stated = re.search(r"in (\S+) s of the designed loop, by at most (\S+) N, (\S+) of the largest force", header)
    assert stated is not None
    experiment = load_experiment("saturation", {"loop.duration": 0.3})
    experiment = experiment.model_copy(update={"change": [], "disturbance": [], "injection": None})
    made, run = designed(experiment), run_in_python(experiment)
    expected = commanded(run, made)
    found = np.abs(Exported(made, single=True).forces(measured_by(run, made)) - expected).max()
    assert float(stated[2]) == pytest.approx(found, rel=0.5)
    assert 0 < float(stated[2]) < tolerance(made, expected)
    assert float(stated[1]) == pytest.approx(0.3, abs=0.01)


def test_single_precision_is_of_c_alone(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="real = 'float' is of the form c alone"):
        gs.export("circle", forms="fmu", real="float", out=tmp_path)
    with pytest.raises(ExportError, match="real is 'half'; expected 'double' or 'float'"):
        gs.export("circle", forms="c", real="half", out=tmp_path)  # type: ignore[arg-type]


def test_a_static_gain_is_exact_where_a_float_can_be() -> None:
    """Expected, by hand: K (r − y) of lengths that differ by 1 µm, to 1 %; whole lengths resolve 0.24 µm."""
    law = LinearController(control.ss([], [], [], 1e6 * np.eye(6), 0.0015))
    made = designed(uneven_experiment(reference={"type": "hold"}, controller={**PD, "feedforward": "none"}), law)
    force, _ = Exported(made, single=True).start().step(made.first_measured - 1e-6 * np.arange(1, 7))
    np.testing.assert_allclose(force, np.arange(1, 7), rtol=1e-2)
