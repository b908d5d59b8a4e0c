"""C source of the kernel: CasADi's straight-line code, with plain signatures (c/kernel.h)."""

import re
from collections.abc import Sequence

import casadi

from gough_stewart.model import kernel

_NUMBER = r"[0-9]+"
_BODY = re.compile(r"static int casadi_f(\d+)\([^{]*\{\n(.*?)\n  return 0;\n\}\n", re.S)
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
    body = body.replace("casadi_real", "double").replace("casadi_sq(", "sq(")
    leftover = re.search(r"casadi|\barg\b|\bres\b|\biw\b|\bif\b|\?", body)
    if leftover:
        raise RuntimeError(f"{function.name()}: unknown construct '{leftover[0]}' in the generated code")
    arguments = [f"const double {name}[]" for name in inputs] + [f"double {name}[]" for name in outputs]
    return f"\nvoid kernel_{function.name()}({', '.join(arguments)})\n{{\n{body}\n}}\n"


def _element(names: Sequence[str], suffix: str = "") -> "re._ReplacementT":  # type: ignore[name-defined]
    return lambda match: f"{names[int(match[1])]}[{match[2]}]{suffix}"
