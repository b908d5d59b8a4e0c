"""What a report shows in three dimensions: a platform in motion, a closed surface over three coordinates."""

from dataclasses import field
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from gough_stewart.harness.report.data import CONFIG, Data, Numbers, Vector, check_shapes
from gough_stewart.harness.report.quantities import NUMBER, Quantity
from gough_stewart.model.vectors import FloatArray

_Rows = Annotated[FloatArray, Numbers(2)]
_THREE = Field(min_length=3, max_length=3)
# Arrays of a scene with a row for each frame, and their columns.
COLUMNS = {"pose": 7, "reference": 7, "orientation": 3, "leg_length": 6}
COLUMNS |= {"actuator_force": 6, "external_force": 3, "nearness": 6}


@dataclass(frozen=True, config=CONFIG)
class Flag(Data):
    """Something that is on or off over time: `values` has a character "0" or "1" per frame but the last."""

    name: str
    values: str


@dataclass(frozen=True, eq=False, config=CONFIG)
class Scene(Data):
    """A platform in motion: points of both bodies, and n frames."""

    name: str
    base_points: _Rows  # (6, 3), world [m]
    platform_points: _Rows  # (6, 3), platform axes [m]
    lower: float  # drawn lengths of the parts of a leg [m]
    upper: float
    time: Vector  # (n,) [s]
    pose: _Rows  # (n, 7): position [m] and quaternion (x, y, z, w)
    leg_length: _Rows  # (n, 6) [m]
    home: Vector = field(default_factory=lambda: np.array([0.0, 0, 0, 0, 0, 0, 1]))  # (7,)
    orientation: _Rows | None = None  # (n, 3): roll, pitch, yaw [rad]
    reference: _Rows | None = None  # (n, 7)
    actuator_force: _Rows | None = None  # (n, 6) [N]
    external_force: _Rows | None = None  # (n, 3), world [N]
    nearness: _Rows | None = None  # (n, 6): to the nearest limit, which is at 1
    nearness_of: tuple[str, ...] = ()
    flags: tuple[Flag, ...] = ()
    rows: int = 0  # of the record; frames may be fewer
    run: int | None = None  # index in `Report.runs`
    decimals: int = 4  # of poses and lengths in m; angles in degrees have two less

    def __post_init__(self) -> None:
        shapes = {name: (len(self.time), width) for name, width in COLUMNS.items()}
        fixed = {"base_points": (6, 3), "platform_points": (6, 3), "home": (7,)}
        check_shapes(self, f"the scene {self.name}", {**fixed, **shapes})


@dataclass(frozen=True, eq=False, config=CONFIG)
class Surface(Data):
    """Triangles in the box of three coordinates, with a value at every corner that sets its colour."""

    title: str
    names: Annotated[tuple[str, ...], _THREE]  # of the three coordinates
    quantities: Annotated[tuple[Quantity, ...], _THREE]
    low: Vector  # (3,): the box
    high: Vector  # (3,)
    vertices: _Rows  # (n, 3), SI units
    triangles: _Rows  # (m, 3): indices of vertices, counter-clockwise seen from outside
    values: Vector  # (n,)
    name: str = ""  # of the values
    quantity: Quantity = NUMBER
    scale: Literal["linear", "log"] = "linear"  # of the colours
    detail: bool = False

    def __post_init__(self) -> None:
        n, m = len(self.vertices), len(self.triangles)
        shapes = {"low": (3,), "high": (3,), "vertices": (n, 3), "triangles": (m, 3), "values": (n,)}
        check_shapes(self, f"the surface {self.title}", shapes)
        if m and not (self.triangles.min() >= 0 and self.triangles.max() < n):
            raise ValueError(f"a triangle of the surface '{self.title}' names a corner that is not there")
