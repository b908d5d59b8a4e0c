"""Laws that users wrote as CasADi functions, as one description for many members that machine code can have.

Members' functions may differ in constants, such as gains; these become coefficients.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gough_stewart.harness.control.python.casadi_function import FORCE, MEMORY, MEMORY_NEXT, OF_REFERENCE
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    import casadi

_ACCELERATIONS = ("acceleration", "angular_acceleration")


@dataclass(frozen=True)
class TracedLaw:
    """The laws of N members: one function, with coefficients of their own.

    The function `law` has one input, `memory`: states, references (24), measurements (24), the time [s], reference
    accelerations (6), coefficients. Its output `next` has six forces [N], then the next states.
    """

    function: "casadi.Function"
    n_states: int
    coefficients: FloatArray  # (k, N)


def traced_law_of(functions: Sequence["casadi.Function"]) -> TracedLaw | None:
    """The laws of members with these functions; None if they have not the same operations, or some that C lacks."""
    try:
        plain, coefficients = _with_coefficients([each.expand() for each in functions])
    except (RuntimeError, NotImplementedError):  # an interpolant, a solver
        return None
    import casadi

    kinds = {plain.instruction_id(k) for k in range(plain.n_instructions())}
    if kinds & {casadi.OP_CALL, casadi.OP_ERFINV}:
        return None
    sizes = {name: plain.numel_in(i) for i, name in enumerate(plain.name_in())}
    outputs = {name: plain.numel_out(i) for i, name in enumerate(plain.name_out())}
    n = sizes.get(MEMORY, 0)
    parts = {
        MEMORY: casadi.SX.sym("states", n),
        **{OF_REFERENCE + v.name: casadi.SX.sym("r", v.size) for v in signals.VARIABLES},
        **{v.name: casadi.SX.sym("y", v.size) for v in signals.VARIABLES},
        "time": casadi.SX.sym("t"),
        **{OF_REFERENCE + name: casadi.SX.sym("a", 3) for name in _ACCELERATIONS},
        _COEFFICIENTS: casadi.SX.sym("c", len(coefficients)),
    }
    wanted = {FORCE: N_LEGS, **({MEMORY_NEXT: n} if n else {})}
    if any(size != parts[name].numel() for name, size in sizes.items() if name in parts):
        return None
    if set(sizes) - set(parts) or {name: outputs.get(name) for name in wanted} != wanted:
        return None
    given = {name: casadi.reshape(parts[name], plain.size_in(i)) for i, name in enumerate(plain.name_in())}
    found = plain.call(given)
    following = casadi.vertcat(*(casadi.vec(casadi.densify(found[name])) for name in wanted))
    memory = casadi.vertcat(*parts.values())
    return TracedLaw(casadi.Function("law", [memory], [following], ["memory"], ["next"]), n, coefficients)


_COEFFICIENTS = "coefficients"


def _with_coefficients(functions: Sequence["casadi.Function"]) -> tuple["casadi.Function", FloatArray]:
    """A function for all, whose constants that differ are an input `coefficients`; and their values (k, N).

    Raises
    ------
    NotImplementedError
        The functions differ in more than constants.
    """
    first = functions[0]
    kinds = {each.serialize(): each for each in functions}
    if len(kinds) == 1:
        return first, np.zeros((0, len(functions)))
    import casadi

    found = {text: _constants(each) for text, each in kinds.items()}
    if len({operations for operations, _ in found.values()}) > 1:
        raise NotImplementedError
    values = np.array([found[each.serialize()][1] for each in functions]).T
    differs = (values != values[:, :1]).any(axis=1)
    numbers: Iterable[Any] = iter(values[:, 0].tolist())
    symbols = casadi.SX.sym(_COEFFICIENTS, int(differs.sum()))
    own, k = [], 0
    for differ, number in zip(differs, numbers, strict=True):
        own.append(symbols[k] if differ else number)
        k += bool(differ)
    inputs = {name: casadi.SX.sym(name, *first.size_in(i)) for i, name in enumerate(first.name_in())}
    outputs = _evaluated(first, inputs, own)
    everything = {**inputs, _COEFFICIENTS: symbols}
    law = casadi.Function("law", [*everything.values()], [*outputs.values()], [*everything], [*outputs])
    return law, values[differs]


def _constants(function: "casadi.Function") -> tuple[tuple[Any, ...], list[float]]:
    """The operations of a plain function with their places, and the values of its constants in order."""
    import casadi

    operations: list[Any] = [*map(function.size_in, range(function.n_in())), *function.name_in(), *function.name_out()]
    values = []
    for k in range(function.n_instructions()):
        kind = function.instruction_id(k)
        if kind == casadi.OP_CONST:
            values.append(float(function.instruction_constant(k)))
        operations.append((kind, *function.instruction_input(k), *function.instruction_output(k)))
    return tuple(operations), values


def _evaluated(
    function: "casadi.Function", inputs: Mapping[str, Any], constants: Iterable[Any]
) -> dict[str, "casadi.SX"]:
    """The outputs of a plain function of dense inputs, with other constants in it."""
    import casadi

    given, rest = [casadi.vec(each) for each in inputs.values()], iter(constants)
    outputs = {name: casadi.SX(*function.size_out(i)) for i, name in enumerate(function.name_out())}
    places = [_nonzeros(function.sparsity_out(i)) for i in range(function.n_out())]
    names, work = list(outputs), dict[int, Any]()
    for k in range(function.n_instructions()):
        kind, read, to = (
            function.instruction_id(k),
            function.instruction_input(k),
            function.instruction_output(k),
        )
        if kind == casadi.OP_CONST:
            work[to[0]] = casadi.SX(next(rest))
        elif kind == casadi.OP_INPUT:
            work[to[0]] = given[read[0]][_nonzero(function.sparsity_in(read[0]), read[1])]
        elif kind == casadi.OP_OUTPUT:
            outputs[names[to[0]]][places[to[0]][to[1]]] = work[read[0]]
        elif len(read) == 1:
            work[to[0]] = casadi.SX.unary(kind, work[read[0]])
        elif len(read) == 2:
            work[to[0]] = casadi.SX.binary(kind, work[read[0]], work[read[1]])
        else:
            raise NotImplementedError
    return outputs


def _nonzeros(sparsity: "casadi.Sparsity") -> list[int]:
    """The places of the elements that may be other than zero, column by column."""
    return [int(k) for k in sparsity.find()]


def _nonzero(sparsity: "casadi.Sparsity", k: int) -> int:
    return _nonzeros(sparsity)[k]
