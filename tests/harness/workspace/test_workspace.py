"""The command `workspace`: every number that it writes, recomputed from the poses of its grid; what it refuses."""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.commands import Result, invoke
from tests.support.reports import parts_in, report_in, rows_in
from tests.support.uneven import UNEVEN

NAMES = ("x", "y", "z", "roll", "pitch", "yaw")
SPEEDS = np.array([0.6, 0.5, 0.7, 0.55, 0.65, 0.8])
LOW, HIGH = np.array([1.9, 2.2, 2.35, 2.25, 2.4, 2.1]), np.array([4.1, 3.8, 3.7, 3.95, 3.85, 3.75])
LIMITED = replace(UNEVEN, leg_velocity_max=SPEEDS, actuator_power_max=300.0)
STRONG = replace(UNEVEN, actuator_force_max=5e4, joint_angle_max=None, leg_length_min=None)
SOFT = replace(UNEVEN, leg_stiffness=3.1e6)
DESKTOP, MOTION_BASE, PAPER = (gs.load_preset(name) for name in ("desktop_hexapod", "motion_base", "liu2000"))
# At home by 69° about its pitch, so that nothing but the pitch itself ends its poses there.
PITCHED = replace(
    DESKTOP,
    platform_points=DESKTOP.platform_points @ Rotation.from_euler("y", -1.2).as_matrix(),
    home_orientation=np.array([0.0, -1.2, 0.0]),
    leg_length_min=None,
    leg_length_max=None,
    joint_angle_max=3.0,
)
# In the order of their numbers, as the table and as words have them.
LIMITS = {
    "none": "reachable",
    "pitch": "pitch at ±90°",
    "singular": "beyond a singular pose",
    "leg_too_short": "a leg too short",
    "leg_too_long": "a leg too long",
    "base_joint": "angle of a base joint",
    "platform_joint": "angle of a platform joint",
}
# Of each result its words, and its unit.
RESULTS: Mapping[str, tuple[str, str]] = {
    "condition_number": ("condition number", ""),
    "payload": ("largest payload", "kg"),
    "force_margin": ("force margin", "N"),
    "largest_speed": ("largest speed", "m/s"),
    "translational_stiffness": ("stiffness, softest direction", "N/µm"),
    "translational_stiffness_max": ("stiffness, stiffest direction", "N/µm"),
    "rotational_stiffness": ("stiffness, softest axis", "kN.m/rad"),
    "rotational_stiffness_max": ("stiffness, stiffest axis", "kN.m/rad"),
    "first_mode": ("first mode", "Hz"),
    "leg_length_margin": ("stroke left", "m"),
    "joint_angle_margin": ("joint angle left", "deg"),
}
Over = dict[str, tuple[float, float] | None]
# Platform, what is swept and fixed, points of each, units of lengths and of forces.
CASES: Mapping[str, tuple[gs.Platform, Over, dict[str, float], int, str, str]] = {
    "map": (LIMITED, {"z": (1.6, 4.0), "pitch": (-1.5, 1.5)}, {"x": 0.2, "yaw": -0.3}, 9, "m", "N"),
    "volume": (LIMITED, {"y": None, "x": (-1.0, 1.5), "z": (2.2, 3.7)}, {"roll": 0.2, "yaw": -0.3}, 6, "m", "N"),
    "small": (DESKTOP, {"yaw": None, "x": (-0.07, 0.06)}, {"y": 0.01}, 8, "mm", "N"),
    "pitched": (PITCHED, {"pitch": (-1.569, -1.0), "x": (-0.01, 0.02)}, {}, 5, "mm", "N"),
    "strong": (STRONG, {"x": None, "y": (-0.7, 1.9)}, {}, 6, "m", "kN"),
    "soft": (SOFT, {"pitch": (-0.4, 0.5), "x": (-0.6, 0.7)}, {}, 5, "m", "N"),
    "unlimited": (PAPER, {"roll": None, "z": (2.0, 2.8)}, {}, 5, "m", ""),
}


def run(platform: gs.Platform, folder: Path, over: Over, at: dict[str, float], points: int, *options: str) -> Result:
    gs.save_platform(platform, folder / "platform.toml")
    swept = ",".join(name if ends is None else f"{name}={ends[0]!r}:{ends[1]!r}" for name, ends in over.items())
    fixed = [word for name, value in at.items() for word in ("--at", f"{name}={value!r}")]
    words = ("--platform", str(folder / "platform.toml"), "--over", swept, *fixed, "--points", str(points))
    done = invoke("workspace", *words, "--out", str(folder / "out"), *options)
    assert done.exit_code == 0, done.output
    return done


def report_of(platform: gs.Platform, folder: Path, over: Over, at: dict[str, float], points: int = 3) -> dict[str, Any]:
    run(platform, folder, over, at, points)
    return report_in(folder / "out")


def numbers(values: Any) -> FloatArray:
    """An array of a report as data."""
    found = np.array(values, dtype=object)
    return np.array([np.nan if x is None else float(x) for x in found.ravel()]).reshape(found.shape)


class Seen:
    """What the command wrote of a case, and the same of its poses, which are evaluated here."""

    def __init__(self, case: str, folder: Path) -> None:
        self.platform, over, at, points, self.length, self.force = CASES[case]
        self.report = report_of(self.platform, folder, over, at, points)
        self.tables = parts_in(self.report, "table")
        self.csv = polars.read_csv(folder / "out/workspace.csv", infer_schema_length=None)
        found = gs.sweep(self.platform, over, at, points)
        self.swept, self.fixed = dict(found.swept), dict(found.fixed)
        self.shape = tuple(len(values) for values in self.swept.values())
        rows = [dict(zip(self.swept, values, strict=True)) | self.fixed for values in product(*self.swept.values())]
        self.poses = np.array([[row[name] for name in NAMES] for row in rows])
        self.each = gs.evaluate_poses(self.platform, self.poses[:, :3], self.poses[:, 3:])
        self.reached = np.asarray(self.each.limit) == 0

    def unit(self, unit: str) -> str:
        """Of a small platform, lengths in mm; of a strong one forces in kN."""
        if unit in ("m", "m/s"):
            return unit if self.length == "m" else f"m{unit}"
        return self.force if unit == "N" else unit

    def results(self) -> dict[str, FloatArray]:
        """Values by result, of the results that there are."""
        return {name: np.asarray(getattr(self.each, name)) for name in RESULTS if getattr(self.each, name) is not None}

    def text(self, value: float, name: str, digits: int = 4) -> str:
        """A coordinate as text with its unit."""
        if name in NAMES[3:]:
            return f"{np.degrees(value):.{digits}g}°".replace("-0°", "0°")
        return f"{(1e3 if self.length == 'mm' else 1.0) * value + 0.0:.{digits}g} {self.length}"

    def quantity(self, key: str) -> dict[str, Any]:
        found: dict[str, Any] = self.report["quantities"][key]
        return found


@pytest.fixture(scope="module", params=CASES)
def seen(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Seen:
    return Seen(request.param, tmp_path_factory.mktemp("workspace"))


def test_every_pose_is_a_row_of_the_table(seen: Seen) -> None:
    """Expected: the poses in the order of the grid, last coordinate fastest, with what each has by itself."""
    stiffness = [name for name in seen.results() if "stiffness" in name or name == "first_mode"]
    assert len(stiffness) == (5 if seen.platform is SOFT else 0)
    columns = [*NAMES, "reachable", "limit", "leg_length_margin", "joint_angle_margin", "singular_margin"]
    columns += ["condition_number", "payload", "force_margin", "largest_speed", *stiffness]
    assert seen.csv.columns == columns
    assert seen.csv.select(NAMES).to_numpy() == pytest.approx(seen.poses)
    assert seen.csv["reachable"].to_list() == seen.reached.tolist()
    assert seen.csv["limit"].to_list() == [[*LIMITS][code] for code in seen.each.limit]
    for name in seen.csv.columns[8:]:
        values = getattr(seen.each, name)
        if values is None:
            assert seen.csv[name].null_count() == len(seen.poses)
        else:
            np.testing.assert_allclose(seen.csv[name].to_numpy(), values, rtol=1e-9, err_msg=name)


def test_tables_have_ranges_limits_and_extremes(seen: Seen) -> None:
    """Expected: ends of the grid, and of what is reached with any other coordinates; shares of poses by their limit."""
    swept, limits, extremes = seen.tables
    assert [table["title"] for table in seen.tables] == ["Swept", "Limits of the platform", "Where it can be reached"]
    assert [column["name"] for column in swept["columns"]] == [
        *("", "from", "to", "points", "reached from", "reached to", "range")
    ]
    origins = {"y": "computed", "yaw": "computed", "roll": "assumed"}
    if seen.platform is STRONG:
        origins = {"x": "computed"}
    for name, values in seen.swept.items():
        there = seen.poses[seen.reached][:, NAMES.index(name)]
        low, high, points, *ends, origin = rows_in(swept)[name]
        assert [low, high, *ends] == pytest.approx([values[0], values[-1], there.min(), there.max()], abs=1e-12)
        assert (points, origin) == (len(values), origins.get(name, "given"))
    codes, n = np.asarray(seen.each.limit), len(seen.poses)

    def share(*names: str) -> float:
        return float(np.isin(codes, [[*LIMITS].index(name) for name in names]).mean())

    stated = {
        "shortest leg": (seen.platform.leg_length_min, share("leg_too_short")),
        "longest leg": (seen.platform.leg_length_max, share("leg_too_long")),
        "leg velocity": (seen.platform.leg_velocity_max, ""),
        "actuator force": (seen.platform.actuator_force_max, ""),
        "actuator power": (seen.platform.actuator_power_max, ""),
        "joint angle from home": (seen.platform.joint_angle_max, share("base_joint", "platform_joint")),
        "leg acceleration": (seen.platform.leg_acceleration_max, ""),
    }
    factors = {"°": 180 / np.pi, "mm": 1e3, "mm/s": 1e3}
    for name, (value, kept) in stated.items():
        text, keeps = rows_in(limits)[name]
        if value is None:
            assert (text, keeps) == ("not stated", "nothing" if kept != "" else "")
        else:
            sizes = [float(size) / factors.get(unit, 1.0) for size, unit in re.findall(r"([\d.]+) ?([^\d,]*)", text)]
            assert sizes == pytest.approx(np.ravel(value), rel=5e-4)
            assert keeps == kept
    for name in ("singular", "pitch"):
        rows = rows_in(limits)
        assert (LIMITS[name] in rows) == (share(name) > 0)
        assert share(name) == 0 or rows[LIMITS[name]][1] == pytest.approx(share(name))
    assert n == np.prod(seen.shape)
    expected, k = seen.results(), 0
    for name, values in expected.items():
        words, unit = RESULTS[name]
        for word in ("best", "worst")[: 1 if unit in ("m", "deg") else 2]:
            least = (word == "best") == (name == "condition_number")
            extreme = (np.min if least else np.max)(values[seen.reached])
            title, said, cell, *place = extremes["rows"][k]
            assert (title, said, cell["value"]) == (words, word, pytest.approx(extreme))
            assert seen.quantity(cell["quantity"]).get("unit", "") == seen.unit(unit)
            at = (np.abs(seen.poses[:, [NAMES.index(n) for n in seen.swept]] - place) < 1e-9).all(axis=1) & seen.reached
            assert values[at] == pytest.approx(extreme, rel=1e-9)
            k += 1
        assert k - 1 in extremes["group_ends"]
    assert k == len(extremes["rows"])


def test_the_maps_have_every_number(seen: Seen) -> None:
    """Expected: the grid in SI units, and by pose the limit, all results, and the distance from the nearest limit."""
    # the least margin of lengths over the characteristic length, of joints, of the pitch below 90° less 1 mrad, and the
    # smallest singular value; of a volume, the slice shown first is the one nearest to home
    charts, names = parts_in(seen.report, "chart"), list(seen.swept)
    assert charts[0]["map"]["classes"] == list(LIMITS.values())
    assert [chart["title"] for chart in charts[1:]] == [RESULTS[name][0] for name in seen.results()]
    margins = [np.asarray(seen.each.singular_margin), np.pi / 2 - 1e-3 - np.abs(seen.poses[:, 4])]
    if seen.each.leg_length_margin is not None:
        margins.append(seen.each.leg_length_margin / seen.platform.characteristic_length)
    if seen.each.joint_angle_margin is not None:
        margins.append(seen.each.joint_angle_margin)
    inside = np.fmin.reduce(margins)
    assert ((inside > 0) == seen.reached).all()
    drawn: dict[str, FloatArray] = {"limit": np.asarray(seen.each.limit, dtype=float), **seen.results()}
    for chart, (name, values) in zip(charts, drawn.items(), strict=True):
        axes = [chart["x"], chart["y"], *([chart["map"]["slices"]] if len(names) == 3 else [])]
        for axis, coordinate in zip(axes, names, strict=True):
            assert (axis["name"], axis["values"]) == (coordinate, seen.swept[coordinate].tolist())
            unit = "deg" if coordinate in NAMES[3:] else seen.length
            assert seen.quantity(axis["quantity"])["unit"] == unit
        (series,) = chart["series"]
        if name != "limit":
            assert seen.quantity(series["quantity"]).get("unit", "") == seen.unit(RESULTS[name][1])
        assert chart["map"].get("scale", "linear") == ("log" if name == "condition_number" else "linear")
        np.testing.assert_allclose(numbers(series["values"]), values.reshape(seen.shape).T, rtol=1e-9)
        np.testing.assert_allclose(numbers(chart["map"]["inside"]), inside.reshape(seen.shape).T, rtol=1e-9, atol=1e-15)
    if len(names) == 3:
        home = seen.platform.home_position[2]
        assert charts[0]["map"]["first"] == int(np.abs(seen.swept["z"] - home).argmin())


def test_the_report_says_each_thing_in_its_place(seen: Seen) -> None:
    """Expected: platform, ranges, share, extents, worst values of what is reached, the size by trapezoids, source."""
    report, verdict = seen.report, seen.report["verdict"]
    assert report["title"] == f"Workspace of {seen.platform.name}"
    swept = ", ".join(f"{n} from {seen.text(v[0], n)} to {seen.text(v[-1], n)}" for n, v in seen.swept.items())
    fixed = ", ".join(f"{n} {seen.text(seen.fixed[n], n)}" for n in NAMES if n not in seen.swept)
    assert report["lead"] == f"{swept}; at {fixed}"
    unstated = "liu2000 states no leg_length_min, leg_length_max or joint_angle_max: only singular poses"
    notes = [note["text"].startswith(unstated) for note in report.get("notes", ())]
    assert notes == [True] * (seen.platform is PAPER)
    by_path = {number["path"]: number for number in report["numbers"]}
    assert by_path["reachable"]["value"] == pytest.approx(seen.reached.mean())
    assert by_path["reachable"]["explanation"].startswith(f"{seen.reached.sum()} of {len(seen.poses)} poses; ")
    for name, values in seen.results().items():
        worst = (np.max if name == "condition_number" else np.min)(values[seen.reached])
        assert by_path[f"worst.{name}"]["value"] == pytest.approx(worst)
    # those at the border are 0 there, and say nothing
    told = [f"worst.{name}" for name in seen.results() if RESULTS[name][1] not in ("m", "deg")]
    assert [number["path"] for number in verdict["numbers"]] == ["reachable", *told]
    ends = []
    for name, values in seen.swept.items():
        there = seen.poses[seen.reached][:, NAMES.index(name)]
        is_cut = bool(there.min() == values[0] or there.max() == values[-1])
        ends.append(
            f"{name} {seen.text(there.min(), name, 3)} to {seen.text(there.max(), name, 3)}{' or more' * is_cut}"
        )
    assert verdict["text"].startswith(f"Reaches {', '.join(ends[:-1])} and {ends[-1]}; ")
    counts = np.bincount(np.asarray(seen.each.limit), minlength=len(LIMITS))[1:]
    if counts.any():
        share = f"{100 * counts.max() / len(seen.poses):.2g} % of it is out of reach"
        assert share in verdict["text"]
    sources = [part["text"] for part in parts_in(report, "note")]
    assert sources == ([f"{seen.platform.name}: {seen.platform.source}"] if seen.platform.source else [])
    if not any(name in NAMES[3:] for name in seen.swept):
        size = seen.reached.reshape(seen.shape).astype(float)
        for values in reversed([*seen.swept.values()]):
            size = np.trapezoid(size, values, axis=-1)
        power, kind = {2: ("²", "an area"), 3: ("³", "a volume")}[len(seen.swept)]
        assert f" of the grid, {kind} of {float(size):.4g} m{power}" in verdict["text"]


@pytest.mark.parametrize(
    ("sides", "text"),
    [
        ((0.4, 0.25), "an area of 0.1 m²"),
        ((0.3, 0.333), "an area of 999 cm²"),
        ((0.003, 0.003), "an area of 9 mm²"),
        ((0.4, 0.25, 0.1), "a volume of 0.01 m³"),
        ((0.004, 0.0025, 0.0011), "a volume of 0.011 cm³"),
        ((0.003, 0.002, 0.0015), "a volume of 9 mm³"),
    ],
)
def test_a_size_is_in_the_largest_unit_that_leaves_it_a_number_to_read(
    sides: tuple[float, ...], text: str, tmp_path: Path
) -> None:
    """Expected: products of the sides, all of which can be reached; units change at 0.1 squared and 0.01 cubed."""
    over: Over = {name: (low, low + side) for name, low, side in zip("xyz", (0.0, 0.0, 3.0), sides, strict=False)}
    verdict = report_of(PAPER, tmp_path, over, {})["verdict"]
    assert verdict["text"].endswith(f"100 % of the grid, {text}")
    assert verdict["status"] == "good"


_NEAR: Over = {"x": (-0.1, 0.1), "y": (0.0, 0.1)}


@pytest.mark.parametrize(
    ("over", "at", "points", "home"),
    [
        # of a volume in the slice of its third coordinate
        ({"yaw": (-0.2, 0.3), "y": (-0.3, 0.2), "x": (-0.12, 0.18)}, {}, 4, (0.11, -0.05)),
        ({"yaw": (-0.2, 0.3), "y": (-0.3, 0.2), "x": (-0.12, 0.18)}, {}, 5, None),
        # to a billionth, from both sides
        (_NEAR, {"z": 2.9 - 0.5e-9}, 3, (0.08, -0.05)),
        (_NEAR, {"z": 2.9 - 2e-9}, 3, None),
        (_NEAR, {"yaw": 0.11 + 0.5e-9}, 3, (0.08, -0.05)),
        (_NEAR, {"yaw": 0.11 + 2e-9}, 3, None),
    ],
)
def test_home_is_marked_where_a_map_goes_through_it(
    over: Over, at: dict[str, float], points: int, home: tuple[float, float] | None, tmp_path: Path
) -> None:
    """Expected: at its first two coordinates where all others agree, and not elsewhere."""
    drawn = parts_in(report_of(LIMITED, tmp_path, over, at, points), "chart")[0]["map"]
    assert drawn.get("point") == (None if home is None else pytest.approx(home))
    assert drawn.get("point_name") == (None if home is None else "home")


def test_the_limit_that_keeps_from_all_poses_is_named_with_its_number(tmp_path: Path) -> None:
    """Expected: the leg by inverse kinematics, the joint by the angle from its direction at home, at the pose named."""

    def notice(platform: gs.Platform, over: Over, at: dict[str, float]) -> str:
        return str(report_of(platform, tmp_path, over, at)["notes"][-1]["text"])

    def legs(values: Mapping[str, float]) -> Any:
        position, orientation = (np.array([values[name] for name in names]) for names in (NAMES[:3], NAMES[3:]))
        return gs.leg_geometry(UNEVEN, position, orientation), Rotation.from_euler("xyz", orientation).as_matrix()

    home = dict(zip(NAMES, [*UNEVEN.home_position, *UNEVEN.home_orientation], strict=True))
    six = replace(UNEVEN, leg_length_min=LOW, leg_length_max=HIGH)
    for at, word, ends, sign in (({"z": 1.0}, "min", LOW, -1), ({"pitch": -1.2}, "max", HIGH, 1)):
        text = notice(six, _NEAR, at)
        said = re.search(r"is x (\S+) m, y (\S+) m: leg (\d) is (\S+) m long; leg_length_(\w+) is (\S+) m\.", text)
        assert said, text
        length = legs({**home, **at, "x": float(said[1]), "y": float(said[2])})[0].length
        leg = int(np.argmax(sign * (length - ends)))
        assert (leg > 0, said[3], said[4]) == (True, str(leg + 1), f"{length[leg]:.4g}")
        assert (said[5], float(said[6])) == (word, ends[leg])
    # known, so that a requirement on it is inconclusive
    numbers = {
        number["path"]: number.get("value") for number in report_of(UNEVEN, tmp_path, _NEAR, {"z": 1.0})["numbers"]
    }
    assert numbers["worst.condition_number"] is None
    tight = replace(UNEVEN, joint_angle_max=0.1, leg_length_min=None, leg_length_max=None)
    for at, word in (({"x": 1.1, "z": 2.9}, "base"), ({"x": 0.08, "yaw": 0.3}, "platform")):
        text = notice(tight, {"y": (-0.05, 0.0), "roll": (0.04, 0.05)}, at)
        words = r"is y (\S+) m, roll (\S+)°: the (\w+) joint of leg (\d) is (\S+)° from its direction at home; "
        said = re.search(rf"{words}joint_angle_max is 5\.73°", text)
        assert said, text
        here = {**home, **at, "y": float(said[1]), "roll": np.radians(float(said[2]))}
        (now, R), (then, R0) = legs(here), legs(home)
        turn = R @ R0.T if word == "platform" else np.eye(3)
        angles = np.arccos((now.direction @ turn * then.direction).sum(axis=1))
        assert (said[3], int(said[4])) == (word, int(angles.argmax()) + 1)
        assert float(said[5]) == pytest.approx(np.degrees(angles.max()), rel=0.02)


@pytest.mark.parametrize(
    ("over", "at", "says"),
    [
        # first coordinates that are fixed elsewhere, then ranges that leave home out, then the grid's points
        ({"x": (1.0, 1.1), "y": (0.0, 0.1)}, {"z": 1.0, "yaw": 0.5},
         "with z at 2.9 m, yaw at 6.303°: fix coordinates nearer to it."),
        ({"x": (1.0, 1.1), "y": (0.0, 0.1)}, {"z": 3.6, "roll": 0.04 + 1e-12},
         "with z at 2.9 m: fix coordinates nearer to it."),
        ({"z": (5.0, 7.0), "y": (-3.05, 3.1)}, {}, "with z at 2.9 m: sweep a range about it, or omit the range."),
        ({"y": (-3.2, -3.1), "x": (-9.0, 9.0)}, {}, "with y at -0.05 m: sweep a range about it, or omit the range."),
        ({"z": (0.5, 7.0), "y": (-3.05, 3.1)}, {},
         "but lies between two poses of this grid: use more points or smaller ranges."),
        (_NEAR, {"roll": 1.2}, "with roll at 2.292°: fix coordinates nearer to it."),
    ],
)  # fmt: skip
def test_what_leads_back_home_is_said_in_the_order_of_its_use(
    over: Over, at: dict[str, float], says: str, tmp_path: Path
) -> None:
    """Expected: written out; nothing of a region that has poses, by any one limit; a bad verdict, and no results."""
    report = report_of(replace(UNEVEN, source=""), tmp_path, over, at)
    text = report["notes"][-1]["text"]
    assert text.startswith("No pose of this grid can be reached")
    assert text.endswith(f"Home can be reached, {says}")
    assert report["verdict"]["text"].startswith("Reaches none of 9 poses of this grid; ")
    assert report["verdict"]["status"] == "bad"
    assert [chart["title"] for chart in parts_in(report, "chart")] == ["reachable region"]
    assert [table["title"] for table in parts_in(report, "table")] == ["Swept", "Limits of the platform"]
    assert parts_in(report, "note") == []
    for one in ("leg_length_min", "leg_length_max", "joint_angle_max"):
        without = dict.fromkeys({"leg_length_min", "leg_length_max", "joint_angle_max"} - {one})
        if over is _NEAR:
            assert "notes" not in report_of(replace(UNEVEN, **without), tmp_path, _NEAR, {})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("platform", "over", "why"),
    [
        (PAPER, {"yaw": (-3.0, 3.0), "x": (-0.1, 0.1)}, "beyond a singular pose"),
        (replace(MOTION_BASE, joint_angle_max=0.1), {"roll": (-0.5, 0.5), "x": (-0.4, 0.4)},
         "because of the angle of a base joint"),
        (MOTION_BASE, {"x": (-1.2, 1.4), "roll": (-0.6, 0.6)}, "because of a leg too short"),
    ],
)  # fmt: skip
def test_why_most_poses_are_out_of_reach_is_a_sentence(
    platform: gs.Platform, over: Over, why: str, tmp_path: Path
) -> None:
    """Expected: written out; the platforms have one limit that keeps off most."""
    verdict = report_of(platform, tmp_path, over, {}, 9)["verdict"]["text"]
    assert verdict.endswith(f" of it is out of reach {why}")


def test_a_surface_lies_where_a_leg_reaches_its_limit(tmp_path: Path) -> None:
    """Expected: inside the box, |p + R b − B| of some leg is its limit: to 0.1 mm, at edges to a fine cell of 5 mm."""
    platform = replace(DESKTOP, joint_angle_max=None)
    over: Over = {"x": (-0.14, 0.14), "z": (0.06, 0.26), "pitch": (-0.6, 0.6)}
    done = run(platform, tmp_path, over, {"y": 0.004, "roll": 0.02, "yaw": -0.05}, 7, "--json")
    (surface,) = parts_in(json.loads(done.stdout), "surface")
    low, high = np.array([over[name] for name in over]).T
    assert (surface["names"], surface["low"], surface["high"]) == (list(over), low.tolist(), high.tolist())
    vertices = np.array(surface["vertices"])
    rows = ((vertices > low + 1e-9) & (vertices < high - 1e-9)).all(axis=1)
    inside = vertices[rows]
    assert len(inside) > 500
    angles = np.column_stack([np.full(len(inside), 0.02), inside[:, 2], np.full(len(inside), -0.05)])
    position = np.column_stack([inside[:, 0], np.full(len(inside), 0.004), inside[:, 1]])
    arms = np.einsum("nij,kj->nki", Rotation.from_euler("xyz", angles).as_matrix(), platform.platform_points)
    length = np.linalg.norm(position[:, None] + arms - platform.base_points, axis=2)
    assert platform.leg_length_min is not None
    assert platform.leg_length_max is not None
    margin = np.minimum(length - platform.leg_length_min, platform.leg_length_max - length).min(axis=1)
    assert np.quantile(np.abs(margin), 0.9) < 1e-4
    assert np.abs(margin).max() < 5e-3
    number = np.asarray(gs.evaluate_poses(platform, position, angles).condition_number)
    np.testing.assert_allclose(np.array(surface["values"])[rows], number, rtol=0.03)


REFUSED = {
    "--over x,q": "--over x,q: unknown coordinate 'q'; expected one of x, y, z, roll, pitch, yaw",
    "--over x": "1 swept coordinates; expected two for maps, or three for a volume",
    "--over x,x": "x appears twice; expected each coordinate once",
    "--over x=1,y": "found the range '1' for x; expected LOW:HIGH",
    "--over x=1:-1,y": "x goes from 1 m to -1 m; expected a range from low to high",
    "--over x=-1deg:1,y": "x is '-1deg'; expected a number of m, or a string with one of the units m, cm",
    "--over x=:1,y": "x is ''; expected a number of m",
    "--over z,y --at z=2": "z is both swept and fixed; expected one of them",
    "--at z": "--at z: found no value; expected NAME=VALUE",
    "--at height=2": "--at height=2: unknown coordinate 'height'",
    "--at z=2 --at z=3": "z is fixed twice; expected one value",
    "--at yaw=high": "yaw is 'high'; expected a number of rad, or a string with one of the units rad, mrad, urad",
    "--over x,y --at pitch=100deg": "pitch is 1.74533 rad, 100°; expected from −90° to 90°",
    "--at z=1e400": "expected a number of at most 1e+12",
    "--points 501": "501 points per coordinate, in all 251,001 poses, for 2 swept coordinates",
    "--points 0": "0 points per coordinate for 2 swept coordinates; expected from 2 to 500",
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_cannot_be_is_one_clear_line_and_no_file(words: str, tmp_path: Path) -> None:
    done = invoke("workspace", *words.split(), "--out", str(tmp_path / "out"), columns=120)
    assert done.exit_code == 2
    assert REFUSED[words] in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
