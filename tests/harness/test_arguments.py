"""What each parameter of public functions takes by its name: values as they become, and whole messages of the rest."""

from collections.abc import Sequence
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
RECORD = gs.run("heave_step", {"loop.duration": 0.01, "reference.at": 0.005})


def function_of(name: str, called: str = "taker") -> Any:
    """A public function with one parameter, which it returns."""
    made: dict[str, Any] = {}
    exec(f"def {called}({name}): return {name}", made)
    return with_checked_arguments(made[called])


def nothing() -> None:
    """A function."""


WHOLE = (
    *("member", "members", "seed", "workers", "generations", "population", "fresh"),
    *("harmonics", "trials", "points", "max_iterations"),
)
HERTZ, FUNCTIONS = ("bandwidth", "frequency", "cutoff"), ("progress", "status", "warn", "injection")
SECONDS = ("duration", "fade", "sample_time", "integral_time", "derivative_filter", "anti_windup_time")
PATHS, TEXTS = ("out", "path", "folder", "fmu"), ("vary", "subject_to", "estimate")
PLATFORMS = ("platform", "parameters", "nominal", "found")
# By name: what is given, and what it becomes.
TAKEN: dict[str, Sequence[tuple[Any, Any]]] = {
    **dict.fromkeys(WHOLE, ((3, 3), (np.int64(-4), -4), (np.uint8(7), 7))),
    **dict.fromkeys(HERTZ, ((2, 2.0), ("3 kHz", 3000.0), ("60 rpm", 1.0), (np.float32(0.5), 0.5))),
    **dict.fromkeys(SECONDS, ((2, 2.0), ("3 ms", 0.003), ("2 min", 120.0))),
    "quantile": [(0.95, 0.95), (-1, -1.0)],
    "damping_ratio": [(0.7, 0.7)],
    **dict.fromkeys(FUNCTIONS, ((nothing, nothing),)),
    **dict.fromkeys(PATHS, (("a/b", "a/b"), (Path("a"), Path("a")))),
    **dict.fromkeys(TEXTS, (("a=1..2", ["a=1..2"]), (("a", "b", "c"), ["a", "b", "c"]))),
    "minimise": [("force.peak", "force.peak")],
    "settings": [("loop.delay=2", ["loop.delay=2"]), ({"loop.delay": 2}, {"loop.delay": 2}), (["a=1"], ["a=1"])],
    "experiment": [("heave_step", "heave_step"), (Path("x.toml"), Path("x.toml")), (nothing, nothing)],
    "records": [("folder", "folder"), ([RECORD, "folder"], [RECORD, "folder"])],
    "log": [("log.csv", "log.csv"), (RECORD, RECORD), (["a", "b"], ["a", "b"])],
    "record": [(RECORD, RECORD)],
}
EXPECTED = {
    **dict.fromkeys(WHOLE, "a whole number, such as 3"),
    **dict.fromkeys(HERTZ, "a number of Hz above 0, or a text with one of the units Hz, kHz, rad/s, rpm"),
    **dict.fromkeys(SECONDS, "a number of s above 0, or a text with one of the units s, ms, us, µs, ns, min"),
    **dict.fromkeys(("quantile", "damping_ratio"), "a number"),
    **dict.fromkeys(FUNCTIONS, "a function"),
    **dict.fromkeys(PATHS, "a path"),
    **dict.fromkeys(TEXTS, "a text, or a list of texts"),
    **dict.fromkeys(PLATFORMS, "a Platform, the name of a preset such as 'motion_base', or a platform file"),
    "case": "a Platform, the name of a preset such as 'motion_base', or a platform file",
    "minimise": "a text",
    "settings": "a dict of keys and values, or texts such as 'loop.duration=1'",
    "experiment": "an Experiment, the name of a shipped one such as 'heave_step', or its TOML file",
    "record": "a Record, or the folder or file of one",
    "records": "a Record, the folder or file of one, or a list of them",
    "log": "a Log, a Record, a file or folder of one, or a list of them",
    "state": "a State(position, orientation, …)",
    "acceleration": "an Acceleration(linear, angular)",
    "gains": "Gains, or the result of gains_from_bandwidth",
    "system": "a python-control system",
    "position": "3 numbers of m, x, y, z, or an array (…, 3)",
    "orientation": "3 numbers of rad, roll, pitch, yaw, or an array (…, 3)",
    "leg_length": "6 numbers of m, one for each leg, or an array (…, 6)",
    **dict.fromkeys(("over", "at"), "a dict by coordinate, such as {'z': 2.1} or {'x': ('-20 mm', '20 mm')}"),
}
WRONG: dict[str, Sequence[Any]] = {
    **dict.fromkeys(WHOLE, (True, 3.0, "3", None)),
    **dict.fromkeys(HERTZ, (0, -1, "0 Hz", "2 s", True, None, [1])),
    **dict.fromkeys(SECONDS, (0, "-1 s", "2 Hz", False, None)),
    **dict.fromkeys(("quantile", "damping_ratio"), ("0.5", True, None)),
    **dict.fromkeys(TEXTS, (3, [1], ["a", 2], None)),
    "settings": [3, None],
    "records": [3, None],
    "log": [3, {"a": 1}, None],
    "gains": [3, "motion_base"],
    "system": [3, "x"],
    "state": [None, 3],
    "acceleration": [None, [1, 2]],
    "position": [[1, 2], 3, "x", None, ["a", 1, 2][1:], [1, 2, 3, 4], [True, True, False], [1j, 2, 3], [[1], [1, 2]]],
    "orientation": [[1, 2], None],
    "leg_length": [[1, 2, 3], [[1, 2]], None],
    **dict.fromkeys(("over", "at"), ("x", 3, None, [1])),
}


@pytest.mark.parametrize("name", TAKEN)
def test_a_value_becomes_what_a_function_takes(name: str) -> None:
    """Expected: as written above, with Python's own types."""
    for given, expected in TAKEN[name]:
        found = function_of(name)(given)
        assert found == expected
        assert type(found) is type(expected)


@pytest.mark.parametrize("name", EXPECTED)
def test_anything_else_is_refused_by_name_value_and_expectation(name: str) -> None:
    """Expected: the whole message."""
    for given in WRONG.get(name, [3, None]):
        with pytest.raises(ArgumentError) as caught:
            function_of(name)(given)
        assert str(caught.value) == f"{name} is {given!r}; expected {EXPECTED[name]}"


# By name: the attributes by which a value is known.
KNOWN_BY = {
    **{name: ["platform_points"] for name in PLATFORMS},
    "experiment": ["model_dump"],
    "record": ["metadata"],
    "state": ["position", "orientation", "velocity", "angular_velocity"],
    "acceleration": ["linear", "angular"],
    "gains": ["proportional", "derivative"],
    "system": ["poles"],
}


@pytest.mark.parametrize("name", KNOWN_BY)
def test_a_value_is_known_by_all_of_its_attributes_and_no_others(name: str) -> None:
    """Expected: what has just these attributes passes; without any one of them it does not."""
    attributes = dict.fromkeys(KNOWN_BY[name])
    whole = SimpleNamespace(**attributes)
    assert function_of(name)(whole) is whole
    for left_out in attributes:
        rest = SimpleNamespace(other=1, **{key: None for key in attributes if key != left_out})
        with pytest.raises(ArgumentError, match=f"{name} is .*; expected "):
            function_of(name)(rest)


@pytest.mark.parametrize(
    ("name", "attribute"),
    [("case", "platform"), ("case", "platform_points"), ("log", "leg_length"), ("log", "table"), ("records", "table")],
)
def test_one_of_two_attributes_is_enough(name: str, attribute: str) -> None:
    value = SimpleNamespace(**{attribute: None})
    assert function_of(name)(value) is value
    with pytest.raises(ArgumentError, match=f"{name} is "):
        function_of(name)(SimpleNamespace(leg_velocity=None, plant=None))


def test_logs_are_listed_by_anything_but_a_dict() -> None:
    log = gs.Log(np.ones((3, 6)))
    for several in ([RECORD, log], (log,), iter([log])):
        assert function_of("log")(several) is several
    assert function_of("log")(log) is log


def test_vectors_take_texts_with_units_and_arrays_with_leading_axes() -> None:
    """Expected: SI units; what is wrong in a list with its place."""
    assert function_of("position")(["1 mm", 2, "3 cm"]).tolist() == pytest.approx([1e-3, 2, 0.03])
    assert function_of("orientation")(["180 deg", 0, "1 mrad"]).tolist() == pytest.approx([np.pi, 0, 1e-3])
    assert function_of("leg_length")([*["2 m"] * 5, "25 cm"]).tolist() == pytest.approx([2] * 5 + [0.25])
    assert function_of("position")(("1 mm", 2, "3 cm")).tolist() == pytest.approx([1e-3, 2, 0.03])
    for many in (np.arange(24.0).reshape(2, 4, 3), np.ones(3, np.uint8), np.ones((0, 3)), np.ones(3, np.float32)):
        assert function_of("position")(many) is many
    symbols = np.array([casadi.SX.sym(each) for each in "xyz"])
    assert function_of("position")(symbols) is symbols
    for no_numbers in (np.array(["1", "2", "3"]), np.ones(3, complex), np.ones((3, 2)), np.array(3.0)):
        with pytest.raises(ArgumentError, match="; expected 3 numbers of m, x, y, z"):
            function_of("position")(no_numbers)
    with pytest.raises(ArgumentError, match=r"position\[2\] is '3 s'; expected a number of m, or a text"):
        function_of("position")([1, "2 m", "3 s"])


def test_coordinates_have_the_units_of_their_kind() -> None:
    """Expected: lengths in m, angles in rad; ranges as pairs; None and unknown keys as they are."""
    for name in ("over", "at"):
        taken = function_of(name)({"x": ("-20 mm", 0.02), "yaw": "90 deg", "z": "2 cm", "pitch": None, "w": "so"})
        assert taken == {
            "x": (pytest.approx(-0.02), 0.02),
            "yaw": pytest.approx(np.pi / 2),
            "z": pytest.approx(0.02),
            "pitch": None,
            "w": "so",
        }
        with pytest.raises(ArgumentError, match=rf"{name}\['roll'\] is '3 mm'; expected a number of rad, or a text"):
            function_of(name)({"roll": ["1 deg", "3 mm"]})


@pytest.mark.parametrize("name", [*PLATFORMS, "case"])
def test_platforms_come_from_presets_files_and_objects(name: str, tmp_path: Path) -> None:
    gs.save_platform(MOTION_BASE, tmp_path / "own.toml")
    for given in ("motion_base", tmp_path / "own.toml", str(tmp_path / "own.toml"), MOTION_BASE):
        assert function_of(name)(given) == MOTION_BASE


def test_lists_of_platforms_name_the_one_that_is_none() -> None:
    stack = function_of("parameters", "stack")
    assert stack(["motion_base", MOTION_BASE]) == [MOTION_BASE, MOTION_BASE]
    with pytest.raises(ArgumentError, match=r"parameters\[1\] is 3; expected a Platform"):
        stack(["motion_base", 3])
    for given in ("motion_base", 3):
        with pytest.raises(ArgumentError, match="expected a list of platforms, names of presets or platform files"):
            stack(given)
    with pytest.raises(ArgumentError, match=r"parameters is \[\]; expected at least one platform"):
        stack([])


def test_some_functions_take_more_under_a_name() -> None:
    """Expected: frf a record or its path unread; estimates as one text or a list; names of experiments and presets."""
    assert function_of("record", "frf")("nowhere") == "nowhere"
    with pytest.raises(gs.GoughStewartError, match="nowhere"):
        function_of("record")("nowhere")
    with pytest.raises(ArgumentError, match=r"records\[1\] is 3; expected a Record, or the folder or file of one"):
        function_of("records")([RECORD, 3])
    for called in ("excite", "identify"):
        assert function_of("estimate", called)("all") == "all"
        assert function_of("estimate", called)(("a", "b")) == ["a", "b"]
    assert function_of("name", "load_experiment")(Path("x")) == Path("x")
    assert function_of("name", "load_preset")("x") == "x"
    for called, given, expected in (("load_experiment", 3, "a path"), ("load_preset", Path("x"), "a text")):
        with pytest.raises(ArgumentError, match=f"; expected {expected}$"):
            function_of("name", called)(given)
    # a name without a meaning of its own is passed on
    assert function_of("title")(3) == 3


def test_defaults_are_kept_and_options_are_looked_into() -> None:
    """Expected: a default is not checked; options are taken by their own names; a long value is cut at 60 letters."""

    def taker(platform: Any, bandwidth: Any = None, **options: Any) -> Any:
        return platform, bandwidth, options

    called = with_checked_arguments(taker)
    assert called("motion_base") == (MOTION_BASE, None, {})
    assert called(MOTION_BASE, bandwidth=None, seed=np.int64(4), title=5) == (
        MOTION_BASE,
        None,
        {"seed": 4, "title": 5},
    )
    assert called(MOTION_BASE, "2 kHz")[1] == 2000
    with pytest.raises(ArgumentError, match=r"^seed is 'x'; expected a whole number"):
        called(MOTION_BASE, seed="x")
    with pytest.raises(ArgumentError) as caught:
        called(MOTION_BASE, "y" * 80)
    assert str(caught.value).startswith(f"bandwidth is '{'y' * 56}…; expected a number of Hz above 0")
    for letters in (58, 59):  # with quotes 60 and 61
        with pytest.raises(ArgumentError) as caught:
            called(MOTION_BASE, "y" * letters)
        text = f"'{'y' * 58}'" if letters == 58 else f"'{'y' * 56}…"
        assert str(caught.value).startswith(f"bandwidth is {text}; expected")
    with pytest.raises(
        ArgumentError, match=r"^taker: missing a required argument: 'platform'; expected taker\(platform, "
    ):
        called()
    with pytest.raises(ArgumentError, match=r"; expected taker\(platform, bandwidth=…\)$"):
        called(MOTION_BASE, 1, 2)


def test_public_functions_are_found_here_by_pickles_and_nothing_else_is() -> None:
    """Expected: the public function itself; what modules have by themselves, and unknown names, are refused."""
    assert arguments.leg_geometry is gs.leg_geometry
    for name in ("__path__", "__version__", "nothing"):
        with pytest.raises(AttributeError) as caught:
            getattr(arguments, name)
        assert str(caught.value) == f"module 'gough_stewart.harness.arguments' has no attribute '{name}'"
        assert caught.value.name == name
    called = function_of("title", "made_here")
    assert (called.__module__, called.__qualname__, called.__name__) == (arguments.__name__, "made_here", "made_here")


def test_options_and_defaults_are_left_out_or_shortened_in_what_is_expected() -> None:
    def taker(a: Any, b: Any = 3, *, c: Any, d: Any = None, **options: Any) -> Any:
        return a, b, c, d, options

    called = with_checked_arguments(taker)
    with pytest.raises(ArgumentError) as caught:
        called(1)
    assert str(caught.value) == "taker: missing a required argument: 'c'; expected taker(a, b=…, c, d=…)"
    assert called(1, 2, c=4, d=5, e=6) == (1, 2, 4, 5, {"e": 6})
    # an explicit value beside a default is taken by its name; an equal one that is not the default, too
    with_seed = with_checked_arguments(lambda seed=1000: seed)
    assert with_seed() == 1000
    with pytest.raises(ArgumentError, match=r"seed is 1000\.0; expected a whole number"):
        with_seed(1000.0)
