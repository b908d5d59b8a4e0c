"""C in single precision: float for double in a text, and functions of time whose sums and phases keep 48 bits.

A float resolves 0.06 ms at 1000 s, in which a platform moves 0.06 mm. So time is the sum of two floats, and what is
computed from it by sums and products of constants stays one, until the sine or cosine of a phase or the product with
such a number takes a float of it.
"""

import re

import casadi
import numpy as np

from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.export.texts import filled, number, read

_NO_CODE = re.compile(r'(/\*.*?\*/|"[^"\n]*"|^#include[^\n]*)', re.S | re.M)
_LITERAL = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])")
_LIBRARY = re.compile(
    r"\b(floor|ceil|fabs|sqrt|sin|cos|tan|asin|acos|atan|atan2|sinh|cosh|tanh|exp|log|pow|fmin|fmax|fma|hypot"
    r"|fmod|expm1|log1p|erf|copysign|remainder)\("
)
_PLAIN = {
    casadi.OP_SQRT: "sqrt",
    casadi.OP_TAN: "tan",
    casadi.OP_ATAN2: "atan2",
    casadi.OP_ATAN: "atan",
    casadi.OP_ASIN: "asin",
    casadi.OP_ACOS: "acos",
    casadi.OP_TANH: "tanh",
    casadi.OP_EXP: "exp",
    casadi.OP_LOG: "log",
    casadi.OP_POW: "pow",
    casadi.OP_CONSTPOW: "pow",
    casadi.OP_FABS: "fabs",
    casadi.OP_HYPOT: "hypot",
    casadi.OP_FLOOR: "floor",
}


def with_floats(text: str) -> str:
    """C code with float in place of double: types, literals, and functions of the C library; comments stay."""
    parts = _NO_CODE.split(text)
    for k in range(0, len(parts), 2):
        part = re.sub(r"\bdouble\b", "float", parts[k])
        part = re.sub(r"\bHUGE_VAL\b", "HUGE_VALF", part)
        parts[k] = _LIBRARY.sub(r"\1f(", _LITERAL.sub(r"\1f", part))
    return "".join(parts)


def halves(value: float) -> tuple[float, float]:
    """Two numbers of single precision whose sum is a number to 48 bits."""
    high = float(np.float32(value))
    return high, float(np.float32(value - high))


def pair(value: float) -> str:
    """A constant in C."""
    high, low = halves(value)
    return f"pair_of({number(high)}, {number(low)})"


def pairs_source(used_in: str) -> str:
    """The functions of pairs that a text needs, and those that they need."""
    turn = 2 * np.pi
    high, low = halves(turn)
    # 2π less its double, 2.4e-16, is less than what phases of 48 bits resolve
    facts = {"TURN_HIGH": number(high), "TURN_LOW": number(low), "TURN_LOWEST": number(float(turn - high - low))}
    head, *functions = re.split(r"(?=^static |^/\* (?:An angle|The time))", filled(read("pairs.c"), facts), flags=re.M)
    functions = _with_comments(functions)
    names = [re.search(r"^static \w+ (\w+)\(", text, re.M)[1] for text in functions]  # type: ignore[index]
    needed = set[str]()
    waiting = [used_in]
    while waiting:
        text = waiting.pop()
        for name, function in zip(names, functions, strict=True):
            if name not in needed and re.search(rf"\b{name}\(", text):
                needed.add(name)
                waiting.append(function)
    return head + "".join(text for name, text in zip(names, functions, strict=True) if name in needed)


def _with_comments(parts: list[str]) -> list[str]:
    """Comments joined to the functions after them."""
    found, comment = list[str](), ""
    for part in parts:
        if part.startswith("/*"):
            comment = part
        else:
            found.append(comment + part)
            comment = ""
    return found


class _Value:
    """A value in C: a pair, or a single number; constants are both."""

    def __init__(self, text: str, *, is_pair: bool, constant: float | None = None) -> None:
        self.text, self.is_pair, self.constant = text, is_pair, constant

    @property
    def pair(self) -> str:
        if self.constant is not None:
            return pair(self.constant)
        return self.text if self.is_pair else f"pair_of({self.text}, 0)"

    @property
    def single(self) -> str:
        if self.constant is not None:
            return f"({number(self.constant)})" if self.constant < 0 else number(self.constant)
        return f"pair_value({self.text})" if self.is_pair else self.text


def function_of_time(function: casadi.Function) -> str:
    """A Function of `time` as `static void NAME(pair time, double out[])`.

    Raises
    ------
    ExportError
        An operation for which there is no rule.
    """
    lines: list[str] = []
    values: dict[int, _Value] = {}
    for k in range(function.n_instructions()):
        kind, read_from, written = (
            function.instruction_id(k),
            function.instruction_input(k),
            function.instruction_output(k),
        )
        if kind == casadi.OP_CONST:
            values[written[0]] = _Value("", is_pair=True, constant=float(function.instruction_constant(k)))
        elif kind == casadi.OP_INPUT:
            values[written[0]] = _Value("time", is_pair=True)
        elif kind == casadi.OP_OUTPUT:
            lines.append(f"  {function.name_out(written[0])}[{written[1]}] = {values[read_from[0]].single};")
        else:
            found = _operation(kind, [values[place] for place in read_from], function.name())
            name = f"a{k}"
            lines.append(f"  const {'pair' if found.is_pair else 'double'} {name} = {found.text};")
            values[written[0]] = _Value(name, is_pair=found.is_pair)
    body = "\n".join(lines)
    return f"\nstatic void {function.name()}(pair time, double {function.name_out(0)}[])\n{{\n{body}\n}}\n"


def _operation(kind: int, of: list[_Value], name: str) -> _Value:
    """Sums keep what either has; products and quotients of pairs are pairs; anything else is single."""
    a, b = of[0], of[-1]
    text = _of_pairs(kind, a, b)
    if text is not None:
        return _Value(text, is_pair=True)
    x, y = a.single, b.single
    some = a.is_pair or b.is_pair
    less, not_more = f"{x} < {y}", f"{x} <= {y}"
    if some:
        less, not_more = f"pair_less({a.pair}, {b.pair})", f"!pair_less({b.pair}, {a.pair})"
    angle = f"pair_angle({a.pair})" if a.is_pair else x
    plain = {
        casadi.OP_ADD: f"{x} + {y}",
        casadi.OP_SUB: f"{x} - {y}",
        casadi.OP_TWICE: f"{x} + {x}",
        casadi.OP_NEG: f"-{x}",
        casadi.OP_MUL: f"{x} * {y}",
        casadi.OP_SQ: f"{x} * {x}",
        casadi.OP_DIV: f"{x} / {y}",
        casadi.OP_INV: f"1 / {x}",
        casadi.OP_FMIN: f"{x} < {y} ? {x} : {y}",
        casadi.OP_FMAX: f"{x} > {y} ? {x} : {y}",
        casadi.OP_LT: f"{less} ? 1 : 0",
        casadi.OP_LE: f"{not_more} ? 1 : 0",
        casadi.OP_NOT: f"{_is_true(x)} ? 0 : 1",
        casadi.OP_AND: f"({_is_true(x)}) && ({_is_true(y)}) ? 1 : 0",
        casadi.OP_OR: f"{_is_true(x)} || {_is_true(y)} ? 1 : 0",
        casadi.OP_IF_ELSE_ZERO: f"{_is_true(x)} ? {y} : 0",
        casadi.OP_SIN: f"sin({angle})",
        casadi.OP_COS: f"cos({angle})",
    }
    if kind in plain:
        return _Value(plain[kind], is_pair=False)
    if kind in _PLAIN:
        return _Value(f"{_PLAIN[kind]}({', '.join(each.single for each in of)})", is_pair=False)
    raise ExportError(
        f"the reference has an operation for which there is no single precision (number {kind} of CasADi in {name}); "
        "expected arithmetic, or an export with real = 'double' or reference = 'inputs'"
    )


def _of_pairs(kind: int, a: _Value, b: _Value) -> str | None:
    """An operation whose result is a pair."""
    sums = {
        casadi.OP_ADD: f"pair_sum({a.pair}, {b.pair})",
        casadi.OP_SUB: f"pair_sum({a.pair}, pair_minus({b.pair}))",
        casadi.OP_TWICE: f"pair_sum({a.pair}, {a.pair})",
        casadi.OP_NEG: f"pair_minus({a.pair})",
    }
    products = {
        casadi.OP_MUL: f"pair_product({a.pair}, {b.pair})",
        casadi.OP_SQ: f"pair_product({a.pair}, {a.pair})",
        casadi.OP_DIV: f"pair_quotient({a.pair}, {b.pair})",
        casadi.OP_INV: f"pair_quotient({pair(1.0)}, {a.pair})",
        casadi.OP_FMIN: f"pair_less({a.pair}, {b.pair}) ? {a.pair} : {b.pair}",
        casadi.OP_FMAX: f"pair_less({a.pair}, {b.pair}) ? {b.pair} : {a.pair}",
    }
    if kind == casadi.OP_IF_ELSE_ZERO and b.is_pair:
        return f"{_is_true(a.single)} ? {b.pair} : {pair(0.0)}"
    if a.is_pair and b.is_pair:
        return (sums | products).get(kind)
    return sums.get(kind) if a.is_pair or b.is_pair else None


def _is_true(x: str) -> str:
    return f"{x} > 0 || {x} < 0"
