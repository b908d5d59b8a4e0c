"""A closed surface over three coordinates, such as that of a workspace: data of a report."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gough_stewart.harness.report.quantities import NUMBER, Quantity
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles in the box of three coordinates, with a value at every corner that sets its colour."""

    title: str
    names: tuple[str, ...]  # of the three coordinates
    quantities: tuple[Quantity, ...]
    low: FloatArray  # (3,): the box
    high: FloatArray  # (3,)
    vertices: FloatArray  # (n, 3), SI units
    triangles: FloatArray  # (m, 3): indices of vertices, counter-clockwise seen from outside
    values: FloatArray  # (n,)
    name: str = ""  # of the values
    quantity: Quantity = NUMBER
    scale: Literal["linear", "log"] = "linear"  # of the colours
    detail: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "quantities", tuple(self.quantities))
        if len(self.names) != 3 or len(self.quantities) != 3:
            found = f"{len(self.names)} names and {len(self.quantities)} quantities"
            raise ValueError(f"the surface '{self.title}' has {found}; expected 3 of each")
        arrays = {
            name: np.array(getattr(self, name), dtype=float)
            for name in ("low", "high", "vertices", "triangles", "values")
        }
        n, m = len(arrays["vertices"]), len(arrays["triangles"])
        expected = {"low": (3,), "high": (3,), "vertices": (n, 3), "triangles": (m, 3), "values": (n,)}
        for name, array in arrays.items():
            if array.shape != expected[name]:
                raise ValueError(
                    f"'{name}' of the surface '{self.title}' has {array.shape} values; expected {expected[name]}"
                )
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if m and not (self.triangles.min() >= 0 and self.triangles.max() < n):
            raise ValueError(f"a triangle of the surface '{self.title}' names a corner that is not there")
