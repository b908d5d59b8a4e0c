"""Figures of a design: loop transfers of the legs and sensitivities over frequency, and a step of the closed loop."""

import math
from typing import Any

import control
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gough_stewart.harness.control.linear import modes
from gough_stewart.harness.control.margins import (
    LegMargins,
    Margins,
    closed_loop,
    frequency_range,
    one_leg_open,
    response,
    sensitivities,
)
from gough_stewart.harness.control.structured import ComplexArray
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.plotting import DASHES, entitle, label, pictures
from gough_stewart.model.vectors import FloatArray

_POINTS = 500
_LONGEST = 10_000  # points of a step response
_SETTLED = 0.01
_BELOW = 1e-4  # gains too small to show
_THIN: dict[str, Any] = {"color": "#555555", "linewidth": 0.9}


def design_figures(L: Any, margins: Margins, title: str) -> dict[str, bytes]:
    """Bode and step figures of a loop transfer (6×6) as PNG and SVG, by file name.

    The margins drawn are those of the leg with the smallest phase margin, at the frequencies at which its loop transfer
    times the margin is −1.
    """
    low, high = frequency_range(L)
    # the range begins far below the slowest pole, where curves are flat
    omega = np.geomspace(min(30 * low, high / 10), high * (1 - 1e-9), _POINTS)

    def bode(figure: Figure) -> None:
        entitle(figure, f"{title}: one leg cut, the others closed; and all together")
        grid = figure.add_gridspec(2, 2, width_ratios=[1.25, 1])
        gain, phase, sigma = (figure.add_subplot(part) for part in (grid[0, 0], grid[1, 0], grid[:, 1]))
        _legs(gain, phase, L, omega, margins)
        _sensitivities(sigma, L, omega, margins)

    def step(figure: Figure) -> None:
        entitle(figure, f"{title}: a step of force on one leg")
        _step(figure.subplots(), L)

    return {**pictures("bode", bode, 9.0, 4.8), **pictures("step", step, 6.4)}


def _legs(gain: Axes, phase: Axes, L: Any, omega: FloatArray, margins: Margins) -> None:
    hertz = omega / (2 * math.pi)
    everything = response(L, omega)
    worst = int(np.argmin([leg.phase for leg in margins.legs]))
    for k in range(L.noutputs):
        loop = one_leg_open(everything, k)
        style: dict[str, Any] = {"color": COLOURS[k], "linestyle": DASHES[k], "label": f"leg {k + 1}"}
        angle = np.degrees(np.unwrap(np.angle(loop)))
        angle -= 360 * (angle[0] > 90.5)  # a loop that begins at 180° begins at −180°
        gain.loglog(hertz, np.abs(loop), **style)
        # at negligible gain the phase is meaningless
        phase.semilogx(hertz, np.where(np.abs(loop) > _BELOW, angle, np.nan), **style)
        if k == worst:
            _margins(gain, phase, hertz, loop, angle, margins.legs[k])
    gain.axhline(1.0, **_THIN)
    phase.axhline(-180.0, **_THIN)
    label(gain, "gain", "1", "")
    label(phase, _phase_label(margins), "°", "frequency [Hz]")
    gain.set_ylim(bottom=max(gain.get_ylim()[0], _BELOW))
    gain.legend(ncols=2)


def _margins(
    gain: Axes, phase: Axes, hertz: FloatArray, loop: ComplexArray, angle: FloatArray, margins: LegMargins
) -> None:
    """The margins as arrows: from the gain to 1, and from the phase to −180° or a full turn from there."""
    mark: dict[str, Any] = {"color": "black", "linewidth": 1.4, "marker": "_", "markersize": 6, "zorder": 3}
    if math.isfinite(margins.gain_up):
        at = int(np.abs(1 + margins.gain_up * loop).argmin())
        gain.plot([hertz[at]] * 2, [1 / margins.gain_up, 1.0], **mark)
        for axes in (gain, phase):
            axes.axvline(hertz[at], linestyle=":", **_THIN)
    if math.isfinite(margins.phase):
        turns = np.exp(1j * margins.phase * np.array([[-1], [1]]))
        at = int(np.abs(1 + turns * loop).min(axis=0).argmin())
        edge = -180 + 360 * np.round((angle[at] + 180) / 360)
        phase.plot([hertz[at]] * 2, [edge, angle[at]], **mark)
        for axes in (gain, phase):
            axes.axvline(hertz[at], linestyle=":", **_THIN)


def _phase_label(margins: Margins) -> str:
    phase, up = min(leg.phase for leg in margins.legs), min(leg.gain_up for leg in margins.legs)
    parts = [f"{math.degrees(phase):.0f}°"] if math.isfinite(phase) else []
    parts += [f"× {up:.3g}"] if math.isfinite(up) else []
    return f"phase (smallest margins: {', '.join(parts)})" if parts else "phase (all margins infinite)"


def _sensitivities(axes: Axes, L: Any, omega: FloatArray, margins: Margins) -> None:
    hertz = omega / (2 * math.pi)
    for k, (values, name) in enumerate(zip(sensitivities(L, omega), ("S", "T"), strict=True)):
        sigma = np.linalg.svd(values, compute_uv=False)
        axes.fill_between(hertz, sigma[:, -1], sigma[:, 0], color=COLOURS[k], alpha=0.2, linewidth=0)
        axes.loglog(hertz, sigma[:, 0], color=COLOURS[k], linestyle=DASHES[k], label=f"σ({name}), largest to smallest")
    axes.axhline(1.0, **_THIN)
    label(axes, f"singular values (disk margin α = {margins.disk.alpha:.2f})", "1", "frequency [Hz]")
    axes.set_ylim(1e-3, max(10.0, 2 * margins.sensitivity_peak, 2 * margins.complementary_peak))
    axes.legend(loc="lower center")


def step_answers(L: Any) -> tuple[FloatArray, FloatArray]:
    """Times (n,) [s] and answers (6, n) [1] to a step of force on each leg: the share that is compensated."""
    time = _times(L)
    closed = closed_loop(L)
    answers = []
    for k in range(L.noutputs):
        one = control.ss(closed.A, closed.B[:, [k]], closed.C[[k]], closed.D[[k]][:, [k]], closed.dt)
        answers.append(control.forced_response(one, time, np.ones(len(time))).outputs)
    values = np.array(answers)
    # slow modes may hardly show: end soon after the response has settled
    moving = np.nonzero((np.abs(values - values[:, -1:]) > _SETTLED).any(axis=0))[0]
    shown = min(len(time), max(10, int(1.5 * (moving[-1] + 1)))) if moving.size else len(time)
    every = max(1, shown // _POINTS)
    return time[:shown:every], values[:, :shown:every]


def _step(axes: Axes, L: Any) -> None:
    time, answers = step_answers(L)
    for k, values in enumerate(answers):
        axes.plot(time, values, color=COLOURS[k], linestyle=DASHES[k], label=f"leg {k + 1}")
    axes.axhline(1.0, **_THIN)
    label(axes, "share of the disturbance that the controller compensates", "1")
    axes.legend(ncols=2, loc="lower right")


def _times(L: Any) -> FloatArray:
    """Times until the slowest mode has decayed to e⁻⁶, with a limited number of points [s]."""
    rates = [-mode.eigenvalue.real for mode in modes(closed_loop(L))]
    end = 6 / min(rates, default=6.0)
    if L.isdtime(strict=True):
        return np.asarray(np.arange(min(math.ceil(end / L.dt) + 1, _LONGEST)) * float(L.dt))
    # fine enough for the fastest visible mode
    fastest = 2 * math.pi * max((mode.frequency for mode in modes(closed_loop(L))), default=1.0)
    return np.linspace(0, end, min(max(_POINTS, math.ceil(3 * end * fastest)), _LONGEST))
