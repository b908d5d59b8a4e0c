"""What varies in an experiment: the place that a key of `[ensemble]` names, and tables with other values there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from pydantic import ValidationError

from gough_stewart.harness.control.controllers import ControllerChoice
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.plants.signals import NAMES, VARIABLES
from gough_stewart.harness.quantities import PLAIN, Vector, quantity_in
from gough_stewart.harness.sampling.choice import EnsembleChoice
from gough_stewart.harness.sampling.variation import Target
from gough_stewart.harness.section import Section, complaints
from gough_stewart.model.interface import nearest
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.platform import Platform

_PLATFORMS = ("platform", "plant")
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


@dataclass(frozen=True)
class Place:
    """A place in an experiment: the path through its tables, and the value there."""

    path: tuple[str, ...]
    target: Target


def place_of(key: str, experiment: Experiment, nominal: Platform, machine: Platform) -> Place:
    """The place that a key of `[ensemble]` names.

    Raises
    ------
    ValueError
        No such parameter or key, or one that is common to all members; suggests the nearest name.
    """
    path = _path_of(key)
    section, *rest = path
    if section not in Experiment.model_fields:
        known = [
            *TABLE,
            *EnsembleChoice.model_fields,
            *(name for name in Experiment.model_fields if name != "ensemble"),
        ]
        raise ValueError(f"no such parameter{nearest(section, known)}")
    if not rest or (rest[-1] in _COMMON.get(section, ()) and rest[:-1] != ["parameters"]) or section == "ensemble":
        raise ValueError("is common to all members; expected a parameter of the machine, or a number of another table")
    if section in _PLATFORMS:
        name = rest[-1]
        if len(rest) != 2 or name not in TABLE:
            raise ValueError(f"no such parameter{nearest(name, TABLE)}")
        value = getattr(machine if section == "plant" else nominal, name)
        bare = name if section == "plant" else f"platform.{name}"
        return Place(path, _of_parameter(bare, name, value))
    return Place(path, _target_of(".".join(path), getattr(experiment, section), rest, section))


class VariedTable:
    """A table of an experiment, or a list of tables, with other values at some of its places."""

    def __init__(self, experiment: Experiment, name: str) -> None:
        self._where, self._name, self._table = experiment.where, name, getattr(experiment, name)
        self._plain = [
            each.model_dump(exclude_unset=True)
            for each in (self._table if isinstance(self._table, list) else [self._table])
            if isinstance(each, Section)
        ]

    def having(self, values: Mapping[tuple[str, ...], Any]) -> Any:
        """With these values by their paths in the table.

        Raises
        ------
        ExperimentError
            Invalid values; those of a platform are checked with the platform.
        """
        if not values:
            return self._table
        if self._name in _PLATFORMS:
            parameters = {**self._table.parameters, **{path[-1]: value for path, value in values.items()}}
            return self._table.model_copy(update={"parameters": parameters})
        if not isinstance(self._table, list):
            return self._validated(self._name, self._table, self._plain[0], values)
        elements = list(self._table)
        for k in {int(path[0]) - 1 for path in values}:
            inner = {path[1:]: value for path, value in values.items() if int(path[0]) - 1 == k}
            elements[k] = self._validated(f"{self._name}.{k + 1}", elements[k], self._plain[k], inner)
        return elements

    def _validated(
        self, name: str, table: Section, plain: Mapping[str, Any], values: Mapping[tuple[str, ...], Any]
    ) -> Section:
        new = dict(plain)
        for (key, *rest), value in values.items():
            new[key] = {**(new.get(key) or {}), rest[0]: value} if rest else value
        kind = type(table)
        try:
            return kind.built().model_validate(new)
        except ValidationError as error:
            raise ExperimentError(self._where, name, complaints(error, kind, new)) from None


def experiment_with(experiment: Experiment, values: Mapping[tuple[str, ...], Any]) -> Experiment:
    """An experiment with other values by their paths.

    Raises
    ------
    ExperimentError
        Invalid values.
    """
    names = dict.fromkeys(path[0] for path in values)
    update = {
        name: VariedTable(experiment, name).having({path[1:]: v for path, v in values.items() if path[0] == name})
        for name in names
    }
    return experiment.model_copy(update=update)


def _path_of(key: str) -> tuple[str, ...]:
    """The path, including tables that the key may omit."""
    parts = tuple(key.split("."))
    if len(parts) == 1 and key in TABLE:
        return ("plant", "parameters", key)
    if len(parts) == 2 and parts[0] in _PLATFORMS and parts[1] in TABLE:
        return (parts[0], "parameters", parts[1])
    return parts


def _of_parameter(name: str, parameter: str, value: Any) -> Target:
    row = TABLE[parameter]
    nominal = None if value is None else np.asarray(value, dtype=float)
    unit = PLAIN if row.unit == "1" else row.unit
    return Target(name, unit, row.shape, nominal, parameter == "platform_inertia")


def _target_of(key: str, table: Any, path: Sequence[str], above: str) -> Target:
    """The value at the end of a path through tables."""
    name, *rest = path
    if isinstance(table, list):
        if not (name.isdigit() and 1 <= int(name) <= len(table)) or not rest:
            raise ValueError(
                f"expected {above}.1 to {above}.{len(table)} and a key of it" if table else f"no [[{above}]]"
            )
        return _target_of(key, table[int(name) - 1], rest, f"{above}.{name}")
    if not isinstance(table, Section):
        raise ValueError(f"the experiment has no [{above}]")  # noqa: TRY004 - the key is wrong, not a type
    field = type(table).model_fields.get(name)
    if field is None:
        raise ValueError(f"no such key of [{above}]{nearest(name, type(table).model_fields)}")
    value = getattr(table, name)
    if isinstance(value, Mapping) and isinstance(table, ControllerChoice):
        return _of_controller(key, name, value, rest)
    if isinstance(value, Mapping):
        return _of_mapping(key, name, value, rest)
    may_be = [isinstance(kind, type) and issubclass(kind, Section) for kind in get_args(field.annotation)]
    if rest and (isinstance(value, Section) or (value is None and any(may_be))):
        return _target_of(key, value, rest, f"{above}.{name}")
    if rest:
        raise ValueError(f"{above}.{name} is not a table")
    quantity = quantity_in(field.annotation, *field.metadata)
    if quantity is None:
        return Target(key, None, (), None)
    shape = (quantity.size,) if isinstance(quantity, Vector) else ()
    nominal = None if value is None or isinstance(value, str) else np.asarray(value, dtype=float)
    return Target(key, quantity.unit, shape, nominal)


def _of_controller(key: str, name: str, table: Mapping[str, Any], rest: Sequence[str]) -> Target:
    """A parameter of a controller in Python or of an FMU, which alone knows its name: a plain number, or a list."""
    if name != "parameters" or len(rest) != 1:
        raise ValueError("is common to all members" if name != "parameters" else f"expected one name after {name}")
    value = table.get(rest[0])
    try:
        nominal = None if value is None or isinstance(value, bool | str) else np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        nominal = None
    # a text or a switch has no distribution but a choice
    return Target(
        key,
        PLAIN if value is None or nominal is not None else None,
        np.shape(nominal) if nominal is not None else (),
        nominal,
    )


def _of_mapping(key: str, name: str, table: Mapping[str, Any], rest: Sequence[str]) -> Target:
    """A place in tables by signal, and in parameters."""
    if len(rest) != 1:
        raise ValueError(f"expected one name after {name}")
    (inner,) = rest
    value = table.get(inner)
    if name in ("parameters", "factors") and inner not in TABLE:
        raise ValueError(f"no such parameter{nearest(inner, TABLE)}")
    if name == "factors":
        return Target(key, PLAIN, (), None if value is None else np.asarray(value, dtype=float))
    if name == "parameters":
        return _of_parameter(key, inner, value)
    if inner not in _SIGNALS:
        raise ValueError(f"no signal '{inner}'{nearest(inner, NAMES)}")
    return Target(key, _SIGNALS[inner].unit, (), None if value is None else np.asarray(value, dtype=float))
