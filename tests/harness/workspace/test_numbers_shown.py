"""Every number of a workspace that is shown: tables, CSV, maps and notices, recomputed pose by pose."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import product

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from gough_stewart import Platform, evaluate_poses, load_preset, sweep
from gough_stewart.harness.report.chart import Chart, Surface
from gough_stewart.harness.report.document import Note, Report
from gough_stewart.harness.report.table import Table
from gough_stewart.harness.workspace.isosurface import clearance, surface_of
from gough_stewart.harness.workspace.workspace_report import workspace_csv, workspace_report
from gough_stewart.model.kinematics import joint_angles
from gough_stewart.model.pose_limits import LARGEST_PITCH
from gough_stewart.model.workspace import Limit, PoseQualities, Workspace, limits_at
from tests.support.arrays import FloatArray
from tests.support.uneven import UNEVEN

NAMES = ("x", "y", "z", "roll", "pitch", "yaw")
LIMITED = replace(UNEVEN, leg_velocity_max=0.6, actuator_power_max=300.0)
STRONG = replace(UNEVEN, actuator_force_max=5e4, joint_angle_max=None, leg_length_min=None)
SOFT = replace(UNEVEN, leg_stiffness=3.1e6)
DESKTOP = load_preset("desktop_hexapod")
# Name, digits of the unit and factor of each result, whether less is better, and whether it ends at the border.
RESULTS: Mapping[str, tuple[str, bool, bool]] = {
    "condition_number": ("condition number", True, False),
    "payload": ("largest payload", False, False),
    "force_margin": ("force margin", False, False),
    "largest_speed": ("largest speed", False, False),
    "translational_stiffness": ("stiffness, softest direction", False, False),
    "translational_stiffness_max": ("stiffness, stiffest direction", False, False),
    "rotational_stiffness": ("stiffness, softest axis", False, False),
    "rotational_stiffness_max": ("stiffness, stiffest axis", False, False),
    "first_mode": ("first mode", False, False),
    "leg_length_margin": ("stroke left", False, True),
    "joint_angle_margin": ("joint angle left", False, True),
}
CASES: Mapping[str, tuple[Callable[[], Workspace], str, str]] = {
    "map": (lambda: sweep(LIMITED, {"z": (1.6, 4.0), "pitch": (-1.5, 1.5)}, {"x": 0.2, "yaw": -0.3}, 9), "m", "N"),
    "volume": (
        lambda: sweep(LIMITED, {"y": None, "x": (-1.0, 1.5), "z": (2.2, 3.7)}, {"roll": 0.2, "yaw": -0.3}, 6),
        "m",
        "N",
    ),
    "small": (lambda: sweep(DESKTOP, {"yaw": None, "x": (-0.07, 0.06)}, {"y": 0.01}, 8), "mm", "N"),
    "strong": (lambda: sweep(STRONG, {"x": None, "y": (-0.7, 1.9)}, points=6), "m", "kN"),
    "soft": (lambda: sweep(SOFT, {"pitch": (-0.4, 0.5), "x": (-0.6, 0.7)}, points=5), "m", "N"),
    "unlimited": (lambda: sweep(load_preset("liu2000"), {"roll": None, "z": (2.0, 2.8)}, points=5), "m", ""),
}


@pytest.fixture(autouse=True, scope="module")
def _coarse() -> Iterator[None]:
    """Surfaces that look ragged are as right, and take a second instead of ten."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gough_stewart.harness.workspace.isosurface._CELLS", 10)
        yield


def tables_of(report: Report) -> list[Table]:
    return [part for part in report.parts() if isinstance(part, Table)]


class Seen:
    """A workspace and, evaluated one by one, its poses."""

    def __init__(self, case: str) -> None:
        make, self.length, self.force = CASES[case]
        self.space = make()
        self.report = workspace_report(self.space)
        self.tables = tables_of(self.report)
        self.swept = dict(self.space.swept)
        self.each: dict[tuple[int, ...], PoseQualities] = {}
        self.poses: dict[tuple[int, ...], FloatArray] = {}
        for index in product(*(range(len(values)) for values in self.swept.values())):
            at = {**self.space.fixed, **{name: self.swept[name][k] for name, k in zip(self.swept, index, strict=True)}}
            self.poses[index] = np.array([at[name] for name in NAMES])
            self.each[index] = evaluate_poses(self.space.platform, self.poses[index][:3], self.poses[index][3:])

    def shown(self, value: float, name: str, digits: int = 4) -> str:
        """A coordinate, length or angle as text with its unit."""
        if name in NAMES[3:]:
            return f"{np.degrees(value):.{digits}g}°".replace("-0°", "0°")
        factor = 1e3 if self.length == "mm" else 1.0
        return f"{factor * value + 0.0:.{digits}g} {self.length}"

    def unit(self, result: str) -> tuple[str, float]:
        """Of a result, with the factor from SI units."""
        length = (self.length, 1e3 if self.length == "mm" else 1.0)
        return {
            "condition_number": ("", 1.0),
            "payload": ("kg", 1.0),
            "force_margin": (self.force, 1e-3 if self.force == "kN" else 1.0),
            "largest_speed": (f"{length[0]}/s", length[1]),
            "translational_stiffness": ("N/µm", 1e-6),
            "translational_stiffness_max": ("N/µm", 1e-6),
            "rotational_stiffness": ("kN.m/rad", 1e-3),
            "rotational_stiffness_max": ("kN.m/rad", 1e-3),
            "first_mode": ("Hz", 1.0),
            "leg_length_margin": length,
            "joint_angle_margin": ("°", 180 / np.pi),
        }[result]

    def results(self) -> dict[str, dict[tuple[int, ...], float]]:
        """Values by result and pose, of the results that there are."""
        some = next(iter(self.each.values()))
        return {
            name: {index: float(getattr(q, name)) for index, q in self.each.items()}
            for name in RESULTS
            if getattr(some, name) is not None
        }

    def reached(self) -> list[tuple[int, ...]]:
        return [index for index, q in self.each.items() if q.limit == 0]


@pytest.fixture(scope="module", params=CASES)
def seen(request: pytest.FixtureRequest) -> Seen:
    return Seen(request.param)


def test_lengths_of_legs_decide_between_too_short_and_too_long() -> None:
    """Expected: |t + R p − b| with SciPy's rotations, where no other limit comes first."""
    found = Seen("map")
    platform, counts = found.space.platform, {Limit.LEG_TOO_SHORT: 0, Limit.LEG_TOO_LONG: 0}
    assert platform.leg_length_min is not None
    assert platform.leg_length_max is not None
    for index, q in found.each.items():
        pose, code = found.poses[index], Limit(int(found.space.qualities.limit[index]))
        arms = Rotation.from_euler("xyz", pose[3:]).apply(platform.platform_points.copy())
        length = np.linalg.norm(pose[:3] + arms - platform.base_points, axis=1)
        assert code == int(q.limit)
        if code in counts or code == Limit.NONE:
            assert (code == Limit.LEG_TOO_SHORT) == bool(length.min() < platform.leg_length_min)
            assert (code == Limit.LEG_TOO_LONG) == bool(
                length.max() > platform.leg_length_max and length.min() >= platform.leg_length_min
            )
            counts[code] = counts.get(code, 0) + 1
    assert min(counts.values()) > 5


def test_swept_ranges(seen: Seen) -> None:
    """Expected: ends of the grid, and of what can be reached with any other coordinates; where the range comes from."""
    table = seen.tables[0]
    assert (table.title, table.heads) == (
        "Swept",
        ("", "from", "to", "points", "reached from", "reached to", "range"),
    )
    expected = []
    for axis, (name, values) in enumerate(seen.swept.items()):
        there = [values[index[axis]] for index in seen.reached()]
        origin = {"y": "computed", "yaw": "computed", "roll": "assumed"}.get(name, "given")
        if seen.force == "kN":
            origin = {"x": "computed", "y": "given"}[name]
        unit = "deg" if name in NAMES[3:] else seen.length
        texts = [seen.shown(each, name) for each in (values[0], values[-1], min(there), max(there))]
        ends = [text.rstrip("°").partition(" ")[0] for text in texts]
        expected.append((f"{name} {unit}", *ends[:2], str(len(values)), *ends[2:], origin))
    assert table.shown == expected


def test_shares_of_the_grid_that_limits_keep_from(seen: Seen) -> None:
    """Expected: shares of poses by their own limit; both kinds of joints count; a limit not stated keeps none."""
    shown = seen.tables[1]
    assert (shown.title, shown.heads) == ("Limits of the platform", ("", "value", "keeps from [%]"))
    codes, platform = [int(q.limit) for q in seen.each.values()], seen.space.platform

    def share(*limits: Limit) -> str:
        return f"{100 * sum(codes.count(int(limit)) for limit in limits) / len(codes):.3g}"

    speed, joints = seen.length + "/s", share(Limit.BASE_JOINT, Limit.PLATFORM_JOINT)
    factor = 1e3 if seen.length == "mm" else 1.0
    table = [
        ("shortest leg", platform.leg_length_min, seen.length, factor, share(Limit.LEG_TOO_SHORT)),
        ("longest leg", platform.leg_length_max, seen.length, factor, share(Limit.LEG_TOO_LONG)),
        ("leg velocity", platform.leg_velocity_max, speed, factor, ""),
        ("actuator force", platform.actuator_force_max, "N", 1.0, ""),
        ("actuator power", platform.actuator_power_max, "W", 1.0, ""),
        ("joint angle from home", platform.joint_angle_max, "°", 180 / np.pi, joints),
        ("leg acceleration", platform.leg_acceleration_max, "m/s²", 1.0, ""),
    ]  # fmt: skip
    expected = []
    for name, value, unit, by, kept in table:
        if value is None:
            expected.append((name, "not stated", "nothing" if kept else ""))
        else:
            text = f"{value * by:.0f}" if value * by >= 1e4 else f"{value * by:.4g}"
            expected.append((name, f"{text}°" if unit == "°" else f"{text} {unit}", kept))
    for limit, text in ((Limit.SINGULAR, "beyond a singular pose"), (Limit.PITCH, "pitch at ±90°")):
        if int(limit) in codes:
            expected.append((text, "", share(limit)))
    assert shown.shown == expected


def test_the_best_and_worst_of_every_result_and_where(seen: Seen) -> None:
    """Expected: least and largest over the poses that can be reached; margins end at the border and have no worst."""
    table = seen.tables[2]
    units = ["deg" if name in NAMES[3:] else seen.length for name in seen.swept]
    heads = [f"{name} [{unit}]" for name, unit in zip(seen.swept, units, strict=True)]
    assert table.title == "Where it can be reached"
    assert table.heads == ("", "", "value", *heads)
    rows, ends = table.shown, set(table.group_ends)
    reached, k = seen.reached(), 0
    for result, values in seen.results().items():
        title, is_best_low, ends_at_border = RESULTS[result]
        unit, factor = seen.unit(result)
        for word, least in (("best", is_best_low), ("worst", not is_best_low))[: 1 if ends_at_border else 2]:
            extreme = (min if least else max)(values[index] for index in reached)
            name, said, value, *place = rows[k]
            assert name == f"{title} {unit}".strip().replace("°", "deg").replace(".", "·")
            assert said == word
            assert value == (f"{extreme * factor:.0f}" if extreme * factor >= 1e4 else f"{extreme * factor:.4g}")
            places = [
                [
                    seen.shown(seen.swept[name][i], name, 3).rstrip("°m ")
                    for name, i in zip(seen.swept, index, strict=True)
                ]
                for index in reached
                if values[index] == pytest.approx(extreme, rel=1e-9)
            ]
            assert place in places
            k += 1
        assert k - 1 in ends
    assert k == len(rows)
    assert len(ends) == len(seen.results())


def test_the_size_of_the_region(seen: Seen) -> None:
    """Expected: by the trapezoidal rule over cells: poses on a face, edge or corner of the grid are parts of cells."""
    text = seen.report.verdict.text
    if any(name in NAMES[3:] for name in seen.swept):
        assert " of the grid;" in text or text.endswith("100 % of the grid")
        return
    size = 0.0
    for index in seen.reached():
        cell = 1.0
        for k, values in zip(index, seen.swept.values(), strict=True):
            cell *= (values[-1] - values[0]) / (len(values) - 1) * (0.5 if k in (0, len(values) - 1) else 1.0)
        size += cell
    power, kind = {2: ("²", "an area"), 3: ("³", "a volume")}[len(seen.swept)]
    assert f" of the grid, {kind} of {size:.4g} m{power}; " in text


@pytest.mark.parametrize(
    ("sides", "text"),
    [
        ((0.4, 0.25), "an area of 0.1 m²"),
        ((0.3, 0.333), "an area of 999 cm²"),
        ((0.004, 0.0025), "an area of 0.1 cm²"),
        ((0.003, 0.003), "an area of 9 mm²"),
        ((0.4, 0.25, 0.1), "a volume of 0.01 m³"),
        ((0.3, 0.3, 0.11), "a volume of 9900 cm³"),
        ((0.004, 0.0025, 0.0011), "a volume of 0.011 cm³"),
        ((0.003, 0.002, 0.0015), "a volume of 9 mm³"),
    ],
)
def test_a_size_is_in_the_largest_unit_that_leaves_it_a_number_to_read(sides: tuple[float, ...], text: str) -> None:
    """Expected: products of the sides, all of which can be reached; units change at 0.1 squared and 0.01 cubed."""
    over = {name: (low, low + side) for name, low, side in zip("xyz", (0.0, 0.0, 3.0), sides, strict=False)}
    report = workspace_report(sweep(load_preset("liu2000"), over, points=3), surface=False)
    assert report.verdict.text.endswith(f"100 % of the grid, {text}")
    assert report.verdict.status == "good"


def test_every_pose_is_a_row_of_the_table(seen: Seen) -> None:
    """Expected: the poses in the order of the grid, last coordinate fastest, with what each has by itself."""
    table = pl.read_csv(workspace_csv(seen.space), infer_schema_length=None)
    columns = [*NAMES, "reachable", "limit", "leg_length_margin", "joint_angle_margin", "singular_margin"]
    stiffness = [name for name in seen.results() if "stiffness" in name or name == "first_mode"]
    assert len(stiffness) == (5 if seen.space.platform is SOFT else 0)
    columns += ["condition_number", "payload", "force_margin", "largest_speed", *stiffness]
    assert table.columns == columns
    assert table.height == len(seen.each)
    for row, (index, q) in zip(table.iter_rows(named=True), seen.each.items(), strict=True):
        assert [row[name] for name in NAMES] == pytest.approx(seen.poses[index])
        assert row["reachable"] == (q.limit == 0)
        assert row["limit"] == Limit(int(q.limit)).name.lower()
        for name in table.columns[8:]:
            value = getattr(q, name)
            assert row[name] == (None if value is None else pytest.approx(float(value), rel=1e-9)), name


def test_the_maps_have_every_number(seen: Seen) -> None:
    """Expected: the grid in SI units, and by pose the limit, the clearance and all results, in slices and rows.

    Of a volume, the slice shown first is the one nearest to home, and the surface has its place, in the same units.
    """
    report = seen.report
    names = list(seen.swept)
    first, *results = report.charts
    assert first.map is not None
    assert first.map.classes == tuple(limit.text for limit in Limit)
    assert [chart.title for chart in results] == [RESULTS[name][0] for name in seen.results()]
    of_page = {"limit": {index: float(q.limit) for index, q in seen.each.items()}, **seen.results()}
    field = clearance(seen.space.platform, seen.space.qualities, seen.space.coordinates()[..., 4])
    for chart, (name, of_poses) in zip(report.charts, of_page.items(), strict=True):
        assert chart.map is not None
        assert chart.y is not None
        assert (chart.x.name, chart.y.name) == tuple(names[:2])
        axes = [chart.x, chart.y, *([chart.map.slices] if chart.map.slices else [])]
        assert [axis.quantity.unit for axis in axes] == ["deg" if n in NAMES[3:] else seen.length for n in names]
        for axis, values in zip(axes, seen.swept.values(), strict=True):
            assert axis.values.tolist() == values.tolist()
        unit, factor = ("", 1.0) if name == "limit" else seen.unit(name)
        quantity = chart.series[0].quantity
        assert quantity.unit == unit.replace("°", "deg")
        assert quantity.factor == pytest.approx(factor)
        assert chart.map.scale == ("log" if name == "condition_number" else "linear")
        for index, value in of_poses.items():
            assert chart.series[0].values[index[::-1]] == pytest.approx(value, rel=1e-9)
            assert chart.map.inside is not None
            assert chart.map.inside[index[::-1]] == field[index]
    if len(names) == 3:
        home = seen.space.platform.home_position[2]
        assert first.map.first == int(np.abs(seen.swept["z"] - home).argmin())
        (shown,) = [part for part in report.parts() if isinstance(part, Surface)]
        surface = surface_of(seen.space)
        assert surface is not None
        assert shown.names == tuple(names)
        assert shown.vertices.tolist() == surface.vertices.tolist()
        assert shown.triangles.tolist() == surface.triangles.tolist()
        assert np.log10(shown.values) == pytest.approx(surface.colour)
        assert shown.low.tolist() == [values[0] for values in seen.swept.values()]
        assert shown.high.tolist() == [values[-1] for values in seen.swept.values()]


def _point(space: Workspace) -> tuple[float, ...]:
    found = workspace_report(space, surface=False).charts[0].map
    assert found is not None
    assert found.point_name == ("home" if found.point else "")
    return found.point


def test_home_is_marked_where_a_map_goes_through_it() -> None:
    """Expected: at its first two coordinates, of a volume in the slice of its third one, and not where none goes."""
    box = {"yaw": (-0.2, 0.3), "y": (-0.3, 0.2), "x": (-0.12, 0.18)}
    assert _point(sweep(LIMITED, box, points=4)) == pytest.approx((0.11, -0.05))
    assert _point(sweep(LIMITED, box, points=5)) == ()
    assert _point(sweep(UNEVEN, {"yaw": (-0.2, 0.3), "y": (-0.3, 0.2)}, points=3)) == pytest.approx((0.11, -0.05))


def _notice(platform: Platform, over: dict[str, tuple[float, float]], at: dict[str, float]) -> str:
    return workspace_report(sweep(platform, over, at, points=3), surface=False).notes[-1].text


_NEAR = {"x": (-0.1, 0.1), "y": (0.0, 0.1)}


def test_the_limit_that_keeps_from_all_poses_is_named_with_its_number() -> None:
    """Expected: the leg or joint by inverse kinematics at the pose that is named, on the uneven platform."""

    def lengths(x: float, y: float, z: float = 2.9, pitch: float = -0.07) -> FloatArray:
        arms = Rotation.from_euler("xyz", [0.04, pitch, 0.11]).apply(UNEVEN.platform_points.copy())
        return np.asarray(np.linalg.norm(np.array([x, y, z]) + arms - UNEVEN.base_points, axis=1))

    for at, z, pitch, pick, word, limit in (
        ({"z": 1.0}, 1.0, -0.07, np.argmin, "min", 2.3),
        ({"pitch": -1.2}, 2.9, -1.2, np.argmax, "max", 3.9),
    ):
        text = _notice(UNEVEN, _NEAR, at)
        said = re.search(r"is x (\S+) m, y (\S+) m: leg (\d) is (\S+) m long; leg_length_(\w+) is (\S+) m\.", text)
        assert said, text
        found = lengths(float(said[1]), float(said[2]), z, pitch)
        assert int(said[3]) == int(pick(found)) + 1
        assert float(said[4]) == pytest.approx(found[pick(found)], rel=2e-4)
        assert (said[5], float(said[6])) == (word, limit)
    tight = replace(UNEVEN, joint_angle_max=0.1, leg_length_min=None, leg_length_max=None)
    for at, word, which in (({"x": 1.1, "z": 2.9}, "base", 0), ({"x": 0.08, "yaw": 0.3}, "platform", 1)):
        over = {"y": (-0.05, 0.0), "roll": (0.04, 0.05)}
        text = _notice(tight, over, at)
        said = re.search(
            r"is y (\S+) m, roll (\S+)°: the (\w+) joint of leg (\d) is (\S+)° from its direction at home; "
            r"joint_angle_max is 5\.73°",
            text,
        )
        assert said, text
        home = {**dict(zip(NAMES, [*UNEVEN.home_position, *UNEVEN.home_orientation], strict=True)), **at}
        home |= {"y": float(said[1]), "roll": np.radians(float(said[2]))}
        pose = np.array([home[name] for name in NAMES])
        angles = joint_angles(tight, pose[:3], pose[3:], tight.home_position, tight.home_orientation)[which]
        assert (said[3], int(said[4])) == (word, int(angles.argmax()) + 1)
        assert float(said[5]) == pytest.approx(np.degrees(angles.max()), rel=0.02)


def test_what_leads_back_home_is_said_in_the_order_of_its_use() -> None:
    """Expected: first coordinates that are fixed elsewhere, then ranges that leave home out, then the grid's points."""
    both = _notice(UNEVEN, {"x": (1.0, 1.1), "y": (0.0, 0.1)}, {"z": 1.0, "yaw": 0.5})
    assert both.endswith("Home can be reached, with z at 2.9 m, yaw at 6.303°: fix coordinates nearer to it.")
    aside = _notice(UNEVEN, {"z": (5.0, 7.0), "y": (-3.05, 3.1)}, {})
    assert aside.endswith("Home can be reached, with z at 2.9 m: sweep a range about it, or omit the range.")
    below = _notice(UNEVEN, {"z": (0.5, 7.0), "y": (3.0, 3.1)}, {})
    assert below.endswith("with y at -0.05 m: sweep a range about it, or omit the range.")
    between = _notice(UNEVEN, {"z": (0.5, 7.0), "y": (-3.05, 3.1)}, {})
    assert between.endswith("but lies between two poses of this grid: use more points or smaller ranges.")
    assert _notice(UNEVEN, _NEAR, {"roll": 1.2}).split(": ")[1].startswith("beyond a singular pose. Home")
    assert workspace_report(sweep(UNEVEN, _NEAR, points=3)).notes == ()
    for one in ("leg_length_min", "leg_length_max", "joint_angle_max"):
        without = dict.fromkeys({"leg_length_min", "leg_length_max", "joint_angle_max"} - {one})
        space = sweep(replace(UNEVEN, **without), _NEAR, points=3)  # type: ignore[arg-type]
        assert workspace_report(space).notes == ()


def test_the_report_says_each_thing_in_its_place(seen: Seen) -> None:
    """Expected: platform, ranges, share of the poses, worst values over those within reach, all tables, source."""
    space, report = seen.space, seen.report
    assert report.title == f"Workspace of {space.platform.name}"
    swept = ", ".join(f"{n} from {seen.shown(v[0], n)} to {seen.shown(v[-1], n)}" for n, v in seen.swept.items())
    fixed = ", ".join(f"{n} {seen.shown(space.fixed[n], n)}" for n in NAMES if n not in seen.swept)
    assert report.lead == f"{swept}; at {fixed}"
    # the published platform states no limits
    unstated = "liu2000 states no leg_length_min, leg_length_max or joint_angle_max: only singular poses"
    assert [note.text.startswith(unstated) for note in report.notes] == [True] * (seen.force == "")
    reached = seen.reached()
    share = report.number("reachable")
    assert share.value == pytest.approx(len(reached) / len(seen.each))
    assert share.explanation.startswith(f"{len(reached)} of {len(seen.each)} poses; ")
    for name, values in seen.results().items():
        inside = [values[index] for index in reached]
        worst = max(inside) if name == "condition_number" else min(inside)
        assert report.number(f"worst.{name}").value == pytest.approx(worst)
    # those at the border are 0 there, and say nothing
    told = [name for name in seen.results() if not RESULTS[name][2]]
    assert [each.path for each in report.verdict.numbers] == ["reachable", *(f"worst.{name}" for name in told)]
    assert len(seen.tables) == 3
    source = [part.text for part in report.parts() if isinstance(part, Note)]
    assert source == ([f"{space.platform.name}: {space.platform.source}"] if space.platform.source else [])


def test_an_empty_region_has_its_limits_and_no_results() -> None:
    """Expected: one map, and no table of what can be reached, since it has no rows."""
    space = sweep(replace(UNEVEN, source=""), _NEAR, {"z": 1.0}, points=3)
    report = workspace_report(space)
    assert [chart.title for chart in report.charts] == ["reachable region"]
    swept, limits = tables_of(report)
    assert (swept.title, limits.title) == ("Swept", "Limits of the platform")
    assert not any(isinstance(part, Note) for part in report.parts())
    assert [row[4:6] for row in swept.shown] == [("–", "–")] * 2


@pytest.mark.parametrize("aside", [-2e-9, -0.5e-9, 0.5e-9, 2e-9, -0.2, 0.2])
@pytest.mark.parametrize("name", ["z", "yaw"])
def test_a_plane_goes_through_home_where_all_other_coordinates_agree(name: str, aside: float) -> None:
    """Expected: to a billionth, from both sides; the first of two coordinates counts as the last does."""
    home = {"z": 2.9, "yaw": 0.11}
    space = sweep(UNEVEN, {"x": (-0.1, 0.12), "y": (-0.1, 0.1)}, {name: home[name] + aside}, points=3)
    assert bool(_point(space)) == (abs(aside) < 1e-9)


def test_where_home_is_told_only_for_coordinates_that_are_away_from_it() -> None:
    """Expected: above home as below; a range that ends a billionth before home includes it."""
    for away in (-0.7, 0.7):
        text = _notice(UNEVEN, {"x": (1.0, 1.1), "y": (0.0, 0.1)}, {"z": 2.9 + away, "roll": 0.04 + 1e-12})
        assert text.endswith("Home can be reached, with z at 2.9 m: fix coordinates nearer to it."), text
    for low, high in ((3.5, 3.6), (-3.2, -3.1)):
        text = _notice(UNEVEN, {"y": (low, high), "x": (-9.0, 9.0)}, {})
        assert text.endswith("with y at -0.05 m: sweep a range about it, or omit the range."), text
    for over in ({"y": (-0.05 + 5e-10, 7.0)}, {"y": (-7.0, -0.05 - 5e-10)}):
        text = _notice(replace(UNEVEN, joint_angle_max=1e-4), over | {"x": (-9.0, 9.0)}, {})
        assert text.endswith("but lies between two poses of this grid: use more points or smaller ranges."), text


def test_the_clearance_is_the_least_of_its_margins_in_their_own_scales() -> None:
    """Expected: by hand, each margin the least in turn; lengths over the characteristic length, NaN passed over."""
    size = UNEVEN.characteristic_length
    q = evaluate_poses(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation)
    nan = np.nan
    cases = [
        ((0.3 * size, 0.5, 0.4), 0.1, 0.3),
        ((-0.2 * size, 0.5, 0.4), 0.1, -0.2),
        ((0.9 * size, 0.25, 0.4), 0.1, 0.25),
        ((0.9 * size, 0.5, 0.15), 0.1, 0.15),
        ((0.9 * size, 0.5, 0.4), -1.5, LARGEST_PITCH - 1.5),
        ((0.9 * size, 0.5, 0.4), 1.5, LARGEST_PITCH - 1.5),
        ((nan, nan, 0.4), 0.0, 0.4),
    ]
    for (length, angle, singular), pitch, expected in cases:
        margins = {"leg_length_margin": length, "joint_angle_margin": angle, "singular_margin": singular}
        found = clearance(UNEVEN, q._replace(**{k: np.array(v) for k, v in margins.items()}), np.array(pitch))
        assert float(found) == pytest.approx(expected)
    alone = q._replace(leg_length_margin=None, joint_angle_margin=None, singular_margin=np.array(0.7))
    assert float(clearance(UNEVEN, alone, np.array(0.0))) == 0.7


def test_the_verdict_has_extents_share_and_the_limit_that_keeps_off_most() -> None:
    """Expected: by the limits of every pose of the grid, one by one."""
    platform = load_preset("motion_base")
    found = sweep(platform, {"x": (-1.2, 1.4), "roll": (-0.6, 0.6)}, {"z": 2.05}, 13)
    x, roll = np.linspace(-1.2, 1.4, 13), np.linspace(-0.6, 0.6, 13)
    code = np.array([[limits_at(platform, np.array([a, 0, 2.05]), np.array([b, 0, 0])) for b in roll] for a in x])
    free = code == Limit.NONE
    report = workspace_report(found)
    text = report.verdict.text
    ends = [float(n) for n in re.findall(r"-?[\d.]+(?= m\b|°)", text)][:4]
    of_x, of_roll = x[free.any(axis=1)], np.degrees(roll[free.any(axis=0)])
    assert ends == pytest.approx([of_x[0], of_x[-1], of_roll[0], of_roll[-1]], rel=6e-3)
    assert f"{100 * free.mean():.2g} % of the grid" in text
    codes, counts = np.unique(code[~free], return_counts=True)
    most = Limit(codes[counts.argmax()])
    assert text.endswith(f"{100 * counts.max() / code.size:.2g} % of it is out of reach because of {most.text}")
    assert report.number("reachable").value == pytest.approx(free.mean())
    chart = next(part for part in report.parts() if isinstance(part, Chart))
    assert chart.kind == "heat"
    assert np.array_equal(chart.series[0].values.T, code)
    assert chart.map is not None
    assert chart.map.inside is not None
    assert ((chart.map.inside.T > 0) == free).all()
    assert chart.y is not None
    assert (chart.x.name, chart.y.name) == ("x", "roll")


def test_a_grid_out_of_reach_is_bad() -> None:
    found = sweep(load_preset("motion_base"), {"x": (-1.0, 1.0), "y": (-1.0, 1.0)}, {"z": 5.0}, 5)
    report = workspace_report(found)
    assert report.verdict.text.startswith("Reaches none of 25 poses of this grid; ")
    assert report.verdict.status == "bad"
    assert report.notes[0].text.startswith("No pose of this grid can be reached")


@pytest.mark.parametrize(
    ("platform", "over", "why"),
    [
        (load_preset("liu2000"), {"yaw": (-3.0, 3.0), "x": (-0.1, 0.1)}, "out of reach beyond a singular pose"),
        (replace(load_preset("motion_base"), joint_angle_max=0.1), {"roll": (-0.5, 0.5), "x": (-0.4, 0.4)},
         "out of reach because of the angle of a base joint"),
    ],
)  # fmt: skip
def test_why_most_poses_are_out_of_reach_is_a_sentence(
    platform: Platform, over: dict[str, tuple[float, float]], why: str
) -> None:
    """Expected: written out; the platforms have one limit that keeps off most."""
    assert workspace_report(sweep(platform, over, points=9)).verdict.text.endswith(f" of it is {why}")
