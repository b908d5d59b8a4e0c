"""All that `margins` says of a loop: numbers, text, tables, files and pictures, of an uneven platform off its home."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex
from numpy.typing import NDArray

import gough_stewart as gs
from tests.support.documented_loop import linear
from tests.support.drawn_figures import drawn
from tests.support.interpreter import Interpreter
from tests.support.uneven import UNEVEN

FloatArray = NDArray[np.float64]


T, DELAY, LAG = 4e-3, 2, 6e-3
POSE = np.array([0.15, -0.1, 2.95, 0.08, -0.11, 0.16])
GAINS = {
    "kp": [440.0, 580.0, 360.0, 500.0, 640.0, 400.0],
    "kd": [107.0, 137.0, 93.0, 123.0, 150.0, 100.0],
    "ki": [180.0, 300.0, 140.0, 220.0, 400.0, 160.0],
}
LOOP = linear(
    {
        **{name: np.array(gain) for name, gain in GAINS.items()},
        "space": "leg",
        "discretisation": "tustin",
        "derivative_filter": 0.012,
        "sample_time": T,
        "delay": DELAY,
        "lag": LAG,
    },
    UNEVEN,
    POSE,
)
KINDS = (("proportional", "kp"), ("derivative", "kd"))
OMEGA = 2 * np.pi * np.geomspace(5e-3, 0.4999 / T, 8_000)
FILE = f"""
title = "an uneven loop"
platform.file = "uneven.toml"
reference = {{type = "hold", position = {POSE[:3].tolist()}, orientation = {POSE[3:].tolist()}}}
actuators.lag = "6 ms"

[controller]
type = "pid"
proportional_gain = {GAINS["kp"]}
derivative_gain = {GAINS["kd"]}
integral_gain = {GAINS["ki"]}
derivative_filter = "12 ms"

[loop]
duration = 1
sample_time = "4 ms"
plant_step = "2 ms"
delay = 2
"""


class Said:
    """What the command made."""

    def __init__(self, folder: Path, interpreter: Interpreter) -> None:
        gs.save_platform(UNEVEN, folder / "uneven.toml")
        self.experiment = folder / "uneven_loop.toml"
        self.experiment.write_text(FILE)
        wide = {"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"}
        done = interpreter.command("margins", str(self.experiment), "--out", "out", cwd=folder, env=wide)
        assert done.returncode == 0, done.stderr
        self.output = done.stdout
        self.values: dict[str, Any] = json.loads((folder / "out" / "margins.json").read_text())
        self.found = gs.margins(self.experiment)

    def rows(self, title: str) -> list[list[str]]:
        """The cells of a table in the terminal."""
        text = self.output[self.output.index(title) :]
        found = []
        for line in text.splitlines()[1:]:
            if line.startswith("│"):
                found.append([cell.strip() for cell in line.strip("│").split("│")])
            if line.startswith("└"):
                break
        return found


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory, interpreter: Interpreter) -> Said:
    """Of the command, for all tests."""
    return Said(tmp_path_factory.mktemp("margins"), interpreter)


@pytest.fixture(scope="module")
def whole() -> Any:
    """L on the unit circle at OMEGA."""
    return LOOP.response(OMEGA)


def leg_loop(whole: Any, leg: int) -> Any:
    """Cut at one leg."""
    return 1 / np.linalg.inv(np.eye(6) + whole)[:, leg, leg] - 1


def test_the_file_has_the_experiments_numbers(said: Said) -> None:
    """Expected: those of the experiment; the same from Python."""
    values = said.values
    assert values["title"] == "an uneven loop"
    assert (values["sample_time"], values["delay"], values["lag"]) == (T, DELAY, LAG)
    gains = {"proportional": GAINS["kp"], "derivative": GAINS["kd"], "integral": GAINS["ki"]}
    assert values["gains"] == {**gains, "derivative_filter": 0.012}
    assert values["versions"]["numpy"] == np.__version__
    assert {name: value for name, value in values.items() if name != "versions"} == said.found.as_dict()


def test_the_loop_is_that_of_the_formulas(said: Said, whole: Any) -> None:
    """Expected: Tustin's PID, the held plant with its lag, and the delay; at 200 frequencies."""
    at = slice(None, None, 40)
    z, loop = np.exp(1j * OMEGA[at] * T), said.found.loop
    A, B, C, D = (np.asarray(each) for each in (loop.A, loop.B, loop.C, loop.D))
    answers = C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(z), *B.shape))) + D
    assert np.abs(answers / whole[at] - 1).max() < 1e-6


def test_every_mode_is_a_pole_of_the_closed_loop(said: Said) -> None:
    """Expected: det(1 + L) vanishes at z = exp(s T): its least singular value is far below that beside it.

    At least as many as 12 states of the platform, 6 of the lag and 12 of the PID, none of them twice.
    """
    modes = [complex(*mode["eigenvalue"]) for mode in said.values["modes"]]
    for eigenvalue, mode in zip(modes, said.values["modes"], strict=True):
        assert mode["frequency"] == pytest.approx(abs(eigenvalue) / (2 * np.pi))
        assert mode["damping_ratio"] == pytest.approx(-eigenvalue.real / abs(eigenvalue))
        s: Any = eigenvalue + np.array([0.0, 1e-3 / T])
        at, beside = np.linalg.svd(np.eye(6) + LOOP.response(s / 1j), compute_uv=False)[:, -1]
        assert at < 1e-3 * beside
    frequencies = [mode["frequency"] for mode in said.values["modes"]]
    assert frequencies == sorted(frequencies)
    assert sum(2 if eigenvalue.imag else 1 for eigenvalue in modes) >= 30


def test_margins_of_each_leg_are_where_its_loop_meets_minus_one(said: Said, whole: Any) -> None:
    """Expected: with the others closed, 1 + g L or 1 + exp(∓i φ) L vanishes, at no g or φ that is nearer."""
    legs = said.values["margins"]["legs"]
    assert len(legs) == 6
    for leg, margins in enumerate(legs):
        loop = leg_loop(whole, leg)
        gains = -1 / _where_zero(loop.imag, loop.real)
        assert margins["gain_up"] == pytest.approx(gains[gains > 1].min(), rel=1e-3)
        assert margins["gain_down"] == pytest.approx(gains[(gains > 0) & (gains < 1)].max(), rel=1e-3)
        lead = np.unwrap(np.angle(-loop))
        lags, omega = (_where_zero(np.abs(loop) - 1, values) for values in (lead, OMEGA))
        phases = np.abs((lags + np.pi) % (2 * np.pi) - np.pi)
        assert margins["phase"] == pytest.approx(phases.min(), rel=1e-3)
        # a delay lags: the angle from −1 to L, counted downwards
        delays = lags % (2 * np.pi) / omega
        assert margins["delay"] == pytest.approx(delays.min(), rel=1e-3)
        assert margins["crossover"] == pytest.approx(omega.max() / (2 * np.pi), rel=1e-3)
    assert len({round(margins["gain_up"], 3) for margins in legs}) == 6


def _where_zero(function: FloatArray, values: FloatArray) -> FloatArray:
    """Values where a function of the same grid is zero, linearly between points."""
    at = np.flatnonzero(np.diff(np.sign(function)) != 0)
    share = function[at] / (function[at] - function[at + 1])
    return np.asarray(values[at] + share * (values[at + 1] - values[at]))


def test_margins_of_all_legs_bound_what_they_may_do_at_once(said: Said, whole: Any) -> None:
    """Expected: peaks of singular values; gains and phases from α; no pair of signs of gains within is unstable."""
    margins, inverse = said.values["margins"], np.linalg.inv(np.eye(6) + whole)
    S, complementary = (np.linalg.norm(each, 2, axis=(1, 2)) for each in (inverse, np.eye(6) - inverse))
    assert margins["sensitivity_peak"] == pytest.approx(S.max(), rel=1e-4)
    assert margins["complementary_peak"] == pytest.approx(complementary.max(), rel=1e-4)
    alpha = margins["disk"]["alpha"]
    gap = (2 * inverse - np.eye(6)) / 2
    # μ lies between the spectral radius and the largest singular value
    assert np.abs(np.linalg.eigvals(gap)).max() <= 1 / alpha * (1 + 1e-6)
    assert 1 / alpha <= np.linalg.norm(gap, 2, axis=(1, 2)).max() * (1 + 1e-6)
    assert margins["disk"]["gain"] == pytest.approx([(2 - alpha) / (2 + alpha), (2 + alpha) / (2 - alpha)])
    assert margins["disk"]["phase"] == pytest.approx(2 * np.arctan(alpha / 2))
    assert 0.1 < margins["disk"]["frequency"] < 0.5 / T


def test_the_tables_and_the_text_have_these_numbers(said: Said) -> None:
    """Expected: those of the file in their units, in every cell."""
    values = said.values
    rows = said.rows("Gains")
    assert rows == [[str(k + 1), *(f"{gain[k]:.5g}" for gain in GAINS.values())] for k in range(6)]
    rows = said.rows("Modes of the closed loop")
    for k, (row, mode) in enumerate(zip(rows[:8], values["modes"], strict=False), 1):
        real, imaginary = mode["eigenvalue"]
        written = f"{real:.4g} ± {imaginary:.4g}i" if imaginary else f"{real:.4g}"
        assert row == [str(k), f"{mode['frequency']:.4g}", f"{mode['damping_ratio']:.3g}", written]
    legs = values["margins"]["legs"]
    common = values["margins"]["common"]
    assert said.rows("Margins, one leg at a time, and the same change of all") == [
        [
            which,
            *(f"{leg[name]:.3g}" for name in ("gain_down", "gain_up")),
            f"{leg['phase'] * 180 / np.pi:.3g}",
            f"{leg['delay'] * 1e3:.3g}",
            f"{leg['crossover']:.3g}",
        ]
        for which, leg in zip([*"123456", "all alike"], [*legs, common], strict=True)
    ]
    disk, peaks = values["margins"]["disk"], values["margins"]
    low, high = (f"{gain:.3g}" for gain in disk["gain"])
    phase = disk["phase"] * 180 / np.pi
    assert said.rows("Margins, independent changes of all legs at once") == [
        ["disk margin α", f"{disk['alpha']:.3g} at {disk['frequency']:.3g} Hz"],
        ["gains of all legs, independently", f"× {low} to {high}"],
        ["phases of all legs, independently", f"± {phase:.3g} deg"],
        ["peak of σ(S)", f"{peaks['sensitivity_peak']:.3g}"],
        ["peak of σ(T)", f"{peaks['complementary_peak']:.3g}"],
    ]
    heads = [[cell.strip() for cell in line.strip("┃").split("┃")] for line in re.findall("┃.*┃", said.output)]
    assert heads == [
        ["leg", "gain", "to", "phase [deg]", "delay [ms]", "crossover [Hz]"],
        ["measure", "value"],
        ["channel", "kp", "kd", "ki"],
        ["mode", "frequency [Hz]", "damping ratio", "eigenvalue [1/s]"],
    ]
    smallest = {name: min(leg[name] for leg in legs) for name in ("gain_up", "phase", "delay")}
    down = max(leg["gain_down"] for leg in legs)
    slowest = values["modes"][0]
    assert repr(said.found).splitlines() == [
        "Margins: an uneven loop",
        f"  all legs at once   disk margin {disk['alpha']:.3g} at {disk['frequency']:.3g} Hz: gains × {low} to {high}, "
        f"phases ± {phase:.3g}°",
        f"  all legs alike     gain × {common['gain_down']:.3g} to {common['gain_up']:.3g}, "
        f"phase {common['phase'] * 180 / np.pi:.3g}°, delay {common['delay'] * 1e3:.3g} ms",
        f"  one leg at a time  gain × {down:.3g} to {smallest['gain_up']:.3g}, "
        f"phase {smallest['phase'] * 180 / np.pi:.3g}°, delay {smallest['delay'] * 1e3:.3g} ms",
        f"  slowest mode       {slowest['frequency']:.3g} Hz, damping ratio {slowest['damping_ratio']:.3g}",
    ]
    page = said.found._repr_html_()
    assert page.count("<table>") == 4
    assert all(f"{gain:.5g}" in page for gain in GAINS["ki"])


def test_the_verdict_says_what_all_legs_bear_alike_and_independently(said: Said) -> None:
    """Expected: gain in dB, phase and delay of the same change; the disk's; rounded down to two digits."""
    margins = said.values["margins"]
    common = margins["common"]
    disk, delays = margins["disk"], [leg["delay"] for leg in margins["legs"]]
    text = said.output.splitlines()[0]
    numbers = [float(number) for number in re.findall(r"(?<= )[\d.]+(?= (?:dB|deg|Hz|ms))", text)]
    decibels, phase = 20 * np.log10(disk["gain"][1]), np.degrees(disk["phase"])
    gain = 20 * np.log10(min(common["gain_up"], 1 / common["gain_down"]))
    alike = gain, np.degrees(common["phase"]), 1e3 * common["delay"]
    for shown, exact in zip(numbers, (*alike, decibels, phase, disk["frequency"]), strict=True):
        step = 10.0 ** (np.floor(np.log10(exact)) - 1)
        assert shown == pytest.approx(exact, abs=1.01 * step)
        assert exact == disk["frequency"] or shown <= exact
    assert text.startswith("Stable: with the same change of all legs it bears ")
    assert f"disk margin {disk['alpha']:.2g} at" in text
    report = said.found.report()
    assert report.verdict.text == text
    assert report.verdict.status == ("good" if disk["alpha"] >= 0.4 else "marginal")
    assert report.number("margins.delay").value == common["delay"]
    assert report.number("margins.leg.delay").value == min(delays)
    assert report.number("margins.gain").value == pytest.approx(gain)
    assert report.number("margins.disk_gain").value == pytest.approx(decibels)
    assert report.number("margins.leg.phase").value == min(leg["phase"] for leg in margins["legs"])
    downs = [leg["gain_down"] for leg in margins["legs"]]
    assert report.number("margins.leg.gain_down").value == pytest.approx(-20 * np.log10(max(downs)))
    crossovers = [leg["crossover"] for leg in margins["legs"]]
    assert report.number("margins.crossover").value == max(crossovers)


def test_charts_have_the_loops_of_the_legs(said: Said) -> None:
    """Expected: gain and phase of each leg's loop by the formula for one leg cut; σ of S and T from L; units."""
    gain, phase, sigma, step = said.found.report().charts
    hertz = gain.x.values
    everything = LOOP.response(2 * np.pi * hertz)
    for k in (0, 3, 5):
        loop = leg_loop(everything, k)
        assert gain.series[k].leg == k + 1
        np.testing.assert_allclose(gain.series[k].values, np.abs(loop), rtol=1e-4)
    ups, downs = ([leg[name] for leg in said.values["margins"]["legs"]] for name in ("gain_up", "gain_down"))
    spans = [(span.low, span.high) for span in gain.spans]
    assert spans == [pytest.approx(ends) for ends in [(1 / min(ups), 1), (1, 1 / max(downs))]]
    assert len(set(ups)) > 1
    S = np.linalg.inv(np.eye(6) + np.asarray(everything))
    singular = np.linalg.svd(S, compute_uv=False)
    np.testing.assert_allclose(sigma.series[0].values, singular[:, 0], rtol=1e-4)
    np.testing.assert_allclose(np.asarray(sigma.series[0].low), singular[:, -1], rtol=1e-4)
    assert [chart.x.scale for chart in (gain, phase, sigma, step)] == ["log", "log", "log", "linear"]
    assert [chart.y_title for chart in (gain, phase)] == ["gain of L [1]", "phase of L [deg]"]


def test_the_phase_is_continuous_and_has_gaps_where_the_gain_is_negligible(said: Said) -> None:
    """Expected: the loop of each leg, by the frequency response of all six; no jump of half a turn."""
    _, phase, *_ = said.found.report().charts
    for k, series in enumerate(phase.series):
        loop = leg_loop(LOOP.response(2 * np.pi * phase.x.values), k)
        turns = series.values / (2 * np.pi) - np.angle(loop) / (2 * np.pi)
        seen = np.isfinite(turns)
        assert (seen == (np.abs(loop) > 1e-4)).all()
        assert np.abs(turns - np.round(turns))[seen].max() < 1e-5
        assert np.abs(np.diff(series.values[seen])).max() < np.pi


def test_the_step_shows_each_legs_own_answer(said: Said) -> None:
    """Expected: the closed loop from its difference equation, d = 1 on one leg: y = C x + D e, e = d − y."""
    step = said.found.report().charts[-1]
    A, B, C = (np.asarray(getattr(said.found.loop, name)) for name in "ABC")
    assert not np.asarray(said.found.loop.D).any()  # there is a delay
    rows = np.round(step.x.values / T).astype(int)
    assert np.allclose(rows * T, step.x.values)
    for k, series in enumerate(step.series):
        x, answers = np.zeros(len(A)), []
        for _ in range(rows[-1] + 1):
            y = C @ x
            answers.append(y[k])
            x = A @ x + B @ (np.eye(6)[k] - y)
        np.testing.assert_allclose(series.values, np.array(answers)[rows], atol=1e-9)
        # an integral compensates all of it
        assert series.values[0] == 0
        assert series.values[-1] == pytest.approx(1, abs=0.05)


def test_the_figures_show_every_leg_of_the_loop(said: Said) -> None:
    """Expected: the panels by their charts, the lines by the legs; a band of each sensitivity."""
    gain, phase, sigma = drawn(said.found.report())["bode"]
    for axes in (gain, phase):
        assert [line.get_label() for line in axes.lines][:6] == [f"leg {k}" for k in range(1, 7)]
        assert len({to_hex(line.get_color()) for line in axes.lines[:6]}) == 6
    assert (gain.get_xscale(), gain.get_yscale(), phase.get_yscale()) == ("log", "log", "linear")
    assert len(sigma.collections) == 2


UNSTABLE: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "without the delay of 9 samples": ({"loop.delay": 9}, {"loop.delay": 0}),
    "without the actuators' lag of 0.15 s": ({"actuators.lag": 0.15}, {"actuators.lag": 0}),
    "at a sample_time of 0.005 s": (
        {"loop.sample_time": 0.02, "loop.plant_step": 0.02, "loop.delay": 1, "actuators.lag": 0},
        {"loop.sample_time": 0.005, "loop.plant_step": 0.005},
    ),
}


@pytest.mark.parametrize("remedy", UNSTABLE)
def test_an_unstable_loop_says_what_alone_would_make_it_stable(remedy: str, said: Said) -> None:
    """Expected: what it says is tried; what it does not say is not stable either."""
    faulty, mended = UNSTABLE[remedy]
    fast = {f"controller.{kind}_gain": [3 * gain for gain in GAINS[name]] for kind, name in KINDS}
    faulty = {**faulty, **(fast if "sample_time" in remedy else {})}
    with pytest.raises(gs.UnstableLoopError) as caught:
        gs.margins(said.experiment, faulty)
    assert abs(caught.value.eigenvalue) > 1
    assert f"it is stable {remedy}" in str(caught.value)
    assert gs.margins(said.experiment, {**faulty, **mended}).disk.alpha > 0
    base = {"loop.delay": DELAY, "actuators.lag": LAG, **faulty}
    for words, key in (("without the delay", "loop.delay"), ("without the actuators' lag", "actuators.lag")):
        if words not in str(caught.value):
            with pytest.raises(gs.UnstableLoopError):
                gs.margins(said.experiment, {**base, key: 0})
