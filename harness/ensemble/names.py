"""Display names of signals and varied inputs: words, units, scale."""

from gough_stewart.harness.results.metric import Shown
from gough_stewart.model.interface import BY_NAME
from gough_stewart.model.parameters import TABLE

# Signals, with the displayed unit.
_SIGNALS = {"m": ("mm", 1e3), "rad": ("mrad", 1e3)}
_AXES = {"position": "xyz", "orientation": ("roll", "pitch", "yaw")}


def shown_signal(column: str) -> Shown:
    """A signal of bands: `position[3]`, `error.position.norm`."""
    is_error, norm = column.startswith("error."), column.endswith(".norm")
    name, _, rest = column.removeprefix("error.").removesuffix(".norm").partition("[")
    variable = BY_NAME[name]
    unit, factor = _SIGNALS.get(variable.unit, (variable.unit, 1.0)) if is_error else (variable.unit, 1.0)
    words = name.replace("_", " ")
    if rest:
        k = int(rest.removesuffix("]")) - 1
        words = str(_AXES[name][k]) if name in _AXES else f"{words} {k + 1}"
    return Shown(f"error of {words}" + (", norm" if norm else "") if is_error else words, unit, factor)


def shown_input(key: str) -> Shown:
    """A varied input, by key: a parameter of the platform has its unit."""
    name = key.removeprefix("platform.").removeprefix("plant.parameters.").partition("[")[0]
    return Shown(key, TABLE[name].unit if name in TABLE else "", 1.0)
