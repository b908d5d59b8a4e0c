"""C source of the kernel: CasADi's straight-line code, with plain signatures (c/kernel.h)."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence

import casadi

from gough_stewart.model import kernel

_NUMBER = r"[0-9]+"
_BODY = re.compile(r"static int casadi_f(\d+)\([^{]*\{\n(.*?)\n  return 0;\n\}\n", re.S)
_ASSIGNMENT = re.compile(r"  (a\d+)=")
_QUOTIENT = re.compile(r"(  a\d+)=\((a\d+)/(a\d+)\);")
_HEAD = """/* Generated from the Python source of the physics, gough_stewart.model.kernel: do not edit. */
#include "kernel.h"

#include <math.h>

static double sq(double x)
{
    return x * x;
}
"""


def kernel_source() -> str:
    """`kernel.c`: the functions that c/kernel.h declares."""
    functions = (
        kernel.derivatives_function(),
        kernel.outputs_function(),
        kernel.forward_function(),
        kernel.reverse_function(),
        kernel.legs_function(),
    )
    return _HEAD + "".join(function_source(f) for f in functions)


def function_source(function: casadi.Function) -> str:
    """One CasADi SX Function as `void kernel_NAME(const double in0[], …, double out0[], …)`.

    Raises
    ------
    RuntimeError
        CasADi wrote something that is not known to be straight-line arithmetic.
    """
    generator = casadi.CodeGenerator("kernel", {"with_export": False})
    generator.add(function)
    bodies = _BODY.findall(generator.dump())
    if len(bodies) != 1:
        raise RuntimeError(f"{function.name()}: expected one straight-line function, found {len(bodies)}")
    inputs, outputs = function.name_in(), function.name_out()
    # a name may stand for an input of one function and an output of another, never for both
    body = re.sub(rf"arg\[({_NUMBER})\]\? arg\[\1\]\[({_NUMBER})\] : 0", _element(inputs), bodies[0][1])
    body = re.sub(rf"if \(res\[({_NUMBER})\]!=0\) res\[\1\]\[({_NUMBER})\]=", _element(outputs, "="), body)
    body = with_reciprocals(body.replace("casadi_real", "double").replace("casadi_sq(", "sq("))
    leftover = re.search(r"casadi|\barg\b|\bres\b|\biw\b|\bif\b|\?", body)
    if leftover:
        raise RuntimeError(f"{function.name()}: unknown construct '{leftover[0]}' in the generated code")
    arguments = [f"const double {name}[]" for name in inputs] + [f"double {name}[]" for name in outputs]
    return f"\nvoid kernel_{function.name()}({', '.join(arguments)})\n{{\n{body}\n}}\n"


def with_reciprocals(body: str) -> str:
    """Straight-line code in which repeated division by one value is multiplication with its reciprocal.

    CasADi writes x·(1/L) as x/L, and a division costs four multiplications: the derivatives hold 88, by 15 values.
    A value is a name and how often it has been assigned before.
    """
    lines = body.splitlines()
    divisors = list(_divisors(lines))
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
    names = f"  double {', '.join(reciprocals.values())};"
    return "\n".join([names, *written] if reciprocals else written)


def _divisors(lines: list[str]) -> Iterator[tuple[str, int] | None]:
    """For each line the value that it divides by, if it is a quotient of two names."""
    assigned = Counter[str]()
    for line in lines:
        quotient, assignment = _QUOTIENT.fullmatch(line), _ASSIGNMENT.match(line)
        yield (quotient[3], assigned[quotient[3]]) if quotient else None
        if assignment:
            assigned[assignment[1]] += 1


def _element(names: Sequence[str], suffix: str = "") -> "re._ReplacementT":  # type: ignore[name-defined]
    return lambda match: f"{names[int(match[1])]}[{match[2]}]{suffix}"
