"""The report of a run as plain data: its verdict, and the numbers that carry it, from the columns of the record."""

import math
from typing import Any

import numpy as np
import polars
import pytest

import gough_stewart as gs
from gough_stewart.harness.report.chart import Chart
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.report.scene import Scene
from gough_stewart.harness.report.table import Table, Value
from gough_stewart.harness.results.record import Record, columns
from gough_stewart.harness.results.run_report import Robustness
from gough_stewart.model.platform_toml import load_preset
from tests.support.orientations import rotation_vectors
from tests.support.records import oscillating, waving_record

PLATFORM = load_preset("motion_base")


def with_columns(record: Record, **values: Any) -> Record:
    """The record with other values of some vectors; names have two underscores for a dot."""
    new: dict[str, Any] = {}
    for name, value in values.items():
        vector = name.replace("__", ".")
        size = len(record.columns_of(vector))
        full = np.broadcast_to(value, (record.table.height, size))
        new |= dict(zip(columns(vector, size), full.T.copy(), strict=True))
    return Record(record.table.with_columns(**{k: polars.Series(v) for k, v in new.items()}), record.metadata)


def up(value: float) -> float:
    """Two digits, rounded up: what "within" promises."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / step - 1e-9) * step


def first_number(text: str, after: str) -> float:
    return float(text.partition(after)[2].split()[0])


def test_a_run_that_follows_says_how_near() -> None:
    """Expected: the largest distance and turn in the record's columns, rounded up; the largest share of a limit."""
    made = waving_record(PLATFORM, force_limit=None)
    record = with_columns(made, flag__force_limited=False, actuator_force=0.31 * made["actuator_force"],
                          leg_velocity=0.3 * made["leg_velocity"])  # fmt: skip
    report = record.report(charts=False)
    error = np.sqrt((record["error.position"] ** 2).sum(axis=1)).max()
    turn = np.degrees(np.sqrt((record["error.orientation"] ** 2).sum(axis=1)).max())
    text = report.verdict.text
    assert text.startswith("Follows within ")
    assert first_number(text, "within ") == pytest.approx(up(1e3 * error))
    assert text.split()[3] == "mm"
    assert first_number(text, " and ") == pytest.approx(up(turn))
    speed = np.abs(record["leg_velocity"]).max(axis=0) / PLATFORM.leg_velocity_max
    leg = int(speed.argmax())
    assert f"leg {leg + 1} uses {100 * speed[leg]:.2g} % of its speed" in text
    numbers = {each.path: each for each in report.verdict.numbers}
    assert numbers["tracking.position.norm_peak"].value == pytest.approx(error)
    used = numbers["limits.leg_velocity_max.used"]
    assert (used.value, used.limit, used.margin) == pytest.approx((speed[leg], 1.0, 1 - speed[leg]))
    assert report.verdict.status == ("bad" if speed[leg] > 1 else "marginal" if speed[leg] > 0.9 else "good")


def test_every_metric_is_a_number_of_the_report() -> None:
    """Expected: the paths of `gs.metrics`, each with its value in SI units, that a requirement may name."""
    record = waving_record(PLATFORM)
    report, found = record.report(charts=False), gs.metrics(record)
    assert report.number("tracking.position.norm_rms").value == found["tracking"]["position"]["norm_rms"]
    assert report.number("stroke.shortest").value == min(found["stroke"]["shortest"])
    assert report.number("force.peak").value == max(found["force"]["peak"])
    assert report.number("tracking.orientation.norm_peak").quantity.unit == "deg"
    assert all(number.explanation for number in report.numbers)


@pytest.mark.parametrize("size", [0.03, -0.12])
def test_a_jump_is_judged_by_where_it_ends_and_when_it_settles(size: float) -> None:
    """Expected: the exponential y = r (1 − exp(−t/τ)) is within 2 % at τ ln 50; a step is no tracking error."""
    tau, n, at = 0.05, 1001, 101
    time = 1e-3 * np.arange(n)
    still = with_columns(waving_record(PLATFORM, rows=n), error__orientation=0.0, error__leg_length=0.0,
                         flag__force_limited=False, actuator_force=20.0, leg_velocity=0.0)  # fmt: skip
    wanted = np.where(np.arange(n)[:, None] >= at, [0.0, 0.0, size], 0.0)
    shape = np.where(time < time[at], 0.0, 1 - np.exp(-(time - time[at]) / tau))
    actual = shape[:, None] * np.array([0.0, 0.0, size])
    home, turned = PLATFORM.home_position, PLATFORM.home_orientation
    record = with_columns(still, position=home + actual, reference__position=home + wanted, orientation=turned,
                          reference__orientation=turned, error__position=wanted - actual)  # fmt: skip
    report = record.report(charts=False)
    left = 1e3 * abs(size) * math.exp(-(time[-1] - time[at]) / tau)
    text = report.verdict.text
    if left < 1e-3:
        assert text.startswith("Ends 0.001 mm from its reference after the step")
    else:
        assert first_number(text, "Ends ") == pytest.approx(up(left))
    assert first_number(text, "settles in ") == pytest.approx(tau * math.log(50), abs=6e-3)
    short = Record(
        record.table.head(at + 80), {**record.metadata, "outcome": {**record.metadata["outcome"], "time": 0.18}}
    )
    unsettled = short.report(charts=False).verdict
    assert "z has not settled to 2 % within 0.079 s of its step" in unsettled.text
    assert unsettled.status == "marginal"
    # a reference that moves smoothly from end to end is followed, not jumped
    ramp = np.clip((time - 0.1) / 0.3, 0, 1)[:, None] * np.array([0.0, 0.0, size])
    smooth = with_columns(record, position=home + ramp - 2e-4, reference__position=home + ramp, error__position=2e-4)
    assert smooth.report(charts=False).verdict.text.startswith("Follows within 0.35 mm")


def test_limits_that_act_are_told_with_their_share_of_the_time() -> None:
    """Expected: flags in a quarter of the rows; a stroke that ends 20 mm before the longest leg."""
    made = waving_record(PLATFORM, rows=401)
    flags = np.zeros((401, 6), dtype=bool)
    flags[100:200, 4] = True
    record = with_columns(made, flag__force_limited=flags)
    text = record.report(charts=False).verdict.text
    assert "forces at the drives' limit for 25 % of the time" in text
    chart = next(each for each in record.report().charts if each.title == "force limit active")
    assert chart.y is not None
    assert (chart.y_title, chart.y.labels, chart.kind) == ("", ("no", "yes"), "step")
    np.testing.assert_array_equal(chart.series[4].values, flags[:, 4])
    assert record.report(charts=False).verdict.status in ("marginal", "bad")
    platform = {**record.metadata["platform"], "leg_length_max": float(record["leg_length"].max()) - 0.02}
    short = Record(record.table, {**record.metadata, "platform": platform})
    verdict = short.report(charts=False).verdict
    assert "a leg is 20 mm beyond its stroke" in verdict.text
    assert verdict.status == "bad"
    weak = Record(with_columns(made, flag__force_limited=False).table, {**made.metadata, "force_limit": 125.0})
    share = np.abs(weak["actuator_force"]).max() / 125
    speed = np.abs(weak["leg_velocity"]).max() / PLATFORM.leg_velocity_max
    number = weak.report(charts=False).verdict.numbers[1]
    assert number.value == pytest.approx(max(share, speed))


def test_a_run_without_a_known_limit_says_so() -> None:
    """Expected: the largest force, rounded up to three digits."""
    bare = {name: value for name, value in waving_record(PLATFORM).metadata["platform"].items() if "_max" not in name}
    made = with_columns(waving_record(PLATFORM, force_limit=None), flag__force_limited=False)
    text = Record(made.table, {**made.metadata, "platform": bare}).report(charts=False).verdict.text
    peak = np.abs(made["actuator_force"]).max()
    assert f"forces up to {math.ceil(10 * peak - 1e-9) / 10:g} N; no limit of the drives is known" in text


@pytest.mark.parametrize(
    ("status", "said"),
    [
        ("diverged", "Diverged at 0.25 s of 0.5 s: the cause"),
        ("interrupted", "Interrupted at 0.25 s of 0.5 s: the cause"),
    ],
)
def test_a_run_that_ends_early_says_when_and_why(status: str, said: str) -> None:
    made = waving_record(PLATFORM)
    outcome = {"status": status, "time": 0.25, "cause": "the cause"}
    verdict = Record(made.table, {**made.metadata, "outcome": outcome}).report(charts=False).verdict
    assert (verdict.text, verdict.status) == (said, "bad")


@pytest.mark.parametrize("grows", [False, True])
def test_a_loop_that_moves_by_itself_is_told_first(grows: bool) -> None:
    """Expected: what `metrics` says of its oscillation."""
    record = oscillating(waving_record(PLATFORM, size=0.0))
    if grows:
        wave = record["error.leg_length[5]"] * 30 ** (record["time"] / 0.5) / 10
        record = Record(record.table.with_columns(**{"error.leg_length[5]": wave}), record.metadata)
    own = gs.metrics(record)["outcome"]["oscillation"]
    verdict = record.report(charts=False).verdict
    assert verdict.status == ("bad" if grows else "marginal")
    assert verdict.text.startswith(
        "Unstable: the error of leg 5 grows" if grows else f"Leg {own['leg']} oscillates by "
    )
    assert "although nothing acts on the loop" in verdict.text.split(";")[0]


def test_robustness_is_in_decibels() -> None:
    """Expected: 20 log10 of the largest factor that all gains may have, rounded down; frail below a margin of 0.4."""
    record = with_columns(waving_record(PLATFORM), flag__force_limited=False, leg_velocity=0.0, actuator_force=20.0)
    firm = record.report(robustness=Robustness(0.5, 3.0, (0.6, 1.6667)), charts=False)
    assert firm.verdict.text.endswith("; 4.4 dB to the disk margin")
    assert firm.verdict.status == "good"
    assert firm.number("margins.disk").value == 0.5
    frail = record.report(robustness=Robustness(0.3, 3.0, (0.74, 1.353)), charts=False)
    assert frail.verdict.text.endswith("; 2.6 dB to the disk margin")
    assert frail.verdict.status == "marginal"


def test_charts_hold_every_row_in_si_units() -> None:
    """Expected: the record's columns; errors first; references beside what follows them; limits of the platform."""
    record = waving_record(PLATFORM)
    report = record.report()
    assert [section.title for section in report.sections][:2] == ["Motion", "Metrics"]
    charts = {chart.title: chart for chart in report.charts}
    error = charts["position error"]
    assert [series.component for series in error.series] == ["x", "y", "z"]
    assert {series.role for series in error.series} == {"error"}
    for k, series in enumerate(error.series):
        np.testing.assert_allclose(series.values, record["error.position"][:, k], rtol=1e-14, atol=0)
        assert series.quantity.unit == "mm"
    legs = charts["length of legs"]
    assert [(series.leg, series.role) for series in legs.series][:4] == [
        (1, "actual"), (1, "reference"), (2, "actual"), (2, "reference")
    ]  # fmt: skip
    np.testing.assert_allclose(legs.series[7].values, record["reference.leg_length"][:, 3], rtol=1e-14)
    assert [mark.value for mark in legs.marks] == [PLATFORM.leg_length_min, PLATFORM.leg_length_max]
    turned = charts["orientation from home"].series[0]
    assert turned.quantity.unit == "deg"
    expected = rotation_vectors(PLATFORM.home_orientation, record["orientation"])[:, 0]
    np.testing.assert_allclose(turned.values, expected, rtol=1e-12, atol=1e-14)
    shown = [chart.title for chart in report.charts if not chart.detail]
    assert shown[:2] == ["position error", "orientation error"]
    assert len(shown) == 6
    assert all(chart.y_title.endswith("]") or chart.series[0].quantity.unit == "" for chart in report.charts)
    (scene,) = (part for part in report.parts() if isinstance(part, Scene))
    np.testing.assert_array_equal(scene.actuator_force, record["actuator_force"])


def tables_of(report: Report) -> dict[str, Table]:
    return {part.title: part for part in report.parts() if isinstance(part, Table)}


def test_settings_and_circumstances_are_tables() -> None:
    """Expected: what was set, beside the file's; the machine's parameters where the design assumes others."""
    machine = {"plant.parameters.platform_mass": 1300.0, "loop.duration": 0.05}
    record = gs.run("heave_step", machine)
    report = record.report()
    tables = tables_of(report)
    parameters = {row[0]: row[1:] for row in tables["Platform: motion_base"].rows}
    assert parameters["platform_mass [kg]"] == ("1300", "1216.9")
    assert parameters["leg_armature [kg]"] == ("515", "")
    run = {row[0]: row[1] for row in tables["Run"].rows}
    assert isinstance(duration := run["duration"], Value)
    assert duration.text == "0.05 s"
    assert isinstance(run["reference"], str)
    assert run["reference"].startswith("type step")
    assert not any(isinstance(part, Chart) for part in record.report(charts=False).parts())


def test_what_was_set_is_told_beside_what_the_file_has() -> None:
    """Expected: the given values, and those of the shipped file; also of a second change; none without any."""
    experiment = gs.load_experiment("heave_step", {"loop.duration": 0.2, "controller.bandwidth": "3 Hz"})
    record = gs.run(experiment, ["loop.duration=0.05", "reference.position_change=[0, 0, 0.01]"])
    settings = {each.key: (each.values, each.default) for each in record.report(charts=False).settings}
    assert settings == {
        "loop.duration": (("0.05",), "2 s"),
        "controller.bandwidth": (("3 Hz",), "2 Hz"),
        "reference.position_change": (("0, 0, 0.01",), "0, 0, 0.05"),
    }
    assert gs.run("heave_step", {"loop.delay": 0, "loop.duration": 0.05}).metadata["settings"]["loop.delay"] == {
        "value": 0,
        "file": 1,
    }
    assert gs.load_experiment("impulse").changed == {}
