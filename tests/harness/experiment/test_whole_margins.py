"""All that `margins` says of a loop: numbers, text, tables, files and pictures, of an uneven platform off its home."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.commands import invoke
from tests.support.documented_loop import linear
from tests.support.experiments import written
from tests.support.uneven import UNEVEN
from tests.support.uneven_loops import LOOPS, POSE, experiment_of

OPTIONS = LOOPS["pid"]
T, GAINS = OPTIONS["sample_time"], {name: OPTIONS[name] for name in ("kp", "kd", "ki")}
LOOP, EXPERIMENT = linear(OPTIONS, UNEVEN, POSE), experiment_of("pid", plant={})


@pytest.fixture(scope="module")
def found() -> gs.LoopMargins:
    return gs.margins(EXPERIMENT)


@pytest.fixture(scope="module")
def report(found: gs.LoopMargins) -> Any:
    return found.report()


def leg_loop(whole: Any, leg: int) -> Any:
    return 1 / np.linalg.inv(np.eye(6) + whole)[:, leg, leg] - 1


def test_the_file_has_the_experiments_numbers(found: gs.LoopMargins, tmp_path: Path) -> None:
    """Expected: those of the experiment; of the command the same as from Python, with the verdict first."""
    done = invoke("margins", str(written(EXPERIMENT, tmp_path / "x.toml")), "--out", str(tmp_path / "out"))
    assert done.exit_code == 0
    assert done.stdout.startswith(found.report().verdict.text)
    values = json.loads((tmp_path / "out" / "margins.json").read_text())
    assert values.pop("versions")["numpy"] == np.__version__
    assert values == found.as_dict()
    assert values["title"] == "uneven pid"
    assert (values["sample_time"], values["delay"], values["lag"]) == (T, 1, 4e-3)
    gains = {"proportional": GAINS["kp"], "derivative": GAINS["kd"], "integral": GAINS["ki"]}
    assert values["gains"] == {**gains, "derivative_filter": 0.006}


def test_the_tables_have_these_numbers(found: gs.LoopMargins, report: Any) -> None:
    """Expected: of each leg and of all alike; of the disk; of each channel; of the modes, the slowest first."""
    tables = {part.title: part for part in report.parts() if type(part).__name__ == "Table"}
    alone, together, gains, modes = (tables[title] for title in list(tables)[:4])
    names = ["gain_down", "gain_up", "phase", "delay", "crossover"]
    assert [column.name for column in alone.columns] == ["leg", "gain", "to", "phase", "delay", "crossover"]
    for which, leg, row in zip([*"123456", "all alike"], [*found.legs, found.common], alone.rows, strict=True):
        assert row == (which, *(getattr(leg, name) for name in names))
    low, high, phase = *found.disk.gain, np.degrees(found.disk.phase)
    texts = [f"{found.disk.alpha:.3g} at {found.disk.frequency:.3g} Hz", f"× {low:.3g} to {high:.3g}"]
    assert [row[1] for row in together.rows[:3]] == [*texts, f"± {phase:.3g} deg"]
    peaks = [row[1].value for row in together.rows[3:]]
    assert peaks == [found.sensitivity_peak, found.complementary_peak]
    assert gains.rows == tuple((str(k + 1), *(gain[k] for gain in GAINS.values())) for k in range(6))
    for k, (row, mode) in enumerate(zip(modes.rows, found.modes, strict=True), 1):
        written = f"{mode.eigenvalue.real:.4g}" + (f" ± {mode.eigenvalue.imag:.4g}i" if mode.eigenvalue.imag else "")
        assert row == (str(k), mode.frequency, mode.damping_ratio, written)
    page = found._repr_html_()
    assert all(f"{gain:.5g}" in page for gain in GAINS["ki"])


def test_the_verdict_says_what_all_legs_bear_alike_and_independently(found: gs.LoopMargins, report: Any) -> None:
    """Expected: gain in dB, phase and delay of the same change; the disk's; rounded down to two digits."""
    common, disk, legs, text = found.common, found.disk, found.legs, report.verdict.text
    numbers = [float(number) for number in re.findall(r"(?<= )[\d.]+(?= (?:dB|deg|Hz|ms))", text)]
    decibels, gain = (20 * np.log10(factor) for factor in (disk.gain[1], min(common.gain_up, 1 / common.gain_down)))
    alike = gain, np.degrees(common.phase), 1e3 * common.delay
    for shown, exact in zip(numbers, (*alike, decibels, np.degrees(disk.phase), disk.frequency), strict=True):
        step = 10.0 ** (np.floor(np.log10(exact)) - 1)
        assert shown == pytest.approx(exact, abs=1.01 * step)
        assert exact == disk.frequency or shown <= exact
    assert text.startswith("Stable: with the same change of all legs it bears ")
    assert f"disk margin {disk.alpha:.2g} at" in text
    assert report.verdict.status == ("good" if disk.alpha >= 0.4 else "marginal")
    for path, value in {
        "delay": common.delay,
        "gain": gain,
        "disk_gain": decibels,
        "leg.delay": min(leg.delay for leg in legs),
        "leg.phase": min(leg.phase for leg in legs),
        "leg.gain_down": -20 * np.log10(max(leg.gain_down for leg in legs)),
        "crossover": max(leg.crossover for leg in legs),
    }.items():
        assert report.number(f"margins.{path}").value == pytest.approx(value)


def test_charts_have_the_loops_of_the_legs(found: gs.LoopMargins, report: Any) -> None:
    """Expected: each leg's loop by the formula for one leg cut; σ of S, T from L; gaps where gains are negligible."""
    gain, phase, sigma, step = report.charts
    everything = LOOP.response(2 * np.pi * gain.x.values)
    for k in range(6):
        loop, angle = leg_loop(everything, k), phase.series[k].values
        assert gain.series[k].leg == k + 1
        np.testing.assert_allclose(gain.series[k].values, np.abs(loop), rtol=1e-4)
        turns = (angle - np.angle(loop)) / (2 * np.pi)
        seen = np.isfinite(turns)
        assert (seen == (np.abs(loop) > 1e-4)).all()
        assert np.abs(turns - np.round(turns))[seen].max() < 1e-5
        assert np.abs(np.diff(angle[seen])).max() < np.pi
    ups, downs = [leg.gain_up for leg in found.legs], [leg.gain_down for leg in found.legs]
    spans = [(span.low, span.high) for span in gain.spans]
    assert spans == [pytest.approx(ends) for ends in [(1 / min(ups), 1), (1, 1 / max(downs))]]
    singular = np.linalg.svd(np.linalg.inv(np.eye(6) + np.asarray(everything)), compute_uv=False)
    np.testing.assert_allclose(sigma.series[0].values, singular[:, 0], rtol=1e-4)
    np.testing.assert_allclose(np.asarray(sigma.series[0].low), singular[:, -1], rtol=1e-4)
    assert [chart.x.scale for chart in (gain, phase, sigma, step)] == ["log", "log", "log", "linear"]
    assert [chart.y_title for chart in (gain, phase)] == ["gain of L", "phase of L [deg]"]
    # a PID about a double integrator begins at three quarters of a turn behind
    of_pid = gs.margins("hold_against_gravity").report().charts[1]
    assert all(series.values[0] == pytest.approx(-1.5 * np.pi, abs=0.05) for series in of_pid.series)


def test_the_step_shows_each_legs_own_answer(found: gs.LoopMargins, report: Any) -> None:
    """Expected: the closed loop from its difference equation, d = 1 on one leg: y = C x + D e, e = d − y."""
    step = report.charts[-1]
    A, B, C = (np.asarray(getattr(found.loop, name)) for name in "ABC")
    assert not np.asarray(found.loop.D).any()  # there is a delay
    rows = np.round(step.x.values / T).astype(int)
    assert np.allclose(rows * T, step.x.values)
    # x⁺ = (A − B C) x + B d; a column for the step on each leg
    one_sample = np.block([[A - B @ C, B], [np.zeros((6, len(A))), np.eye(6)]])
    start = np.vstack([np.zeros((len(A), 6)), np.eye(6)])
    states = np.array([np.linalg.matrix_power(one_sample, row) @ start for row in rows])
    answers = np.diagonal(C @ states[:, :-6], axis1=1, axis2=2)
    for k, series in enumerate(step.series):
        np.testing.assert_allclose(series.values, answers[:, k], atol=1e-9)
        assert series.values[0] == 0
        if GAINS["ki"][k]:  # compensates all of it
            assert series.values[-1] == pytest.approx(1, abs=0.05)


UNSTABLE: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "without the delay of 9 samples": ({"loop.delay": 9}, {"loop.delay": 0}),
    "without the actuators' lag of 0.15 s": ({"actuators.lag": 0.15}, {"actuators.lag": 0}),
    "at a sample_time of 0.005 s": (
        {"loop.sample_time": 0.02, "loop.plant_step": 0.02, "loop.delay": 1, "actuators.lag": 0},
        {"loop.sample_time": 0.005, "loop.plant_step": 0.005},
    ),
}


@pytest.mark.parametrize("remedy", UNSTABLE)
def test_an_unstable_loop_says_what_alone_would_make_it_stable(remedy: str) -> None:
    """Expected: what it says is tried; what it does not say is not stable either."""
    faulty, mended = UNSTABLE[remedy]
    kinds = (("proportional", "kp"), ("derivative", "kd"))
    fast = {f"controller.{kind}_gain": [3 * gain for gain in GAINS[name]] for kind, name in kinds}
    faulty = {**faulty, **(fast if "sample_time" in remedy else {})}
    with pytest.raises(gs.UnstableLoopError) as caught:
        gs.margins(EXPERIMENT, faulty)
    assert abs(caught.value.eigenvalue) > 1
    assert f"it is stable {remedy}" in str(caught.value)
    assert gs.margins(EXPERIMENT, {**faulty, **mended}).disk.alpha > 0
    base = {"loop.delay": 1, "actuators.lag": 4e-3, **faulty}
    for words, key in (("without the delay", "loop.delay"), ("without the actuators' lag", "actuators.lag")):
        if words not in str(caught.value):
            with pytest.raises(gs.UnstableLoopError):
                gs.margins(EXPERIMENT, {**base, key: 0})
