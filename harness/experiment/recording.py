"""The record of a run: columns by name, and metadata."""

from typing import Any

import numpy as np
import polars

from gough_stewart.harness.experiment.batch import Prepared
from gough_stewart.harness.loop.run import Run
from gough_stewart.harness.loop.seeds import as_numbers
from gough_stewart.harness.output.versions import versions
from gough_stewart.harness.plants import signals
from gough_stewart.harness.results.record import Record, columns, plain
from gough_stewart.model import interface
from gough_stewart.model.vectors import FloatArray

FORMAT = 1
_INPUT_COLUMNS = [name for v in interface.INPUTS for name in v.scalar_names]
_REFERENCE = (
    *((f"reference.{name}", 3) for name in (*signals.NAMES[:4], "acceleration", "angular_acceleration")),
    ("reference.leg_length", 6),
    ("reference.leg_velocity", 6),
)


def record_of(run: Run, prepared: Prepared, circumstances: dict[str, Any]) -> Record:
    """The table of a run, and its metadata: those passed in, and those of the run itself."""
    n, at = len(run.time), run.sample_of_row
    parts: list[tuple[list[str], Any]] = [
        (["time"], run.time[:, None]),
        (list(interface.RESULT_COLUMNS), run.results),
        (_INPUT_COLUMNS, run.inputs),
    ]
    if prepared.motion is not None and prepared.legs is not None:
        reference = np.concatenate([*prepared.motion, *prepared.legs], axis=1)[:n]
        parts.append(([name for prefix, size in _REFERENCE for name in columns(prefix, size)], reference))
        parts += _errors(run.results, reference)
    if run.used:
        names = [f"measured.{name}" for name in signals.column_names(run.used)]
        parts.append((names, run.measured[at][:, signals.positions(run.used)]))
    parts.append((columns("controller.force", 6), run.command[at]))
    parts.append((columns("controller.feedforward", 6), prepared.loop.feedforward[at]))
    if prepared.loop.injection is not None:
        parts.append((columns("controller.injection", 6), prepared.loop.injection[at]))
    parts.append((columns("controller.state", run.controller_state.shape[1]), run.controller_state[at]))
    parts += _changed_parameters(prepared, run.time)
    parts.append((columns("flag.force_limited", 6), run.force_limited[at]))
    parts.append((columns("flag.rate_limited", 6), run.rate_limited))
    parts.append((columns("flag.stroke_exceeded", 6), run.stroke_exceeded))
    table = polars.DataFrame({name: values[:, k] for names, values in parts for k, name in enumerate(names)})
    return Record(table, _metadata(run, prepared, circumstances))


def _errors(results: FloatArray, reference: FloatArray) -> list[tuple[list[str], FloatArray]]:
    """Reference minus actual."""
    actual = interface.unpack(interface.RESULTS, results)
    references, at = {}, 0
    for name, size in _REFERENCE:
        references[name.removeprefix("reference.")] = reference[:, at : at + size]
        at += size
    names = ("position", "orientation", "leg_length")
    return [(columns(f"error.{name}", references[name].shape[1]), references[name] - actual[name]) for name in names]


def _changed_parameters(prepared: Prepared, time: FloatArray) -> list[tuple[list[str], FloatArray]]:
    """Parameters that changed during the run, over time; the others are in the metadata."""
    changes = [change for change in prepared.loop.changes if change.parameters]
    parts = []
    for variable in interface.VARIABLES:
        if not any(variable.name in change.parameters for change in changes):
            continue
        values = np.tile(np.ravel(getattr(prepared.machine, variable.name)), (len(time), 1))
        for change in changes:
            if variable.name in change.parameters:
                # rows are multiples of the plant step up to rounding
                values[time > change.time - prepared.loop.timing.plant_step / 2] = np.ravel(
                    np.asarray(change.parameters[variable.name])
                )
        parts.append((list(variable.scalar_names), values))
    return parts


def _metadata(run: Run, prepared: Prepared, circumstances: dict[str, Any]) -> dict[str, Any]:
    timing, actuators = prepared.loop.timing, prepared.loop.actuators
    return {
        "format": FORMAT,
        **circumstances,
        **({"warnings": list(prepared.warnings)} if prepared.warnings else {}),
        "rows": len(run.time),
        "outcome": run.outcome._asdict(),
        "duration": timing.duration,
        "sample_time": timing.sample_time,
        "plant_step": timing.plant_step,
        "seed": as_numbers(prepared.loop.sensors.seed),
        "force_limit": actuators.force_limit,
        "platform": plain(prepared.platform),
        "machine": plain(prepared.machine),
        "versions": versions(),
    }
