"""The figure of shares: every curve in percent under its name, the strip of active limits, the page's limits."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from gough_stewart.harness.motion.limits import shares_figure
from gough_stewart.harness.motion.limits.shares import Limited, Shares, shares_along
from gough_stewart.harness.motion.references import Sine
from gough_stewart.harness.output.colours import COLOURS
from tests.support.uneven import UNEVEN

NAMES = {
    "stroke": "stroke",
    "joint_angle_max": "joint angle",
    "leg_velocity_max": "leg velocity",
    "leg_acceleration_max": "leg acceleration",
    "actuator_force_max": "force",
    "actuator_power_max": "power",
    "condition_number": "condition number",
    "pitch": "pitch",
    "side": "singular pose",
}
DASHES = {"joint_angle_max": "--", "leg_acceleration_max": "-.", "actuator_power_max": "--", "pitch": ":"}
DASHES |= {"condition_number": ":"}
PLATFORM = replace(UNEVEN, leg_velocity_max=2.4, leg_acceleration_max=14.0, actuator_power_max=400.0)
TIME = np.linspace(7.3, 8.4, 301)
SWAY = Sine(
    position_amplitude=(0.1, -0.16, 0.2), orientation_amplitude=(0.05, -0.08, 0.07), frequency=1.1, phase=0.3
).about(UNEVEN)


def drawn(shares: Shares, monkeypatch: pytest.MonkeyPatch) -> tuple[Figure, tuple[Any, ...]]:
    """The figure before it becomes a picture, and name and size."""
    made: list[Any] = []

    def pictures(name: str, draw: Any, width: float, height: float) -> dict[str, bytes]:
        figure = Figure(figsize=(width, height))
        draw(figure)
        made.extend([figure, (name, width, height)])
        return {}

    monkeypatch.setattr(shares_figure, "pictures", pictures)
    shares_figure.shares_pictures(shares, "a $title")
    return made[0], made[1]


def simple(**of: list[float]) -> Shares:
    """Shares of limits as given, at times from 7.3 s, one second apart."""
    n = len(next(iter(of.values())))
    limited = [Limited(name, name, "", np.array(values), -1.0, 1.0) for name, values in of.items()]
    return Shares(7.3 + np.arange(float(n)), tuple(limited))


def test_every_limit_that_is_used_has_its_curve_in_percent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: shares of the swing in percent, the largest over the legs; solid where it is the active one."""
    shares = shares_along(PLATFORM, TIME, SWAY(TIME))
    figure, size = drawn(shares, monkeypatch)
    assert size == ("shares", 8.0, 4.4)
    assert figure.get_suptitle() == "a $title"
    top, strip = figure.axes
    peaks = {}
    for name, share in shares.of.items():
        peaks[name] = float(np.max(share))
    names = sorted((name for name in peaks if peaks[name] > 0.005), key=lambda name: peaks[name])
    lines = top.get_lines()[:-1]
    assert len(lines) == len(names) > 5
    largest = np.max([np.asarray(share).reshape(301, -1).max(axis=1) for share in shares.of.values()], axis=0)
    colours = dict(zip(NAMES, (*COLOURS, "#000000", "#999999", "#8B0000"), strict=True))
    for line, name in zip(lines, names, strict=True):
        values = np.asarray(shares.of[name]).reshape(301, -1).max(axis=1)
        np.testing.assert_allclose(np.asarray(line.get_ydata()), 100 * values, rtol=1e-12)
        np.testing.assert_array_equal(line.get_xdata(), TIME)
        label, used = str(line.get_label()).rsplit(", ", 1)
        assert label == NAMES[name]
        assert float(used.removesuffix(" %")) == pytest.approx(100 * peaks[name], rel=6e-3)
        is_active = bool((values == largest).any())
        assert line.get_linestyle() == ("-" if is_active else DASHES.get(name, "-"))
        assert line.get_linewidth() == (1.4 if is_active else 1.0)
        assert to_hex(line.get_color()) == to_hex(colours[name])
    bound = top.get_lines()[-1]
    assert list(np.asarray(bound.get_ydata())) == [100, 100]
    assert top.get_xlim() == (7.3, 8.4)
    assert top.get_ylim() == pytest.approx((0, 104 * np.clip(largest.max(), 1, 2)))
    assert top.get_ylabel() == "share of the limit [%]"
    legend: Any = top.get_legend()
    assert [text.get_text() for text in legend.get_texts()] == [line.get_label() for line in lines[::-1]]
    assert strip.get_xlabel() == "time [s]"
    assert strip.get_ylabel() == "active"


def test_the_strip_names_the_active_limit_and_leaves_narrow_pieces_bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: pieces by hand: stroke to row 4, power to row 5 (a tenth of 12 s less), force to the end."""
    n = 13
    stroke, power, force = ([0.1] * n for _ in range(3))
    stroke[:4], power[4:5], force[5:] = [0.5] * 4, [0.9], [0.4] * (n - 5)
    shares = simple(stroke=stroke, actuator_power_max=power, actuator_force_max=force, pitch=[0.004] * n)
    figure, _ = drawn(shares, monkeypatch)
    top, strip = figure.axes
    pieces = [patch for patch in strip.patches if isinstance(patch, Rectangle)]
    spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in pieces]
    assert np.array(spans) == pytest.approx(np.array([[7.3, 11.3], [11.3, 12.3], [12.3, 19.3]]))
    colours = [COLOURS[0], COLOURS[5], COLOURS[4]]
    assert [patch.get_facecolor() for patch in pieces] == [to_rgba(colour, 0.85) for colour in colours]
    texts = [(text.get_text(), *text.get_position()) for text in strip.texts]
    # 1 s of 12 s is less than 9 %
    assert [text[0] for text in texts] == ["stroke", "force"]
    assert [text[1] for text in texts] == pytest.approx([9.3, 15.8])
    assert [text[2] for text in texts] == [0.5, 0.5]
    labels = {str(line.get_label()).split(",")[0] for line in top.get_lines()[:-1]}
    assert labels == {"stroke", "power", "force"}  # the pitch is at 0.4 %
    assert top.get_ylim() == (0, 104)
    wide = simple(stroke=[0.5] * 4 + [0.1] * 6, actuator_power_max=[0.2] * 10)
    figure, _ = drawn(wide, monkeypatch)
    assert [text.get_text() for text in figure.axes[1].texts] == ["stroke", "power"]


@pytest.mark.parametrize(("largest", "top"), [(0.7, 1.0), (1.4, 1.4), (2.6, 2.0), (50.0, 2.0)])
def test_the_axis_ends_between_one_and_two_times_the_limit(
    largest: float, top: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: 104 % of it; larger shares are clipped at 2,000 %, their names have the value."""
    figure, _ = drawn(simple(stroke=[0.1, largest, 0.2], pitch=[0.05, 0.06, 0.3]), monkeypatch)
    axes = figure.axes[0]
    assert axes.get_ylim() == pytest.approx((0, 104 * top))
    (stroke,) = (line for line in axes.get_lines() if str(line.get_label()).startswith("stroke"))
    assert np.asarray(stroke.get_ydata()) == pytest.approx([10, 100 * min(largest, 20.0), 20])
    assert str(stroke.get_label()) == f"stroke, {100 * largest:g} %".replace("5000", "5000")
    assert axes.get_lines()[0].get_label() == "pitch, 30 %"


def test_what_is_beyond_every_number_is_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: "beyond" for a share that is not finite."""
    shares = Shares(np.array([7.3, 8.0]), (Limited("side", "side", "", np.array([1.0, -1.0]), 1.0, 1.0),))
    figure, _ = drawn(shares, monkeypatch)
    line = figure.axes[0].get_lines()[0]
    assert line.get_label() == "singular pose, beyond"
    assert np.asarray(line.get_ydata()) == pytest.approx([0, 2000])
