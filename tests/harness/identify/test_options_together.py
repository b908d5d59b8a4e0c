"""Every pair of options of an identification, against the Cramér–Rao bound and the truth of a Lagrangian's logs."""

import json
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from allpairspy import AllPairs
from scipy.linalg import eigvals
from scipy.ndimage import minimum_filter1d
from scipy.stats import chi2

import gough_stewart as gs
from gough_stewart import Log
from tests.harness.identify.information import information, readings, sensitivities, with_changes
from tests.harness.identify.machine_logs import (
    Course,
    Sensing,
    Swing,
    machine_log,
    random_machine,
    value_of,
    without_rows,
)
from tests.support.arrays import FloatArray
from tests.support.commands import invoke
from tests.support.covering import covering
from tests.support.lagrangian import legs_along

RATE, DURATION, FROM = 250.0, 2.8, 7.3
FACTOR = -37.5  # force per current [N/A]
COURSES = [Course(Swing(seed=3 + k, frequency=0.6, harmonics=2, fade=1.0), DURATION, RATE) for k in (0, 1)]
# Six unlike legs, gravity aslant. Joints, legs and gravity are known; what is estimated is not.
MACHINE = replace(
    random_machine(4, equal_friction=False)[0],
    gravity=np.array([0.31, -0.44, -9.77]),
    leg_friction_velocity=5e-3,
    leg_coulomb_friction=90.0,
)
COM = tuple(f"platform_com[{k}]" for k in (1, 2, 3))
INERTIA = tuple(f"platform_inertia[{k}]" for k in ("1,1", "1,2", "1,3", "2,2", "2,3", "3,3"))
# What is asked for, and the elements that it means.
ESTIMATES = {
    "payload": ("platform_mass,platform_com", ("platform_mass", *COM)),
    "body": ("platform_inertia, leg_armature, platform_mass", (*INERTIA, "leg_armature", "platform_mass")),
    "friction": (
        "leg_viscous_friction,platform_com[2],platform_mass",
        ("leg_viscous_friction", COM[1], "platform_mass"),
    ),
    "each leg": (
        "platform_mass,leg_viscous_friction[1..6]",
        ("platform_mass", *(f"leg_viscous_friction[{k}]" for k in range(1, 7))),
    ),
}
# How far the file is from the machine.
WRONG = {
    "platform_mass": -260.0,
    **dict(zip(COM, (0.07, -0.05, -0.11), strict=True)),
    **dict(zip(INERTIA, (40.0, 9.0, -12.0, -25.0, 7.0, 30.0), strict=True)),
    "leg_armature": 55.0,
    "leg_viscous_friction": -90.0,
}
# What the instruments do, beside what is right; they are estimated too.
INSTRUMENTS: dict[str, dict[str, float]] = {
    "right": {},
    "gain": {"force_gain[5]": 0.03},
    "offsets": {
        f"force_offset[{k}]": v for k, v in zip(range(1, 7), (40.0, -25.0, 31.0, -52.0, 18.0, -9.0), strict=True)
    },
    "late": {"delay": 2.7e-3},
    "tilt": {"base_tilt[1]": 0.006, "base_tilt[2]": -0.009},
}
OPTIONS: dict[str, list[Any]] = {
    "estimate": list(ESTIMATES),
    "instruments": list(INSTRUMENTS),
    "friction": ["viscous", "coulomb"],
    "cutoff": [None, 20.0],
    "noise": [(0.01, 1e-6), (0.03, 3e-6)],
    "validation": [0.2, 0.4, 0.0, "a log"],
    "logs": ["one", "two", "gap"],
    "source": ["csv", "currents", "held", "object"],
    "door": ["command", "python"],
}
# What takes least time, for rows in which no pair needs anything else.
_QUICK = {"friction": "viscous", "door": "python", "estimate": "payload", "logs": "one"}


def _pairs(rows: list[dict[str, Any]]) -> set[tuple[str, ...]]:
    return {(a, str(row[a]), b, str(row[b])) for row in rows for a, b in combinations(OPTIONS, 2)}


def _rows() -> list[dict[str, Any]]:
    """Every pair in a row; the command has no cut-off."""
    rows = [dict(zip(OPTIONS, row, strict=True)) for row in AllPairs(list(OPTIONS.values()))]
    rows += [row | {"door": "python"} for row in rows if row["door"] == "command" and row["cutoff"]]
    rows = [row | ({"cutoff": None} if row["door"] == "command" else {}) for row in rows]
    wanted = _pairs(rows)
    for row in list(rows):
        others = [other for other in rows if other is not row]
        rows = others if _pairs(others) == wanted else rows
    for name, value in _QUICK.items():
        for k, row in enumerate(rows):
            tried = [*rows[:k], row | {name: value}, *rows[k + 1 :]]
            rows = tried if _pairs(tried) == wanted else rows
    return rows


ROWS = _rows()
_ALWAYS = covering(ROWS)


def _machine(row: dict[str, Any]) -> gs.Platform:
    return MACHINE if row["friction"] == "coulomb" else replace(MACHINE, leg_coulomb_friction=0.0)


def _names(row: dict[str, Any]) -> tuple[str, ...]:
    return (*ESTIMATES[row["estimate"]][1], *INSTRUMENTS[row["instruments"]])


def _log(row: dict[str, Any], course: Course, seed: int) -> Log:
    own = INSTRUMENTS[row["instruments"]]
    six = range(1, 7)
    held = row["source"] == "held"
    sensing = Sensing(
        force_gain=tuple(1 + own.get(f"force_gain[{k}]", 0.0) for k in six),
        force_offset=tuple(own.get(f"force_offset[{k}]", 0.0) for k in six),
        # a force that is held acts until the next row, so on average half a row later than that of its time
        delay=own.get("delay", 0.0) - (0.5 / RATE if held else 0.0),
        force_noise=row["noise"][0],
        length_noise=row["noise"][1],
    )
    tilt = own.get("base_tilt[1]", 0.0), own.get("base_tilt[2]", 0.0)
    log = machine_log(_machine(row), replace(course, base_tilt=tilt), sensing, seed=seed)
    assert log.time is not None
    log = replace(log, time=log.time + FROM, holds_force=held)
    # seven rows are more than are interpolated
    return without_rows(log, 350, 7) if row["logs"] == "gap" else log


def _written(log: Log, source: str, path: Path) -> Path:
    """As a file of another origin: other units, order and spelling; or as SI."""
    assert log.time is not None
    assert log.actuator_force is not None
    legs = range(6)
    if source == "csv":
        columns = {f"leg_length_{k + 1} (mm)": 1e3 * log.leg_length[:, k] for k in legs}
        columns |= {f"actuator_force[{k + 1}] [kN]": 1e-3 * log.actuator_force[:, k] for k in reversed(legs)}
        columns["time [ms]"] = 1e3 * log.time
    else:
        columns = {"time": log.time} | {f"leg_length[{k + 1}]": log.leg_length[:, k] for k in legs}
        name, factor = ("motor_current", FACTOR * 1e-3) if source == "currents" else ("actuator_force", 1.0)
        unit = " [mA]" if source == "currents" else ""
        columns |= {f"{name}[{k + 1}]{unit}": log.actuator_force[:, k] / factor for k in legs}
    table = polars.DataFrame(columns)
    if source == "currents":
        table.write_parquet(path.with_suffix(".parquet"))
        return path.with_suffix(".parquet")
    table.write_csv(path.with_suffix(".csv"))
    return path.with_suffix(".csv")


@cache
def _columns(course: int, friction: str, names: tuple[str, ...], instruments: str) -> FloatArray:
    """∂(reading)/∂θ on a grid of twenty milliseconds."""
    machine = MACHINE if friction == "coulomb" else replace(MACHINE, leg_coulomb_friction=0.0)
    return sensitivities(machine, COURSES[course], _GRID, names, INSTRUMENTS[instruments])


_GRID = np.arange(0.0, DURATION, 0.02)


def _bounds(row: dict[str, Any], cutoff: float) -> tuple[FloatArray, FloatArray]:
    """Covariances of the best possible estimate from all readings that are fitted, and from those far from any edge."""
    edge = 4.2 / cutoff  # of the filters
    share = row["validation"] if isinstance(row["validation"], float) else 0.0
    p = len(_names(row))
    every, inner = np.zeros((2, p, p))
    for k in range(2 if row["logs"] == "two" else 1):
        machine = _machine(row)
        D = _columns(k, row["friction"], _names(row), row["instruments"])
        noise = row["noise"][0] * np.sqrt((readings(machine, COURSES[k], _GRID, {}) ** 2).mean(axis=0))
        fitted = (1 - share) * DURATION >= _GRID
        far = (edge < _GRID) & (min((1 - share) * DURATION, DURATION - edge) > _GRID)
        if row["logs"] == "gap":
            far &= (1.4 - edge > _GRID) | (1.428 + edge < _GRID)
        sliding = np.ones((len(_GRID), 6), dtype=bool)
        if row["friction"] == "coulomb":
            speed = np.abs(legs_along(machine, COURSES[k].swing.along(machine, _GRID, DURATION))[1])
            reach = 2 * round(1.5 / cutoff / 0.02) + 3
            sliding = minimum_filter1d(speed, reach, axis=0) > 10 * machine.leg_friction_velocity
        every += information(D, np.broadcast_to(fitted[:, None], (len(_GRID), 6)), noise, 0.02 * RATE)
        inner += information(D, far[:, None] & sliding, noise, 0.02 * RATE)
    return np.asarray(np.linalg.inv(every), dtype=float), np.asarray(np.linalg.inv(inner), dtype=float)


def _identified(row: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The estimate as in its file, and the platform that follows."""
    believed = with_changes(_machine(row), {name: WRONG[name] for name in _names(row) if name in WRONG})
    logs = [_log(row, course, 11 + k) for k, course in enumerate(COURSES[: 2 if row["logs"] == "two" else 1])]
    aside = [_log(row, COURSES[1], 77)] if row["validation"] == "a log" else []
    estimate = ",".join([ESTIMATES[row["estimate"]][0], *INSTRUMENTS[row["instruments"]]])
    source = row["source"]
    factor = FACTOR if source == "currents" else None
    paths = [_written(log, source, folder / f"log{k}") for k, log in enumerate([*logs, *aside])]
    if row["door"] == "command":
        gs.save_platform(believed, folder / "believed.toml")
        options = ["--platform", str(folder / "believed.toml"), "--estimate", estimate]
        options += [] if factor is None else ["--force-per-current", str(factor)]
        options += ["--holds-force"] if source == "held" else []
        options += ["--validate", str(paths[-1])] if aside else ["--validation", str(row["validation"])]
        given = [str(path) for path in paths[: len(logs)]]
        done = invoke("identify", *given, *options, "--out", str(folder / "out"))
        found: dict[str, Any] = json.loads((folder / "out" / "estimate.json").read_text("utf-8"))
        assert done.exit_code == (3 if found["alarms"] else 0), done.stderr
        return found | {"platform": gs.load_platform(folder / "out" / "platform.toml")}
    if source != "object":
        read = [gs.read_log(path, factor, holds_force=source == "held") for path in paths]
        logs, aside = read[: len(logs)], read[len(logs) :]
    result = gs.identify(
        logs if len(logs) > 1 else logs[0],
        believed,
        estimate,
        validation=aside[0] if aside else row["validation"],
        cutoff=row["cutoff"],
    )
    made: dict[str, Any] = json.loads(result.to_json())
    return made | {"platform": result.platform(believed)}


@cache
def _kernel_gain(cutoff: float) -> float:
    """Standard deviation of white noise after the low-pass 2 f sinc(2 f t) cos⁴(π t/2T), T = 2.75/f."""
    reach = 2.75 / cutoff
    t = np.arange(-int(reach * RATE), int(reach * RATE) + 1) / RATE
    kernel = np.sinc(2 * cutoff * t) * np.cos(np.pi * t / (2 * reach)) ** 4
    return float(np.sqrt((kernel**2).sum()) / kernel.sum())


def _parameter(row: dict[str, Any]) -> Any:
    """The row; those that hold every value run without the evidence."""
    name = "-".join(map(str, row.values())).replace(" ", "_")
    return pytest.param(row, id=name, marks=[] if ROWS.index(row) in _ALWAYS else [pytest.mark.evidence])


@pytest.mark.parametrize("row", [_parameter(row) for row in ROWS])
def test_every_pair_of_options_finds_the_machine_as_well_as_its_noise_allows(
    row: dict[str, Any], tmp_path: Path
) -> None:
    """Expected: the machine, and the covariance of the Cramér–Rao bound in every direction, from both sides."""
    # (θ̂ − θ)ᵀ C⁻¹ (θ̂ − θ) between the quantiles 5e-5 and 1 − 5e-5 of χ²: one right row in 10,000 fails; errors
    # from 0.85 times the bound of all fitted readings to 1.4 times that of readings far from edges, gaps and reversals;
    # noise of the forces within 25 %, six of its errors
    found = _identified(row, tmp_path)
    names = _names(row)
    assert list(found["parameters"]) == list(names)
    shown = found["parameters"].values()
    values = np.array([one["value"] for one in shown])
    machine = _machine(row)
    truth = np.array([_true(machine, row, name) for name in names])
    C = np.array(found["covariance"])
    distance = (values - truth) @ np.linalg.solve(C, values - truth)
    assert chi2.ppf(5e-5, len(names)) < distance < chi2.isf(5e-5, len(names))
    errors = np.array([one["standard_error"] for one in shown])
    np.testing.assert_allclose(errors, np.sqrt(np.diag(C)), rtol=1e-9)
    np.testing.assert_allclose(found["correlation"], C / np.outer(errors, errors), atol=1e-9)
    ends = np.array([one["interval"] for one in shown])
    # Student's t of a hundred degrees of freedom or more
    half = np.stack([values - ends[:, 0], ends[:, 1] - values]) / errors
    assert np.ptp(half) < 1e-9 * half.max()
    assert 1.95996 < half[0, 0] < 1.985

    cutoff = row["cutoff"] or 20.0  # that of these courses is higher
    least, most = _bounds(row, cutoff)
    of_least, of_most = (np.sqrt(np.real(eigvals(np.linalg.solve(bound, C)))) for bound in (least, most))
    assert of_least.min() > 0.85
    assert of_most.max() < 1.4

    assert found["method"] == "linear"
    # the least p-value that there is, of 4,000 simulations: of 1,000 right rows one is below
    assert found["diagnosis"]["p_value"] > 1e-3, found["alarms"]
    judged = found["validation"]["p_value"] if found["validation"] else 1.0
    assert judged > 1e-4
    assert bool(found["alarms"]) == (found["diagnosis"]["p_value"] < 0.05 or judged < 0.005)
    _check_noise(found, row)
    for name in (name for name in names if name in WRONG):
        np.testing.assert_allclose(value_of(found["platform"], name), found["parameters"][name]["value"], rtol=1e-9)


def _check_noise(found: dict[str, Any], row: dict[str, Any]) -> None:
    """Residuals: what the documented filter leaves of the noise that was put in; those of validation are alike."""
    course = COURSES[0]
    force = np.sqrt((readings(_machine(row), course, _GRID, {}) ** 2).mean(axis=0))
    np.testing.assert_allclose(found["diagnosis"]["noise"]["force"], row["noise"][0] * force, rtol=0.25)
    residuals = found["residuals"]
    rms = np.array(residuals["rms"])
    assert (residuals["quantity"], residuals["unit"]) == ("force of leg", "N")
    if row["cutoff"]:
        ratio = rms / (row["noise"][0] * force * _kernel_gain(row["cutoff"]))
        assert 0.9 < ratio.mean() < 1.25
    if row["validation"] == 0.0:
        assert residuals["validation_rms"] is None
    else:
        # another log has another motion, and noise that is a share of its forces
        error = 0.4 if row["validation"] == "a log" else 0.25
        np.testing.assert_allclose(np.mean(np.array(residuals["validation_rms"]) / rms), 1.0, atol=error)


def _true(machine: gs.Platform, row: dict[str, Any], name: str) -> float:
    own = INSTRUMENTS[row["instruments"]]
    return own[name] + name.startswith("force_gain") if name in own else value_of(machine, name)
