"""How a run was made, as tables of a report: settings, nearness to limits, parameters, versions."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.report.quantities import FORCE, SHARE, TIME, Quantity
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.report.words import plain_text
from gough_stewart.harness.results.outcome import outcome_of, outcome_text
from gough_stewart.harness.results.record_data import RecordData
from gough_stewart.harness.results.scene import FLAGS, nearness_to_limits
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.platform import Platform

_SECTIONS = (
    *("reference", "controller", "loop", "sensors", "actuators", "limits", "start", "change", "disturbance"),
    *("fault", "injection"),
)


def run_table(record: RecordData, platform: Platform) -> Table:
    """How the run was made, and how it ended."""
    metadata = record.metadata
    rows: list[tuple[Cell, Cell]] = []
    if metadata.get("outcome"):
        rows.append(("outcome", outcome_text(outcome_of(record))))
    rows += [("plant", str(metadata.get("plant", "–"))), ("platform", platform.name), ("rows", record.table.height)]
    for name in ("duration", "sample_time", "plant_step"):
        if metadata.get(name) is not None:
            rows.append((name.replace("_", " "), Value(metadata[name], TIME)))
    if metadata.get("force_limit"):
        rows.append(("force limit", Value(metadata["force_limit"], FORCE)))
    rows += _settings_of(metadata.get("experiment") or {})
    return Table("Run", (Column(""), Column("")), tuple(rows))


def _settings_of(experiment: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The settings of an experiment, table by table, without empty ones."""
    found = []
    for name in _SECTIONS:
        section = experiment.get(name)
        for part in section if isinstance(section, list) else [section] if section else []:
            text = ", ".join(f"{key} {plain_text(value)}" for key, value in part.items() if value not in (None, {}, []))
            if text:
                found.append((name, text))
    return found


def limits_table(record: RecordData, platform: Platform) -> Table | None:
    """How near each leg came to its limits, and when flags were first set; the metrics have their shares."""
    rows: list[tuple[Cell, ...]] = []
    for name, values in nearness_to_limits(record, platform).items():
        rows.append((f"{name}, of its limit", *(Value(share, SHARE) for share in values.max(axis=0).tolist())))
        if name in ("velocity", "power"):
            rows.append((f"{name}, first beyond its limit", *_firsts(record, values > 1)))
    for name in FLAGS:
        if f"flag.{name}" in record:
            flags = record[f"flag.{name}"].astype(bool)
            rows.append((f"{name.replace('_', ' ')}, first", *_firsts(record, flags)))
    columns = (Column("leg"), *(Column(f"{i}") for i in range(1, 7)))
    return Table("Limits", columns, tuple(rows), detail=True) if rows else None


def _firsts(record: RecordData, flags: NDArray[np.bool_]) -> list[Cell]:
    """Times at which each leg's flag (n, 6) is first set."""
    return [Value(float(record["time"][leg.argmax()]), TIME) if leg.any() else "never" for leg in flags.T]


def parameters_table(machine: Platform, believed: Platform) -> Table:
    """All parameters of the machine, with those that the controller's design assumes where they differ."""
    differ = machine != believed
    assumed, rows = believed.as_dict(), []
    for name, value in machine.as_dict().items():
        if value is None or name == "name":
            continue
        head = Quantity("", TABLE[name].unit if name in TABLE else "").headed(name)
        row: list[Cell] = [head, plain_text(value)]
        if differ:
            same = assumed.get(name) is not None and np.array_equal(value, assumed[name])
            row.append("" if same else plain_text(assumed.get(name, "–")))
        rows.append(tuple(row))
    columns = (Column("parameter"), Column("machine"), *((Column("assumed in the design"),) if differ else ()))
    return Table(f"Platform: {machine.name}", columns, tuple(rows), detail=True)


def versions_table(record: RecordData) -> Table:
    """Versions of the software that wrote the record."""
    rows = tuple((name, str(number)) for name, number in record.metadata.get("versions", {}).items())
    return Table("Versions", (Column("package"), Column("version")), rows, detail=True)
