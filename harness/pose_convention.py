"""How a file writes poses: the order of rotations, the axes, and the point whose position it has.

p = M p' − R c and R = M R' Mᵀ, with position p' and rotation R' of the file, its axes as the columns of M, and the
pivot c in the axes of the platform. SciPy composes R' and takes it apart.
"""

import re
import warnings
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import angles_of, matrix_from_orientation
from gough_stewart.model.vectors import FloatArray

RotationAbout = Literal["fixed", "moving"]
QUATERNION = "quaternion"
_ORDER = re.compile(r"([XYZ])(?!\1)([XYZ])(?!\2)([XYZ])")
_FRAMES = {"z_up": "x,y,z", "z_down": "x,-y,-z"}
_ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
_MIRRORED = ("-x,y,z", "x,-y,z", "x,y,-z")
# Sine or cosine of the middle angle below which the other two are undefined.
_SINGULAR = 1e-6
# Another convention is named if its errors are this much smaller, and its own above this share of a leg.
_BETTER, _SMALLEST = 5.0, 1e-6
# Rows that are compared, and those from which on constant errors, such as offsets of encoders, are left out.
_ROWS, _FOR_OFFSETS = 200, 12


@dataclass(frozen=True)
class PoseConvention:
    """How poses are written; by default as in this project."""

    # Angles are those about x, y, z, in whatever order; where an axis comes twice, as in "ZXZ", they are in that order.
    rotation_order: str = "XYZ"
    rotation_about: RotationAbout = "fixed"  # or the axes that move with the platform
    frame: str = "z_up"  # or "z_down", or the file's axes in this project's, as "y,x,-z"
    pivot: tuple[float, ...] = (0.0, 0.0, 0.0)  # in the axes of the platform [m]

    def __post_init__(self) -> None:
        if self.rotation_order != QUATERNION and not _ORDER.fullmatch(self.rotation_order):
            raise ValueError(
                f"rotation_order is '{self.rotation_order}'; expected three of X, Y, Z in capitals, such as 'XYZ' or "
                "'ZYX'; rotation_about says whether the axes are fixed or moving"
            )
        if self.rotation_about not in get_args(RotationAbout):
            raise ValueError(f"rotation_about is '{self.rotation_about}'; expected 'fixed' or 'moving'")
        axes = [axis.strip().lstrip("+-") for axis in _FRAMES.get(self.frame, self.frame).split(",")]
        if sorted(axes) != ["x", "y", "z"]:
            raise ValueError(f"frame is '{self.frame}'; expected 'z_up', 'z_down', or the file's axes, as 'y,x,-z'")
        if len(self.pivot) != 3 or not np.isfinite(self.pivot).all():
            raise ValueError(f"pivot is {self.pivot}; expected x, y, z in the axes of the platform [m]")

    @property
    def axes(self) -> FloatArray:
        """M (3, 3): the file's axes, as columns, in those of this project."""
        matrix = np.zeros((3, 3))
        for k, axis in enumerate(_FRAMES.get(self.frame, self.frame).split(",")):
            matrix["xyz".index(axis.strip()[-1]), k] = -1.0 if axis.strip().startswith("-") else 1.0
        return matrix

    @property
    def is_left_handed(self) -> bool:
        """Whether the file's frame is mirrored."""
        return bool(np.linalg.det(self.axes) < 0)

    def read(self, position: FloatArray, turning: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (n, 3) of Op [m] and rotation matrices (n, 3, 3) from positions and angles or quaternions."""
        from scipy.spatial.transform import Rotation  # rarely needed

        if self.rotation_order == QUATERNION:
            rotation = Rotation.from_quat(turning)
        else:
            sequence, columns = self._sequence
            rotation = Rotation.from_euler(sequence, turning[:, columns])
        return self.read_matrices(position, rotation.as_matrix())

    def read_matrices(self, position: FloatArray, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (n, 3) of Op [m] and rotation matrices (n, 3, 3) from those of the file."""
        M = self.axes
        R = M @ rotation @ M.T
        return position @ M.T - R @ np.asarray(self.pivot), R

    def written(self, position: FloatArray, orientation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (n, 3) [m], and angles (n, 3) [rad] or quaternions (n, 4), of Op's poses; NaN remains.

        Angles that are undefined in this order are a `ValueError` with the row.
        """
        from scipy.spatial.transform import Rotation  # rarely needed

        M, known = self.axes, np.flatnonzero(np.isfinite(orientation).all(axis=1))
        R = matrix_from_orientation(orientation)
        place = (position + R @ np.asarray(self.pivot)) @ M
        if replace(self, pivot=(0.0, 0.0, 0.0)) in (OURS, PoseConvention("ZYX", "moving")):
            return place, orientation  # angles about fixed X, Y, Z as they are
        turning = np.full((len(orientation), 4 if self.rotation_order == QUATERNION else 3), np.nan)
        if not known.size:
            return place, turning
        rotation = Rotation.from_matrix(M.T @ R[known] @ M)
        if self.rotation_order == QUATERNION:
            quaternions = rotation.as_quat()
            # q and −q are the same rotation: the sign of the row before
            jumps = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
            signs = np.cumprod(np.concatenate([[-1.0 if quaternions[0, 3] < 0 else 1.0], np.where(jumps, -1.0, 1.0)]))
            turning[known] = signs[:, None] * quaternions
            return place, turning
        sequence, columns = self._sequence
        with warnings.catch_warnings(action="ignore"):  # undefined angles are refused below
            angles = rotation.as_euler(sequence)
        size = np.abs(np.cos(angles[:, 1]) if len(set(self.rotation_order)) == 3 else np.sin(angles[:, 1]))
        undefined = known[size < _SINGULAR]
        if undefined.size:
            raise ValueError(
                f"the angles of row {undefined[0] + 1} are undefined in the order {self.rotation_order}; choose "
                f"another order, or '{QUATERNION}'"
            )
        turning[known[:, None], columns] = np.unwrap(angles, axis=0)
        return place, turning

    @property
    def _sequence(self) -> tuple[Any, list[int]]:
        """The order in the letters of SciPy, and the columns of its angles."""
        order = self.rotation_order
        columns = ["XYZ".index(axis) for axis in order] if len(set(order)) == 3 else [0, 1, 2]
        return (order if self.rotation_about == "moving" else order.lower()), columns

    @property
    def settings(self) -> str:
        """Its keys that are not the default."""
        values = {key: getattr(self, key) for key in ("rotation_order", "rotation_about", "frame")}
        changed = [f'{key} = "{value}"' for key, value in values.items() if value != getattr(OURS, key)]
        if any(self.pivot):
            changed.append(f"pivot = {list(self.pivot)}")
        return ", ".join(changed) or 'rotation_order = "XYZ", rotation_about = "fixed", frame = "z_up"'


OURS = PoseConvention()


def check_convention(
    platform: Platform,
    leg_length: FloatArray,  # measured (n, 6) [m]
    position: FloatArray,  # (n, 3) [m], as read in the convention
    orientation: FloatArray,  # (n, 3) [rad]
    convention: PoseConvention,
) -> None:
    """Refuse poses that contradict leg lengths in their convention and fit them in another, which it names."""
    rows = np.unique(np.linspace(0, len(leg_length) - 1, _ROWS).astype(int))
    rows = rows[np.isfinite(leg_length[rows]).all(axis=1)]
    if not rows.size:
        return
    try:
        place, turning = convention.written(position[rows], orientation[rows])
    except ValueError:  # in their order the angles cannot be determined
        return
    quaternions = convention.rotation_order == QUATERNION
    orders = [QUATERNION] if quaternions else _ORDERS
    frames = [convention.frame, *_FRAMES, *_MIRRORED]
    candidates = [
        replace(convention, rotation_order=order, rotation_about="fixed", frame=frame)
        for frame in frames
        for order in orders
    ]
    lengths = leg_length[rows]
    now = _misfits(platform, lengths, place, turning, convention)
    others = np.array([_misfits(platform, lengths, place, turning, candidate) for candidate in candidates])
    for kind in range(len(now)):
        # of those that are equal but for noise, the first
        best = int(np.argmax(others[:, kind] <= 1.5 * others[:, kind].min() + _SMALLEST * lengths.mean()))
        if now[kind] > _BETTER * max(_SMALLEST * lengths.mean(), others[best, kind]):
            fits = candidates[best]
            mirrored = fits.is_left_handed and not convention.is_left_handed
            what = "; their frame is left-handed (mirrored)" if mirrored else ""
            raise ValueError(
                f"the leg lengths contradict the poses, by {now[kind]:.3g} m rms, and fit them within "
                f"{others[best, kind]:.3g} m with {fits.settings}{what}; read the poses so, if that is how they were "
                "written"
            )


def _misfits(
    platform: Platform, leg_length: FloatArray, position: FloatArray, turning: FloatArray, convention: PoseConvention
) -> list[float]:
    """Rms errors of the lengths [m]: as they are, and of many rows without what is constant in each leg."""
    p, R = convention.read(position, turning)
    error = leg_length - leg_geometry(platform, p, angles_of(R)).length
    kinds = [error, error - error.mean(axis=0)] if len(error) >= _FOR_OFFSETS else [error]
    return [float(np.sqrt(np.mean(kind**2))) for kind in kinds]
