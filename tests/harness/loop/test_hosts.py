"""Rows are the same in machine code and called from Python, and members of ensembles are runs of their own."""

from collections.abc import Callable
from typing import Any

import casadi
import control
import numpy as np
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.metric_definitions import as_one_number
from tests.support.uneven_loops import experiment_of

NAMES = ("memory", "time", "reference_acceleration", "reference_leg_length", "leg_velocity", "leg_length", "position")
GAINS = np.array([1100.0, 1450.0, 900.0, 1250.0, 1600.0, 1000.0])


def law_of(_platform: object, sample_time: float, scale: float = 1.0) -> casadi.Function:
    """A law with a limited integral, a cubic spring and functions of time; its inputs are in an order of their own."""
    inputs = [casadi.SX.sym(name, size) for name, size in zip(NAMES, (6, 1, 3, 6, 6, 6, 3), strict=True)]
    memory, time, acceleration, wanted, velocity, length, position = inputs
    error = wanted - length
    integral = casadi.fmin(casadi.fmax(memory + scale * 900 * sample_time * error, -0.5), 0.4)
    force = scale * GAINS * (error + 900 * error**3) - 110 * velocity + integral
    force += casadi.if_else(time > 0.06, 2 * casadi.sin(40 * time), 0.0) + casadi.repmat(acceleration, 2, 1) / 7
    force += casadi.atan2(position[1], 3) * casadi.tanh(velocity)
    return casadi.Function("law", inputs, [integral, force], list(NAMES), ["memory_next", "actuator_force"])


class Law:
    """The same with a memory that nobody sees."""

    def __init__(self, platform: object, sample_time: float, scale: float = 1.0) -> None:
        self._function, self._memory = law_of(platform, sample_time, scale), np.zeros(6)

    def __call__(self, sample: gs.Sample) -> FloatArray:
        reference = sample.reference
        inputs = [self._memory, sample.time, reference["acceleration"], reference["leg_length"]]
        outputs = self._function(*inputs, *(sample.measured[name] for name in NAMES[4:]))
        self._memory, force = (np.asarray(output).ravel() for output in outputs)
        return force


def linear_of(_platform: object, sample_time: float, scale: float = 1.0) -> gs.LinearController:
    """A PID whose states depend on each other, another one for each scale."""
    pid = gs.sampled(gs.pid(gs.Gains(0.7 * scale * GAINS, 110.0, scale * 900.0)), sample_time)
    mix = np.eye(pid.nstates) + 0.3 * np.tri(pid.nstates)
    mixed = mix @ pid.A @ np.linalg.inv(mix), mix @ pid.B, pid.C @ np.linalg.inv(mix), pid.D
    return gs.LinearController(control.ss(*mixed, sample_time))


CLOCKS = {"duration": 0.12, "sample_time": "4 ms", "plant_step": "1 ms", "jitter": "2 ms", "delay": 1}
# Everything at once; each clock is another one, and each member has other numbers.
SENSORS: dict[str, Any] = {
    **{"noise": {"leg_length": "20 um", "leg_velocity": "1 mm/s"}, "quantisation": {"leg_length": "3 um"}, "seed": 5}
}
ALL: dict[str, Any] = {
    "loop": CLOCKS,
    "sensors": {**SENSORS, "sample_time": "3 ms"},
    "actuators": {"force_limit": "75 N", "rate_limit": "2 kN/s", "lag": "3 ms"},
    "change": [{"at": 0.05, "factors": {"platform_mass": 1.4}}],
    "disturbance": [{"at": 0.03, "duration": 0.03, "force": ["180 N", "-90 N", "120 N"]}],
    "fault": [
        {"at": 0.035, "cut": [2, 5], "duration": 0.02},
        {"at": 0.05, "freeze": {"leg_length": [3, 4]}, "duration": 0.045},
        {"at": 0.08, "cut": [1], "freeze": {"leg_length": [4]}},
    ],
}
MANY: dict[str, Any] = {
    "platform_mass": {"factor": {"uniform": [0.8, 1.3]}},
    "platform_points": {"normal": "1 mm"},
    "fault.1.at": {"choice": ["21 ms", "35 ms"]},
    "fault.2.duration": {"choice": ["20 ms", "45 ms"]},
    "loop": {"delay": {"choice": [0, 1, 3]}, "jitter": {"choice": ["0 ms", "1 ms", "3 ms"]}},
    "sensors": {"noise": {"leg_length": {"uniform": ["0 um", "40 um"]}}},
    "actuators": {"lag": {"choice": ["0 ms", "2 ms", "5 ms"]}, "force_limit": {"uniform": ["68 N", "80 N"]}},
}


def members_of(tables: dict[str, Any], varied: dict[str, Any], kind: str = "pid", members: int = 11) -> gs.Experiment:
    """Members of an uneven loop whose reference moves."""
    motion = {"type": "sine", "position_amplitude": ["8 mm", "-5 mm", "6 mm"], "frequency": "4 Hz"}
    shared = {"limits": {"reference": "warn"}, "reference": motion}
    return experiment_of(kind, **{**shared, **tables, "ensemble": {**varied, "members": members, "seed": 4}})


# Of the law of a user, whose forces are smaller.
OF_LAW: dict[str, Any] = {"controller": {"parameters": {"scale": {"uniform": [0.7, 1.6]}}}}
WEAK = {"actuators": {"lag": {"choice": ["0 ms", "2 ms", "5 ms"]}, "force_limit": {"uniform": ["48 N", "56 N"]}}}
SWITCH = [{"at": 0.037, "enabled": False}, {"at": 0.081, "enabled": True}]
CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "plain": ({"loop": CLOCKS}, {"platform_mass": {"uniform": [9, 14]}}),
    "rate limit alone": ({"loop": CLOCKS, "actuators": {"force_limit": "none", "rate_limit": "700 N/s"}},
                         {"platform_mass": {"uniform": [9, 14]}}),
    # a flip of a quantised reading is no rounding
    "all": ({**ALL, "sensors": {**ALL["sensors"], "quantisation": {}}}, {**MANY, **WEAK}),
    "switched off and on": ({"loop": CLOCKS, "change": SWITCH}, {"change.1.at": {"choice": [0.0, 0.037]}}),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_traced_law_and_a_function_give_the_same_rows(case: str) -> None:
    """Expected: every column, to 1e-11 of its scale; flags and outcomes exactly."""
    tables, varied = CASES[case]
    chosen = members_of({**tables, "controller": {"type": "python"}}, {**varied, **OF_LAW})
    limited = set[str]()
    for member in (0, 3, 10):
        ours, theirs = (gs.run(chosen, member=member, controller=law) for law in (law_of, Law))
        assert ours.metadata["host"].startswith("compiled, ")
        assert theirs.metadata["host"] == "Python"
        assert ours.metadata["outcome"] == theirs.metadata["outcome"]
        assert ours.table.columns == theirs.table.columns
        columns = dict.fromkeys(name.partition("[")[0] for name in ours.table.columns)
        for name in columns:
            a, b = (np.asarray(record[name], dtype=float) for record in (ours, theirs))
            assert np.abs(a - b).max() <= (0.0 if name[:4] == "flag" else 1e-11) * np.abs(b).max(), name
        limited |= {name for name in columns if name[:4] == "flag" and 0 < ours[name].mean() < 1}
    expected = {"all": {"flag.force_limited", "flag.rate_limited"}, "rate limit alone": {"flag.rate_limited"}}
    assert limited >= expected.get(case, set())


# With the distance from the reference that some of their members pass.
LAWS: dict[str, tuple[Any, str]] = {
    "pid": (None, "56 mm"),
    "task": (None, "50 mm"),
    "traced": (law_of, "54 mm"),
    "Python": (Law, "54 mm"),
    "linear": (linear_of, "54 mm"),
}


@pytest.mark.parametrize("kind", LAWS)
def test_members_of_an_ensemble_are_runs_of_their_own(kind: str) -> None:
    """Expected: outcome and every metric of the record; the same bits among other members, and by several threads."""
    law, far = LAWS[kind]
    varied = {**MANY, "limits": {"position_error": {"choice": [far, "1 m"]}}, **({} if law is None else OF_LAW | WEAK)}
    own_clock = {} if kind in ("task", "Python") else {"sample_time": "3 ms"}  # else readings at the jittered samples
    changes = [*ALL["change"], *(SWITCH if law is Law else [])]  # with jitter, others are switched at other rows
    tables = {
        **ALL,
        "change": changes,
        "sensors": {**SENSORS, **own_clock},
        **({} if law is None else {"controller": {"type": "python"}}),
    }
    chosen = members_of(tables, varied, kind if law is None else "pid")
    many = gs.ensemble(chosen, controller=law, workers=1).members
    for k in range(0, 11, 3):
        record, row = gs.run(chosen, controller=law, member=k), many.row(k, named=True)
        outcome, found = record.metadata["outcome"], gs.metrics(record)
        assert (row["outcome"], row["ended"], row["cause"]) == tuple(outcome.values())
        for path, value in as_one_number({name: part for name, part in found.items() if name != "outcome"}).items():
            assert row[path] == (value if value is None else pytest.approx(value, rel=1e-11, abs=1e-15)), (k, path)
    assert many["outcome"].n_unique() == 2
    assert many["saturation.force_limited.any"].n_unique() > 5
    few = gs.ensemble(chosen, controller=law, members=3, workers=1).members
    assert many.head(3).equals(few)
    assert gs.ensemble(chosen, controller=law).members.equals(many)


# Settings of `heave_step`, what varies beside the mass, and words of the cause.
ENDS: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "far": ({}, {"limits.position_error": {"choice": ["40 mm", "48 mm", "1 m"]}}, "m from its reference; the limit is"),
    "singular": ({"disturbance": [{"at": 0.1, "duration": 0.2, "torque": [0, 1e6, 0]}], "limits.position_error": 1e6},
                 {"disturbance.1.at": {"choice": [0.1, 0.19]}}, "singular pose"),
    "sticky": ({}, {"leg_friction_velocity": {"choice": ["0.01 m/s", "1e-11 m/s"]},
                    "leg_coulomb_friction": {"choice": [50.0, 9e5]}}, "too many for one plant step"),
    "noise beyond numbers": ({"sensors": {"noise": {"leg_length": 1e-6}}},
                             {"sensors.noise.leg_length": {"choice": [1e-6, 1e12]}}, "the controller's forces are ["),
}  # fmt: skip


@pytest.mark.parametrize("case", ENDS)
def test_members_end_for_their_causes_and_the_others_go_on(case: str) -> None:
    """Expected: of both laws the same time, status and words, each of a run of its own; rows up to there count."""
    change, varied, words = ENDS[case]
    varied = {"members": 11, "seed": 2, "platform_mass": {"factor": {"uniform": [0.8, 1.3]}}, **varied}
    settings = {"loop.duration": 0.2, "loop.sample_time": 2e-3, "reference.at": 0.05, **change, "ensemble": varied}
    law = law_of(None, 2e-3, 300.0)
    compiled, stepped = (
        gs.ensemble("heave_step", settings, controller=controller, workers=1).members
        for controller in (law, lambda platform, period: Law(platform, period, 300.0))
    )
    names = ["outcome", "ended", "cause", "rows"]
    assert compiled.select(names).equals(stepped.select(names))
    assert set(compiled["outcome"].unique()) == {"completed", "diverged"}
    assert any(words in str(cause) for cause in compiled["cause"])
    k = int(np.argmax(compiled["outcome"].to_numpy() != "completed"))
    record = gs.run("heave_step", settings, controller=law, member=k)
    row = compiled.row(k, named=True)
    assert (row["outcome"], row["ended"], row["cause"]) == tuple(record.metadata["outcome"].values())
    assert row["rows"] == record.table.height == round(row["ended"] / 2e-3) + 1


def test_what_has_no_plain_operations_runs_in_python() -> None:
    length = casadi.MX.sym("leg_length", 6)
    table = casadi.interpolant("table", "bspline", [[0.0, 2.0, 3.0, 4.0, 5.0]], [0.0, 1.0, -1.0, 2.0, 1.0])
    looked_up = casadi.vertcat(*(100 * table(length[k]) for k in range(6)))
    law = casadi.Function("law", [length], [looked_up], ["leg_length"], ["actuator_force"])
    assert gs.run("heave_step", {"loop.duration": 0.01}, controller=law).metadata["host"] == "Python"


ONE: dict[str, Callable[[Any], Any]] = {
    "arcsin": casadi.asin, "arccos": casadi.acos, "arctan": casadi.atan, "sinh": casadi.sinh, "cosh": casadi.cosh,
    "arcsinh": casadi.asinh, "arctanh": casadi.atanh, "expm1": casadi.expm1, "log1p": casadi.log1p,
    "exp": casadi.exp, "tan": casadi.tan, "floor": casadi.floor, "ceil": casadi.ceil, "fabs": casadi.fabs,
    "sign": casadi.sign, "sin": casadi.sin, "cos": casadi.cos, "tanh": casadi.tanh,
}  # fmt: skip
TWO: dict[str, Callable[[Any, Any], Any]] = {
    "arctan2": casadi.atan2, "fmod": casadi.fmod, "hypot": casadi.hypot, "copysign": casadi.copysign,
    "fmin": casadi.fmin, "fmax": casadi.fmax, "less": lambda a, b: a < b, "not_equal": lambda a, b: a != b,
}  # fmt: skip


def test_operations_of_a_law_are_those_of_the_c_library() -> None:
    """Expected: NumPy's functions of sines of the measured lengths and of time: at each sample another function."""
    length, time = casadi.SX.sym("leg_length", 6), casadi.SX.sym("time")
    x, y = 0.95 * casadi.sin(900 * length + 500 * time), 0.95 * casadi.sin(1100 * length + 1 - 900 * time)
    terms = [function(x) for function in ONE.values()] + [function(x, y) for function in TWO.values()]
    terms += [casadi.sqrt(x + 2), casadi.log(x + 2)]
    terms.append(casadi.if_else(casadi.logic_and(x > 0.1, y > 0.2), x**3, casadi.remainder(x, y)))
    force = sum(casadi.if_else(casadi.fabs(1e3 * time - k) < 0.5, term, 0.0) for k, term in enumerate(terms))
    law = casadi.Function("law", [length, time], [force], ["leg_length", "time"], ["actuator_force"])
    settings = {"loop.duration": 1e-3 * len(terms), "controller.feedforward": "none", "sensors": {}}
    record = gs.run("heave_step", settings | {"limits.stroke": "ignore"}, controller=law)
    assert record.metadata["host"].startswith("compiled, ")
    measured, now = record["measured.leg_length"][:-1], record["time"][:-1, None]
    a, b = 0.95 * np.sin(900 * measured + 500 * now), 0.95 * np.sin(1100 * measured + 1 - 900 * now)
    expected = [getattr(np, name)(a) for name in ONE] + [getattr(np, name)(a, b) for name in TWO]
    expected += [np.sqrt(a + 2), np.log(a + 2), np.where((a > 0.1) & (b > 0.2), a**3, a - np.rint(a / b) * b)]
    assert np.ptp(a) > 1
    for k, values in enumerate(expected):
        assert record["controller.force"][k] == pytest.approx(values[k].astype(float), rel=1e-9, abs=1e-12), k
