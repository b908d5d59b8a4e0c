"""Numbers and motions of a design in C: constant tables, rows of a file, splines of a path, functions of time.

The harness plays a path as quintics between the knots of its time law. There are thousands of them; the path's splines
and the law at its knots are a tenth of that. What the law keeps in 32 bits changes forces by less than 1e-6 of the
largest, which an export measures. A table of the platform's coordinates would be larger: along a fastest path,
accelerations have a kink or jump at every knot, and 1e-6 of the forces takes 380 kB of six coordinates.
"""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import casadi
import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.errors import ExportError
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
        # of a search by halves, the largest power of 2 below their number
        tables.define(N_PIECES=len(begins), FIRST_STEP=1 << max(0, (len(begins) - 1).bit_length() - 1))
        tables.add("BEGINS", begins, "moment")
        tables.add("PIECES", pieces, written=_rows(pieces, 6))
        return
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
    first_step = 1 << max(0, (len(knots) - 2).bit_length() - 1)
    tables.define(N_KNOTS=len(knots), FIRST_STEP=first_step, LAW_UNIT=number(_UNIT))
    tables.lines.append("#include <stdint.h>")
    tables.add("FIRST_KNOT", np.searchsorted(begin, begins), "int32_t")
    tables.add("KNOTS", knots, "moment")
    # at the end of a path of one piece the value is 1, one unit beyond the largest number
    tables.add("LAW_VALUE", np.minimum(np.rint((at.value - begin) / _UNIT), 2**31 - 1), "int32_t")
    tables.add("LAW_RATE", at.rate.astype(np.float32).astype(float), "float")
    tables.add("LAW_CHANGE", at.acceleration.astype(np.float32).astype(float), "float")


def _rows(pieces: FloatArray, relative: int) -> str:
    """Rows (n, 6, powers), with the constant terms of the first coordinates relative to home."""
    kinds, rows = [f"H{k}" if k < relative else "R" for k in range(6)], []
    for piece in pieces:
        parts = (f"{{{numbers(p[:-1])}, {number(p[-1], kind)}}}" for p, kind in zip(piece, kinds, strict=True))
        rows.append(f"{{{', '.join(parts)}}}")
    return "\n    " + ",\n    ".join(rows)


# ---- motions as functions of time in single precision: time is a moment of 48 bits, see runtime/time.c ----


class _Value(NamedTuple):
    """A value of a motion: a moment, or a single number; constants are both."""

    text: str
    is_moment: bool = True
    constant: float | None = None

    @property
    def moment(self) -> str:
        if self.constant is not None:
            return f"CONSTANT({self.constant!r})"
        return self.text if self.is_moment else f"moment_of({self.text}, 0)"

    @property
    def single(self) -> str:
        if self.constant is not None:
            return number(self.constant)
        return f"moment_value({self.text})" if self.is_moment else self.text


# By CasADi's operation, of moments {a}, {b} and numbers {x}, {y}. Sums keep the digits that one of them has, products
# those that both have; the others give numbers.
_SUMS = {
    "ADD": "moment_sum({a}, {b})",
    "SUB": "moment_sum({a}, moment_minus({b}))",
    "TWICE": "moment_sum({a}, {a})",
    "NEG": "moment_minus({a})",
}
_PRODUCTS = {
    "MUL": "moment_product({a}, {b})",
    "SQ": "moment_product({a}, {a})",
    "DIV": "moment_quotient({a}, {b})",
    "INV": "moment_quotient(CONSTANT(1.0), {a})",
    "FMIN": "moment_less({a}, {b}) ? {a} : {b}",
    "FMAX": "moment_less({a}, {b}) ? {b} : {a}",
}
_OF_MOMENTS = {
    "LT": "moment_less({a}, {b}) ? 1 : 0",
    "LE": "moment_less({b}, {a}) ? 0 : 1",
    "SIN": "REAL(sin)(moment_angle({a}))",
    "COS": "REAL(cos)(moment_angle({a}))",
}
_OF_NUMBERS = {
    **{"ADD": "{x} + {y}", "SUB": "{x} - {y}", "TWICE": "{x} + {x}", "NEG": "-({x})"},
    **{"MUL": "{x} * {y}", "SQ": "{x} * {x}", "DIV": "{x} / {y}", "INV": "1 / {x}"},
    **{"FMIN": "{x} < {y} ? {x} : {y}", "FMAX": "{x} > {y} ? {x} : {y}"},
    **{"LT": "{x} < {y} ? 1 : 0", "LE": "{x} <= {y} ? 1 : 0", "NOT": "IS_TRUE({x}) ? 0 : 1"},
    **{"AND": "IS_TRUE({x}) && IS_TRUE({y}) ? 1 : 0", "OR": "IS_TRUE({x}) || IS_TRUE({y}) ? 1 : 0"},
    "IF_ELSE_ZERO": "IS_TRUE({x}) ? {y} : 0",
    **{name.upper(): f"REAL({name})({{x}})" for name in ("sqrt", "sin", "cos", "fabs", "floor")},
}
_NAMES = {getattr(casadi, f"OP_{name}"): name for name in (*_SUMS, *_PRODUCTS, *_OF_MOMENTS, *_OF_NUMBERS)}


def function_of_time(function: casadi.Function) -> str:
    """A motion as a function of a moment, of which sums and products of constants keep 48 bits."""
    lines, values = list[str](), dict[int, _Value]()
    for k in range(function.n_instructions()):
        kind, read, written = (
            function.instruction_id(k),
            function.instruction_input(k),
            function.instruction_output(k),
        )
        if kind == casadi.OP_CONST:
            values[written[0]] = _Value("", constant=float(function.instruction_constant(k)))
            continue
        if kind == casadi.OP_INPUT:
            values[written[0]] = _Value("now")
            continue
        if kind == casadi.OP_OUTPUT:
            lines.append(f"  motion[{written[1]}] = {values[read[0]].single};")
            continue
        a, b, name = values[read[0]], values[read[-1]], _NAMES.get(kind, "")
        either, both = a.is_moment or b.is_moment, a.is_moment and b.is_moment
        form = (_SUMS.get(name) if either else None) or (_PRODUCTS.get(name) if both else None)
        is_moment = form is not None
        form = form or (_OF_MOMENTS.get(name) if either else None) or _OF_NUMBERS.get(name)
        if name == "IF_ELSE_ZERO" and b.is_moment:
            form, is_moment = "IS_TRUE({x}) ? {b} : CONSTANT(0.0)", True
        if form is None:
            raise ExportError(
                f"the reference has an operation for which there is no single precision (number {kind} of CasADi in "
                f"{function.name()}); expected arithmetic, or an export with reference = 'inputs'"
            )
        text = form.format(a=a.moment, b=b.moment, x=a.single, y=b.single)
        lines.append(f"  const {'moment' if is_moment else 'real'} a{k} = {text};")
        values[written[0]] = _Value(f"a{k}", is_moment)
    return "\n".join(["\nstatic void motion(moment now, real motion[])", "{", *lines, "}\n"])
