"""`NAME_REAL=float`: no arithmetic in double is left, and no digits are lost that forces need.

The forces of all kinds of controllers in single precision are compared in test_controllers.py.
"""

import ctypes
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart import load_experiment
from gough_stewart.harness.export.design import designed
from gough_stewart.harness.export.moments import function_of_time
from gough_stewart.harness.export.write import RUNTIME, controller_sources
from gough_stewart.harness.motion.limits.reach import legs_of
from tests.harness.export.test_controllers import CIRCLE, HOLD, PD, PID, SINE, often
from tests.harness.export.test_toolchains import M4F, STRICT
from tests.support.exported import (
    COMPILER,
    Exported,
    commanded,
    compiled,
    measured_by,
    run_in_python,
    uneven_experiment,
    write_sources,
)
from tests.support.uneven import UNEVEN

GRAVITY = {**PD, "feedforward": "gravity"}


@pytest.mark.parametrize("start", [10**6, 2**23 - 2, 10**9, 10**11])
@pytest.mark.parametrize("reference", [SINE, CIRCLE])
def test_phases_stay_right_for_months(reference: dict[str, Any], start: int) -> None:
    """Expected: double precision at that sample; a float alone has no digit of the phase after a million samples."""
    made = designed(uneven_experiment(reference=reference, controller=GRAVITY))
    both = [Exported(made, real).start() for real in ("float", "double")]
    for code in both:
        code.step(made.first_measured)
        code.set_samples(start)
    assert made.reference is not None
    rounding = 1e-15 * start * made.sample_time * 2 * np.pi * 5  # [rad], of the double
    for k in range(5):
        lengths = legs_of(UNEVEN, made.reference(np.array([(start + k) * made.sample_time]))).leg_length[0]
        single, double = (code.step(lengths)[0] for code in both)
        assert np.abs(single - double).max() < 1e-4 * np.abs(double).max() + 0.1 * rounding * 2e4
    assert [both[0].remembered(name)[0] for name in ("turns", "samples")] == list(divmod(start + 5, 2**23))


@pytest.mark.parametrize("change", [-1e-5, 1e-5])
def test_another_sample_time_than_the_designed_one_has_no_part_of_it(change: float) -> None:
    """Expected: double precision after a hundred million samples; what a float leaves out would be 5 ms by then."""
    made = designed(uneven_experiment(reference=CIRCLE, controller=GRAVITY))
    T = float(np.float32(made.sample_time + change))
    assert made.reference is not None
    lengths = legs_of(UNEVEN, made.reference(np.array([10**8 * T]))).leg_length[0]
    forces = []
    for real in ("float", "double"):
        code = Exported(made, real)
        code.parameters["sample_time"] = T
        code.start().step(made.first_measured)
        code.set_samples(10**8)
        forces.append(code.step(lengths)[0])
    single, double = forces
    np.testing.assert_allclose(single, double, atol=1e-4 * np.abs(double).max())


def test_small_steps_of_an_integral_add_up() -> None:
    """Expected: double precision; steps are less than half of what a float of the sum resolves."""
    made = designed(uneven_experiment(reference=HOLD, controller=PID))
    both = [Exported(made, real).start() for real in ("float", "double")]
    for error, samples in ((0.1, 2000), (1e-6, 40000)):
        for _ in range(samples):
            force, expected = (code.step(made.first_measured - error)[0] for code in both)
    step = np.array(PID["integral_gain"]) * 1e-6 * made.sample_time
    legs = step > 0
    assert (step < np.spacing(expected.astype(np.float32)) / 2)[legs].all()
    assert (np.abs(force - expected) < 0.1 * 40000 * step)[legs].all()


SHIPPED = ("saturation", "pitch_sine", "fastest_path", "recorded_ride", "circle from inputs", "circle", "excitation")


@pytest.mark.parametrize("name", often(SHIPPED, ("pitch_sine", "circle from inputs")))
def test_a_cortex_m4f_computes_without_software_arithmetic(name: str, tmp_path: Path) -> None:
    """Expected: no call of the compiler's runtime, whose functions for double are named __aeabi_d…; no warning."""
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("arm-none-eabi-gcc is not installed")
    experiment, _, inputs = name.partition(" from ")
    made = designed(load_experiment(experiment), None, "inputs" if inputs else "inside")
    write_sources(controller_sources(made), tmp_path)
    command = [*M4F, *STRICT, "-DCONTROLLER_REAL=float", "-O1", "-c", "controller.c"]
    compiled(["arm-none-eabi-gcc", "-std=c99", *command], tmp_path)
    undefined = ["arm-none-eabi-nm", "--undefined-only", "controller.o"]
    text = subprocess.run(undefined, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    called = {line.split()[-1] for line in text.splitlines()} - {"memset", "memcpy"}
    names = ("sin", "cos", "tanh", "floor", "fma", "fmin", "fmax", "atan2", "hypot", "remainder", "sqrt")
    assert called <= {f"{each}f" for each in names}


def test_the_header_states_the_deviation_that_was_measured(tmp_path: Path) -> None:
    """Expected: the largest difference of the forces from the harness, measured again with another compiler."""
    settings = {"loop.duration": 0.3}
    header = " ".join(gs.export("saturation", settings, forms="c", out=tmp_path)[1].read_text().split())
    stated = re.search(r"in (\S+) s of the designed loop, by at most (\S+) N, (\S+) of the largest force", header)
    assert stated is not None
    assert "With SATURATION_CONTROLLER_REAL=float, forces deviate" in header
    experiment = load_experiment("saturation", settings)
    experiment = experiment.model_copy(update={"change": [], "disturbance": [], "injection": None})
    made, run = designed(experiment), run_in_python(experiment)
    expected = commanded(run, made)
    deviation = np.abs(Exported(made, "float").forces(measured_by(run, made)) - expected).max()
    assert float(stated[2]) == pytest.approx(deviation, rel=0.5)
    assert float(stated[3]) == pytest.approx(deviation / np.abs(expected).max(), rel=0.5)
    assert 0 < float(stated[3]) < 1e-3
    assert float(stated[1]) == pytest.approx(0.3, abs=0.01)


# --- functions of time -----------------------------------------------------------------------------------------------

TIMES = (0.7, 3.0, 5.25, 250_000 + 1 / 3, 1e6 + 0.3125)


def _operations(t: casadi.SX) -> dict[str, casadi.SX]:
    """Of the time itself, which keep 48 bits, up to the phase of a motion; of numbers, and of these with time."""
    phase = 2 * np.pi * 7.3 * t
    x, y = casadi.sin(1.1 * t), 0.5 * casadi.cos(0.7 * t)
    return {
        "sum": t + 0.3, "difference": 1.7 - t, "other difference": t - 250_000.1, "twice": (t + t) - 500_000.2,
        "negative": -t, "product": (1.3 * t) - 325_000.03, "square": t**2 - 6.25e10, "quotient": (t / 3.7) - 67_567.5,
        "other quotient": 2.5 / t, "inverse": 1 / t, "smaller": casadi.fmin(t, 3), "larger": casadi.fmax(3, t),
        "if": casadi.if_else(t < 3, 2 * t, -t), "less": t < 3, "not more": t <= 3, "more": t > 3,
        "sine": casadi.sin(phase), "cosine": casadi.cos(phase + 0.4), "sine of a sum": casadi.sin(2.5 * (t - 250_000)),
        "equal parts": (t * 0.1) / (t * 0.2), "x + y": x + y, "x - y": x - y, "2 x": 2 * x, "-x": -x, "x y": x * y,
        "x2": x**2, "x/y": x / (2 + y), "1/x": 1 / (2 + x), "min": casadi.fmin(x, y), "max": casadi.fmax(x, y),
        "x < y": x < y, "x <= y": x <= y, "not": casadi.logic_not(x < y), "and": casadi.logic_and(x < y, t < 4),
        "or": casadi.logic_or(x < y, t < 4), "if x": casadi.if_else(x < y, 3 * x, y - 2), "sin": casadi.sin(x),
        "cos": casadi.cos(x), "root": casadi.sqrt(2 + x), "tan": casadi.tan(x), "atan2": casadi.atan2(x, y),
        "atan": casadi.atan(x), "asin": casadi.asin(y), "acos": casadi.acos(y), "tanh": casadi.tanh(x),
        "exp": casadi.exp(x), "log": casadi.log(2 + x), "power": (2 + x) ** y, "constant power": (2 + x) ** 2.5,
        "size": casadi.fabs(x), "hypotenuse": casadi.hypot(x, y), "floor": casadi.floor(5 * x),
        "time and number": (x + t) - 250_000, "number and time": x * (1e-6 * t), "number over time": y / t,
    }  # fmt: skip


def test_every_operation_of_a_motion_gives_its_value_after_days_of_samples(tmp_path: Path) -> None:
    """Expected: CasADi in double precision, to 2e-6 of the value, or of 1; a float has no digit left of these."""
    t = casadi.SX.sym("time")
    expressions = _operations(t)
    function = casadi.Function("motion", [t], [casadi.vertcat(*expressions.values())], ["time"], ["motion"])
    head = (
        "#include <math.h>\n#define CONTROLLER_SINGLE 1\n#define MAYBE_UNUSED __attribute__((unused))\n"
        "#define REAL(name) name##f\n#define R(x) ((real)(x))\n#define IS_TRUE(x) ((x) > 0 || (x) < 0)\n"
        "typedef float real;\n"
    )
    caller = "\nvoid run(float high, float low, float *out)\n{\n    motion(moment_of(high, low), out);\n}\n"
    (tmp_path / "motion.c").write_text(head + RUNTIME["time.c"] + function_of_time(function) + caller)
    flags = ("-std=c99", "-O0", "-Wall", "-Werror", "-Wdouble-promotion", "-shared", "-fPIC")
    compiled([*COMPILER, *flags, "motion.c", "-o", "motion.so", "-lm"], tmp_path)
    code = ctypes.CDLL(str(tmp_path / "motion.so"))
    values = (ctypes.c_float * len(expressions))()
    for time in TIMES:
        high = float(np.float32(time))
        code.run(ctypes.c_float(high), ctypes.c_float(time - high), values)
        for name, one, expected in zip(expressions, values, np.asarray(function(time)).ravel(), strict=True):
            assert abs(one - expected) < 2e-6 * max(1.0, abs(expected)), (name, time)


def test_an_operation_without_a_rule_is_refused_with_a_remedy() -> None:
    t = casadi.SX.sym("time")
    function = casadi.Function("motion", [t], [casadi.sinh(t)], ["time"], ["motion"])
    with pytest.raises(
        gs.GoughStewartError, match=r"no single precision \(number \d+ of CasADi in motion\).*reference = 'inp"
    ):
        function_of_time(function)
