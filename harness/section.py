"""Tables of an experiment, from a file or from Python; the quantities in them, and the messages for invalid ones.

Quantities are numbers in SI units or with a unit, and vectors of them. Results are written with them as JSON.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, cast, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, BeforeValidator, ConfigDict, GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema
from pydantic_core.core_schema import no_info_plain_validator_function, tagged_union_schema

from gough_stewart.harness.errors import ExperimentError
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.interface import nearest
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.units import PLAIN, number

ZEROS = (0.0, 0.0, 0.0)
_Annotation = TypeVar("_Annotation")


def positive_or_word(value: object, unit: str, *words: str) -> float | str:
    """A quantity > 0 in SI units, or one of some keywords."""
    if value in words:
        return str(value)
    or_words = "".join(f", or '{word}'" for word in words)
    try:
        size = number(value, unit)
    except ValueError as error:
        raise ValueError(f"{error}{or_words.replace(',', ';', 1)}") from None
    if not size > 0:
        raise ValueError(f"expected > 0 {unit}{or_words}")
    return size


@dataclass(frozen=True)
class Unit:
    """Annotates the unit of a field that has its own parser."""

    unit: str


@dataclass(frozen=True)
class InUnit(Unit):
    """Annotates a field that accepts strings with a unit; it stores a number in SI units, or a tuple of them."""

    bound: Literal["> 0", ">= 0"] | None = None  # of a single number
    size: int | None = None  # of a vector, of which a list or an array is accepted
    one_for_all: bool = False  # whether one quantity stands for all of a vector

    def __get_pydantic_core_schema__(self, _source: object, _handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_plain_validator_function(self.parsed)

    def parsed(self, value: object) -> Any:
        """The number within its bound, or the numbers, of which a ValueError has the index."""
        unit, size = self.unit, self.size
        if size is None:
            single = number(value, unit)
            if (self.bound == "> 0" and not single > 0) or (self.bound == ">= 0" and not single >= 0):
                raise ValueError(f"expected {self.bound}{'' if unit == PLAIN else f' {unit}'}")
            return single
        values = value.tolist() if isinstance(value, np.ndarray) else value
        if self.one_for_all and not isinstance(values, list | tuple):
            return (number(values, unit),) * size
        if not isinstance(values, list | tuple) or len(values) != size:
            expected = f"a number [{unit}] or a list of {size}" if self.one_for_all else f"a list of {size} [{unit}]"
            number_of_values = f"{len(values)} values" if isinstance(values, list | tuple) else "one value"
            raise ValueError(f"expected {expected}; found {number_of_values}")
        numbers = []
        for k, element in enumerate(values):
            try:
                numbers.append(number(element, unit))
            except ValueError as error:
                raise ValueError(f"value {k + 1} of {size}: {error}") from None
        return tuple(numbers)


def annotation_in(kind: type[_Annotation], *annotations: object) -> _Annotation | None:
    """The first of this kind, or None, among the annotations of a field and in them."""
    for annotation in annotations:
        if isinstance(annotation, kind):
            return annotation
        if (inner := annotation_in(kind, *get_args(annotation))) is not None:
            return inner
    return None


def _share(value: object) -> float:
    """A share from 0 to below 1: 0.1, or "10 %"."""
    try:
        size = number(value, "1")
    except ValueError:
        raise ValueError("expected a number from 0 to below 1, or a string such as '10 %'") from None
    if not 0 <= size < 1:
        raise ValueError("expected a number from 0 to below 1, or from '0 %' to below '100 %'")
    return size


Share = Annotated[float, Unit("1"), BeforeValidator(_share)]
Number = Annotated[float, InUnit(PLAIN)]
PositiveNumber = Annotated[float, InUnit(PLAIN, "> 0")]
AnyTime = Annotated[float, InUnit("s")]
Time = Annotated[float, InUnit("s", ">= 0")]
PositiveTime = Annotated[float, InUnit("s", "> 0")]
PositiveLength = Annotated[float, InUnit("m", "> 0")]
Angle = Annotated[float, InUnit("rad")]
Frequency = Annotated[float, InUnit("Hz", "> 0")]
Band = Annotated[ArrayLike, InUnit("Hz", size=2)]
PositiveForce = Annotated[float, InUnit("N", "> 0")]
PositiveForceRate = Annotated[float, InUnit("N/s", "> 0")]
Position = Annotated[ArrayLike, InUnit("m", size=3)]
Orientation = Annotated[ArrayLike, InUnit("rad", size=3)]
Velocity = Annotated[ArrayLike, InUnit("m/s", size=3)]
AngularVelocity = Annotated[ArrayLike, InUnit("rad/s", size=3)]
Force = Annotated[ArrayLike, InUnit("N", size=3)]
Torque = Annotated[ArrayLike, InUnit("N.m", size=3)]
LegForces = Annotated[ArrayLike, InUnit("N", size=6)]
# In task space the last three channels are torques per angle: N.m/rad and so on, plain numbers.
ProportionalGains = Annotated[ArrayLike, InUnit("N/m", size=6, one_for_all=True)]
DerivativeGains = Annotated[ArrayLike, InUnit("N.s/m", size=6, one_for_all=True)]
IntegralGains = Annotated[ArrayLike, InUnit("N/(m.s)", size=6, one_for_all=True)]


def plain(value: Any) -> Any:
    """A value in types of JSON; None for what is no finite number."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def readable_json(value: Any) -> bytes:
    """Plain values as a file of JSON that people read."""
    return (json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


@dataclass(frozen=True)
class _NamesFile:
    """Annotates a key that names a file."""


# The name of a file; relative names are relative to the experiment's folder.
FileName = Annotated[str, _NamesFile()]


class TableSection(BaseModel):
    """A table: unknown keys are errors, and instances are immutable.

    Raises
    ------
    ExperimentError
        Wrong values in Python; references and controllers have errors of their own.
    """

    # pydantic builds the validator of a table at first use: most are only used as parts of an experiment
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, defer_build=True)
    error: ClassVar[type[GoughStewartError] | None] = None  # its own

    def __init__(self, /, **values: Any) -> None:
        self.built()
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise self.refusal(complaints(error, type(self), values)) from None

    # For Python callers only: pydantic would call it for nested tables too, and lose their keys.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def built(cls) -> type[Self]:
        """The class with its validator, built once without interrupts, which pydantic would make errors of its own."""
        if not cls.__pydantic_complete__:
            with interrupts_held_back():
                cls.model_rebuild()
        return cls

    @classmethod
    def refusal(cls, message: str) -> GoughStewartError:
        """The error for wrong values."""
        return ExperimentError("", "", message) if cls.error is None else cls.error(message)


class Kind(TableSection):
    """A table whose key `type` selects a subclass of a base; that key is always written."""

    type: str

    def model_post_init(self, _context: Any, /) -> None:
        """Mark the type as set, also where Python code has left it to the class."""
        self.model_fields_set.add("type")


def file_names(table: TableSection) -> dict[tuple[str, ...], str]:
    """The files that a table and the tables in it name, by the path of the key; elements of lists count from 1."""
    files = dict[tuple[str, ...], str]()
    for name, field in type(table).model_fields.items():
        value = getattr(table, name)
        names_a_file = annotation_in(_NamesFile, field.annotation, *field.metadata) is not None
        if isinstance(value, str) and names_a_file:
            files[name,] = value
        elements = enumerate(value, 1) if isinstance(value, list) else [(None, value)]
        for k, element in elements:
            if isinstance(element, TableSection):
                place = (name,) if k is None else (name, str(k))
                files |= {(*place, *path): file for path, file in file_names(element).items()}
    return files


class ByType:
    """Annotates the base class where one of its kinds is expected."""

    def __get_pydantic_core_schema__(self, base: type[Kind], handler: GetCoreSchemaHandler) -> CoreSchema:
        """The union of all subclasses that have a `type`."""
        schemas = {name: handler.generate_schema(kind) for name, kind in kinds(base).items()}
        return tagged_union_schema(schemas, discriminator="type")


def kinds(base: type[TableSection]) -> dict[str, type[TableSection]]:
    """The subclasses of a base by their `type`; defining a subclass registers it."""
    by_type = dict[str, type[TableSection]]()
    for kind in base.__subclasses__():
        field = kind.model_fields.get("type")
        by_type |= ({} if field is None or field.is_required() else {str(field.default): kind}) | kinds(kind)
    return by_type


_WORDS = {
    "missing": "is missing; add it",
    "union_tag_not_found": "the key type is missing; `gough-stewart experiments heave_step` shows a whole file",
    "union_tag_invalid": "type is {tag!r}; expected one of {expected_tags}",
}


def complaints(error: ValidationError, section: type[TableSection], values: Mapping[str, Any]) -> str:
    """What is wrong with the values of a table, once per key: key, value found, value expected, remedy."""
    lines = []
    for detail in error.errors():
        # the key, and the table that has it; pydantic also counts the type of a controller or reference as a step
        parts, table, inner, kind = list[str](), section, cast("Any", values), None
        for step in detail["loc"]:
            if step == kind:
                kind = None
                continue
            parts.append(str(step + 1) if isinstance(step, int) else step)
            try:
                inner = inner[step]
            except (LookupError, TypeError):
                inner = None
            kind = inner.get("type") if isinstance(inner, Mapping) else None
            if step in table.model_fields and (sections := sections_in(table.model_fields[str(step)].annotation)):
                table = kinds(sections[0]).get(str(kind), sections[0])

        # in the words of this project
        context, found = detail.get("ctx", {}), detail["input"]
        if detail["type"] == "extra_forbidden":
            text = f"unknown key (= {found!r}){nearest(str(detail['loc'][-1]), table.model_fields)}"
        elif detail["type"] in _WORDS:
            text = _WORDS[detail["type"]].format(**context)
        else:
            text = str(context.get("error", "")) or detail["msg"].replace("Input should be", "expected")
            text = text.replace("a valid integer", "a whole number")
            if detail["type"] in ("model_attributes_type", "model_type", "dict_type"):
                text = "expected a table of keys"
            text = text if isinstance(found, Mapping) else f"is {found!r}; {text}"
        lines.append(": ".join(filter(None, (".".join(parts), text))))
    return "; ".join(dict.fromkeys(lines))


def sections_in(annotation: Any) -> list[type[TableSection]]:
    """The classes of tables that an annotation names."""
    if isinstance(annotation, type) and issubclass(annotation, TableSection):
        return [annotation]
    return [section for part in getattr(annotation, "__args__", ()) for section in sections_in(part)]
