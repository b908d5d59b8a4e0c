"""The frequency response of a loop from the record of a run with an injection, compared with the linear model."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.control.frequency_response import Response, response_of_periods
from gough_stewart.harness.control.linear import loop_transfer
from gough_stewart.harness.control.linear_controller import controller_of, linear_of
from gough_stewart.harness.control.loop_margins import ComplexArray, is_stable, response
from gough_stewart.harness.errors import ControllerError, RecordError
from gough_stewart.harness.experiment.file import digests, load_experiment
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.report.chart import Axis, Chart, Mark, Series
from gough_stewart.harness.report.document import (
    Cell,
    Column,
    Note,
    Number,
    Report,
    Section,
    Status,
    Table,
    Verdict,
    settings_of,
)
from gough_stewart.harness.report.page import to_html
from gough_stewart.harness.report.quantities import (
    ANGLE,
    DECIBEL,
    FREQUENCY,
    NUMBER,
    SHARE,
    Quantity,
    about,
    percent,
    sentence,
)
from gough_stewart.harness.results.record import Record, platform_of, read_record
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.vectors import FloatArray

FILES = ("frf.csv", "frf.parquet")
_SHOWN_ROWS = 24
# 1/S is a circle only while the radius of S is small beside it.
_SMALL = 0.5
# A peak of |S| above 6 dB leaves little margin, and a model that so few of the points agree with is another's.
_HIGH, _FEW = 2.0, 0.5
_GAIN = Quantity("1", "1", name="gain", digits=3)
_PLAIN = replace(NUMBER, digits=3)
_PHASE = replace(ANGLE, digits=3)
_COHERENCE = Quantity("", "", name="coherence", digits=5)


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse:
    """S, T and L of one leg or mode with the others closed, measured in a run; from `frf`."""

    title: str
    """Title of the experiment."""
    channel: str
    """For example leg 3, or heave."""
    frequency: FloatArray
    """Frequencies of the injection's lines (n,) [Hz]."""
    measured: Response
    """`S`, `T`, `L` (n,), 95 % confidence `radius` of S and T and `loop_radius` of L, `coherence`, `periods`."""
    predicted: ComplexArray | None
    """L of the linear model (n,) [1], without Coulomb friction; None where there is none."""
    notes: tuple[str, ...]
    """Reasons to doubt the result."""
    changed: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Keys of the experiment that were changed, as `Experiment.changed`."""
    requirements: tuple[str, ...] = ()
    """`[require]` of the run's experiment."""

    def __repr__(self) -> str:
        """Channel, band, coherence, and the largest difference from the linear model."""
        seen, f, peak = self.measured, self.frequency, int(np.abs(self.measured.S).argmax())
        lines = [
            f"Frequency response: {self.title}",
            f"{self.channel}, {self._band}",
            f"largest |S| {abs(seen.S[peak]):.4g} at {f[peak]:.4g} Hz; smallest coherence {seen.coherence.min():.3g}",
        ]
        if self._model_S is not None:
            gap = np.abs(seen.S - self._model_S)
            worst = int(gap.argmax())
            lines.append(f"farthest from the linear model: S by {gap[worst]:.3g} at {f[worst]:.4g} Hz")
        return "\n  ".join([*lines, *self.notes])

    @property
    def _band(self) -> str:
        f = self.frequency
        return f"{len(f)} frequencies from {f[0]:.4g} to {f[-1]:.4g} Hz, {self.measured.periods} periods"

    @property
    def _model_S(self) -> ComplexArray | None:
        """S of the linear model."""
        return None if self.predicted is None else np.asarray(1 / (1 + self.predicted))

    def _repr_html_(self) -> str:
        return to_html(self.report(charts=False))

    def report(self, *, charts: bool = True) -> Report:
        """Report the peak of S, the crossover of L, and the agreement with the linear model.

        Returns
        -------
        Report
            Verdict, numbers such as `S.peak` and `L.crossover`, a table, and with `charts` the Bode plot.
        """
        sections = [Section("Bode plot", _charts(self))] if charts else []
        seen, f, n = self.measured, self.frequency, len(self.frequency)
        is_known, size = loop_is_known(seen), np.abs(seen.S)

        # numbers; the crossover is the highest frequency at which |L| falls through 1, between two known lines
        peak, gain, crossover, agreement = int(size.argmax()), np.abs(seen.L), None, None
        falls = np.flatnonzero((gain[:-1] >= 1) & (gain[1:] < 1) & is_known[:-1] & is_known[1:])
        if falls.size:
            k = int(falls[-1])
            share = math.log(gain[k]) / (math.log(gain[k]) - math.log(gain[k + 1]))
            crossover = float(f[k] * (f[k + 1] / f[k]) ** share)
        if self._model_S is not None:
            agreement = float((np.abs(seen.S - self._model_S) <= seen.radius).mean())
        largest, radius = float(size[peak]), float(seen.radius[peak])
        numbers = (
            Number("S.peak", "largest |S|", largest, _PLAIN, largest - radius, largest + radius,
                   explanation="the largest amplification of a disturbance, with its 95 % confidence"),
            Number("L.crossover", "crossover of L", crossover, FREQUENCY, explanation="where |L| is 1"),
            Number("L.known", "frequencies at which L is known", float(is_known.mean()), SHARE,
                   explanation="where the 95 % confidence of L leaves 0 out"),
            Number("agreement", "agreement of S with the linear model", agreement, SHARE,
                   explanation="share of the frequencies at which the model is within the 95 % confidence of S; 95 % "
                   "if the model were exact and friction linear"),
            Number("coherence", "least coherence", float(seen.coherence.min()), _COHERENCE,
                   explanation="share of the force that the injection explains, of S and T"),
        )  # fmt: skip

        # verdict
        status: Status = "marginal" if largest > _HIGH else "good"
        if agreement is None:
            agrees, status = "no linear model to compare with", "told" if status == "good" else status
        else:
            agrees = f"S agrees with the linear model within its 95 % confidence at {percent(agreement)} of them"
            status = "marginal" if agreement < _FEW else status
        decibels = 20 * math.log10(largest or math.nan)
        parts = [
            f"|S| peaks at {about(DECIBEL, decibels)} at {about(FREQUENCY, float(f[peak]))}",
            None if crossover is None else f"the gain of L is 1 at {about(FREQUENCY, crossover)}",
            f"L is known at {'all ' if is_known.all() else f'{is_known.sum()} of '}{n} frequencies",
            agrees,
        ]
        verdict = Verdict(sentence(parts), status, (numbers[0], numbers[1], numbers[3]))

        # table: of all frequencies the terminal shows some; L where it is known
        columns = [
            Column("f", FREQUENCY),
            Column("|S|", _PLAIN, "gain from the injected to the total force"),
            Column("|T|", _PLAIN, "share of the injected force that the controller cancels"),
            Column("|L|", _PLAIN, "gain of the loop with this channel cut; none where its confidence includes 0"),
            Column("∠L", _PHASE),
        ]
        if self.predicted is not None:
            columns += [Column("|L| model", _PLAIN, "of the linear model"), Column("∠L model", _PHASE)]
        columns.append(
            Column("coherence", _COHERENCE, "of S and T, not of L: what the injection explains of the force")
        )
        rows: list[tuple[Cell, ...]] = []
        for k in np.unique(np.linspace(0, n - 1, min(_SHOWN_ROWS, n)).round().astype(int)):
            cells: list[Cell] = [float(f[k]), float(size[k]), float(abs(seen.T[k]))]
            cells += [float(gain[k]), float(np.angle(seen.L[k]))] if is_known[k] else [None, None]
            if self.predicted is not None:
                cells += [float(abs(self.predicted[k])), float(np.angle(self.predicted[k]))]
            rows.append((*cells, float(seen.coherence[k])))
        shown = f"{len(rows)} of {n} frequencies; frf.csv has all. " if len(rows) < n else ""
        note = f"{shown}Coherence is of S and T: it may be 1 where L is not known."
        table = Table("Frequency response", tuple(columns), tuple(rows), note=note)
        return Report(
            f"{self.title}: {self.channel}",
            verdict,
            (*sections, Section("Values", (table,))),
            study="frf",
            settings=settings_of(self.changed),
            lead=self._band,
            numbers=numbers,
            notes=tuple(Note(text, "warning") for text in self.notes),
        )

    def table(self) -> polars.DataFrame:
        """One row per frequency: gains [1], phases [rad], radii of 95 % confidence, coherence."""
        measured = self.measured
        parts: dict[str, Any] = {"frequency": self.frequency}
        for name, values, radius in (
            ("S", measured.S, measured.radius),
            ("T", measured.T, measured.radius),
            ("L", measured.L, measured.loop_radius),
        ):
            parts |= {f"{name}.gain": np.abs(values), f"{name}.phase": np.angle(values), f"{name}.radius": radius}
        parts["coherence"] = measured.coherence
        if self.predicted is not None and (S := self._model_S) is not None:
            for name, values in (("S", S), ("T", 1 - S), ("L", self.predicted)):
                parts |= {f"predicted.{name}.gain": np.abs(values), f"predicted.{name}.phase": np.angle(values)}
        return polars.DataFrame(parts)


def frf(  # noqa: PLR0912, PLR0915 - one road, in sections
    record: Record | Path | str, *, experiment: Experiment | Path | str | None = None, controller: Any = None
) -> FrequencyResponse:
    """The frequency response of a loop, from a run of an experiment with an `[injection]`.

    For the excited leg or mode, with the other channels closed: S = u/d from the injected to the total force,
    T = 1 − S, L = 1/S − 1, averaged over periods (Pintelon & Schoukens, System Identification, 2012),
    with those of the linear model that `margins` uses.

    A record executes no code. If its controller is a Python file, give the experiment or the controller for the linear
    model; without either, the notes say what is left out.

    Parameters
    ----------
    record
        From `run`, or its file or folder.
    experiment
        The experiment of the run, in whose folder the controller's Python file is found and executed; for the linear
        model.
    controller
        The controller of the run, if it replaced that of the experiment; for the linear model.

    Returns
    -------
    FrequencyResponse
        S, T and L at the injection's frequencies (n,) with their 95 % confidence, L of the linear model, and notes.

    Raises
    ------
    RecordError
        It cannot be read, its run had no injection, or `experiment` has another controller.
    ControllerError
        The run ended before two periods.

    See Also
    --------
    run, margins

    Examples
    --------
    >>> response = gs.frf(gs.run("frequency_response", {"loop.duration": 6}))
    >>> response.frequency.shape == response.measured.L.shape
    True
    """
    # read: the run's experiment, in the folder of the one that the caller has passed
    if not isinstance(record, Record):
        record = read_record(record)
    metadata = record.metadata
    try:
        chosen = Experiment.built().model_validate_json(json.dumps(metadata["experiment"]))
    except (KeyError, ValueError) as error:
        raise RecordError(f"the metadata contain no experiment ({error}); expected a record of `run`") from error
    if experiment is not None:
        now = load_experiment(experiment)
        if chosen.controller.code != now.controller.code:
            names = [", ".join(source.controller.code) or "no file" for source in (now, chosen)]
            raise RecordError(
                f"{now.where} has a controller of {names[0]}, the record's run one of {names[1]}; expected the "
                "experiment of this run"
            )
        chosen = chosen.from_file(now.where, now.folder)
    choice = chosen.injection
    if choice is None or "controller.injection" not in record:
        raise RecordError("the record's run had no [injection]; expected an experiment with that table")
    if "injection" in metadata.get("replaced", []):
        raise RecordError("the run had an injection of its own instead of [injection]; expected that of the experiment")

    # measure: S of the excited channel in the first pose of the reference, or at home
    sample_time, platform = float(metadata["sample_time"]), platform_of(record)
    pose = platform.home_position, platform.home_orientation
    if "reference.position" in record:
        pose = record["reference.position"][0], record["reference.orientation"][0]
    a, b = choice.directions(leg_jacobian(platform, *pose))
    # commands are held, so the last row before the next sample also has that of a delayed sample
    steps_a_sample = round(sample_time / float(metadata["plant_step"]))
    at = slice(steps_a_sample - 1, len(record.table) - 1, steps_a_sample)
    injected = record["controller.injection"][at] @ b
    force = (record["controller.force"] - record["controller.feedforward"])[at] @ b
    lines, samples = choice.lines(sample_time), len(choice.signal(sample_time))
    measured = response_of_periods(injected, force, samples, lines, choice.settle)
    frequency = lines / (samples * sample_time)

    # compare: L of the linear model, as in `margins`
    predicted, notes = None, list[str]()
    limited = float(record["flag.force_limited"].any(axis=1).mean())
    if limited:
        notes.append(f"forces were limited for {limited:.0%} of the time, so the loop is not linear; inject less")
    if "flag.manual" in record and record["flag.manual"].any():
        notes.append("the controller was off for a part of the run, so the loop was open; leave [[change]] enabled out")
    if metadata["outcome"]["status"] != "completed":
        notes.append(f"the run ended early: {metadata['outcome']['cause']}")
    if chosen.loop.jitter:
        notes.append("jitter delayed the samples, which the linear model does not include")
    if chosen.sensors.sample_time:
        notes.append("readings had a clock of their own, which the linear model does not include")
    try:
        if controller is None:
            # whether the experiment's controller is that of the run
            code = chosen.controller.code
            if "controller" in metadata.get("replaced", []):
                if experiment is None:
                    raise ControllerError(
                        "the run had a controller of its own instead of the experiment's; give it: frf(…, controller=…)"
                    )
                notes.append("the run had a controller of its own; the linear model has the experiment's")
            if code and experiment is None:
                raise ControllerError(
                    f"it would execute {', '.join(code)}, which the record names; if you trust this file, give the "
                    "run's experiment: --experiment FILE.toml, or frf(…, experiment=…)"
                )
            then, today = metadata.get("files", {}), digests(chosen) if code else {}
            executed = [name for name in today if name in code or name.endswith(".py")]
            changed = [name for name in executed if name in then and then[name] != today[name]]
            if changed:
                notes.append(
                    f"{', '.join(changed)} has changed since the run: the linear model is that of today's file"
                )
            law = chosen.controller.controller(platform, sample_time, chosen.folder)
        else:
            law = controller_of(controller, chosen.controller.design(platform, sample_time))
        linear = linear_of(law)
        if linear is None:
            raise ControllerError("the controller is not linear, or there is none")
        L = loop_transfer(
            platform_of(record, "machine"),
            linear,
            sample_time,
            pose,
            believed=platform,
            delay=chosen.loop.delay,
            lag=chosen.actuators.lag,
            side=chosen.sensors.side,
        )
        # of one channel, the others closed: 1/(b S a) − 1 with S = (1 + L)⁻¹ (n, 6, 6)
        S = np.linalg.inv(np.eye(6) + response(L, 2 * np.pi * frequency))
        predicted = np.asarray(1 / (S @ a @ b) - 1)
        if not is_stable(L):
            notes.append("the linear loop is unstable; `gough-stewart margins` shows the cause")
    except GoughStewartError as error:
        notes.append(f"no linear model to compare with: {error}")
    return FrequencyResponse(
        chosen.title,
        choice.channel,
        frequency,
        measured,
        predicted,
        tuple(notes),
        metadata.get("settings") or {},
        chosen.requirements,
    )


def loop_is_known(result: Response) -> NDArray[np.bool_]:
    """Where the circle of 95 % confidence about L leaves 0 out, and is a circle: elsewhere L is not known.

    At high frequencies S is near 1 and L = 1/S − 1 is the small difference of two larger numbers, however coherent
    force and injection are.
    """
    is_known = (result.loop_radius < np.abs(result.L)) & (result.radius < _SMALL * np.abs(result.S))
    return np.asarray(is_known)


def _charts(result: FrequencyResponse) -> tuple[Chart, ...]:
    """Points of the run with their circles, L where it is known, and lines of the linear model."""
    seen, model_L, model_S = result.measured, result.predicted, result._model_S
    is_known = loop_is_known(seen)
    size, radius = (np.where(is_known, values, np.nan) for values in (np.abs(seen.L), seen.loop_radius))
    angle, spread = np.full((2, len(size)), np.nan)
    angle[is_known] = np.unwrap(np.angle(seen.L[is_known]))
    spread[is_known] = np.arcsin(np.minimum(1.0, radius[is_known] / size[is_known]))
    unknown = "" if is_known.all() else "L is left out where its 95 % confidence includes 0."
    unity = (Mark(1.0, "gain of 1", role="neutral", tells=False),)
    half_turn = Mark(-math.pi, "−180°", role="neutral", tells=False)
    x = Axis("frequency", FREQUENCY, result.frequency, scale="log")

    def chart(title: str, values: FloatArray, radius: FloatArray, model: FloatArray | None, **options: Any) -> Chart:
        quantity = _PHASE if title == "phase of L" else _GAIN
        series = [Series("run", quantity, values, "measured", low=values - radius, high=values + radius)]
        if model is not None:
            series.append(Series("linear model", quantity, model, "nominal"))
        y = Axis(title, ANGLE) if quantity is _PHASE else Axis(title, _GAIN, scale="log")
        return Chart(title, x, tuple(series), y=y, group="bode", **options)

    line = None
    if model_L is not None:  # by full turns to the nearest phase
        line = np.unwrap(np.angle(model_L))
        turns = np.round(np.median(angle[is_known] - line[is_known]) / (2 * math.pi)) if is_known.any() else 0.0
        line = line + 2 * math.pi * turns
    coherence = Series("coherence of S and T", _COHERENCE, seen.coherence, "measured")
    return (
        chart("gain of L", size, radius, None if model_L is None else np.abs(model_L), marks=unity, note=unknown),
        chart("phase of L", angle, spread, line, marks=(half_turn,), note=unknown),
        chart("gain of S", np.abs(seen.S), seen.radius, None if model_S is None else np.abs(model_S), marks=unity),
        chart("gain of T", np.abs(seen.T), seen.radius, None if model_S is None else np.abs(1 - model_S), marks=unity),
        Chart("coherence of S and T", x, (coherence,), "points", y=Axis("coherence", _COHERENCE), group="bode",
              note="The share of the force that the injection explains; it says nothing of L where that is small."),
    )  # fmt: skip
