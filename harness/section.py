"""Tables of an experiment, from a file or from Python, and the messages for invalid ones."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self, cast, get_args

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema
from pydantic_core.core_schema import tagged_union_schema

from gough_stewart.harness.errors import ExperimentError
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.interface import nearest
from gough_stewart.model.process.progress import interrupts_held_back


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
        if isinstance(value, str) and names_file(field.annotation, *field.metadata):
            files[name,] = value
        elements = enumerate(value, 1) if isinstance(value, list) else [(None, value)]
        for k, element in elements:
            if isinstance(element, TableSection):
                place = (name,) if k is None else (name, str(k))
                files |= {(*place, *path): file for path, file in file_names(element).items()}
    return files


def names_file(*annotations: object) -> bool:
    """Whether the annotations of a field say that it names a file."""
    return any(isinstance(part, _NamesFile) or names_file(*get_args(part)) for part in annotations)


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
            if step in table.model_fields and (sections := _sections_in(table.model_fields[str(step)].annotation)):
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


def _sections_in(annotation: Any) -> list[type[TableSection]]:
    if isinstance(annotation, type) and issubclass(annotation, TableSection):
        return [annotation]
    return [section for part in getattr(annotation, "__args__", ()) for section in _sections_in(part)]
