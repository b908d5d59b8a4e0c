"""A path through poses as `[reference]` of an experiment, as fast as the platform can or in a given time."""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, model_validator

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.harness.motion.path import DEGREES, GeometricPath
from gough_stewart.harness.motion.polynomials import Polynomials, polynomials_of
from gough_stewart.harness.motion.recording import read_poses
from gough_stewart.harness.motion.references import ReferenceChoice
from gough_stewart.harness.motion.shares import shares_along
from gough_stewart.harness.motion.time_law import Quintic, Stretched, TimeLaw
from gough_stewart.harness.motion.timed_path import TimedPath
from gough_stewart.harness.quantities import Share, Time, positive_or_word, vector
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation, orientation_from_matrix
from gough_stewart.model.vectors import FloatArray


def _poses(value: Any) -> list[tuple[float, ...]]:
    """Rows of x, y, z, roll, pitch, yaw."""
    rows = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(rows, list | tuple):
        raise ValueError("expected a list of poses, each x, y, z, roll, pitch, yaw")  # noqa: TRY004 - pydantic's
    found = []
    for k, row in enumerate(rows):
        listed = row.tolist() if isinstance(row, np.ndarray) else row
        if not isinstance(listed, list | tuple) or len(listed) != 6:
            raise ValueError(f"pose {k + 1} is {row!r}; expected x, y, z, roll, pitch, yaw")
        try:
            found.append((*vector(listed[:3], "m", 3), *vector(listed[3:], "rad", 3)))
        except ValueError as error:
            raise ValueError(f"pose {k + 1}: {error}") from None
    return found


def _timing(value: Any) -> float | str:
    return positive_or_word(value, "s", "fastest")


class ViaPath(ReferenceChoice):
    """Go along a smooth path through poses, from rest to rest.

    `poses` are rows of x, y, z [m], roll, pitch, yaw [rad], or those of a `file`, as a motion log without times;
    `relative_to` "world" as they are, or "home" as displacements in the world's axes and rotations before that of home.
    `interpolation` "quintic" or "cubic" joins positions and rotation vectors by natural splines.
    `timing` is a duration [s], gone by a quintic, or "fastest": the least time that the platform's limits of leg
    velocity, leg acceleration, force and power admit, of which a `margin` is left; with `ramp` [s] its acceleration is
    averaged over that time, so that no force jumps. The motion begins `at` [s].

    Examples
    --------
    >>> there_and_back = [[0, 0, 0, 0, 0, 0], [0.1, 0, 0.2, 0, 0.1, 0], [0, 0, 0, 0, 0, 0]]
    >>> path = gs.ViaPath(poses=there_and_back, relative_to="home", timing="fastest", margin=0.1)
    >>> path.about(gs.load_preset("motion_base")).end
    """

    type: Literal["path"] = "path"
    poses: Annotated[Any, BeforeValidator(_poses)] = ()
    file: str | None = None
    relative_to: Literal["world", "home"] = "world"
    interpolation: Literal["quintic", "cubic"] = "quintic"
    timing: Annotated[float | str, BeforeValidator(_timing)]
    margin: Share = 0.0
    ramp: Time = 0.0
    at: Time = 0.0

    @model_validator(mode="after")
    def _poses_or_file(self) -> "ViaPath":
        if bool(self.poses) == (self.file is not None):
            raise ValueError("expected poses, or a file of them")
        if self.timing != "fastest" and (self.margin or self.ramp):
            raise ValueError("margin and ramp go with timing = 'fastest'")
        return self

    def about(self, platform: Platform, folder: Path = Path()) -> Polynomials:
        """The motion for a platform, whose limits say how fast it is.

        Raises
        ------
        MotionError
            Poses that make no path or are out of reach, or limits that admit no motion.
        """
        poses = np.reshape(self.poses, (-1, 6))
        position, orientation = (poses[:, :3], poses[:, 3:]) if self.file is None else read_poses(folder / self.file)
        if self.relative_to == "home":
            position = position + platform.home_position
            turned = matrix_from_orientation(orientation) @ matrix_from_orientation(platform.home_orientation)
            orientation = orientation_from_matrix(turned)
        path = GeometricPath(position, orientation, platform.characteristic_length, DEGREES[self.interpolation])
        _check_poses(platform, position, orientation)
        law = Stretched(self._law(platform, path), self.time_scale)
        return polynomials_of(TimedPath(path, law, self.at * self.time_scale, self.amplitude_scale))

    def _law(self, platform: Platform, path: GeometricPath) -> TimeLaw:
        if not isinstance(self.timing, str):
            return Quintic(self.timing)
        from gough_stewart.harness.motion.fastest import fastest

        return fastest(platform, path, self.margin, self.ramp)


def _check_poses(platform: Platform, position: FloatArray, orientation: FloatArray) -> None:
    """Refuse poses (n, 3) that the platform cannot have, before anything is planned through them."""
    rest = np.zeros_like(position)
    at_rest = Motion(position, orientation, rest, rest, rest, rest)
    shares = shares_along(platform, np.zeros(len(position)), at_rest)
    beyond = [each.first_beyond for each in shares.limited if not each.within.all()]
    if beyond:
        first = min(beyond, key=lambda each: each.row)
        raise MotionError(f"pose {first.row + 1} of the path cannot be reached: {first.text}")
