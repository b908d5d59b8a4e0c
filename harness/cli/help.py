"""Help in which a flag is only a flag, and a value is named without types of Python; wrong values in plain words."""

from typing import Any

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

# What Typer says of a wrong value, and what it is to say.
_PLAIN = {
    "Value error, ": "",
    "Input should be a valid integer, unable to parse string as an integer": "expected a whole number",
    "Input should be a valid number, unable to parse string as a number": "expected a number",
    "Input should be": "expected a number",
}


class PlainCommand(TyperCommand):
    """A command whose options and arguments read well in its help."""

    def get_params(self, ctx: Any) -> list[Any]:
        """As Typer has them, made plain."""
        return _made_plain(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As Typer does; what is wrong with a value is said in plain words."""
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            for pedantic, plain in _PLAIN.items():
                error.message = error.message.replace(pedantic, plain)
            raise


class PlainGroup(TyperGroup):
    """The same of the whole program."""

    def get_params(self, ctx: Any) -> list[Any]:
        """As Typer has them, made plain."""
        return _made_plain(super().get_params(ctx))


def _made_plain(parameters: list[Any]) -> list[Any]:
    """Without <bool> beside flags, and without <str> beside arguments, whose names say what they are."""
    for each in parameters:
        if isinstance(each, TyperArgument):
            each.display_type_rich = _no_type  # type: ignore[method-assign]
        elif getattr(each, "is_flag", False):
            each.metavar = ""
    return parameters


def _no_type(ctx: Any) -> None:
    """Nothing stands beside the name."""
