"""The C sources of a unit: FMI layers, the component's code and tables, headers of the standard."""

from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from gough_stewart.fmu_build.component import Code, Component
from gough_stewart.fmu_build.errors import RUNNER, BuildError
from gough_stewart.fmu_build.tables import model_header, model_source, start_source

_LAYERS = {"2.0": "fmi2.c", "3.0": "fmi3.c"}
_STATELESS = "stateless.c"
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
        """Names of the files to compile."""
        return tuple(sorted(self.units))


def sources(component: Component, fmi_version: str, token: str) -> Sources:
    """All C files of a unit for one FMI version."""
    tokens = (token, "") if fmi_version == "2.0" else ("", token)
    return _sources(component, (fmi_version,), start_source(component, tokens))


def library_sources(component: Component) -> Sources:
    """All C files of the library of all units of this code, for both FMI versions, without start values and tokens."""
    return _sources(component, _LAYERS, start_source(component, None))


def _sources(component: Component, versions: Iterable[str], start: str) -> Sources:
    layers = c_folder("unit")
    unused = set(_LAYERS.values()) - {_LAYERS[each] for each in versions}
    unused |= {_STATELESS} if component.has_states else set()
    units = {name: text for name, text in layers.units.items() if name not in unused} | dict(component.code.units)
    units |= {"model.c": model_source(component), "start.c": start}
    headers = {**layers.headers, **component.code.headers, "model.h": model_header(component)}
    for each in versions:
        headers |= standard_headers(each)
    return Sources(units, headers)


def c_folder(name: str) -> Code:
    """The C files of a folder below c/."""
    texts = {f.name: f.read_text() for f in files("gough_stewart.fmu_build").joinpath("c", name).iterdir()}
    units = {name: text for name, text in texts.items() if name.endswith(".c")}
    return Code(units, {name: text for name, text in texts.items() if name.endswith(".h")})


def standard_headers(fmi_version: str) -> dict[str, str]:
    """The headers of the standard, from FMPy's wheel.

    Raises
    ------
    BuildError
        FMPy does not have them.
    """
    spec = find_spec(RUNNER)  # importing it would take half a second
    assert spec is not None
    assert spec.origin is not None
    folder = Path(spec.origin).parent / "c-code"
    try:
        return {name: (folder / name).read_text() for name in _STANDARD[fmi_version]}
    except FileNotFoundError as error:
        raise BuildError(
            f"FMPy {version(RUNNER)} has no {Path(error.filename).name}; install FMPy 0.3.28 or later"
        ) from None


def standard_license(fmi_version: str) -> str:
    """The copyright notice in the headers of the standard."""
    text = standard_headers(fmi_version)[_STANDARD[fmi_version][0]]
    start = text.index("Copyright")
    return text[start : text.index("*/", start)].rstrip(" -\n") + "\n"
