"""What public functions take from users, and what they say of the rest: value, expectation, remedy."""

import inspect
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi
import control
import numpy as np
import pytest

import gough_stewart as gs

gs_any: Any = gs  # what a type checker would refuse
SYSTEM = control.ss(-1, 1, 1, 0)
SHORT = {"loop.duration": 0.3}
MOTION_BASE = gs.load_preset("motion_base")
HOME = (MOTION_BASE.home_position, MOTION_BASE.home_orientation)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a run."""
    place = tmp_path_factory.mktemp("run")
    gs.save_record(gs.run("heave_step", SHORT), place)
    return place


WRONG: dict[str, tuple[Callable[[], Any], str]] = {
    "member 3.0": (lambda: gs_any.run("heave_tolerances", member=3.0), "member is 3.0; expected a whole number"),
    "member True": (lambda: gs_any.run("heave_tolerances", member=True), "member is True; expected a whole number"),
    "members 2.5": (lambda: gs_any.ensemble("heave_tolerances", members=2.5), "members is 2.5; expected a whole"),
    "workers '2'": (lambda: gs_any.ensemble("heave_tolerances", workers="2"), "workers is '2'; expected a whole"),
    "a folder as file": (lambda: gs.save_platform(MOTION_BASE, "."), "is a folder; expected a file"),
    "metrics of 3": (lambda: gs_any.metrics(3), "record is 3; expected a Record, or the folder or file of one"),
    "metrics of nothing": (lambda: gs_any.metrics("nowhere"), "nowhere: no such file; expected record.parquet"),
    "identify 3": (lambda: gs_any.identify(3, "motion_base", "platform_mass"), "log is 3; expected a Log, a Record"),
    "cutoff −1": (
        lambda: gs_any.identify("nowhere", "motion_base", "platform_mass", cutoff=-1),
        "cutoff is -1; expected a number of Hz above 0, or a text with one of the units Hz",
    ),
    "one argument": (
        lambda: gs_any.gains_from_bandwidth("2 Hz"),
        "missing a required argument: 'bandwidth'; expected gains_from_bandwidth\\(platform, bandwidth",
    ),
    "bandwidth in mm": (
        lambda: gs_any.gains_from_bandwidth("motion_base", "2 mm"),
        "bandwidth is '2 mm'; expected a number of Hz above 0",
    ),
    "no platform": (lambda: gs_any.leg_jacobian(None, *HOME), "parameters is None; expected a Platform, the name of"),
    "no preset": (lambda: gs_any.leg_jacobian("nope", *HOME), "nope: cannot read this platform file"),
    "two coordinates": (lambda: gs_any.leg_jacobian(MOTION_BASE, [0, 0], HOME[1]), r"position is \[0, 0\]; expected 3"),
    "two legs": (lambda: gs_any.forward_kinematics(MOTION_BASE, [2, 2]), r"leg_length is \[2, 2\]; expected 6"),
    "no state": (lambda: gs_any.inverse_dynamics(MOTION_BASE, None, None), "state is None; expected a State"),
    "an empty stack": (lambda: gs.stack([]), r"parameters is \[\]; expected at least one platform"),
    "a name as system": (lambda: gs.modes("motion_base"), "system is 'motion_base'; expected a python-control"),
    "a number as gains": (lambda: gs_any.pid(3), "gains is 3; expected Gains"),
    "a number as experiment": (lambda: gs_any.run(3), "experiment is 3; expected an Experiment, the name of a shipped"),
    "a number as settings": (lambda: gs_any.run("heave_step", 3), "settings is 3; expected a dict of keys and values"),
    "a number as injection": (lambda: gs_any.run("heave_step", injection=3), "injection is 3; expected a function"),
    "vary 3": (lambda: gs_any.tune("heave_step", 3, "force.peak"), "vary is 3; expected a text, or a list of texts"),
    "minimise 3": (lambda: gs_any.tune("heave_step", ["a=1..2"], 3), "minimise is 3; expected a text"),
    "a seed": (lambda: gs_any.tune("heave_step", ["a=1..2"], "force.peak", seed="a"), "seed is 'a'; expected a whole"),
    "views 3": (lambda: gs_any.view(3), "records is 3; expected a Record, the folder or file of one, or a list"),
    "sweeps text": (lambda: gs_any.sweep("motion_base", "x,y"), "over is 'x,y'; expected a dict by coordinate"),
    "a range in s": (
        lambda: gs_any.sweep("motion_base", {"x": ("0 s", 1), "y": None}),
        r"over\['x'\] is '0 s'; expected a number of m, or a text",
    ),
    "an unknown argument": (lambda: gs_any.run("heave_step", plnat="fmu3"), "unexpected keyword argument 'plnat'"),
    "three arguments": (lambda: gs_any.modes(1, 2, 3), r"too many positional arguments; expected modes\(system\)"),
    "a filter in Hz": (
        lambda: gs_any.gains_from_bandwidth("motion_base", 2, derivative_filter="2 Hz"),
        "derivative_filter is '2 Hz'; expected a number of s above 0, or a text with one of the units s, ms, us, µs",
    ),
    "a damping in words": (
        lambda: gs_any.gains_from_bandwidth("motion_base", 2, "0.5"),
        "damping_ratio is '0.5'; expected a number$",
    ),
    "progress 3": (lambda: gs_any.ensemble("heave_tolerances", progress=3), "progress is 3; expected a function"),
    "estimates": (
        lambda: gs_any.excite("motion_base", ["platform_mass", 2]),
        r"estimate is \['platform_mass', 2\]; expected a text, or a list of texts",
    ),
    "a dict as log": (
        lambda: gs_any.identify({"a": 1}, "motion_base", "platform_mass"),
        r"log is \{'a': 1\}; expected a Log, a Record, a file or folder of one, or a list of them",
    ),
    "a record in a list": (lambda: gs_any.view(["a", 3]), r"records\[1\] is 3; expected a Record, or the folder"),
    "no acceleration": (
        lambda: gs_any.inverse_dynamics(MOTION_BASE, gs.State(*HOME, *np.zeros((2, 3))), None),
        r"acceleration is None; expected an Acceleration\(linear, angular\)",
    ),
    "a word as out": (lambda: gs_any.export("heave_step", out=3), "out is 3; expected a path"),
    "a name as stack": (
        lambda: gs_any.stack("motion_base"),
        "expected a list of platforms, names of presets or platform",
    ),
    "ragged": (
        lambda: gs_any.leg_geometry(MOTION_BASE, [[1], [1, 2]], HOME[1]),
        r"position is \[\[1\], \[1, 2\]\]; expected 3 numbers of m, x, y, z, or an array \(…, 3\)",
    ),
    "booleans": (lambda: gs_any.leg_geometry(MOTION_BASE, [True, True, False], HOME[1]), "expected 3 numbers of m"),
    "an element in s": (
        lambda: gs_any.leg_geometry(MOTION_BASE, [1, "2 m", "3 s"], HOME[1]),
        r"position\[2\] is '3 s'; expected a number of m, or a text",
    ),
    "angles in mm": (
        lambda: gs_any.sweep("motion_base", {"x": (0, 1), "y": None}, {"roll": ["1 deg", "3 mm"]}),
        r"at\['roll'\] is '3 mm'; expected a number of rad, or a text",
    ),
    "angles in m": (
        lambda: gs_any.leg_geometry(MOTION_BASE, HOME[0], [0, "1 m", 0]),
        r"orientation\[1\] is '1 m'; expected a number of rad, or a text",
    ),
    "no bandwidth": (
        lambda: gs_any.gains_from_bandwidth("motion_base", 0),
        "bandwidth is 0; expected a number of Hz above 0",
    ),
    "a number in a stack": (lambda: gs_any.stack([MOTION_BASE, 3]), r"parameters\[1\] is 3; expected a Platform, the"),
    "a long value": (lambda: gs_any.pid("y" * 80), rf"gains is '{'y' * 56}…; expected Gains, or the result of"),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_argument_is_named_with_what_is_expected(what: str) -> None:
    """Expected: an error of the package, which is a ValueError, too."""
    call, says = WRONG[what]
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


def test_files_stand_for_platforms(tmp_path: Path) -> None:
    gs.save_platform(MOTION_BASE, tmp_path / "own.toml")
    for file in (tmp_path / "own.toml", str(tmp_path / "own.toml")):
        assert np.array_equal(gs_any.trim(file).inputs, gs.trim(MOTION_BASE).inputs)


def test_numbers_take_units() -> None:
    """Expected: 2 Hz, however it is written."""
    expected = gs.gains_from_bandwidth(MOTION_BASE, 2.0).proportional
    for bandwidth in ("2 Hz", "0.002 kHz", np.float64(2), 2):
        assert np.allclose(gs_any.gains_from_bandwidth("motion_base", bandwidth).proportional, expected, rtol=1e-12)
    swept = gs_any.sweep("motion_base", {"x": ("-20 mm", "20 mm"), "yaw": None}, {"pitch": "5 deg"}, points=np.int64(3))
    expected_too = gs.sweep(MOTION_BASE, {"x": (-0.02, 0.02), "yaw": None}, {"pitch": np.deg2rad(5)}, points=3)
    assert np.allclose(swept.qualities.condition_number, expected_too.qualities.condition_number, equal_nan=True)


def test_folders_stand_for_records(folder: Path) -> None:
    assert gs_any.metrics(folder) == gs_any.metrics(str(folder / "record.csv")) == gs.metrics(gs.read_record(folder))


def test_whole_numbers_of_numpy_are_whole_numbers() -> None:
    settings = {"loop.duration": 0.01}
    own, theirs = (gs_any.run("heave_tolerances", settings, member=k) for k in (3, np.int64(3)))
    assert own.table.equals(theirs.table)


def test_public_functions_can_be_sent_to_other_processes_and_explain_themselves() -> None:
    assert pickle.loads(pickle.dumps(gs.leg_geometry)) is gs.leg_geometry
    assert list(inspect.signature(gs.run).parameters)[:2] == ["experiment", "settings"]
    assert re.search("Run an experiment", gs.run.__doc__ or "")
