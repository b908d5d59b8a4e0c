"""The units of the keys of experiment files and of platforms, from their declarations."""

import re
from collections.abc import Iterable, Iterator
from inspect import isclass
from typing import Any, get_args

from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.quantities import quantity_in
from gough_stewart.harness.report.quantities import of_unit
from gough_stewart.harness.report.words import plain_text
from gough_stewart.harness.section import Section
from gough_stewart.model.interface import VARIABLES
from gough_stewart.model.parameters import TABLE

_GAINS = re.compile(r"controller\.\w+_gain")
_NAMED = {each.name: each.unit for each in VARIABLES} | {name: row.unit for name, row in TABLE.items()}


def unit_of(key: str) -> str:
    """The SI unit of the values of a key such as `controller.bandwidth`, or `machine.platform_mass`; "" for none.

    There is none either where kinds of motions or controllers give a key of one name different units, and for gains,
    whose unit depends on the space in which they act.
    """
    if _GAINS.fullmatch(key):
        return ""
    names = re.sub(r"\[[\d,]+\]", "", key).split(".")
    kinds: list[type[Section]] = [Experiment]
    units: set[str] = set()
    for name in names:
        fields = [kind.model_fields[name] for kind in kinds if name in kind.model_fields]
        if not fields:
            # a parameter of the platform or a signal; factors on them have no unit
            return "" if "factors" in names else _NAMED.get(names[-1], "")
        found = [quantity_in(each.annotation, *each.metadata) for each in fields]
        units = {"" if each is None else each.unit for each in found}
        kinds = list(_sections(each.annotation for each in fields))
    return next(iter(units)) if len(units) == 1 else ""


def _sections(annotations: Iterable[Any]) -> Iterator[type[Section]]:
    for each in annotations:
        if isclass(each) and issubclass(each, Section):
            # of a base, its keys are those of the kinds that `type` selects
            yield each
            yield from _sections(each.__subclasses__())
        else:
            yield from _sections(get_args(each))


def value_text(key: str, value: Any) -> str:
    """A value of a key in SI units as text with its unit; angles in degrees, shares in percent."""
    unit = unit_of(key)
    is_number = not isinstance(value, bool | str | dict) and value is not None
    if not unit or not is_number:
        return plain_text(value)
    quantity = of_unit("%" if unit == "1" else unit)
    return f"{plain_text(_scaled(value, quantity.factor))} {quantity.unit_text}"


def _scaled(value: Any, factor: float) -> Any:
    return [_scaled(each, factor) for each in value] if isinstance(value, list | tuple) else factor * value
