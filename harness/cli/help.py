"""Help in which a flag is only a flag, and a value is named without types of Python."""

from typing import Any

from typer.core import TyperArgument, TyperCommand, TyperGroup


class PlainCommand(TyperCommand):
    """A command whose options and arguments read well in its help."""

    def get_params(self, ctx: Any) -> list[Any]:
        """As Typer has them, made plain."""
        return _made_plain(super().get_params(ctx))


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
