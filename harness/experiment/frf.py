"""The frequency response of a loop from the record of a run with an injection, compared with the linear model."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import polars

from gough_stewart.harness.control.frequency_response import Response, response_of_periods
from gough_stewart.harness.control.laws import Controller, controller_of, linear_of
from gough_stewart.harness.control.loop_transfer import loop_transfer
from gough_stewart.harness.control.margins import is_stable, response
from gough_stewart.harness.control.structured import ComplexArray
from gough_stewart.harness.errors import ControllerError, RecordError
from gough_stewart.harness.experiment.file import experiment_of
from gough_stewart.harness.experiment.frf_report import frf_report
from gough_stewart.harness.experiment.named_files import digests
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.results.record import Record, machine_of, platform_of, read_record
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.vectors import FloatArray

FILES = ("frf.csv", "frf.parquet")


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
    """L of the linear model (n,), without Coulomb friction; None where there is none."""
    notes: tuple[str, ...]
    """Reasons to doubt the result."""
    changed: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """What was set of the experiment's file, as `Experiment.changed`."""
    requirements: tuple[str, ...] = ()
    """`[require]` of the run's experiment."""

    def __repr__(self) -> str:
        """Channel, band, coherence, and the largest difference from the linear model."""
        return "\n".join([f"Frequency response: {self.title}", *(f"  {line}" for line in self._summary())])

    def _repr_html_(self) -> str:
        from gough_stewart.harness.report.notebook import to_html

        return to_html(self.report(charts=False))

    def report(self, *, charts: bool = True) -> Report:
        """The peak of S, where L is known and where its gain is 1, and how all agrees with the linear model.

        Returns
        -------
        Report
            Verdict, numbers such as `S.peak` and `L.crossover`, a table, and with `charts` the Bode plot.
        """
        return frf_report(self, charts=charts)

    def _summary(self) -> list[str]:
        found, f = self.measured, self.frequency
        peak = int(np.abs(found.S).argmax())
        lines = [
            f"{self.channel}, {len(f)} frequencies from {f[0]:.4g} to {f[-1]:.4g} Hz, {found.periods} periods",
            f"largest |S| {abs(found.S[peak]):.4g} at {f[peak]:.4g} Hz; smallest coherence {found.coherence.min():.3g}",
        ]
        if self.predicted is not None:
            gap = np.abs(found.S - 1 / (1 + self.predicted))
            worst = int(gap.argmax())
            lines.append(f"farthest from the linear model: S by {gap[worst]:.3g} at {f[worst]:.4g} Hz")
        return [*lines, *self.notes]

    def table(self) -> polars.DataFrame:
        """One row per frequency: gains [1], phases [rad], radii of 95 % confidence, coherence."""
        found = self.measured
        parts: dict[str, Any] = {"frequency": self.frequency}
        for name, values, radius in (
            ("S", found.S, found.radius),
            ("T", found.T, found.radius),
            ("L", found.L, found.loop_radius),
        ):
            parts |= {f"{name}.gain": np.abs(values), f"{name}.phase": np.angle(values), f"{name}.radius": radius}
        parts["coherence"] = found.coherence
        if self.predicted is not None:
            S = 1 / (1 + self.predicted)
            for name, values in (("S", S), ("T", 1 - S), ("L", self.predicted)):
                parts |= {f"predicted.{name}.gain": np.abs(values), f"predicted.{name}.phase": np.angle(values)}
        return polars.DataFrame(parts)


def frf(
    record: Record | Path | str, *, experiment: Experiment | Path | str | None = None, controller: Any = None
) -> FrequencyResponse:
    """The frequency response of a loop, from a run of an experiment with an `[injection]`.

    For the excited leg or mode, with the other channels closed: S = u/d from the injected to the total force,
    T = 1 − S, L = 1/S − 1, averaged over periods, with those of the linear model that `margins` uses.

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
        S, T and L at the lines of the injection (n,) with their 95 % confidence, L of the linear model, and notes.

    Raises
    ------
    RecordError
        It cannot be read, its run had no injection, or `experiment` has another controller.
    ControllerError
        The run ended before two periods.

    Examples
    --------
    >>> found = gs.frf(gs.run("frequency_response", {"loop.duration": 6}))
    >>> found.frequency.shape == found.measured.L.shape
    True
    """
    if not isinstance(record, Record):
        record = read_record(record)
    own = _experiment_of(record)
    if experiment is not None:
        own = _with_folder(own, experiment_of(experiment))
    choice = own.injection
    if choice is None or "controller.injection" not in record:
        raise RecordError("the record's run had no [injection]; expected an experiment with that table")
    if "injection" in _replaced(record):
        raise RecordError("the run had an injection of its own instead of [injection]; expected that of the experiment")
    sample_time = float(record.metadata["sample_time"])
    J = leg_jacobian(platform_of(record), *_pose(record))
    a, b = choice.directions(J)
    # commands are held, so the last row before the next sample also has that of a delayed sample
    every = round(sample_time / float(record.metadata["plant_step"]))
    at = slice(every - 1, len(record.table) - 1, every)
    injected = record["controller.injection"][at] @ b
    force = (record["controller.force"] - record["controller.feedforward"])[at] @ b
    lines, samples = choice.lines(sample_time), len(choice.signal(sample_time))
    measured = response_of_periods(injected, force, samples, lines, choice.settle)
    frequency = lines / (samples * sample_time)
    predicted, notes = None, _notes(record)
    try:
        if controller is None:
            notes += _doubts_of_controller(record, own, is_given=experiment is not None)
        L = _linear_loop(record, own, controller)
        # of one channel, the others closed: 1/(b S a) − 1 with S = (1 + L)⁻¹ (n, 6, 6)
        S = np.linalg.inv(np.eye(6) + response(L, 2 * np.pi * frequency))
        predicted = np.asarray(1 / (S @ a @ b) - 1)
        if not is_stable(L):
            notes.append("the linear loop is unstable; `gough-stewart margins` shows the cause")
    except GoughStewartError as error:
        notes.append(f"no linear model to compare with: {error}")
    changed = record.metadata.get("settings") or {}
    found = (frequency, measured, predicted, tuple(notes), changed, own.requirements)
    return FrequencyResponse(own.title, choice.channel, *found)


def _experiment_of(record: Record) -> Experiment:
    try:
        return Experiment.built().model_validate_json(json.dumps(record.metadata["experiment"]))
    except (KeyError, ValueError) as error:
        raise RecordError(f"the metadata contain no experiment ({error}); expected a record of `run`") from error


def _with_folder(own: Experiment, given: Experiment) -> Experiment:
    """The record's experiment, which may have other settings, with the folder of the given one."""
    if own.controller.code != given.controller.code:
        names = [", ".join(each.controller.code) or "no file" for each in (given, own)]
        raise RecordError(
            f"{given.where} has a controller of {names[0]}, the record's run one of {names[1]}; expected the "
            "experiment of this run"
        )
    return own.from_file(given.where, given.folder)


def _doubts_of_controller(record: Record, own: Experiment, is_given: bool) -> list[str]:
    """Notes on whether the experiment's controller is that of the run.

    Raises
    ------
    ControllerError
        It is not, or executes code, and nobody has asked for it.
    """
    notes, code = [], own.controller.code
    if "controller" in _replaced(record):
        if not is_given:
            raise ControllerError(
                "the run had a controller of its own instead of the experiment's; give it: frf(…, controller=…)"
            )
        notes.append("the run had a controller of its own; the linear model has the experiment's")
    if code and not is_given:
        raise ControllerError(
            f"it would execute {', '.join(code)}, which the record names; if you trust this file, give the run's "
            "experiment: --experiment FILE.toml, or frf(…, experiment=…)"
        )
    then, now = record.metadata.get("files", {}), digests(own) if code else {}
    executed = [name for name in now if name in code or name.endswith(".py")]
    changed = [name for name in executed if name in then and then[name] != now[name]]
    if changed:
        notes.append(f"{', '.join(changed)} has changed since the run: the linear model is that of today's file")
    return notes


def _replaced(record: Record) -> list[str]:
    """The tables of the experiment that objects replaced in the run."""
    return list(record.metadata.get("replaced", []))


def _pose(record: Record) -> tuple[FloatArray, FloatArray]:
    """The pose of linearisation: the first of the reference, or home."""
    if "reference.position" in record:
        return record["reference.position"][0], record["reference.orientation"][0]
    platform = platform_of(record)
    return platform.home_position, platform.home_orientation


def _linear_loop(record: Record, experiment: Experiment, controller: Any) -> Any:
    """The loop transfer of the run, as in `margins`."""
    platform, sample_time = platform_of(record), float(record.metadata["sample_time"])
    own: Controller | None
    own = (
        experiment.controller.controller(platform, sample_time, experiment.folder)
        if controller is None
        else controller_of(controller, experiment.controller.design(platform, sample_time))
    )
    made = linear_of(own)
    if made is None:
        raise ControllerError("the controller is not linear, or there is none")
    position, orientation = _pose(record)
    return loop_transfer(
        machine_of(record),
        made,
        sample_time,
        believed=platform,
        delay=experiment.loop.delay,
        lag=experiment.actuators.lag,
        position=position,
        orientation=orientation,
        side=experiment.sensors.side,
    )


def _notes(record: Record) -> list[str]:
    notes = []
    limited = float(record["flag.force_limited"].any(axis=1).mean())
    if limited:
        notes.append(f"forces were limited for {limited:.0%} of the time, so the loop is not linear; inject less")
    if record.metadata["outcome"]["status"] != "completed":
        notes.append(f"the run ended early: {record.metadata['outcome']['cause']}")
    choice = record.metadata["experiment"]
    if choice["loop"]["jitter"]:
        notes.append("jitter delayed the samples, which the linear model does not include")
    if choice["sensors"].get("sample_time"):
        notes.append("readings had a clock of their own, which the linear model does not include")
    return notes


def frf_files(found: FrequencyResponse) -> dict[str, bytes]:
    """The table by file name."""
    table, parquet = found.table(), BytesIO()
    table.write_parquet(parquet)
    return {
        "frf.csv": table.write_csv().encode(),
        "frf.parquet": parquet.getvalue(),
    }
