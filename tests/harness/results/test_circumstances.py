"""How a run was made, as tables: settings, limits, parameters, versions; of uneven records, by hand."""

from typing import Any

import numpy as np

from gough_stewart.harness.report.table import Table
from gough_stewart.harness.results.circumstances import limits_table, parameters_table, run_table, versions_table
from gough_stewart.harness.results.record import Record, plain
from gough_stewart.harness.results.scene import nearness_to_limits
from gough_stewart.model.platform_toml import load_preset
from tests.support.records import waving_record
from tests.support.uneven_records import BELIEVED, MACHINE, ROWS, RUN


def rows_of(table: Table) -> list[tuple[str, ...]]:
    return [table.texts(k) for k in range(len(table.rows))]


def heads_of(table: Table) -> tuple[str, ...]:
    return tuple(column.name for column in table.columns)


def test_the_table_of_a_run() -> None:
    """Expected: by hand, what was set, six digits, empty settings left out, every part of lists and tables."""
    sheet = run_table(RUN, BELIEVED)
    assert (sheet.title, heads_of(sheet)) == ("Run", ("", ""))
    assert rows_of(sheet) == [
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
    bare = Record(RUN.table, {"outcome": {**RUN.metadata["outcome"], "cause": "a cause"}, "platform": plain(BELIEVED)})
    assert rows_of(run_table(bare, BELIEVED)) == [
        ("outcome", "completed at 0.3 s: a cause"),
        ("plant", "–"),
        ("platform", "uneven"),
        ("rows", "301"),
    ]
    every = (
        "reference",
        "controller",
        "loop",
        "sensors",
        "actuators",
        "limits",
        "start",
        "change",
        "disturbance",
        "fault",
    )
    full = Record(RUN.table, {**RUN.metadata, "experiment": {name: {"k": n} for n, name in enumerate(reversed(every))}})
    assert rows_of(run_table(full, BELIEVED))[8:] == [(name, f"k {9 - n}") for n, name in enumerate(every)]


def test_the_table_of_limits_and_flags() -> None:
    """Expected: the largest share by leg in percent, and the time of the row at which each leg first had a flag."""
    sheet = limits_table(RUN, MACHINE)
    assert sheet is not None
    assert (sheet.title, heads_of(sheet)) == ("Limits", ("leg", *"123456"))
    parts = dict(nearness_to_limits(RUN, MACHINE))
    time, expected = RUN["time"], []

    def firsts(name: str, up: Any) -> tuple[str, ...]:
        rows = [next((k for k in range(ROWS) if up[k, leg]), None) for leg in range(6)]
        return (name, *("never" if k is None else f"{time[k]:.4g} s" for k in rows))

    for name, values in parts.items():
        shares = tuple(f"{100 * values[:, leg].max():.4g} %" for leg in range(6))
        expected.append((f"{name}, of its limit", *shares))
        if name in ("velocity", "power"):
            expected.append(firsts(f"{name}, first beyond its limit", values > 1))
    for name in ("force limited", "rate limited", "stroke exceeded"):
        up = np.asarray(RUN[f"flag.{name.replace(' ', '_')}"], dtype=bool)
        expected.append(firsts(f"{name}, first", up))
    assert rows_of(sheet) == expected
    assert {cell == "never" for row in expected for cell in row[1:]} == {True, False}
    assert sum("first beyond" in row[0] and any(c != "never" for c in row[1:]) for row in expected) == 2


def test_the_tables_of_parameters_and_versions() -> None:
    """Expected: every parameter that is stated, in the order of the platform, and the belief only where it differs."""
    sheet = parameters_table(MACHINE, BELIEVED)
    assert (sheet.title, heads_of(sheet)) == ("Platform: machine", ("parameter", "machine", "assumed in the design"))
    rows = {row[0]: row[1:] for row in rows_of(sheet)}
    stated = [name for name, value in MACHINE.as_dict().items() if value is not None and name != "name"]
    assert [name.partition(" [")[0] for name in rows] == stated
    assert rows["platform_mass [kg]"] == ("13", "11.5")
    assert rows["leg_length_max [m]"] == ("3.85", "3.9")
    assert rows["leg_acceleration_max [m/s²]"] == ("2.5", "–")
    assert rows["gravity [m/s²]"] == ("0.9, -1.3, -9.4", "")
    assert rows["source"] == ("made up for tests", "")
    assert rows["base_points [m]"][0].split("; ")[3] == "1.98, -0.49, -0.08"
    assert rows["leg_viscous_friction_factor [1]"] == ("0.7, 1.4, 0.9, 1.6, 0.5, 1.1", "")
    assert [row[0] for row in rows.items() if row[1][1]] == [
        "platform_mass [kg]",
        "leg_length_max [m]",
        "leg_acceleration_max [m/s²]",
    ]
    same = parameters_table(BELIEVED, BELIEVED)
    assert (same.title, heads_of(same)) == ("Platform: uneven", ("parameter", "machine"))
    assert {len(row) for row in same.rows} == {2}
    versions = versions_table(RUN)
    assert (versions.title, heads_of(versions), rows_of(versions)) == (
        "Versions",
        ("package", "version"),
        [("python", "3.x"), ("numpy", "2.y")],
    )


def test_what_is_less_than_the_least_of_its_unit_is_shown_as_less() -> None:
    """Expected: of 1e-9 m/s and 0.8 m/s a share below 0.001 %, as that."""
    base = load_preset("motion_base")
    still = waving_record(base, rows=5, size=0.0)
    slow = {f"leg_velocity[{k}]": np.full(5, 1e-9) for k in range(1, 7)}
    table = limits_table(Record(still.table.with_columns(**slow), still.metadata), base)
    assert table is not None
    assert {row[0]: row[1:] for row in rows_of(table)}["velocity, of its limit"] == ("< 0.001 %",) * 6
