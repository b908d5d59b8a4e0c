"""A user's controller as equations: traced with CasADi for machine code, and linearised at a working point.

What it remembers is found by calling it: the numbers in its attributes, containers and enclosed variables that change.
"""

import linecache
import re
import sys
import traceback
import warnings
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType, FunctionType, MethodType, ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gough_stewart.harness.control.laws_of_members import CalledLaw, KnownAhead
from gough_stewart.harness.control.linear_controller import Controller, LinearController, fresh_controller
from gough_stewart.harness.control.makers import Maker, Sample, is_of_user, name_of
from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.harness.control.traced_law import FORCE, MEMORY, MEMORY_NEXT, OF_REFERENCE, SIZES
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    import casadi

# Of a trace: samples of the run that it is held against, in blocks of errors of these sizes [m, rad, m/s, rad/s], and
# how far its forces may be from the class's, as a share of the largest so far.
_BLOCK, _ERRORS, _AGREES = 25, (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 1e-2, 1e-3, 1e-4), 1e-12
_SEED = 4
# Of a linearisation: samples in which the memory comes to rest, changes of signals [SI] and of states as a share, and
# of the gains, how much they may depend on the size and sign of the change; no multiples of usual steps of encoders.
_SAMPLES_TO_REST, _CHANGES, _LINEAR = 2000, (1.37e-6, 2.93e-5), 1e-3
_DRAWN, _AT_REST, _NEGLIGIBLE = 4, 1e-9, 1e-6
_BRANCHES = "write np.where(condition, a, b) in place of if, and, or; and functions of NumPy of whole signals"
_NUMBERS = (
    "float(), int() and elements of arrays of numbers hold no symbol: write arithmetic of whole signals, "
    "np.concatenate, or a list of six forces"
)
# Why a call with symbols fails, by the words of CasADi and NumPy, the first that fits.
_CAUSES = {
    "truth value": "a condition depends on a signal",
    r"'SX' object has no attribute '(\w+)'": "a signal has no '{}' in equations",
    "not iterable": "a signal is not iterable; write signal[k] for k in range(6)",
    "imension": "sizes do not fit each other",
    "SX|(?i:casadi)|slice": "a function or an index takes numbers only",
}
_START = "give it its start value in __init__, such as np.zeros(6)"

# Where a number is in a controller: names of attributes, keys and places, from the outside in.
Place = tuple[Any, ...]
Line = tuple[str, int]


# ---- what a controller remembers ----


def numbers_in(value: Any, place: Place = (), visited: set[int] | None = None) -> Iterator[tuple[Place, Any]]:
    """Numbers, arrays of numbers and symbols in an object, with their places."""
    visited = set() if visited is None else visited
    if isinstance(value, bool | int | float | np.number) or _is_symbol(value):
        yield place, value
    elif isinstance(value, np.ndarray):
        if value.dtype.kind in "biuf":
            yield place, value.copy()
    elif id(value) not in visited:
        visited.add(id(value))
        for key, part in _parts(value).items():
            yield from numbers_in(part, (*place, key), visited)


def with_numbers(value: Any, numbers: Mapping[Place, Any], place: Place = ()) -> Any:
    """The object with other numbers in these places; containers are made anew, other objects changed in place."""
    if place in numbers:
        return numbers[place]
    if not any(changed[: len(place)] == place for changed in numbers):
        return value
    parts = {key: with_numbers(part, numbers, (*place, key)) for key, part in _parts(value).items()}
    if isinstance(value, dict):
        return parts
    if isinstance(value, deque):
        return deque(parts.values(), value.maxlen)
    if isinstance(value, list | tuple):
        return type(value)(*parts.values()) if hasattr(value, "_fields") else type(value)(parts.values())
    if isinstance(value, FunctionType):
        for name, cell in zip(value.__code__.co_freevars, value.__closure__ or (), strict=True):
            cell.cell_contents = parts[name]
    elif not isinstance(value, MethodType):
        for name, part in parts.items():
            object.__setattr__(value, name, part)
    return value


def _parts(value: Any) -> dict[Any, Any]:
    """What an object of the user's holds, by name."""
    if isinstance(value, dict):
        return value
    if isinstance(value, list | tuple | deque):
        return dict(enumerate(value))
    if isinstance(value, FunctionType):
        return dict(zip(value.__code__.co_freevars, (c.cell_contents for c in value.__closure__ or ()), strict=True))
    if isinstance(value, MethodType):
        return {"__self__": value.__self__}
    return {} if isinstance(value, type | ModuleType) else dict(getattr(value, "__dict__", {}))


def _is_symbol(value: Any) -> bool:
    loaded = sys.modules.get("casadi")
    return loaded is not None and isinstance(value, loaded.SX)


def _memory(law: CalledLaw) -> dict[Place, Any]:
    """What a controller, and the loop for it, remember of the samples so far."""
    return dict(numbers_in({"law": law.function, "command": law.command}))


def _remember(law: CalledLaw, numbers: Mapping[Place, Any]) -> None:
    holder = with_numbers({"law": law.function, "command": law.command}, numbers)
    law.function, law.command = holder["law"], holder["command"]


def _changed(before: Mapping[Place, Any], after: Mapping[Place, Any]) -> set[Place]:
    places = {**before, **after}
    return {p for p in places if not np.array_equal(before.get(p, np.nan), after.get(p, np.nan))}


# ---- its small signals ----


class LinearForm(NamedTuple):
    """A controller's small signals at a working point."""

    controller: LinearController
    is_numerical: bool = False  # by differences, of a controller that is no linear system
    doubt: str = ""  # what these leave out, so that a requirement on margins is inconclusive


def linearised(  # noqa: PLR0915 - one road, in sections
    controller: Controller, known: KnownAhead, reference: FloatArray
) -> LinearForm:
    """x⁺ = A x + B y, F = C x + D y of a controller at rest in the pose of a reference (30,), by central differences.

    Its memory is what changes when it is called; first it comes to rest under constant inputs. Of two sizes of change
    and of both signs the gains have to be the same; else they are in doubt, as with a dead zone or a quantisation.
    """
    rows = (_SAMPLES_TO_REST + 2, N_LEGS)
    feedforward, planned = (np.broadcast_to(forces[0], rows) for forces in (known.feedforward, known.planned))
    law = CalledLaw(fresh_controller(controller), known._replace(feedforward=feedforward, planned=planned))
    has_rest = np.isin(np.arange(len(reference)), signals.positions(["position", "orientation", "leg_length"]))
    at_rest = np.where(has_rest, reference, 0.0)
    y, T, start = at_rest[: signals.SIZE], known.sample_time, _memory(law)

    def called(k: int, measured: FloatArray) -> FloatArray:
        return law.force(k, k * T, at_rest, measured, np.zeros(N_LEGS))

    def is_still(before: Any, after: Any) -> bool:
        if before is None or after is None or np.shape(before) != np.shape(after):
            return False
        step = np.abs(np.asarray(after, dtype=float) - np.asarray(before, dtype=float))
        return float((step / np.maximum(1.0, np.abs(after))).max(initial=0.0)) < _AT_REST

    # the memory: what changes under changing measurements; then its rest under constant ones
    drawn, states, after, k = np.random.default_rng(_SEED), set[Place](), start, 0
    for k in range(_SAMPLES_TO_REST):
        before = after
        called(k, y + (_CHANGES[0] * drawn.standard_normal(len(y)) if k < _DRAWN else 0.0))
        after = _memory(law)
        if k < _DRAWN:
            states |= _changed(before, after)
        elif all(is_still(before.get(place), after.get(place)) for place in states):
            break
    places = sorted(states & after.keys(), key=repr)
    shapes = [np.shape(after[place]) for place in places]
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]

    def flat(numbers: Mapping[Place, Any]) -> FloatArray:
        return np.concatenate([np.zeros(0), *(np.ravel(np.asarray(numbers[p], dtype=float)) for p in places)])

    def step(at: FloatArray) -> FloatArray:
        """F and x⁺ from x and y, all at the same sample."""
        parts = [part.reshape(shape)[()] for part, shape in zip(np.split(at[:n], ends), shapes, strict=False)]
        _remember(law, dict(zip(places, parts, strict=True)))
        return np.concatenate([called(k + 1, at[n:]), flat(_memory(law))])

    rest = flat(after)
    n, working_point = len(rest), np.concatenate([rest, y])
    middle = step(working_point)
    scales = np.concatenate([np.maximum(1.0, np.abs(rest)), np.ones(len(y))])
    slopes = []
    for share in _CHANGES:
        changes = share * scales
        up, down = (np.array([step(working_point + sign * row) for row in np.diag(changes)]) for sign in (1, -1))
        slopes += [(up - down).T / (2 * changes), (up - middle).T / changes, (middle - down).T / changes]
    _remember(law, start)  # of a function that all runs share
    # an integrator's 1 is 1
    gains = np.where(np.abs(slopes[0] - np.rint(slopes[0])) < _AT_REST, np.rint(slopes[0]), slopes[0])

    # states that never reach the forces, such as a count of samples, are none of the loop's
    reaches = (gains[:N_LEGS, :n] != 0).any(axis=0)
    for _ in range(n):
        reaches = reaches | (gains[N_LEGS:, :n][reaches] != 0).any(axis=0)
    chosen = np.concatenate([np.ones(N_LEGS, dtype=bool), reaches])
    if not (gains[chosen, n:] != 0).any():
        raise ControllerError(
            "the controller does not answer to small changes of the measurements at rest in the first pose of the "
            "reference, so its loop has no margins; expected feedback there"
        )
    size = np.maximum(np.abs(gains), _NEGLIGIBLE * np.abs(gains).max(axis=1, keepdims=True, initial=1e-300))
    doubt = ""
    if max(float((np.abs(slope - gains) / size)[chosen].max()) for slope in slopes) > _LINEAR:
        doubt = "the controller's gains depend on the size or the sign of a small change"
    elif ((np.abs(middle[N_LEGS:] - rest) / scales[:n])[reaches] > _AT_REST).any():
        doubt = f"the controller's memory does not come to rest in {_SAMPLES_TO_REST} samples of constant signals"
    gains = gains[chosen]
    used = tuple(name for name in signals.NAMES if (gains[:, n:][:, signals.positions([name])] != 0).any())
    # inputs are references, which do not change, and measurements
    inputs = gains[:, n:][:, signals.positions(used)]
    inputs = np.concatenate([np.zeros_like(inputs), inputs], axis=1)
    A, C = gains[N_LEGS:, :n][:, reaches], gains[:N_LEGS, :n][:, reaches]
    system = StateSpace(A, inputs[N_LEGS:], C, inputs[:N_LEGS], T)
    return LinearForm(LinearController(system, signals=used), is_numerical=True, doubt=doubt)


# ---- its function ----


def traced_function(controller: Controller, known: KnownAhead, reference: FloatArray) -> "casadi.Function":
    """The CasADi function of a controller whose call is arithmetic; it has the same names as a `Sample`.

    Its memory is the change since the start of what changes between samples. It is traced at the first and at a later
    sample, and its forces are held against the controller's over a run with these references (m, 30) at its samples, in
    which they pass their limits.
    """
    shape = (_BLOCK * len(_ERRORS), N_LEGS)
    feedforward, planned = (np.resize(forces, shape) for forces in (known.feedforward, known.planned))
    known = known._replace(feedforward=feedforward, planned=planned)
    first, later = fresh_controller(controller), fresh_controller(controller)
    name = name_of(later).removeprefix("object of ")
    law = CalledLaw(later, known)
    start = _memory(law)
    expected, states = _driven(law, known, reference)
    if states and not isinstance(controller, Maker):
        _remember(law, start)
        raise ControllerError(f"{name} keeps memory; expected a class or a factory, of which each run gets its own")

    # the start values of states, in the shapes that they have later
    after, starts = _memory(law), dict[Place, FloatArray]()
    for place in states:
        shapes = [np.shape(numbers.get(place, np.zeros(0))) for numbers in (start, after)]
        if place in start and place in after and shapes[0] in ((), shapes[1]) and len(shapes[1]) <= 2:
            starts[place] = np.broadcast_to(np.asarray(start[place], dtype=float), shapes[1])
    (_, first_way), (function, way) = (_trace(one, name, starts, known) for one in (first, later))
    if first_way != way:
        ends = min(len(first_way), len(way))
        shared = next((k for k in range(ends) if first_way[k] != way[k]), ends)
        why = "goes another way at the first sample than at later ones"
        raise _refusal(name, first_way[max(0, shared - 1)], why, f"{_START}, and {_BRANCHES}")
    for place in states:
        if place not in starts:
            before, later_shape = (np.shape(numbers.get(place, np.zeros(0))) for numbers in (start, after))
            raise ControllerError(
                f"{name} cannot be traced: {'.'.join(['self', *map(str, place[1:])])} has the shape {before} before "
                f"the first sample and {later_shape} later; expected numbers of one shape, and at most two axes: "
                f"{_START}"
            )

    # the forces of both in the same run
    forces, _ = _driven(CalledLaw(function, known), known, reference)
    largest = np.maximum.accumulate(np.abs(expected).max(axis=1))
    apart = np.abs(forces - expected).max(axis=1)
    for k in np.flatnonzero(~(apart <= _AGREES * largest)).tolist():
        raise ControllerError(
            f"{name} cannot be traced: at sample {k} of a run the traced law differs from it by {apart[k]:.3g} N, of "
            f"forces of {largest[k]:.3g} N; expected the same arithmetic: no arrays that are changed in place under "
            "two names, no random numbers, and nothing that is decided by a value"
        )
    return function


def _driven(law: CalledLaw, known: KnownAhead, reference: FloatArray) -> tuple[FloatArray, list[Place]]:
    """Forces (m, 6) [N] and states of a controller in a run whose errors grow until forces pass their limits."""
    drawn, states, limit = np.random.default_rng(_SEED), set[Place](), known.force_limit
    after, forces, excess = _memory(law), np.zeros((_BLOCK * len(_ERRORS), N_LEGS)), np.zeros(N_LEGS)
    for k in range(len(forces)):
        row, before = reference[k % len(reference)], after
        measured = row[: signals.SIZE] + _ERRORS[k // _BLOCK] * drawn.standard_normal(signals.SIZE)
        forces[k] = law.force(k, k * known.sample_time, row, measured, excess)
        if not np.isfinite(limit) and k == 3 * _BLOCK:  # a limit that some of what follows passes
            limit = float(np.abs(forces[k]).max())
        excess = np.clip(law.command, -limit, limit) - law.command
        after = _memory(law)
        states |= {place for place in _changed(before, after) if place[0] == "law"}
    return forces, sorted(states, key=repr)


class _LostError(Exception):
    """A symbol became a number that is none, at a line."""


def _trace(  # noqa: PLR0915 - one road, in sections
    law: Any, name: str, start_values: Mapping[Place, FloatArray], known: KnownAhead
) -> tuple["casadi.Function", list[Line]]:
    """The function of a controller as it is now, and the lines of the user's that its call passed."""
    import casadi

    starts = {place: casadi.DM(np.atleast_1d(value)) for place, value in start_values.items()}
    changes = {place: casadi.SX.sym("change", *value.shape) for place, value in starts.items()}
    inputs: dict[str, Any] = {key: casadi.SX.sym(key, size) for key, size in SIZES.items()}
    sample = Sample(
        reference={key.removeprefix(OF_REFERENCE): v for key, v in inputs.items() if key.startswith(OF_REFERENCE)},
        measured={key: inputs[key] for key in signals.NAMES},
        index=casadi.floor(inputs["time"] / known.sample_time + 0.5),
        sample_time=known.sample_time,  # a number, as in __init__
        platform=known.platform,
        gains=known.gains,
        **{key: inputs[key] for key in ("time", "command", "excess", "feedforward", "force_limit", "rate_limit")},
    )
    holder = with_numbers({"law": law}, {place: changes[place] + start for place, start in starts.items()})
    lines = list[Line]()

    def passes(frame: FrameType, event: str, argument: Any) -> Any:
        if not is_of_user(frame):
            return None
        if event == "line":
            lines.append((frame.f_code.co_filename, frame.f_lineno))
        # what was lost at a line, as `float` makes NaN of a symbol, is seen at the next one
        for value in [argument] if event == "return" else frame.f_locals.values():
            is_number = isinstance(value, float | np.ndarray) and np.asarray(value).dtype.kind == "f"
            if is_number and np.isnan(value).any():
                raise _LostError(lines[-1 if event == "return" else -2])
        return passes

    tracer = sys.gettrace()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # CasADi's, of the functions of NumPy that it takes over
        sys.settrace(passes)
        try:
            result = holder["law"](sample)
        except _LostError as error:
            raise _refusal(name, error.args[0], "makes no number of a symbol", _NUMBERS) from None
        except (Exception, SystemExit) as error:  # user code may raise anything when it is called with symbols
            of_user = [at for at in traceback.walk_tb(error.__traceback__) if is_of_user(at[0])]
            line = (of_user[-1][0].f_code.co_filename, of_user[-1][1]) if of_user else ("", 0)
            causes = ((re.search(pattern, str(error)), words) for pattern, words in _CAUSES.items())
            why = next((words.format(*at.groups()) for at, words in causes if at), f"{type(error).__name__}: {error}")
            raise _refusal(name, line, why, _BRANCHES) from None
        finally:
            sys.settrace(tracer)
    after = dict(numbers_in(holder))
    try:
        force = _column(result, (N_LEGS, 1))
        following = [casadi.vec(_column(after[place], start.shape) - start) for place, start in starts.items()]
    except (NotImplementedError, TypeError, RuntimeError, KeyError):
        has_symbols = any(_is_symbol(value) for _, value in numbers_in([result]))
        raise ControllerError(
            f"{name} cannot be traced: it returned {'other values' if has_symbols else repr(result)}; expected "
            f"{N_LEGS} forces, and a memory of one shape"
        ) from None
    outputs = {FORCE: force, **({MEMORY_NEXT: casadi.vertcat(*following)} if starts else {})}
    all_outputs = casadi.vertcat(*outputs.values())
    arguments = {key: symbol for key, symbol in inputs.items() if casadi.depends_on(all_outputs, symbol)}
    arguments |= {MEMORY: casadi.vertcat(*map(casadi.vec, changes.values()))} if starts else {}
    try:
        function = casadi.Function("law", [*arguments.values()], [*outputs.values()], [*arguments], [*outputs])
    except RuntimeError:  # symbols of the other trace
        raise ControllerError(f"{name} cannot be traced: it keeps memory in a global; expected it in self") from None
    constants = [k for k in range(function.n_instructions()) if function.instruction_id(k) == casadi.OP_CONST]
    if any(np.isnan(function.instruction_constant(k)) for k in constants):
        raise ControllerError(f"{name} cannot be traced: its forces are not a number; {_NUMBERS}")
    return function, lines


def _column(value: Any, shape: Sequence[int]) -> Any:
    """A matrix of symbols of a shape: of a signal, a list, or a number for all elements."""
    import casadi

    matrix = casadi.vertcat(*value) if isinstance(value, list | tuple) else value
    matrix = casadi.SX(np.atleast_1d(matrix) if isinstance(matrix, np.ndarray) else matrix)
    if matrix.numel() == 1:
        return casadi.repmat(matrix, *shape)
    if matrix.shape != tuple(shape):
        raise TypeError
    return matrix


def _refusal(name: str, line: Line, why: str, remedy: str) -> ControllerError:
    file, number = line
    code = linecache.getline(file, number).strip()
    place = f"{Path(file).name}, line {number}{f': `{code}`' if code else ''}" if number else "its call"
    return ControllerError(f"{name} cannot be traced: {place}: {why}; expected arithmetic without branches: {remedy}")
