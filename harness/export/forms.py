"""What can be chosen of an export: forms, precision, where the reference comes from."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, get_args

from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.model.interface import nearest

Form = Literal["fmu", "c", "ssp", "clocked", "page"]
FORMS: tuple[Form, ...] = get_args(Form)
Real = Literal["double", "float"]
REALS: tuple[Real, ...] = get_args(Real)
ReferenceFrom = Literal["inside", "inputs"]
# The program that shows how the C is called.
EXAMPLE = "example_main.c"


def chosen_forms(forms: Iterable[str] | str) -> tuple[Form, ...]:
    """Forms without repetition, in the order of `FORMS`.

    Raises
    ------
    ExportError
        An unknown form, or none.
    """
    if not isinstance(forms, Iterable):
        raise ExportError(f"forms is {forms!r}; expected one or more of {', '.join(FORMS)}")
    requested = [forms] if isinstance(forms, str) else list(forms)
    for form in requested:
        if form not in FORMS:
            raise ExportError(f"no form '{form}'{nearest(form, FORMS)}")
    if not requested:
        raise ExportError(f"no form; expected one or more of {', '.join(FORMS)}")
    return tuple(form for form in FORMS if form in requested)


def name_of(experiment: Experiment) -> str:
    """A C identifier from the name of the experiment or its file."""
    place = experiment.where.removeprefix("experiment").strip() or experiment.title
    words = re.findall(r"[a-z0-9]+", Path(place).stem.lower())
    name = "_".join(words)[:24].strip("_")
    return name if name[:1].isalpha() else f"loop_{name}".rstrip("_")
