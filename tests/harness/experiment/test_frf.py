"""What is said of the frequency response of a run: text, tables, charts, doubts, and which controller it is of."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np
import polars
import pytest

import gough_stewart as gs
from gough_stewart import metrics
from tests.support.commands import invoke
from tests.support.uneven import PARAMETERS
from tests.support.uneven_loops import experiment_of

PARTS = {**PARAMETERS, "leg_coulomb_friction": 0.0}
PD = {"type": "pd", "bandwidth": 1.5, "derivative_filter": 0.002, "feedforward": "gravity"}
LOOP = {"duration": 2.5, "sample_time": 2e-3, "plant_step": 1e-3, "delay": 1}


def uneven_run(injection: dict[str, Any], **tables: Any) -> gs.Record:
    """PD about the home pose of an uneven platform, one sample late."""
    values = {"platform": {"parameters": PARTS}, "plant": {"tolerance": 1e-9}, "reference": {"type": "hold"}}
    return gs.run(experiment_of("pd", **values | {"controller": PD, "loop": LOOP, "injection": injection} | tables))


@pytest.fixture(scope="module")
def shipped() -> gs.Record:
    return gs.run("frequency_response", {"loop.duration": 3, "loop.sample_time": 2e-3})


def test_the_command_writes_table_and_picture_beside_the_record(shipped: gs.Record, tmp_path: Path) -> None:
    """Expected: the same numbers as in Python, one row a frequency."""
    (tmp_path / "record.parquet").write_bytes(shipped.to_parquet())
    done = invoke("frf", str(tmp_path))
    assert done.exit_code == 0
    assert "coherence" in done.output
    found = gs.frf(shipped)
    for table in (polars.read_parquet(tmp_path / "frf.parquet"), polars.read_csv(tmp_path / "frf.csv")):
        assert table["frequency"].to_numpy() == pytest.approx(found.frequency, rel=1e-15)
        assert table["L.gain"].to_numpy() == pytest.approx(np.abs(found.measured.L), rel=1e-15)
        assert table["predicted.T.phase"].len() == len(found.frequency)


def test_text_and_table_have_the_numbers_of_the_response(shipped: gs.Record) -> None:
    """Expected: written here from the response itself; of the table 24 rows over all frequencies."""
    found = gs.frf(shipped)
    assert found.predicted is not None
    measured, f, model = found.measured, found.frequency, 1 / (1 + found.predicted)
    peak, gap = int(np.abs(measured.S).argmax()), np.abs(measured.S - model)
    assert repr(found).splitlines() == [
        f"Frequency response: {shipped.metadata['title']}",
        f"  leg 3, {len(f)} frequencies from {f[0]:.4g} to {f[-1]:.4g} Hz, 2 periods",
        f"  largest |S| {abs(measured.S[peak]):.4g} at {f[peak]:.4g} Hz; "
        f"smallest coherence {min(measured.coherence):.3g}",
        f"  farthest from the linear model: S by {max(gap):.3g} at {f[int(gap.argmax())]:.4g} Hz",
    ]
    report: Any = found.report()
    (table,) = (part for part in report.parts() if type(part).__name__ == "Table")
    heads = ["f", "|S|", "|T|", "|L|", "∠L", "|L| model", "∠L model", "coherence"]
    assert [column.name for column in table.columns] == heads
    assert table.note.startswith(f"24 of {len(f)} frequencies; frf.csv has all. Coherence is of S and T: it may be 1 ")
    at = [int(np.abs(f - row[0]).argmin()) for row in table.rows]
    assert (len(at), at[0], at[-1]) == (24, 0, len(f) - 1)
    assert np.ptp(np.diff(at)) <= 1
    size = np.abs(measured.S)
    unknown = (np.abs(measured.L) <= measured.radius / size**2) | (measured.radius >= 0.5 * size)
    for row, k in zip(table.rows, at, strict=True):
        known = () if unknown[k] else (abs(measured.L[k]), np.angle(measured.L[k]))
        cells = (f[k], size[k], abs(measured.T[k]), *known, abs(found.predicted[k]), np.angle(found.predicted[k]))
        assert [cell for cell in row if cell is not None] == pytest.approx([*cells, measured.coherence[k]])
    assert report.number("agreement").value == pytest.approx(np.mean(gap <= measured.radius))
    assert report.number("L.known").value == pytest.approx(1 - unknown.mean())
    largest = report.number("S.peak")
    ends = size[peak] - measured.radius[peak], size[peak] + measured.radius[peak]
    assert (largest.value, largest.low, largest.high) == pytest.approx((size[peak], *ends))
    assert report.verdict.text.startswith(f"|S| peaks at {20 * np.log10(size.max()):.2g} dB at {f[peak]:.2g} Hz; ")
    # without a linear model there are no columns of it
    odd = gs.frf(shipped, controller=lambda _sample: np.zeros(6))
    report = odd.report()
    (table,) = (part for part in report.parts() if type(part).__name__ == "Table")
    assert [column.name for column in table.columns] == [*heads[:5], "coherence"]
    assert "no linear model to compare with: the controller is not linear" in " ".join(odd.notes)
    assert "predicted.L.gain" not in odd.table().columns
    assert report.verdict.text.endswith("no linear model to compare with")


def test_an_l_that_cannot_be_known_is_not_shown_however_coherent(shipped: gs.Record) -> None:
    """Expected: S = 1/(1 + L) with a radius of 0.02: L of 0.5 is known, 0.01 is not; the crossover in between."""
    f = np.array([1.0, 4.0, 16.0, 64.0])
    L: Any = np.array([4, 2, 0.5, 0.01], dtype=complex)
    made = gs.frf(shipped)
    for radius, known in (([0.02] * 4, [1, 1, 1, 0]), ([0.15, 0.02, 0.02, 0.02], [0, 1, 1, 0])):
        measured = made.measured._replace(
            S=np.asarray(1 / (1 + L)), radius=np.array(radius), coherence=np.ones(4), periods=5
        )
        report: Any = replace(made, frequency=f, measured=measured, predicted=np.asarray(L * 1.001), notes=()).report()
        (table,) = (part for part in report.parts() if type(part).__name__ == "Table")
        assert [int(row[3] is not None) for row in table.rows] == known
        assert report.number("L.crossover").value == pytest.approx(8.0)
        assert f"L is known at {sum(known)} of 4 frequencies" in report.verdict.text
        assert "S agrees with the linear model within its 95 % confidence at 100 % of them" in report.verdict.text
        assert table.rows[3][-1] == 1.0
    # of two frequencies at which the gain falls through 1, the higher one
    twice: Any = np.array([2, 0.5, 2, 0.5], dtype=complex)
    measured = measured._replace(S=np.asarray(1 / (1 + twice)), radius=np.full(4, 0.02))
    report = replace(made, frequency=f, measured=measured, predicted=None, notes=()).report()
    assert report.number("L.crossover").value == pytest.approx(32.0)
    for x, model, status in ((-0.49, 0, "good"), (-0.51, 0, "marginal"), (-0.49, 1, "marginal"), (-0.49, None, "told")):
        measured = measured._replace(S=np.full(4, 1 / (1 + x), dtype=complex))
        predicted = None if model is None else np.full(4, x + model, dtype=complex)
        assert replace(made, measured=measured, frequency=f, predicted=predicted).report().verdict.status == status


def test_charts_show_points_with_their_circles_and_the_model(shipped: gs.Record) -> None:
    """Expected: points from the response, intervals of the radii, lines of the linear model; no L that has 0 in it."""
    found = gs.frf(shipped)
    assert found.predicted is not None
    measured, S = found.measured, 1 / (1 + found.predicted)
    charts = found.report().charts
    assert [chart.title for chart in charts] == [*(f"{what} of {x}" for what, x in zip(
        ("gain", "phase", "gain", "gain"), "LLST", strict=True)), "coherence of S and T"]  # fmt: skip
    sees = (measured.loop_radius < np.abs(measured.L)) & (measured.radius < 0.5 * np.abs(measured.S))
    everywhere = np.ones(len(sees), dtype=bool)
    angle = np.unwrap(np.angle(measured.L[sees]))
    spread = np.arcsin(np.minimum(1, measured.loop_radius / np.abs(measured.L)))[sees]
    for chart, values, radius, there, model in zip(
        charts,
        (np.abs(measured.L)[sees], angle, np.abs(measured.S), np.abs(measured.T)),
        (measured.loop_radius[sees], spread, measured.radius, measured.radius),
        (sees, sees, everywhere, everywhere),
        (np.abs(found.predicted), None, np.abs(S), np.abs(1 - S)),
        strict=False,
    ):
        run, line = chart.series
        assert chart.x.values.tolist() == found.frequency.tolist()
        assert np.isnan(run.values[~there]).all()
        ends = np.column_stack([np.asarray(run.low), np.asarray(run.high)])[there]
        np.testing.assert_allclose(run.values[there], values, rtol=1e-12)
        np.testing.assert_allclose(ends, np.column_stack([values - radius, values + radius]), rtol=1e-9)
        if model is not None:
            np.testing.assert_allclose(line.values, model, rtol=1e-12)
    turns = (charts[1].series[1].values - np.angle(found.predicted)) / (2 * np.pi)
    assert np.abs(turns - np.round(turns)).max() < 1e-9
    assert abs(np.median(angle - charts[1].series[1].values[sees])) < np.pi
    np.testing.assert_allclose(charts[4].series[0].values, measured.coherence, rtol=1e-12)


def test_runs_that_ended_jittered_or_have_an_unstable_model_are_doubted() -> None:
    """Expected: one note each, alone."""
    injection = {"type": "chirp", "leg": 2, "amplitude": 1.0, "band": [4, 50], "period": 0.25}
    base = {"duration": 0.9, "sample_time": 2e-3}
    late = uneven_run(injection, loop={**base, "plant_step": 1e-3, "jitter": 1e-3})
    assert gs.frf(late).notes == ("jitter delayed the samples, which the linear model does not include",)
    assert repr(gs.frf(late)).endswith(f"\n  {gs.frf(late).notes[0]}")
    elastic: Any = {"platform": {"preset": "liu2000", "parameters": PARTS | {"leg_stiffness": 3e5}}}
    elastic |= {"sensors": {"side": "motor"}, "loop": base | {"duration": 1.2}}
    at_motors = gs.frf(uneven_run(injection, **elastic))
    assert pytest.approx(1 / (1 + np.asarray(at_motors.predicted)), abs=5e-3) == at_motors.measured.S
    assert "a clock of their own" in str(gs.frf(uneven_run(injection, loop=base, sensors={"sample_time": 4e-3})).notes)
    force = {"at": 0.8, "duration": 0.1, "force": [0, 0, 4e3]}
    ended = uneven_run(injection, loop=base, disturbance=[force], limits={"position_error": 0.05})
    cause = ended.metadata["outcome"]["cause"]
    assert ended.metadata["outcome"]["time"] < 0.9
    assert f"the run ended early: {cause}" in gs.frf(ended).notes
    assert not [note for note in gs.frf(ended).notes if "jitter" in note]
    limited = uneven_run(injection | {"amplitude": 400.0}, actuators={"force_limit": 100.0}, loop=base)
    share = limited["flag.force_limited"].any(axis=1).mean()
    assert gs.frf(limited).notes[0].startswith(f"forces were limited for {share:.0%} of the time")
    with pytest.raises(gs.GoughStewartError, match=r"2\.4 periods, of which 1 settle; expected at least two more"):
        gs.frf(gs.Record(limited.table.head(301), limited.metadata))
    weak = {"type": "pd", "proportional_gain": 2500, "derivative_gain": 100, "feedforward": "gravity"}
    slow = uneven_run(injection, controller=weak, loop={**base, "delay": 40})
    assert "the linear loop is unstable; `gough-stewart margins` shows the cause" in gs.frf(slow).notes
    off = uneven_run(injection, loop=base, change=[{"at": 0.5, "enabled": False}])
    assert any("the controller was off" in note for note in gs.frf(off).notes)


def test_runs_without_a_response_are_refused_with_the_reason(shipped: gs.Record) -> None:
    plain = gs.run("heave_step", {"loop.duration": 0.05})
    with pytest.raises(gs.GoughStewartError, match=r"had no \[injection\]"):
        gs.frf(plain)
    with pytest.raises(gs.GoughStewartError, match="contain no experiment"):
        gs.frf(gs.Record(shipped.table, {**shipped.metadata, "experiment": {"title": 3}}))


LAW = """
from pathlib import Path
import control
import numpy as np
from gough_stewart import LinearController

Path(__file__).with_name("executed").touch()
gains = np.hstack([2000 * np.eye(6), 60 * np.eye(6)])
controller = LinearController(control.ss([], [], [], gains, 2e-3), ("leg_length", "leg_velocity"))
"""
OWN = """
title = "own"
reference.type = "hold"
controller = { type = "python", file = "law.py", feedforward = "gravity" }
loop = { duration = 0.8, sample_time = "2 ms" }
injection = { type = "chirp", leg = 1, amplitude = 1, band = [4, 50], period = 0.25 }
"""


def test_reading_a_record_never_executes_the_file_that_it_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: no trace of the file, also where it lies in the present folder; with consent, its own gains' L."""
    mine, elsewhere = tmp_path / "mine", tmp_path / "elsewhere"
    for folder in (mine, elsewhere):
        folder.mkdir()
        (folder / "law.py").write_text(LAW)
    (mine / "own.toml").write_text(OWN)
    record = gs.run(mine / "own.toml")
    (mine / "executed").unlink()
    gs.save_record(record, mine / "record")
    monkeypatch.chdir(mine)
    read = gs.read_record(mine / "record")
    found = gs.frf(read)
    assert found.predicted is None
    assert "it would execute law.py" in " ".join(found.notes)
    assert len(repr(read) + read._repr_html_() + str(metrics(read)) + repr(found)) > 1000
    assert "it would execute law.py" in " ".join(invoke("frf", "record").output.split())
    assert invoke("view", "record").exit_code == 0
    # 3: written, with an alarm
    assert invoke("identify", "record", "--preset", "liu2000", "--estimate", "platform_mass").exit_code in (0, 3)
    assert not list(tmp_path.rglob("executed"))
    monkeypatch.chdir(elsewhere)
    gains = np.hstack([2000 * np.eye(6), 60 * np.eye(6)])
    same = gs.LinearController(control.ss([], [], [], gains, 2e-3), ("leg_length", "leg_velocity"))
    expected, asked = gs.frf(record, controller=same).predicted, gs.frf(record, experiment=mine / "own.toml")
    assert asked.predicted is not None
    assert expected is not None
    assert np.abs(asked.predicted / expected - 1).max() < 1e-12
    assert asked.notes == ()
    assert (mine / "executed").exists()
    assert not (elsewhere / "executed").exists()
    done = invoke("frf", str(mine / "record"), "--experiment", str(mine / "own.toml"))
    assert "executes law.py" in done.output
    assert "|L| model" in done.output
    (mine / "law.py").write_text(LAW.replace("2000", "2500"))
    assert "law.py has changed since the run" in " ".join(gs.frf(record, experiment=mine / "own.toml").notes)
    with pytest.raises(gs.GoughStewartError, match=r"frequency_response' has a controller of no file"):
        gs.frf(record, experiment="frequency_response")


def test_a_controller_or_injection_that_replaced_the_experiments_is_not_taken_for_it(shipped: gs.Record) -> None:
    """Expected: no linear model of the experiment's gains for a run with others, unless asked for, and then said."""
    law = gs.LinearController(control.ss([], [], [], 900 * np.eye(6), 2e-3), ("leg_length",))
    chirp = {"type": "chirp", "leg": 1, "amplitude": 300.0, "band": [4, 50], "period": 0.25}
    settings = {"loop.duration": 0.8, "loop.sample_time": 2e-3, "injection": chirp}
    record = gs.run("frequency_response", settings, controller=law)
    assert gs.frf(record).predicted is None
    assert "a controller of its own" in " ".join(gs.frf(record).notes)
    assert gs.frf(record, controller=law).predicted is not None
    assert "a controller of its own" in " ".join(gs.frf(record, experiment="frequency_response").notes)
    other = gs.run("frequency_response", settings, injection=lambda _time: np.zeros(6))
    with pytest.raises(gs.GoughStewartError, match=r"injection of its own"):
        gs.frf(other)
    assert gs.frf(shipped).notes == ()
