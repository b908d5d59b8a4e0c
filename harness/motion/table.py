"""Reference motions from tables of poses, such as CSV files."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.motion import ROUNDING, Motion, motion_of
from gough_stewart.model.real import real_array
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_SPLINE_DEGREE = 5
_SEPARATORS = {b";": "semicolons", b"\t": "tabulators"}
_FILTER_ORDER = 3


@dataclass(frozen=True, eq=False)
class FromTable:
    """Poses at given times with quintic splines between them, and the splines' own derivatives.

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
        back = np.flatnonzero(np.diff(self.time) <= 0)
        if back.size:
            k = int(back[0])
            raise MotionError(
                f"time goes from {self.time[k]:g} to {self.time[k + 1]:g} s in row {k + 2}; expected increasing times"
            )
        from scipy.interpolate import make_interp_spline  # half a second of imports that other motions do without

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
                f"time {outside[0]:g} s is outside of the table, which goes from {first:g} to {last:g} s; make the run "
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
        """The splines as polynomials: when each begins (n,) [s], and of each six in the time since then (n, 6, 6).

        Coefficients of x, y, z, roll, pitch, yaw, the highest power first.
        """
        begins = self._spline.t[_SPLINE_DEGREE : -_SPLINE_DEGREE - 1]
        powers = range(_SPLINE_DEGREE, -1, -1)
        return begins, np.stack([self._spline(begins, k) / math.factorial(k) for k in powers], axis=-1)

    def from_time(self, start: float) -> "FromTable":
        """The same motion with its time [s] counted from `start`."""
        return self if start == 0 else FromTable(self.time - start, self.position, self.orientation)

    def smoothed(self, cutoff: float) -> "FromTable":
        """Poses through a low-pass without phase, at even times.

        A Butterworth filter of third order, forward and backward: gain 1/(1 + (√2 − 1)(f/fc)⁶), so that accelerations
        of noise beyond fc fade as f⁻⁴. Rows at uneven times are resampled by the splines first.

        Parameters
        ----------
        cutoff
            [Hz]

        Raises
        ------
        MotionError
            The cut-off is not below half the rate of the rows, or the table shorter than the filter needs.
        """
        from scipy.signal import butter, sosfiltfilt  # takes a second to import, and is seldom needed

        n = len(self.time)
        time: FloatArray = np.linspace(self.time[0], self.time[-1], n)
        rate = (n - 1) / float(time[-1] - time[0])
        corner = cutoff * (math.sqrt(2) - 1) ** (-1 / (2 * _FILTER_ORDER))
        if not corner < rate / 2:
            raise MotionError(
                f"smoothing is {cutoff:g} Hz; expected below {rate / 2.32:.3g} Hz, for rows at {rate:.4g} Hz"
            )
        sections = butter(_FILTER_ORDER, corner, fs=rate, output="sos")
        # one period of the cut-off, mirrored at both ends
        padding = math.ceil(rate / cutoff)
        if not padding < n:
            raise MotionError(
                f"smoothing is {cutoff:g} Hz; expected above {rate / n:.3g} Hz, for {n} rows at {rate:.4g} Hz"
            )
        pose = sosfiltfilt(sections, self._spline(time), axis=0, padtype="odd", padlen=padding)
        return FromTable(time, pose[:, :3], pose[:, 3:])


def read_reference(path: Path | str) -> FromTable:
    """A motion from a CSV file with the columns time, position[1..3] and orientation[1..3], in SI units.

    Raises
    ------
    MotionError
        The file cannot be read, a column is missing or holds no numbers, or as `FromTable`; names file, column and row.
    """
    import polars  # the schema of experiments, which knows of tables, does without

    names = ["time", *(f"{name}[{k}]" for name in ("position", "orientation") for k in (1, 2, 3))]
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise MotionError(f"{path}: cannot read this reference: {error.strerror or error}") from error
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise MotionError(f"{path}: is UTF-16, as some spreadsheets write it; expected CSV in UTF-8")
    header = content.partition(b"\n")[0]
    other = next((name for mark, name in _SEPARATORS.items() if mark in header), None)
    if other is not None and b"," not in header:
        raise MotionError(
            f"{path}: its columns are separated by {other}, as some spreadsheets write them; expected commas between "
            "them, and points in numbers"
        )
    try:
        # as texts, so that true is no number
        table = polars.read_csv(content, infer_schema=False)
    except polars.exceptions.PolarsError as error:
        raise MotionError(f"{path}: is not CSV: {str(error).splitlines()[0]}") from error
    twice = [name for name in names if f"{name}_duplicated_0" in table.columns]
    if twice:
        raise MotionError(f"{path}: has the column {twice[0]} twice; expected every column once")
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise MotionError(f"{path}: has no column {', '.join(missing)}; expected {', '.join(names)}")
    for name in names:
        column = table[name]
        numbers = column.cast(polars.Float64, strict=False)
        bad = [k for k, value in enumerate(numbers) if value is None or not math.isfinite(value)]
        if bad:
            found = column[bad[0]]
            remedy = ", with a point, not a comma" if found is not None and "," in found else ""
            raise MotionError(f"{path}: {name} in row {bad[0] + 1} is {found!r}; expected a finite number{remedy}")
    values = table.select(polars.col(names).cast(polars.Float64)).to_numpy()
    try:
        return FromTable(values[:, 0], values[:, 1:4], values[:, 4:7])
    except MotionError as error:
        raise MotionError(f"{path}: {error}") from error
