"""The report of a run: verdict, charts, scene, tables; as lines and in a notebook; from the columns of its record."""

import base64
import math
import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars
import pytest
from lxml import html
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.orientations import rotation_vectors
from tests.support.records import changed, columns, oscillating, plain, says_it_oscillates, stepping, waving_record
from tests.support.uneven import UNEVEN
from tests.support.uneven_records import BELIEVED, LEGS, MACHINE, ROWS, RUN

PLATFORM = gs.load_preset("motion_base")
BAD = '<script>alert(1)</script> & "so on"'
REPORT = RUN.report()


def up(value: float) -> float:
    """Two digits, rounded up: what "within" promises."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / step - 1e-9) * step


def first_number(text: str, after: str) -> float:
    return float(text.partition(after)[2].split()[0])


def verdict(record: gs.Record, **metadata: Any) -> Any:
    return gs.Record(record.table, {**record.metadata, **metadata}).report(charts=False).verdict


def part(report: Any, kind: str, title: str = "") -> Any:
    """The only scene, or the table or chart of a title."""
    (found,) = (p for p in report.parts() if type(p).__name__ == kind and getattr(p, "title", "") in (title, ""))
    return found


def rows_of(table: Any) -> list[tuple[str, ...]]:
    return [table.texts(k) for k in range(len(table.rows))]


# --- the verdict -----------------------------------------------------------------------------------------------------


def test_a_run_that_follows_says_how_near_and_which_limit_it_uses_most() -> None:
    """Expected: the largest distance and turn in the record's columns, rounded up; the largest share of a limit."""
    made = waving_record(PLATFORM, force_limit=None)
    weaker = {"actuator_force": 0.31 * made["actuator_force"], "leg_velocity": 0.3 * made["leg_velocity"]}
    record = changed(made, flag__force_limited=False, **weaker)
    found, limit = verdict(record), PLATFORM.leg_velocity_max or 0.0
    error = np.sqrt((record["error.position"] ** 2).sum(axis=1)).max()
    turn = np.degrees(np.sqrt((record["error.orientation"] ** 2).sum(axis=1)).max())
    assert found.text.startswith("Follows within ")
    assert first_number(found.text, "within ") == pytest.approx(up(1e3 * error))
    assert found.text.split()[3] == "mm"
    assert first_number(found.text, " and ") == pytest.approx(up(turn))
    speed = np.abs(record["leg_velocity"]).max(axis=0) / limit
    leg = int(speed.argmax())
    assert f"leg {leg + 1} uses {100 * speed[leg]:.2g} % of its speed" in found.text
    numbers = {number.path: number for number in found.numbers}
    assert numbers["tracking.position.norm_peak"].value == pytest.approx(error)
    used = numbers["limits.leg_velocity_max.used"]
    assert (used.value, used.limit, used.margin) == pytest.approx((speed[leg], 1.0, 1 - speed[leg]))
    for share, status in ((1.1, "bad"), (0.95, "marginal"), (0.85, "good")):
        assert verdict(changed(record, leg_velocity=share * limit, actuator_force=0.0)).status == status
    # of the run's actuators, which may be weaker than the platform's
    weak = changed(record, actuator_force=40.0, leg_velocity=0.0)
    assert "forces 32 % of what the drives have" in verdict(weak, force_limit=[*[200.0] * 5, 125.0]).text
    # a turn is told from a tenth of the position error on, by what it moves at the joints
    reach = np.linalg.norm(UNEVEN.platform_points, axis=1).mean()
    for share, is_told in ((0.098, False), (0.102, True)):
        turned = {"error__position": [1e-3, 0.0, 0.0], "error__orientation": [0.0, share * 1e-3 / reach, 0.0]}
        text = verdict(changed(waving_record(UNEVEN), **turned)).text
        assert (" and " in text.split(";")[0]) == is_told


@pytest.mark.parametrize("size", [0.03, -0.12])
def test_a_jump_is_judged_by_where_it_ends_and_when_it_settles(size: float) -> None:
    """Expected: r (1 − exp(−t/τ)) is within 2 % at τ ln 50; what is left is its error as the last tenth begins."""
    tau, at = 0.05, 101
    record = stepping(PLATFORM, tau, size, at=at, actuator_force=20.0)
    time, text = record["time"], verdict(record).text
    left = 1e3 * abs(size) * math.exp(-(time[-101] - time[at]) / tau)
    assert first_number(text, "Ends within ") == pytest.approx(max(up(left), 1e-3))
    assert first_number(text, "settles in ") == pytest.approx(tau * math.log(50), abs=6e-3)
    short = gs.Record(record.table.head(at + 80), record.metadata)
    unsettled = verdict(short, outcome={"status": "completed", "time": 0.18, "cause": None})
    assert "z has not settled to 2 % within 0.079 s of its step" in unsettled.text
    assert unsettled.status == "marginal"
    # of two axes the slower one counts
    late = np.maximum(time - time[at], 0.0)
    steps = {"reference.position": np.sign(late), "position": 1 - np.exp(-2 * late / tau)}
    along_x = {name.replace(".", "__"): record[name] + np.outer(x, [size, 0.0, 0.0]) for name, x in steps.items()}
    both = verdict(changed(record, **along_x))
    assert both.numbers[-1].path == "step_response.z.settling_time"
    assert first_number(both.text, "settles in ") == pytest.approx(tau * math.log(50), abs=6e-3)
    # the end of a run that ended early is not known, whenever it began
    begun = gs.Record(record.table.with_columns(polars.col("time") + 7.3), record.metadata)
    assert [verdict(begun, duration=planned).status for planned in (1.0, 2.0)] == ["good", "marginal"]
    assert verdict(begun, duration=2.0).text.startswith("Its error at the end is not known; ")
    # a reference that moves smoothly from end to end is followed, not jumped; half of it in a row is a jump
    for share, word in ((0.003, "Follows"), (0.45, "Follows"), (0.55, "Ends")):
        ramp = PLATFORM.home_position + np.outer(np.clip(share * (time - 0.1) / 1e-3, 0, 1), [0.0, 0.0, size])
        moved = changed(record, position=ramp - 2e-4, reference__position=ramp, error__position=2e-4)
        assert verdict(moved).text.startswith(f"{word} within 0.35 mm")


def test_limits_that_act_are_told_with_their_share_of_the_time() -> None:
    """Expected: flags in a quarter of the rows; a stroke that ends 20 mm before the longest leg; no limit at all."""
    made = waving_record(PLATFORM, rows=401)
    flags = (np.arange(401) // 100 == 1)[:, None] & (np.arange(6) == 4)
    assert "forces at the drives' limit for 25 % of the time" in verdict(changed(made, flag__force_limited=flags)).text
    rated = gs.Record(made.table.with_columns(**columns("flag.rate_limited", flags)), made.metadata)
    assert "forces at the drives' rate limit for 25 % of the time" in verdict(rated).text
    longest = {**made.metadata["platform"], "leg_length_max": float(made["leg_length"].max()) - 0.02}
    beyond = verdict(made, platform=longest)
    assert ("a leg is 20 mm beyond its stroke" in beyond.text, beyond.status) == (True, "bad")
    bare = {name: value for name, value in made.metadata["platform"].items() if "_max" not in name}
    peak = np.abs(made["actuator_force"]).max()
    text = verdict(changed(made, flag__force_limited=False), platform=bare, force_limit=None).text
    assert f"forces up to {math.ceil(10 * peak - 1e-9) / 10:g} N; no limit of the drives is known" in text


def test_how_a_run_ends_comes_first() -> None:
    """Expected: when and why it ended; what its loop does without input; how far an open loop goes."""
    made = waving_record(PLATFORM)
    elsewhere = {"duration": None, "experiment": {"loop": {"duration": 0.5}}}
    cases: dict[str, dict[str, Any]] = {"diverged": {}, "interrupted": elsewhere}
    for status, planned in cases.items():
        ended = verdict(made, outcome={"status": status, "time": 0.25, "cause": "the cause"}, **planned)
        assert (ended.text, ended.status) == (f"{status.title()} at 0.25 s of 0.5 s: the cause", "bad")
    swinging = oscillating(waving_record(PLATFORM, size=0.0))
    wave = swinging["error.leg_length[5]"] * 30 ** (swinging["time"] / 0.5) / 10
    growing = gs.Record(swinging.table.with_columns(**{"error.leg_length[5]": wave}), swinging.metadata)
    of_itself = "although nothing acts on the loop"
    for record, status, words in (
        (swinging, "marginal", rf"Leg 5 oscillates by 3\.\d mm at (39\.\d|40) Hz {of_itself}"),
        (growing, "bad", rf"Unstable: the error of leg 5 grows to \S+ mm( at \S+ Hz)? {of_itself}"),
    ):
        assert (verdict(record).status, bool(re.match(words, verdict(record).text))) == (status, True)
    (line,) = (line for line in repr(swinging).splitlines() if line.split()[0] == "outcome")
    assert says_it_oscillates(line.removeprefix("  outcome").strip())
    poses = [name for name in made.table.columns if not name.startswith(("error.", "reference."))]
    distance = np.linalg.norm(made["position"] - made["position"][0], axis=1).max()
    idle = changed(made, actuator_force=0.0, flag__force_limited=False, leg_velocity=0.0)
    alone = verdict(gs.Record(idle.table.select(poses), made.metadata))
    assert (alone.text.partition(" up to ")[0], alone.status) == ("Open loop: the platform moves", "told")
    assert first_number(alone.text, "up to ") == pytest.approx(up(1e3 * distance))


@pytest.mark.parametrize(
    ("alpha", "decibels", "says"), [(0.5, 4.437, "4.4 dB"), (0.3, 2.63, "2.6 dB"), (2, math.inf, "any gain")]
)
def test_robustness_is_in_decibels(alpha: float, decibels: float, says: str) -> None:
    """Expected: how much all gains may rise, rounded down; frail below a margin of 0.4; its doubt with the number."""
    record = changed(waving_record(PLATFORM), flag__force_limited=False, leg_velocity=0.0, actuator_force=20.0)
    robustness: Any = SimpleNamespace(alpha=alpha, decibels=decibels, doubt="some")
    warned = gs.Record(record.table, {**record.metadata, "warnings": ["careful"]})
    report = warned.report(robustness=robustness, charts=False)
    assert [(note.text, note.kind) for note in report.notes] == [("careful", "warning")]
    assert report.verdict.text.endswith(f"; {says} to the disk margin")
    assert report.verdict.status == ("marginal" if alpha < 0.4 else "good")
    assert (report.number("margins.disk").value, report.number("margins.disk").doubt) == (alpha, "some")


def test_what_was_set_is_told_beside_what_the_file_has() -> None:
    """Expected: the given values, and those of the shipped file; also of a second change; what the design assumes."""
    experiment = gs.load_experiment("heave_step", {"loop.duration": 0.2, "controller.bandwidth": "3 Hz"})
    changes = ["loop.duration=0.05", "reference.position_change=[0, 0, 0.01]", "plant.parameters.platform_mass=1300"]
    report = gs.run(experiment, changes).report(charts=False)
    assert {each.key: (*each.values, each.default) for each in report.settings} == {
        "loop.duration": ("0.05", "2 s"),
        "controller.bandwidth": ("3 Hz", "2 Hz"),
        "reference.position_change": ("0, 0, 0.01", "0, 0, 0.05"),
        "plant.parameters.platform_mass": ("1300", ""),
    }
    assert "platform motion_base, plant model, 0.05 s, sampled every 1 ms" in report.lead
    assert {type(each).__name__ for each in report.parts()} == {"Table"}


def test_faults_stand_in_the_verdict_and_at_their_times_in_charts() -> None:
    """Expected: the experiment's two faults, of which the run has not seen a third, in order of time."""
    cuts = [{"at": 0.1, "duration": 5, "cut": [3, 6]}, {"at": 9.0, "cut": [1]}]
    faults = [{"at": 0.3, "duration": 0.1, "freeze": {"leg_length": [2, 5]}}, *cuts]
    switched = {0.45: False, 0.25: True, 0.05: False, 0.15: False}
    changes = [{"at": at, "enabled": enabled} for at, enabled in switched.items()]
    made = waving_record(PLATFORM, rows=501)
    record = gs.Record(made.table, {**made.metadata, "experiment": {"fault": faults, "change": changes}})
    report = record.report()
    said = "Controller off from 0.05 to 0.25 s; legs 3 and 6 without force from 0.1 to 5.1 s; "
    said += "leg_length 2 and 5 frozen from 0.3 to 0.4 s; controller off from 0.45 s; "
    assert report.verdict.text.startswith(said)
    ended = verdict(record, outcome={"status": "diverged", "time": 0.2, "cause": None})
    assert ended.text.endswith("; legs 3 and 6 without force from 0.1 to 5.1 s")
    marks = [mark for mark in part(report, "Chart", "position error").marks if mark.direction == "vertical"]
    assert [(mark.value, mark.text) for mark in marks] == [
        (0.05, "controller off from"),
        (0.25, "controller off until"),
        (0.1, "legs 3 and 6 without force from"),
        (0.3, "leg_length 2 and 5 frozen from"),
        (0.4, "leg_length 2 and 5 frozen until"),
        (0.45, "controller off from"),
    ]


# --- charts ----------------------------------------------------------------------------------------------------------

XYZ, ANGLES = ("x", "y", "z"), ("roll", "pitch", "yaw")
# By title: column, group, unit, components, whether its reference is drawn, limits; the first ones are shown at first.
CHARTS: dict[str, tuple[str, str, str, tuple[str, ...], bool, tuple[float, ...]]] = {
    "position error": ("error.position", "errors", "mm", XYZ, False, ()),
    "orientation error": ("error.orientation", "errors", "deg", ANGLES, False, ()),
    "position from home": ("position", "pose", "mm", XYZ, True, ()),
    "orientation from home": ("orientation", "pose", "deg", ANGLES, True, ()),
    "actuator force": ("actuator_force", "actuators", "N", LEGS, False, (110.0, -110.0)),
    "length of legs": ("leg_length", "legs", "m", LEGS, True, (2.3, 3.85)),
    "sliding velocity of legs": ("leg_velocity", "legs", "m/s", LEGS, False, (0.6, -0.6)),
    "actuator power of legs": ("", "actuators", "W", LEGS, False, (45.0, -45.0)),
    "condition number of the leg Jacobian": ("", "legs", "1", ("condition number",), False, ()),
    "position": ("position", "pose", "m", XYZ, True, ()),
    "orientation": ("orientation", "pose", "deg", ANGLES, True, ()),
    "velocity": ("velocity", "velocities", "m/s", XYZ, True, ()),
    "angular velocity": ("angular_velocity", "velocities", "deg/s", XYZ, False, ()),
    "joint force, x": ("joint_force", "legs", "N", LEGS, False, ()),
    "joint force, y": ("joint_force", "legs", "N", LEGS, False, ()),
    "joint force, z": ("joint_force", "legs", "N", LEGS, False, ()),
    "leg length error": ("error.leg_length", "errors", "mm", LEGS, False, ()),
    "external force": ("external_force", "disturbance", "N", XYZ, False, ()),
    "external torque": ("external_torque", "disturbance", "N.m", XYZ, False, ()),
    "controller force": ("controller.force", "controller", "N", LEGS, False, ()),
    "controller feedforward": ("controller.feedforward", "controller", "N", LEGS, False, ()),
    "controller integral": ("controller.integral", "controller", "", tuple("12345678"), False, ()),
    "controller gain": ("controller.gain", "controller", "", ("controller gain",), False, ()),
    "measured leg length": ("measured.leg_length", "sensors", "m", LEGS, False, ()),
    "force limit active": ("flag.force_limited", "flags", "", LEGS, False, ()),
    "beyond the stroke": ("flag.stroke_exceeded", "flags", "", LEGS, False, ()),
    "force rate limit active": ("flag.rate_limited", "flags", "", LEGS, False, ()),
    "kinetic energy": ("kinetic_energy", "energy", "J", ("kinetic energy",), False, ()),
    "platform mass": ("platform_mass", "parameters", "kg", ("platform mass",), False, ()),
    "my sensor": ("my_sensor", "other", "", ("my sensor",), False, ()),
}


def values_of(title: str, prefix: str = "") -> FloatArray:
    """What a chart shows, from the columns of the record, in SI units."""
    column = prefix + CHARTS[title][0]
    if title == "actuator power of legs":
        return np.asarray(RUN["actuator_force"] * RUN["leg_velocity"])
    if title.startswith("condition number"):
        J = gs.leg_jacobian(MACHINE, RUN["position"], RUN["orientation"])
        arms = MACHINE.platform_points
        J[..., 3:] /= np.sqrt((arms**2).sum() / 6)
        return np.asarray(np.linalg.cond(J)[:, None])
    values = np.asarray(RUN[column], dtype=float).reshape(ROWS, -1)
    if title == "position from home":
        return np.asarray(values - MACHINE.home_position)
    if title == "orientation from home":
        return rotation_vectors(MACHINE.home_orientation, values)
    return values[:, XYZ.index(title[-1]) :: 3] if column == "joint_force" else values


def test_every_column_is_a_chart_with_its_words_unit_and_limits() -> None:
    """Expected: the table above, in its order; values of the columns; steps for what is held from row to row."""
    assert [chart.title for chart in REPORT.charts] == list(CHARTS)
    assert [chart.detail for chart in REPORT.charts] == [False] * 6 + [True] * (len(CHARTS) - 6)
    for chart in REPORT.charts:
        _, group, unit, components, has_reference, limits = CHARTS[chart.title]
        assert (chart.group, tuple(mark.value for mark in chart.marks)) == (group, limits)
        kind = "step" if group in ("actuators", "controller", "flags") else "line"
        labels = ("no", "yes") if group == "flags" else None
        assert (chart.kind, chart.y and chart.y.labels) == (kind, labels)
        assert {series.quantity.unit for series in chart.series} == {unit}
        role = "error" if group == "errors" else "actual"
        shown = [(series.component, series.role) for series in chart.series]
        roles = (role, "reference") if has_reference else (role,)
        assert shown == [(component, each) for component in components for each in roles]
        legs = [k + 1 if components == LEGS else None for k in range(len(components))]
        assert [series.leg for series in chart.series if series.role != "reference"] == legs
        for prefix in ("", "reference."):
            values = np.array([s.values for s in chart.series if (s.role == "reference") == bool(prefix)]).T
            assert not values.size or values == pytest.approx(values_of(chart.title, prefix), rel=1e-12, abs=1e-12)
    strips = {
        "force at": "bad",
        "force rate at": "neutral",
        "leg speed beyond": "published",
        "power beyond": "measured",
    }
    wanted = [(f"{name} its limit", role) for name, role in strips.items()]
    assert [(strip.name, strip.role) for strip in REPORT.charts[0].strips] == wanted


def test_charts_show_what_a_record_has() -> None:
    """Expected: no reference that is not there; two components of three as such; no row that overflows an axis."""
    names = [name for name in RUN.table.columns if not name.startswith("reference")]
    wild = RUN.table.select(names).drop("velocity[3]").with_columns(
        pl_force=polars.when(polars.col("time") > 7.5).then(1e10).otherwise(0.0)
    ).with_columns(polars.col("pl_force").alias("actuator_force[2]")).drop("pl_force")  # fmt: skip
    charts = {chart.title: chart for chart in gs.Record(wild, RUN.metadata).report().charts}
    assert [series.component for series in charts["velocity"].series] == ["1", "2"]
    assert {series.role for series in charts["position from home"].series} == {"actual"}
    assert len(charts["velocity"].series[0].values) == 201


# --- the scene -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rows", "stride"), [(2001, 1), (4004, 3)])
def test_frames_are_evenly_spaced_rows_with_first_and_last(rows: int, stride: int) -> None:
    """Expected: at most 2,001 of them, with the bits of their rows; flags of the rows up to the next one."""
    made = waving_record(PLATFORM, rows=rows, size=0.02)
    flags = np.zeros((rows, 6), dtype=bool)
    flags[[5, 9, rows - 2], [1, 2, 4]] = True
    record = changed(made, flag__force_limited=flags)
    scene = part(record.report(), "Scene")
    kept = sorted({*range(0, rows, stride), rows - 1})
    assert np.array_equal(scene.time, record["time"][kept])
    assert np.array_equal(scene.pose[:, :3], record["position"][kept])
    assert scene.flags[0].values == "".join(str(int(flags[a:b].any())) for a, b in pairwise(kept))


def test_the_scene_has_the_bodies_and_every_frame() -> None:
    """Expected: joints of the machine, poses as position and quaternion by SciPy, values of the rows."""
    scene = part(REPORT, "Scene")
    assert (scene.rows, scene.run) == (ROWS, None)
    assert np.array_equal(scene.base_points, MACHINE.base_points)
    assert np.array_equal(scene.platform_points, MACHINE.platform_points)
    for poses, position, orientation in (
        (scene.pose, RUN["position"], RUN["orientation"]),
        (scene.reference, RUN["reference.position"], RUN["reference.orientation"]),
        (scene.home[None], MACHINE.home_position[None], MACHINE.home_orientation[None]),
    ):
        assert poses[:, :3] == pytest.approx(position)
        wanted = Rotation.from_euler("xyz", orientation.copy())
        assert np.abs((Rotation.from_quat(poses[:, 3:]).inv() * wanted).magnitude()).max() < 1e-12
    for name in ("orientation", "leg_length", "actuator_force", "external_force"):
        assert getattr(scene, name) == pytest.approx(RUN[name], rel=1e-15)
    assert [flag.name for flag in scene.flags] == ["force_limited", "rate_limited", "stroke_exceeded"]
    for flag in scene.flags:
        assert flag.values == "".join(str(int(row.any())) for row in RUN[f"flag.{flag.name}"][:-1])
    bare = RUN.table.select(c for c in RUN.table.columns if not c.startswith(("reference", "flag")))
    still = bare.with_columns(**columns("external_force", np.zeros((ROWS, 3))))
    limitless = dict.fromkeys(("leg_length_min", "leg_velocity_max", "actuator_power_max", "joint_angle_max"))
    known = {**RUN.metadata, "force_limit": None, "machine": plain(MACHINE) | limitless}
    empty = part(gs.Record(still, known).report(), "Scene")
    assert [empty.reference, empty.external_force, empty.nearness, empty.flags] == [None, None, None, ()]


def nearness() -> dict[str, FloatArray]:
    """By their definitions; power counts the velocity at both ends of a row."""
    length, force, velocity = RUN["leg_length"], np.abs(RUN["actuator_force"]), np.abs(RUN["leg_velocity"])
    later = np.maximum(velocity, np.vstack([velocity[1:], velocity[-1:]]))
    angles = []
    for pose in ((RUN["position"], RUN["orientation"]), (MACHINE.home_position, MACHINE.home_orientation)):
        u = gs.leg_geometry(MACHINE, *pose).direction
        R = Rotation.from_euler("xyz", np.array(pose[1])).as_matrix()
        angles.append((u, np.einsum("...ji,...lj->...li", R, u)))
    between = [np.arccos(np.clip((a * b).sum(axis=-1), -1, 1)) for a, b in zip(*angles, strict=True)]
    return {
        "stroke": np.abs(length - (2.3 + 3.85) / 2) / ((3.85 - 2.3) / 2),
        "force": force / 110.0,
        "velocity": velocity / 0.6,
        "power": force * later / 45.0,
        "joint angle": np.maximum(*between) / 0.7,
    }


def test_nearness_to_limits_counts_each_that_is_stated() -> None:
    """Expected: the definitions, of all limits and of each alone; a stroke needs both ends, a force its loop's."""
    parts = nearness()
    scene = part(REPORT, "Scene")
    assert scene.nearness_of == tuple(parts)
    assert scene.nearness == pytest.approx(np.max(list(parts.values()), axis=0), rel=1e-6)
    names = ("leg_length_min", "leg_length_max", "leg_velocity_max", "actuator_power_max", "joint_angle_max")
    stated = {name: getattr(MACHINE, name) for name in names}
    for kept, limit, key in (
        (names[:1], None, ()),
        (names[1:2], None, ()),
        (names[:2], None, ("stroke",)),
        (names[2:3], None, ("velocity",)),
        (names[3:4], None, ("power",)),
        (names[4:], None, ("joint angle",)),
        ((), 110.0, ("force",)),
    ):
        machine = plain(MACHINE) | {name: stated[name] if name in kept else None for name in names}
        alone = part(gs.Record(RUN.table, {**RUN.metadata, "machine": machine, "force_limit": limit}).report(), "Scene")
        assert alone.nearness_of == key
        for name in key:
            assert alone.nearness == pytest.approx(parts[name], rel=1e-6, abs=1e-7)


@pytest.mark.parametrize(("low", "high"), [(2.9, 3.3), (1.5, 3.3), (2.0, 3.9), (None, None)])
def test_legs_are_drawn_for_the_lengths_that_occur_or_are_allowed(low: float | None, high: float | None) -> None:
    """Expected: the longest is spanned with 6 % of overlap, each part is at most 97 % of the shortest."""
    machine = {**plain(MACHINE), "leg_length_min": low, "leg_length_max": high}
    scene = part(gs.Record(RUN.table, {**RUN.metadata, "machine": machine}).report(), "Scene")
    shortest = min(RUN["leg_length"].min(), low or math.inf)
    longest = max(RUN["leg_length"].max(), high or 0.0)
    lower = min(0.97 * shortest, 0.53 * longest)
    assert (scene.lower, scene.upper) == pytest.approx((lower, min(0.97 * shortest, 1.06 * longest - lower)))


# --- tables ----------------------------------------------------------------------------------------------------------


def test_the_table_of_a_run() -> None:
    """Expected: by hand, what was set, six digits, empty settings left out, every part of lists and tables."""
    assert rows_of(part(REPORT, "Table", "Run")) == [
        ("outcome", "completed at 0.3 s"),
        ("plant", "fmu3"),
        ("platform", "uneven"),
        ("rows", "301"),
        ("duration", "0.3 s"),
        ("sample time", "0.002 s"),
        ("plant step", "0.001 s"),
        ("force limit", "110 N"),
        ("reference", "type sine, frequency 2.12346, position_amplitude 0.01, 0, 0.03"),
        ("controller", "type pd, gains 1, 2.5; 3, 4"),
        ("loop", "duration 0.3"),
        ("sensors", "noise leg_length 5e-06"),
        ("disturbance", "at 0.02, force 1, 2, 3"),
        ("disturbance", "at 0.04"),
    ]
    bare = {"outcome": {**RUN.metadata["outcome"], "cause": "a cause"}, "platform": plain(BELIEVED)}
    rows = rows_of(part(gs.Record(RUN.table, bare).report(), "Table", "Run"))
    assert [row[1] for row in rows] == ["completed at 0.3 s: a cause", "–", "uneven", "301"]


def test_the_table_of_limits_and_flags() -> None:
    """Expected: the largest share by leg in percent, and the time of the row at which each leg first had a flag."""
    time, expected = RUN["time"], []

    def firsts(name: str, flags: Any) -> tuple[str, ...]:
        rows = [next((k for k in range(ROWS) if flags[k, leg]), None) for leg in range(6)]
        return (name, *("never" if k is None else f"{time[k]:.4g} s" for k in rows))

    for name, values in nearness().items():
        expected.append((f"{name}, of its limit", *(f"{100 * values[:, leg].max():.4g} %" for leg in range(6))))
        if name in ("velocity", "power"):
            expected.append(firsts(f"{name}, first beyond its limit", values > 1))
    for name in ("force limited", "rate limited", "stroke exceeded"):
        expected.append(firsts(f"{name}, first", RUN[f"flag.{name.replace(' ', '_')}"]))
    assert rows_of(part(REPORT, "Table", "Limits")) == expected
    assert sum("first beyond" in row[0] and any(cell != "never" for cell in row[1:]) for row in expected) == 2
    still = changed(waving_record(PLATFORM, rows=5, size=0.0), leg_velocity=1e-9)
    rows = {row[0]: row[1:] for row in rows_of(part(still.report(), "Table", "Limits"))}
    assert rows["velocity, of its limit"] == ("< 0.001 %",) * 6


def test_the_tables_of_parameters_and_versions() -> None:
    """Expected: every parameter that is stated, in the order of the platform, and the belief only where it differs."""
    table = part(REPORT, "Table", "Platform: machine")
    assert [column.name for column in table.columns] == ["parameter", "machine", "assumed in the design"]
    rows = {row[0]: row[1:] for row in rows_of(table)}
    stated = [name for name, value in MACHINE.as_dict().items() if value is not None and name != "name"]
    assert [name.partition(" [")[0] for name in rows] == stated
    assert {name: cells for name, cells in rows.items() if cells[1]} == {
        "platform_mass [kg]": ("13", "11.5"),
        "leg_length_max [m]": ("3.85", "3.9"),
        "leg_acceleration_max [m/s²]": ("2.5", "–"),
    }
    assert rows["gravity [m/s²]"][0] == "0.9, -1.3, -9.4"
    assert rows["base_points [m]"][0].split("; ")[3] == "1.98, -0.49, -0.08"
    known = {**RUN.metadata, "machine": plain(BELIEVED)}
    same = part(gs.Record(RUN.table, known).report(), "Table", "Platform: uneven")
    assert [column.name for column in same.columns] == ["parameter", "machine"]
    assert rows_of(part(REPORT, "Table", "Versions")) == [("python", "3.x"), ("numpy", "2.y")]


# --- lines, and a notebook -------------------------------------------------------------------------------------------


def test_a_record_shows_what_it_has() -> None:
    """Expected: lines of what is known alone; metrics and a picture only with everything that they need."""
    record = waving_record(gs.load_preset("desktop_hexapod"), rows=101, plant="fmu2")
    page = html.fragment_fromstring(record._repr_html_())
    assert [table.text_content() for table in page.iter("caption")] == ["Record: six sines", "Tracking error", "Legs"]
    (image,) = page.iter("img")
    assert base64.b64decode(str(image.get("src")).partition("base64,")[2]).startswith(b"\x89PNG")
    assert image.get("alt") == "pose over time: six sines"
    known = record.metadata
    for lacks in ("platform", "plant", "outcome", "title"):
        rest = gs.Record(record.table, {name: value for name, value in known.items() if name != lacks})
        lines = repr(rest).splitlines()
        assert lines[0] == ("Record: untitled" if lacks == "title" else "Record: six sines")
        heads = [re.split(r"\s{2,}", line.strip())[0] for line in lines[1:]]
        expected = [name for name in ("platform", "plant", "outcome", "table", "time") if name != lacks]
        assert heads == [*expected, *(f"peak error of {name}" for name in ("position", "orientation", "leg length"))]
        assert ("<img" in rest._repr_html_()) == (lacks not in ("platform", "outcome"))
    for name in ("position", "orientation", "leg_length", "leg_velocity", "actuator_force"):
        assert "<img" not in gs.Record(record.table.drop(record.columns_of(name)), known)._repr_html_()
    bare = gs.Record(polars.DataFrame({"time": [0.0, 1.0], "x": [np.nan, np.nan]}), {})
    assert repr(bare).splitlines() == ["Record: untitled", "  table  2 rows, 2 columns", "  time   0 to 1 s"]
    lost = changed(record, error__position=np.nan)
    assert "nan" not in repr(lost) + repr(gs.Record(lost.table.head(0), known))


def test_what_users_write_is_text_in_a_notebook() -> None:
    """Expected: no element but those of tables and the picture, and the text as it was."""
    named = replace(gs.load_preset("desktop_hexapod"), name=BAD, source=BAD)
    ended = {"status": "stopped", "time": 0.1, "cause": BAD}
    odd = waving_record(named, rows=20, title=BAD, plant=BAD, outcome=ended)
    for text in (odd._repr_html_(), gs.metrics(odd)._repr_html_()):
        page = html.fragment_fromstring(text, create_parent="div")
        allowed = {"div", "table", "caption", "thead", "tbody", "tr", "th", "td", "span", "img", "p", "strong"}
        assert {str(element.tag) for element in page.iter()} <= allowed
        assert BAD in page.text_content()
