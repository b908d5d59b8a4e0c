"""Other values in an experiment: of `--set`, of `--vary`, of the members of an `[ensemble]`, of tuning's candidates.

A key such as `controller.bandwidth` names a place in the experiment's tables. `with_settings` sets keys in plain
tables, before they are validated as a whole; `table_with` sets paths in one validated table, and validates only that.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from pydantic import ValidationError

from gough_stewart.harness.control.controllers import ControllerChoice
from gough_stewart.harness.errors import ExperimentError, SettingError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.plants.signals import NAMES, VARIABLES
from gough_stewart.harness.report.quantities import of_unit, plain_text
from gough_stewart.harness.sampling.variation import EnsembleChoice, VariedValue
from gough_stewart.harness.section import TableSection, Unit, annotation_in, complaints, kinds, sections_in
from gough_stewart.model import interface
from gough_stewart.model.interface import nearest
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.toml import toml_values
from gough_stewart.model.units import PLAIN

# Changed settings: strings "key.key=value", or a mapping from "key.key" to values.
Settings = Iterable[str] | Mapping[str, Any]
# Values of a member by their path through the tables of the experiment.
Values = Mapping[tuple[str, ...], Any]

_PLATFORMS = ("platform", "plant")
# Setting one of two keys removes the other one of its table.
_EITHER = {"platform.preset": "file", "platform.file": "preset"}
# Common to all members: clocks, sampling and simulation settings, and strings.
_COMMON = {
    "loop": ("duration", "sample_time", "plant_step"),
    "sensors": ("seed", "sample_time", "side"),
    "plant": ("kind", "fmu", "file", "tolerance", "fixed_step_size"),
    "platform": ("preset", "file"),
    "limits": ("stroke", "condition_number"),
    "controller": ("type", "file", "name", "factory", "names", "space"),
    "reference": ("type", "file"),
}
_SIGNALS = {variable.name: variable for variable in VARIABLES}
_GAINS = re.compile(r"controller\.\w+_gain")
_POINT_FIRST = re.compile(r"[+-]?\.\d+([eE][+-]?\d+)?", re.ASCII)
_UNITS = {variable.name: variable.unit for variable in interface.VARIABLES} | {n: row.unit for n, row in TABLE.items()}


def with_settings(values: Mapping[str, Any], settings: Settings) -> dict[str, Any]:
    """A copy of plain values with some set: "loop.duration=3", "reference.position_change=[0, 0, 0.01]"."""
    tables: dict[str, Any] = _copied(values)
    items = keys_and_values(settings)
    for where, key, value in items:
        set_key(tables, where, key, _copied(value))
    if {key.strip() for _, key, _ in items} >= _EITHER.keys():
        raise SettingError(items[-1][0], "", f"{' and '.join(_EITHER)} are both set; expected one of them")
    return tables


def keys_and_values(settings: Settings) -> list[tuple[str, str, Any]]:
    """For every setting its name for messages, its key, and its value; texts are TOML, or else texts as they are."""
    if isinstance(settings, Mapping):
        return [
            (f"setting {key!r}", str(key), value.tolist() if isinstance(value, np.ndarray | np.generic) else value)
            for key, value in settings.items()
        ]
    items = list[tuple[str, str, Any]]()
    for setting in [settings] if isinstance(settings, str) else settings:
        where = f"--set {setting}"
        key, equals, text = setting.partition("=")
        if not equals:
            raise SettingError(where, "", "expected key=value, for instance loop.duration=2")
        if "\n" in text:
            raise SettingError(where, "", "expected one line")
        items.append((where, key, typed_value(text)))
    return items


def typed_value(text: str) -> Any:
    """The value of a typed text: of TOML, such as a number in SI units, or else the text itself, such as 300kg."""
    try:
        return toml_values(f"value = {text}")["value"]
    except ValueError:
        # TOML has no numbers that begin with their point
        return float(text) if _POINT_FIRST.fullmatch(text.strip()) else text.strip()


def set_key(values: Any, where: str, key: str, value: Any) -> None:
    """Set one key, such as "loop.duration", in the tables of an experiment, plain or tomlkit's."""
    names = key.strip().split(".")
    if not all(names):
        raise SettingError(where, "", "expected key=value, for instance loop.duration=2")
    table: Any = values
    for name in names[:-1]:
        if isinstance(table, dict) and table.get(name) is None:
            table[name] = {}
        table = inner(table, name)
    if not isinstance(table, dict):
        raise SettingError(where, "", f"{key.rpartition('.')[0]} is not a table of the experiment")
    table[names[-1]] = value
    if replaced := _EITHER.get(key.strip()):
        table.pop(replaced, None)


def inner(tables: Any, name: str) -> Any:
    """What a table has under a name, or a list such as [[change]] under a number from 1 on; None if it has nothing."""
    if isinstance(tables, Mapping):
        return tables.get(name)
    is_number = isinstance(tables, list) and name.isdigit() and 1 <= int(name) <= len(tables)
    return tables[int(name) - 1] if is_number else None


def _copied(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _copied(inner) for key, inner in value.items()}
    return [_copied(element) for element in value] if isinstance(value, list) else value


def by_table(values: Values) -> dict[str, dict[tuple[str, ...], Any]]:
    """Values by the name of their table, and by their paths in it."""
    tables = dict[str, dict[tuple[str, ...], Any]]()
    for (name, *path), value in values.items():
        tables.setdefault(name, {})[tuple(path)] = value
    return tables


def experiment_with(experiment: Experiment, values: Values) -> Experiment:
    """An experiment with other values by their paths."""
    changed = by_table(values)
    return experiment.model_copy(update={name: table_with(experiment, name, changed[name]) for name in changed})


def table_with(experiment: Experiment, name: str, values: Values) -> Any:
    """A table of an experiment, or a list of tables, with other values by their paths in it.

    Invalid ones are an `ExperimentError`; those of a platform are checked with the platform.
    """
    table = getattr(experiment, name)
    if name in _PLATFORMS:
        parameters = {**table.parameters, **{path[-1]: value for path, value in values.items()}}
        return table.model_copy(update={"parameters": parameters})

    is_list = isinstance(table, list)
    elements: dict[str, TableSection] = {str(k): part for k, part in enumerate(table, 1)} if is_list else {"": table}
    for number, of_element in by_table(values).items() if is_list else [("", values)]:
        element = elements[number]
        plain = element.model_dump(exclude_unset=True)
        for path, value in of_element.items():
            set_key(plain, experiment.where, ".".join(path), value)
        try:
            elements[number] = type(element).built().model_validate(plain)
        except ValidationError as error:
            where = f"{name}.{number}".rstrip(".")
            raise ExperimentError(experiment.where, where, complaints(error, type(element), plain)) from None
    return [*elements.values()] if is_list else elements[""]


@dataclass(frozen=True)
class Place:
    """A place in an experiment: the path through its tables, and the value there."""

    path: tuple[str, ...]
    target: VariedValue


def place_of(  # noqa: PLR0912, PLR0915 - one road, in sections
    key: str, experiment: Experiment, nominal: Platform, machine: Platform, is_replaced: bool
) -> Place:
    """The place that a key of `[ensemble]` names, a `ValueError` if it is none, or one common to all members.

    Likewise one of a controller that another replaces.
    """
    path = tuple(key.split("."))
    if len(path) == 1 and key in TABLE:
        path = ("plant", "parameters", key)
    elif len(path) == 2 and path[0] in _PLATFORMS and path[1] in TABLE:
        path = (path[0], "parameters", path[1])
    section, *rest = path
    if section not in Experiment.model_fields:
        tables = [name for name in Experiment.model_fields if name != "ensemble"]
        raise ValueError(f"no such parameter{nearest(section, [*TABLE, *EnsembleChoice.model_fields, *tables])}")
    if not rest or (rest[-1] in _COMMON.get(section, ()) and rest[:-1] != ["parameters"]) or section == "ensemble":
        raise ValueError("is common to all members; expected a parameter of the machine, or a number of another table")
    if section in _PLATFORMS:
        name = rest[-1]
        if len(rest) != 2 or name not in TABLE:
            raise ValueError(f"no such parameter{nearest(name, TABLE)}")
        value = getattr(machine if section == "plant" else nominal, name)
        return Place(path, _parameter(name if section == "plant" else f"platform.{name}", name, value))

    if is_replaced and section == "controller" and rest[0] not in ("feedforward", "parameters"):
        raise ValueError("has no effect, since controller= replaces the experiment's controller")

    # through the tables down to the value
    column, above, table = ".".join(path), section, getattr(experiment, section)
    while True:
        name, *rest = rest
        if isinstance(table, list):
            if not (name.isdigit() and 1 <= int(name) <= len(table)) or not rest:
                raise ValueError(
                    f"expected {above}.1 to {above}.{len(table)} and a key of it" if table else f"no [[{above}]]"
                )
            above, table = f"{above}.{name}", table[int(name) - 1]
            continue
        if not isinstance(table, TableSection):
            raise ValueError(f"the experiment has no [{above}]")  # noqa: TRY004 - the key is wrong, not a type
        field = type(table).model_fields.get(name)
        if field is None:
            raise ValueError(f"no such key of [{above}]{nearest(name, type(table).model_fields)}")
        value = getattr(table, name)
        may_be = [isinstance(kind, type) and issubclass(kind, TableSection) for kind in get_args(field.annotation)]
        if isinstance(value, Mapping):
            # of parameters of a platform or a controller, of factors on them, or of signals
            is_own = isinstance(table, ControllerChoice)
            if is_own and name != "parameters":
                raise ValueError("is common to all members")
            if len(rest) != 1:
                raise ValueError(f"expected one name after {name}")
            kind, name, value = name, rest[0], value.get(rest[0])
            if is_own:  # only the controller knows them: a text or a switch has no distribution but a choice
                try:
                    numbers = None if value is None or isinstance(value, bool | str) else np.asarray(value, dtype=float)
                except (TypeError, ValueError):
                    numbers = None
                unit = PLAIN if value is None or numbers is not None else None
                return Place(path, VariedValue(column, unit, () if numbers is None else numbers.shape, numbers))
            if kind in ("parameters", "factors") and name not in TABLE:
                raise ValueError(f"no such parameter{nearest(name, TABLE)}")
            if kind == "parameters":
                return Place(path, _parameter(column, name, value))
            if kind != "factors" and name not in _SIGNALS:
                raise ValueError(f"no signal '{name}'{nearest(name, NAMES)}")
            unit = PLAIN if kind == "factors" else _SIGNALS[name].unit
            return Place(path, VariedValue(column, unit, (), None if value is None else np.asarray(value, dtype=float)))
        if not rest:
            quantity = annotation_in(Unit, field.annotation, *field.metadata)
            if quantity is None:
                return Place(path, VariedValue(column, None, (), None))
            size = getattr(quantity, "size", None)
            shape = () if size is None else (size,)
            numbers = None if value is None or isinstance(value, str) else np.asarray(value, dtype=float)
            return Place(path, VariedValue(column, quantity.unit, shape, numbers))
        if not (isinstance(value, TableSection) or (value is None and any(may_be))):
            raise ValueError(f"{above}.{name} is not a table")
        above, table = f"{above}.{name}", value


def _parameter(column: str, name: str, value: Any) -> VariedValue:
    row = TABLE[name]
    nominal = None if value is None else np.asarray(value, dtype=float)  # limits of legs that differ are six
    shape = row.shape if nominal is None else nominal.shape
    return VariedValue(column, PLAIN if row.unit == "1" else row.unit, shape, nominal, name == "platform_inertia")


def unit_of(key: str) -> str:
    """The SI unit of the values of a key such as `controller.bandwidth`, or `machine.platform_mass`; "" for none.

    There is none either where kinds of motions or controllers give a key of one name different units, and for gains,
    whose unit depends on the space in which they act.
    """
    if _GAINS.fullmatch(key):
        return ""
    names = re.sub(r"\[[\d,]+\]", "", key).split(".")
    sections: list[type[TableSection]] = [Experiment]
    units: set[str] = set()
    for name in names:
        fields = [section.model_fields[name] for section in sections if name in section.model_fields]
        if not fields:
            # a parameter of the platform or a signal; factors on them have no unit
            return "" if "factors" in names else _UNITS.get(names[-1], "")
        quantities = [annotation_in(Unit, field.annotation, *field.metadata) for field in fields]
        units = {"" if quantity is None else quantity.unit for quantity in quantities}
        # of a base, its keys are those of the kinds that `type` selects
        bases = [base for field in fields for base in sections_in(field.annotation)]
        sections = [section for base in bases for section in (base, *kinds(base).values())]
    return next(iter(units)) if len(units) == 1 else ""


def value_text(key: str, value: Any) -> str:
    """A value of a key in SI units as text with its unit; angles in degrees, shares in percent."""
    unit = unit_of(key)
    if not unit or value is None or isinstance(value, bool | str | dict):
        return plain_text(value)
    quantity = of_unit("%" if unit == "1" else unit)

    def scaled(value: Any) -> Any:
        return [scaled(element) for element in value] if isinstance(value, list | tuple) else quantity.factor * value

    return f"{plain_text(scaled(value))} {quantity.unit_text}"
