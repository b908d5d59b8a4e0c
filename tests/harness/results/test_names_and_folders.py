"""Names and units of metrics in an ensemble's table, and what is said of folders without a record."""

import re
from pathlib import Path

import numpy as np
import polars
import pytest

import gough_stewart as gs
from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.results.metric_folds import metric_of
from tests.support.ensembles import ensemble_of

# As the table names them, with unit and the number that stands for 0.0123 in SI units.
SHOWN = {
    "tracking.position.norm_rms": ("position error, RMS mm", 12.3),
    "tracking.position.norm_peak": ("position error, peak mm", 12.3),
    "tracking.orientation.norm_rms": ("orientation error, RMS deg", 0.0123 * 180 / np.pi),
    "tracking.orientation.norm_peak": ("orientation error, peak deg", 0.0123 * 180 / np.pi),
    "tracking.leg_length.peak": ("leg error, peak mm", 12.3),
    **{
        f"step_response.{axis}.{name}": (f"{axis}: {words}", 0.0123)
        for axis in ("x", "y", "z", "roll", "pitch", "yaw")
        for name, words in (
            ("overshoot_percent", "overshoot %"),
            ("rise_time", "rise time s"),
            ("settling_time", "settling time s"),
        )
    },
    "force.peak": ("peak force N", 0.0123),
    "power.peak": ("peak power W", 0.0123),
    "energy.absolute_total": ("work, absolute J", 0.0123),
    "stroke.margin": ("stroke margin mm", 12.3),
    "saturation.force_limited.any": ("force limited %", 1.23),
    "saturation.rate_limited.any": ("rate limited %", 1.23),
    "stroke.exceeded.any": ("beyond stroke %", 1.23),
    "margins.stable": ("stable", 0.0123),
    "margins.disk": ("disk margin", 0.0123),
}


def test_a_table_names_metrics_with_their_units() -> None:
    """Expected: words and units of docs/ensembles.md, and numbers in them: of each metric another multiple of 0.0123.

    Metrics that are not for the terminal are left out: the mean power, the time of a step, the use of a limit.
    """
    made = ensemble_of(np.zeros((4, 4)))
    kept = made.members.select("member", "outcome", "ended", "cause")
    columns = [polars.lit(0.0123 * (k + 1)).alias(name) for k, name in enumerate(SHOWN)]
    others = ("power.mean", "step_response.z.at", "limits.leg_velocity_max.used", "force.rms", "energy.net_total")
    table = kept.with_columns(*columns, *(polars.lit(5.0).alias(name) for name in others))
    text = str(type(made)(table, made.bands, made.metadata))
    rows = {cells[1].strip(): cells[2:8] for line in text.splitlines() if len(cells := re.split("[│┃]", line)) == 9}
    assert set(rows) - {""} == {name for name, _ in SHOWN.values()}
    assert [cell.strip() for cell in rows[""]] == ["5 %", "25 %", "50 %", "75 %", "95 %", "members"]
    for k, (name, value) in enumerate(SHOWN.values()):
        *quantiles, defined = (cell.strip() for cell in rows[name])
        assert [float(cell) for cell in quantiles] == [pytest.approx(value * (k + 1), rel=6e-3)] * 5, name
        assert defined == "4"


# Words, unit and factor of paths of every kind, shown anywhere.
NAMED = {
    "tracking.position.rms": ("position error, RMS of an axis", "mm", 1e3),
    "tracking.position.peak": ("position error, peak of an axis", "mm", 1e3),
    "tracking.position.norm_rms": ("position error, RMS", "mm", 1e3),
    "tracking.position.norm_peak": ("position error, peak", "mm", 1e3),
    "tracking.orientation.rms": ("orientation error, RMS of an axis", "deg", 180 / np.pi),
    "tracking.orientation.norm_peak": ("orientation error, peak", "deg", 180 / np.pi),
    "tracking.leg_length.rms": ("leg error, RMS", "mm", 1e3),
    "tracking.leg_length.peak": ("leg error, peak", "mm", 1e3),
    "step_response.y.from": ("y: from", "mm", 1e3),
    "step_response.yaw.to": ("yaw: to", "deg", 180 / np.pi),
    "step_response.z.at": ("z: step at", "s", 1.0),
    "step_response.roll.overshoot_percent": ("roll: overshoot", "%", 1.0),
    "step_response.x.rise_time": ("x: rise time", "s", 1.0),
    "step_response.pitch.settling_time": ("pitch: settling time", "s", 1.0),
    "step_response.z.final_error": ("z: final error", "mm", 1e3),
    "step_response.pitch.final_error": ("pitch: final error", "deg", 180 / np.pi),
    "force.peak": ("peak force", "N", 1.0),
    "force.rms": ("RMS force", "N", 1.0),
    "power.peak": ("peak power", "W", 1.0),
    "power.mean": ("mean power", "W", 1.0),
    "energy.absolute_total": ("work, absolute", "J", 1.0),
    "energy.net_total": ("work, net", "J", 1.0),
    "energy.net": ("work of a leg, net", "J", 1.0),
    "saturation.force_limited.any": ("force limited", "%", 100.0),
    "saturation.rate_limited.any": ("rate limited", "%", 100.0),
    "saturation.rate_limited.legs": ("rate limited, a leg", "%", 100.0),
    "stroke.margin": ("stroke margin", "mm", 1e3),
    "stroke.exceeded.any": ("beyond stroke", "%", 100.0),
    "stroke.shortest": ("shortest leg", "mm", 1e3),
    "limits.leg_velocity_max.used": ("leg velocity, of its limit", "%", 100.0),
    "limits.actuator_power_max.used": ("actuator power, of its limit", "%", 100.0),
    "limits.actuator_force_max.limit": ("limit of actuator force", "N", 1.0),
    "margins.disk": ("disk margin", "", 1.0),
    "margins.stable": ("stable", "", 1.0),
    "rows": ("rows", "", 1.0),
    "unheard.of": ("unheard.of", "", 1.0),
}


@pytest.mark.parametrize("path", NAMED)
def test_each_metric_has_its_words_unit_and_factor(path: str) -> None:
    """Expected: the table above; what is no metric has its path."""
    metric = metric_of(path)
    assert (metric.text, metric.quantity.unit, metric.quantity.factor) == NAMED[path]


FOLDERS = {
    "differences.parquet": "it has two ensembles compared by `ensemble --compare`; `gough-stewart view` it",
    "plan.json": "it has an unfinished ensemble; continue it with `gough-stewart ensemble … --resume`",
    "ensemble.json": "it has an ensemble; `gough-stewart view` it, or worst/member-…",
    "tuning.json": "it has a tuning; run tuned.toml, then view that run",
    "workspace.csv": "it has a workspace; `gough-stewart view` it",
    "estimate.json": "it has an identification; `gough-stewart view` it",
    "excitation.toml": "it has an excitation; run excitation.toml, then view that run",
    "check.json": "it has a motion check; `gough-stewart view` it",
    "margins.json": "it has margins; `gough-stewart view` it",
    "frf.csv": "it has a frequency response; `gough-stewart view` it, or its record",
    "open_loop.csv": "it has the paper's case; open report.html, which `reproduce --report` writes, in a browser",
    "report.html": "it has a page; open report.html in a browser",
    "law.fmu": "it has FMUs: law.fmu",
    "loop.ssp": "it has an exported loop: loop.ssp",
    "law.c": "it has an exported controller: law.c",
    "mine.toml": "it has TOML files: mine.toml",
    "run_1/record.parquet": "it has folders of records: run_1; view one of them",
    "notes.txt": "it has notes.txt",
}


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_without_a_record_is_told_by_what_it_has(name: str, tmp_path: Path) -> None:
    """Expected: the file that the command of the same name writes, and what to do with it."""
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("")
    with pytest.raises(RecordError) as caught:
        gs.read_record(tmp_path)
    found = str(caught.value)
    expected = "expected record.parquet, or record.csv with metadata.json beside it"
    assert found.startswith(f"{tmp_path}: the folder has no record; {FOLDERS[name]}; {expected}")


def test_of_many_files_in_a_folder_five_are_named_in_order(tmp_path: Path) -> None:
    """Expected: by name, without hidden ones; the rest as their number; of two kinds the result of a command."""
    for name in ("f", "b", "e", "a", "g", "c", "d", ".hidden"):
        (tmp_path / name).write_text("")
    with pytest.raises(RecordError, match=r"it has a, b, c, d, e and 2 more; "):
        gs.read_record(tmp_path)
    (tmp_path / "f").unlink()
    (tmp_path / "g").unlink()
    with pytest.raises(RecordError, match=r"it has a, b, c, d, e; "):
        gs.read_record(tmp_path)
    for name in ("two.c", "one.c", "law.fmu"):
        (tmp_path / name).write_text("")
    with pytest.raises(RecordError, match=r"it has FMUs: law\.fmu; "):
        gs.read_record(tmp_path)
    (tmp_path / "law.fmu").unlink()
    with pytest.raises(RecordError, match=r"it has an exported controller: one\.c, two\.c; "):
        gs.read_record(tmp_path)
    (tmp_path / "report.html").write_text("")
    (tmp_path / "margins.json").write_text("")
    with pytest.raises(RecordError, match=r"it has margins; `gough-stewart view` it; "):
        gs.read_record(tmp_path)


def test_an_empty_folder_is_said_to_be_empty(tmp_path: Path) -> None:
    """Expected: that, and what a record is."""
    with pytest.raises(RecordError, match="the folder has no record; it is empty; expected record"):
        gs.read_record(tmp_path)
