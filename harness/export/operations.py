"""Floating-point operations per step."""

import re

import casadi

from gough_stewart.fmu_build.codegen import function_source
from gough_stewart.harness.export.trace import Traced

# Not counted: CasADi's reads, writes and copies.
_FREE = {casadi.OP_CONST, casadi.OP_INPUT, casadi.OP_OUTPUT, casadi.OP_ASSIGN, casadi.OP_PARAMETER}
_SIMPLE = {
    *(casadi.OP_ADD, casadi.OP_SUB, casadi.OP_MUL, casadi.OP_NEG, casadi.OP_SQ, casadi.OP_TWICE),
    *(casadi.OP_LT, casadi.OP_LE, casadi.OP_EQ, casadi.OP_NE, casadi.OP_NOT, casadi.OP_AND, casadi.OP_OR),
    *(casadi.OP_FMIN, casadi.OP_FMAX, casadi.OP_IF_ELSE_ZERO, casadi.OP_FABS),
}
SIMPLE, DIVISIONS, OTHERS = (
    "additions, multiplications and comparisons",
    "divisions and square roots",
    "other functions",
)
# Of the hand-written code for six forces: sums and checks for finite values, of which there may be many of inputs and
# states; and the search in a table.
_A_FORCE, _A_CHECK, _A_SEARCH, _A_PIECE = 8, 2, 40, 6 * (5 + 4 + 3) * 2
_A_LAW = 25


def operations_of(functions: Traced) -> dict[str, int]:
    """Floating-point operations per step, at most, by kind."""
    law = functions.law
    n_checked = (
        0 if law is None else sum(map(law.numel_in, range(law.n_in()))) + sum(map(law.numel_out, range(law.n_out())))
    )
    total = {SIMPLE: 6 * _A_FORCE + _A_CHECK * n_checked, DIVISIONS: 0, OTHERS: 0}
    motions = 0
    if functions.motion is not None:
        motions = (functions.feedforward is not None) + (functions.law is not None)
        if functions.motion.name() == "motion_of_table":
            total[SIMPLE] += motions * (_A_SEARCH + _A_PIECE)
        if functions.path is not None:  # at both ends of a piece
            total[SIMPLE] += motions * 2 * (_A_SEARCH + 2 * _A_LAW + _A_PIECE)
    used = [
        functions.extrapolated,
        functions.feedforward,
        functions.start,
        functions.expected,
        functions.law,
        *(each.step for each in functions.components),
        *[functions.motion] * motions,
        *[functions.path] * 2 * motions,
    ]
    for function in used:
        for kind, n in _counts(function).items():
            total[kind] += n
    return total


def words_of(counts: dict[str, int]) -> str:
    """A text for the header of the source."""
    return f"at most {sum(counts.values())} floating-point operations, of them " + ", ".join(
        f"{n} {kind}" for kind, n in counts.items() if kind != SIMPLE
    )


# In the written code, where several quotients of one divisor are products with its reciprocal.
_RECIPROCAL, _PRODUCT = re.compile(r"^  r\d+=1/", re.M), re.compile(r"\*r\d+\);$", re.M)


def _counts(function: casadi.Function | None) -> dict[str, int]:
    found = {SIMPLE: 0, DIVISIONS: 0, OTHERS: 0}
    if function is None:
        return found
    for k in range(function.n_instructions()):
        kind = function.instruction_id(k)
        if kind in _FREE:
            continue
        name = (
            SIMPLE
            if kind in _SIMPLE
            else DIVISIONS
            if kind in {casadi.OP_DIV, casadi.OP_SQRT, casadi.OP_INV}
            else OTHERS
        )
        found[name] += 1
    if found[DIVISIONS]:
        code = function_source(function, conditions=True)
        products = len(_PRODUCT.findall(code))
        found[SIMPLE] += products
        found[DIVISIONS] += len(_RECIPROCAL.findall(code)) - products
    return found
