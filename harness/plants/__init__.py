"""The plant behind one protocol: the stepping model, or an FMU; the kinds, which a command names without NumPy."""

from typing import Literal

# the compiled engine, SciPy as its judge, and the units of both FMI versions
PlantKind = Literal["model", "scipy", "fmu2", "fmu3"]
FMI_VERSIONS: dict[str, str] = {"fmu2": "2.0", "fmu3": "3.0"}
