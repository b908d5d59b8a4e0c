"""Help without the names of Python types, and plain messages for wrong values."""

from typing import Any

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

# Parts of Typer's messages on wrong values, and their plain replacements.
_PLAIN = {
    "Value error, ": "",
    "Input should be a valid integer, unable to parse string as an integer": "expected a whole number",
    "Input should be a valid number, unable to parse string as a number": "expected a number",
    "Input should be": "expected a number",
}


class PlainCommand(TyperCommand):
    """A command whose help names no Python types."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Parameters as in Typer, without the names of types."""
        return _without_types(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As in Typer, with plain messages for wrong values."""
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            for pedantic, plain in _PLAIN.items():
                error.message = error.message.replace(pedantic, plain)
            raise


class PlainGroup(TyperGroup):
    """The same for the group of all commands."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Parameters as in Typer, without the names of types."""
        return _without_types(super().get_params(ctx))


def _without_types(parameters: list[Any]) -> list[Any]:
    """Remove <bool> from flags and <str> from arguments, whose names are clear."""
    for each in parameters:
        if isinstance(each, TyperArgument):
            each.display_type_rich = _no_type  # type: ignore[method-assign]
        elif getattr(each, "is_flag", False):
            each.metavar = ""
    return parameters


def _no_type(ctx: Any) -> None:
    """Return no text to print beside the name."""
