"""What can be chosen of an export: forms, precision, where the reference comes from."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, TypeVar, get_args

from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.model.interface import nearest

Form = Literal["fmu", "c", "ssp", "page"]
FORMS: tuple[Form, ...] = get_args(Form)
Real = Literal["double", "float"]
REALS: tuple[Real, ...] = get_args(Real)
ReferenceFrom = Literal["inside", "inputs"]
T = TypeVar("T", bound=str)
# What serves instead of a form that there was.
_REMOVED = {"clocked": "; the unit without a clock serves: form fmu"}
# The program that shows how the C is called.
EXAMPLE = "example_main.c"


def chosen_forms(forms: Iterable[str] | str) -> tuple[Form, ...]:
    """Forms without repetition, in the order of `FORMS`.

    Raises
    ------
    ExportError
        An unknown form, or none.
    """
    found = chosen("form", forms, FORMS)
    if not found:
        raise ExportError(f"no form; expected one or more of {', '.join(FORMS)}")
    return found


def chosen(what: str, names: Iterable[str] | str, known: tuple[T, ...]) -> tuple[T, ...]:
    """Names without repetition, in the order of those that are known.

    Raises
    ------
    ExportError
        An unknown name.
    """
    if not isinstance(names, Iterable):
        raise ExportError(f"{what}s is {names!r}; expected one or more of {', '.join(known)}")
    requested = [names] if isinstance(names, str) else list(names)
    for name in requested:
        if name not in known:
            raise ExportError(f"no {what} '{name}'{nearest(name, known)}{_REMOVED.get(name, '')}")
    return tuple(name for name in known if name in requested)


def name_of(experiment: Experiment) -> str:
    """A C identifier from the name of the experiment or its file."""
    place = experiment.where.removeprefix("experiment").strip() or experiment.title
    words = re.findall(r"[a-z0-9]+", Path(place).stem.lower())
    name = "_".join(words)[:24].strip("_")
    return name if name[:1].isalpha() else f"loop_{name}".rstrip("_")
