"""Colours of a report by role, in three palettes: light, dark, and high contrast.

Series differ by lightness or dashes too, so that they can be told apart without colour. Hues are those of Okabe & Ito
(Color Universal Design, 2008), darkened or lightened until they contrast with their ground by at least 3 : 1.
"""

from typing import Literal, get_args

Role = Literal[
    "reference", "actual", "measured", "error", "limit", "band", "median", "nominal", "published", "command", "neutral",
    "good", "marginal", "bad",
]  # fmt: skip
ROLES: tuple[Role, ...] = get_args(Role)
Theme = Literal["light", "dark", "contrast"]
THEMES: tuple[Theme, ...] = get_args(Theme)

GROUND: dict[Theme, str] = {"light": "#ffffff", "dark": "#14181d", "contrast": "#ffffff"}
INK: dict[Theme, str] = {"light": "#1b1f24", "dark": "#e6e9ed", "contrast": "#000000"}

_BLUE, _VERMILION, _GREEN, _PURPLE, _GREY = (
    ("#0072b2", "#56b4e9", "#00427a"),
    ("#c04f00", "#ff8a4c", "#8a2f00"),
    ("#00805c", "#2fc49a", "#00563d"),
    ("#b3528a", "#e29cc6", "#7a1f56"),
    ("#6b7280", "#9aa4b2", "#3c4148"),
)
_AMBER = ("#96690a", "#f0b429", "#5e3f00")
_COLOURS: dict[Role, tuple[str, str, str]] = {
    "reference": ("#1b1f24", "#e6e9ed", "#000000"),
    "actual": _BLUE,
    "measured": _GREEN,
    "error": _BLUE,
    "limit": _VERMILION,
    "band": _BLUE,
    "median": _BLUE,
    "nominal": _AMBER,
    "published": _PURPLE,
    "command": _PURPLE,
    "neutral": _GREY,
    "good": _GREEN,
    "marginal": _AMBER,
    "bad": _VERMILION,
}
# Roles whose series differ by leg or component; all others have the colour of their role.
PLAIN_ROLES: tuple[Role, ...] = ("actual", "measured", "error", "neutral")
# Dashes in widths of the line; none for a full line.
DASHES: dict[Role, tuple[float, ...]] = {
    "reference": (4, 3),
    "limit": (1, 1.5),
    "nominal": (6, 2),
    "published": (5, 1.5, 1, 1.5),
    "command": (2.5, 1),
}
# Of a mark whose role has none, so that it is told from series and limits of its colour.
MARK_DASHES = (3, 1, 1, 1)
# Six legs, or six runs: colours and dashes that tell them apart.
_SIX: dict[Theme, tuple[str, ...]] = {
    "light": ("#0072b2", "#c04f00", "#00805c", "#b3528a", "#2b85bd", "#96690a"),
    "dark": ("#56b4e9", "#ff8a4c", "#2fc49a", "#e29cc6", "#a8d8f5", "#f0b429"),
    "contrast": ("#00427a", "#8a2f00", "#00563d", "#7a1f56", "#2f5f8a", "#5e3f00"),
}
SIX_DASHES: tuple[tuple[float, ...], ...] = ((), (5, 1.5), (6, 1.5, 1, 1.5), (1, 1), (8, 1.5, 1, 1.5, 1, 1.5), (2.5, 1))

# Kinds on a map: the first is the ground, the others are pale enough to stay in the background.
_PALE = ("#dddddd", "#999999", "#f0c566", "#9ad2f2", "#e0aeca", "#66c5ab")
KINDS: dict[Theme, tuple[str, ...]] = {
    "light": ("#ffffff", *_PALE),
    "dark": ("#14181d", "#5b636d", "#8f98a3", "#9a7420", "#3f7fa6", "#8d5f7b", "#2f7a66"),
    "contrast": ("#ffffff", "#767676", "#3c4148", "#96690a", "#2f5f8a", "#7a1f56", "#00563d"),
}


def colour_of(role: Role, theme: Theme = "light") -> str:
    """The colour of a role, as #rrggbb."""
    return _COLOURS[role][THEMES.index(theme)]


def colour_of_six(index: int, theme: Theme = "light") -> str:
    """The colour of a leg or a run, counted from 0; of more than six they come again."""
    return _SIX[theme][index % 6]
