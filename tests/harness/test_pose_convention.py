"""Poses as other people write them: what is read is the pose that they mean, by matrices written out."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.commands import invoke
from tests.support.motions import motion_of
from tests.support.uneven import UNEVEN

N = 40
TIME = 0.02 * np.arange(N)
PLACE = UNEVEN.home_position + np.outer(np.sin(3 * TIME), [0.05, -0.04, 0.03])
ANGLES = np.add(np.outer(np.sin(4 * TIME), [0.11, -0.08, 0.15]), [0.05, 0.12, -0.2])
X, Y, Z = 0, 1, 2


def about(axis: int, angle: FloatArray) -> FloatArray:
    """Elementary rotations (n, 3, 3) about an axis."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    R = np.tile(np.eye(3), (len(angle), 1, 1))
    R[:, j, j], R[:, k, k], R[:, k, j], R[:, j, k] = np.cos(angle), np.cos(angle), np.sin(angle), -np.sin(angle)
    return R


def composed(*axes: int) -> FloatArray:
    """Rotations by the angles about x, y, z, the first axis leftmost."""
    first, second, third = (about(axis, ANGLES[:, axis]) for axis in axes)
    return first @ second @ third


def lengths(place: FloatArray, R: FloatArray) -> FloatArray:
    arms = np.einsum("nij,lj->nli", R, UNEVEN.platform_points)
    return np.asarray(np.linalg.norm(place[:, None] + arms - UNEVEN.base_points, axis=-1))


def matrices(orientation: FloatArray) -> FloatArray:
    """R = Rz·Ry·Rx of roll, pitch, yaw."""
    return about(Z, orientation[:, 2]) @ about(Y, orientation[:, 1]) @ about(X, orientation[:, 0])


def file_of(folder: Path, header: str, *columns: FloatArray, first: list[str] | None = None) -> Path:
    rows = np.column_stack(columns)
    lead = [f"{t:.3f}" for t in TIME] if first is None else first
    lines = [f"{lead[k]}," + ",".join(f"{value:.12g}" for value in row) for k, row in enumerate(rows)]
    path = folder / "log.csv"
    path.write_text("\n".join([header, *lines]) + "\n", "utf-8")
    return path


def read(path: Path, **keys: Any) -> Any:
    return motion_of(UNEVEN, path.parent, type="file", file=path.name, **keys)


POSE = "t [s],x [mm],y [mm],z [mm],roll [rad],pitch [rad],yaw [rad]"
LEGS = ",".join(f"leg_{k} [mm]" for k in range(1, 7))
NED, MIRROR = np.diag([1.0, -1.0, -1.0]), np.diag([1.0, -1.0, 1.0])
SWAPPED = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
TURNED = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
C = np.array([0.03, -0.05, 0.2])
# Keys, and the rotation and the position of Op that the file means by its angles and positions.
CASES: dict[str, tuple[dict[str, Any], FloatArray, FloatArray]] = {
    "ours": ({}, composed(Z, Y, X), PLACE),
    "moving XYZ": ({"rotation_about": "moving"}, composed(X, Y, Z), PLACE),
    "fixed ZYX": ({"rotation_order": "ZYX"}, composed(X, Y, Z), PLACE),
    "moving YZX": ({"rotation_order": "YZX", "rotation_about": "moving"}, composed(Y, Z, X), PLACE),
    "fixed ZXY": ({"rotation_order": "ZXY"}, composed(Y, X, Z), PLACE),
    "z down": ({"frame": "z_down"}, NED @ composed(Z, Y, X) @ NED, PLACE * [1, -1, -1]),
    "north-east-down": ({"frame": "y,x,-z"}, SWAPPED @ composed(Z, Y, X) @ SWAPPED, PLACE[:, [1, 0, 2]] * [1, 1, -1]),
    "turned": ({"frame": "-y,x,z"}, TURNED @ composed(Z, Y, X) @ TURNED.T, PLACE[:, [1, 0, 2]] * [1, -1, 1]),
    "left-handed": ({"frame": "x,-y,z"}, MIRROR @ composed(Z, Y, X) @ MIRROR, PLACE * [1, -1, 1]),
    "pivot": ({"pivot": tuple(C.tolist())}, composed(Z, Y, X), PLACE - composed(Z, Y, X) @ C),
    "ZXZ": (
        {"rotation_order": "ZXZ", "rotation_about": "moving"},
        about(Z, ANGLES[:, 0]) @ about(X, ANGLES[:, 1]) @ about(Z, ANGLES[:, 2]),
        PLACE,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_references_paths_and_logs_are_read_as_they_were_written(case: str, tmp_path: Path) -> None:
    keys, R, position = CASES[case]
    path = file_of(tmp_path, POSE, 1e3 * PLACE, ANGLES)
    table = read(path, **keys)
    np.testing.assert_allclose(matrices(table.orientation), R, atol=1e-9)
    np.testing.assert_allclose(table.position, position, atol=1e-9)
    log = gs.read_log(file_of(tmp_path, f"{POSE},{LEGS}", 1e3 * PLACE, ANGLES, np.ones((N, 6))), **keys)
    assert log.position is not None
    assert log.orientation is not None
    np.testing.assert_allclose(matrices(log.orientation), R, atol=1e-9)
    np.testing.assert_allclose(log.position, position, atol=1e-9)


@pytest.mark.parametrize("case", ["ours", "moving XYZ", "z down", "left-handed", "pivot"])
def test_paths_pass_through_the_poses_that_are_meant(case: str) -> None:
    """Expected: displacements from home: of the pivot, and rotations applied after home's; at both ends at rest."""
    keys, R, _ = CASES[case]
    M = {"z down": NED, "left-handed": MIRROR}.get(case, np.eye(3))
    rows = [0, 12, 30]
    moved = np.array([[0.02, 0.01, -0.01], [0.0, -0.02, 0.02], [0.01, 0.0, 0.03]])
    poses = np.hstack([moved, ANGLES[rows]]).tolist()
    path = gs.ViaPath(poses=poses, relative_to="home", timing=3, **keys).about(UNEVEN)
    ends = path(np.array([0.0, 3.0]))
    R_home = matrices(UNEVEN.home_orientation[None])[0]
    c = np.asarray(keys.get("pivot", (0, 0, 0)))
    for end, row in ((0, 0), (1, 2)):
        turned = R[rows[row]] @ R_home
        np.testing.assert_allclose(matrices(ends.orientation[[end]])[0], turned, atol=1e-9)
        held = UNEVEN.home_position + R_home @ c + M @ moved[row]  # of the pivot
        np.testing.assert_allclose(ends.position[end] + turned @ c, held, atol=1e-9)


def test_a_log_that_fits_in_another_order_or_frame_is_told_so(tmp_path: Path) -> None:
    """Expected: lengths of the poses that are meant; a noise of 0.02 mm, an encoder offset and a gap hide nothing."""
    noise = np.random.default_rng(3).normal([0, 0, 4e-3, 0, 0, 0], 2e-5, (N, 6))
    for case, says in (
        ("fixed ZYX", r'contradict the poses.*rotation_order = "ZYX"; read'),
        ("fixed ZXY", r'rotation_order = "ZXY"; read'),
        ("moving YZX", r'rotation_order = "XZY"; read'),
        ("z down", r'frame = "z_down"; read'),
        ("left-handed", r'frame = "x,-y,z"; their frame is left-handed \(mirrored\)'),
    ):
        keys, R, position = CASES[case]
        path = file_of(tmp_path, f"{POSE},{LEGS}", 1e3 * PLACE, ANGLES, 1e3 * (lengths(position, R) + noise))
        with pytest.raises(gs.GoughStewartError, match=says) as caught:
            read(path)
        error = lengths(position, R) + noise - lengths(PLACE, composed(Z, Y, X))
        told = []
        for offset in (0, 1):  # with and without what is constant in each leg
            now, best = (np.sqrt(np.mean((e - offset * e.mean(axis=0)) ** 2)) for e in (error, noise))
            told.append(f"contradict the poses, by {now:.3g} m rms, and fit them within {best:.3g} m with ")
        assert any(text in str(caught.value) for text in told)
        with pytest.raises(gs.GoughStewartError, match=says):
            gs.identify(path, UNEVEN, "leg_length_offset")
        read(path, **keys)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], lines[1].rpartition(",")[0] + ",", *lines[2:]]))
    gs.save_platform(UNEVEN, tmp_path / "own.toml")
    done = invoke("poses", str(path), "--platform", str(tmp_path / "own.toml"), "--out", str(tmp_path / "out"))
    assert "the leg lengths contradict the poses" in done.stderr


def test_leg_lengths_are_a_reference_with_dates_and_repeated_rows(tmp_path: Path) -> None:
    """Expected: the poses of the lengths; the row that repeats another counts once, and is told."""
    R = composed(Z, Y, X)
    L = lengths(PLACE, R)
    home = lengths(UNEVEN.home_position[None], matrices(UNEVEN.home_orientation[None]))
    dates = [f"2024-02-29T23:59:{59 + t:06.3f}+01:00" if t < 1 else "" for t in TIME]
    early, late = ([f"{first + t:.3f}" for t in TIME] for first in (1_000_000_000, 3_999_999_999))
    for stamps, name, values, keys, said in (
        (dates, "leg_", L, {}, ["row 6 repeats"]),
        (early, "strut_", L, {}, ["2 rows, from 6 on, repeat"] * 2),
        (late, "l", L - home, {"leg_lengths": "from_home"}, ["row 6 repeats"]),
    ):
        path = file_of(tmp_path, f"timestamp,{LEGS.replace('leg_', name)}", 1e3 * values, first=stamps)
        lines = path.read_text().splitlines()
        path.write_text("\n".join([*lines[:6], *[lines[5]] * len(said), *lines[6:]]))
        with pytest.warns(UserWarning, match=f"{said[0]} the row before"):
            table = read(path, **keys)
        np.testing.assert_allclose(table.time, TIME, atol=3e-7)
        np.testing.assert_allclose(table.position, PLACE, atol=1e-8)
        np.testing.assert_allclose(matrices(table.orientation), R, atol=1e-8)
        path.write_text("\n".join([*lines[:6], lines[5][:-4] + "9999", *lines[6:]]))
        with pytest.raises(gs.GoughStewartError, match=r"in row 6, with other values"):
            read(path, **keys)
    path.write_text("\n".join(lines))
    with pytest.raises(gs.GoughStewartError, match=r"of row 1 .*leg_lengths = \"from_home\""):
        read(path)
    L[7, 2] = 9.0
    path = file_of(tmp_path, f"t [s],{LEGS}", 1e3 * L)
    with pytest.raises(gs.GoughStewartError, match=r"no pose of this platform .*9\.0.* m of row 8 "):
        read(path)


def test_messages_of_poses_are_read_by_their_names(tmp_path: Path) -> None:
    """Expected: a unit quaternion, scalar last, of half angles about z; no unit is needed of its numbers."""
    yaw = ANGLES[:, 2]
    header = "/tool/pose/header/stamp," + ",".join(f"/tool/pose/position/{axis} [m]" for axis in "xyz")
    header += "," + ",".join(f"/tool/pose/orientation/{axis}" for axis in "xyzw")
    stamps = [str(1709247599_000000000 + round(t * 1e9)) for t in TIME]
    quaternion = np.column_stack([0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)])
    path = file_of(tmp_path, header.replace("stamp", "stamp [ns]"), PLACE, quaternion, first=stamps)
    table = read(path)
    np.testing.assert_allclose(table.orientation, np.column_stack([0 * yaw, 0 * yaw, yaw]), atol=1e-9)
    np.testing.assert_allclose(table.time, TIME, atol=1e-12)
    with pytest.raises(
        gs.GoughStewartError, match=r"rotation_order is 'ZYX'.* orientations are a quaternion; leave both"
    ):
        read(path, rotation_order="ZYX")


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"rotation_order": "xyz"}, "rotation_order is 'xyz'; expected three of X, Y, Z in capitals"),
        ({"rotation_order": "XXY"}, "rotation_order is 'XXY'"),
        ({"rotation_order": "quaternion"}, "rotation_order is 'quaternion'"),
        ({"rotation_about": "body"}, "rotation_about"),
        ({"frame": "x,x,z"}, "frame is 'x,x,z'; expected 'z_up'"),
        ({"pivot": (0, 1)}, "pivot"),
    ],
)
def test_impossible_conventions_are_refused(keys: dict[str, Any], says: str, tmp_path: Path) -> None:
    with pytest.raises(gs.GoughStewartError, match=says):
        read(tmp_path / "a.csv", **keys)
    with pytest.raises(gs.GoughStewartError, match=says):
        gs.read_log(file_of(tmp_path, f"t [s],{LEGS}", np.ones((N, 6))), **keys)


def test_dates_keep_their_digits_and_those_that_no_month_has_are_named_with_their_row(tmp_path: Path) -> None:
    """Expected: nanoseconds by whole numbers; zones, of which none is UTC, differ by hours."""
    dates = ["2024-02-29T23:59:59.999999999Z", "2024-03-01 01:00:01+01:00"]
    dates += [f"2024-03-01T00:00:0{k}" for k in range(2, 7)]
    pose = np.column_stack([np.outer(np.arange(7), [1, 1, 1]), 0.01 * np.outer(np.arange(7), [1, 1, 1])])
    header = POSE.replace("t [s]", "t")
    path = file_of(tmp_path, header, pose, first=dates)
    assert read(path).time.tolist() == [0, *((10**9 * k + 1) / 1e9 for k in range(1, 7))]
    path = file_of(tmp_path, header, pose, first=[*dates[:3], "2023-02-29T00:00:00Z", *dates[4:]])
    with pytest.raises(gs.GoughStewartError, match=r"t in row 4 is '2023-02-29T00:00:00Z'; expected a date and time"):
        read(path)
