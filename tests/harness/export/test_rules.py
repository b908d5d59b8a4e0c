"""What an exported controller promises beside its forces: its start, bad values, what it refuses, what C it is."""

import re
from functools import cache
from typing import Any

import casadi
import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough_stewart import (
    Chirp,
    Circle,
    GoughStewartError,
    Hold,
    LinearController,
    PointToPoint,
    Sine,
    Step,
    leg_geometry,
)
from gough_stewart.harness.export.design import Designed, designed
from gough_stewart.harness.export.trace import motion_function
from gough_stewart.harness.export.write import RUNTIME, controller_sources
from gough_stewart.harness.motion.motion import Motion
from tests.harness.export.test_controllers import CASES, CIRCLE, HOLD, PD, PID, SINE
from tests.support.exported import (
    KP,
    Exported,
    uneven_experiment,
)
from tests.support.uneven import UNEVEN

GRAVITY: dict[str, Any] = {"reference": CIRCLE, "controller": {**PD, "feedforward": "gravity"}}
PID_AT_REST: dict[str, Any] = {"reference": HOLD, "controller": {**PID, "feedforward": "gravity"}}


@cache
def designed_once(of: str) -> Designed:
    """The controller of a table; its parameters are set in a copy of their own."""
    return designed(uneven_experiment(**{"pd": GRAVITY, "pid": PID_AT_REST}[of]))


VECTORS = st.tuples(*[st.floats(-0.3, 0.3)] * 3)
POSE = {"position": VECTORS, "orientation": VECTORS}
CHANGE = {"position_change": VECTORS, "orientation_change": VECTORS}
SWING = {"position_amplitude": VECTORS, "orientation_amplitude": VECTORS, "fade_in": st.sampled_from([0.0, 0.7])}
RATES = st.floats(0.1, 5.0)
MOTIONS = st.one_of(
    st.builds(Hold, **POSE),
    st.builds(Step, **POSE, **CHANGE, at=st.floats(0.1, 1.0)),
    st.builds(PointToPoint, **POSE, **CHANGE, at=st.floats(0.0, 0.5), duration=st.floats(0.2, 1.0)),
    st.builds(Sine, **POSE, **SWING, frequency=RATES, phase=st.floats(-3, 3)),
    st.builds(Chirp, **POSE, **SWING, from_frequency=RATES, to_frequency=RATES, duration=st.floats(0.2, 1.5)),
    st.builds(
        Circle,
        **POSE,
        radius=st.floats(0.01, 0.3),
        frequency=RATES,
        plane=st.sampled_from(["xy", "xz", "yz"]),
        fade_in=st.sampled_from([0.0, 0.7]),
    ),
)


@given(MOTIONS, st.lists(st.floats(0.0, 2.0), min_size=1, max_size=5))
@settings(max_examples=60)
def test_a_traced_motion_is_the_motion(reference: Any, times: list[float]) -> None:
    """Expected: the same class called with numbers; also at the times at which something begins and ends."""
    edges = [getattr(reference, name, 0.0) for name in ("at", "duration", "fade_in")]
    times = [*times, *edges, edges[0] + edges[1]]
    function = motion_function(reference)
    traced = [function(time) if function.n_in() else function()["motion"] for time in times]
    expected = np.concatenate(reference(np.array(times)), axis=1)
    np.testing.assert_allclose(np.array(traced).reshape(expected.shape), expected, rtol=1e-12, atol=1e-11)


def test_zeros_at_first_give_the_start_forces_and_count_as_samples() -> None:
    """Expected: `start_force`; then, with the memory fresh, F = kp e + ki T e/2 of the fourth sample's reference.

    The derivative starts at rest, and the integral at zero, half a step by Tustin's rule.
    """
    made = designed(uneven_experiment(reference=CIRCLE, controller={**PID, "derivative_on": "measurement"}))
    exported, measured = Exported(made).start(), made.first_measured + 1e-3 * np.arange(1, 7)
    for _ in range(3):
        force, limited = exported.step(np.zeros(6))
        assert np.array_equal(force, made.start_force)
        assert not limited.any()
    assert made.reference is not None
    at = made.reference(np.array([3 * made.sample_time]))
    error = leg_geometry(UNEVEN, at.position[0], at.orientation[0]).length - measured
    force, _ = exported.step(measured)
    gain = np.array(KP) + np.array(PID["integral_gain"]) * made.sample_time / 2
    np.testing.assert_allclose(force, gain * error, rtol=1e-9)
    assert exported.status == 0
    # zeros later on are a fault
    exported.step(np.zeros(6))
    assert exported.status == 1


def test_a_controller_of_velocities_takes_zeros_as_measurements() -> None:
    """Expected: 200 N.s/m of the legs' velocities, by differences of the reference's leg lengths."""
    damper = LinearController(control.ss([], [], [], 200 * np.eye(6), 0.0015), signals=("leg_velocity",))
    tables = {"reference": {**SINE, "fade_in": 0}, "controller": {"type": "open_loop"}}
    made = designed(uneven_experiment(**tables), damper)
    assert made.reference is not None
    around_sample_2 = made.reference(0.003 + np.array([-1e-5, 1e-5]))
    lengths = leg_geometry(UNEVEN, around_sample_2.position, around_sample_2.orientation).length
    force = Exported(made).forces(np.zeros((3, 6)))[2]
    # the differences' error is of h² and the third derivative, below 1e-6 m/s
    np.testing.assert_allclose(force, 200 * (lengths[1] - lengths[0]) / 2e-5, rtol=0, atol=2e-4)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[("sample_time", value) for value in (0.0, np.nan, np.inf, -5.0, 1e-9, 0.1)],
        *[("delay", value) for value in (-1.0, 0.5, 1001.0, 1e9, np.nan)],
        *[("force_limit", value) for value in (np.nan, -5.0, 1e-300, 9e-4)],
        *[("force_rate_limit", value) for value in (-1.0, np.nan, 1e-300)],
        *[("start_force", [0, 0, 0, 0, 0, value]) for value in (np.inf, np.nan, 1e12, -1e12)],
        *[("proportional_gain", [1, 1, 1, 0, 1, 1]), ("platform_mass", 1e31), ("platform_mass", np.inf)],
        *[("derivative_gain", [1, 1, -1, 1, 1, 1]), ("derivative_filter", 0.0), ("derivative_filter", 7e-4)],
        *[("integral_gain", [1, 1, 1, 1, 1, 1]), ("anti_windup_time", [1, 1, 1e-3, 1, 1, 1])],
        *[("platform_mass", 0.0), ("leg_coulomb_friction", -1.0), ("gravity", [0, np.nan, 0])],
    ],
)
def test_a_parameter_that_cannot_be_is_refused_by_its_number(name: str, value: Any) -> None:
    exported = Exported(designed_once("pid"))
    assert exported.prepare() == 0
    exported.parameters[name] = value
    names = [s.variable.name for s in exported.designed.settings]
    # a sample time can be too long for the anti-windup or the filter, too
    assert exported.prepare() in ({names.index(name) + 1} if value != 0.1 else {8, 10})


def test_matrices_are_refused_at_another_sample_time() -> None:
    system = control.ss(np.eye(1) * 0.5, np.ones((1, 6)), np.ones((6, 1)), np.zeros((6, 6)), 0.0015)
    exported = Exported(designed(uneven_experiment(**GRAVITY), system))
    assert exported.prepare() == 0
    exported.parameters["sample_time"] = 0.002
    assert exported.prepare() == 1


POINTS = np.array([-0.05, -0.02, 0.0, 0.03, 0.06])
VALUES = np.array([-90.0, -20.0, 0.0, 24.0, 77.0])


def _function(inputs: dict[str, int], outputs: dict[str, int]) -> casadi.Function:
    symbols = [casadi.MX.sym(name, size) for name, size in inputs.items()]
    results = [casadi.MX.zeros(size) + symbols[0][0] for size in outputs.values()]
    return casadi.Function("f", symbols, results, list(inputs), list(outputs))


def _interpolant(kind: str) -> casadi.Function:
    """Of two signals, beside a third."""
    names = ["time", "leg_length", "reference_leg_length"]
    inputs = [casadi.MX.sym(name, size) for name, size in zip(names, (1, 6, 6), strict=True)]
    table = casadi.interpolant("gain", kind, [POINTS], VALUES)
    force = casadi.vertcat(*(table(inputs[2][k] - inputs[1][k]) for k in range(6))) + inputs[0]
    return casadi.Function("law", inputs, [force], names, ["actuator_force"])


def _erfinv() -> casadi.Function:
    length = casadi.SX.sym("length", 6)
    return casadi.Function("law", [length], [casadi.erfinv(length - 3)], ["leg_length"], ["actuator_force"])


ONE = np.ones((1, 6)), np.ones((6, 1)), np.zeros((6, 6))
REFUSED: list[tuple[Any, str]] = [
    (
        control.ss(np.diag([0.5, -1.01]), np.ones((2, 6)), np.ones((6, 2)), np.zeros((6, 6)), 0.0015),
        r"controller itself is unstable: it has an eigenvalue z = -1.01\+0j with \|z\| = 1.01; expected none outside",
    ),
    (_function({"leg_lenght": 6}, {"actuator_force": 6}), "has the input 'leg_lenght'; expected one of time, pos"),
    (_function({"leg_length": 5}, {"actuator_force": 6}), "input 'leg_length' has 5 elements; expected 6"),
    (_function({"leg_length": 6}, {"force": 6}), "has the outputs {'force': 6}; expected {'actuator_force': 6}"),
    (_function({"memory": 2}, {"actuator_force": 6}), "expected {'actuator_force': 6, 'memory_next': 2}"),
    (_function({"time": 1}, {"actuator_force": 6, "memory_next": 2}), "memory_next needs an input memory"),
    *(
        (_interpolant(kind), r"looks leg_length and reference_leg_length up in 'gain'.*casadi\.pw_lin\(x")
        for kind in ("linear", "bspline")
    ),
    (_erfinv(), "has erfinv of leg_length, which C lacks"),
    (control.ss([[0.5]], *ONE), "continuous time; expected discrete"),
    (control.ss([[0.5]], np.ones((1, 5)), ONE[1], np.zeros((6, 5)), 0.0015), "has 5 inputs and 6 outputs"),
    (control.ss([[0.5]], *ONE, 0.001), "the loop's 0.0015 s"),
    (control.ss([], [], [], np.diag([1, 2, np.nan, 3, 4, 5]), 0.0015), "D has elements that are not finite"),
]


@pytest.mark.parametrize(("controller", "message"), REFUSED)
def test_a_controller_that_cannot_leave_is_refused(controller: Any, message: str) -> None:
    with pytest.raises(GoughStewartError, match=message):
        designed(uneven_experiment(**GRAVITY), controller)


def test_a_piecewise_linear_gain_gives_the_forces_of_the_interpolant() -> None:
    """Expected: linear interpolation by NumPy, and the end pieces beyond the ends, as a casadi.interpolant has it."""
    length, wanted = casadi.SX.sym("length", 6), casadi.SX.sym("wanted", 6)
    force = casadi.vertcat(*(casadi.pw_lin(wanted[k] - length[k], POINTS, VALUES) for k in range(6)))
    law = casadi.Function("law", [length, wanted], [force], ["leg_length", "reference_leg_length"], ["actuator_force"])
    made = designed(uneven_experiment(reference=HOLD, controller={**PD, "feedforward": "none"}), law)
    error = np.array([0.011, -0.034, 0.05, 0.0, 0.0871, -0.02])
    found, _ = Exported(made).start().step(made.first_measured - error)
    slope = (VALUES[-1] - VALUES[-2]) / (POINTS[-1] - POINTS[-2])
    expected = np.interp(error, POINTS, VALUES) + slope * np.maximum(error - POINTS[-1], 0)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_a_motion_that_branches_is_refused() -> None:
    """Expected: symbols have no truth value."""

    def motion(time: Any) -> Motion:
        return Hold(position=(0, 0, 3), orientation=(0, 0, 0))(time if time[0] > 0 else -time)

    with pytest.raises(GoughStewartError, match=r"reference cannot be traced with CasADi .* without branches, or"):
        motion_function(motion)


def test_nothing_to_compute_is_refused() -> None:
    experiment = uneven_experiment(reference=HOLD, controller={"type": "open_loop", "force": [1, 2, 3, 4, 5, 6]})
    with pytest.raises(GoughStewartError, match="its forces are constant; expected a controller with feedback"):
        designed(experiment)


@pytest.mark.parametrize("prefix", ["", "2nd", "Controller", "a-b", "a b", "x" * 42])
def test_a_prefix_that_c_cannot_have_is_refused(prefix: str) -> None:
    with pytest.raises(GoughStewartError, match="expected a lower-case letter, then"):
        controller_sources(designed(uneven_experiment(**GRAVITY)), prefix)


def test_a_title_cannot_end_the_comment_that_it_is_in() -> None:
    experiment = uneven_experiment(**GRAVITY, title="nice */ int x; /* title")
    header = controller_sources(designed(experiment)).headers["controller.h"]
    assert "int x" in header[: header.index("*/")]


def test_the_sources_keep_the_rules_of_plain_c() -> None:
    """Expected: no allocation, no memory of its own, no goto; loops of fixed length, the same text twice."""
    made = designed(uneven_experiment(**CASES["PID in task space at its rate limit"]))
    sources = controller_sources(made)
    text = sources.units["controller.c"]
    assert not re.search(r"\b(malloc|calloc|free|goto|printf|extern)\b", text)
    assert not re.search(r"^(MAYBE_UNUSED )?\s*static (?!const |void |int |real |moment )", text, re.M)
    assert set(re.findall(r"for \(k = 0; k < (\w+);", text)) <= {"3", "6", "9", "18", "n", "N_STATES", "N_WATCHED"}
    assert f"at most {sources.operations} floating-point operations" in sources.headers["controller.h"]
    again = controller_sources(designed(uneven_experiment(**CASES["PID in task space at its rate limit"])))
    assert again == sources


def test_the_runtime_stands_in_a_controller_as_it_is() -> None:
    """Expected: its files verbatim, so that what a reader sees there is what was compiled in all other tests."""
    text = controller_sources(designed_once("pid")).units["controller.c"]
    parts = [RUNTIME["time.c"], RUNTIME["motion.c"]]
    parts += re.split(r'#include "(?:design|time|law|motion)\.c"\n', RUNTIME["controller.c"])
    assert len(parts) >= 6
    assert all(part in text for part in parts)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[("sample_time", value) for value in (1e-6, 1e3)],
        *[("delay", value) for value in (0.0, 1000.0)],
        *[(name, value) for name in ("force_limit", "force_rate_limit") for value in (0.0, 1e-3, np.inf)],
        *[("start_force", [0, 0, 0, 0, 0, value]) for value in (1e9, -1e9)],
        *[("platform_mass", 1e30), ("gravity", [0, -1e30, 0])],
    ],
)
def test_a_parameter_at_its_bound_is_accepted(name: str, value: Any) -> None:
    """Expected: the bounds of docs/export.md belong to what can be; what is beyond them is refused above."""
    exported = Exported(designed_once("pd"))
    if name == "sample_time":
        exported.parameters["derivative_filter"] = 1e3
    exported.parameters[name] = value
    assert exported.prepare() == 0


def test_a_reference_of_zeros_is_one_where_the_platform_can_be_there() -> None:
    """Expected: with the base 2.9 m lower, a pose of zeros is near home: after a start it is followed, not a fault."""
    home = [0.08, -0.05, 0.05]
    lowered = {
        name: np.asarray(getattr(UNEVEN, name)).tolist()
        for name in ("platform_points", "leg_length_min", "leg_length_max", "home_orientation", "platform_mass")
    }
    points = (np.array(UNEVEN.base_points) - [0, 0, 2.85]).tolist()
    platform = {"preset": "liu2000", "parameters": {**lowered, "base_points": points, "home_position": home}}
    experiment = uneven_experiment(
        platform=platform,
        reference={"type": "hold"},
        start={"position": home},
        controller={**PD, "feedforward": "none"},
    )
    exported = Exported(designed(experiment, reference="inputs")).start()
    there = exported.designed.first_reference
    assert np.array_equal(there[:3], home)
    lengths = [leg_geometry(exported.designed.platform, pose[:3], pose[3:6]).length for pose in (there, np.zeros(18))]
    exported.step(lengths[0], there)
    error = np.array([1, -2, 3, -4, 5, -6]) * 1e-3
    for _ in range(400):  # until the derivative rests
        force, _ = exported.step(lengths[1] - error, np.zeros(18))
    assert exported.status == 0
    np.testing.assert_allclose(force, np.array(KP) * error, rtol=1e-6)
