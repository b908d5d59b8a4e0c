"""The scene of a run: bodies, frames, nearness to limits, from the columns of its record."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.scene import frame_rows, leg_parts, nearness_to_limits, scene_of
from gough_stewart.model.kinematics import joint_angles
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.rotations import matrix_from_orientation, matrix_from_quaternion
from gough_stewart.model.vectors import FloatArray
from tests.support.records import waving_record
from tests.support.uneven_records import MACHINE, ROWS, RUN


def array(values: FloatArray | None) -> FloatArray:
    assert values is not None
    return values


@pytest.fixture(scope="module")
def platform() -> Platform:
    """A platform with all limits."""
    return load_preset("motion_base")


@pytest.fixture(scope="module")
def record(platform: Platform) -> Record:
    return waving_record(platform, rows=4001)


@given(st.integers(1, 30_000), st.integers(1, 3000))
def test_frames_are_evenly_spaced_rows_with_first_and_last(rows: int, frames: int) -> None:
    kept = frame_rows(rows, frames)
    assert kept[0] == 0
    assert kept[-1] == rows - 1
    steps = np.diff(kept)
    assert len(set(steps[:-1])) <= 1
    assert len(kept) <= max(frames, 2)
    if rows <= frames:
        assert len(kept) == rows


def test_frames_hold_the_bits_of_their_rows(record: Record, platform: Platform) -> None:
    scene = scene_of(record, platform, "waves", frames=101)
    rows = frame_rows(record.table.height, 101)
    assert np.array_equal(array(scene.time), record["time"][rows])
    assert np.array_equal(array(scene.pose)[:, :3], record["position"][rows])
    assert np.array_equal(array(scene.leg_length), record["leg_length"][rows])
    assert np.array_equal(array(scene.actuator_force), record["actuator_force"][rows])
    assert np.array_equal(array(scene.reference)[:, :3], record["reference.position"][rows])


def test_quaternions_turn_as_the_orientation_does(record: Record, platform: Platform) -> None:
    """Expected: R = Rz Ry Rx of the record's own orientation; the quaternion comes from SciPy, its matrix from here."""
    scene = scene_of(record, platform, "waves", frames=101)
    orientation = array(scene.orientation)
    turned = matrix_from_quaternion(array(scene.pose)[:, 3:])
    assert np.abs(turned - matrix_from_orientation(orientation)).max() < 1e-14


def test_a_flag_between_two_frames_is_not_lost(record: Record, platform: Platform) -> None:
    """Expected: nine rows in frames 0, 4, 8; a flag of row 3 holds until row 4, so in the first interval only."""
    few = record.table.head(9).with_columns(**{f"flag.force_limited[{leg}]": np.zeros(9, bool) for leg in range(1, 7)})
    for row, said in ((0, "10"), (3, "10"), (4, "01"), (7, "01"), (8, "00")):
        flag = np.arange(9) == row
        one = Record(few.with_columns(**{"flag.force_limited[2]": flag}), record.metadata)
        assert scene_of(one, platform, "waves", frames=3).flags[0].values == said


@given(st.floats(0.05, 5), st.floats(1.0, 1.85), st.floats(0.0, 1.0))
def test_the_parts_of_a_leg_overlap_and_stay_within_it(shortest: float, ratio: float, share: float) -> None:
    """Expected at every length L between the extremes: lower + upper > L, and both shorter than L."""
    platform = replace(load_preset("liu2000"), leg_length_min=None, leg_length_max=None)
    longest = shortest * ratio
    lower, upper = leg_parts(np.array([[shortest, longest]]), platform)
    length = shortest + share * (longest - shortest)
    assert lower + upper > length
    assert max(lower, upper) < length


def test_nearness_is_one_at_each_limit(platform: Platform) -> None:
    """Expected: 0 in the middle of the stroke, 1 at both ends; |F|/limit; the joint angles' own ratio at home is 0."""
    low, high = platform.leg_length_min, platform.leg_length_max
    assert low is not None
    assert high is not None
    home = waving_record(platform, rows=3, size=0.0)
    table = home.table
    for row, length in enumerate((low, (low + high) / 2, high)):
        for leg in range(1, 7):
            values = table[f"leg_length[{leg}]"].to_numpy().copy()
            values[row] = length
            table = table.with_columns(**{f"leg_length[{leg}]": values})
    near = nearness_to_limits(Record(table, home.metadata), platform)
    assert near["stroke"][:, 0] == pytest.approx([1, 0, 1])
    assert np.array_equal(near["force"], np.abs(home["actuator_force"]) / 100)
    assert np.abs(near["joint angle"]).max() < 1e-7
    velocity, force = np.abs(home["leg_velocity"]), np.abs(home["actuator_force"])
    assert near["velocity"] == pytest.approx(velocity / 0.8)
    assert near["power"][-1] == pytest.approx(force[-1] * velocity[-1] / 12000)
    assert nearness_to_limits(Record(table, {}), load_preset("liu2000")) == {}


def test_poses_are_drawn_from_home(record: Record, platform: Platform) -> None:
    """Expected: the position of home as it is, and a quaternion whose matrix is R = Rz Ry Rx of its orientation."""
    tilted = replace(platform, home_orientation=np.array([0.1, -0.2, 0.3]))
    home = scene_of(record, tilted, "waves", frames=3).home
    assert home[:3] == pytest.approx(platform.home_position)
    assert matrix_from_quaternion(home[3:]) == pytest.approx(matrix_from_orientation(tilted.home_orientation))


def test_the_scene_has_the_bodies_and_every_frame() -> None:
    """Expected: joints of the machine, poses as position and quaternion by SciPy, values of the rows that are kept.

    Flags hold from a frame to the next if any row between has one, of any leg.
    """
    scene = scene_of(RUN, MACHINE, "a name", frames=40)
    rows = [*range(0, ROWS, 8), 300]
    assert frame_rows(ROWS, 40).tolist() == rows
    assert (scene.name, scene.rows, scene.run) == ("a name", ROWS, None)
    assert np.array_equal(scene.base_points, MACHINE.base_points)
    assert np.array_equal(scene.platform_points, MACHINE.platform_points)
    assert scene.time == pytest.approx(RUN["time"][rows], rel=1e-15)
    for poses, position, orientation in (
        (array(scene.pose), RUN["position"], RUN["orientation"]),
        (array(scene.reference), RUN["reference.position"], RUN["reference.orientation"]),
    ):
        assert poses[:, :3] == pytest.approx(position[rows])
        wanted = Rotation.from_euler("xyz", orientation[rows].copy())
        assert np.abs((Rotation.from_quat(poses[:, 3:]).inv() * wanted).magnitude()).max() < 1e-12
    assert scene.home[:3] == pytest.approx(MACHINE.home_position)
    turned = Rotation.from_euler("xyz", MACHINE.home_orientation.copy())
    assert (Rotation.from_quat(scene.home[3:]).inv() * turned).magnitude() < 1e-12
    for name in ("orientation", "leg_length", "actuator_force", "external_force"):
        assert array(getattr(scene, name)) == pytest.approx(RUN[name][rows], rel=1e-15)
    flags = {flag.name: flag.values for flag in scene.flags}
    assert flags.keys() == {"force_limited", "rate_limited", "stroke_exceeded"}
    for name, said in flags.items():
        up = np.asarray(RUN[f"flag.{name}"], dtype=bool)
        assert said == "".join(str(int(up[a:b].any())) for a, b in pairwise(rows))
    assert {"0", "1"} == set(flags["rate_limited"])
    assert scene.nearness_of == ("stroke", "force", "velocity", "power", "joint angle")
    worst = np.max([each[rows] for each in _nearness_parts(rows)], axis=0)
    assert array(scene.nearness) == pytest.approx(worst, rel=1e-12)
    assert (scene.lower, scene.upper) == leg_parts(RUN["leg_length"], MACHINE)
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
    assert [empty.reference, empty.external_force, empty.nearness, empty.flags] == [None, None, None, ()]


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
