"""Bode figure of a measured loop: gain and phase of L, |S| and |T|, coherence; points, with the linear model."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gough_stewart.harness.control.frequency_response import Response
from gough_stewart.harness.control.structured import ComplexArray
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.plotting import entitle, label, pictures
from gough_stewart.model.vectors import FloatArray

_THIN: dict[str, Any] = {"color": "#555555", "linewidth": 0.9}


def frf_figure(
    frequency: FloatArray, measured: Response, predicted: ComplexArray | None, title: str
) -> dict[str, bytes]:
    """`frf.png` and `frf.svg`: points with 95 % confidence bars, lines for the linear model."""

    def draw(figure: Figure) -> None:
        entitle(figure, title)
        (gain, both), (phase, coherence) = figure.subplots(2, 2, sharex=True)
        _points(gain, frequency, np.abs(measured.L), measured.loop_radius, 0, "run")
        angle = np.degrees(np.unwrap(np.angle(measured.L)))
        spread = np.degrees(np.arcsin(np.minimum(1.0, measured.loop_radius / np.abs(measured.L))))
        _points(phase, frequency, angle, spread, 0, "")
        _points(both, frequency, np.abs(measured.S), measured.radius, 0, "S")
        _points(both, frequency, np.abs(measured.T), measured.radius, 1, "T")
        if predicted is not None:
            S = 1 / (1 + predicted)
            style: dict[str, Any] = {"linewidth": 1.1, "zorder": 1}
            gain.plot(frequency, np.abs(predicted), color=COLOURS[0], label="linear model", **style)
            # shift by full turns to the nearest phase
            line = np.degrees(np.unwrap(np.angle(predicted)))
            line += 360 * np.round(np.median(angle - line) / 360)
            phase.plot(frequency, line, color=COLOURS[0], **style)
            both.plot(frequency, np.abs(S), color=COLOURS[0], **style)
            both.plot(frequency, np.abs(1 - S), color=COLOURS[1], linestyle="--", **style)
        coherence.semilogx(frequency, measured.coherence, ".", color=COLOURS[0])
        coherence.set_ylim(min(0.9, float(measured.coherence.min())) - 0.02, 1.01)
        for axes in (gain, both):
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.axhline(1.0, **_THIN)
            axes.legend()
        phase.set_xscale("log")
        phase.axhline(-180.0, **_THIN)
        label(gain, "gain of L", "1", "")
        label(phase, "phase of L", "°", "frequency [Hz]")
        label(both, "|S| and |T|", "1", "")
        label(coherence, "coherence", "1", "frequency [Hz]")
        for axes in (gain, phase, both, coherence):
            axes.margins(x=0.02)

    return pictures("frf", draw, 9.0, 5.4)


def _points(axes: Axes, x: FloatArray, y: FloatArray, radius: FloatArray, colour: int, name: str) -> None:
    axes.errorbar(
        x, y, radius, fmt="s^"[colour], markersize=3, color=COLOURS[colour], elinewidth=0.8, label=name or None
    )
