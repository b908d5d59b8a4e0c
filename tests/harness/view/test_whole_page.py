"""Everything that a page of runs is made of, recomputed from the columns of uneven records at uneven settings."""

import base64
import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import lxml.html
import numpy as np
import polars
import pytest
from scipy.spatial.transform import Rotation

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.tables import Named, Sheet
from gough_stewart.harness.results.metrics import metrics
from gough_stewart.harness.results.record import Record, plain
from gough_stewart.harness.view import file as view_file
from gough_stewart.harness.view.charts import chart_of, coinciding, difference, points_of
from gough_stewart.harness.view.comparison import comparison_table
from gough_stewart.harness.view.file import view
from gough_stewart.harness.view.page import names_of, view_page
from gough_stewart.harness.view.scene import frame_rows, leg_parts, nearness_to_limits, scene_of
from gough_stewart.harness.view.signals import GROUPS, SHOWN, Signal, signals_of
from gough_stewart.harness.view.tables import limits_sheet, parameters_sheet, run_sheet, versions_sheet
from gough_stewart.model.errors import OutputError
from gough_stewart.model.kinematics import conditioning, joint_angles
from gough_stewart.model.vectors import FloatArray
from tests.support.records import waving_record
from tests.support.uneven import UNEVEN

BELIEVED = replace(UNEVEN, leg_velocity_max=0.6, actuator_power_max=45.0)
MACHINE = replace(BELIEVED, name="machine", platform_mass=13.0, leg_length_max=3.85, leg_acceleration_max=2.5)
EXPERIMENT: dict[str, Any] = {
    "title": "uneven",
    "description": "six <sines>",
    "reference": {"type": "sine", "frequency": 2.123456789, "position_amplitude": [0.01, 0.0, 0.03], "none": None},
    "controller": {"type": "pd", "gains": [[1.0, 2.5], [3.0, 4.0]]},
    "loop": {"duration": 0.3},
    "sensors": {"noise": {"leg_length": 5e-6}, "quantisation": {}},
    "actuators": {},
    "limits": None,
    "disturbance": [{"at": 0.02, "force": [1.0, 2.0, 3.0]}, {"at": 0.04, "force": []}],
}
ROWS = 301


def numbers(packed: dict[str, str], width: int | None = None) -> FloatArray:
    values = np.frombuffer(base64.b64decode(packed["bdata"]), f"<{packed['dtype']}").astype(float)
    return values if width is None else values.reshape(-1, width)


def more(rows: int) -> dict[str, FloatArray]:
    """Columns of every kind, all different, as a run or another program may write them."""
    t = np.arange(rows)
    found = {f"{name}[{k}]": np.sin(t / 9 + k) + k for name in ("velocity", "angular_velocity") for k in (1, 2, 3)}
    found |= {f"external_torque[{k}]": 0.0 * t + k for k in (1, 2, 3)}
    found |= {f"joint_force[{leg},{k}]": t / 50 + leg + k / 8 for leg in range(1, 7) for k in (1, 2, 3)}
    found |= {
        f"{n}[{k}]": np.cos(t / 7 + k) for n in ("controller.force", "controller.feedforward") for k in range(1, 7)
    }
    found |= {f"measured.leg_length[{k}]": 2.9 + 0.1 * np.cos(t / 5 + k) for k in range(1, 7)}
    found |= {f"reference.velocity[{k}]": np.cos(t / 5 + k) for k in (1, 2, 3)}
    found |= {f"controller.integral[{k}]": np.cos(t / 5 + k) for k in range(1, 9)}
    found |= {f"flag.rate_limited[{k}]": (t % (17 + k) == 3) & (k != 4) for k in range(1, 7)}
    return found | {
        "kinetic_energy": t / 3,
        "platform_mass": 11 + t / 900,
        "my_sensor": np.sqrt(t),
        "controller.gain": t / 2,
    }


def record_of(size: float = 0.03, rows: int = ROWS, step: float = 1e-3, start: float = 7.3, **metadata: Any) -> Record:
    """Moving sines from 7.3 s on, with the machine and the belief above."""
    known: dict[str, Any] = {
        "platform": plain(BELIEVED),
        "machine": plain(MACHINE),
        "experiment": EXPERIMENT,
        "force_limit": 110.0,
        "plant": "fmu3",
        "duration": 0.3,
        "sample_time": 2e-3,
        "plant_step": 1e-3,
        "versions": {"python": "3.x", "numpy": "2.y"},
        "title": "uneven run",
    }
    made = waving_record(BELIEVED, rows=rows, size=size, step=step)
    extra = {name: np.asarray(values) for name, values in more(rows).items()}
    return Record(made.table.with_columns(time=made["time"] + start, **extra), made.metadata | known | metadata)


RUN = record_of()
OTHER = record_of(0.02, rows=211, step=1.7e-3, start=7.35, force_limit=120.0, title="other")


def rows_of(sheet: Sheet) -> list[tuple[str, ...]]:
    return [tuple(f"{c.what} [{c.unit}]" if isinstance(c, Named) else c for c in row) for row in sheet.rows]


LEGS = tuple(f"leg {k}" for k in range(1, 7))
XYZ, ANGLES = ("x", "y", "z"), ("roll", "pitch", "yaw")
_FROM_HOME = "reference.position from home", "reference.orientation from home"
# By name: title, group, unit, kind, components, reference, limits.
SIGNALS: dict[str, tuple[str, str, str, str, tuple[str, ...], str | None, tuple[float, ...]]] = {
    "position from home": ("position from home", "pose", "mm", "axes", XYZ, _FROM_HOME[0], ()),
    "orientation from home": ("orientation from home", "pose", "deg", "axes", ANGLES, _FROM_HOME[1], ()),
    "error.position": ("position error", "errors", "mm", "axes", XYZ, None, ()),
    "error.orientation": ("orientation error", "errors", "mrad", "axes", ANGLES, None, ()),
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
    return np.asarray(values * {"mm": 1e3, "mrad": 1e3, "deg": 180 / np.pi}.get(unit, 1.0))


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


def test_the_scene_has_the_bodies_and_every_frame() -> None:
    """Expected: joints of the machine, poses as position and quaternion by SciPy, values of the rows that are kept.

    Flags hold from a frame to the next if any row between has one, of any leg.
    """
    scene = scene_of(RUN, MACHINE, "a name", frames=40)
    rows = [*range(0, ROWS, 8), 300]
    assert frame_rows(ROWS, 40).tolist() == rows
    assert (scene["name"], scene["rows"]) == ("a name", ROWS)
    assert scene["base"] == MACHINE.base_points.tolist()
    assert scene["platform"] == MACHINE.platform_points.tolist()
    assert numbers(scene["time"]) == pytest.approx(RUN["time"][rows], rel=1e-15)
    for key, position, orientation in (
        ("pose", RUN["position"], RUN["orientation"]),
        ("reference", RUN["reference.position"], RUN["reference.orientation"]),
    ):
        poses = numbers(scene[key], 7)
        assert poses[:, :3] == pytest.approx(position[rows])
        wanted = Rotation.from_euler("xyz", orientation[rows].copy())
        assert np.abs((Rotation.from_quat(poses[:, 3:]).inv() * wanted).magnitude()).max() < 1e-12
    home = np.array(scene["home"])
    assert home[:3] == pytest.approx(MACHINE.home_position)
    turned = Rotation.from_euler("xyz", MACHINE.home_orientation.copy())
    assert (Rotation.from_quat(home[3:]).inv() * turned).magnitude() < 1e-12
    for key, name, width in (
        ("orientation", "orientation", 3),
        ("length", "leg_length", 6),
        ("force", "actuator_force", 6),
        ("external_force", "external_force", 3),
    ):
        assert numbers(scene[key], width) == pytest.approx(RUN[name][rows], rel=1e-15)
    assert scene["flags"].keys() == {"force_limited", "rate_limited", "stroke_exceeded"}
    for name, said in scene["flags"].items():
        up = np.asarray(RUN[f"flag.{name}"], dtype=bool)
        assert said == "".join(str(int(up[a:b].any())) for a, b in pairwise(rows))
    assert "1" in scene["flags"]["rate_limited"]
    assert "0" in scene["flags"]["rate_limited"]
    assert scene["nearness"]["of"] == ["stroke", "force", "velocity", "power", "joint angle"]
    worst = numbers(scene["nearness"]["values"], 6)
    assert worst == pytest.approx(np.max([each[rows] for each in _nearness_parts(rows)], axis=0), rel=1e-12)
    assert (scene["lower"], scene["upper"]) == leg_parts(RUN["leg_length"], MACHINE)
    bare = Record(
        RUN.table.select(c for c in RUN.table.columns if not c.startswith(("reference", "flag"))).with_columns(
            **{f"external_force[{k}]": np.zeros(ROWS) for k in (1, 2, 3)}
        ),
        {**RUN.metadata, "force_limit": None},
    )
    limitless = replace(
        MACHINE, leg_length_min=None, leg_velocity_max=None, actuator_power_max=None, joint_angle_max=None
    )
    empty = scene_of(bare, limitless, "b")
    assert [empty[key] for key in ("reference", "external_force", "nearness", "flags")] == [None, None, None, {}]


def _nearness_parts(rows: list[int]) -> list[FloatArray]:
    """By their definitions; power counts the velocity at both ends of a row, here of the rows that are kept."""
    length, force, velocity = RUN["leg_length"], RUN["actuator_force"], np.abs(RUN["leg_velocity"])
    later = velocity.copy()
    for k, row in enumerate(rows):
        later[row] = np.maximum(velocity[row], velocity[rows[min(k + 1, len(rows) - 1)]])
    pose = (RUN["position"], RUN["orientation"], MACHINE.home_position, MACHINE.home_orientation)
    return [
        np.abs(length - (2.3 + 3.85) / 2) / ((3.85 - 2.3) / 2),
        np.abs(force) / 110.0,
        velocity / 0.6,
        np.abs(force) * later / 45.0,
        np.maximum(*joint_angles(MACHINE, *pose)) / 0.7,
    ]


def test_limits_count_for_themselves() -> None:
    """Expected: a stroke needs both ends, a force the limit of the loop; each limit is there if it is stated alone."""
    none = replace(
        MACHINE,
        leg_length_min=None,
        leg_length_max=None,
        leg_velocity_max=None,
        actuator_power_max=None,
        joint_angle_max=None,
    )
    without = Record(RUN.table, {**RUN.metadata, "force_limit": None})
    for name, value, key in (
        ("leg_velocity_max", 0.6, ["velocity"]),
        ("actuator_power_max", 45.0, ["power"]),
        ("joint_angle_max", 0.7, ["joint angle"]),
        ("leg_length_min", 2.3, []),
        ("leg_length_max", 3.85, []),
    ):
        assert list(nearness_to_limits(without, replace(none, **{name: value}))) == key  # type: ignore[arg-type]
    assert list(nearness_to_limits(RUN, none)) == ["force"]


@pytest.mark.parametrize(("low", "high"), [(2.9, 3.0), (1.5, 2.9), (2.0, 3.9)])
def test_legs_are_drawn_for_the_lengths_allowed_as_well(low: float, high: float) -> None:
    """Expected: of lengths from 2.4 m to 3.5 m and limits 2.3 m and 3.85 m: the widest of both; by hand.

    The longest is spanned with 6 % of overlap, each part is at most 97 % of the shortest.
    """
    lower, upper = leg_parts(np.array([[low, high]]), MACHINE)
    shortest, longest = min(low, 2.3), max(high, 3.85)
    assert lower == pytest.approx(min(0.97 * shortest, 0.53 * longest))
    assert upper == pytest.approx(min(0.97 * shortest, 1.06 * longest - lower))


def test_the_table_of_a_run() -> None:
    """Expected: by hand, what was set, six digits, empty settings left out, every part of lists and tables."""
    sheet = run_sheet(RUN, BELIEVED)
    assert (sheet.title, sheet.heads) == ("Run", ("", ""))
    assert rows_of(sheet) == [
        ("outcome", "completed at 0.3 s"),
        ("plant", "fmu3"),
        ("platform", "uneven"),
        ("rows", "301"),
        ("duration [s]", "0.3"),
        ("sample time [s]", "0.002"),
        ("plant step [s]", "0.001"),
        ("force limit [N]", "110"),
        ("reference", "type sine, frequency 2.12346, position_amplitude 0.01, 0, 0.03"),
        ("controller", "type pd, gains 1, 2.5; 3, 4"),
        ("loop", "duration 0.3"),
        ("sensors", "noise leg_length 5e-06"),
        ("disturbance", "at 0.02, force 1, 2, 3"),
        ("disturbance", "at 0.04"),
    ]
    bare = Record(RUN.table, {"outcome": {**RUN.metadata["outcome"], "cause": "a cause"}, "platform": plain(BELIEVED)})
    assert rows_of(run_sheet(bare, BELIEVED)) == [
        ("outcome", "completed at 0.3 s: a cause"),
        ("plant", "–"),
        ("platform", "uneven"),
        ("rows", "301"),
    ]
    every = ("reference", "controller", "loop", "sensors", "actuators", "limits", "start", "change", "disturbance")
    full = Record(RUN.table, {**RUN.metadata, "experiment": {name: {"k": n} for n, name in enumerate(reversed(every))}})
    assert rows_of(run_sheet(full, BELIEVED))[8:] == [(name, f"k {8 - n}") for n, name in enumerate(every)]


def test_the_table_of_limits_and_flags() -> None:
    """Expected: the largest share by leg in percent, and the time of the row at which each leg first had a flag."""
    sheet = limits_sheet(RUN, MACHINE)
    assert sheet is not None
    assert (sheet.title, sheet.heads) == ("Limits and flags", ("", *"123456"))
    parts = dict(
        zip(("stroke", "force", "velocity", "power", "joint angle"), _nearness_parts(list(range(ROWS))), strict=True)
    )
    time, expected = RUN["time"], []

    def firsts(name: str, up: Any) -> tuple[str, ...]:
        rows = [next((k for k in range(ROWS) if up[k, leg]), None) for leg in range(6)]
        return (name, *("never" if k is None else f"{time[k]:.6g}" for k in rows))

    for name, values in parts.items():
        shares = tuple(f"{100 * values[:, leg].max():.4g}" for leg in range(6))
        expected.append((f"{name}, most of its limit [%]", *shares))
        if name in ("velocity", "power"):
            expected.append(firsts(f"{name}, first beyond its limit at [s]", values > 1))
    for name in ("force limited", "rate limited", "stroke exceeded"):
        up = np.asarray(RUN[f"flag.{name.replace(' ', '_')}"], dtype=bool)
        expected.append(firsts(f"{name}, first at [s]", up))
    assert rows_of(sheet) == expected
    assert {cell == "never" for row in expected for cell in row[1:]} == {True, False}
    assert sum("first beyond" in row[0] and any(c != "never" for c in row[1:]) for row in expected) == 2


def test_the_tables_of_parameters_and_versions() -> None:
    """Expected: every parameter that is stated, in the order of the platform, and the belief only where it differs."""
    sheet = parameters_sheet(MACHINE, BELIEVED)
    assert (sheet.title, sheet.heads) == ("Platform: machine", ("", "machine", "believed"))
    rows = {row[0]: row[1:] for row in rows_of(sheet)}
    stated = [name for name, value in MACHINE.as_dict().items() if value is not None and name != "name"]
    assert [name.partition(" [")[0] for name in rows] == stated
    assert rows["platform_mass [kg]"] == ("13", "11.5")
    assert rows["leg_length_max [m]"] == ("3.85", "3.9")
    assert rows["leg_acceleration_max [m/s2]"] == ("2.5", "–")
    assert rows["gravity [m/s2]"] == ("0.9, -1.3, -9.4", "")
    assert rows["source"] == ("made up for tests", "")
    assert rows["base_points [m]"][0].split("; ")[3] == "1.98, -0.49, -0.08"
    assert rows["leg_viscous_friction_factor [1]"] == ("0.7, 1.4, 0.9, 1.6, 0.5, 1.1", "")
    assert [row[0] for row in rows.items() if row[1][1]] == [
        "platform_mass [kg]",
        "leg_length_max [m]",
        "leg_acceleration_max [m/s2]",
    ]
    same = parameters_sheet(BELIEVED, BELIEVED)
    assert (same.title, same.heads) == ("Platform: uneven", ("", ""))
    assert {len(row) for row in same.rows} == {2}
    versions = versions_sheet(RUN)
    assert (versions.title, versions.heads, rows_of(versions)) == (
        "Versions",
        ("", ""),
        [("python", "3.x"), ("numpy", "2.y")],
    )


def elements(page: bytes, path: str) -> list[Any]:
    found: Any = lxml.html.fromstring(page.decode()).xpath(path)
    return list(found)


def test_the_texts_of_a_page_of_one_run() -> None:
    """Expected: title, description, platform and plant; how many rows and points are shown; all tables in order."""
    page = view_page([RUN], ["folder"], [_more()])
    assert elements(page, "//title/text()") == elements(page, "//h1/text()") == ["uneven run"]
    text = " ".join(elements(page, "//header")[0].text_content().split())
    assert "six <sines> — platform uneven, plant fmu3" in text
    footer = " ".join(elements(page, "//footer")[0].text_content().split())
    assert "The animation shows 301 of 301 rows, interpolated linearly" in footer
    assert "smallest and the largest value in each of 400 intervals of time" in footer
    captions = elements(page, "//caption/text()")
    assert captions == ["More", "Tracking error", "Legs", "Limits and flags", "Run", "Platform: machine", "Versions"]
    assert elements(page, "//h2/text()") == ["Curves", "Results", "Metrics"]
    assert [e.get("aria-label") for e in elements(page, "//div[@role='group' and .//caption]")] == captions
    described = Record(RUN.table, {**RUN.metadata, "experiment": {}, "plant": None})
    text = " ".join(elements(view_page([described], ["x"]), "//header")[0].text_content().split())
    assert "made up for tests — platform uneven" in text
    assert "plant" not in text
    unknown = {key: value for key, value in RUN.metadata.items() if key != "experiment"}
    text = " ".join(elements(view_page([Record(RUN.table, unknown)], ["x"]), "//header")[0].text_content().split())
    assert "made up for tests — platform uneven, plant fmu3" in text


def _more() -> Sheet:
    sheet = Sheet("More", ("", "a"))
    sheet.add("b", "c")
    return sheet


def test_the_texts_of_a_page_of_several_runs() -> None:
    """Expected: names, boxes in order, how the second ended, and of each its own tables; frames are shared."""
    ended = {"status": "diverged", "time": 7.6, "cause": "far <away>"}
    second = Record(OTHER.table, {**OTHER.metadata, "outcome": ended})
    page = view_page([RUN, second, record_of(0.025)], ["one <1>", "two", "three"])
    assert elements(page, "//h1/text()") == ["one <1> · two · three"]
    heads = elements(page, "//label[@class='record']")
    assert [head.text_content().strip() for head in heads] == [
        "one <1>", "two diverged at 7.6 s: far <away>", "three"
    ]  # fmt: skip
    assert [head.xpath("input/@data-record")[0] for head in heads] == ["0", "1", "2"]
    assert [head.xpath("span/@style")[0] for head in heads] == [f"background:{c}" for c in COLOURS[:3]]
    text = " ".join(elements(page, "//header")[0].text_content().split())
    assert "several runs overlaid" in text
    footer = " ".join(elements(page, "//footer")[0].text_content().split())
    assert "301 of 301 rows, 211 of 211 rows, 301 of 301 rows" in footer
    assert "each of 133 intervals" in footer
    summaries = [" ".join(s.text_content().split()) for s in elements(page, "//details/summary")]
    assert summaries[:3] == [f"{name}: all metrics, run, parameters, versions" for name in ("one <1>", "two", "three")]
    errors = elements(
        page, "//details//caption[text()='Tracking error']/../tbody/tr[starts-with(th, '|position|')]/td[2]/text()"
    )
    peaks = [metrics(each)["tracking"]["position"]["norm_peak"] for each in (RUN, second, record_of(0.025))]
    assert [float(text) for text in errors] == pytest.approx([1e3 * peak for peak in peaks], rel=1e-3)
    data = json.loads(elements(page, "//script[@id='data']")[0].text)
    assert data["colours"] == list(COLOURS)
    assert [share for share, _ in data["nearness"]["stops"]] == [0.0, 0.5, 0.8, 1.0]
    assert [scene["name"] for scene in data["scenes"]] == ["one <1>", "two", "three"]
    assert data["chart"]["shown"] == list(SHOWN)
    outcomes = elements(page, "//caption[text()='Run']/../tbody/tr[th='outcome']/td/text()")
    assert outcomes == ["completed at 0.3 s", "diverged at 7.6 s: far <away>", "completed at 0.3 s"]


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


def test_runs_side_by_side_have_every_metric_and_its_best() -> None:
    """Expected: three runs with the numbers of their metrics in words and units; the best marked of those that rank."""
    records = [record_of(0.03), record_of(0.02), record_of(0.025)]
    found = [metrics(each) for each in records]
    table: Any = lxml.html.fromstring(comparison_table(records, found, ["a", "b", "c"]))
    assert [cell.text_content() for cell in table.xpath("thead//th")] == ["a", "b", "c"]
    assert table.xpath("caption")[0].text_content() == "Runs side by side ★ best of the row"
    rows = {r.xpath("th")[0].text_content(): [c.text_content() for c in r.xpath("td")] for r in table.xpath("tbody/tr")}
    # by the words that are shown: path in the metrics, factor, and which run is best
    words = {
        "position error, RMS mm": (("tracking", "position", "norm_rms"), 1e3, 1),
        "position error, peak mm": (("tracking", "position", "norm_peak"), 1e3, 1),
        "orientation error, RMS mrad": (("tracking", "orientation", "norm_rms"), 1e3, 1),
        "orientation error, peak mrad": (("tracking", "orientation", "norm_peak"), 1e3, 1),
        "stroke margin mm": (("stroke", "margin"), 1e3, 1),
        "work, net J": (("energy", "net_total"), 1.0, None),
        "work, absolute J": (("energy", "absolute_total"), 1.0, 1),
    }  # fmt: skip
    for name, (path, factor, top) in words.items():
        values: list[Any] = list(found)
        for key in path:
            values = [value[key] for value in values]
        texts = rows[name]
        assert [float(text.removeprefix("★ ")) for text in texts] == pytest.approx(
            [factor * value for value in values], rel=1e-3
        ), name
        assert [text.startswith("★") for text in texts] == [k == top for k in range(3)], name
    assert list(rows)[:5] == ["outcome", *list(words)[:4]]
    order = [name.split(",")[0].split(" ")[0] for name in rows]
    starts = [
        order.index(word) for word in ("outcome", "position", "orientation", "leg", "peak", "work", "force", "stroke")
    ]
    assert starts == sorted(starts)
    assert not any(word in name for name in rows for word in (" at", "first exceeded"))
    step = {"axis": "z", "from": 1.0, "to": 1.05, "at": 7.4, "overshoot_percent": 12.5, "rise_time": 0.1}
    stepped = {**found[0], "step_response": [{**step, "settling_time": 0.3, "final_error": 1.5e-3}]}
    whole: Any = lxml.html.fromstring(comparison_table([records[0]], [stepped], ["a"]))
    cells = {r.xpath("th")[0].text_content(): r.xpath("td")[0].text_content() for r in whole.xpath("tbody/tr")}
    of_axes = [
        f"{what} error, {kind} {unit}"
        for what, unit in (("position", "mm"), ("orientation", "mrad"))
        for kind in ("RMS", "peak")
    ]
    assert list(cells) == [
        "outcome", *of_axes, "leg error, RMS mm", "leg error, peak mm",
        "z: overshoot %", "z: rise time s", "z: settling time s", "z: final error mm",
        "peak force N", "RMS force N", "peak power W", "mean power W", "work, absolute J", "work, net J",
        "force limited %", "rate limited %", "stroke margin mm", "beyond stroke %",
        "leg velocity, of its limit %", "actuator force, of its limit %", "actuator power, of its limit %",
    ]  # fmt: skip
    assert [cells[f"z: {name}"] for name in ("overshoot %", "rise time s", "settling time s", "final error mm")] == [
        "12.5", "0.1", "0.3", "1.5",
    ]  # fmt: skip
    assert cells["rate limited %"] == f"{100 * found[0]['saturation']['rate_limited']['any']:.4g}"
    later = Record(records[1].table, {**records[1].metadata, "duration": 0.4})
    unlike = comparison_table([records[0], later], found[:2], ["a", "b"])
    assert "★" not in unlike


def test_a_page_is_written_where_it_was_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: names given, of folders, or titles, numbered where they are equal; steps are told; shown if asked."""
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    steps: list[str] = []
    made: list[list[str]] = []

    def page_of(_read: object, names: Sequence[str]) -> bytes:
        made.append(list(names))
        return b"page"

    monkeypatch.setattr(view_file, "view_page", page_of)
    out = tmp_path / "new" / "a.htm"
    assert view(RUN, out, progress=steps.append) == out
    assert (out.read_bytes(), opened, steps) == (b"page", [], ["reading", "writing the page"])
    view([RUN, OTHER, RUN], tmp_path / "b.html", show=True)
    assert opened == [(tmp_path / "b.html").as_uri()]
    view([RUN, OTHER], tmp_path / "b.html", names=["x", "y"])
    folder = tmp_path / "of a run"
    folder.mkdir()
    RUN.write_parquet(folder / "record.parquet")
    (folder / "metadata.json").write_bytes(RUN.to_metadata())
    view([folder, RUN], tmp_path / "b.html")
    view(str(folder / "record.parquet"), tmp_path / "b.html")
    assert made == [
        ["uneven run"],
        ["uneven run (1)", "other", "uneven run (3)"],
        ["x", "y"],
        ["of a run", "uneven run"],
        ["of a run"],
    ]
    untitled = Record(RUN.table, {key: value for key, value in RUN.metadata.items() if key != "title"})
    view(untitled, tmp_path / "b.html")
    assert made[-1] == ["record"]
    with pytest.raises(RecordError, match="1 names for 2 records; expected one per record"):
        view([RUN, OTHER], out, names=["x"])
    for wrong in ("page", "page.pdf", "html"):
        with pytest.raises(OutputError, match=f"{wrong}: expected the name of a page, such as {wrong}.html"):
            view(RUN, wrong)
    assert names_of([folder, folder / "record.parquet"]) == [str(folder), str(folder / "record.parquet")]
    assert isinstance(polars.read_parquet(folder / "record.parquet"), polars.DataFrame)
