"""The C sources of a unit: hand-written core, generated kernel and tables, headers of the standard."""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import fmpy

from gough_stewart.fmu_build.codegen import kernel_source
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.tables import model_header, model_source, plant_header, token_source
from gough_stewart.model.platform import Platform

# The FMI layers with what they share, and the component behind them.
_ROOMS = ("unit", "plant")
_LAYERS = {"2.0": "fmi2.c", "3.0": "fmi3.c"}
_STANDARD = {
    "2.0": ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    "3.0": ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}


@dataclass(frozen=True)
class Sources:
    """Texts by file name."""

    units: dict[str, str]  # .c
    headers: dict[str, str]  # .h

    @property
    def unit_names(self) -> tuple[str, ...]:
        """Of the files to be compiled."""
        return tuple(sorted(self.units))


def sources(platform: Platform, fmi_version: str, token: str) -> Sources:
    """Everything that a compiler needs for one FMI version; `platform` gives the start values."""
    units, headers = {}, {}
    for room in _ROOMS:
        for file in files("gough_stewart.fmu_build").joinpath("c", room).iterdir():
            if file.name.endswith(".h"):
                headers[file.name] = file.read_text()
            elif file.name.endswith(".c") and file.name not in set(_LAYERS.values()) - {_LAYERS[fmi_version]}:
                units[file.name] = file.read_text()
    units["kernel.c"] = _kernel_source()
    units["model.c"] = model_source(platform)
    units["token.c"] = token_source(token)
    headers |= {"model.h": model_header(), "plant_table.h": plant_header()}
    headers |= standard_headers(fmi_version)
    return Sources(units, headers)


def standard_headers(fmi_version: str) -> dict[str, str]:
    """The standard's own headers, as FMPy's wheel carries them.

    Raises
    ------
    BuildError
        This FMPy has them elsewhere.
    """
    folder = Path(fmpy.__file__).parent / "c-code"
    try:
        return {name: (folder / name).read_text() for name in _STANDARD[fmi_version]}
    except FileNotFoundError as error:
        raise BuildError(
            f"FMPy {fmpy.__version__} has no {Path(error.filename).name}; install FMPy 0.3.28 or later"
        ) from None


def standard_license(fmi_version: str) -> str:
    """What the headers of the standard say of their copyright."""
    text = standard_headers(fmi_version)[_STANDARD[fmi_version][0]]
    start = text.index("Copyright")
    return text[start : text.index("*/", start)].rstrip(" -\n") + "\n"


_kernel_source = cache(kernel_source)
