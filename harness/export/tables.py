"""Constant tables in C: numbers of a design, and motions that are no formula: rows of a file, splines of a path.

The harness plays a path as quintics between the knots of its time law. There are thousands of them; the path's splines
and the law at its knots are a tenth of that. What the law keeps in 32 bits changes forces by less than 1e-6 of the
largest, which an export measures. A table of the platform's coordinates would be larger: along a fastest path,
accelerations have a kink or jump at every knot, and 1e-6 of the forces takes 380 kB of six coordinates.
"""

import math
from collections.abc import Iterable
from typing import Any

import casadi
import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.export import symbols
from gough_stewart.harness.export.symbols import Home
from gough_stewart.harness.motion.motion import ROUNDING, Piecewise, coordinates_of, smaller
from gough_stewart.harness.motion.paths.time_law import Averaged, Polynomials, Quintic, Stretched, TimedPath, TimeLaw
from gough_stewart.model.vectors import FloatArray

# Of the path parameter, which is at most 1, in 32 bits with a sign: a float of that size would move legs by 30 nm.
_UNIT = 2.0**-31


def number(value: float, form: str = "R") -> str:
    """A number in C, exactly; as a macro of the runtime converts it."""
    if math.isinf(value):
        return "(real)HUGE_VAL" if value > 0 else "-(real)HUGE_VAL"
    return f"{form}({float(value)!r})" if form else repr(float(value))


def numbers(values: Iterable[float], form: str = "R") -> str:
    """Numbers separated by commas."""
    return ", ".join(number(float(value), form) for value in values)


class ConstantTables:
    """Constant arrays and macros as a text of C, and what they take of a processor's memory."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.reals = self.words = 0  # numbers in the type of the controller, and of 32 bits

    def bytes(self, size: int) -> int:
        """What they take, where a number takes `size`."""
        return size * self.reals + 4 * self.words

    def add(self, name: str, values: ArrayLike, kind: str = "real", written: Any = None) -> None:
        """An array; `written` are its rows in C if a macro of its kind does not write them."""
        array = np.asarray(values)
        sizes = "".join(f"[{n}]" for n in array.shape)
        form = {"real": "R", "moment": "MOMENT", "float": "(float)"}.get(kind)
        texts = written or (numbers(array.flat, form) if form else ", ".join(str(int(v)) for v in array.flat))
        self.lines.append(f"static const {kind} {name}{sizes} = {{{texts}}};")
        if kind == "real":
            self.reals += array.size
        else:  # a moment has 64 bits in both precisions
            self.words += array.size * (2 if kind == "moment" else 1)

    def define(self, **macros: object) -> None:
        """Macros."""
        self.lines += [f"#define {name} {value}" for name, value in macros.items()]


def path_of(reference: object) -> TimedPath | None:
    """The path that a motion follows; None if it is another motion."""
    return reference.source if isinstance(reference, Polynomials) else None


def path_function(source: TimedPath, home: Home | None = None) -> casadi.Function:
    """CasADi Function `motion_of_path`: splines and two derivatives, ṡ, s̈ -> pose, rate, acceleration."""
    parts = {name: casadi.SX.sym(name, 6) for name in ("spline", "slope", "bend")}
    speed = {name: casadi.SX.sym(name) for name in ("speed", "change")}
    splines = [symbols.row(part) for part in parts.values()]
    if home is not None:  # the splines of positions are relative
        splines[0] = splines[0] + np.concatenate([home.position, np.zeros(3)])
    point = source.path.point(*splines)
    motion: Any = point.motion(*map(symbols.elements, speed.values()))
    if source.amplitude != 1:
        motion = smaller(
            motion, source.amplitude, np.concatenate([source.path.position[0], source.path.orientation[0]])
        )
    pose, *rates = coordinates_of(motion)
    if home is not None:
        pose = pose - home.pose
        if source.amplitude == 1:
            pose[:, :3] = symbols.row(parts["spline"])[:, :3]
    outputs = zip(("pose", "rate", "acceleration"), (pose, *rates), strict=True)
    return symbols.function("motion_of_path", {**parts, **speed}, {name: symbols.column(v) for name, v in outputs})


def add_motion(tables: ConstantTables, reference: Piecewise, home: Home) -> None:
    """Add the polynomials between the rows of a file; or the splines of a path, and its time law at the knots.

    The constant terms of coordinates are relative to home in single precision, by macros `H0` to `H5`.
    """
    source = path_of(reference)
    tables.define(**{f"H{k}(x)": f"FROM_HOME(x, {float(value)!r})" for k, value in enumerate(home.pose)})
    tables.define(TABLE_ROUNDING=number(ROUNDING))
    tables.lines.append(f"static const moment TABLE_END = MOMENT({float(reference.end)!r});")
    if source is None:
        begins, pieces = reference.pieces
        tables.define(N_PIECES=len(begins), FIRST_STEP=_first_step(len(begins)))
        tables.add("BEGINS", begins, "moment")
        tables.add("PIECES", pieces, written=_rows(pieces, 6))
    else:
        _add_path(tables, source)


def _add_path(tables: ConstantTables, source: TimedPath) -> None:
    begins, pieces = source.path.pieces
    law: TimeLaw = source.law
    while isinstance(law, Stretched):
        law = law.law
    tables.lines.append(f"static const moment PATH_START = MOMENT({float(source.start)!r});")
    tables.define(N_SPLINES=len(begins), N_POWERS=pieces.shape[2], IS_AVERAGED=int(isinstance(law, Averaged)))
    tables.add("SPLINE_AT", begins)
    tables.add("SPLINES", pieces, written=_rows(pieces, 3))
    if isinstance(law, Quintic):
        tables.define(N_KNOTS=0, LAW_DURATION=number(source.law.duration))
        return
    # the law at its knots: the path parameter since its spline's piece began, and its two derivatives
    knots = source.law.knots
    at = source.law(knots)
    begin = begins[np.searchsorted(begins, at.value, side="right") - 1]
    tables.define(N_KNOTS=len(knots), FIRST_STEP=_first_step(len(knots) - 1), LAW_UNIT=number(_UNIT))
    tables.lines.append("#include <stdint.h>")
    tables.add("FIRST_KNOT", np.searchsorted(begin, begins), "int32_t")
    tables.add("KNOTS", knots, "moment")
    # at the end of a path of one piece the value is 1, one unit beyond the largest number
    tables.add("LAW_VALUE", np.minimum(np.rint((at.value - begin) / _UNIT), 2**31 - 1), "int32_t")
    tables.add("LAW_RATE", at.rate.astype(np.float32).astype(float), "float")
    tables.add("LAW_CHANGE", at.acceleration.astype(np.float32).astype(float), "float")


def _rows(pieces: FloatArray, relative: int) -> str:
    """Rows (n, 6, powers), with the constant terms of the first coordinates relative to home."""

    def row(k: int, powers: FloatArray) -> str:
        return f"{{{numbers(powers[:-1])}, {number(powers[-1], f'H{k}' if k < relative else 'R')}}}"

    return "\n    " + ",\n    ".join("{" + ", ".join(row(k, p) for k, p in enumerate(piece)) + "}" for piece in pieces)


def _first_step(n: int) -> int:
    """Of a search among n values by halves: the largest power of 2 below n."""
    return 1 << max(0, (n - 1).bit_length() - 1)
