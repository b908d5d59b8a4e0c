"""Control laws that can be exported: PD and PID, discrete systems, CasADi functions; each as symbolic equations.

A law says which of its numbers stay tunable: its settings.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough_stewart.harness.control.component import Link, Parameter, with_links
from gough_stewart.harness.control.laws_of_members import integrating_modes, integrators, rest
from gough_stewart.harness.control.linear_controller import LinearController, Space
from gough_stewart.harness.control.pid import DerivativeOn, Gains, channel_matrices
from gough_stewart.harness.control.state_space import Method, StateSpace, matrices_at
from gough_stewart.harness.control.traced_law import FORCE, MEMORY, MEMORY_NEXT, SIZES
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.export import symbols
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.parameters import Bound, Variability, Variable
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import Array, FloatArray

# Tolerance beyond the unit circle, needed for chains of integrators, whose eigenvalues are rounded.
_ROUNDING = 1e-6


class ExportSetting(NamedTuple):
    """A parameter of the exported controller, with its designed value: in C a field of a struct."""

    variable: Variable
    value: FloatArray  # in the variable's shape
    # C conditions on the struct `parameters`, besides finite values and the variable's bound
    conditions: tuple[str, ...] = ()
    may_be_infinite: bool = False  # a limit; none is 0, or infinite
    largest: float = LARGEST_NUMBER  # magnitude of an element
    expected: str = ""  # the conditions in the user's words; by default as they are


def setting(
    name: str,
    unit: str,
    bound: Bound,
    description: str,
    value: ArrayLike,
    *,
    variability: Variability = "tunable",
    conditions: Iterable[str] = (),
    **more: Any,
) -> ExportSetting:
    """A setting with the shape of its value; `more` are other fields."""
    value = np.asarray(value, dtype=float)
    variable = Variable(name, value.shape, unit, "parameter", variability, description, lower_bound=bound)
    return ExportSetting(variable, value, tuple(conditions), **more)


def setting_of(parameter: Parameter, value: ArrayLike, more: str = "") -> ExportSetting:
    """The setting of a component's parameter, with more words in its description."""
    name, unit = parameter.name, parameter.unit
    is_limit = parameter.none is not None and math.isinf(parameter.none)
    # at least a thousandth, written so that it holds for float and for double
    condition = "!(value > 0) || value * 1000 >= 1" if is_limit else parameter.condition
    named = {"value": f"parameters->{name}", "sample_time": "parameters->sample_time"}
    condition = re.sub(r"\b(value|sample_time)\b", lambda word: named[word[0]], condition)
    return setting(
        *(name, unit, parameter.bound, parameter.description + more, value),
        conditions=(condition,) if condition else (),
        may_be_infinite=is_limit,
        expected=f"0, which is none, or at least 0.001 {unit}" if is_limit else parameter.expected,
    )


@dataclass(frozen=True, eq=False)
class Law:
    """What all laws say of themselves."""

    name: str  # for display
    signals: tuple[str, ...]  # that it uses
    space: Space = "leg"  # of its output forces
    settings: tuple[ExportSetting, ...] = ()
    fixes_sample_time: bool = False  # whether its numbers are valid for one sample time


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedLaw(Law):
    """x⁺ = A x + B u, w = C x + D u, as numbers and as symbols of coefficients."""

    system: StateSpace
    kinds: int  # of inputs, as of `LinearController`
    start: Array  # (n, inputs): the steady state under constant inputs u is start @ u, with integrators at zero
    integrating: Array  # (n, n): projection on the modes of the integrators
    symbols: casadi.SX  # the coefficients (k,)
    coefficients: casadi.Function | None = None  # settings -> coefficients


def pid_law(
    gains: Gains,
    derivative_on: DerivativeOn,
    discretisation: Method,
    space: Space,
    sample_time: float,
    links: tuple[Link, ...] = (),
) -> ExportedLaw:
    """PD or PID: its gains stay tunable; which channels have derivative and integral action is fixed."""
    kp, kd, ki, filter_time, tracking_time = gains.channels
    acts = differentiates, integrates = kd > 0, ki > 0
    units = ("N/m", "N.s/m", "N/(m.s)") if space == "leg" else ("", "", "")
    channel = "of each leg" if space == "leg" else "of each axis, three of force and three of torque"

    # gains, and the related times
    def gain(name: str, unit: str, bound: Bound, value: Any, acts: NDArray[np.bool_]) -> ExportSetting:
        """Of six channels, of which those that do not act have none."""
        none = [f"!(parameters->{name}_gain[{k}] > 0)" for k in np.flatnonzero(~acts)]
        return setting(f"{name}_gain", unit, bound, f"{name} gain {channel}", value, conditions=none)

    settings = [gain("proportional", units[0], "> 0", kp, np.ones(N_LEGS, dtype=bool))]
    if differentiates.any():
        sampled = ["parameters->derivative_filter >= parameters->sample_time / 2"]
        settings += [
            gain("derivative", units[1], ">= 0", kd, differentiates),
            setting(
                *("derivative_filter", "s", "> 0", "time constant of the derivative filter"),
                filter_time[0],
                conditions=sampled if discretisation == "tustin" else (),
            ),
        ]
    if integrates.any():
        late = [f"parameters->anti_windup_time[{k}] >= parameters->sample_time" for k in np.flatnonzero(integrates)]
        text = "time constant of back-calculation at a limit"
        settings += [
            gain("integral", units[2], ">= 0", ki, integrates),
            setting("anti_windup_time", "s", "> 0", text, tracking_time, conditions=late),
        ]
    settings += [setting_of(p, getattr(link, p.key)) for link in links for p in link.parameters()]

    # its matrices, discretised by the function that discretises the controller in Python
    inputs = {s.variable.name: casadi.SX.sym(s.variable.name, s.variable.size) for s in settings}
    inputs["sample_time"] = casadi.SX.sym("sample_time")
    values, zeros = {key: symbols.elements(v) for key, v in inputs.items()}, np.array([casadi.SX(0)] * N_LEGS)
    names = ("proportional_gain", "derivative_gain", "integral_gain", "derivative_filter", "anti_windup_time")
    # one value for all, or one each
    of_channels = [np.asarray(values[name] + zeros) if name in values else zeros for name in names]
    T = values["sample_time"]
    traced = matrices_at(channel_matrices(of_channels, derivative_on, acts), T, discretisation, symbols.solve)
    of_links = [(type(link), {p.key: values[p.name] for p in link.parameters()}) for link in links]
    traced = with_links(traced, of_links, T, symbols.solve)
    A = matrices_at(channel_matrices(gains.channels, derivative_on), sample_time, discretisation).A
    # the integrators are states whose rows are those of the unit matrix, whatever the gains; links have none
    alone = [*(np.eye(len(A)) == A).all(axis=1), *[False] * (len(traced.A) - len(A))]

    # one symbol for each distinct value in the matrices
    entries = symbols.elements(casadi.cse(symbols.column(np.concatenate([b.reshape(-1) for b in traced.blocks]))))
    distinct = {entry.element_hash(): entry for entry in entries if not entry.is_constant()}
    c, places = casadi.SX.sym("coefficients", len(distinct)), {key: place for place, key in enumerate(distinct)}
    flat = np.array([float(e) if e.is_constant() else c[places[e.element_hash()]] for e in entries], dtype=object)
    parts = np.split(flat, np.cumsum([b.size for b in traced.blocks])[:-1])
    blocks = [part.reshape(b.shape) for part, b in zip(parts, traced.blocks, strict=True)]
    system = StateSpace(blocks[0], blocks[1], blocks[2], blocks[3], 1.0)
    start = integrating = system.B
    if len(traced.A):
        # a mode is an integrator at 1 with what it leaves in all other states: x = A x there
        unit = np.diag(np.array(alone, dtype=float))
        integrating = symbols.solve(np.eye(len(traced.A)) - system.A + unit, unit)
        start = rest(system.A, unit, system.B, symbols.solve)
    name = f"{'PID' if integrates.any() else 'PD'} in {space} space"
    return ExportedLaw(
        " with ".join([name, *(f"a {link.name}" for link in links)]),
        ("leg_length",),
        space,
        tuple(settings),
        system=system,
        kinds=system.D.shape[1] // N_LEGS,
        start=start,
        integrating=integrating,
        symbols=c,
        coefficients=symbols.function("coefficients_of_law", inputs, {"law": casadi.vertcat(*distinct.values())}),
    )


def matrix_law(controller: LinearController) -> ExportedLaw:
    """A discrete linear system with constant matrices."""
    A, B, C, D = (np.asarray(getattr(controller.system, name), dtype=float) for name in "ABCD")
    poles = np.linalg.eigvals(A)
    worst = complex(poles[np.abs(poles).argmax()]) if len(poles) else 0j
    if abs(worst) > 1 + _ROUNDING:
        raise ExportError(
            f"the controller itself is unstable: it has an eigenvalue z = {worst:.6g} with |z| = "
            f"{abs(worst):.6g}; expected none outside the unit circle, since its state would grow for any "
            "measurement; redesign it with more damping or less gain"
        )
    integrating = integrating_modes(A) if len(A) else A
    return ExportedLaw(
        f"a discrete linear system in {controller.space} space",
        controller.signals,
        controller.space,
        fixes_sample_time=controller.sample_time is not None,
        system=StateSpace(A, B, C, D, 1.0),
        kinds=controller.kinds,
        start=rest(A, integrators(integrating), B) if len(A) else B,
        integrating=integrating,
        symbols=casadi.SX.sym("coefficients", 0),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class FunctionLaw(Law):
    """A CasADi function, see `function_law`; its state is its memory, with the last command if it takes that."""

    function: casadi.Function  # of plain operations
    constants: Mapping[str, int]  # its inputs that are settings or made of them, with their sizes
    memory: int  # size

    @property
    def n_states(self) -> int:
        """Size of its state."""
        return self.memory + N_LEGS * ("command" in self.function.name_in())

    @cached_property
    def coefficients(self) -> casadi.Function | None:
        """Settings -> `constants`, one after the other; a limit of 0 is none."""
        if not self.constants:
            return None
        named = {_LIMITS.get(name, name): casadi.SX.sym(name, size) for name, size in self.constants.items()}
        values = [casadi.if_else(s > 0, s, np.inf) if name in _LIMITS.values() else s for name, s in named.items()]
        return symbols.function("coefficients_of_law", named, {"law": casadi.vertcat(*values)})

    def __call__(self, values: Mapping[str, casadi.SX]) -> tuple[casadi.SX, casadi.SX]:
        """Forces and next states, from symbols by name: `states`, `coefficients`, and those of its inputs."""
        f = self.function
        memory, command = casadi.vertsplit(values["states"], [0, self.memory, self.n_states])
        ends = np.cumsum([0, *self.constants.values()]).tolist()
        constants = dict(zip(self.constants, casadi.vertsplit(values["coefficients"], ends), strict=True))
        parts = {**values, **constants, MEMORY: memory, "command": command}
        outputs = f.call({name: casadi.reshape(parts[name], f.size_in(k)) for k, name in enumerate(f.name_in())})
        force, following = casadi.vec(outputs[FORCE]), [casadi.vec(outputs.get(MEMORY_NEXT, casadi.SX(0, 1)))]
        if command.numel():
            following.append(values["feedforward"] + force)
        return force, casadi.vertcat(*following)


# Inputs of a function and the settings that they are.
_LIMITS = {"force_limit": "force_limit", "rate_limit": "force_rate_limit"}


def function_law(f: casadi.Function, gains: Mapping[str, Any], name: str, *, fixes_sample_time: bool) -> FunctionLaw:
    """The law of a CasADi function from named inputs to `actuator_force` (6,) [N].

    Inputs may be time; the measurements position, orientation, velocity, angular_velocity, leg_length, leg_velocity;
    the same with the prefix `reference_`, and reference_acceleration, reference_angular_acceleration; command, excess,
    feedforward, sample_time, force_limit and rate_limit of the loop, as a `Sample` has them; and the names of `gains`.
    State is an input `memory` with an output `memory_next` of the same length; it begins at zero.
    """
    known = SIZES | {key: int(np.size(value)) for key, value in gains.items()}
    inputs = {key: f.numel_in(k) for k, key in enumerate(f.name_in())}
    outputs = {key: f.numel_out(k) for k, key in enumerate(f.name_out())}
    for key, size in inputs.items():
        if key != MEMORY and key not in known:
            raise ExportError(
                f"the CasADi function has the input '{key}'; expected one of {', '.join(known)}, {MEMORY}"
            )
        if key != MEMORY and size != known[key]:
            raise ExportError(f"the CasADi function's input '{key}' has {size} elements; expected {known[key]}")
    expected = {FORCE: N_LEGS} | ({MEMORY_NEXT: inputs[MEMORY]} if MEMORY in inputs else {})
    if outputs != expected:
        raise ExportError(
            f"the CasADi function has the outputs {outputs}; expected {expected}, names and sizes"
            + ("" if MEMORY in inputs else f"; {MEMORY_NEXT} needs an input {MEMORY}")
        )
    try:
        plain = f.expand()
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise ExportError(
            f"the CasADi function cannot be expanded to plain operations ({reason}); expected one without "
            "solvers, tables or callbacks"
        ) from None

    # refuse what is not an operation of C: calls, which remain of tables, and functions that its library lacks
    signals_of = dict[int, frozenset[str]]()  # by the place of a value in memory
    for k in range(plain.n_instructions()):
        kind, read = plain.instruction_id(k), plain.instruction_input(k)
        if kind == casadi.OP_INPUT:
            names = frozenset([plain.name_in()[read[0]]])
        elif kind in (casadi.OP_CONST, casadi.OP_PARAMETER):
            names = frozenset()
        else:
            names = frozenset().union(*(signals_of.get(place, frozenset()) for place in read))
        if kind in (casadi.OP_CALL, casadi.OP_ERFINV):
            read_from = " and ".join(sorted(names)) or "constants"
            if kind == casadi.OP_ERFINV:
                raise ExportError(
                    f"the CasADi function has erfinv of {read_from}, which C lacks; expected other operations"
                )
            tables = ", ".join(sorted(f"'{called.name()}'" for called in f.find_functions())) or "a function"
            raise ExportError(
                f"the CasADi function looks {read_from} up in {tables}, an interpolant or another call that is not "
                "plain operations; expected plain ones: casadi.pw_lin(x, points, values) with SX is the same as a "
                "linear interpolant of one input, and polynomials take the place of splines and of tables with more "
                "inputs"
            )
        if kind != casadi.OP_OUTPUT:
            signals_of |= dict.fromkeys(plain.instruction_output(k), names)
    return FunctionLaw(
        name,
        tuple(key for key in signals.NAMES if key in inputs),
        settings=tuple(setting(key, "", None, f"{key} of the law", gains[key]) for key in inputs if key in gains),
        fixes_sample_time=fixes_sample_time,
        function=plain,
        constants={key: size for key, size in inputs.items() if key in ("sample_time", *_LIMITS, *gains)},
        memory=inputs.get(MEMORY, 0),
    )
