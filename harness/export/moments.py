"""Motions as functions of time in single precision, as C: time is a moment of 48 bits, see runtime/time.c."""

from typing import NamedTuple

import casadi

from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.export.tables import number


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
    **{
        name.upper(): f"REAL({name})({{x}})"
        for name in ("sqrt", "sin", "cos", "tan", "atan", "asin", "acos", "tanh", "exp", "log", "fabs", "floor")
    },
    **{"ATAN2": "REAL(atan2)({x}, {y})", "POW": "REAL(pow)({x}, {y})", "CONSTPOW": "REAL(pow)({x}, {y})"},
    "HYPOT": "REAL(hypot)({x}, {y})",
}
_NAMES = {getattr(casadi, f"OP_{name}"): name for name in (*_SUMS, *_PRODUCTS, *_OF_MOMENTS, *_OF_NUMBERS)}


def function_of_time(function: casadi.Function) -> str:
    """A motion as a function of a moment, of which sums and products of constants keep 48 bits.

    Raises
    ------
    ExportError
        An operation for which there is no rule.
    """
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
