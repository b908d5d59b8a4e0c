"""What exported C promises beside its forces: start, bad inputs, parameters, manual operation, and what C it is."""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import casadi
import control
import numpy as np
import pytest

import gough_stewart as gs
from tests.support import exported
from tests.support.arrays import FloatArray
from tests.support.exported import HOLD, KP, PD, PID, SINE, Exported, compiled, source_of, uneven_experiment
from tests.support.uneven import PARAMETERS, UNEVEN

T = 0.0015
GOOD, OUT_OF_RANGE, FROZEN, NOT_FINITE, NOT_PREPARED = range(5)
TABLES: dict[str, dict[str, Any]] = {
    "PD": {"reference": exported.CIRCLE, "controller": {**PD, "feedforward": "gravity"}},
    "PID": {"reference": SINE, "controller": {**PID, "feedforward": "computed_torque"}},
    "PID in task space": {"reference": SINE, "controller": {**PID, "space": "task", "feedforward": "gravity"}},
    "PID at rest": {"reference": HOLD, "controller": {**PID, "feedforward": "gravity"}},
}
BAD: list[list[Any]] = [
    [np.nan, None, None, None, None, None],
    [None, None, -np.inf, None, None, None],
    [0.0] * 6,  # a dead bus
    [None, None, None, None, 1e300, None],
    [None, 3.9 + 0.17, None, None, None, None],  # just beyond the stroke
]
BEFORE, AFTER = np.array([[3, -2, 4, 1, -5, 2], [2, 7, -1, 8, 2, -8]]) * 1e-3


def code_of(controller: Any = None, feedforward: str = "none", motion: Any = HOLD, **options: Any) -> Exported:
    """The code of an experiment's PD, or of what replaces it, started."""
    experiment = uneven_experiment(reference=motion, controller={**PD, "feedforward": feedforward})
    return Exported(source_of(experiment, controller, **options)).start()


def at_hold() -> FloatArray:
    """The leg lengths in the pose of `HOLD`."""
    return gs.leg_geometry(UNEVEN, np.array(HOLD["position"]), np.array(HOLD["orientation"])).length


def function_of(name: str, size: int, force: Any, **memory: Any) -> casadi.Function:
    """A law of one signal, and perhaps of a memory."""
    signal, state = casadi.SX.sym(name, size), casadi.SX.sym("memory")
    outputs = [force(signal), *(following(signal, state) for following in memory.values())]
    names = [name, "memory"] if memory else [name], ["actuator_force", "memory_next"][: len(outputs)]
    return casadi.Function("law", [signal, state][: len(names[0])], outputs, *names)


# ---- the start ----


def test_a_controller_of_velocities_takes_zeros_as_measurements() -> None:
    """Expected: 200 N.s/m of the legs' velocities in the reference of a run."""
    damper = gs.LinearController(control.ss([], [], [], 200 * np.eye(6), T), signals=("leg_velocity",))
    experiment = uneven_experiment(reference={**SINE, "fade_in": 0}, controller={"type": "open_loop"})
    force, _ = Exported(source_of(experiment, damper)).steps(np.zeros((3, 6)))
    wanted = exported.samples_of(gs.run(experiment, controller=damper), "reference.leg_velocity")
    np.testing.assert_allclose(force, 200 * wanted[:3], rtol=1e-9)


def test_a_reference_of_zeros_is_one_where_the_platform_can_be_there() -> None:
    """Expected: with the base 2.85 m higher, a pose of zeros is near home: after a start it is followed, no fault."""
    points, home = np.array(UNEVEN.base_points) - [0, 0, 2.85], [0.08, -0.05, 0.05]
    lowered = {**PARAMETERS, "base_points": points.tolist(), "home_position": home}
    there: dict[str, Any] = {"reference": {"type": "hold"}, "start": {"position": home}}
    machine = {"preset": "liu2000", "parameters": lowered}
    experiment = uneven_experiment(platform=machine, controller={**PD, "feedforward": "none"}, **there)
    code, platform = Exported(source_of(experiment, reference="inputs")).start(), gs.Platform(**lowered)
    at_home = np.concatenate([home, UNEVEN.home_orientation, np.zeros(12)])
    lengths = [gs.leg_geometry(platform, pose[:3], pose[3:6]).length for pose in (at_home, np.zeros(18))]
    code.step(lengths[0], at_home)
    for _ in range(400):  # until the derivative rests
        force, _ = code.step(lengths[1] - AFTER, np.zeros(18))
    assert code.status[0] == GOOD
    np.testing.assert_allclose(force, np.array(KP) * AFTER, rtol=1e-6)


# ---- bad inputs ----


def test_a_bad_sample_gives_the_feedforward_and_leaves_the_law_as_it_was() -> None:
    """Expected: all six forces of the run's feedforward, and the states of before, by each kind of fault."""
    experiment = uneven_experiment(**TABLES["PID"])
    record, source = gs.run(experiment), source_of(experiment)
    measured, known = exported.measured_by(record), exported.samples_of(record, "controller.feedforward")[40]
    usual, _ = Exported(source).steps(measured[:42])
    for bad in BAD:
        code = Exported(source)
        code.steps(measured[:40])
        states = code.remembered("states")
        force, limited = code.step([good if x is None else x for good, x in zip(measured[40], bad, strict=True)])
        np.testing.assert_allclose(force, known, rtol=1e-9, atol=1e-9)
        assert not limited.any()
        assert np.array_equal(code.remembered("states"), states)
        assert code.status == (OUT_OF_RANGE, T)
        assert np.abs(code.step(measured[41])[0] - usual[41]).max() < 4 * np.abs(np.diff(usual, axis=0)).max()
        assert code.status == (GOOD, 0.0)
        assert np.isfinite(code.memory).all()


def test_after_a_gap_the_law_begins_at_rest_with_its_integrals() -> None:
    """Expected, by hand: F = kp e + x + ki T e/2 + known; no derivative of the jump of e over the gap."""
    code = Exported(source_of(uneven_experiment(**TABLES["PID at rest"]))).start()
    for _ in range(50):
        code.step(at_hold() + BEFORE)
    for k in range(20):
        code.step(np.full(6, np.nan))
        assert code.status[1] == pytest.approx((k + 1) * T)
    force, _ = code.step(at_hold() - AFTER)
    integral = np.array(PID["integral_gain"]) * T * (AFTER / 2 - 50 * BEFORE)  # Tustin: half a step at either end
    known = gs.static_leg_forces(UNEVEN, np.array(HOLD["position"]), np.array(HOLD["orientation"]))
    np.testing.assert_allclose(force, np.array(KP) * AFTER + integral + known, rtol=1e-9)


def test_a_force_or_a_memory_that_is_no_number_is_told_from_a_bad_input() -> None:
    """Expected: √z of a law at z = −0.1 m, within the range: the feedforward; an infinite memory is not kept."""
    code = code_of(function_of("position", 3, lambda p: casadi.repmat(casadi.sqrt(p[2]), 6)), "gravity")
    x, y, z = HOLD["position"]
    normal, _ = code.step([x, y, z])
    force, _ = code.step([x, y, -0.1])
    assert code.status[0] == NOT_FINITE
    np.testing.assert_allclose(force, normal - np.sqrt(z), rtol=1e-12)
    assert np.array_equal(code.step([x, y, z])[0], normal)
    code = code_of(function_of("leg_length", 6, lambda v: v, memory=lambda v, state: state + 1 / (v[0] - 3)))
    for first, status in ((3.5, GOOD), (3.0, NOT_FINITE)):
        code.step([first, 3, 3, 3, 3, 3])
        assert (code.status[0], *code.remembered("states")) == (status, 2)


def test_a_measurement_that_stands_still_while_its_reference_moves_is_frozen() -> None:
    """Expected: bad from the sample at which both bounds are passed, until it moves; by the reference of a run."""
    samples, movement = 20, 0.004
    law = gs.LinearController(control.ss([], [], [], 100 * np.ones((6, 3)), T), ("position",))
    motion = {**SINE, "frequency": 6.0}
    code = code_of(law, "gravity", motion, frozen=(samples, movement))
    run = gs.run(uneven_experiment(reference=motion, controller=PD, loop={"duration": 0.48, "sample_time": T}))
    wanted = exported.samples_of(run, "reference.position")
    stuck = wanted[59, 1]
    moved = np.maximum.accumulate(np.abs(wanted[59:, 1] - stuck))
    first = 59 + int(((np.arange(len(moved)) >= samples) & (moved > movement)).argmax())
    assert first > 59
    for k in range(first + 110):
        row = wanted[k].copy()
        row[1] = stuck if k > 59 else row[1]
        code.step(row)
        assert code.status[0] == (FROZEN if k >= first else GOOD), k
    # the reference has come back, which thaws nothing
    assert np.abs(wanted[first : first + 110, 1] - stuck).min() < movement / 2
    assert code.status[1] == pytest.approx(110 * T)
    code.step(wanted[first + 110])
    assert code.status[0] == GOOD


def test_poses_within_a_leg_of_home_are_in_range_without_a_stroke() -> None:
    """Expected: all of them, in every orientation but upside down; eight times as far, none."""
    platform, rng = gs.load_preset("liu2000"), np.random.default_rng(8)
    home = np.array(platform.home_position)
    leg = gs.leg_geometry(platform, home, np.array(platform.home_orientation)).length.mean()
    law = gs.LinearController(control.ss([], [], [], np.ones((6, 6)), 1e-3), ("position", "orientation"))
    experiment = gs.load_experiment("circle", {"platform": {"preset": "liu2000"}, "reference": {"type": "hold"}})
    code = Exported(source_of(experiment, law)).start()
    for direction in rng.normal(size=(40, 3)):
        angles, unit = rng.uniform(-1, 1, 3) * [3.1, 1.5, 3.1], direction / np.linalg.norm(direction)
        for far, status in ((rng.uniform(0, 1), GOOD), (8.0, OUT_OF_RANGE)):
            code.step([*(home + far * leg * unit), *angles])
            assert code.status[0] == status


# ---- parameters ----


@pytest.mark.parametrize("with_drives", [False, True], ids=["at samples", "at steps of drives"])
def test_coefficients_count_once_they_are_prepared_and_a_refused_parameter_leaves_them(with_drives: bool) -> None:
    """Expected: before, no force, a status of its own, and nothing else in the memory; each byte after a refusal."""
    actuators = {"force_limit": 900.0, "lag": 2e-3} if with_drives else {}
    experiment = uneven_experiment(**TABLES["PID at rest"], actuators=actuators)
    source = source_of(experiment, parts="drives" if with_drives else ())
    code, fresh = Exported(source).start(), Exported(source).start()
    prepared, before = code.coefficients.copy(), code.memory.copy()
    code.coefficients[:] = 0
    force, limited = code.step(at_hold() + 0.01)
    assert not force.any()
    assert not limited.any()
    assert code.status[0] == NOT_PREPARED
    assert np.array_equal(fresh.memory, before)
    code.coefficients[:] = prepared
    for k, (name, value) in enumerate((("platform_mass", np.nan), ("proportional_gain", -1.0), ("delay", 0.5))):
        good, of_now = code.parameters[name].copy(), code.coefficients.tobytes()
        code.parameters[name] = value
        assert code.prepare() == 1 + code.names.index(name)
        assert code.coefficients.tobytes() == of_now
        code.parameters[name] = good
        force, _ = code.step(at_hold() + 1e-3 * k)
        assert np.abs(force).min() > 0.1
        assert np.array_equal(force, fresh.step(at_hold() + 1e-3 * k)[0])
        assert code.status == (GOOD, 0)


# Of each parameter what is refused, and what is accepted at a bound.
BOUNDS: dict[str, tuple[list[Any], list[Any]]] = {
    "sample_time": ([0.0, np.nan, np.inf, -5.0, 1e-9], [1e-6, 1e3]),
    "delay": ([-1.0, 0.5, 1001.0, 1e9, np.nan], [0.0, 1000.0]),
    "force_limit": ([np.nan, -5.0, 1e-300, 9e-4], [0.0, 1e-3, np.inf]),
    "force_rate_limit": ([-1.0, np.nan, 1e-300], [0.0, 1e-3, np.inf]),
    "start_force": ([[0, 0, 0, 0, 0, x] for x in (np.inf, np.nan, 1e12, -1e12)], [[0, 0, 0, 0, 0, -1e9], [1e9] * 6]),
    "proportional_gain": ([[1, 1, 1, 0, 1, 1]], []),
    "derivative_gain": ([[1, 1, -1, 1, 1, 1]], []),
    "derivative_filter": ([0.0, 7e-4], [1e3]),
    "integral_gain": ([[1, 1, 1, 1, 1, 1]], []),
    "anti_windup_time": ([[1, 1, 1e-3, 1, 1, 1]], []),
    "platform_mass": ([0.0, 1e31, np.inf], [1e30]),
    "leg_coulomb_friction": ([-1.0], []),
    "gravity": ([[0, np.nan, 0]], [[0, -1e30, 0]]),
}


def test_a_parameter_that_cannot_be_is_refused_by_its_number_and_one_at_its_bound_is_accepted() -> None:
    """Expected: the bounds of docs/export.md; of the accepted ones a PD with a slow filter, beside which any may be."""
    code, pd = (Exported(source_of(uneven_experiment(**TABLES[case]))).start() for case in ("PID at rest", "PD"))
    pd.parameters["derivative_filter"] = 1e3
    for name, (refused, accepted) in BOUNDS.items():
        for one, values, status in ((code, refused, 1 + code.names.index(name)), (pd, accepted, 0)):
            for value in values:
                good = one.parameters[name].copy()
                one.parameters[name] = value
                assert one.prepare() == status, (name, value)
                one.parameters[name] = good
    # a sample time can be too long for the filter or the anti-windup
    code.parameters["sample_time"] = 0.1
    assert code.names[code.prepare() - 1] in ("derivative_filter", "anti_windup_time")


# ---- what cannot leave ----

POINTS, VALUES = np.array([-0.05, -0.02, 0.0, 0.03, 0.06]), np.array([-90.0, -20.0, 0.0, 24.0, 77.0])


def _function(inputs: dict[str, int], outputs: dict[str, int]) -> casadi.Function:
    symbols = [casadi.MX.sym(name, size) for name, size in inputs.items()]
    results = [casadi.MX.zeros(size) + symbols[0][0] for size in outputs.values()]
    return casadi.Function("f", symbols, results, list(inputs), list(outputs))


def _interpolant() -> casadi.Function:
    """Of two signals, beside a third."""
    names = ["time", "leg_length", "reference_leg_length"]
    inputs = [casadi.MX.sym(name, size) for name, size in zip(names, (1, 6, 6), strict=True)]
    table = casadi.interpolant("gain", "bspline", [POINTS], VALUES)
    force = casadi.vertcat(*(table(inputs[2][k] - inputs[1][k]) for k in range(6))) + inputs[0]
    return casadi.Function("law", inputs, [force], names, ["actuator_force"])


REFUSED: dict[str, tuple[Any, dict[str, Any]]] = {
    r"controller itself is unstable: it has an eigenvalue z = -1.01\+0j with \|z\| = 1.01; expected none outside": (
        lambda: control.ss(np.diag([0.5, -1.01]), np.ones((2, 6)), np.ones((6, 2)), np.zeros((6, 6)), T), {}),
    "has the input 'leg_lenght'; expected one of time, pos": (
        lambda: _function({"leg_lenght": 6}, {"actuator_force": 6}), {}),
    "input 'leg_length' has 5 elements; expected 6": (lambda: _function({"leg_length": 5}, {"actuator_force": 6}), {}),
    "has the outputs {'force': 6}; expected {'actuator_force': 6}": (
        lambda: _function({"leg_length": 6}, {"force": 6}), {}),
    "expected {'actuator_force': 6, 'memory_next': 2}": (lambda: _function({"memory": 2}, {"actuator_force": 6}), {}),
    "memory_next needs an input memory": (
        lambda: _function({"time": 1}, {"actuator_force": 6, "memory_next": 2}), {}),
    r"looks leg_length and reference_leg_length up in 'gain'.*casadi\.pw_lin\(x": (_interpolant, {}),
    "has erfinv of leg_length, which C lacks": (
        lambda: function_of("leg_length", 6, lambda length: casadi.erfinv(length - 3)), {}),
    "the loop's 0.0015 s": (lambda: control.ss([], [], [], np.eye(6), 0.001), {}),
    r"leg_length or position.*the controller measures leg_velocity": (
        lambda: gs.LinearController(control.ss([], [], [], np.eye(6), T), signals=("leg_velocity",)),
        {"frozen": (5, 0.1)}),
    "safe_force is 'brake'; expected 'feedforward' or 'zero'": (lambda: None, {"safe_force": "brake"}),
    "frozen is 5; expected a number of samples and a movement": (lambda: None, {"frozen": 5}),
    r"frozen is \(0, 1.0\); expected a number of samples": (lambda: None, {"frozen": (0, 1.0)}),
    r"frozen is \(5, 0.0\).*such as": (lambda: None, {"frozen": (5, 0.0)}),
    r"frozen is \(5, inf\)": (lambda: None, {"frozen": (5, np.inf)}),
    "reference is 'outside'; expected 'inside' or 'inputs'": (lambda: None, {"reference": "outside"}),
    r"no part 'drive'; did you mean 'drives'\?": (lambda: None, {"parts": "drive"}),
    "parts is 3; expected one or more of drives, sensors, manual": (lambda: None, {"parts": 3}),
    "drives run at the plant_step of 1e-06 s, 1500 times in a sample of 0.0015 s; expected at most 1000 times": (
        lambda: None, {"parts": "drives", "settings": {"loop.plant_step": 1e-6, "loop.duration": 0.006}}),
    "its forces are constant; expected a controller with feedback": (
        lambda: None, {"settings": {"controller": {"type": "open_loop", "force": [1, 2, 3, 4, 5, 6]}}}),
}  # fmt: skip


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_leave_is_refused(message: str, tmp_path: Path) -> None:
    """Expected: what was found, and what would work; no file."""
    make, options = REFUSED[message]
    experiment = uneven_experiment(reference=HOLD, controller={**PD, "feedforward": "gravity"})
    with pytest.raises(gs.GoughStewartError, match=message):
        source_of(experiment, make(), tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_a_motion_by_hand_is_refused(tmp_path: Path) -> None:
    """Expected: what would work; its equations, traced as they stand, know of no hand."""
    (tmp_path / "targets.csv").write_text("time,x,y,z,roll,pitch,yaw,jumps\n0.03,0.1,0,2.9,0,0,0,0\n")
    by_hand = {"type": "by_hand", "sample_time": T, "motion": HOLD, "file": str(tmp_path / "targets.csv")}
    experiment = uneven_experiment(reference=by_hand, controller={**PD, "feedforward": "gravity"})
    with pytest.raises(gs.GoughStewartError, match="motion by hand, which is no formula and no table; expected refer"):
        source_of(experiment)
    assert "N_REFERENCE = 18" in source_of(experiment, reference="inputs").with_suffix(".h").read_text()


def test_a_piecewise_linear_gain_gives_the_forces_of_the_interpolant() -> None:
    """Expected: linear interpolation by NumPy, and the end pieces beyond the ends, as a casadi.interpolant has it."""
    length, wanted = casadi.SX.sym("length", 6), casadi.SX.sym("wanted", 6)
    force, limit = (casadi.pw_lin(wanted[k] - length[k], POINTS, VALUES) for k in range(6)), casadi.SX.sym("limit")
    names = ["leg_length", "reference_leg_length", "force_limit"]
    limited = casadi.fmin(casadi.vertcat(*force), limit)
    law = casadi.Function("law", [length, wanted, limit], [limited], names, ["actuator_force"])
    error = np.array([0.011, -0.034, 0.05, 0.0, 0.0871, -0.02])
    code = code_of(law)
    code.parameters["force_limit"] = 0.0  # none
    found, _ = code.start().step(at_hold() - error)
    slope = (VALUES[-1] - VALUES[-2]) / (POINTS[-1] - POINTS[-2])
    expected = np.interp(error, POINTS, VALUES) + slope * np.maximum(error - POINTS[-1], 0)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


# ---- switched off and on ----

MANUAL = np.array([31.0, -42.0, 17.0, 55.0, -23.0, 38.0])


def switched(experiment: gs.Experiment, real: str = "double") -> Exported:
    """A started controller that can be switched."""
    return Exported(source_of(experiment, parts="manual"), real).start()


def off(code: Exported, force: FloatArray = MANUAL) -> Exported:
    """Switch it off."""
    code.set("enabled", 0)
    code.set("manual_force", force)
    return code


@pytest.mark.parametrize(("kind", "space"), [("pd", "leg"), ("pid", "leg"), ("pid", "task")])
def test_a_controller_follows_while_it_is_off_and_begins_there(kind: str, space: str) -> None:
    """Expected: the run that is switched at the same samples, which `loop/test_faults.py` has by hand."""
    changes = [{"at": 0.03, "enabled": False, "manual_force": MANUAL.tolist()}, {"at": 0.09, "enabled": True}]
    controller = {**(PD if kind == "pd" else PID), "space": space, "feedforward": "gravity"}
    experiment = uneven_experiment(
        reference=SINE, controller=controller, actuators={"force_limit": 53.0}, change=changes
    )
    record = gs.run(experiment)
    for real in exported.REALS:
        code, forces = switched(experiment, real), []
        for k, lengths in enumerate(exported.measured_by(record)):
            off(code).set("enabled", not 20 <= k < 60)
            forces.append(code.step(lengths)[0])
        assert exported.largest_difference(np.array(forces), exported.commanded(record)) < exported.TOLERANCE[real]
    assert np.abs(forces[30]).tolist() == pytest.approx(np.minimum(np.abs(MANUAL), 53))


def test_bad_inputs_while_it_is_off_change_nothing_and_a_bad_manual_force_is_none() -> None:
    """Expected: the manual force whatever is measured, with its status; NaN as such leaves it on."""
    controller = {**PID, "feedforward": "gravity"}
    code = off(switched(uneven_experiment(reference=HOLD, controller=controller, actuators={"force_limit": 60.0})))
    code.step(at_hold())
    for row, status in ((np.full(6, np.nan), OUT_OF_RANGE), (at_hold(), GOOD)):
        force, _ = code.step(row)
        np.testing.assert_allclose(force, MANUAL)
        assert code.status[0] == status
    force, _ = off(code, np.full(6, np.nan)).step(at_hold())
    np.testing.assert_allclose(force, MANUAL)
    known = gs.static_leg_forces(UNEVEN, np.array(HOLD["position"]), np.array(HOLD["orientation"]))
    np.testing.assert_allclose(code.step(np.full(6, np.nan))[0], np.minimum(known, 60), rtol=1e-9)


# ---- compilers ----

STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wdouble-promotion")
LANGUAGES = (("-std=c99",), ("-std=c11",), ("-std=c17",), ("-x", "c++", "-std=c++11"))
COMPILERS: dict[str, tuple[str, ...]] = {
    "gcc": ("gcc",),
    "clang": ("clang",),
    "Cortex-M4F": ("arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
    "Cortex-M7": ("arm-none-eabi-gcc", "-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16"),
}
# Together they have every part of the template: a law in leg and in task space, integrals and limits, a table, both
# kinds of feedforward, a reference that comes in, and measurements that are watched. The last one is quick to make.
SHIPPED = ("recorded_ride", "pitch_sine", "saturation", "circle from inputs")


def shipped(name: str) -> Path:
    """The C of a shipped experiment."""
    experiment, _, inputs = name.partition(" from ")
    options: dict[str, Any] = {"frozen": (50, 1e-3)} if inputs or experiment == "saturation" else {}
    settings = {"loop.duration": 0.1, "limits.reference": "warn"}
    return source_of(experiment, settings=settings, reference="inputs" if inputs else "inside", **options)


def available(compiler: str) -> tuple[str, ...]:
    """Its command."""
    if shutil.which(COMPILERS[compiler][0]) is None:
        pytest.skip(f"{compiler} is not installed")
    return COMPILERS[compiler]


@pytest.mark.parametrize("compiler", COMPILERS)
def test_sources_compile_without_a_warning(compiler: str) -> None:
    """Expected: none, in the standards of C and in C++, with both types of numbers."""
    command = available(compiler)
    for name in SHIPPED if compiler == "gcc" else SHIPPED[-1:]:
        source = shipped(name)
        for k, language in enumerate(LANGUAGES if name in SHIPPED[-2:] else LANGUAGES[:1]):
            real = f"-D{source.stem.upper()}_REAL={('float', 'double')[k % 2]}"
            compiled([*command, *STRICT, *language, real, "-fsyntax-only", source.name], source.parent)


def test_a_cortex_m4f_computes_without_software_arithmetic() -> None:
    """Expected: no call of the compiler's runtime, whose functions for double are named __aeabi_d…."""
    command, names = available("Cortex-M4F"), ("sin", "cos", "tanh", "floor", "fma", "fmin", "fmax", "fmod", "sqrt")
    for source in map(shipped, SHIPPED):
        real = f"-D{source.stem.upper()}_REAL=float"
        compiled([*command, "-std=c99", real, "-O0", "-c", source.name, "-o", "float.o"], source.parent)
        undefined = ["arm-none-eabi-nm", "--undefined-only", "float.o"]
        text = subprocess.run(undefined, cwd=source.parent, capture_output=True, text=True, check=True).stdout
        called = {line.split()[-1] for line in text.splitlines()} - {"memset", "memcpy"}
        assert called <= {f"{name}f" for name in (*names, "remainder", "atan2", "hypot")}


def test_a_program_in_c_plus_plus_calls_a_controller_in_c() -> None:
    """Expected: it links with the object that a C compiler made, and prints the forces of the example in C."""
    available("gcc")
    source = shipped("saturation")
    folder = source.parent
    compiled(["gcc", *STRICT, "-c", source.name, "-o", "law.o"], folder)
    compiled(["gcc", "example_main.c", "law.o", "-lm", "-o", "in_c"], folder)
    strict = [flag for flag in STRICT if flag != "-Wconversion"]
    compiled(["g++", *strict, *LANGUAGES[-1], "example_main.c", "-x", "none", "law.o", "-lm", "-o", "in_cpp"], folder)
    printed = [
        subprocess.run([str(folder / program)], capture_output=True, text=True, check=True).stdout
        for program in ("in_c", "in_cpp")
    ]
    assert printed[0] == printed[1]
    assert printed[0].count(" N") == 30
    first = [float(value) for value in re.findall(r"(\S+) N", printed[0].splitlines()[0])]
    record = gs.run("saturation", {"loop.duration": 0.1})
    code = Exported(source).start()
    np.testing.assert_allclose(first, code.step(record["reference.leg_length"][0])[0], rtol=1e-5)


def test_two_controllers_of_different_precision_link_into_one_program(tmp_path: Path) -> None:
    """Expected: no name that both have; each prepares with its own parameters, one in float and one in double."""
    available("gcc")
    sources = [shipped(name) for name in SHIPPED[-2:]]
    names = [source.stem for source in sources]
    lines = [f'#include "{name}.h"' for name in names] + ["int main(void)", "{", "    int wrong = 0;"]
    for name in names:
        lines.append(f"    {name}_coefficients {name} = {{0}};")
        lines.append(f"    wrong += {name}_prepare(&{name.upper()}_DEFAULTS, &{name});")
    sizes = " ".join(f"!(sizeof({name}_real) == {size}) ||" for name, size in zip(names, (4, 8), strict=True))
    (tmp_path / "main.c").write_text("\n".join([*lines, f"    return {sizes} wrong != 0;", "}", ""]))
    flags = [f"-D{names[0].upper()}_REAL=float", *(f"-I{source.parent}" for source in sources)]
    compiled(["gcc", "-std=c99", *flags, "-Wall", "-Werror", "main.c", *map(str, sources), "-lm"], tmp_path)
    assert subprocess.run([str(tmp_path / "a.out")], check=False).returncode == 0


def test_the_sources_allocate_nothing_and_keep_no_state_of_their_own() -> None:
    text = source_of(uneven_experiment(**TABLES["PID in task space"])).read_text()
    assert not re.search(r"\b(malloc|calloc|free|printf|extern)\b", text)
    assert not re.search(r"^(MAYBE_UNUSED )?\s*static (?!const |void |int |real |moment )", text, re.M)
