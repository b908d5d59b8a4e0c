"""The kinds of plants: the compiled engine, SciPy as its judge, and the units of both FMI versions."""

from typing import Literal

PlantKind = Literal["model", "scipy", "fmu2", "fmu3"]
FMI_VERSIONS: dict[str, str] = {"fmu2": "2.0", "fmu3": "3.0"}
