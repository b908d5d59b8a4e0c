"""A path through poses as `[reference]` of an experiment, as fast as the platform allows or in a chosen time."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, model_validator

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.limits.shares import shares_along
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.harness.motion.paths.path import DEGREES, GeometricPath
from gough_stewart.harness.motion.paths.time_law import (
    Polynomials,
    Quintic,
    Stretched,
    TimedPath,
    TimeLaw,
    polynomials_of,
)
from gough_stewart.harness.motion.recorded.recording import converted, read_poses
from gough_stewart.harness.motion.references import WrittenPoses
from gough_stewart.harness.pose_convention import OURS
from gough_stewart.harness.section import FileName, InUnit, Share, Time, positive_or_word
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation, nearest_angle, orientation_from_matrix


def _poses(value: Any) -> list[tuple[float, ...]]:
    """Rows of x, y, z, roll, pitch, yaw."""
    rows = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(rows, list | tuple):
        raise ValueError("expected a list of poses, each x, y, z, roll, pitch, yaw")  # noqa: TRY004 - pydantic's
    poses = []
    for k, row in enumerate(rows):
        listed = row.tolist() if isinstance(row, np.ndarray) else row
        if not isinstance(listed, list | tuple) or len(listed) != 6:
            raise ValueError(f"pose {k + 1} is {row!r}; expected x, y, z, roll, pitch, yaw")
        try:
            poses.append((*InUnit("m", size=3).parsed(listed[:3]), *InUnit("rad", size=3).parsed(listed[3:])))
        except ValueError as error:
            raise ValueError(f"pose {k + 1}: {error}") from None
    return poses


class ViaPath(WrittenPoses):
    """Move along a smooth path through poses, from rest to rest.

    `poses` are rows of x, y, z [m], roll, pitch, yaw [rad], or come from a `file`, a motion log whose times are
    ignored; `relative_to` "world", or "home" for displacements in the world's axes and rotations applied after home's.
    `interpolation` "quintic" or "cubic": splines of positions and rotation vectors with zero second derivative at
    the ends. `timing` is a duration [s] with a quintic time law, or "fastest": the least time within the platform's
    limits of leg velocity, leg acceleration, force and power, less a `margin`; `ramp` [s] averages the acceleration
    along the path over that time, so that forces are continuous. The motion begins `at` [s]. `rotation_order`,
    `rotation_about`, `frame` and `pivot` say how the poses are written.

    Examples
    --------
    >>> there_and_back = [[0, 0, 0, 0, 0, 0], [0.1, 0, 0.2, 0, 0.1, 0], [0, 0, 0, 0, 0, 0]]
    >>> path = gs.ViaPath(poses=there_and_back, relative_to="home", timing="fastest", margin=0.1)
    >>> path.about(gs.load_preset("motion_base")).end
    """

    type: Literal["path"] = "path"
    poses: Annotated[Any, BeforeValidator(_poses)] = ()
    file: FileName | None = None
    relative_to: Literal["world", "home"] = "world"
    interpolation: Literal["quintic", "cubic"] = "quintic"
    timing: Annotated[float | str, BeforeValidator(lambda value: positive_or_word(value, "s", "fastest"))]
    margin: Share = 0.0
    ramp: Time = 0.0
    at: Time = 0.0

    @model_validator(mode="after")
    def _poses_or_file(self) -> "ViaPath":
        if bool(self.poses) == (self.file is not None):
            raise ValueError("expected poses, or a file of them")
        if self.timing != "fastest" and (self.margin or self.ramp):
            raise ValueError("margin and ramp need timing = 'fastest'")
        return self

    def about(self, platform: Platform, folder: Path = Path()) -> Polynomials:
        """The motion for a platform, whose limits determine its speed.

        Returns
        -------
        Polynomials
            Called with times (n,) [s], it gives the motion there.

        Raises
        ------
        MotionError
            Poses that do not form a path or are out of reach, or limits that no motion meets.
        """
        poses = np.reshape(self.poses, (-1, 6))
        convention, home = self.convention, matrix_from_orientation(platform.home_orientation)
        pivot = np.asarray(convention.pivot)
        if self.relative_to == "home":
            pivot = home @ pivot
            convention = replace(convention, pivot=tuple(pivot.tolist()))
        if self.file is not None:
            position, orientation = read_poses(folder / self.file, convention)
        elif convention == OURS:
            position, orientation = poses[:, :3], poses[:, 3:]
        else:
            position, orientation = converted(poses[:, :3], poses[:, 3:], "orientation", convention)
        if self.relative_to == "home":
            position = position + pivot + platform.home_position
            turned = matrix_from_orientation(orientation) @ home
            orientation = nearest_angle(orientation_from_matrix(turned), platform.home_orientation)
        path = GeometricPath(position, orientation, platform.characteristic_length, DEGREES[self.interpolation])
        # poses that the platform cannot take are refused before planning through them
        rest = np.zeros_like(position)
        shares = shares_along(platform, rest[:, 0], Motion(position, orientation, rest, rest, rest, rest))
        beyond = [limited.first_beyond for limited in shares.limited if not limited.within.all()]
        if beyond:
            first = min(beyond, key=lambda limited: limited.row)
            raise MotionError(f"pose {first.row + 1} of the path cannot be reached: {first.text}")
        if isinstance(self.timing, str):
            from gough_stewart.harness.motion.paths.fastest import fastest

            law: TimeLaw = fastest(platform, path, self.margin, self.ramp)
        else:
            law = Quintic(self.timing)
        law = Stretched(law, self.time_scale)
        return polynomials_of(TimedPath(path, law, self.at * self.time_scale, self.amplitude_scale))
