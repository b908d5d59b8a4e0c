"""The command `poses`: files of encoders by hand to tables of poses, whose lengths |p + R b − a| are in the file."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.commands import invoke
from tests.support.uneven import UNEVEN

N = 50
TIME = 0.01 * np.arange(N)
PLACE = UNEVEN.home_position + np.outer(np.sin(5 * TIME), [0.06, -0.03, 0.04])
TURNS = Rotation.from_euler("ZYX", np.add(np.outer(np.sin(7 * TIME), [0.2, -0.1, 0.12]), [0.3, 0.1, -0.05]))


def lengths() -> FloatArray:
    arms = np.einsum("nij,lj->nli", TURNS.as_matrix(), UNEVEN.platform_points)
    return np.asarray(np.linalg.norm(PLACE[:, None] + arms - UNEVEN.base_points, axis=-1))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    gs.save_platform(UNEVEN, tmp_path / "machine.toml")
    return tmp_path


def encoders(values: FloatArray, more: str = "", beside: FloatArray | None = None) -> None:
    """A file with decimal commas, counted legs, a row of units, and an empty cell in row 4."""
    head = "Time;" + ";".join(f"S{k}" for k in range(1, 7)) + more
    rows = np.column_stack([1e3 * TIME, 1e3 * values, *([] if beside is None else [beside])])
    lines = [";".join(f"{value:.10f}" for value in row).replace(".", ",") for row in rows]
    cells = lines[3].split(";")
    lines[3] = ";".join([*cells[:5], "", *cells[6:]])
    units = ";".join(["ms", *["mm"] * 6, *["mm"] * (3 if more else 0), *["deg"] * (3 if more else 0)])
    Path("encoders.csv").write_text("\n".join([head, units, *lines]), "cp1252")


COLUMNS = [word for k in range(1, 7) for word in ("--column", f"leg_length[{k}]=S{k}")]


def poses(*words: str) -> tuple[int, str]:
    done = invoke("poses", "encoders.csv", "--platform", "machine.toml", *COLUMNS, *words, "--out", "out")
    return done.exit_code, done.output + done.stderr


@pytest.mark.parametrize("relative", [False, True])
def test_the_table_has_the_poses_of_the_lengths(relative: bool, folder: Path) -> None:
    home = Rotation.from_euler("xyz", UNEVEN.home_orientation).as_matrix()
    arms = UNEVEN.home_position + UNEVEN.platform_points @ home.T - UNEVEN.base_points
    encoders(lengths() - np.linalg.norm(arms, axis=1) if relative else lengths())
    code, said = poses("--leg-lengths", "from_home" if relative else "absolute", "--require", "residual <= 1 um")
    assert code == 0, said
    assert "49 rows of 50 have a pose" in " ".join(said.split())
    table = polars.read_parquet(folder / "out/poses.parquet")
    worst = 1 + int(np.nanargmax(table["condition_number"].to_numpy()))
    assert worst > 4  # behind the row without a pose, which counts
    assert f"the largest in row {worst}" in " ".join(said.split())
    condition = np.delete(table["condition_number"].to_numpy(), 3)
    assert f"condition number {condition.min():.4g} to {condition.max():.4g}, the" in " ".join(said.split())
    report = json.loads((folder / "out/report.json").read_text("utf-8"))
    numbers = {row["path"]: row for row in report["numbers"]}
    assert (report["verdict"]["status"], numbers["rows.gaps"]["value"]) == ("told", 1)
    assert [numbers["condition_number"][end] for end in ("low", "high")] == [condition.min(), condition.max()]
    assert f"x m │ {PLACE[:, 0].min():.5g} │ {PLACE[:, 0].max():.5g} │" in " ".join(said.split())
    text = polars.read_csv(folder / "out/poses.csv")
    assert text.columns == table.columns
    np.testing.assert_array_equal(text.cast(polars.Float64), table)
    np.testing.assert_allclose(table["time"], TIME, atol=1e-12)
    place = table.select("^position.*$").to_numpy()
    assert np.isnan(np.column_stack([place, table["residual"], table["condition_number"]])[3]).all()
    known = np.arange(N) != 3
    np.testing.assert_allclose(place[known], PLACE[known], atol=1e-8)
    R = Rotation.from_euler("xyz", table.select("^orientation.*$").to_numpy()[known])
    assert (R * TURNS[known].inv()).magnitude().max() < 1e-8
    assert np.nanmax(table["residual"].to_numpy()) < 1e-9
    # the largest over the smallest singular value of J, with angles as lengths at the platform's size
    row = 20
    jacobian = gs.leg_jacobian(UNEVEN, place[row], table.select("^orientation.*$").to_numpy()[row])
    scaled = jacobian / [1, 1, 1, *[UNEVEN.characteristic_length] * 3]
    assert table["condition_number"][row] == pytest.approx(np.linalg.cond(scaled), rel=1e-6)


def test_poses_are_written_in_the_order_and_frame_of_others(folder: Path) -> None:
    """Expected: of moving axes, the angles of Z, Y', X''; north-east-down with a pivot; and quaternions."""
    encoders(lengths())
    known = np.arange(N) != 3
    cases: tuple[tuple[tuple[str, ...], FloatArray, FloatArray, Any], ...] = (
        (("--rotation-order", "XZY", "--rotation-about", "moving"), np.eye(3), np.zeros(3), "XZY"),
        (("--frame", "z_down", "--pivot", "0.1,0,-0.3"), np.diag([1.0, -1.0, -1.0]), np.array([0.1, 0, -0.3]), "xyz"),
    )
    for words, M, pivot, order in cases:
        code, said = poses(*words)
        assert code == 0, said
        table = polars.read_parquet(folder / "out/poses.parquet")
        R = Rotation.from_matrix(M @ TURNS.as_matrix() @ M)
        angles = np.zeros((N, 3))
        angles[:, ["XYZ".index(axis) for axis in order.upper()]] = R.as_euler(order)
        np.testing.assert_allclose(table.select("^orientation.*$").to_numpy()[known], angles[known], atol=1e-8)
        np.testing.assert_allclose(
            table.select("^position.*$").to_numpy()[known], ((PLACE + TURNS.apply(pivot)) @ M)[known], atol=1e-8
        )
    code, said = poses("--rotation-order", "quaternion")
    assert code == 0, said
    quaternion = polars.read_parquet(folder / "out/poses.parquet").select("^quaternion.*$").to_numpy()
    np.testing.assert_allclose(quaternion[known], TURNS.as_quat(canonical=True)[known], atol=1e-8)
    code, said = poses("--rotation-order", "zyx")
    assert (code, "three of X, Y, Z in capitals" in said) == (2, True)


def test_measured_poses_are_compared_and_their_pivot_is_found(folder: Path) -> None:
    """Expected: a tracker's target at (0.1, 0, 0.25) m of the platform, whose angles are about moving axes."""
    target = PLACE + TURNS.apply([0.1, 0, 0.25])
    angles = np.degrees(TURNS.as_euler("XYZ"))
    wrong = TURNS * Rotation.from_rotvec(np.outer(np.arange(N) == 31, [0.012, 0.0, -0.016]))
    encoders(lengths(), ";x;y;z;roll;pitch;yaw", np.hstack([1e3 * target, np.degrees(wrong.as_euler("XYZ"))]))
    code, said = poses("--rotation-about", "moving", "--pivot", "0.1,0,0.25")
    assert (code, "poses 4.6 mm and 1.146 deg" in " ".join(said.split())) == (0, True)  # |w × target| and |w|
    encoders(lengths(), ";x;y;z;roll;pitch;yaw", np.hstack([1e3 * target, angles]))
    code, said = poses("--rotation-about", "moving", "--pivot", "0,0,0.1")
    assert code == 0, said
    assert "pivot = [0.1, 0.0, 0.25] m" in " ".join(said.split()).replace("-0.0", "0.0")
    code, said = poses("--rotation-about", "moving", "--pivot", "0.1,0,0.25", "--require", "deviation.position<=1um")
    assert code == 0, said
    numbers = json.loads((folder / "out/report.json").read_text("utf-8"))["numbers"]
    assert next(row["value"] for row in numbers if row["path"] == "deviation.orientation") < 1e-8
    code, said = poses("--pivot", "0.1,0,0.25")
    assert (code, 'rotation_order = "ZYX"' in " ".join(said.split())) == (1, True)


@pytest.mark.parametrize(("low", "high"), [(2.3, 3.5), (2.95, 3.9), (None, 3.5), (2.9, None)])
def test_the_margin_of_the_stroke_is_that_of_its_nearer_end(low: Any, high: Any, folder: Path) -> None:
    """Expected: from the lengths that were written."""
    gs.save_platform(UNEVEN.with_parameters({"leg_length_min": low, "leg_length_max": high}), folder / "machine.toml")
    encoders(lengths())
    code, said = poses()
    numbers = json.loads((folder / "out/report.json").read_text("utf-8"))["numbers"]
    margin = next(row["value"] for row in numbers if row["path"] == "stroke.margin")
    L = np.delete(lengths(), 3, axis=0)
    ends = [*([] if low is None else [L.min() - low]), *([] if high is None else [high - L.max()])]
    assert margin == pytest.approx(min(ends), abs=1e-8)
    assert (code, f"up to {-1e3 * margin:.4g} mm beyond" in " ".join(said.split())) == (0, margin < 0)


def test_lengths_without_a_pose_are_refused_and_nothing_is_written(folder: Path) -> None:
    wrong = lengths()
    wrong[30, 4] = 5 * wrong.max()
    encoders(wrong)
    code, said = poses()
    assert code == 1
    assert "of row 31 " in " ".join(said.split())
    assert not (folder / "out").exists()


def test_a_log_without_a_whole_row_has_no_poses(folder: Path) -> None:
    encoders(np.full((N, 6), math.nan))
    code, said = poses()
    assert (code, "one of 50 rows has six lengths" in " ".join(said.split())) == (0, True)
    assert polars.read_parquet(folder / "out/poses.parquet")["position[1]"].is_nan().all()
