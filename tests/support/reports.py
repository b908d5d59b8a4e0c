"""Parts of a report: as `report()` gives them in Python, and as a command writes them to report.json."""

import json
from pathlib import Path
from typing import Any


def tables_of(report: Any) -> dict[str, Any]:
    """The tables of a report in Python, by title."""
    return {part.title: part for part in report.parts() if type(part).__name__ == "Table"}


def report_in(folder: Path) -> dict[str, Any]:
    """The report that a command wrote to a folder."""
    data: dict[str, Any] = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    return data


def parts_in(data: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    """All tables, charts, notes or surfaces of a report as data."""
    return [part for section in data["sections"] for part in section["parts"] if part["part"] == kind]


def rows_in(table: dict[str, Any]) -> dict[str, list[Any]]:
    """The cells of a table as data by the first one of each row, numbers in SI units."""
    return {row[0]: [cell["value"] if isinstance(cell, dict) else cell for cell in row[1:]] for row in table["rows"]}


def units_in(data: dict[str, Any], table: dict[str, Any]) -> dict[str, str]:
    """The unit in which each row of a table as data is shown, by its first cell; that of its first number."""
    quantities = {row[0]: next((c["quantity"] for c in row[1:] if isinstance(c, dict)), None) for row in table["rows"]}
    return {name: data["quantities"].get(key, {}).get("unit", "") for name, key in quantities.items()}
