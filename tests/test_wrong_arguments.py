"""What public functions take from users, and what they say of the rest: value, expectation, remedy."""

import inspect
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest

import gough_stewart as gs

gs_any: Any = gs  # what a type checker would refuse
MOTION_BASE = gs.load_preset("motion_base")
HOME = (MOTION_BASE.home_position, MOTION_BASE.home_orientation)
REST = gs.State(*HOME, np.zeros(3), np.zeros(3))


WRONG: tuple[tuple[Callable[[], Any], str], ...] = (
    (lambda: gs_any.run("heave_tolerances", member=3.0), "member is 3.0; expected a whole number"),
    (lambda: gs_any.run("heave_tolerances", member=True), "member is True; expected a whole number"),
    (lambda: gs_any.excite("motion_base", "platform_mass", harmonics=2.0), "harmonics is 2.0; expected a whole"),
    (lambda: gs_any.excite("motion_base", "platform_mass", trials="2"), "trials is '2'; expected a whole"),
    (lambda: gs_any.forward_kinematics("motion_base", [2] * 6, max_iterations=2.0), "max_iterations is 2.0; expected"),
    (lambda: gs.save_platform(MOTION_BASE, "."), "is a folder; expected a file"),
    (lambda: gs.ensemble("heave_step", resume=True), "resume is True and out is None; expected the interrupted run's"),
    (lambda: gs_any.metrics(3), "record is 3; expected a Record, or the folder or file of one"),
    (lambda: gs_any.metrics("nowhere"), "nowhere: no such file; expected record.parquet"),
    (
        lambda: gs_any.identify("nowhere", "motion_base", "platform_mass", cutoff=-1),
        "cutoff is -1; expected a number of Hz above 0, or a text with one of the units Hz",
    ),
    (
        lambda: gs_any.gains_from_bandwidth("2 Hz"),
        "missing a required argument: 'bandwidth'; expected gains_from_bandwidth\\(platform, bandwidth",
    ),
    (lambda: gs_any.leg_jacobian(None, *HOME), "parameters is None; expected a Platform, the name of"),
    (lambda: gs_any.leg_jacobian("nope", *HOME), "nope: cannot read this platform file"),
    (lambda: gs_any.leg_jacobian(MOTION_BASE, [0, 0], HOME[1]), r"position is \[0, 0\]; expected 3"),
    (lambda: gs_any.inverse_dynamics(MOTION_BASE, None, None), "state is None; expected a State"),
    (lambda: gs_any.inverse_dynamics(MOTION_BASE, REST, gs_any.Acceleration([0], 0)), r"acceleration.linear is \[0\]"),
    (lambda: gs_any.static_leg_forces(MOTION_BASE, *HOME, [1, 2, 3]), r"external_wrench is \[1, 2, 3\]; expected 6"),
    (lambda: gs.mass_matrix(MOTION_BASE, *map(np.zeros, ((5, 3), (4, 3)))), r"\(5, 3\), and orientation \(4, 3\); exp"),
    (lambda: gs.stack([]), r"parameters is \[\]; expected at least one platform"),
    (lambda: gs.modes("motion_base"), "system is 'motion_base'; expected a python-control"),
    (lambda: gs_any.run(3), "experiment is 3; expected an Experiment, the name of a shipped"),
    (lambda: gs_any.run("heave_step", 3), "settings is 3; expected a dict of keys and values"),
    (lambda: gs_any.run("heave_step", injection=3), "injection is 3; expected a function"),
    (lambda: gs_any.tune("heave_step", ["a=1..2"], 3), "minimise is 3; expected a text"),
    (lambda: gs_any.view(3), "records is 3; expected a Record, the folder or file of one, or a list"),
    (lambda: gs_any.sweep("motion_base", "x,y"), "over is 'x,y'; expected a dict by coordinate"),
    (lambda: gs_any.sweep("motion_base", {"x": None}, {"roll": ["1 deg", "3 mm"]}), r"at\['roll'\] is '3 mm'; expec"),
    (
        lambda: gs_any.sweep("motion_base", {"x": ("0 s", 1), "y": None}),
        r"over\['x'\] is '0 s'; expected a number of m, or a text",
    ),
    (lambda: gs_any.run("heave_step", plnat="fmu3"), "unexpected keyword argument 'plnat'"),
    (lambda: gs_any.modes(1, 2, 3), r"too many positional arguments; expected modes\(system\)"),
    (
        lambda: gs_any.gains_from_bandwidth("motion_base", 2, derivative_filter="2 Hz"),
        "derivative_filter is '2 Hz'; expected a number of s above 0, or a text with one of the units s, ms, us, µs",
    ),
    (lambda: gs_any.gains_from_bandwidth("motion_base", 2, "0.5"), "damping_ratio is '0.5'; expected a number$"),
    (
        lambda: gs_any.excite("motion_base", ["platform_mass", 2]),
        r"estimate is \['platform_mass', 2\]; expected a text, or a list of texts",
    ),
    (
        lambda: gs_any.identify({"a": 1}, "motion_base", "platform_mass"),
        r"log is \{'a': 1\}; expected a Log, a Record, a file or folder of one, or a list of them",
    ),
    (lambda: gs_any.view(["a", 3]), r"records\[1\] is 3; expected a Record, or the folder"),
    (lambda: gs_any.export("heave_step", out=3), "out is 3; expected a path"),
    (lambda: gs_any.stack("motion_base"), "expected a list of platforms, names of presets or platform"),
    (
        lambda: gs_any.leg_geometry(MOTION_BASE, [[1], [1, 2]], HOME[1]),
        r"position is \[\[1\], \[1, 2\]\]; expected 3 numbers of m, x, y, z, or an array \(…, 3\)",
    ),
    (lambda: gs_any.leg_geometry(MOTION_BASE, [True, True, False], HOME[1]), "expected 3 numbers of m"),
    (
        lambda: gs_any.leg_geometry(MOTION_BASE, HOME[0], [0, "1 m", 0]),
        r"orientation\[1\] is '1 m'; expected a number of rad, or a text",
    ),
    (lambda: gs_any.gains_from_bandwidth("motion_base", 0), "bandwidth is 0; expected a number of Hz above 0"),
    (lambda: gs_any.stack([MOTION_BASE, 3]), r"parameters\[1\] is 3; expected a Platform, the"),
    (lambda: gs_any.pid("y" * 80), rf"gains is '{'y' * 56}…; expected Gains, or the result of"),
)


@pytest.mark.parametrize(("call", "says"), WRONG, ids=[says for _, says in WRONG])
def test_a_wrong_argument_is_named_with_what_is_expected(call: Callable[[], Any], says: str) -> None:
    """Expected: an error of the package, which is a ValueError, too."""
    with pytest.raises(gs.GoughStewartError, match=says) as caught:
        call()
    assert isinstance(caught.value, ValueError)


def test_names_of_presets_stand_for_platforms() -> None:
    """Expected: what the platform itself gives."""
    assert np.array_equal(gs_any.leg_jacobian("motion_base", *HOME), gs.leg_jacobian(MOTION_BASE, *HOME))
    length = gs.leg_geometry(MOTION_BASE, *HOME).length
    place = ["0 mm", 0, f"{1e3 * HOME[0][2]} mm"]
    assert np.array_equal(gs_any.leg_geometry("motion_base", place, [0, 0, 0]).length, length)
    assert gs_any.stack(["motion_base", MOTION_BASE]).base_points.shape == (2, 6, 3)
    assert len(gs_any.trim("motion_base").state) == 12
    # arrays over leading axes, and symbols of CasADi, stay as they are
    many = np.broadcast_to(HOME[0], (2, 4, 3))
    assert gs.leg_geometry(MOTION_BASE, many, HOME[1]).length.shape == (2, 4, 6)
    symbols = np.array([[casadi.SX.sym(axis) for axis in "xyz"]])
    assert gs_any.leg_geometry(MOTION_BASE, symbols, np.zeros((1, 3))).length.dtype == object


def test_files_stand_for_platforms_and_folders_for_records(tmp_path: Path) -> None:
    gs.save_platform(MOTION_BASE, tmp_path / "own.toml")
    for file in (tmp_path / "own.toml", str(tmp_path / "own.toml")):
        assert np.array_equal(gs_any.trim(file).inputs, gs.trim(MOTION_BASE).inputs)
    gs.save_record(gs.run("heave_step", {"loop.duration": 0.3}), tmp_path)
    expected = gs.metrics(gs.read_record(tmp_path))
    assert gs_any.metrics(tmp_path) == gs_any.metrics(str(tmp_path / "record.csv")) == expected


def test_numbers_take_units() -> None:
    """Expected: 2 Hz, however it is written."""
    expected = gs.gains_from_bandwidth(MOTION_BASE, 2.0).proportional
    for bandwidth in ("2 Hz", "0.002 kHz", np.float64(2), 2):
        assert np.allclose(gs_any.gains_from_bandwidth("motion_base", bandwidth).proportional, expected, rtol=1e-12)
    swept = gs_any.sweep("motion_base", {"x": ("-20 mm", "20 mm"), "yaw": None}, {"pitch": "5 deg"}, points=np.int64(3))
    expected_too = gs.sweep(MOTION_BASE, {"x": (-0.02, 0.02), "yaw": None}, {"pitch": np.deg2rad(5)}, points=3)
    assert np.allclose(swept.qualities.condition_number, expected_too.qualities.condition_number, equal_nan=True)


def test_whole_numbers_of_numpy_are_whole_numbers() -> None:
    settings = {"loop.duration": 0.01}
    own, theirs = (gs_any.run("heave_tolerances", settings, member=k) for k in (3, np.int64(3)))
    assert own.table.equals(theirs.table)


def test_public_functions_can_be_sent_to_other_processes_and_explain_themselves() -> None:
    assert pickle.loads(pickle.dumps(gs.leg_geometry)) is gs.leg_geometry
    assert list(inspect.signature(gs.run).parameters)[:2] == ["experiment", "settings"]
    assert re.search("Run an experiment", gs.run.__doc__ or "")
