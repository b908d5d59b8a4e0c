"""A platform whose frame is fixed to it in another way is the same machine: only what names an orientation differs.

With p′ = Qᵀ p for joints and centre of mass, J′ = Qᵀ J Q for the inertia and R′ = R Q for orientations, all legs,
forces, errors and margins are those of before.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import control
import numpy as np
import polars
import pytest
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.arrays import FloatArray

Frame = tuple[float, float, float]
AS_SHIPPED: Frame = (0.0, 0.0, 0.0)
HALF, BACK, ODD, UPSIDE_DOWN = ((0.0, 0.0, np.pi), (0.0, 0.0, -np.pi), (0.0, 0.0, 3.0), (np.pi, 0.0, 0.0))
# Roll, pitch and yaw themselves, of which the step response is one by one, and the pitch has a limit of its own.
OF_FRAME = ("orientation", "reference orientation", "limits.pitch", "pitch", "step_response.")
DURATION = {"circle": 0.5, "heave_step": 0.3, "recorded_ride": 0.5}


def turned(platform: Mapping[str, Any], frame: Frame) -> dict[str, Any]:
    """The parameters of a platform in another frame; in those that ship the home pose is level."""
    Q = Rotation.from_euler("xyz", frame).as_matrix()
    return {
        "platform_points": np.array(platform["platform_points"]) @ Q,
        "platform_com": np.array(platform["platform_com"]) @ Q,
        "platform_inertia": Q.T @ np.array(platform["platform_inertia"]) @ Q,
        "home_orientation": np.array(frame),
    }


@cache
def shipped(name: str) -> gs.Record:
    return gs.run(name, {"loop.duration": DURATION[name]})


def machine(name: str, frame: Frame) -> dict[str, Any]:
    """The changes that turn the frames of the nominal model and of the machine."""
    metadata = shipped(name).metadata
    nominal, plant = turned(metadata["platform"], frame), turned(metadata["machine"], frame)
    return {
        "loop.duration": DURATION[name],
        "plant.tolerance": 1e-11,
        "limits.reference": "warn",  # splines ring at a step
        **{f"platform.parameters.{key}": value.tolist() for key, value in nominal.items()},
        **{f"plant.parameters.{key}": plant[key].tolist() for key in list(plant)[:3]},
    }


def reference(name: str, frame: Frame, folder: Path, *, as_path: bool) -> dict[str, Any]:
    """The shipped reference in another frame, as a table of poses or through some of them."""
    record = shipped(name)
    angles = Rotation.from_euler("xyz", record["reference.orientation"]) * Rotation.from_euler("xyz", frame)
    columns = {"position": record["reference.position"], "orientation": angles.as_euler("xyz")}
    table = {f"{key}[{k + 1}]": values[:, k] for key, values in columns.items() for k in range(3)}
    # every other row: rounding of second derivatives goes with 1/h²
    poses = polars.DataFrame({"time": record["time"], **table})[::2]
    if as_path:
        rows = poses.drop("time").rows()[poses.height // 5 :: poses.height // 5]
        return {"type": "path", "timing": 1.0, "poses": [list(row) for row in rows]}
    poses.write_csv(folder / "poses.csv")
    return {"type": "file", "file": str(folder / "poses.csv"), "unusual_speed": True}


def shown(report: Any) -> dict[str, FloatArray]:
    """Numbers and curves of a report by name, but those that name an orientation."""
    values = {number.path: np.array(number.value) for number in report.numbers if number.value is not None}
    values = {path: value for path, value in values.items() if not path.startswith(OF_FRAME[2:])}
    for chart in report.charts:
        for series in chart.series:
            if chart.title not in OF_FRAME and series.name not in OF_FRAME:
                values[f"{chart.title}, {series.name}"] = series.values
    return values


def gaps(ours: Mapping[str, FloatArray], theirs: Mapping[str, FloatArray]) -> dict[str, float]:
    """Largest differences, as shares of the largest number or of 1."""
    assert ours.keys() == theirs.keys()
    found = dict[str, float]()
    for name, values in theirs.items():
        finite = np.isfinite(values)
        assert np.array_equal(np.isfinite(ours[name]), finite)
        scale = max(1.0, np.abs(values[finite]).max(initial=0.0))
        found[name] = float(np.abs(ours[name][finite] - values[finite]).max(initial=0.0) / scale)
    return found


@pytest.mark.parametrize(
    ("name", "as_path", "frames"),
    [("circle", False, (HALF, ODD)), ("heave_step", False, (BACK, UPSIDE_DOWN)), ("recorded_ride", True, (HALF, ODD))],
)
def test_checks_runs_and_metrics_are_those_of_the_unturned_machine(
    name: str, as_path: bool, frames: tuple[Frame, ...], tmp_path: Path
) -> None:
    """Expected: the same poses in the frame as shipped; curves have the rounding of second derivatives of splines."""

    def found(frame: Frame) -> dict[str, FloatArray]:
        changes = machine(name, frame) | {"reference": reference(name, frame, tmp_path, as_path=as_path)}
        return shown(gs.run(name, changes).report()) | shown(gs.check(name, changes).report())

    expected = found(AS_SHIPPED)
    for frame in frames:
        is_other_spline = not as_path and frame == ODD
        for path, gap in gaps(found(frame), expected).items():
            limits = (2e-6, 1e-7) if is_other_spline else (1e-8, 1e-9)
            assert gap < limits[", " not in path], (frame, path)


# Frame, what is swept of the turned machine, and of that as shipped.
SWEEPS: tuple[tuple[Frame, dict[str, Any], dict[str, Any]], ...] = (
    (BACK, {"yaw": None, "z": (1.9, 2.2)}, {"yaw": None, "z": (1.9, 2.2)}),
    (HALF, {"yaw": (-np.pi - 0.5, -np.pi + 0.5), "x": None}, {"yaw": (-0.5, 0.5), "x": None}),
    (UPSIDE_DOWN, {"roll": None, "pitch": None}, {"roll": None, "pitch": None}),
    (UPSIDE_DOWN, {"roll": (np.pi - 0.5, np.pi + 0.5), "x": None}, {"roll": (-0.5, 0.5), "x": None}),
)


@pytest.mark.parametrize(("frame", "over", "over_as_shipped"), SWEEPS)
def test_a_workspace_goes_through_half_a_turn(
    frame: Frame, over: dict[str, Any], over_as_shipped: dict[str, Any]
) -> None:
    """Expected: the map of the machine as shipped, with angles from home."""
    platform = gs.load_preset("motion_base")
    ours = gs.sweep(replace(platform, **turned(platform.as_dict(), frame)), over, points=15)
    theirs = gs.sweep(platform, over_as_shipped, points=15)
    home = dict(zip(("roll", "pitch", "yaw"), frame, strict=True))
    home |= {"yaw": home["yaw"] - 2 * np.pi} if isinstance(over.get("yaw"), tuple) and over["yaw"][1] < 0 else {}
    for name, values in theirs.swept.items():
        assert ours.swept[name] - home.get(name, 0.0) == pytest.approx(values, abs=1e-12)
    for name, qualities in theirs.qualities._asdict().items():
        if qualities is not None:
            np.testing.assert_allclose(getattr(ours.qualities, name), qualities, rtol=1e-9, atol=1e-9, err_msg=name)


def test_angles_that_differ_by_a_turn_are_the_same_in_starts_references_and_errors() -> None:
    """Expected: no error and no force, whichever turn start, reference and home are counted in."""
    system = control.ss([], [], [], np.ones((6, 6)) * 1e3, 1e-3)
    follows = gs.LinearController(system, signals=("position", "orientation"))
    for sign in (1, -1):
        changes = machine("heave_step", HALF if sign > 0 else BACK)
        changes |= {"reference": {"type": "hold"}, "start.orientation": [0, 0, -sign * np.pi], "loop.duration": 0.01}
        record = gs.run("heave_step", changes, controller=follows)
        assert np.abs(record["error.orientation"]).max() < 1e-6
        assert np.abs(record["controller.force"] - record["controller.feedforward"]).max() < 1e-3
    ride = {"type": "file", "file": "ride.csv", "at_home": "start"}
    path = {"type": "path", "relative_to": "home", "timing": 1.0, "poses": [[0, 0, 0, 0, 0, 0], [0.1, 0, 0, 0, 0, 0]]}
    for name, moves in (("heave_step", path), ("recorded_ride", ride)):
        changes = machine(name, (0.0, 0.0, 4.0)) | {"reference": moves, "loop.duration": 0.1}
        assert gs.run(name, changes)["reference.orientation"][0] == pytest.approx([0, 0, 4], abs=1e-9)
