"""The data of a page's charts: lines, groups that coincide, differences; every value is looked up in the record."""

import base64
from typing import Any

import numpy as np
import pytest

from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.signals import SHOWN, signals_of
from gough_stewart.harness.view.charts import chart_of, coinciding, difference
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray
from tests.support.records import waving_record


def numbers(packed: dict[str, str]) -> FloatArray:
    return np.frombuffer(base64.b64decode(packed["bdata"]), dtype=f"<{packed['dtype']}").astype(float)


def with_columns(record: Record, **columns: Any) -> Record:
    return Record(record.table.with_columns(**columns), record.metadata)


@pytest.fixture(scope="module")
def record(platform: Platform) -> Record:
    return waving_record(platform, rows=4001)


@pytest.fixture(scope="module")
def chart(record: Record, platform: Platform) -> dict[str, Any]:
    return chart_of([record], [platform])


@pytest.mark.parametrize(
    ("signal", "component", "column", "unit", "factor"),
    [
        ("position from home", 2, "position[3]", "mm", 1e3),
        ("orientation from home", 1, "orientation[2]", "deg", 180 / np.pi),
        ("error.orientation", 1, "error.orientation[2]", "deg", 180 / np.pi),
        ("actuator_force", 5, "actuator_force[6]", "N", 1.0),
        ("leg_length", 0, "leg_length[1]", "m", 1.0),
        ("reference.position from home", 0, "reference.position[1]", "mm", 1e3),
        ("flag.force_limited", 3, "flag.force_limited[4]", "", 1.0),
    ],
)
def test_points_of_a_line_are_rows_of_the_record(
    record: Record,
    platform: Platform,
    chart: dict[str, Any],
    signal: str,
    component: int,
    column: str,
    unit: str,
    factor: float,
) -> None:
    """Expected: the row's own value at the row's time, first and last row, and both extremes; at most 800 points."""
    found = chart["signals"][signal]
    assert found["unit"] == unit
    home = np.append(platform.home_position, platform.home_orientation)
    at = 0.0 if "home" not in signal else home[component + 3 * ("orientation" in signal)]
    expected = factor * (record[column].astype(float) - at)
    (group,) = [k for k, members in enumerate(found["curves"]["groups"]) if component in members]
    line = found["curves"]["lines"][0][group]
    time, values = numbers(line["x"]), numbers(line["y"])
    rows = np.round(time / 1e-3).astype(int)
    size = np.abs(expected).max() + 1e-30
    assert record["time"][rows] == pytest.approx(time, rel=1e-6)
    assert values == pytest.approx(expected[rows], rel=1e-6, abs=1e-6 * size)
    assert len(values) <= 800
    assert [rows[0], rows[-1]] == [0, 4000]
    assert (values.min(), values.max()) == pytest.approx((expected.min(), expected.max()), rel=1e-6)


def test_power_is_force_times_velocity(record: Record, chart: dict[str, Any]) -> None:
    line = chart["signals"]["actuator power"]["curves"]["lines"][0][4]
    rows = np.round(numbers(line["x"]) / 1e-3).astype(int)
    expected = [record["actuator_force[5]"][row] * record["leg_velocity[5]"][row] for row in rows]
    assert numbers(line["y"]) == pytest.approx(expected, rel=1e-6)


def test_every_column_can_be_put_on_a_chart_in_the_unit_of_its_declaration(platform: Platform) -> None:
    """Expected: each column of the record is a component of one signal, whose first value is the column's.

    Units are those of the interface, degrees in place of radians; of lengths of errors mm.
    """
    record = waving_record(platform, rows=7)
    extra = {f"joint_force[{leg},{k}]": np.arange(7.0) + leg / 8 + k for leg in range(1, 7) for k in range(1, 4)}
    extra |= {f"controller.state[{k}]": np.arange(7.0) * k for k in range(1, 9)}
    extra |= {"kinetic_energy": np.arange(7.0), "platform_mass": np.arange(7.0) + 9, "my_sensor": np.arange(7.0) - 4}
    record = with_columns(record, **extra)
    signals = signals_of([record], [platform])
    found = {signal.name: signal for signal in signals}
    assert tuple(found)[: len(SHOWN)] == SHOWN
    columns = sum(len(s.components) for s in signals if "home" not in s.name and s.name not in SHOWN[-2:])
    assert columns == len(record.table.columns) - 1
    for name, unit, group in (
        ("reference.orientation", "deg", "reference"),
        ("external_force", "N", "disturbance"),
        ("kinetic_energy", "J", "energy"),
        ("platform_mass", "kg", "parameters"),
        ("my_sensor", "", "other"),
        ("joint_force y", "N", "legs"),
        ("error.leg_length", "mm", "errors"),
    ):
        assert (found[name].unit, found[name].group) == (unit, group), name
    declared = {v.name: v.unit.replace("rad", "deg") for v in interface.RESULTS if v.unit == "rad"}
    assert all(found[name].unit == unit for name, unit in declared.items() if name in found)
    force = found["joint_force y"].values[0]
    assert force is not None
    assert np.array_equal(force[3], record.table.select([f"joint_force[{k},2]" for k in range(1, 7)]).row(3))


def test_components_coincide_where_none_is_further_than_the_least_span_from_the_first() -> None:
    """Expected: 1, 3 and 5 share a line, 2 is too far off in one row, 4 is 2 and 6 has gaps where others have none."""
    wave = np.sin(np.arange(200.0))
    apart = wave + np.where(np.arange(200) == 137, 1.1e-3, 0)
    gaps = np.where(np.arange(200) == 60, np.nan, wave)
    values = np.stack([wave, apart, wave + 9e-4, apart, wave - 9e-4, gaps], axis=1)
    assert coinciding([values], 1e-3) == [[0, 2, 4], [1, 3], [5]]
    assert coinciding([values, None, values[:, [0, 0, 1, 0, 0, 0]]], 1e-3) == [[0, 4], [1, 3], [2], [5]]
    assert coinciding([np.full((3, 2), np.nan)], 1e-3) == [[0, 1]]


def test_what_rests_up_to_rounding_is_one_line_of_a_panel_with_a_least_span(platform: Platform) -> None:
    """Expected: noise of 1e-11 m is one line for x, y, z, in a panel of a micrometre; a flag differs from another."""
    record = waving_record(platform, rows=50)
    noise = 1e-11 * np.random.default_rng(4).normal(size=(50, 3))
    record = with_columns(
        record,
        **{f"position[{k + 1}]": platform.home_position[k] + noise[:, k] for k in range(3)},
        **{f"flag.stroke_exceeded[{k}]": np.arange(50) > 40 for k in (2, 5)},
    )
    signals = chart_of([record], [platform])["signals"]
    curves = signals["position from home"]["curves"]
    assert curves["groups"] == [[0, 1, 2]]
    assert curves["least"] == 1e-3
    assert signals["flag.stroke_exceeded"]["curves"]["groups"] == [[0, 2, 3, 5], [1, 4]]


def test_a_difference_is_of_the_times_that_both_records_span() -> None:
    """Expected: of two straight lines 3 + 2t and 1 − t the line −2 − 3t, at the times of both from 0.5 s to 1 s."""
    one, other = np.arange(0, 1.01, 0.25), np.arange(0.5, 2, 0.2)
    lines = (np.stack([3 + 2 * one, one], axis=1), np.stack([1 - other, other], axis=1))
    time, values = difference((one, other), lines)
    assert time == pytest.approx([0.5, 0.7, 0.75, 0.9, 1.0])
    assert values[:, 0] == pytest.approx(-2 - 3 * time)
    assert values[:, 1] == pytest.approx(0 * time, abs=1e-15)
    assert len(difference((one, other + 5), lines)[0]) == 0


def test_a_flag_holds_in_a_difference() -> None:
    """Expected: the first flag is up from 0.2 s to 0.4 s, the other never, and nothing is between 0 and 1."""
    one, other = np.array([0.0, 0.2, 0.4]), np.array([0.0, 0.3, 0.4])
    flags = np.array([[0.0], [1.0], [0.0]]), np.zeros((3, 1))
    time, values = difference((one, other), flags, holds=True)
    assert dict(zip(time, values[:, 0], strict=True)) == {0.0: 0.0, 0.2: -1.0, 0.3: -1.0, 0.4: 0.0}


def test_records_of_different_clocks_are_compared_where_both_have_rows(platform: Platform) -> None:
    """Expected: six sines of two sizes differ by a sine; a row's straight line is off by (2π f h)²/8 of it at most."""
    records = [waving_record(platform, rows=501, size=0.04), waving_record(platform, rows=251, size=0.03, step=1.7e-3)]
    pair = chart_of(records, [platform, platform])["signals"]["position from home"]["differences"]["lines"]["0,1"]
    time, values = numbers(pair[2]["x"]), numbers(pair[2]["y"])
    amplitude = 1e3 * platform.characteristic_length * (0.03 - 0.04)
    assert time[-1] == pytest.approx(250 * 1.7e-3)
    bound = 70 * platform.characteristic_length * (2 * np.pi * 1.7e-3) ** 2 / 8
    assert values == pytest.approx(amplitude * np.sin(2 * np.pi * time), abs=bound)
    assert np.ptp(values) > 100 * bound


def test_a_reference_that_runs_share_is_kept_once(record: Record, platform: Platform) -> None:
    other = with_columns(record, **{"position[1]": record["position[1]"] + 1e-3})
    signals = chart_of([record, other], [platform, platform])["signals"]
    assert signals["reference.position from home"]["curves"]["lines"][1] == 0
    assert len(signals["position from home"]["curves"]["lines"][1]) == 3
    changes = signals["position from home"]["differences"]
    assert changes["groups"] == [[0], [1, 2]]
    # the second, moved by 1 mm, minus the first
    assert numbers(changes["lines"]["0,1"][0]["y"]) == pytest.approx(1.0)
