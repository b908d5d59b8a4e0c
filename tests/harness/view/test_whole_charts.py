"""Everything that the charts of a page show, recomputed from the columns of uneven records at uneven settings."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.signals import GROUPS, SHOWN, Signal, signals_of
from gough_stewart.harness.view.charts import chart_of, coinciding, difference, points_of
from gough_stewart.harness.view.page import view_page
from gough_stewart.model.kinematics import conditioning
from gough_stewart.model.vectors import FloatArray
from tests.support.uneven_records import LEGS, MACHINE, OTHER, RUN, numbers, record_of

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
    "flag.force_limited": ("flag force limited", "flags", "", "legs", LEGS, None, ()),
    "flag.stroke_exceeded": ("flag stroke exceeded", "flags", "", "legs", LEGS, None, ()),
    "flag.rate_limited": ("flag rate limited", "flags", "", "legs", LEGS, None, ()),
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
        values = values - home[column.removeprefix("reference.")]
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


def test_the_data_of_charts_hold_the_lines_of_all_runs_and_their_differences() -> None:
    """Expected: of each group the first component, by run, within the resolution of single precision.

    A difference is the second run minus the first at the times of both; a flag is held between rows.
    """
    third = record_of(0.025, title="third")
    records = [RUN, OTHER, third]
    chart = chart_of(records, [MACHINE] * 3)
    assert chart["shown"] == list(SHOWN)
    assert chart["range"] == pytest.approx([7.3, 7.35 + 210 * 1.7e-3])
    assert chart["signals"].keys() == SIGNALS.keys()
    points = points_of(3)
    assert (points, points_of(1), points_of(8), points_of(9)) == (266, 800, 100, 100)
    for name, found in chart["signals"].items():
        title, group, unit, kind, components, reference, _ = SIGNALS[name]
        said = [found[key] for key in ("title", "group", "unit", "kind", "reference", "holds")]
        assert said == [title, group, unit, kind, reference, group == "flags"], name
        assert tuple(found["components"]) == components
        groups = found["curves"]["groups"]
        assert sorted(k for members in groups for k in members) == list(range(len(components)))
        for k, record in enumerate(records):
            _check_lines(found["curves"]["lines"], k, records, name, groups, points)
            values = expected_values(record, name)
            for members in groups:
                gap = np.abs(values[:, members] - values[:, members[:1]])
                assert gap.max() < found["curves"]["least"]
        if name in ("position from home", "flag.rate_limited", "leg_length"):
            _check_differences(found, name, records)


def _check_lines(
    lines: list[Any], k: int, records: Sequence[Record], name: str, groups: list[list[int]], points: int
) -> None:
    if isinstance(lines[k], int):  # the same as an earlier run's
        j = lines[k]
        assert j < k
        assert np.array_equal(records[j]["time"], records[k]["time"])
        assert np.array_equal(expected_values(records[j], name), expected_values(records[k], name))
        return
    values, time = expected_values(records[k], name), records[k]["time"]
    assert len(lines[k]) == len(groups)
    for line, members in zip(lines[k], groups, strict=True):
        x, y = numbers(line["x"]), numbers(line["y"])
        wanted = values[:, members[0]]
        rows = np.abs(time[:, None] - x).argmin(axis=0)
        assert x == pytest.approx(time[rows], rel=1e-6)
        assert y == pytest.approx(wanted[rows], rel=1e-5, abs=1e-6 * np.abs(wanted).max())
        assert 2 <= len(x) <= points
        assert (rows[0], rows[-1]) == (0, len(time) - 1)
        if len(x) == 2:
            assert np.ptp(wanted) == 0
        else:
            assert (y.min(), y.max()) == pytest.approx((wanted.min(), wanted.max()), rel=1e-5, abs=1e-9)


def _check_differences(found: dict[str, Any], name: str, records: Sequence[Record]) -> None:
    groups = found["differences"]["groups"]
    assert found["differences"]["lines"].keys() == {"0,1", "0,2", "1,2"}
    for pair, lines in found["differences"]["lines"].items():
        j, k = map(int, pair.split(","))
        times = [records[j]["time"], records[k]["time"]]
        values = [expected_values(records[j], name), expected_values(records[k], name)]
        both = np.unique(np.round(np.concatenate(times), 9))
        for line, members in zip(lines, groups, strict=True):
            x, y = numbers(line["x"]), numbers(line["y"])
            assert np.abs(both[:, None] - x).min(axis=0).max() < 1e-6
            x, at = both[np.abs(both[:, None] - x).argmin(axis=0)], []
            for time, column in zip(times, (each[:, members[0]] for each in values), strict=True):
                held = column[np.searchsorted(time, x + 1e-8, side="right") - 1]
                at.append(held if name.startswith("flag") else np.interp(x, time, column))
            assert y == pytest.approx(at[1] - at[0], rel=1e-3, abs=2e-3 * np.abs(values[0]).max())
            assert x[0] == pytest.approx(max(time[0] for time in times))
            assert x[-1] == pytest.approx(min(time[-1] for time in times))


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_lines_of_very_short_runs_have_a_point_for_each_row(rows: int) -> None:
    """Expected: as many points as rows, but for what rests, which has its two ends."""
    chart = chart_of([record_of(rows=rows)], [MACHINE])
    lines = chart["signals"]["position from home"]["curves"]["lines"][0]
    assert [len(numbers(line["x"])) for line in lines] == [rows] * len(lines)
    (resting,) = chart["signals"]["external_torque"]["curves"]["lines"][0][:1]
    assert len(numbers(resting["x"])) == min(rows, 2)


def test_clocks_that_agree_but_for_rounding_have_the_same_rows() -> None:
    """Expected: tenths as multiples and as sums differ in the last bits; equal flags have no difference at any row."""
    one, other = np.linspace(0.0, 1.1, 12), np.cumsum(np.full(12, 0.1)) - 0.1
    assert not np.array_equal(one, other)
    flags = (np.arange(12.0) % 3 == 0)[:, None].astype(float)
    time, values = difference((one, other), (flags, flags), holds=True)
    assert time == pytest.approx(one)
    assert not values.any()
    lines = (one[:, None], 3 * other[:, None])
    assert difference((one, other), lines)[1][:, 0] == pytest.approx(2 * one)


def test_columns_that_are_close_share_a_line_only_if_all_rows_are() -> None:
    """Expected: the last of 33 rows keeps columns apart, and so does a gap of the second run; less than, not up to."""
    base = np.linspace(0.0, 1.0, 33)
    for row in (0, 1, 2, 31, 32):
        other = base.copy()
        other[row] += 0.25
        assert coinciding([np.stack([base, other], axis=1)], 0.25) == [[0], [1]]
        assert coinciding([np.stack([base, other], axis=1)], 0.2501) == [[0, 1]]
    assert coinciding([], 1.0) == []
    time = np.array([0.0, 1.0, 2.0])
    same, gap = difference((time, time), (np.zeros((3, 2)), np.ones((3, 2))))
    assert (same.tolist(), gap.tolist()) == ([0.0, 1.0, 2.0], [[1.0, 1.0]] * 3)


def test_rows_beyond_what_can_be_drawn_are_left_out_of_every_column_that_is_drawn() -> None:
    """Expected: rows up to the first of a value of 1e9 in any column that is drawn, of either sign; tables have all."""
    for name in (
        "position[3]",
        "orientation[2]",
        "leg_length[6]",
        "leg_velocity[4]",
        "actuator_force[5]",
        "external_force[1]",
    ):
        values = RUN[name].copy()
        values[123:] = -1.5e9
        page = view_page([Record(RUN.table.with_columns(**{name: values}), RUN.metadata)], ["x"])
        assert b"The animation shows 123 of 301 rows" in page, name
        values[:] = 1e9
        with pytest.raises(RecordError, match="x: no row with finite values; there is nothing to show"):
            view_page([Record(RUN.table.with_columns(**{name: values}), RUN.metadata)], ["x"])
