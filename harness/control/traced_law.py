"""Laws that users wrote as CasADi functions, called in a run, and as one description that machine code can have.

Members' functions may differ in constants, such as gains; these become coefficients.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    import casadi

    from gough_stewart.harness.control.makers import Sample

# Names of a function's inputs and outputs, besides signals and `time`.
MEMORY, MEMORY_NEXT, FORCE, OF_REFERENCE = "memory", "memory_next", "actuator_force", "reference_"
# What a function may take, as a `Sample` has it, with the number of elements.
SIZES = {
    "time": 1,
    **{v.name: v.size for v in signals.VARIABLES},
    **{OF_REFERENCE + v.name: v.size for v in signals.REFERENCES},
    **dict.fromkeys(("command", "excess", "feedforward"), N_LEGS),
    **dict.fromkeys(("sample_time", "force_limit", "rate_limit"), 1),
}
# Of these, what machine code has, in its order.
_IN_ORDER = (
    *(OF_REFERENCE + name for name in signals.NAMES),
    *(*signals.NAMES, "time", f"{OF_REFERENCE}acceleration", f"{OF_REFERENCE}angular_acceleration"),
)
_COEFFICIENTS = "coefficients"


def is_casadi_function(controller: Any) -> "TypeGuard[casadi.Function]":
    """Whether an object is one; without an import, since who has one has imported CasADi."""
    loaded = sys.modules.get("casadi")
    return loaded is not None and isinstance(controller, loaded.Function)


class CasadiFunction:
    """A control function that calls a CasADi function; its memory begins at zero."""

    def __init__(self, function: "casadi.Function") -> None:
        self.function, names = function, function.name_in()
        self._memory = np.zeros(function.numel_in(names.index(MEMORY)) if MEMORY in names else 0)

    def __call__(self, sample: "Sample") -> FloatArray:
        """Forces (6,) at a sample."""
        references = {OF_REFERENCE + name: value for name, value in sample.reference.items()}
        by_name = {**sample.gains, **sample._asdict(), MEMORY: self._memory, **sample.measured, **references}
        known, inputs = (*sample.gains, *SIZES, MEMORY), dict[str, FloatArray]()
        for k, name in enumerate(self.function.name_in()):
            if name not in known:
                raise ControllerError(
                    f"the CasADi function has the input '{name}'; expected one of {', '.join(known)}, or a gain of "
                    "[controller.parameters]"
                )
            inputs[name] = np.reshape(np.asarray(by_name[name], dtype=float), self.function.size_in(k), order="F")
        outputs = {name: np.asarray(value).ravel(order="F") for name, value in self.function.call(inputs).items()}
        self._memory = outputs.get(MEMORY_NEXT, self._memory)
        return np.asarray(outputs[FORCE], dtype=float)


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
        plain, coefficients = _with_coefficients([function.expand() for function in functions])
    except (RuntimeError, NotImplementedError):  # an interpolant, a solver
        return None
    import casadi

    if {plain.instruction_id(k) for k in range(plain.n_instructions())} & {casadi.OP_CALL, casadi.OP_ERFINV}:
        return None
    sizes = {name: plain.numel_in(i) for i, name in enumerate(plain.name_in())}
    outputs = {name: plain.numel_out(i) for i, name in enumerate(plain.name_out())}
    n = sizes.get(MEMORY, 0)
    parts = {
        MEMORY: casadi.SX.sym("states", n),
        **{name: casadi.SX.sym(name, SIZES[name]) for name in _IN_ORDER},
        _COEFFICIENTS: casadi.SX.sym("c", len(coefficients)),
    }
    needed = {FORCE: N_LEGS, **({MEMORY_NEXT: n} if n else {})}
    if any(name not in parts or size != parts[name].numel() for name, size in sizes.items()):
        return None
    if {name: outputs.get(name) for name in needed} != needed:
        return None
    inputs = {name: casadi.reshape(parts[name], plain.size_in(i)) for i, name in enumerate(plain.name_in())}
    results = plain.call(inputs)
    following = casadi.vertcat(*(casadi.vec(casadi.densify(results[name])) for name in needed))
    memory = casadi.vertcat(*parts.values())
    return TracedLaw(casadi.Function("law", [memory], [following], ["memory"], ["next"]), n, coefficients)


def _with_coefficients(functions: Sequence["casadi.Function"]) -> tuple["casadi.Function", FloatArray]:
    """A function for all, whose constants that differ are an input `coefficients`; and their values (k, N)."""
    import casadi

    first = functions[0]
    distinct = {function.serialize(): function for function in functions}
    if len(distinct) == 1:
        return first, np.zeros((0, len(functions)))

    # the same operations in the same places, and the constants in order
    operations, constants_of = set[tuple[Any, ...]](), dict[str, list[float]]()
    for text, function in distinct.items():
        steps = range(function.n_instructions())
        operations.add(
            (
                *map(function.size_in, range(function.n_in())),
                *(*function.name_in(), *function.name_out()),
                *((function.instruction_id(k), *function.instruction_input(k), *function.instruction_output(k))
                  for k in steps),
            )
        )  # fmt: skip
        of_function = [k for k in steps if function.instruction_id(k) == casadi.OP_CONST]
        constants_of[text] = [float(function.instruction_constant(k)) for k in of_function]
    if len(operations) > 1:
        raise NotImplementedError
    values = np.array([constants_of[function.serialize()] for function in functions]).T
    differs = (values != values[:, :1]).any(axis=1)
    symbols = casadi.SX.sym(_COEFFICIENTS, int(differs.sum()))
    constants: list[Any] = values[:, 0].tolist()
    for k, place in enumerate(np.flatnonzero(differs).tolist()):
        constants[place] = symbols[k]

    # the first function again, of dense inputs and with symbols for constants; of sparse matrices, the places of the
    # elements that may be other than zero, column by column
    inputs = {name: casadi.SX.sym(name, *first.size_in(i)) for i, name in enumerate(first.name_in())}
    outputs = {name: casadi.SX(*first.size_out(i)) for i, name in enumerate(first.name_out())}
    read_at = [first.sparsity_in(i).find() for i in range(first.n_in())]
    written_at = [first.sparsity_out(i).find() for i in range(first.n_out())]
    arguments, numbers = [casadi.vec(symbols_of_one) for symbols_of_one in inputs.values()], iter(constants)
    names, work = list(outputs), dict[int, Any]()
    for k in range(first.n_instructions()):
        kind, read, to = first.instruction_id(k), first.instruction_input(k), first.instruction_output(k)
        if kind == casadi.OP_CONST:
            work[to[0]] = casadi.SX(next(numbers))
        elif kind == casadi.OP_INPUT:
            work[to[0]] = arguments[read[0]][int(read_at[read[0]][read[1]])]
        elif kind == casadi.OP_OUTPUT:
            outputs[names[to[0]]][int(written_at[to[0]][to[1]])] = work[read[0]]
        elif len(read) == 1:
            work[to[0]] = casadi.SX.unary(kind, work[read[0]])
        elif len(read) == 2:
            work[to[0]] = casadi.SX.binary(kind, work[read[0]], work[read[1]])
        else:
            raise NotImplementedError
    all_inputs = {**inputs, _COEFFICIENTS: symbols}
    law = casadi.Function("law", [*all_inputs.values()], [*outputs.values()], [*all_inputs], [*outputs])
    return law, values[differs]
