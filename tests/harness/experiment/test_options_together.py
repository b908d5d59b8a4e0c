"""Every pair of options of an experiment, against a loop written from the documentation."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations, product
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from allpairspy import AllPairs

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.covering import covering
from tests.support.documented_loop import Documented, simulate
from tests.support.foreign_controller import NAMES, foreign_controller
from tests.support.orientations import rotation_vectors
from tests.support.uneven import UNEVEN
from tests.support.uneven_loops import LEG, TASK, experiment_of

pytestmark = pytest.mark.usefixtures("units_in_process")


DURATION, SAMPLE_TIME = 0.1, 0.005
_STEPS = 5  # of the plant in a sample time, where it has several
ALONG = np.array([0.021, -0.017, 0.026, 0.031, -0.024, 0.035])
OPTIONS: dict[str, list[Any]] = {
    "type": ["pd", "pid"],
    "space": ["leg", "task"],
    "derivative_on": ["error", "measurement"],
    "derivative_filter": [None, 0.009],
    "discretisation": ["tustin", "backward_diff", "zoh"],
    "feedforward": ["none", "gravity", "computed_torque"],
    "anti_windup_time": [None, 0.06],
    "delay": [0, 1, 3],
    "plant_step": [SAMPLE_TIME, SAMPLE_TIME / _STEPS],
    "sensor_time": [None, 2 * SAMPLE_TIME],
    "quantisation": [0.0, 4e-4],
    "force_limit": [np.inf, 76.0],
    "rate_limit": [np.inf, 900.0],
    "lag": [0.0, 0.012],
    "reference": ["sine", "point_to_point", "step"],
    "machine": ["as believed", "differs", "changes"],
    "disturbance": [False, True],
    "start": [False, True],
    # kp, kd and ki, or bandwidth, damping ratio and integral time
    "gains": ["stated", "bandwidth"],
    "scales": [(1.0, 1.0), (1.3, -0.8)],
    "about": ["home", "elsewhere"],
    "injection": [False, True],
    "noise": [0.0, 2e-4],
    # steps of signals that the controller does not use
    "others": [False, True],
    "host": ["model", "fmu3", "member"],
    # frequency, damping and depth
    "notch": [None, (31.0, 0.4, 0.15)],
    "jitter": [0.0, 3.5 * SAMPLE_TIME / _STEPS],
}


def _can_be(row: dict[str, Any]) -> bool:
    """Samples are late by whole plant steps."""
    return not (row.get("jitter") and row.get("plant_step") == SAMPLE_TIME)


def _rows() -> list[dict[str, Any]]:
    """Every pair of two options' values that can be; where the library leaves a pair out, one more row for it."""
    pairs = AllPairs(list(OPTIONS.values()), filter_func=lambda row: _can_be(dict(zip(OPTIONS, row, strict=False))))
    rows = [dict(zip(OPTIONS, row, strict=True)) for row in pairs]
    for a, b in combinations(OPTIONS, 2):
        for x, y in product(OPTIONS[a], OPTIONS[b]):
            if _can_be({a: x, b: y}) and not any((row[a], row[b]) == (x, y) for row in rows):
                rows.append(next(new for row in rows[::-1] if _can_be(new := {**row, a: x, b: y})))
    return rows


ROWS = _rows()
# Of somebody else's controller, a unit with F = k (L_r − L): all but the options of a PD or PID, and ensembles, which
# have many of a kind; its output is that of the sample before, so without a delay there is none.
_OF_UNITS = (
    *("plant_step", "sensor_time", "quantisation", "force_limit", "rate_limit", "lag", "reference", "machine"),
    *("feedforward", "disturbance", "start", "scales", "about", "injection", "noise", "others"),
)
_UNIT_OPTIONS = {name: OPTIONS[name] for name in _OF_UNITS} | {"delay": [1, 3], "host": ["model", "fmu3"]}
_UNIT_GAIN = 600.0
_FIRST = {name: values[0] for name, values in OPTIONS.items()} | {"type": "fmu"}
ROWS += [_FIRST | dict(zip(_UNIT_OPTIONS, row, strict=True)) for row in AllPairs(list(_UNIT_OPTIONS.values()))]
_UNITS = [number for number, row in enumerate(ROWS) if row["type"] == "fmu"]
# Those that hold every value twice, and two of these, always run; all of them with the evidence.
ALWAYS = sorted({*covering(ROWS[: _UNITS[0]], times=2), *_UNITS[:2]})
_MACHINE: dict[str, Any] = {
    "base_points": (UNEVEN.base_points + 0.004 * UNEVEN.base_points[::-1]).tolist(),
    "platform_points": (UNEVEN.platform_points - 0.003 * UNEVEN.platform_points[::-1]).tolist(),
    "platform_mass": 13.9,
    "platform_com": [0.02, -0.07, 0.11],
    "leg_lower_mass": [2.3, 0.0, 2.9, 1.8, 2.5, 3.1],
    "leg_upper_mass": [1.2, 1.5, 0.0, 1.1, 1.4, 0.8],
    "leg_lower_com": [0.47, 0.4, 0.55, 0.5, 0.6, 0.44],
    "leg_upper_com": [0.58, 0.5, 0.66, 0.61, 0.54, 0.7],
    "leg_lower_inertia": [0.13, 0.1, 0.17, 0.15, 0.12, 0.2],
    "leg_upper_inertia": [0.061, 0.05, 0.07, 0.08, 0.055, 0.066],
    "leg_armature": [1.7, 2.2, 1.3, 1.9, 1.5, 2.4],
    "leg_viscous_friction": 9.5,
    "gravity": [0.8, -1.1, -9.6],
}
_CHANGED: dict[str, Any] = {"platform_mass": 15.2, "platform_com": [-0.03, -0.02, 0.21]}
_CHANGE_AT, _FROM, _FOR = 0.05, 0.035, 0.06
_ABOUT = np.array([0.11, -0.06, 2.93, 0.02, -0.05, 0.14])
_OTHERS = {"position": 3e-4, "orientation": 2e-4, "velocity": 5e-3, "angular_velocity": 4e-3, "leg_velocity": 7e-3}
_SWEEP = 0.03  # [s]
_WRENCH = np.array([9.0, -14.0, 21.0, 3.0, -4.0, 6.0])


def _machine(kind: str, time: float) -> gs.Platform:
    if kind == "as believed":
        return UNEVEN
    machine = UNEVEN.with_parameters(_MACHINE)
    if kind == "changes" and time > _CHANGE_AT - 1e-9:
        return replace(machine, **_CHANGED)
    return machine


def _wrench(time: float) -> FloatArray:
    return _WRENCH if _FROM - 1e-9 < time < _FROM + _FOR - 1e-9 else np.zeros(6)


def _injected(time: float, J: FloatArray) -> FloatArray:
    """A torque about y that sweeps from 30 to 80 Hz every 30 ms, in two whole cycles instead of 1.65; a leg's most."""
    forces = np.linalg.solve(J.T, np.eye(6)[4])
    t = time % _SWEEP
    cycles = (2 - 25 * _SWEEP) * t / _SWEEP + 25 * t**2 / _SWEEP
    return np.asarray(8.0 * np.sin(2 * np.pi * cycles) * forces / np.abs(forces).max())


def _pose_about(row: dict[str, Any]) -> FloatArray:
    home = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
    return home if row["about"] == "home" else _ABOUT


def _expected(row: dict[str, Any], readings: FloatArray | None, samples: Sequence[int] | None = None) -> Documented:
    options = {
        **row,
        **(TASK if row["space"] == "task" else LEG),
        "sample_time": SAMPLE_TIME,
        "duration": DURATION,
        "along": ALONG,
        "frequency": 2.3,
        "phase": 0.6,
        "at": 0.03,
        "move_duration": 0.11,
        "disturbance": _wrench if row["disturbance"] else lambda _time: np.zeros(6),
        "injection": _injected if row["injection"] else lambda _time, _J: np.zeros(6),
        "about": _pose_about(row),
        "bandwidth": 1.9 if row["gains"] == "bandwidth" else None,
        "damping_ratio": 0.85,
        "integral_time": 0.31,
    }
    if row["type"] != "pid":
        options["ki"] = [0.0] * 6
    if row["type"] == "fmu":  # proportional; a derivative without gain needs some filter
        options |= {"kp": [_UNIT_GAIN] * 6, "kd": [0.0] * 6, "derivative_filter": 1.0}
    start = _pose_about(row) + 0.3 * ALONG[::-1] if row["start"] else None
    return simulate(options, UNEVEN, lambda time: _machine(row["machine"], time), start, readings, samples)


def _unit(row: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The table of somebody else's controller, F = k (L_r − L), under its own names."""
    unit = foreign_controller(folder / "theirs.fmu")
    of_unit = {"type": "fmu", "file": str(unit), "names": NAMES, "parameters": {"gain": _UNIT_GAIN}}
    return {**of_unit, "feedforward": row["feedforward"]}


def _controller(row: dict[str, Any]) -> dict[str, Any]:
    gains, stated = TASK if row["space"] == "task" else LEG, row["gains"] == "stated"
    plain = ("type", "space", "derivative_on", "discretisation", "feedforward")
    kinds: list[dict[str, Any]] = [{"bandwidth": "1.9 Hz", "damping_ratio": 0.85}, {"integral_time": "310 ms"}]
    if stated:
        kinds = [{"proportional_gain": gains["kp"], "derivative_gain": gains["kd"]}, {"integral_gain": gains["ki"]}]
    controller: dict[str, Any] = {name: row[name] for name in plain} | kinds[0]
    controller |= {"derivative_filter": row["derivative_filter"]} if row["derivative_filter"] else {}
    if row["type"] == "pid":
        controller |= kinds[1] | ({"anti_windup_time": row["anti_windup_time"]} if row["anti_windup_time"] else {})
    if row["notch"]:
        controller["notch"] = dict(zip(("frequency", "damping", "depth"), row["notch"], strict=True))
    return controller


def _recorded(row: dict[str, Any], folder: Path) -> gs.Record:
    what = "amplitude" if row["reference"] == "sine" else "change"
    reference = {"type": row["reference"], "time_scale": row["scales"][0], "amplitude_scale": row["scales"][1]}
    reference |= {f"position_{what}": ALONG[:3].tolist(), f"orientation_{what}": ALONG[3:].tolist()}
    reference |= {"frequency": 2.3, "phase": 0.6} if what == "amplitude" else {"at": 0.03}
    reference |= {"duration": 0.11} if row["reference"] == "point_to_point" else {}
    if row["about"] != "home":
        reference |= {"position": _ABOUT[:3].tolist(), "orientation": _ABOUT[3:].tolist()}
    quantisation = {"leg_length": row["quantisation"]} if row["quantisation"] else {}
    values: dict[str, Any] = {
        "plant": {"tolerance": 1e-11},
        "reference": reference,
        "controller": _unit(row, folder) if row["type"] == "fmu" else _controller(row),
        "loop": {"duration": DURATION, "sample_time": SAMPLE_TIME}
        | {name: row[name] for name in ("plant_step", "delay", "jitter")},
        "sensors": {
            "quantisation": quantisation | (_OTHERS if row["others"] else {}),
            "noise": {"leg_length": row["noise"]} if row["noise"] else {},
            "seed": crc32(_name(row).encode()) % 1000,
            **({"sample_time": row["sensor_time"]} if row["sensor_time"] else {}),
        },
        "actuators": {
            "force_limit": row["force_limit"] if np.isfinite(row["force_limit"]) else "none",
            "lag": row["lag"],
            **({"rate_limit": row["rate_limit"]} if np.isfinite(row["rate_limit"]) else {}),
        },
        "limits": {"reference": "warn", "position_error": 10.0},
    }
    if row["machine"] != "as believed":
        values["plant"]["parameters"] = _MACHINE
    if row["machine"] == "changes":
        values["change"] = [{"at": _CHANGE_AT, "parameters": _CHANGED}]
    if row["disturbance"]:
        wrench = {"force": _WRENCH[:3].tolist(), "torque": _WRENCH[3:].tolist()}
        values["disturbance"] = [{"at": _FROM, "duration": _FOR, **wrench}]
    if row["start"]:
        pose, rest = (_pose_about(row) + 0.3 * ALONG[::-1]).tolist(), [0.0] * 3
        still = {"velocity": rest, "angular_velocity": rest}
        values["start"] = {"position": pose[:3], "orientation": pose[3:], **still}
    if row["injection"]:
        values["injection"] = {"type": "chirp", "mode": "pitch", "amplitude": 8, "band": [30, 80], "period": "30 ms"}
    if row["host"] != "member":
        return gs.run(experiment_of("pd", **values), plant=row["host"])
    # of a spread far below what is compared
    spread = {"factor": {"uniform": [1 - 1e-13, 1 + 1e-13]}}
    values["ensemble"] = {"members": 4, "tolerance": 1e-11, "platform_mass": spread}
    return gs.run(experiment_of("pd", **values), member=2)


def _samples(record: gs.Record) -> list[int]:
    """The row of each sample, by the first change of the command; at rest, that at which the first one comes to act."""
    rows = []
    command, force = (
        (np.diff(record[name], axis=0) != 0).any(axis=1) for name in ("controller.force", "actuator_force")
    )
    for first in range(_STEPS, len(command), _STEPS):
        since = np.s_[first - 1 : first + _STEPS - 1]
        rows.append(first + int((command if command[since].any() else force)[since].argmax()))
    return [0, *rows]


def _name(row: dict[str, Any]) -> str:
    return "-".join(str(value) for value in row.values())


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], tuple[gs.Record, Documented]]:
    """The record of a row of options, and what it should be; each is made once."""

    @cache
    def made(number: int) -> tuple[gs.Record, Documented]:
        row = ROWS[number]
        record = _recorded(row, tmp_path_factory.mktemp("options"))
        # what noise was there is no matter of the loop
        readings = record["measured.leg_length"] if row["noise"] else None
        return record, _expected(row, readings, _samples(record) if row["jitter"] else None)

    return made


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(number, id=_name(row), marks=() if number in ALWAYS else pytest.mark.evidence)
        for number, row in enumerate(ROWS)
    ],
)
def test_every_pair_of_options_does_what_the_documentation_says(number: int, both: Callable[[int], Any]) -> None:
    """Expected: the loop written from docs/loop.md around a Lagrangian's plant, without code of the harness."""
    row, (record, expected) = ROWS[number], both(number)
    assert record.metadata["outcome"] == {"status": "completed", "time": pytest.approx(DURATION), "cause": None}
    (pose, twist, acceleration), (wanted, wanted_twist, wanted_acceleration) = (
        [
            np.concatenate([record[of + linear], record[of + angular]], axis=1)
            for linear, angular in (
                ("position", "orientation"),
                ("velocity", "angular_velocity"),
                ("acceleration", "angular_acceleration"),
            )
        ]
        for of in ("", "reference.")
    )
    n = len(expected.pose)
    np.testing.assert_allclose(record["time"], np.linspace(0, DURATION, n), rtol=0, atol=1e-12)
    for found, meant, within in (
        (record["controller.force"], expected.command, 2e-5),
        (record["controller.feedforward"], expected.feedforward, 1e-6),
        (record["actuator_force"], expected.actuator_force, 2e-5),
        (np.concatenate([record["external_force"], record["external_torque"]], axis=1), expected.wrench, 0),
        (pose, expected.pose, 2e-8),
        (twist, expected.twist, 2e-6),
        (acceleration, expected.acceleration, 2e-5),
        (record["leg_length"], expected.leg_length, 2e-8),
        (record["leg_velocity"], expected.leg_velocity, 2e-6),
        (wanted, expected.wanted, 1e-12),
        (wanted_twist, expected.wanted_twist, 1e-11),
        (wanted_acceleration, expected.wanted_acceleration, 1e-6),
        (record["reference.leg_length"], expected.wanted_length, 1e-12),
        (record["reference.leg_velocity"], expected.wanted_velocity, 1e-11),
        (record["error.position"], (expected.wanted - expected.pose)[:, :3], 2e-8),
        (record["error.orientation"], rotation_vectors(expected.pose[:, 3:], expected.wanted[:, 3:]), 2e-8),
        (record["error.leg_length"], expected.wanted_length - expected.leg_length, 2e-8),
    ):
        np.testing.assert_allclose(found, meant, rtol=0, atol=within)
    if row["quantisation"]:  # a rounding to the next step is seldom, but possible
        assert (np.abs(record["measured.leg_length"] - expected.reading) < 2e-8).mean() > 0.995
    else:
        np.testing.assert_allclose(record["measured.leg_length"], expected.reading, rtol=0, atol=2e-8)
    if row["injection"]:
        np.testing.assert_allclose(record["controller.injection"], expected.injection, rtol=0, atol=1e-9)
    else:
        assert "controller.injection" not in record
    _check_flags(row, record, expected)
    _check_parameters(row, record)


def _check_flags(row: dict[str, Any], record: gs.Record, expected: Documented) -> None:
    beyond = np.abs(expected.command) - row["force_limit"]
    clear = np.abs(beyond) > 1e-4
    assert (record["flag.force_limited"] == (beyond > 0))[clear].all()
    left = np.abs(expected.target - expected.reached)[:-1] if np.isfinite(row["rate_limit"]) else np.zeros((1, 6))
    clear = (left == 0) | (left > 1e-4)
    assert (record["flag.rate_limited"][: len(left)] == (left > 0))[clear].all()
    assert not record["flag.stroke_exceeded"].any()


def _check_parameters(row: dict[str, Any], record: gs.Record) -> None:
    """A column for each parameter that changes, of the value that acts from the row on."""
    assert ("platform_mass" in record) == ("platform_com" in record) == (row["machine"] == "changes")
    assert "platform_inertia" not in record
    if row["machine"] == "changes":
        later = record["time"] > _CHANGE_AT - 1e-9
        assert np.allclose(
            record["platform_mass"], np.where(later, _CHANGED["platform_mass"], _MACHINE["platform_mass"]), 1e-12
        )
        both_coms = np.array([_MACHINE["platform_com"], _CHANGED["platform_com"]])
        assert (record["platform_com"] == both_coms[later.astype(int)]).all()


def test_the_limits_of_the_rows_are_reached(both: Callable[[int], Any]) -> None:
    """A row in which a limit is never active says nothing of it: most of those that have one reach it."""
    for name, flag in (("force_limit", "flag.force_limited"), ("rate_limit", "flag.rate_limited")):
        limited = [number for number in ALWAYS if np.isfinite(ROWS[number][name])]
        reached = [bool(both(number)[0][flag].any()) for number in limited]
        assert sum(reached) >= 0.7 * len(limited)
