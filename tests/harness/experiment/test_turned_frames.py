"""A platform whose frame is fixed to it in another way is the same machine: only what names an orientation differs.

With p′ = Qᵀ p for joints and centre of mass, J′ = Qᵀ J Q for the inertia and R′ = R Q for orientations, all legs,
forces, errors and margins are those of before.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import control
import numpy as np
import polars
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from gough_stewart.harness.report.chart import Chart
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.view.view import view_report
from gough_stewart.harness.workspace.workspace_report import workspace_report
from tests.support.exported import Exported, source_of
from tests.support.laws import law_of

FloatArray = NDArray[np.float64]


AS_SHIPPED = (0.0, 0.0, 0.0)
HALF, BACK, ODD, UPSIDE_DOWN = FRAMES = ((0.0, 0.0, np.pi), (0.0, 0.0, -np.pi), (0.0, 0.0, 3.0), (np.pi, 0.0, 0.0))
Frame = tuple[float, float, float]
# The shipped experiments whose references differ, with durations [s] that show them.
SHIPPED = {
    **{"circle": 1.0, "excitation": 1.0, "fastest_path": 1.0, "heave_step": 0.4, "heave_tolerances": 0.4},
    **{"impulse": 0.6, "pitch_sine": 1.0, "recorded_ride": 1.0, "saturation": 0.4, "too_slow": 0.8},
}
# Those whose poses are those of a path, with its timing.
PATHS = {"circle": 1.0, "excitation": 1.5, "fastest_path": "fastest", "pitch_sine": 1.0, "recorded_ride": 1.0}
# Those that are quick; the others are evidence.
ALWAYS = ("circle", "heave_step", "pitch_sine", "recorded_ride")
# Roll, pitch and yaw themselves, of which the step response is one by one, and the pitch has a limit of its own.
OF_FRAME = ("orientation", "reference orientation", "limits.pitch", "pitch", "step_response.")


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
    return gs.run(name, {"loop.duration": SHIPPED[name]})


def machine(name: str, frame: Frame) -> dict[str, Any]:
    """The changes that turn the frames of the nominal model and of the machine."""
    known = shipped(name).metadata
    nominal, plant = turned(known["platform"], frame), turned(known["machine"], frame)
    return {
        "loop.duration": SHIPPED[name],
        "plant.tolerance": 1e-11,
        "limits.reference": "warn",  # splines ring at a step
        **{f"platform.parameters.{key}": value.tolist() for key, value in nominal.items()},
        **{f"plant.parameters.{key}": plant[key].tolist() for key in list(plant)[:3]},
    }


def poses(name: str, frame: Frame) -> polars.DataFrame:
    """The shipped reference as a table of poses in another frame."""
    record = shipped(name)
    angles = Rotation.from_euler("xyz", record["reference.orientation"]) * Rotation.from_euler("xyz", frame)
    columns = {"position": record["reference.position"], "orientation": angles.as_euler("xyz")}
    table = {f"{key}[{k + 1}]": values[:, k] for key, values in columns.items() for k in range(3)}
    return polars.DataFrame({"time": record["time"], **table})[::2]  # rounding of second derivatives goes with 1/h²


def as_recorded(name: str, frame: Frame, folder: Path) -> dict[str, Any]:
    poses(name, frame).write_csv(folder / "poses.csv")
    return {"type": "file", "file": str(folder / "poses.csv"), "unusual_speed": True}


def as_path(name: str, frame: Frame, _folder: Path) -> dict[str, Any]:
    rows = poses(name, frame).drop("time").rows()
    return {
        "type": "path",
        "timing": PATHS[name],
        "poses": [list(row) for row in rows[len(rows) // 5 :: len(rows) // 5]],
    }


def shown(report: Report) -> Iterator[tuple[str, FloatArray]]:
    """Numbers and curves of a report and its page by name, but those that name an orientation."""
    for number in report.numbers:
        if number.value is not None and not number.path.startswith(OF_FRAME[2:]):
            yield number.path, np.array(number.value)
    for chart in report.charts:
        for series in chart.series:
            if chart.title not in OF_FRAME and series.name not in OF_FRAME:
                yield f"{chart.title}, {series.name}", series.values


def gaps(ours: Mapping[str, FloatArray], theirs: Mapping[str, FloatArray]) -> dict[str, float]:
    """Largest differences, as shares of the largest number or of 1."""
    assert ours.keys() == theirs.keys()
    same = [(name, ours[name], values, np.isfinite(values)) for name, values in theirs.items()]
    assert all(np.array_equal(np.isfinite(one), known) for _, one, _, known in same)
    scales = [max(1.0, np.abs(values[known]).max(initial=0.0)) for _, _, values, known in same]
    differences = [np.abs(one[known] - values[known]).max(initial=0.0) for _, one, values, known in same]
    return {name: gap / scale for (name, *_), gap, scale in zip(same, differences, scales, strict=True)}


@pytest.mark.parametrize(
    ("name", "how"),
    [
        pytest.param(name, how, marks=() if name in ALWAYS else pytest.mark.evidence)
        for how, names in ((as_recorded, SHIPPED), (as_path, PATHS))
        for name in names
    ],
)
def test_checks_runs_metrics_and_pages_are_those_of_the_unturned_machine(
    name: str, how: Callable[[str, Frame, Path], dict[str, Any]], tmp_path: Path
) -> None:
    """Expected: the same poses in the frame as shipped; curves have the rounding of second derivatives of splines.

    Between the rows of a table, splines through the angles of another frame differ, where 3 rad mix roll and pitch.
    """

    def found(frame: Frame) -> dict[str, FloatArray]:
        changes = machine(name, frame) | {"reference": how(name, frame, tmp_path)}
        return dict(shown(gs.run(name, changes).report())) | dict(shown(gs.check(name, changes).report()))

    expected = found(AS_SHIPPED)
    for frame in FRAMES:
        is_other_spline = how is as_recorded and frame == ODD
        worst = gaps(found(frame), expected)
        curves = {of: gap for of, gap in worst.items() if ", " in of}
        numbers = {of: gap for of, gap in worst.items() if of not in curves}
        assert max(numbers.values()) < (1e-7 if is_other_spline else 1e-9), (frame, numbers)
        assert max(curves.values()) < (2e-6 if is_other_spline else 1e-8), (frame, curves)


@pytest.mark.parametrize("timing", [4.0, pytest.param("fastest", marks=pytest.mark.evidence)])
def test_a_path_through_half_a_turn_is_that_through_zero(timing: Any) -> None:
    """Expected: the check of the machine as shipped, from a yaw of −5° to 6° around home, 0 between knots."""
    poses = [[0, 0, 0, 0, 0, np.radians(yaw)] for yaw in (-5, 6)]
    path = {"type": "path", "relative_to": "home", "timing": timing, "poses": poses}
    changes = {"reference": path, "loop.duration": 4.0, "loop.sample_time": 0.004}
    found = [
        dict(shown(gs.check("heave_step", machine("heave_step", frame) | changes).report()))
        for frame in (AS_SHIPPED, HALF, BACK)
    ]
    assert max(max(gaps(each, found[0]).values()) for each in found[1:]) < 1e-8


def test_references_are_counted_in_the_turns_of_home() -> None:
    """Expected: a first yaw of 4 rad, as home has it, and not of 4 rad − 2π; of a path and of a recorded motion."""
    ride = {"type": "file", "file": "ride.csv", "at_home": "start"}
    path = {"type": "path", "relative_to": "home", "timing": 1.0, "poses": [[0, 0, 0, 0, 0, 0], [0.1, 0, 0, 0, 0, 0]]}
    for name, reference in (("heave_step", path), ("recorded_ride", ride)):
        changes = machine(name, (0.0, 0.0, 4.0)) | {"reference": reference, "loop.duration": 0.1}
        assert gs.run(name, changes)["reference.orientation"][0] == pytest.approx([0, 0, 4], abs=1e-9)


def test_an_open_loop_is_that_of_the_unturned_machine() -> None:
    """Expected: the record as shipped, whose angles are turned; the paper's case, which starts askew."""
    shipped_record = gs.run("paper_open_loop")
    for frame in FRAMES:
        start = Rotation.from_euler("z", -0.1) * Rotation.from_euler("xyz", frame)
        parameters = turned(shipped_record.metadata["platform"], frame)
        changes = {f"platform.parameters.{key}": value.tolist() for key, value in parameters.items()}
        record = gs.run("paper_open_loop", changes | {"start.orientation": start.as_euler("xyz").tolist()})
        assert max(gaps(dict(shown(record.report())), dict(shown(shipped_record.report()))).values()) < 1e-8


# Frame, what is swept of the turned machine, and of that as shipped.
SWEEPS: tuple[tuple[Frame, dict[str, Any], dict[str, Any]], ...] = (
    (HALF, {"yaw": None, "x": None}, {"yaw": None, "x": None}),
    (BACK, {"yaw": None, "z": (1.9, 2.2)}, {"yaw": None, "z": (1.9, 2.2)}),
    (HALF, {"yaw": (-np.pi - 0.5, -np.pi + 0.5), "x": None}, {"yaw": (-0.5, 0.5), "x": None}),
    (ODD, {"yaw": (2.2, 3.8), "y": None}, {"yaw": (-0.8, 0.8), "y": None}),
    (UPSIDE_DOWN, {"roll": None, "pitch": None}, {"roll": None, "pitch": None}),
    (UPSIDE_DOWN, {"roll": (np.pi - 0.5, np.pi + 0.5), "x": None}, {"roll": (-0.5, 0.5), "x": None}),
)


@pytest.mark.parametrize(("frame", "over", "over_as_shipped"), SWEEPS)
def test_a_workspace_goes_through_half_a_turn(
    frame: Frame, over: dict[str, Any], over_as_shipped: dict[str, Any]
) -> None:
    """Expected: the map of the machine as shipped, with angles from home, home in the same place, and no open end."""
    platform = gs.load_preset("motion_base")
    ours = gs.sweep(replace(platform, **turned(platform.as_dict(), frame)), over, points=21)
    theirs = gs.sweep(platform, over_as_shipped, points=21)
    home = dict(zip(("roll", "pitch", "yaw"), frame, strict=True))
    home |= {"yaw": home["yaw"] - 2 * np.pi} if isinstance(over.get("yaw"), tuple) and over["yaw"][1] < 0 else {}
    for name, values in theirs.swept.items():
        assert ours.swept[name] - home.get(name, 0.0) == pytest.approx(values, abs=1e-12)
    for name, qualities in theirs.qualities._asdict().items():
        if qualities is not None:
            np.testing.assert_allclose(getattr(ours.qualities, name), qualities, rtol=1e-9, atol=1e-9, err_msg=name)
    reports = [workspace_report(each) for each in (ours, theirs)]
    assert max(gaps(*(dict(shown(each)) for each in reports)).values()) < 1e-9
    points = [[np.array(chart.map.point) for chart in each.charts if chart.map] for each in reports]
    turn = [home.get(name, 0.0) for name in theirs.swept]
    assert all(ours_at - theirs_at == pytest.approx(turn) for ours_at, theirs_at in zip(*points, strict=True))
    assert len({each.verdict.text.count(" or more") for each in reports}) == 1


def test_a_range_of_angles_is_bounded() -> None:
    """Expected: half a turn on either side of 0, and a whole one if the frame is turned round."""
    platform = gs.load_preset("motion_base")
    around = replace(platform, **turned(platform.as_dict(), HALF))
    for machine_of, most in ((platform, 180), (around, 360)):
        with pytest.raises(gs.GoughStewartError, match=f"expected from −{most}° to {most}°"):
            gs.sweep(machine_of, {"x": (-0.1, 0.1), "yaw": (3.0, 6.3)})


def test_angles_that_differ_by_a_turn_are_the_same_in_starts_errors_and_comparisons() -> None:
    """Expected: no error and no difference, whichever turn start, reference and home are counted in."""
    system = control.ss([], [], [], np.ones((6, 6)) * 1e3, 1e-3)
    follows = gs.LinearController(system, signals=("position", "orientation"))
    records = []
    for sign in (1, -1):
        changes = machine("heave_step", HALF if sign > 0 else BACK)
        changes |= {"reference": {"type": "hold"}, "start.orientation": [0, 0, -sign * np.pi], "loop.duration": 0.01}
        records.append(gs.run("heave_step", changes, controller=follows))
        assert np.abs(records[-1]["error.orientation"]).max() < 1e-6
        assert np.abs(records[-1]["controller.force"] - records[-1]["controller.feedforward"]).max() < 1e-3
    (section,) = (each for each in view_report(records, ["a", "b"]).sections if each.title == "Differences from a")
    charts = {chart.title: chart.series for chart in section.parts if isinstance(chart, Chart)}
    for title in ("orientation error, difference", "orientation from home, difference"):
        assert max(np.abs(series.values).max() for series in charts[title]) < 1e-9


def test_a_controller_of_orientations_sees_them_in_the_turns_of_their_reference() -> None:
    """Expected: of readings a turn away the forces of those beside the reference, in NumPy and in C."""
    rng = np.random.default_rng(4)
    system = control.ss([], [], [], rng.normal(size=(6, 6)), 1e-3)
    follows = gs.LinearController(system, signals=("position", "orientation"))
    experiment = gs.load_experiment("heave_step", machine("heave_step", HALF) | {"reference": {"type": "hold"}})
    source = source_of(experiment, follows)
    pose = np.array([0.0, 0.0, 2.01, 0.01, 0.02, np.pi + 0.03])
    far = pose - [0, 0, 0, 0, 0, 2 * np.pi]
    in_c = [Exported(source).start().step(each)[0] for each in (pose, far)]
    reference = np.concatenate([shipped("heave_step")["reference.position"][0], HALF, np.zeros(24)])
    signals = [np.concatenate([each, np.zeros(18)]) for each in (pose, far)]
    laws = [law_of(follows, 1e-3, np.zeros((0, 6, 6)), reference, each) for each in signals]
    near, away = (law.force(0, 0.0, reference, each, np.zeros(6)) for law, each in zip(laws, signals, strict=True))
    assert np.array([away, in_c[1]]) == pytest.approx(np.array([near, in_c[0]]), abs=1e-9)
    assert np.abs(near).max() > 1e-3
