"""A report as plain data for JSON, and back; docs/report.md describes the fields.

Fields with their default value are left out. Quantities are listed once, under `quantities`, and named elsewhere. A
part of a section says what it is by `part`. In arrays, NaN is null; infinite numbers are the strings "Infinity" and
"-Infinity" everywhere, since JSON has none.
"""

import json
import math
import types
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from gough_stewart.harness.report import document
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.report.quantities import Quantity

VERSION = 1
_PARTS: dict[str, type] = {kind.__name__.lower(): kind for kind in get_args(document.Part)}
_INFINITE = {"Infinity": math.inf, "-Infinity": -math.inf}


def to_data(report: Report) -> dict[str, Any]:
    """A report as dictionaries, lists, strings, numbers, booleans and None."""
    keys: dict[Quantity, str] = {}
    data = _plain(report, keys)
    known = {key: _fields_of(quantity, {}) for quantity, key in keys.items()}
    return {"version": VERSION, "quantities": known, **data}


def to_json(report: Report) -> str:
    """A report as JSON, on one line."""
    return json.dumps(to_data(report), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def from_data(data: dict[str, Any]) -> Report:
    """The report of `to_data`.

    Raises
    ------
    ValueError
        Not such data; names the field.
    """
    if not isinstance(data, dict) or data.get("version") != VERSION:
        found = data.get("version") if isinstance(data, dict) else type(data).__name__
        raise ValueError(f"version: {found}; expected a report of version {VERSION}")
    quantities = {key: _object(Quantity, each, {}, f"quantities.{key}") for key, each in data["quantities"].items()}
    rest = {name: each for name, each in data.items() if name not in ("version", "quantities")}
    report: Report = _object(Report, rest, quantities, "report")
    return report


def from_json(text: str | bytes) -> Report:
    """The report of `to_json`.

    Raises
    ------
    ValueError
        Not JSON, or as `from_data`.
    """
    return from_data(json.loads(text))


def _plain(value: Any, keys: dict[Quantity, str]) -> Any:
    if isinstance(value, Quantity):
        return _key(value, keys)
    if is_dataclass(value):
        kind = type(value).__name__.lower()
        head = {"part": kind} if kind in _PARTS else {}
        return {**head, **_fields_of(value, keys)}
    if isinstance(value, tuple):
        return [_plain(each, keys) for each in value]
    if isinstance(value, np.ndarray):
        return _numbers(value)
    plain = value.item() if isinstance(value, np.generic) else value
    return _infinite(plain) if isinstance(plain, float) else plain


def _fields_of(value: Any, keys: dict[Quantity, str]) -> dict[str, Any]:
    return {
        each.name: _plain(found, keys)
        for each in fields(value)
        if not _is_default(each, found := getattr(value, each.name))
    }


def _is_default(each: "Field[Any]", value: Any) -> bool:
    default = each.default if each.default_factory is MISSING else each.default_factory()
    if isinstance(value, np.ndarray) or isinstance(default, np.ndarray):
        return default is not None and default is not MISSING and np.array_equal(value, default)
    return default is not MISSING and type(value) is type(default) and bool(value == default)


def _numbers(array: Any) -> list[Any]:
    listed: list[Any] = array.tolist()
    if np.isfinite(array).all():
        return listed
    return [_numbers(np.asarray(each)) if isinstance(each, list) else _infinite(each) for each in listed]


def _infinite(value: float) -> float | str | None:
    if math.isnan(value):
        return None
    return value if math.isfinite(value) else ("Infinity" if value > 0 else "-Infinity")


def _key(quantity: Quantity, keys: dict[Quantity, str]) -> str:
    if quantity not in keys:
        stem = quantity.name or quantity.unit or "number"
        taken = set(keys.values())
        numbered = (f"{stem} {k}" for k in range(2, len(taken) + 3))
        keys[quantity] = stem if stem not in taken else next(key for key in numbered if key not in taken)
    return keys[quantity]


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _object(kind: type, data: Any, quantities: dict[str, Quantity], where: str) -> Any:
    if not isinstance(data, dict):
        raise ValueError(f"{where}: {type(data).__name__}; expected an object")  # noqa: TRY004
    hints, known = _hints(kind), {each.name for each in fields(kind)}
    given = {name: each for name, each in data.items() if name != "part"}
    unknown = next((name for name in given if name not in known), None)
    if unknown is not None:
        raise ValueError(f"{where}.{unknown}: unknown; expected fields among {', '.join(sorted(known))}")
    values = {name: _read(hints[name], each, quantities, f"{where}.{name}") for name, each in given.items()}
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from error


def _read(hint: Any, data: Any, quantities: dict[str, Quantity], where: str) -> Any:
    origin, choices = get_origin(hint), get_args(hint)
    found = _INFINITE.get(data, data) if hint is float and isinstance(data, str) else data
    if origin in (Union, types.UnionType):
        found = _either(choices, data, quantities, where)
    elif hint is Quantity:
        if data not in quantities:
            raise ValueError(f"{where}: the quantity '{data}'; expected one of {', '.join(quantities)}")
        found = quantities[data]
    elif is_dataclass(hint):
        found = _object(hint, data, quantities, where)  # type: ignore[arg-type]
    elif origin is tuple:
        if not isinstance(data, list):
            raise ValueError(f"{where}: {type(data).__name__}; expected a list")
        kinds = [choices[0]] * len(data) if choices[-1] is Ellipsis else choices
        pairs = enumerate(zip(kinds, data, strict=True))
        found = tuple(_read(each, item, quantities, f"{where}[{k}]") for k, (each, item) in pairs)
    elif origin is np.ndarray:
        found = _array(data)
    return found


def _either(choices: tuple[Any, ...], data: Any, quantities: dict[str, Quantity], where: str) -> Any:
    """One of several types: an object by its `part`, or as the only class among them; anything else as it is."""
    if isinstance(data, dict):
        kind = _PARTS.get(data["part"]) if "part" in data else next(filter(is_dataclass, choices), None)
        if kind is None or kind not in choices:
            raise ValueError(f"{where}: the part '{data.get('part')}'; expected one of {', '.join(_PARTS)}")
        return _object(kind, data, quantities, where)  # type: ignore[arg-type]
    if data is None and type(None) in choices:
        return None
    if isinstance(data, str) and Quantity in choices:
        return _read(Quantity, data, quantities, where)
    if isinstance(data, str) and data in _INFINITE and float in choices:
        return _INFINITE[data]
    if isinstance(data, list):
        return _read(next(each for each in choices if get_origin(each) in (np.ndarray, tuple)), data, quantities, where)
    return data


def _array(data: Any) -> Any:
    def number(each: Any) -> Any:
        if isinstance(each, list):
            return [number(item) for item in each]
        return math.nan if each is None else _INFINITE.get(each, each) if isinstance(each, str) else each

    return np.array([number(each) for each in data], dtype=float)
