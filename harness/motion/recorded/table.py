"""Motions from a table of poses, by quintic splines."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.motion import ROUNDING, Motion, Piecewise, motion_of
from gough_stewart.model.vectors import FloatArray, real_array

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_SPLINE_DEGREE = 5
# Share of the mean step below which two times are the same: a spline between them would have any slope.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class FromTable(Piecewise):
    """Poses at given times with quintic splines between them, differentiated exactly.

    Raises
    ------
    MotionError
        Fewer than six rows, times that do not increase, or numbers that are not finite.
    """

    time: FloatArray  # (n,) [s]
    position: FloatArray  # (n, 3) [m]
    orientation: FloatArray  # (n, 3) [rad]
    _spline: "BSpline" = field(init=False, repr=False)

    def __post_init__(self) -> None:
        n = np.size(self.time)
        if n <= _SPLINE_DEGREE:
            raise MotionError(f"a table of {n} rows; expected at least {_SPLINE_DEGREE + 1} for quintic splines")
        for name, shape in (("time", (n,)), ("position", (n, 3)), ("orientation", (n, 3))):
            try:
                array = real_array(getattr(self, name), shape)
            except ValueError as error:
                raise MotionError(f"{name} {error}") from None
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        check_increasing(self.time)
        from scipy.interpolate import make_interp_spline  # half a second of imports, needed here only

        pose = np.hstack([self.position, self.orientation])
        object.__setattr__(self, "_spline", make_interp_spline(self.time, pose, k=_SPLINE_DEGREE))

    def __call__(self, time: ArrayLike) -> Motion:
        """The motion at times (n,) [s].

        Raises
        ------
        MotionError
            A time before the first row or after the last.
        """
        time = np.asarray(time, dtype=float)
        first, last = float(self.time[0]), float(self.time[-1])
        outside = time[~((time >= first - ROUNDING) & (time <= last + ROUNDING))]  # NaN is outside
        if outside.size:
            raise MotionError(
                f"time {outside[0]:g} s is outside the table, which covers {first:g} to {last:g} s; make the run "
                "shorter or the table longer"
            )
        inside = np.clip(time, first, last)
        return motion_of(*(self._spline(inside, k) for k in range(3)))

    @property
    def end(self) -> float:
        """The time of the last row [s]."""
        return float(self.time[-1])

    @property
    def pieces(self) -> tuple[FloatArray, FloatArray]:
        """The splines as polynomials: start times (n,) [s], and six each in the time since then (n, 6, 6).

        Coefficients of x, y, z, roll, pitch, yaw, highest power first.
        """
        begins = self._spline.t[_SPLINE_DEGREE : -_SPLINE_DEGREE - 1]
        powers = range(_SPLINE_DEGREE, -1, -1)
        return begins, np.stack([self._spline(begins, k) / math.factorial(k) for k in powers], axis=-1)

    def from_time(self, start: float) -> "FromTable":
        """The same motion with times [s] relative to `start`."""
        return self if start == 0 else FromTable(self.time - start, self.position, self.orientation)

    @property
    def centre(self) -> FloatArray:
        """The pose (6,) at time 0, or that of the first row if it is later; amplitudes are scaled about it."""
        begin = self(np.clip([0.0], self.time[0], self.time[-1]))
        return np.concatenate([begin.position[0], begin.orientation[0]])

    def scaled(self, time_scale: float, amplitude_scale: float) -> "FromTable":
        """The motion s times as long, and a times as large about its centre; splines scale exactly."""
        if time_scale == amplitude_scale == 1:
            return self
        position, orientation = np.split(self.centre, 2)
        return FromTable(
            time_scale * self.time,
            position + amplitude_scale * (self.position - position),
            orientation + amplitude_scale * (self.orientation - orientation),
        )


def check_increasing(time: FloatArray, first: float = 0.0) -> None:
    """Refuse times (n,) [s] that do not increase, or by next to nothing; `first` is added to the times in the message.

    Raises
    ------
    MotionError
        Names the times and the row, counted from 1.
    """
    back = np.flatnonzero(~(np.diff(time) > _SAME * np.ptp(time) / len(time)))
    if back.size:
        k = int(back[0])
        raise MotionError(
            f"time goes from {first + time[k]:g} to {first + time[k + 1]:g} s in row {k + 2}; expected increasing times"
        )
