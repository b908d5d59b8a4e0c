"""All that is said of one ensemble of an uneven machine in trouble, against the records of its members."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.commands import Result, invoke
from tests.support.metric_definitions import as_one_number, defined_metrics
from tests.support.reports import parts_in, report_in, rows_in
from tests.support.uneven import UNEVEN

LIMITS: dict[str, Any] = {"leg_velocity_max": 0.25, "actuator_force_max": 90.0, "actuator_power_max": 20.0}
MACHINE = replace(UNEVEN, leg_length_min=2.6, leg_length_max=3.44, **LIMITS)
TOML = """
title = "machines in trouble"
platform.file = "uneven.toml"
plant.parameters = { platform_mass = 13.9, platform_com = [0.02, -0.07, 0.11] }
loop = { duration = 0.3, sample_time = 0.005, plant_step = 0.0025, delay = 1 }
sensors.noise.leg_length = "0.3 mm"
actuators = { force_limit = 110.0, rate_limit = 1500.0 }
limits = { reference = "warn", position_error = 0.075 }
[reference]
type = "point_to_point"
position_change = [0.061, -0.047, 0.083]
orientation_change = [0.071, -0.064, 0.095]
at = 0.03
duration = 0.1
[controller]
type = "pid"
proportional_gain = [1100.0, 1450.0, 900.0, 1250.0, 1600.0, 1000.0]
derivative_gain = [110.0, 140.0, 95.0, 125.0, 150.0, 105.0]
integral_gain = [900.0, 1500.0, 700.0, 1100.0, 2000.0, 800.0]
feedforward = "gravity"
[[disturbance]]
at = 0.06
duration = 0.05
force = [40.0, -30.0, 55.0]
torque = [9.0, -7.0, 5.0]
[ensemble]
members = 14
seed = 11
worst = 14
worst_by = "force.rms"
margins = true
signals = SIGNALS
platform_mass = { normal = [12, 8] }
base_points = { normal = "2 mm" }
leg_viscous_friction = { lognormal = 0.5 }
loop.delay = { choice = [0, 1, 3] }
controller.proportional_gain = { factor = { uniform = [0.7, 1.3] } }
actuators.force_limit = { uniform = [85, 120] }
reference.position_change = { factor = { uniform = [0.5, 1.0] } }
sensors.noise.leg_length = { uniform = [1e-4, 5e-4] }
disturbance.1.force = { normal = "20 N" }
platform.leg_length_max = { uniform = [3.37, 3.55] }
platform.actuator_power_max = { uniform = [10, 30] }
[[ensemble.correlation]]
of = ["platform_mass", "leg_viscous_friction"]
matrix = [[1.0, 0.6], [0.6, 1.0]]
"""
NORMS = ("error.position.norm", "error.orientation.norm")
SIGNALS = [
    *("position", "orientation", "velocity", "angular_velocity", "leg_length", "leg_velocity", "actuator_force"),
    *("error.position", "error.orientation", "error.leg_length", *NORMS),
]
LEVELS = {"q05": 0.05, "q25": 0.25, "q50": 0.5, "q75": 0.75, "q95": 0.95}


@dataclass(frozen=True)
class Done:
    """The command's output, its folder, and what it has of every member."""

    result: Result
    folder: Path
    members: polars.DataFrame
    records: Mapping[int, gs.Record]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Done:
    """The ensemble; all members that can run are among the worst, so that each has a record."""
    folder = tmp_path_factory.mktemp("whole")
    gs.save_platform(MACHINE, folder / "uneven.toml")
    (folder / "differ.toml").write_text(TOML.replace("SIGNALS", json.dumps(SIGNALS)))
    out = folder / "out"
    result = invoke("ensemble", str(folder / "differ.toml"), "--workers", "1", "--out", str(out))
    members = polars.read_parquet(out / "members.parquet")
    numbers = [int(path.name.removeprefix("member-")) for path in (out / "worst").glob("member-*")]
    return Done(result, out, members, {k: gs.read_record(out / "worst" / f"member-{k}") for k in sorted(numbers)})


def test_members_end_in_all_ways(done: Done) -> None:
    """Members that are alike would hide what is mixed up: here six complete, three diverge, and five cannot run."""
    assert done.result.exit_code == 0, done.result.output
    outcome = done.members["outcome"].to_list()
    assert {each: outcome.count(each) for each in set(outcome)} == {"completed": 6, "diverged": 3, "impossible": 5}
    assert list(done.records) == [k for k, each in enumerate(outcome) if each != "impossible"]
    assert len(set(done.members["ended"].drop_nulls().to_list())) >= 3


def test_the_command_names_all_that_it_wrote(done: Done) -> None:
    """Expected: what is in its folder."""
    named = re.search(r"members\.parquet(?:, [\w.-]+)+", " ".join(done.result.output.split()))
    assert named is not None
    assert sorted(named[0].split(", ")) == sorted(path.name for path in done.folder.iterdir())


def test_every_number_of_a_member_is_that_of_its_record(done: Done) -> None:
    """Expected: metrics by definition, from the rows of each record and the limits of its own nominal platform."""
    other = {"member", "outcome", "ended", "cause", "integration_error", "internal_steps"}
    other |= {"margins.stable", "margins.disk", "oscillation", "oscillation.amplitude", "oscillation.frequency"}
    metrics = [name for name in done.members.columns if name not in other and not name.startswith("varied.")]
    known = set[str]()
    for k, record in done.records.items():
        row = done.members.row(k, named=True)
        outcome = record.metadata["outcome"]
        assert [row[name] for name in ("outcome", "ended", "cause")] == list(outcome.values())
        platform, machine, experiment = (record.metadata[name] for name in ("platform", "machine", "experiment"))
        ran_with = {
            **{f"platform.{name}": platform[name] for name in ("leg_length_max", "actuator_power_max")},
            **{name: machine[name] for name in ("platform_mass", "leg_viscous_friction")},
            "loop.delay": experiment["loop"]["delay"],
            "sensors.noise.leg_length": experiment["sensors"]["noise"]["leg_length"],
            "actuators.force_limit": record.metadata["force_limit"],
            "controller.proportional_gain.factor": experiment["controller"]["proportional_gain"][0] / 1100,
        }
        assert row["member"] == k
        assert {name: row[f"varied.{name}"] for name in ran_with} == pytest.approx(ran_with, rel=1e-14)
        expected = as_one_number(defined_metrics(record.table, platform, outcome["status"] == "completed"))
        known |= set(expected)
        for name in metrics:
            value = expected.get(name)
            assert row[name] == (None if value is None else pytest.approx(value, rel=1e-11, abs=1e-13)), (k, name)
    assert known == set(metrics)
    for k in set(range(14)) - set(done.records):
        row = done.members.row(k, named=True)
        assert row["cause"]
        unknown = {*metrics, *other} - {"member", "outcome", "cause"}
        assert {row[name] for name in unknown} == {None}


def test_a_member_is_the_same_in_the_ensemble_and_in_a_run(done: Done) -> None:
    """Expected: its record bit for bit from `run --member`; the nominal machine has the experiment's own noise."""
    file = done.folder.parent / "differ.toml"
    k, record = next((k, each) for k, each in done.records.items() if done.members["outcome"][k] == "completed")
    alone = gs.run(file, {"ensemble.worst": 1}, member=k)
    assert alone.table.equals(record.table)
    assert alone.metadata["settings"] == {"ensemble.worst": {"value": 1, "file": 14}}
    nominal, own = gs.read_record(done.folder / "worst" / "nominal"), gs.run(file)
    assert nominal.metadata["seed"] == own.metadata["seed"]
    np.testing.assert_allclose(nominal["measured.leg_length"], own["measured.leg_length"], rtol=0, atol=1e-6)


def test_the_worst_member_and_the_nominal_machine_share_the_axis_of_the_longer_run(done: Done) -> None:
    """Expected: the times of the run that went on for longer, as of each curve those of its own record."""
    beside = next(part for part in report_in(done.folder)["sections"] if part["title"].startswith("Worst member, "))
    worst = done.records[int(beside["title"].split()[2].rstrip(","))]
    ends = [record["time"][-1] for record in (gs.read_record(done.folder / "worst" / "nominal"), worst)]
    chart = next(part for part in beside["parts"] if part["title"] == "position error")
    assert ends[0] != ends[1]
    assert chart["x"]["values"][-1] == pytest.approx(max(ends))
    assert [curve["x"][-1] for curve in chart["series"]] == pytest.approx(ends, abs=2 * 0.0025)


def test_a_worst_member_that_outlasts_the_nominal_machine_has_the_axis(tmp_path: Path) -> None:
    """Expected: the times of the member; the nominal machine is too heavy for its drives, and falls."""
    settings = ("loop.duration=0.3", "reference.at=0.01", "actuators.force_limit=5e3", "limits.position_error=0.06",
                "plant.parameters.platform_mass=5e3", "ensemble.platform_mass={ grid = [1200, 1250] }")  # fmt: skip
    invoke("ensemble", "heave_step", "--out", str(tmp_path), *(word for text in settings for word in ("--set", text)))
    chart = next(part for part in parts_in(report_in(tmp_path), "chart") if part["title"] == "position error")
    assert chart["series"][0]["x"][-1] < chart["x"]["values"][-1] == pytest.approx(0.3)


def test_bands_are_quantiles_of_the_members_rows(done: Done) -> None:
    """Expected: NumPy's quantiles of the records' columns, row by row, over the members that have the row."""
    bands = polars.read_parquet(done.folder / "bands.parquet")
    rows = 121
    expected: dict[str, list[FloatArray]] = {}
    for record in done.records.values():
        for name in SIGNALS:
            for column in [name] if name in NORMS else record.columns_of(name):
                gap = record[column.removesuffix(".norm")]
                values = np.linalg.norm(gap, axis=1) if column in NORMS else gap
                expected.setdefault(column, []).append(values)
    assert bands["signal"].unique(maintain_order=True).to_list() == list(expected)
    assert bands.height == rows * len(expected)
    for column, all_values in expected.items():
        found = bands.filter(polars.col("signal") == column)
        np.testing.assert_allclose(found["time"].to_numpy(), 0.0025 * np.arange(rows), atol=1e-12)
        whole = np.full((len(all_values), rows), np.nan)
        for k, values in enumerate(all_values):
            whole[k, : len(values)] = values
        assert found["running"].to_list() == np.isfinite(whole).sum(axis=0).tolist()
        levels, is_there = LEVELS | {"lowest": 0.0, "highest": 1.0}, np.isfinite(whole)
        quantiles = np.empty((len(levels), rows))
        for running in np.unique(is_there, axis=1).T:  # members that end take no part in what follows
            at = (is_there == running[:, None]).all(axis=0)
            quantiles[:, at] = np.quantile(whole[running][:, at], [*levels.values()], axis=0)
        np.testing.assert_allclose(found.select(*levels).to_numpy().T, quantiles, rtol=1e-12, atol=1e-13)


def test_tables_are_of_members_that_completed_and_say_how_many_are_left_out(done: Done) -> None:
    """Expected: NumPy's quantiles of the table's columns, of completed members; margins of all that have them."""
    quantiles, failures, *_ = parts_in(report_in(done.folder), "table")
    assert quantiles["title"] == "14 members: 6 completed, 3 diverged, 5 impossible"
    assert quantiles["note"].endswith("Quantiles are without the 8 members not completed.")
    rows, completed = rows_in(quantiles), done.members.filter(polars.col("outcome") == "completed")
    for words, metric in (
        ("position error, RMS", "tracking.position.norm_rms"),
        ("orientation error, peak", "tracking.orientation.norm_peak"),
        ("peak force", "force.peak"), ("work, absolute", "energy.absolute_total"), ("disk margin", "margins.disk"),
        ("stable", "margins.stable"), ("force limited", "saturation.force_limited.any"),
    ):  # fmt: skip
        some = done.members if metric.startswith("margins.") else completed
        values = some[metric].drop_nulls().to_numpy()
        assert rows[words][:5] == pytest.approx(np.quantile(values, list(LEVELS.values())).tolist()), words
        assert rows[words][5] == len(values)
    assert len(completed) == 6 < done.members["margins.stable"].drop_nulls().len() == 9
    first = done.members["outcome"].to_list().index("diverged")
    counts = {row[1]: (row[0], row[2], row[3]) for row in failures["rows"]}
    assert counts["diverged"] == (first, done.members["cause"][first], 3)
    assert sum(number for _, _, number in counts.values()) == 8
    assert "14 members: 6 completed" in done.result.stdout


def test_ensemble_json_counts_what_happened(done: Done) -> None:
    """Expected: counts of the table, seeds and names of the experiment file, in groups that vary together."""
    said = json.loads((done.folder / "ensemble.json").read_text())
    assert said["outcomes"] == {"completed": 6, "diverged": 3, "impossible": 5}
    assert (said["title"], said["members"], said["seed"], said["sampling"]) == ("machines in trouble", 14, 11, "random")
    assert said["oscillations"] == {}
    causes = done.members["cause"].drop_nulls().to_list()
    assert said["causes"] == {cause: causes.count(cause) for cause in causes}
    # the most frequent first
    assert list(said["causes"]) == sorted(said["causes"], key=lambda cause: (-causes.count(cause), cause))
    assert len(said["causes"]) > 2
    assert said["integration_error"] == done.members["integration_error"].max()
    assert said["tolerance"] == 1e-10
    groups = {frozenset(group) for group in said["groups"]}
    assert frozenset({"platform_mass", "leg_viscous_friction"}) in groups
    assert frozenset({"loop.delay"}) in groups
    assert sum(map(len, said["groups"])) == sum(name.startswith("varied.") for name in done.members.columns)


def test_margins_are_those_of_a_loop_around_each_machine(done: Done) -> None:
    """Expected: `gs.margins` of an experiment that believes in the machine, of a stable one and of one that is not."""
    stable = done.members.filter(polars.col("margins.stable") == 1.0)
    assert stable["margins.disk"].null_count() == 0
    unstable = done.members.filter(polars.col("margins.stable") == 0.0)
    assert unstable["margins.disk"].null_count() == len(unstable) > 0
    for member in (int(stable["member"][-1]), int(unstable["member"][0])):
        row, record = done.members.row(member, named=True), done.records[member]
        machine, controller = record.metadata["machine"], record.metadata["experiment"]["controller"]
        # margins are those of the nominal model: here the machine is one
        names = ("platform_com", "platform_mass", "base_points", "leg_viscous_friction")
        settings = {
            "platform.parameters": {name: machine[name] for name in names},
            "plant.parameters": {},
            "loop.delay": row["varied.loop.delay"],
            "controller.proportional_gain": controller["proportional_gain"],
        }
        file = done.folder.parent / "differ.toml"
        if row["margins.stable"]:
            assert gs.margins(file, settings).disk.alpha == pytest.approx(row["margins.disk"], rel=1e-6)
        else:
            with pytest.raises(gs.GoughStewartError, match="unstable"):
                gs.margins(file, settings)
