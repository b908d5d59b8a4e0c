"""What a report shows in three dimensions: a platform in motion, a closed surface over three coordinates."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from gough_stewart.harness.report.fields import array_of, set_arrays
from gough_stewart.harness.report.quantities import NUMBER, Quantity
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True)
class Flag:
    """Something that is on or off over time: `values` has a character "0" or "1" per frame but the last."""

    name: str
    values: str


@dataclass(frozen=True, eq=False)
class Scene:
    """A platform in motion: points of both bodies, and n frames."""

    name: str
    base_points: FloatArray  # (6, 3), world [m]
    platform_points: FloatArray  # (6, 3), platform axes [m]
    lower: float  # drawn lengths of the parts of a leg [m]
    upper: float
    time: FloatArray  # (n,) [s]
    pose: FloatArray  # (n, 7): position [m] and quaternion (x, y, z, w)
    leg_length: FloatArray  # (n, 6) [m]
    home: FloatArray = field(default_factory=lambda: np.array([0.0, 0, 0, 0, 0, 0, 1]))  # (7,)
    orientation: FloatArray | None = None  # (n, 3): roll, pitch, yaw [rad]
    reference: FloatArray | None = None  # (n, 7)
    actuator_force: FloatArray | None = None  # (n, 6) [N]
    external_force: FloatArray | None = None  # (n, 3), world [N]
    nearness: FloatArray | None = None  # (n, 6): to the nearest limit, which is at 1
    nearness_of: tuple[str, ...] = ()
    flags: tuple[Flag, ...] = ()
    rows: int = 0  # of the record; frames may be fewer
    run: int | None = None  # index in `Report.runs`
    decimals: int = 4  # of poses and lengths in m; angles in degrees have two less

    def __post_init__(self) -> None:
        n = len(array_of(self.time, f"the time of the scene {self.name}"))
        shapes: dict[str, tuple[int, ...]] = {
            **{"base_points": (6, 3), "platform_points": (6, 3), "time": (n,), "pose": (n, 7), "leg_length": (n, 6)},
            **{"home": (7,), "orientation": (n, 3), "reference": (n, 7), "actuator_force": (n, 6)},
            **{"external_force": (n, 3), "nearness": (n, 6)},
        }
        set_arrays(self, shapes, f"the scene {self.name}")


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
        n, m = len(self.vertices), len(self.triangles)
        shapes = {"low": (3,), "high": (3,), "vertices": (n, 3), "triangles": (m, 3), "values": (n,)}
        set_arrays(self, shapes, f"the surface {self.title}")
        if m and not (self.triangles.min() >= 0 and self.triangles.max() < n):
            raise ValueError(f"a triangle of the surface '{self.title}' names a corner that is not there")
