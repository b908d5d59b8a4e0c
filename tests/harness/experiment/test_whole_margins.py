"""All that `margins` says of a loop: numbers, text, tables, files and pictures, of an uneven platform off its home."""

import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import gough_stewart as gs
from gough_stewart.harness.errors import UnstableLoopError
from gough_stewart.model.vectors import FloatArray
from tests.support.commands import invoke
from tests.support.documented_loop import linear
from tests.support.figures import axes_titled, data_of, figures_drawn, lines_labelled
from tests.support.uneven import UNEVEN

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

    def __init__(self, folder: Path) -> None:
        gs.save_platform(UNEVEN, folder / "uneven.toml")
        self.experiment = folder / "uneven_loop.toml"
        self.experiment.write_text(FILE)
        self.figures: list[Figure]
        with figures_drawn() as self.figures:
            done = invoke("margins", str(self.experiment), "--out", str(folder / "out"))
        assert done.exit_code == 0, done.output
        self.output = done.output
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
def said(tmp_path_factory: pytest.TempPathFactory) -> Said:
    """Of the command, for all tests."""
    return Said(tmp_path_factory.mktemp("margins"))


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
    assert said.rows("Margins, one leg at a time") == [
        [
            str(k + 1),
            *(f"{leg[name]:.3g}" for name in ("gain_down", "gain_up")),
            f"{leg['phase'] * 180 / np.pi:.3g}",
            f"{leg['delay'] * 1e3:.3g}",
            f"{leg['crossover']:.3g}",
        ]
        for k, leg in enumerate(legs)
    ]
    disk, peaks = values["margins"]["disk"], values["margins"]
    low, high = (f"{gain:.3g}" for gain in disk["gain"])
    phase = disk["phase"] * 180 / np.pi
    assert said.rows("Margins, all legs at once") == [
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
        f"  one leg at a time  gain × {down:.3g} to {smallest['gain_up']:.3g}, "
        f"phase {smallest['phase'] * 180 / np.pi:.3g}°, delay {smallest['delay'] * 1e3:.3g} ms",
        f"  slowest mode       {slowest['frequency']:.3g} Hz, damping ratio {slowest['damping_ratio']:.3g}",
    ]
    page = said.found._repr_html_()
    assert page.count("<table>") == 4
    assert all(f"{gain:.5g}" in page for gain in GAINS["ki"])


def test_the_verdict_says_what_all_legs_and_the_weakest_leg_bear(said: Said) -> None:
    """Expected: the disk's gain in dB and its phase, the leg with the shortest delay; rounded down to two digits."""
    margins = said.values["margins"]
    disk, delays = margins["disk"], [leg["delay"] for leg in margins["legs"]]
    text = said.output.splitlines()[0]
    numbers = [float(number) for number in re.findall(r"(?<= )[\d.]+(?= (?:dB|deg|Hz|ms))", text)]
    decibels, phase = 20 * np.log10(disk["gain"][1]), np.degrees(disk["phase"])
    delay = 1e3 * min(delays)
    for shown, exact in zip(numbers, (decibels, phase, disk["frequency"], delay), strict=True):
        step = 10.0 ** (np.floor(np.log10(exact)) - 1)
        assert shown == pytest.approx(exact, abs=1.01 * step)
        assert exact == disk["frequency"] or shown <= exact
    assert text.startswith("Stable: the gains of all legs may rise or fall by ")
    assert f"disk margin {disk['alpha']:.2g} at" in text
    assert f"leg {int(np.argmin(delays)) + 1} alone bears" in text
    report = said.found.report()
    assert report.verdict.text == text
    assert report.verdict.status == ("good" if disk["alpha"] >= 0.4 else "marginal")
    assert report.number("margins.delay").value == min(delays)
    assert report.number("margins.gain").value == pytest.approx(decibels)
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
        angles = phase.series[k].values
        seen = np.isfinite(angles)
        np.testing.assert_allclose(np.exp(1j * angles[seen]), (loop / np.abs(loop))[seen], atol=1e-4)
    S = np.linalg.inv(np.eye(6) + np.asarray(everything))
    singular = np.linalg.svd(S, compute_uv=False)
    np.testing.assert_allclose(sigma.series[0].values, singular[:, 0], rtol=1e-4)
    np.testing.assert_allclose(np.asarray(sigma.series[0].low), singular[:, -1], rtol=1e-4)
    assert [chart.x.scale for chart in (gain, phase, sigma, step)] == ["log", "log", "log", "linear"]
    assert [chart.y_title for chart in (gain, phase)] == ["gain of L [1]", "phase of L [deg]"]
    assert step.series[2].values[-1] == pytest.approx(1.0, abs=0.05)


def test_the_bode_figure_shows_the_loops_of_the_legs(said: Said) -> None:
    """Expected: gain and phase of each leg's loop, arrows at the margins of the leg with the least phase."""
    bode = said.figures[0]
    assert bode.get_suptitle() == "an uneven loop: one leg cut, the others closed; and all together"
    gain, phase, sigma = (axes_titled(bode, name) for name in ("gain", "phase", "singular values"))
    assert [axes.get_xlabel() for axes in (gain, phase, sigma)] == ["", "frequency [Hz]", "frequency [Hz]"]
    assert [axes.get_ylabel() for axes in (gain, phase, sigma)] == ["[1]", "[°]", "[1]"]
    legs = said.values["margins"]["legs"]
    least = min(leg["phase"] for leg in legs) * 180 / np.pi
    assert phase.get_title(loc="left") == (
        f"phase (smallest margins: {least:.0f}°, × {min(leg['gain_up'] for leg in legs):.3g})"
    )
    alpha = said.values["margins"]["disk"]["alpha"]
    assert sigma.get_title(loc="left") == f"singular values (disk margin α = {alpha:.2f})"
    for k in range(6):
        (line,), (angle,) = (lines_labelled(axes, f"leg {k + 1}") for axes in (gain, phase))
        (hertz, gains), (_, degrees) = data_of(line), data_of(angle)
        loop = leg_loop(LOOP.response(2 * np.pi * hertz), k)
        np.testing.assert_allclose(gains, np.abs(loop), rtol=1e-4)
        turns = degrees / 360 - np.angle(loop) / (2 * np.pi)
        seen_ones = np.isfinite(turns)
        assert (seen_ones == (np.abs(loop) > 1e-4)).all()
        assert np.abs(turns - np.round(turns))[seen_ones].max() < 1e-5
        assert np.abs(np.diff(degrees[seen_ones])).max() < 180
    _check_styles(gain)
    _check_styles(phase)
    assert _in_legend(gain) == [f"leg {k + 1}" for k in range(6)]
    assert _in_legend(phase) == []
    assert _in_legend(sigma) == [f"σ({name}), largest to smallest" for name in "ST"]
    worst = int(np.argmin([leg["phase"] for leg in legs]))
    arrows = [line for line in gain.get_lines() if line.get_linewidth() == 1.4]
    arrows += [line for line in phase.get_lines() if line.get_linewidth() == 1.4]
    at = sorted(data_of(arrow)[0][0] for arrow in arrows)
    for axes in (gain, phase):
        dotted = [data_of(line)[0] for line in axes.get_lines() if line.get_linestyle() == ":"]
        assert np.sort(dotted, axis=0) == pytest.approx(np.column_stack([at, at]))
    (up,), (turn,) = ([line for line in axes.get_lines() if line.get_linewidth() == 1.4] for axes in (gain, phase))
    hertz, ends = data_of(up)
    assert ends == pytest.approx([1 / legs[worst]["gain_up"], 1])
    assert abs(1 + legs[worst]["gain_up"] * leg_loop(LOOP.response(2 * np.pi * hertz), worst)).max() < 0.05
    hertz, (edge, end) = data_of(turn)
    assert (edge + 180) % 360 == pytest.approx(0)
    assert abs(end - edge) == pytest.approx(legs[worst]["phase"] * 180 / np.pi, abs=1.5)
    assert np.abs(leg_loop(LOOP.response(2 * np.pi * hertz), worst)) == pytest.approx(1, abs=0.05)
    assert np.degrees(np.angle(leg_loop(LOOP.response(2 * np.pi * hertz), worst)))[0] % 360 == pytest.approx(
        end % 360, abs=0.1
    )


def _in_legend(axes: Any) -> list[str]:
    legend = axes.get_legend()
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]


def _check_styles(axes: Any) -> None:
    """Six colours, and dashes for those who do not see them."""
    lines = [lines_labelled(axes, f"leg {k + 1}")[0] for k in range(6)]
    assert len({to_hex(line.get_color()) for line in lines}) == 6
    assert len({line.get_linestyle() for line in lines}) == 3
    assert all(a.get_linestyle() != b.get_linestyle() for a, b in pairwise(lines))


def test_the_bode_figure_shows_both_sensitivities(said: Said) -> None:
    """Expected: the largest singular values as lines, filled down to the smallest."""
    sigma = axes_titled(said.figures[0], "singular values")
    for k, name in enumerate("ST"):
        (line,) = lines_labelled(sigma, f"σ({name}), largest to smallest")
        hertz, largest = data_of(line)
        inverse = np.linalg.inv(np.eye(6) + LOOP.response(2 * np.pi * hertz))
        values = np.linalg.svd(inverse if name == "S" else np.eye(6) - inverse, compute_uv=False)
        np.testing.assert_allclose(largest, values[:, 0], rtol=1e-4)
        area: Any = sigma.collections[k]
        outline = area.get_paths()[0].vertices[:, 1]
        assert outline.min() == pytest.approx(values[:, -1].min(), rel=1e-3)
        assert outline.max() == pytest.approx(values[:, 0].max(), rel=1e-3)
        assert to_hex(area.get_facecolor()[0]) == to_hex(line.get_color())
    peaks = said.values["margins"]
    most = 2 * max(peaks["sensitivity_peak"], peaks["complementary_peak"])
    assert sigma.get_ylim() == pytest.approx((1e-3, max(10, most)))


def test_the_step_figure_shows_each_legs_own_answer(said: Said) -> None:
    """Expected: the closed loop from its difference equation, d = 1 on one leg: y = C x + D e, e = d − y."""
    figure = said.figures[1]
    assert figure.get_suptitle() == "an uneven loop: a step of force on one leg"
    (axes,) = figure.axes
    assert axes.get_title(loc="left") == "share of the disturbance that the controller compensates"
    assert axes.get_xlabel() == "time [s]"
    _check_styles(axes)
    assert _in_legend(axes) == [f"leg {k + 1}" for k in range(6)]
    A, B, C = (np.asarray(getattr(said.found.loop, name)) for name in "ABC")
    assert not np.asarray(said.found.loop.D).any()  # there is a delay
    for k in range(6):
        (line,) = lines_labelled(axes, f"leg {k + 1}")
        time, values = data_of(line)
        rows = np.round(time / T).astype(int)
        assert np.allclose(rows * T, time)
        x, answers = np.zeros(len(A)), []
        for _ in range(rows[-1] + 1):
            y = C @ x
            answers.append(y[k])
            x = A @ x + B @ (np.eye(6)[k] - y)
        np.testing.assert_allclose(values, np.array(answers)[rows], atol=1e-9)
        # an integral compensates all of it
        assert values[0] == 0
        assert values[-1] == pytest.approx(1, abs=0.05)


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
    with pytest.raises(UnstableLoopError) as caught:
        gs.margins(said.experiment, faulty)
    assert abs(caught.value.eigenvalue) > 1
    assert f"it is stable {remedy}" in str(caught.value)
    assert gs.margins(said.experiment, {**faulty, **mended}).disk.alpha > 0
    base = {"loop.delay": DELAY, "actuators.lag": LAG, **faulty}
    for words, key in (("without the delay", "loop.delay"), ("without the actuators' lag", "actuators.lag")):
        if words not in str(caught.value):
            with pytest.raises(UnstableLoopError):
                gs.margins(said.experiment, {**base, key: 0})
