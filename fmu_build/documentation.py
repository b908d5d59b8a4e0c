"""Pages of documentation, of units and of archives: templates filled in, self-contained and well-formed as XML."""

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from gough_stewart.model.vectors import Array

if TYPE_CHECKING:
    from jinja2 import Environment


def page(template: str, **values: Any) -> bytes:
    """The page of a template in `templates/`.

    Raises
    ------
    jinja2.UndefinedError
        A value that the template names is missing.
    """
    return _environment().get_template(template).render(**values).encode()


@cache
def _environment() -> "Environment":
    # here, since most programs make no page
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("gough_stewart.fmu_build"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"lines": _lines, "number": _number}
    return environment


def _lines(values: Array | None) -> Sequence[str]:
    """Numbers with six digits, a line for every row of a matrix; one number if all digits are equal."""
    if values is None:
        return ()
    if len({_number(value) for value in values.flat}) == 1:
        return (_number(values.flat[0]),)
    return [" ".join(map(_number, row)) for row in (values if values.ndim == 2 else values[None])]


def _number(value: float) -> str:
    return f"{value + 0.0:.6g}".replace("-", "−")
