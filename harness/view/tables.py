"""Tables of a page on a record: run settings, flags, parameters, versions."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.output.tables import Named, Sheet, number_text, quantity_text
from gough_stewart.harness.results.outcome import outcome_of, outcome_text
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.scene import FLAGS, nearness_to_limits
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.platform import Platform


def run_sheet(record: Record, platform: Platform) -> Sheet:
    """How the run was made, and how it ended."""
    metadata, sheet = record.metadata, Sheet("Run", ("", ""))
    sheet.add("outcome", outcome_text(outcome_of(record)))
    sheet.add("plant", str(metadata.get("plant", "–")))
    sheet.add("platform", platform.name)
    sheet.add("rows", str(record.table.height))
    for name in ("duration", "sample_time", "plant_step"):
        if metadata.get(name) is not None:
            sheet.add(Named(name.replace("_", " "), "s"), number_text(metadata[name], 6))
    if metadata.get("force_limit"):
        sheet.add(Named("force limit", "N"), number_text(metadata["force_limit"], 6))
    for name, values in settings_of(metadata.get("experiment") or {}):
        sheet.add(name, values)
    return sheet


def settings_of(experiment: dict[str, Any]) -> list[tuple[str, str]]:
    """The settings of an experiment, section by section, without empty ones."""
    sections = ("reference", "controller", "loop", "sensors", "actuators", "limits", "start", "change", "disturbance")
    found = []
    for name in sections:
        for part in _as_list(experiment.get(name)):
            text = ", ".join(f"{key} {_plain(value)}" for key, value in part.items() if value not in (None, {}, []))
            if text:
                found.append((name, text))
    return found


def limits_sheet(record: Record, platform: Platform) -> Sheet | None:
    """How near each leg came to its limits, and when flags were first set; the metrics have their shares."""
    sheet = Sheet("Limits and flags", ("", *(f"{i}" for i in range(1, 7))))
    for name, values in nearness_to_limits(record, platform).items():
        sheet.add(
            Named(f"{name}, most of its limit", "%"), *(quantity_text(share, "%") for share in 100 * values.max(axis=0))
        )
        if name in ("velocity", "power"):
            sheet.add(Named(f"{name}, first beyond its limit at", "s"), *_firsts(record, values > 1))
    for name in FLAGS:
        if f"flag.{name}" in record:
            flags = record[f"flag.{name}"].astype(bool)
            sheet.add(Named(f"{name.replace('_', ' ')}, first at", "s"), *_firsts(record, flags))
    return sheet if sheet.rows else None


def _firsts(record: Record, flags: NDArray[np.bool_]) -> list[str]:
    """Times at which each leg's flag (n, 6) is first set."""
    return [number_text(record["time"][leg.argmax()], 6) if leg.any() else "never" for leg in flags.T]


def parameters_sheet(machine: Platform, believed: Platform) -> Sheet:
    """All parameters of the machine, with the nominal values where they differ."""
    differ = machine != believed
    sheet = Sheet(f"Platform: {machine.name}", ("", "machine", "believed") if differ else ("", ""))
    values = believed.as_dict()
    for name, value in machine.as_dict().items():
        if value is None or name == "name":
            continue
        texts = [_plain(value)]
        if differ:
            texts.append(
                ""
                if values.get(name) is not None and np.array_equal(value, values[name])
                else _plain(values.get(name, "–"))
            )
        sheet.add(Named(name, TABLE[name].unit) if name in TABLE else name, *texts)
    return sheet


def versions_sheet(record: Record) -> Sheet:
    """Versions of the software that wrote the record."""
    sheet = Sheet("Versions", ("", ""))
    for name, number in record.metadata.get("versions", {}).items():
        sheet.add(name, str(number))
    return sheet


def _as_list(section: Any) -> list[dict[str, Any]]:
    if not section:
        return []
    return section if isinstance(section, list) else [section]


def _plain(value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        rows = [_plain(each) for each in value]
        return "; ".join(rows) if value and isinstance(value[0], list) else ", ".join(rows)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_plain(each)}" for key, each in value.items())
    return str(value)
