"""What a measured frequency response found, as a report: where L is known, its peaks, how it agrees with the model."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.frequency_response import Response
from gough_stewart.harness.control.structured import ComplexArray
from gough_stewart.harness.report.chart import Axis, Chart, Mark, Series
from gough_stewart.harness.report.document import Note, Number, Report, Section, Status, Verdict, settings_of
from gough_stewart.harness.report.quantities import ANGLE, DECIBEL, FREQUENCY, NUMBER, SHARE, Quantity
from gough_stewart.harness.report.table import Cell, Column, Table
from gough_stewart.harness.report.words import about, percent, sentence
from gough_stewart.model.vectors import FloatArray

_SHOWN_ROWS = 24
# 1/S is a circle only while the radius of S is small beside it.
_SMALL = 0.5
# A peak of |S| above 6 dB leaves little margin, and a model that so few of the points agree with is another's.
_HIGH, _FEW = 2.0, 0.5
_GAIN = Quantity("1", "1", name="gain", digits=3)
_PLAIN = replace(NUMBER, digits=3)
_PHASE = replace(ANGLE, digits=3)
_COHERENCE = Quantity("", "", name="coherence", digits=5)


class Measured(Protocol):
    """What a frequency response has."""

    @property
    def title(self) -> str: ...
    @property
    def changed(self) -> Mapping[str, Mapping[str, Any]]: ...
    @property
    def channel(self) -> str: ...
    @property
    def frequency(self) -> FloatArray: ...
    @property
    def measured(self) -> Response: ...
    @property
    def predicted(self) -> ComplexArray | None: ...
    @property
    def notes(self) -> tuple[str, ...]: ...


def loop_is_known(found: Response) -> NDArray[np.bool_]:
    """Where the circle of 95 % confidence about L leaves 0 out, and is a circle: elsewhere L is not known.

    At high frequencies S is near 1 and L = 1/S − 1 is the small difference of two larger numbers, however coherent
    force and injection are.
    """
    known = (found.loop_radius < np.abs(found.L)) & (found.radius < _SMALL * np.abs(found.S))
    return np.asarray(known)


def frf_report(found: Measured, *, charts: bool = True) -> Report:
    """The report of a frequency response."""
    sections = [Section("Bode plot", _charts(found))] if charts else []
    sections.append(Section("Values", (_table(found),)))
    f = found.frequency
    return Report(
        f"{found.title}: {found.channel}",
        frf_verdict(found),
        tuple(sections),
        study="frf",
        settings=settings_of(found.changed),
        lead=f"{len(f)} frequencies from {f[0]:.4g} to {f[-1]:.4g} Hz, {found.measured.periods} periods",
        numbers=_numbers(found),
        notes=tuple(Note(text, "warning") for text in found.notes),
    )


def frf_verdict(found: Measured) -> Verdict:
    """The peak of S, where L is 1, at how many frequencies L is known, and how many agree with the linear model."""
    numbers = {each.path: each for each in _numbers(found)}
    peak, crossover, agree = (numbers[path] for path in ("S.peak", "L.crossover", "agreement"))
    n, known = len(found.frequency), int(loop_is_known(found.measured).sum())
    at = found.frequency[int(np.abs(found.measured.S).argmax())]
    parts: list[str | None] = [
        f"|S| peaks at {about(DECIBEL, 20 * math.log10(peak.value or math.nan))} at {about(FREQUENCY, float(at))}",
        None if crossover.value is None else f"the gain of L is 1 at {about(FREQUENCY, crossover.value)}",
        f"L is known at {known} of {n} frequencies" if known < n else f"L is known at all {n} frequencies",
    ]
    status: Status = "marginal" if (peak.value or 0.0) > _HIGH else "good"
    if agree.value is None:
        parts.append("no linear model to compare with")
        status = "told" if status == "good" else status
    else:
        parts.append(f"S agrees with the linear model within its 95 % confidence at {percent(agree.value)} of them")
        status = "marginal" if agree.value < _FEW else status
    return Verdict(sentence(parts), status, tuple(numbers[path] for path in ("S.peak", "L.crossover", "agreement")))


def _numbers(found: Measured) -> tuple[Number, ...]:
    seen = found.measured
    size, known = np.abs(seen.S), loop_is_known(seen)
    peak = int(size.argmax())
    within = None
    if found.predicted is not None:
        within = float((np.abs(seen.S - 1 / (1 + found.predicted)) <= seen.radius).mean())
    return (
        Number(
            "S.peak",
            "largest |S|",
            float(size[peak]),
            _PLAIN,
            float(size[peak] - seen.radius[peak]),
            float(size[peak] + seen.radius[peak]),
            explanation="the largest amplification of a disturbance, with its 95 % confidence",
        ),
        Number("L.crossover", "crossover of L", _crossover(found, known), FREQUENCY, explanation="where |L| is 1"),
        Number(
            "L.known",
            "frequencies at which L is known",
            float(known.mean()),
            SHARE,
            explanation="where the 95 % confidence of L leaves 0 out",
        ),
        Number(
            "agreement",
            "agreement of S with the linear model",
            within,
            SHARE,
            explanation="share of the frequencies at which the model is within the 95 % confidence of S; 95 % if the "
            "model were exact and friction linear",
        ),
        Number("coherence", "least coherence", float(seen.coherence.min()), _COHERENCE,
               explanation="share of the force that the injection explains, of S and T"),
    )  # fmt: skip


def _crossover(found: Measured, known: NDArray[np.bool_]) -> float | None:
    """The highest frequency at which the measured |L| falls through 1, between two lines at which it is known."""
    gain, f = np.abs(found.measured.L), found.frequency
    falls = np.flatnonzero((gain[:-1] >= 1) & (gain[1:] < 1) & known[:-1] & known[1:])
    if not falls.size:
        return None
    k = int(falls[-1])
    share = math.log(gain[k]) / (math.log(gain[k]) - math.log(gain[k + 1]))
    return float(f[k] * (f[k + 1] / f[k]) ** share)


def _table(found: Measured) -> Table:
    """All frequencies, of which the terminal shows some; L where it is known."""
    seen, n = found.measured, len(found.frequency)
    known = loop_is_known(seen)
    columns = [
        Column("f", FREQUENCY),
        Column("|S|", _PLAIN, "gain from the injected to the total force"),
        Column("|T|", _PLAIN, "share of the injected force that the controller cancels"),
        Column("|L|", _PLAIN, "gain of the loop with this channel cut; none where its confidence includes 0"),
        Column("∠L", _PHASE),
    ]
    if found.predicted is not None:
        columns += [Column("|L| model", _PLAIN, "of the linear model"), Column("∠L model", _PHASE)]
    columns.append(Column("coherence", _COHERENCE, "of S and T, not of L: what the injection explains of the force"))
    rows: list[tuple[Cell, ...]] = []
    for k in np.unique(np.linspace(0, n - 1, min(_SHOWN_ROWS, n)).round().astype(int)):
        cells: list[Cell] = [float(found.frequency[k]), float(abs(seen.S[k])), float(abs(seen.T[k]))]
        cells += [float(abs(seen.L[k])), float(np.angle(seen.L[k]))] if known[k] else [None, None]
        if found.predicted is not None:
            cells += [float(abs(found.predicted[k])), float(np.angle(found.predicted[k]))]
        rows.append((*cells, float(seen.coherence[k])))
    some = f"{len(rows)} of {n} frequencies; frf.csv has all. " if len(rows) < n else ""
    note = f"{some}Coherence is of S and T: it may be 1 where L is not known."
    return Table("Frequency response", tuple(columns), tuple(rows), note=note)


def _charts(found: Measured) -> tuple[Chart, ...]:
    seen = found.measured
    known = loop_is_known(seen)
    x = Axis("frequency", FREQUENCY, found.frequency, scale="log")
    L = np.where(known, seen.L, np.nan)
    radius = np.where(known, seen.loop_radius, np.nan)
    size = np.abs(L)
    angle = np.full(len(L), np.nan)
    angle[known] = np.unwrap(np.angle(seen.L[known]))
    spread = np.full(len(L), np.nan)
    spread[known] = np.arcsin(np.minimum(1.0, radius[known] / size[known]))
    gain = [Series("run", _GAIN, size, "measured", low=size - radius, high=size + radius)]
    phase = [Series("run", _PHASE, angle, "measured", low=angle - spread, high=angle + spread)]
    each = {"S": seen.S, "T": seen.T}
    sizes = {
        name: [
            Series("run", _GAIN, np.abs(values), "measured", low=np.abs(values) - seen.radius,
                   high=np.abs(values) + seen.radius)
        ]
        for name, values in each.items()
    }  # fmt: skip
    if found.predicted is not None:
        line = np.unwrap(np.angle(found.predicted))
        # by full turns to the nearest phase
        turns = np.round(np.median(angle[known] - line[known]) / (2 * math.pi)) if known.any() else 0.0
        S = 1 / (1 + found.predicted)
        gain.append(Series("linear model", _GAIN, np.abs(found.predicted), "nominal"))
        phase.append(Series("linear model", _PHASE, line + 2 * math.pi * turns, "nominal"))
        for name, values in (("S", S), ("T", 1 - S)):
            sizes[name].append(Series("linear model", _GAIN, np.abs(values), "nominal"))
    one = (Mark(1.0, "gain of 1", role="neutral", tells=False),)
    unknown = "" if known.all() else "L is left out where its 95 % confidence includes 0."
    half_turn = Mark(-math.pi, "−180°", role="neutral", tells=False)
    coherence = Series("coherence of S and T", _COHERENCE, seen.coherence, "measured")
    return (
        Chart("gain of L", x, tuple(gain), y=Axis("gain of L", _GAIN, scale="log"), marks=one, note=unknown,
              group="bode"),
        Chart("phase of L", x, tuple(phase), y=Axis("phase of L", ANGLE), marks=(half_turn,),
              note=unknown, group="bode"),
        *(
            Chart(f"gain of {name}", x, tuple(series), y=Axis(f"gain of {name}", _GAIN, scale="log"), marks=one,
                  group="bode")
            for name, series in sizes.items()
        ),
        Chart("coherence of S and T", x, (coherence,), "points", y=Axis("coherence", _COHERENCE), group="bode",
              note="The share of the force that the injection explains; it says nothing of L where that is small."),
    )  # fmt: skip
