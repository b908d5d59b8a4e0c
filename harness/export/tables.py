"""Constant tables in C: numbers of a design, and motions that are no formula: rows of a file, splines of a path.

The harness plays a path as quintics between the knots of its time law. There are thousands of them; the path's splines
and the law at its knots are a tenth of that. What the law keeps in 32 bits changes forces by less than 1e-6 of the
largest, see `path_deviation`. A table of the platform's coordinates would be larger: along a fastest path,
accelerations have a kink or jump at every knot, and 1e-6 of the forces takes 380 kB of six coordinates.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import casadi
import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.control.controllers import feedforward
from gough_stewart.harness.export import symbols
from gough_stewart.harness.export.symbols import Home
from gough_stewart.harness.motion.limits.reach import legs_of
from gough_stewart.harness.motion.motion import ROUNDING, Piecewise, coordinates_of, smaller
from gough_stewart.harness.motion.paths.polynomials import Polynomials
from gough_stewart.harness.motion.paths.time_law import AlongPath, Averaged, Quintic, Stretched, TimedPath, TimeLaw
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Of the path parameter, which is at most 1, in 32 bits with a sign: a float of that size would move legs by 30 nm.
_UNIT = 2.0**-31
# Instants at which motions are compared.
_COMPARED = 20_000


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


class KnotTable(NamedTuple):
    """A time law at its knots in 32-bit numbers, as C has it; each (n,)."""

    knots: FloatArray  # since the start [s]
    begins: FloatArray  # path parameter at which the spline's piece begins
    values: FloatArray  # path parameter since then, in units of 2⁻³¹
    rates: FloatArray  # [1/s]
    accelerations: FloatArray  # [1/s²]
    jerks: FloatArray  # from a knot to the next [1/s³] (n − 1,)

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.knots[-1])

    def __call__(self, time: FloatArray) -> AlongPath:
        """At times (n,) [s], as C computes in double precision."""
        knot = np.searchsorted(self.knots[:-1], time, side="right") - 1
        since, jerk = time - self.knots[knot], self.jerks[knot]
        rate, acceleration = self.rates[knot], self.accelerations[knot]
        value = self.begins[knot] + _UNIT * self.values[knot]
        value = value + since * (rate + since * (acceleration / 2 + since * jerk / 6))
        return AlongPath(value, rate + since * (acceleration + since * jerk / 2), acceleration + since * jerk)


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
    law = _unstretched(source.law)
    tables.lines.append(f"static const moment PATH_START = MOMENT({float(source.start)!r});")
    tables.define(N_SPLINES=len(begins), N_POWERS=pieces.shape[2], IS_AVERAGED=int(isinstance(law, Averaged)))
    tables.add("SPLINE_AT", begins)
    tables.add("SPLINES", pieces, written=_rows(pieces, 3))
    if isinstance(law, Quintic):
        tables.define(N_KNOTS=0, LAW_DURATION=number(source.law.duration))
        return
    table = _at_knots(source)
    tables.define(N_KNOTS=len(table.knots), FIRST_STEP=_first_step(len(table.knots) - 1), LAW_UNIT=number(_UNIT))
    tables.lines.append("#include <stdint.h>")
    tables.add("FIRST_KNOT", np.searchsorted(table.begins, begins), "int32_t")
    tables.add("KNOTS", table.knots, "moment")
    tables.add("LAW_VALUE", table.values, "int32_t")
    tables.add("LAW_RATE", table.rates, "float")
    tables.add("LAW_CHANGE", table.accelerations, "float")


def _rows(pieces: FloatArray, relative: int) -> str:
    """Rows (n, 6, powers), with the constant terms of the first coordinates relative to home."""

    def row(k: int, powers: FloatArray) -> str:
        return f"{{{numbers(powers[:-1])}, {number(powers[-1], f'H{k}' if k < relative else 'R')}}}"

    return "\n    " + ",\n    ".join("{" + ", ".join(row(k, p) for k, p in enumerate(piece)) + "}" for piece in pieces)


def _first_step(n: int) -> int:
    """Of a search among n values by halves: the largest power of 2 below n."""
    return 1 << max(0, (n - 1).bit_length() - 1)


def path_deviation(platform: Platform, reference: Polynomials, source: TimedPath) -> str:
    """What rounding of the law costs in double precision, for the header."""
    exported = source if isinstance(_unstretched(source.law), Quintic) else replace(source, law=_at_knots(source))
    times = source.start + np.linspace(0, 1, _COMPARED + 1)[1:-1] * source.law.duration
    motions = exported(times), reference(times)
    forces = [feedforward("computed_torque", platform, motion) for motion in motions]
    force = np.abs(forces[0] - forces[1]).max() / np.abs(forces[1]).max()
    legs = zip(*(legs_of(platform, motion) for motion in motions), strict=True)
    length, velocity = (np.abs(a - b).max() for a, b in legs)
    return (
        f"The motion along the path differs from that of a run, in double precision: its computed torque by at most "
        f"{force:.2g} of the largest, leg lengths by {length:.2g} m, leg velocities by {velocity:.2g} m/s."
    )


def _at_knots(source: TimedPath) -> KnotTable:
    knots, (begins, _) = source.law.knots, source.path.pieces
    at = source.law(knots)
    begin = begins[np.searchsorted(begins, at.value, side="right") - 1]
    rates, accelerations = (values.astype(np.float32).astype(float) for values in (at.rate, at.acceleration))
    is_linear = isinstance(_unstretched(source.law), Averaged)
    jerks = is_linear * np.diff(accelerations) / np.diff(knots)
    return KnotTable(knots, begin, np.rint((at.value - begin) / _UNIT), rates, accelerations, jerks)


def _unstretched(law: TimeLaw) -> TimeLaw:
    while isinstance(law, Stretched):
        law = law.law
    return law
