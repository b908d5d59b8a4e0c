"""The signals of records, recomputed from the columns of uneven records at uneven settings."""

from dataclasses import replace

import numpy as np
import pytest

from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.signals import GROUPS, SHOWN, Signal, signals_of
from gough_stewart.model.kinematics import conditioning
from gough_stewart.model.vectors import FloatArray
from tests.support.orientations import rotation_vectors
from tests.support.uneven_records import LEGS, MACHINE, OTHER, RUN

XYZ, ANGLES = ("x", "y", "z"), ("roll", "pitch", "yaw")


_FROM_HOME = "reference.position from home", "reference.orientation from home"


# By name: title, group, unit, kind, components, reference, limits.
SIGNALS: dict[str, tuple[str, str, str, str, tuple[str, ...], str | None, tuple[float, ...]]] = {
    "position from home": ("position from home", "pose", "mm", "axes", XYZ, _FROM_HOME[0], ()),
    "orientation from home": ("orientation from home", "pose", "deg", "axes", ANGLES, _FROM_HOME[1], ()),
    "error.position": ("position error", "errors", "mm", "axes", XYZ, None, ()),
    "error.orientation": ("orientation error", "errors", "deg", "axes", ANGLES, None, ()),
    "actuator_force": ("actuator force", "actuators", "N", "legs", LEGS, None, (110.0, -110.0)),
    "leg_length": ("length of legs", "legs", "m", "legs", LEGS, "reference.leg_length", (2.3, 3.85)),
    "leg_velocity": ("sliding velocity of legs", "legs", "m/s", "legs", LEGS, None, (0.6, -0.6)),
    "actuator power": ("actuator power of legs", "actuators", "W", "legs", LEGS, None, (45.0, -45.0)),
    "condition number": ("condition number of the leg Jacobian", "legs", "1", "other", ("condition number",), None, ()),
    "position": ("position", "pose", "m", "axes", XYZ, "reference.position", ()),
    "orientation": ("orientation", "pose", "deg", "axes", ANGLES, "reference.orientation", ()),
    "velocity": ("velocity", "velocities", "m/s", "axes", XYZ, "reference.velocity", ()),
    "angular_velocity": ("angular velocity", "velocities", "rad/s", "axes", XYZ, None, ()),
    "joint_force x": ("joint force, x", "legs", "N", "legs", LEGS, None, ()),
    "joint_force y": ("joint force, y", "legs", "N", "legs", LEGS, None, ()),
    "joint_force z": ("joint force, z", "legs", "N", "legs", LEGS, None, ()),
    "error.leg_length": ("leg length error", "errors", "mm", "legs", LEGS, None, ()),
    "reference.position from home": ("reference position from home", "reference", "mm", "axes", XYZ, None, ()),
    _FROM_HOME[1]: ("reference orientation from home", "reference", "deg", "axes", ANGLES, None, ()),
    "reference.position": ("reference position", "reference", "m", "axes", XYZ, None, ()),
    "reference.orientation": ("reference orientation", "reference", "deg", "axes", ANGLES, None, ()),
    "reference.leg_length": ("reference leg length", "reference", "m", "legs", LEGS, None, ()),
    "reference.velocity": ("reference velocity", "reference", "m/s", "axes", XYZ, None, ()),
    "external_force": ("external force", "disturbance", "N", "axes", XYZ, None, ()),
    "external_torque": ("external torque", "disturbance", "N.m", "axes", XYZ, None, ()),
    "controller.force": ("controller force", "controller", "N", "legs", LEGS, None, ()),
    "controller.feedforward": ("controller feedforward", "controller", "N", "legs", LEGS, None, ()),
    "controller.integral": ("controller integral", "controller", "", "other", tuple("12345678"), None, ()),
    "controller.gain": ("controller gain", "controller", "", "other", ("controller gain",), None, ()),
    "measured.leg_length": ("measured leg length", "sensors", "m", "legs", LEGS, None, ()),
    "flag.force_limited": ("force limit active", "flags", "", "legs", LEGS, None, ()),
    "flag.stroke_exceeded": ("beyond the stroke", "flags", "", "legs", LEGS, None, ()),
    "flag.rate_limited": ("force rate limit active", "flags", "", "legs", LEGS, None, ()),
    "kinetic_energy": ("kinetic energy", "energy", "J", "other", ("kinetic energy",), None, ()),
    "platform_mass": ("platform mass", "parameters", "kg", "other", ("platform mass",), None, ()),
    "my_sensor": ("my sensor", "other", "", "other", ("my sensor",), None, ()),
}  # fmt: skip


def expected_values(record: Record, name: str) -> FloatArray:
    """From the columns of the record, with factors by definition of the units."""
    home = {"position": MACHINE.home_position, "orientation": MACHINE.home_orientation}
    unit = SIGNALS[name][2]
    if name == "actuator power":
        return np.asarray(record["actuator_force"] * record["leg_velocity"])
    if name == "condition number":
        return conditioning(MACHINE, record["position"], record["orientation"]).condition_number[:, None]
    column, _, axis = name.removesuffix(" from home").partition(" ")
    values = np.asarray(record[column], dtype=float).reshape(record.table.height, -1)
    if name.endswith("from home"):
        at_home = home[column.removeprefix("reference.")]
        values = values - at_home if "position" in column else rotation_vectors(at_home, values)
    if axis in XYZ:
        parts = [record.table[f"{column}[{leg},{XYZ.index(axis) + 1}]"].to_numpy() for leg in range(1, 7)]
        values = np.stack(parts, axis=1)
    return np.asarray(values * {"mm": 1e3, "deg": 180 / np.pi}.get(unit, 1.0))


@pytest.fixture(scope="module")
def signals() -> list[Signal]:
    return signals_of([RUN], [MACHINE])


def test_every_column_is_a_signal_with_its_words_unit_and_limits(signals: list[Signal]) -> None:
    """Expected: the table above, in the order of the charts shown at first and then of groups."""
    assert {s.name: (s.title, s.group, s.unit, s.kind, s.components, s.reference, s.limits) for s in signals} == SIGNALS
    names = [signal.name for signal in signals]
    assert names[: len(SHOWN)] == list(SIGNALS)[: len(SHOWN)] == list(SHOWN)
    groups = [signal.group for signal in signals[len(SHOWN) :]]
    order = (
        "pose velocities legs actuators errors reference disturbance controller sensors flags energy parameters other"
    )
    assert tuple(order.split()) == GROUPS
    assert groups == sorted(groups, key=order.split().index)
    assert [signal.is_flag for signal in signals] == [signal.group == "flags" for signal in signals]


def test_values_of_signals_are_those_of_the_columns(signals: list[Signal]) -> None:
    for signal in signals:
        (values,) = signal.values
        assert values is not None
        assert values == pytest.approx(expected_values(RUN, signal.name), rel=1e-12, abs=1e-12), signal.name


def test_limits_are_drawn_where_all_runs_have_the_same() -> None:
    """Expected: of two runs with other force limits and machines that share the shortest length, that one only."""
    other = replace(MACHINE, leg_length_max=3.7, leg_velocity_max=None)
    found = {signal.name: signal.limits for signal in signals_of([RUN, OTHER], [MACHINE, other])}
    assert (found["leg_length"], found["actuator_force"], found["leg_velocity"]) == ((2.3,), (), ())
    assert found["actuator power"] == (45.0, -45.0)


def test_runs_with_other_columns_share_signals_where_they_can() -> None:
    """Expected: nothing of a run without a column, of one with fewer components, and no reference that nobody has."""
    few = Record(
        RUN.table.drop("my_sensor", "controller.integral[8]", *[f"reference.velocity[{k}]" for k in (1, 2, 3)]),
        RUN.metadata,
    )
    found = {signal.name: signal for signal in signals_of([few, RUN], [MACHINE, MACHINE])}
    assert [values is None for values in found["my_sensor"].values] == [True, False]
    assert [values is None for values in found["controller.integral"].values] == [True, False]
    assert len(found["controller.integral"].components) == 8
    assert found["velocity"].reference == "reference.velocity"
    alone = {signal.name: signal for signal in signals_of([few], [MACHINE])}
    assert "my_sensor" not in alone
    assert alone["velocity"].reference is None
    open_loop = Record(RUN.table.select(c for c in RUN.table.columns if not c.startswith("reference")), RUN.metadata)
    of_open = {signal.name: signal for signal in signals_of([open_loop], [MACHINE])}
    assert "reference.position from home" not in of_open
    assert of_open["position from home"].reference is None
    odd = Record(RUN.table.drop("velocity[3]"), RUN.metadata)  # two components of three
    (velocity,) = (signal for signal in signals_of([odd], [MACHINE]) if signal.name == "velocity")
    assert (velocity.components, velocity.kind) == (("1", "2"), "other")
