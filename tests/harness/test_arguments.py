"""What each parameter of public functions takes by its name: values as they become, and whole messages of the rest."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi
import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness import arguments
from gough_stewart.harness.arguments import with_checked_arguments
from gough_stewart.model.errors import ArgumentError

MOTION_BASE = gs.load_preset("motion_base")
LOG = gs.Log(np.ones((3, 6)))
UNITS_OF_TIME = "s, ms, us, µs, ns, min"


def function_of(name: str, called: str = "taker") -> Any:
    """A public function with one parameter, which it returns."""
    made: dict[str, Any] = {}
    exec(f"def {called}({name}): return {name}", made)
    return with_checked_arguments(made[called])


def nothing() -> None:
    """A function."""


def with_attributes(*names: str) -> Any:
    return SimpleNamespace(**dict.fromkeys(names))


# Names; values that are taken, and what they become; what is refused; what is expected instead.
RULES: list[tuple[str, list[tuple[Any, Any]], list[Any], str]] = [
    (
        "member members seed workers generations population fresh n hold harmonics trials points max_iterations",
        [(3, 3), (np.int64(-4), -4), (np.uint8(7), 7)],
        [True, 3.0, "3", None],
        "a whole number, such as 3",
    ),
    (
        "bandwidth frequency cutoff",
        [(2, 2.0), ("3 kHz", 3000.0), ("60 rpm", 1.0), (np.float32(0.5), 0.5)],
        [0, -1, "0 Hz", "2 s", True, None, [1]],
        "a number of Hz above 0, or a text with one of the units Hz, kHz, rad/s, rpm",
    ),
    (
        "duration fade sample_time integral_time derivative_filter anti_windup_time",
        [(2, 2.0), ("3 ms", 0.003), ("2 min", 120.0)],
        [0, "-1 s", "2 Hz", False, None],
        f"a number of s above 0, or a text with one of the units {UNITS_OF_TIME}",
    ),
    ("quantile damping_ratio", [(0.95, 0.95), (-1, -1.0)], ["0.5", True, None], "a number"),
    ("progress status warn injection", [(nothing, nothing)], [3, None], "a function"),
    ("out path folder fmu", [("a/b", "a/b"), (Path("a"), Path("a"))], [3, None], "a path"),
    (
        "vary subject_to estimate observations",
        [("a=1..2", ["a=1..2"]), (("a", "b"), ["a", "b"])],
        [3, [1], ["a", 2], None],
        "a text, or a list of texts",
    ),
    ("minimise", [("force.peak", "force.peak")], [3, None], "a text"),
    (
        "settings",
        [("loop.delay=2", ["loop.delay=2"]), ({"loop.delay": 2}, {"loop.delay": 2}), (["a=1"], ["a=1"])],
        [3, None],
        "a dict of keys and values, or texts such as 'loop.duration=1'",
    ),
    (
        "experiment",
        [("heave_step", "heave_step"), (Path("x.toml"), Path("x.toml")), (nothing, nothing)],
        [3, None, SimpleNamespace(other=1)],
        "an Experiment, the name of a shipped one such as 'heave_step', or its TOML file",
    ),
    ("records", [("folder", "folder")], [3, None], "a Record, the folder or file of one, or a list of them"),
    ("record", [], [3, None, SimpleNamespace(other=1)], "a Record, or the folder or file of one"),
    (
        "log",
        [("log.csv", "log.csv"), (["a", "b"], ["a", "b"]), (LOG, LOG)],
        [3, {"a": 1}, None],
        "a Log, a Record, a file or folder of one, or a list of them",
    ),
    ("gains", [], [3, "motion_base"], "Gains, or the result of gains_from_bandwidth"),
    ("system", [], [3, "x"], "a python-control system"),
    ("state", [], [None, with_attributes("position", "orientation")], "a State(position, orientation, …)"),
    ("acceleration", [], [None, with_attributes("linear")], "an Acceleration(linear, angular)"),
    (
        "position",
        [],
        [[1, 2], 3, "x", None, ["a", 1, 2][1:], [1, 2, 3, 4], [True, True, False], [1j, 2, 3], [[1], [1, 2]]],
        "3 numbers of m, x, y, z, or an array (…, 3)",
    ),
    ("orientation", [], [[1, 2], None], "3 numbers of rad, roll, pitch, yaw, or an array (…, 3)"),
    ("leg_length", [], [[1, 2, 3], [[1, 2]], None], "6 numbers of m, one for each leg, or an array (…, 6)"),
    ("over at", [], ["x", 3, None, [1]], "a dict by coordinate, such as {'z': 2.1} or {'x': ('-20 mm', '20 mm')}"),
    (
        "platform parameters nominal found case",
        [("motion_base", MOTION_BASE), (MOTION_BASE, MOTION_BASE)],
        [3, None],
        "a Platform, the name of a preset such as 'motion_base', or a platform file",
    ),
]
CASES = [(name, *rule[1:]) for rule in RULES for name in rule[0].split()]


@pytest.mark.parametrize(("name", "taken", "refused", "expected"), CASES, ids=[case[0] for case in CASES])
def test_a_value_becomes_what_a_function_takes_or_is_refused(
    name: str, taken: list[tuple[Any, Any]], refused: list[Any], expected: str
) -> None:
    """Expected: the table above, with Python's own types, and the whole message."""
    take = function_of(name)
    for given, becomes in taken:
        assert take(given) == becomes
        assert type(take(given)) is type(becomes)
    for given in refused:
        with pytest.raises(ArgumentError) as caught:
            take(given)
        assert str(caught.value) == f"{name} is {given!r}; expected {expected}"


@pytest.mark.parametrize(
    ("name", "attributes"),
    [
        *((name, "platform_points") for name in ("platform", "parameters", "nominal", "found", "case")),
        *[("case", "platform"), ("experiment", "model_dump"), ("record", "metadata"), ("records", "table")],
        *[("log", "leg_length"), ("log", "table"), ("system", "poles"), ("gains", "proportional derivative")],
        *[("acceleration", "linear angular"), ("state", "position orientation velocity angular_velocity")],
    ],
)
def test_a_value_is_known_by_its_attributes(name: str, attributes: str) -> None:
    value = with_attributes(*attributes.split())
    assert function_of(name)(value) is value


def test_vectors_take_texts_with_units_and_arrays_with_leading_axes() -> None:
    """Expected: SI units; what is wrong in a list with its place."""
    take = function_of("position")
    assert take(("1 mm", 2, "3 cm")).tolist() == pytest.approx([1e-3, 2, 0.03])
    assert function_of("orientation")(["180 deg", 0, "1 mrad"]).tolist() == pytest.approx([np.pi, 0, 1e-3])
    symbols = np.array([casadi.SX.sym(axis) for axis in "xyz"])
    for many in (np.arange(24.0).reshape(2, 4, 3), np.ones(3, np.uint8), np.ones((0, 3)), symbols):
        assert take(many) is many
    for no_numbers in (np.array(["1", "2", "3"]), np.ones((3, 2)), np.array(3.0)):
        with pytest.raises(gs.GoughStewartError, match="; expected 3 numbers of m, x, y, z"):
            take(no_numbers)
    with pytest.raises(gs.GoughStewartError, match=r"position\[2\] is '3 s'; expected a number of m, or a text"):
        take([1, "2 m", "3 s"])


def test_coordinates_have_the_units_of_their_kind() -> None:
    """Expected: lengths in m, angles in rad; ranges as pairs; None and unknown keys as they are."""
    given = {"x": ("-20 mm", 0.02), "yaw": "90 deg", "z": "2 cm", "pitch": None, "w": "so"}
    expected = {"x": (-0.02, 0.02), "yaw": pytest.approx(np.pi / 2), "z": 0.02, "pitch": None, "w": "so"}
    for name in ("over", "at"):
        assert function_of(name)(given) == expected
        with pytest.raises(
            gs.GoughStewartError, match=rf"{name}\['roll'\] is '3 mm'; expected a number of rad, or a text"
        ):
            function_of(name)({"roll": ["1 deg", "3 mm"]})


def test_lists_and_files_of_platforms_and_records(tmp_path: Path) -> None:
    """Expected: what is in the file; of a list the one that is none by its number."""
    gs.save_platform(MOTION_BASE, tmp_path / "own.toml")
    for name in ("platform", "case"):
        assert function_of(name)(tmp_path / "own.toml") == function_of(name)(str(tmp_path / "own.toml")) == MOTION_BASE
    stack = function_of("parameters", "stack")
    assert stack(["motion_base", MOTION_BASE]) == [MOTION_BASE, MOTION_BASE]
    with pytest.raises(gs.GoughStewartError, match=r"parameters\[1\] is 3; expected a Platform"):
        stack(["motion_base", 3])
    for given in ("motion_base", 3):
        with pytest.raises(
            gs.GoughStewartError, match="expected a list of platforms, names of presets or platform files"
        ):
            stack(given)
    with pytest.raises(gs.GoughStewartError, match=r"parameters is \[\]; expected at least one platform"):
        stack([])
    record = with_attributes("metadata")
    assert function_of("records")([record, "folder"]) == [record, "folder"]
    with pytest.raises(gs.GoughStewartError, match=r"records\[1\] is 3; expected a Record"):
        function_of("records")(["a", 3])
    # of some functions a name means something else
    assert function_of("record", "frf")("folder") == "folder"
    assert function_of("estimate", "identify")("payload") == "payload"
    with pytest.raises(gs.GoughStewartError, match="nowhere"):
        function_of("record")("nowhere")


def test_a_call_is_checked_whole() -> None:
    """Expected: values by position and by name, defaults as they are; long values shortened; calls written out."""

    def taker(platform: Any, bandwidth: Any = None, *, seed: Any = 1000, **options: Any) -> Any:
        return platform, bandwidth, seed, options

    called = with_checked_arguments(taker)
    assert called("motion_base", "2 kHz", sample_time="1 ms") == (MOTION_BASE, 2000, 1000, {"sample_time": 1e-3})
    assert called(MOTION_BASE, seed=np.int64(3))[2] == 3
    for letters, text in ((58, f"'{'y' * 58}'"), (59, f"'{'y' * 56}…")):  # with quotes 60 and 61
        with pytest.raises(ArgumentError) as caught:
            called(MOTION_BASE, "y" * letters)
        assert str(caught.value).startswith(f"bandwidth is {text}; expected a number of Hz above 0")
    with pytest.raises(ArgumentError) as caught:
        called()
    expected = "expected taker(platform, bandwidth=…, seed=…)"
    assert str(caught.value) == f"taker: missing a required argument: 'platform'; {expected}"
    with pytest.raises(gs.GoughStewartError, match="too many positional arguments; expected taker"):
        called(MOTION_BASE, 1, 2)
    # an equal value that is not the default is taken by its name
    with pytest.raises(gs.GoughStewartError, match=r"seed is 1000\.0; expected a whole number"):
        called(MOTION_BASE, seed=1000.0)


def test_public_functions_are_found_here_by_pickles_and_nothing_else_is() -> None:
    """Expected: the public function itself; what modules have by themselves, and unknown names, are refused."""
    assert arguments.leg_geometry is gs.leg_geometry
    for name in ("__path__", "__version__", "nothing"):
        with pytest.raises(AttributeError, match=f"module 'gough_stewart.harness.arguments' has no attribute '{name}'"):
            getattr(arguments, name)
    called = function_of("title", "made_here")
    assert (called.__module__, called.__qualname__, called.__name__) == (arguments.__name__, "made_here", "made_here")
