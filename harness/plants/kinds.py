"""The kinds of plants."""

from typing import Literal

PlantKind = Literal["model", "fmu2", "fmu3"]
FMI_VERSIONS: dict[str, str] = {"fmu2": "2.0", "fmu3": "3.0"}
