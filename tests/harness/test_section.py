"""Tables of experiments: how their validators come to be."""

import os
import signal
from typing import Any, Literal

import pytest
from pydantic import Field

import gough_stewart as gs
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.section import FileName, Kind, Section, file_names, kinds


class Loud(Section):
    """A table during whose building a signal arrives."""

    size: int

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        os.kill(os.getpid(), signal.SIGINT)
        return handler(source)


def test_an_interrupt_while_a_validator_is_built_comes_after_it() -> None:
    """Expected: Python's own exception, and a validator; pydantic's builder makes a SchemaError of an interrupt."""
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            Loud(size=3)
    finally:
        signal.signal(signal.SIGINT, handler)
    assert Loud.__pydantic_complete__
    assert Loud(size=3).size == 3


BASE: dict[str, Any] = {"title": "x", "controller": {"type": "pd", "bandwidth": 2}, "loop": {"duration": 1}}
MESSAGES: dict[str, tuple[dict[str, Any], str]] = {
    "the second of two": (
        {"change": [{"at": 1, "factors": {"gravity": 2}}, {"at": "x", "factors": {"gravity": 2}}]},
        "change.2.at: is 'x'; expected a number of s, or a string with one of the units s, ms, us, µs, ns, min",
    ),
    "a key of a kind": (
        {"reference": {"type": "sine", "frequency": 1, "fase": 2}},
        "reference.fase: unknown key (= 2); did you mean 'phase'?",
    ),
    "a key that is named like its kind": (
        {"controller": {"type": "pd", "bandwidth": 2, "pd": 3}},
        "controller.pd: unknown key (= 3); expected one of type, feedforward, space, bandwidth, damping_ratio, "
        "proportional_gain, derivative_gain, derivative_on, derivative_filter, discretisation, notch",
    ),
    "a key that another kind has": (
        {"reference": {"type": "sine", "frequency": 1, "file": "a.csv"}},
        "reference.file: unknown key (= 'a.csv'); expected one of type, time_scale, amplitude_scale, position, "
        "orientation, position_amplitude, orientation_amplitude, fade_in, frequency, phase, position_phase, "
        "orientation_phase",
    ),
    "a value in a list in a table": (
        {"disturbance": [{"at": 0, "duration": 1}, {"at": 0, "duration": 1, "force": [1, 2, "3 m"]}]},
        "disturbance.2.force: is [1, 2, '3 m']; value 3 of 3: expected a number of N, or a string with one of the "
        "units N, kN; found the unit 'm'",
    ),
    "faults of three tables, in their order": (
        {"loop": {"duration": 0, "dely": 1}, "sensors": {"seed": "x"}, "change": [{"at": 1, "values": {}}]},
        "loop.duration: is 0; expected > 0 s; loop.dely: unknown key (= 1); did you mean 'delay'?; "
        "sensors.seed: is 'x'; expected a valid integer; "
        "change.1.values: unknown key (= {}); expected one of at, parameters, factors, controller, delay, force_limit, "
        "noise, quantisation",
    ),
    "two faults of one table": (
        {"disturbance": [{"at": 0, "duraton": 1}]},
        "disturbance.1.duration: is missing; add it; "
        "disturbance.1.duraton: unknown key (= 1); did you mean 'duration'?",
    ),
    "no type": (
        {"controller": {"bandwidth": 2}},
        "controller: the key type is missing; `gough-stewart experiments heave_step` shows a whole file",
    ),
    "no kind": (
        {"injection": {"type": "noise"}},
        "injection: type is 'noise'; expected one of 'multisine', 'chirp', 'prbs'",
    ),
    "no table": ({"loop": 3}, "loop: is 3; expected a table of keys"),
    "no list": ({"change": {"at": 1}}, "change: expected a valid list"),
    "a key of the whole": ({"titel": "y"}, "titel: unknown key (= 'y'); did you mean 'title'?"),
    "a choice": (
        {"limits": {"stroke": "end"}},
        "limits.stroke: is 'end'; expected 'ignore', 'warn' or 'stop'",
    ),
    "a whole number": ({"sensors": {"seed": 1.5}}, "sensors.seed: is 1.5; expected a valid integer"),
    "below a bound": ({"loop": {"duration": 1, "delay": -1}}, "loop.delay: is -1; expected greater than or equal to 0"),
    "above a bound": (
        {"loop": {"duration": 1, "delay": 1001}},
        "loop.delay: is 1001; expected less than or equal to 1000",
    ),
    "a condition of two keys": (
        {"platform": {"preset": "liu2000", "file": "x"}},
        "platform: expected preset or file, not both",
    ),
    "a signal": (
        {"sensors": {"noise": {"legs": 1}}},
        "sensors.noise: no signal 'legs'; expected position, orientation, velocity, angular_velocity, leg_length, "
        "leg_velocity",
    ),
    "signals that are none": (
        {"sensors": {"noise": 3}},
        "sensors.noise: is 3; expected a table of signals (position, orientation, velocity, angular_velocity, "
        "leg_length, leg_velocity)",
    ),
}


@pytest.mark.parametrize("what", MESSAGES)
def test_a_wrong_table_is_told_with_place_value_and_expectation(what: str) -> None:
    """Expected: the whole message."""
    tables, message = MESSAGES[what]
    with pytest.raises(ExperimentError) as caught:
        gs.load_experiment("heave_step", {"sensors": {}, "platform": {}, **BASE, **tables})
    assert str(caught.value) == f"experiment 'heave_step': {message}"
    assert caught.value.where == "experiment 'heave_step'"


def test_files_are_found_in_every_table_by_their_keys() -> None:
    """Expected: keys that name files, also in elements of lists, which count from 1."""

    class Named(Section):
        file: FileName | None = None
        other: str = "no.csv"

    class Whole(Section):
        first: Named = Named()
        several: list[Named] = Field(default_factory=list)
        fmu: FileName = "a.fmu"

    several = [Named(), Named(file="two.csv"), Named(file="three.csv")]
    found = file_names(Whole(first=Named(file="one.csv"), several=several))
    assert found == {
        ("first", "file"): "one.csv",
        ("several", "2", "file"): "two.csv",
        ("several", "3", "file"): "three.csv",
        ("fmu",): "a.fmu",
    }


def test_kinds_are_known_by_their_type_through_classes_between() -> None:
    """Expected: subclasses of subclasses; those without a type of their own are none."""

    class Base(Kind):
        """A base."""

    class Between(Base):
        size: int = 1

    class Own(Between):
        type: Literal["own"] = "own"

    class Other(Base):
        type: Literal["other"] = "other"

    assert kinds(Base) == {"own": Own, "other": Other}
    assert Own().model_dump(exclude_unset=True) == {"type": "own"}
    with pytest.raises(ExperimentError, match=r"^sice: unknown key \(= 3\); did you mean 'size'\?$"):
        Own(sice=3)  # type: ignore[call-arg]
