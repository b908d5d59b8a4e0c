"""`[reference]` of an experiment file: the motions that it may name."""

from typing import Annotated, Literal

from pydantic import Field

from gough_stewart.harness.quantities import Angle, Frequency, Orientation, Position, PositiveLength, PositiveTime, Time
from gough_stewart.harness.section import Section

_REST = (0.0, 0.0, 0.0)


class _Pose(Section):
    """Where a motion happens; the home pose by default."""

    position: Position | None = None
    orientation: Orientation | None = None


class HoldReference(_Pose):
    """Stay."""

    type: Literal["hold"]


class StepReference(_Pose):
    """Jump."""

    type: Literal["step"]
    position_change: Position = _REST
    orientation_change: Orientation = _REST
    # at 0 there would be nothing to step from
    at: PositiveTime


class PointToPointReference(StepReference):
    """Go from rest to rest by a quintic polynomial."""

    type: Literal["point_to_point"]  # type: ignore[assignment]
    at: Time = 0.0
    duration: PositiveTime


class SineReference(_Pose):
    """Swing."""

    type: Literal["sine"]
    position_amplitude: Position = _REST
    orientation_amplitude: Orientation = _REST
    frequency: Frequency
    phase: Angle = 0.0
    fade_in: Time = 0.0


class CircleReference(_Pose):
    """Circle."""

    type: Literal["circle"]
    radius: PositiveLength
    frequency: Frequency
    plane: Literal["xy", "xz", "yz"] = "xy"
    fade_in: Time = 0.0


class ChirpReference(_Pose):
    """Swing ever faster, or slower."""

    type: Literal["chirp"]
    position_amplitude: Position = _REST
    orientation_amplitude: Orientation = _REST
    from_frequency: Frequency
    to_frequency: Frequency
    duration: PositiveTime
    fade_in: Time = 0.0


class FileReference(Section):
    """Go through the rows of a CSV file."""

    type: Literal["file"]
    file: str


ReferenceChoice = Annotated[
    HoldReference
    | StepReference
    | PointToPointReference
    | SineReference
    | CircleReference
    | ChirpReference
    | FileReference,
    Field(discriminator="type"),
]
