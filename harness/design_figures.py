"""Figures of a design: the loops of the legs and the sensitivities over frequency, and the closed loop's step."""

import math
from typing import Any

import control
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gough_stewart.harness.margins import Margins, closed_loop, frequency_range, one_leg_open, response, sensitivities
from gough_stewart.harness.plotting import COLOURS, DASHES, entitle, label, pictures
from gough_stewart.model.vectors import FloatArray

_POINTS = 500


def design_figures(L: Any, margins: Margins, title: str) -> dict[str, bytes]:
    """Bode and step figures of a loop transfer (6×6) as PNG and SVG, by file name."""
    low, high = frequency_range(L)
    omega = np.geomspace(low, high * (1 - 1e-9), _POINTS)

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
    for k in range(L.noutputs):
        loop = one_leg_open(everything, k)
        style: dict[str, Any] = {"color": COLOURS[k], "linestyle": DASHES[k], "label": f"leg {k + 1}"}
        gain.loglog(hertz, np.abs(loop), **style)
        phase.semilogx(hertz, np.degrees(np.unwrap(np.angle(loop))), **style)
    gain.axhline(1.0, color="#555555", linewidth=0.9)
    phase.axhline(-180.0, color="#555555", linewidth=0.9)
    worst = min(margins.legs, key=lambda leg: leg.phase)
    if math.isfinite(worst.crossover):
        for axes in (gain, phase):
            axes.axvline(worst.crossover, color="#555555", linewidth=0.9, linestyle=":")
    label(gain, "gain", "1", "")
    label(phase, "phase", "°", "frequency [Hz]")
    gain.legend(ncols=2)
    least, up = np.degrees(worst.phase), min(leg.gain_up for leg in margins.legs)
    phase.set_title(f"phase (smallest margins: {least:.0f}°, × {up:.3g})")


def _sensitivities(axes: Axes, L: Any, omega: FloatArray, margins: Margins) -> None:
    hertz = omega / (2 * math.pi)
    for k, (values, name) in enumerate(zip(sensitivities(L, omega), ("S", "T"), strict=True)):
        sigma = np.linalg.svd(values, compute_uv=False)
        axes.fill_between(hertz, sigma[:, -1], sigma[:, 0], color=COLOURS[k], alpha=0.2, linewidth=0)
        axes.loglog(hertz, sigma[:, 0], color=COLOURS[k], linestyle=DASHES[k], label=f"σ({name}), largest to smallest")
    axes.axhline(1.0, color="#555555", linewidth=0.9)
    label(axes, f"singular values (disk margin α = {margins.disk.alpha:.2f})", "1", "frequency [Hz]")
    axes.set_ylim(1e-3, 10)
    axes.legend(loc="lower center")


def _step(axes: Axes, L: Any) -> None:
    closed = closed_loop(L)
    poles = closed.poles()
    # until the slowest mode has decayed to e⁻⁶
    rates = -np.log(np.abs(poles[np.abs(poles) > 1e-9])) / L.dt if L.isdtime(strict=True) else -poles.real
    end = 6 / float(rates.min())
    if L.isdtime(strict=True):
        steps = int(end / L.dt) + 1
        time = np.arange(0, steps + 1) * L.dt
    else:
        time = np.linspace(0, end, _POINTS)
    for k in range(L.noutputs):
        one = control.ss(closed.A, closed.B[:, [k]], closed.C[[k]], closed.D[[k]][:, [k]], closed.dt)
        answer = control.forced_response(one, time, np.ones(len(time))).outputs
        every = max(1, len(time) // _POINTS)
        axes.plot(time[::every], answer[::every], color=COLOURS[k], linestyle=DASHES[k], label=f"leg {k + 1}")
    axes.axhline(1.0, color="#555555", linewidth=0.9)
    label(axes, "share of the disturbance that the controller has taken over", "1")
    axes.legend(ncols=2, loc="lower right")
