"""C text of CasADi functions, scalar and on vectors of members, and that of the kernel (c/plant/kernel.h)."""

import re
from collections import Counter
from collections.abc import Sequence

import casadi
import numpy as np

from gough_stewart.model.interface import IDEAL, Variant
from gough_stewart.model.traced import traced_function

_BODY = re.compile(r"static int casadi_f(\d+)\([^{]*\{\n(.*?)\n  return 0;\n\}\n", re.S)
_LITERAL = r"(?<![\w.\[])[0-9]+\.[0-9]*(?:e[+-]?[0-9]+)?"
_ASSIGNMENT = re.compile(r"  (a\d+)=")
_QUOTIENT = re.compile(r"(  a\d+)=\((a\d+)/(a\d+)\);")
_HEAD = """/* Generated from the Python source of the physics, gough_stewart.model.traced: do not edit. */
#include "kernel.h"

#include <math.h>

static double sq(double x)
{
    return x * x;
}
"""
_SIGN = """
static double sign(double x)
{
    return (x > 0) - (x < 0);
}
"""


def kernel_source(variant: Variant = IDEAL, order: Sequence[int] = ()) -> str:
    """`kernel.c`: the functions that c/plant/kernel.h declares.

    `order` has the positions in `Variant.results` of a unit's results, which begin with the states; empty: as they are.
    """
    functions, back = [traced_function("derivatives", variant)], np.argsort(order).tolist()
    for kind in ("outputs", "forward", "reverse"):
        function = traced_function(kind, variant)
        if order:  # its results y, changes dy and weights wy
            arguments, names, result_names = function.sx_in(), function.name_in(), function.name_out()
            results = function.call([v[back] if name == "wy" else v for name, v in zip(names, arguments, strict=True)])
            pairs = zip(result_names, results, strict=True)
            ordered = [casadi.cse(v[list(order)] if name in ("y", "dy") else v) for name, v in pairs]
            function = casadi.Function(function.name(), arguments, ordered, names, result_names)
        functions.append(function)
    functions.append(traced_function("legs", variant))
    head = _HEAD
    if variant.bristles:
        functions += [traced_function(kind, variant) for kind in ("decays", "grip", "sliding")]
        head += _SIGN
    return head + "".join(function_source(f, conditions=variant != IDEAL) for f in functions)


# Calls of the C library in CasADi's code.
_CALL = re.compile(
    r"\b(?:casadi_)?((?:a?(?:sin|cos|tan)h?|atan2|ceil|copysign|erf|exp|expm1|fabs|floor|fmax|fmin|fmod|hypot|log|log1p"
    r"|pow|remainder|sqrt))(?=\()"
)


# Numbers as conditions, which compilers warn of.
_TRUTHS = (
    (re.compile(r"\((a\d+)\?"), r"(\1!=0?"),
    (re.compile(r"\(!(a\d+)\)"), r"(\1==0)"),
    (re.compile(r"\((a\d+)(&&|\|\|)(a\d+)\)"), r"(\1!=0\2\3!=0)"),
)


def function_source(
    function: casadi.Function,
    declarator: str = "void kernel_",
    real: str = "double",
    *,
    call: str = "{}",
    conditions: bool = False,
    reciprocals: bool = True,
) -> str:
    """One CasADi SX Function as `void kernel_NAME(const double in0[], …, double out0[], …)`.

    `real` is the type of all numbers, to which literals are cast, and `call` how a function of the C library is called,
    from its name. With `conditions` conditional expressions are allowed, whose cost does not depend on the condition;
    with `reciprocals` repeated divisions become multiplications, which are rounded otherwise. `RuntimeError` if
    CasADi's code has a construct that is not known to be straight-line arithmetic.
    """
    generator = casadi.CodeGenerator("kernel", {"with_export": False})
    generator.add(function)
    bodies = _BODY.findall(generator.dump())
    if len(bodies) != 1:
        raise RuntimeError(f"{function.name()}: expected one straight-line function, found {len(bodies)}")
    inputs, outputs = function.name_in(), function.name_out()
    # a name may be an input of one function and an output of another, but not both in one function
    body = bodies[0][1]
    if real != "double":
        body = re.sub(_LITERAL, rf"(({real})\g<0>)", body)

    for k, name in enumerate(inputs):
        body = re.sub(rf"arg\[{k}\]\? arg\[{k}\]\[([0-9]+)\] : 0", rf"{name}[\1]", body)
    for k, name in enumerate(outputs):
        body = re.sub(rf"if \(res\[{k}\]!=0\) res\[{k}\]\[([0-9]+)\]=", rf"{name}[\1]=", body)
    body = body.replace("casadi_real", real)
    body = body.replace("casadi_inf", "HUGE_VAL" if real == "double" else f"(({real})HUGE_VAL)")
    body = body.replace("casadi_sq(", "sq(").replace("casadi_sign(", "sign(")
    for truth, compared in _TRUTHS:
        body = truth.sub(compared, body)
    body = _CALL.sub(lambda match: call.format(match[1]), body)
    body = with_reciprocals(body, real) if reciprocals else body
    leftover = re.search(r"casadi|\barg\b|\bres\b|\biw\b|\bif\b" + ("" if conditions else r"|\?"), body)
    if leftover:
        raise RuntimeError(f"{function.name()}: unknown construct '{leftover[0]}' in the generated code")
    arguments = [f"const {real} {name}[]" for name in inputs] + [f"{real} {name}[]" for name in outputs]
    return f"\n{declarator}{function.name()}({', '.join(arguments) or 'void'})\n{{\n{body}\n}}\n"


def with_reciprocals(body: str, real: str = "double") -> str:
    """Straight-line code with repeated divisions by one value replaced by multiplications with its reciprocal.

    CasADi writes x·(1/L) as x/L, and a division costs as much as four multiplications: the derivatives have 88
    divisions by 15 values. A value is identified by its name and the number of earlier assignments to it.
    """
    lines, assigned = body.splitlines(), Counter[str]()
    divisors: list[tuple[str, int] | None] = []
    for line in lines:
        quotient, assignment = _QUOTIENT.fullmatch(line), _ASSIGNMENT.match(line)
        divisors.append((quotient[3], assigned[quotient[3]]) if quotient else None)
        if assignment:
            assigned[assignment[1]] += 1
    uses = Counter(divisors)
    reciprocals: dict[tuple[str, int], str] = {}
    written = []
    for line, divisor in zip(lines, divisors, strict=True):
        if divisor is None or uses[divisor] == 1:
            written.append(line)
            continue
        if divisor not in reciprocals:
            reciprocals[divisor] = f"r{len(reciprocals)}"
            written.append(f"  {reciprocals[divisor]}=1/{divisor[0]};")
        written.append(_QUOTIENT.sub(rf"\1=(\2*{reciprocals[divisor]});", line))
    names = f"  {real} {', '.join(reciprocals.values())};"
    return "\n".join([names, *written] if reciprocals else written)


# Divisors are inverted by a function of c/lanes/elementary.h, faster than a division, for finite numbers.
_RECIPROCALS = (
    (r"=1/(\w+);", r"=reciprocal(\1);"),
    (r"=\((\w+)/(\w+)\);", r"=(\1*reciprocal(\2));"),
)
_ROOTS = ((r"\bsqrt\(", "rounded_square_root("),)
# What vectors cannot do by operators is done by functions there.
_ON_VECTORS = (
    (r"=\((\w+)!=0\?(\w+):0\);", r"=if_so(\1,\2);"),
    (r"=\((\w+)==0\);", r"=is_not(\1);"),
    (r"=\((\w+)!=0&&(\w+)!=0\);", r"=both(\1,\2);"),
    (r"=\((\w+)!=0\|\|(\w+)!=0\);", r"=either(\1,\2);"),
    (r"=\((\w+)<=(\w+)\);", r"=is_at_most(\1,\2);"),
    (r"=\((\w+)<(\w+)\);", r"=is_less(\1,\2);"),
    (r"=\((\w+)==(\w+)\);", r"=is_equal(\1,\2);"),
    (r"=\((\w+)!=(\w+)\);", r"=is_other(\1,\2);"),
)


_KERNEL = "static __attribute__((noinline)) void kernel_"


def in_lanes(function: casadi.Function, declarator: str = _KERNEL, *, exact: bool = False, call: str = "{}") -> str:
    """The C source of a CasADi Function on vectors of members; see `function_source` for errors.

    With `exact` divisions and roots are rounded as NumPy's, without it divisors must be finite.
    """
    text = function_source(function, declarator, "lanes", call=call, conditions=True, reciprocals=not exact)
    for scalar, vector in (*(_ROOTS if exact else _RECIPROCALS), *_ON_VECTORS):
        text = re.sub(scalar, vector, text)
    if leftover := re.search(r".*(\?|[<>!=]=|[<>]|&&|\|\|).*", text):
        raise RuntimeError(f"{function.name()}: unknown construct '{leftover[0].strip()}' in the generated code")
    return text
