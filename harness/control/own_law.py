"""A user's controller as equations: traced with CasADi for machine code, and linearised at a working point.

What it remembers is found by calling it: the numbers in its attributes, containers and enclosed variables that change.
"""

import linecache
import sys
import traceback
import warnings
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, FunctionType, MethodType, ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gough_stewart.harness.control.laws import ControlFunction, Controller, LinearController, fresh_controller
from gough_stewart.harness.control.laws_of_members import CalledLaw, KnownAhead
from gough_stewart.harness.control.makers import Maker, Sample, name_of
from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.harness.control.traced_law import ACCELERATIONS, FORCE, MEMORY, MEMORY_NEXT, OF_REFERENCE
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
_AT_REST, _NEGLIGIBLE = 1e-9, 1e-6
_LIBRARIES = frozenset(("casadi", "numpy", __name__.partition(".")[0]))
_WRITE = "write np.where(condition, a, b) in place of if, and, or; and functions of NumPy of whole signals"
_BY_ELEMENT = (
    "float(), int() and elements of arrays of numbers hold no symbol: write arithmetic of whole signals, "
    "np.concatenate, or a list of six forces"
)

# Where a number is in a controller: names of attributes, keys and places, from the outside in.
Place = tuple[Any, ...]


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
        for key, part in _parts(value):
            yield from numbers_in(part, (*place, key), visited)


def with_numbers(value: Any, numbers: Mapping[Place, Any], place: Place = ()) -> Any:
    """The object with other numbers in these places; containers are made anew, other objects changed in place."""
    if place in numbers:
        return numbers[place]
    if not any(other[: len(place)] == place for other in numbers):
        return value
    parts = {key: with_numbers(part, numbers, (*place, key)) for key, part in _parts(value)}
    if isinstance(value, dict):
        return {**value, **parts}
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


def _parts(value: Any) -> list[tuple[Any, Any]]:
    """What an object of the user's holds, by name."""
    if isinstance(value, dict):
        return list(value.items())
    if isinstance(value, list | tuple | deque):
        return list(enumerate(value))
    if isinstance(value, FunctionType):
        return list(zip(value.__code__.co_freevars, (c.cell_contents for c in value.__closure__ or ()), strict=True))
    if isinstance(value, MethodType):
        return [("__self__", value.__self__)]
    return [] if isinstance(value, type | ModuleType) else list(getattr(value, "__dict__", {}).items())


def _is_symbol(value: Any) -> bool:
    loaded = sys.modules.get("casadi")
    return loaded is not None and isinstance(value, loaded.SX)


def _memory(law: CalledLaw) -> dict[Place, Any]:
    """What a controller, and the loop for it, remember of the samples so far."""
    return dict(numbers_in({"law": law.function, "command": law.command}))


def _remember(law: CalledLaw, numbers: Mapping[Place, Any]) -> None:
    holder = with_numbers({"law": law.function, "command": law.command}, numbers)
    law.function, law.command = holder["law"], holder["command"]


class LinearForm(NamedTuple):
    """A controller's small signals at a working point."""

    controller: LinearController
    is_numerical: bool = False  # by differences, of a controller that is no linear system
    doubt: str = ""  # what these leave out, so that a requirement on margins cannot be told


def linearised(  # noqa: PLR0915 - one road, in sections
    controller: Controller, known: KnownAhead, reference: FloatArray
) -> LinearForm:
    """x⁺ = A x + B y, F = C x + D y of a controller at rest in the pose of a reference (30,), by central differences.

    Its memory is what changes when it is called; first it comes to rest under constant inputs. Of two sizes of change
    and of both signs the gains have to be the same; else they are in doubt, as with a dead zone or a quantisation.

    Raises
    ------
    ControllerError
        It fails, or does not answer to the measurements.
    """
    most = _SAMPLES_TO_REST + 10
    constant = {name: np.broadcast_to(getattr(known, name)[0], (most, N_LEGS)) for name in ("feedforward", "planned")}
    law = CalledLaw(fresh_controller(controller), known._replace(**constant))
    at_rest = reference.copy()
    has_rest = np.isin(np.arange(len(at_rest)), signals.positions(["position", "orientation", "leg_length"]))
    at_rest[~has_rest] = 0.0
    y, T, start = at_rest[: signals.SIZE], known.sample_time, _memory(law)

    def called(k: int, measured: FloatArray) -> FloatArray:
        return law.force(k, k * T, at_rest, measured, np.zeros(N_LEGS))

    # the memory: what changes under changing measurements, then its rest under constant ones
    drawn, states, after, k = np.random.default_rng(_SEED), set[Place](), start, 0
    for k in range(4):
        before = after
        called(k, y + _CHANGES[0] * drawn.standard_normal(len(y)))
        after = _memory(law)
        states |= {place for place in after if not np.array_equal(before.get(place), after[place])}
    for k in range(4, _SAMPLES_TO_REST):
        before = after
        called(k, y)
        after = _memory(law)
        if all(_change(before.get(place), after[place]) < _AT_REST for place in states & after.keys()):
            break
    places = sorted(states & after.keys(), key=repr)
    shapes = [np.shape(after[place]) for place in places]
    rest = np.concatenate([np.zeros(0), *(np.ravel(np.asarray(after[place], dtype=float)) for place in places)])
    n, ends = len(rest), np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]

    def step(at: FloatArray) -> FloatArray:
        """F and x⁺ from x and y, all at the same sample."""
        parts = [part.reshape(shape)[()] for part, shape in zip(np.split(at[:n], ends), shapes, strict=False)]
        _remember(law, dict(zip(places, parts, strict=True)))
        force, following = called(k + 1, at[n:]), _memory(law)
        return np.concatenate([force, *(np.ravel(np.asarray(following[place], dtype=float)) for place in places)])

    working_point = np.concatenate([rest, y])
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
    apart = max(float((np.abs(slope - gains) / size)[chosen].max()) for slope in slopes)
    moves = (np.abs(middle[N_LEGS:] - rest) / scales[:n])[reaches]
    doubt = ""
    if apart > _LINEAR:
        doubt = "the controller's gains depend on the size or the sign of a small change"
    elif (moves > _AT_REST).any():
        doubt = f"the controller's memory does not come to rest in {_SAMPLES_TO_REST} samples of constant signals"
    gains = gains[chosen]
    A, B = gains[N_LEGS:, :n][:, reaches], gains[N_LEGS:, n:]
    C, D = gains[:N_LEGS, :n][:, reaches], gains[:N_LEGS, n:]
    used = tuple(
        name for name in signals.NAMES if any((block[:, signals.positions([name])] != 0).any() for block in (B, D))
    )
    read = signals.positions(used)
    # inputs are references, which do not change, and measurements
    B, D = (np.concatenate([np.zeros((len(block), len(read))), block[:, read]], axis=1) for block in (B, D))
    return LinearForm(LinearController(StateSpace(A, B, C, D, T), signals=used), True, doubt)


def _change(before: Any, after: Any) -> float:
    """The largest change, as a share."""
    if np.shape(before) != np.shape(after):
        return np.inf
    size = np.abs(np.asarray(after, dtype=float) - np.asarray(before, dtype=float))
    return float((size / np.maximum(1.0, np.abs(after))).max(initial=0.0))


@dataclass
class _Seen:
    """What a controller did at the samples of a run."""

    rows: list[tuple[Any, ...]]  # arguments of its samples: index, reference, measured, excess, command
    forces: FloatArray  # (m, 6) [N]
    starts: dict[Place, Any]  # its memory before the first sample
    later: dict[Place, Any]
    states: list[Place]


def traced_function(controller: Controller, known: KnownAhead, reference: FloatArray) -> "casadi.Function":
    """The CasADi function of a controller whose call is arithmetic; it has the same names as a `Sample`.

    Its memory is the change since the start of what changes between samples. It is traced at the first and at a later
    sample, and its forces are held against the controller's over a run in which these pass their limits.

    Parameters
    ----------
    reference
        References at the samples of a run (m, 30).

    Raises
    ------
    ControllerError
        It cannot be traced: names the line, and what to write instead.
    """
    first, later = fresh_controller(controller), fresh_controller(controller)
    name = name_of(later).removeprefix("object of ")
    n = _BLOCK * len(_ERRORS)
    again = {name: np.resize(getattr(known, name), (n, N_LEGS)) for name in ("feedforward", "planned")}
    known = known._replace(**again)
    law = CalledLaw(later, known)
    start = _memory(law)
    seen = _driven(law, known, reference)
    if seen.states and not isinstance(controller, Maker):
        _remember(law, start)
        raise ControllerError(f"{name} keeps memory; expected a class or a factory, of which each run gets its own")
    functions, lines = [], []
    for law in (first, later):
        function, path = _trace(law, name, seen, known)
        functions.append(function)
        lines.append(path)
    if lines[0] != lines[1]:
        shared = 0
        while shared < min(map(len, lines)) and lines[0][shared] == lines[1][shared]:
            shared += 1
        raise _refusal(
            name,
            lines[0][max(0, shared - 1)],
            "goes another way at the first sample than at later ones",
            f"give each attribute its start value in __init__, such as np.zeros(6), and {_WRITE}",
        )
    _check_memory(name, seen)
    _hold_against(functions[1], name, seen, known)
    return functions[1]


def _driven(law: CalledLaw, known: KnownAhead, reference: FloatArray) -> _Seen:
    """A run of a controller with errors that grow until its forces pass their limits, and then fall."""
    drawn = np.random.default_rng(_SEED)
    starts = {place: np.array(number) for place, number in _memory(law).items()}
    before, states, forces = starts, dict[Place, None](), list[FloatArray]()
    rows, excess, later = [], np.zeros(N_LEGS), starts
    limit = known.force_limit
    for k, feedforward in enumerate(known.feedforward):
        wanted = reference[k % len(reference)]
        measured = wanted[: signals.SIZE] + _ERRORS[k // _BLOCK] * drawn.standard_normal(signals.SIZE)
        command = law.command
        forces.append(law.force(k, k * known.sample_time, wanted, measured, excess))
        rows.append((k, wanted, measured, excess, command, feedforward))
        if not np.isfinite(limit) and k == 3 * _BLOCK:  # limits that some of what follows passes
            limit = float(np.abs(forces[-1]).max())
        excess = np.clip(law.command, -limit, limit) - law.command
        later = {place: np.array(number) for place, number in _memory(law).items()}
        for place in {**before, **later}:
            if not np.array_equal(before.get(place), later.get(place)):
                states[place] = None
        before = later
    return _Seen(rows, np.array(forces), starts, later, [place for place in states if place[:1] == ("law",)])


def _check_memory(name: str, seen: _Seen) -> None:
    """Refuse memory without a start value, or of a size that changes."""
    for place in seen.states:
        attribute = ".".join(["self", *map(str, place[1:])])
        if place not in seen.later or place not in seen.starts:
            raise ControllerError(
                f"{name} cannot be traced: {attribute} is no number at some samples; expected numbers of one size from "
                f"the start on: give it its start value in __init__, such as np.zeros(6)"
            )
        start, later = seen.starts[place], seen.later[place]
        if later.ndim > 2 or start.size not in (1, later.size):
            raise ControllerError(
                f"{name} cannot be traced: {attribute} has the shape {start.shape} at first and {later.shape} later; "
                "expected one size from the start on, and at most two axes"
            )


def _trace(
    law: ControlFunction, name: str, seen: _Seen, known: KnownAhead
) -> tuple["casadi.Function", list[tuple[str, int]]]:
    """The function of a controller as it is now, and the lines of the user's that its call passed."""
    import casadi

    # of memory without a start value it is said after both traces, which tell the line that asks for it
    states = [place for place in seen.states if place in seen.starts and place in seen.later]
    states = [place for place in states if seen.starts[place].size in (1, seen.later[place].size)]
    shapes = [seen.later[place].shape for place in states]
    sizes = [int(np.prod(shape)) for shape in shapes]
    memory = casadi.SX.sym(MEMORY, sum(sizes))
    starts = [np.broadcast_to(seen.starts[place], shape) for place, shape in zip(states, shapes, strict=True)]
    parts = [
        casadi.reshape(change, *_matrix(shape)) + casadi.DM(start.reshape(_matrix(shape)))
        for change, shape, start in zip(
            casadi.vertsplit(memory, np.cumsum([0, *sizes]).tolist()) if sizes else [], shapes, starts, strict=True
        )
    ]
    inputs, sample = _symbols(known)
    holder = with_numbers({"law": law}, dict(zip(states, parts, strict=True)))
    lines = list[tuple[str, int]]()

    def passes(frame: FrameType, event: str, _argument: Any) -> Any:
        if str(frame.f_globals.get("__name__", "")).partition(".")[0] in _LIBRARIES:
            return None
        if event == "line":
            lines.append((frame.f_code.co_filename, frame.f_lineno))
            lost = next((v for v in frame.f_locals.values() if _is_lost(v)), None)
            if lost is not None and len(lines) > 1:
                raise _LostError(lines[-2])
        elif event == "return" and _is_lost(_argument):
            raise _LostError(lines[-1])
        return passes

    tracer = sys.gettrace()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # CasADi's, of the functions of NumPy that it takes over
        sys.settrace(passes)
        try:
            result = holder["law"](sample)
        except _LostError as error:
            raise _refusal(name, error.line, "makes no number of a symbol", _BY_ELEMENT) from None
        except (Exception, SystemExit) as error:  # user code may raise anything when it is called with symbols
            raise _refusal(
                name, _line_of(error, lines), f"{type(error).__name__}: {_in_one_line(error)}", _WRITE
            ) from None
        finally:
            sys.settrace(tracer)
    after, following = dict(numbers_in(holder)), []
    for place, shape, start in zip(states, shapes, starts, strict=True):
        following.append(
            casadi.vec(_symbolic(after.get(place, np.nan), shape) - casadi.DM(start.reshape(_matrix(shape))))
        )
    try:
        force = _symbolic(result, (N_LEGS,))
    except (NotImplementedError, TypeError, RuntimeError):
        raise ControllerError(f"{name} cannot be traced: it returned {result!r}; expected {N_LEGS} forces") from None
    outputs = {FORCE: force, **({MEMORY_NEXT: casadi.vertcat(*following)} if sizes else {})}
    everything = casadi.vertcat(*map(casadi.vec, outputs.values()))
    taken = {key: symbol for key, symbol in inputs.items() if casadi.depends_on(everything, symbol)}
    taken |= {MEMORY: memory} if sizes else {}
    function = casadi.Function("law", [*taken.values()], [*outputs.values()], [*taken], [*outputs])
    constants = [k for k in range(function.n_instructions()) if function.instruction_id(k) == casadi.OP_CONST]
    if any(np.isnan(function.instruction_constant(k)) for k in constants):
        raise ControllerError(f"{name} cannot be traced: its forces are not a number; {_BY_ELEMENT}")
    return function, lines


def _symbols(known: KnownAhead) -> tuple[dict[str, Any], Sample]:
    """The inputs of a traced law by name, and a sample of them; the sample time is a number, as in `__init__`."""
    import casadi

    sizes = {v.name: v.size for v in signals.VARIABLES}
    inputs = {
        "time": casadi.SX.sym("time"),
        **{name: casadi.SX.sym(name, size) for name, size in sizes.items()},
        **{OF_REFERENCE + name: casadi.SX.sym(name, size) for name, size in sizes.items()},
        **{OF_REFERENCE + name: casadi.SX.sym(name, 3) for name in ACCELERATIONS},
        **{name: casadi.SX.sym(name, N_LEGS) for name in ("command", "excess", "feedforward")},
        **{name: casadi.SX.sym(name) for name in ("force_limit", "rate_limit")},
    }
    sample = Sample(
        inputs["time"],
        {name: inputs[OF_REFERENCE + name] for name in (*sizes, *ACCELERATIONS)},
        {name: inputs[name] for name in sizes},
        casadi.floor(inputs["time"] / known.sample_time + 0.5),
        known.sample_time,
        inputs["command"],
        inputs["excess"],
        inputs["feedforward"],
        known.platform,
        inputs["force_limit"],
        inputs["rate_limit"],
        known.gains,
    )
    return inputs, sample


class _LostError(Exception):
    """A symbol became a number that is none, in the line before."""

    def __init__(self, line: tuple[str, int]) -> None:
        super().__init__()
        self.line = line


def _is_lost(value: Any) -> bool:
    """Whether a number or an array is NaN, as `float` makes it of a symbol."""
    if isinstance(value, float):
        return value != value  # noqa: PLR0124 - NaN
    return isinstance(value, np.ndarray) and value.dtype.kind == "f" and bool(np.isnan(value).any())


def _symbolic(value: Any, shape: Sequence[int]) -> Any:
    """A matrix of symbols of a shape: of a signal, a list, or a number for all elements."""
    import casadi

    if isinstance(value, list | tuple):
        value = casadi.vertcat(*value)
    matrix = casadi.SX(np.atleast_1d(value) if isinstance(value, np.ndarray) else value)
    rows, columns = _matrix(shape)
    if matrix.numel() == 1:
        return casadi.repmat(matrix, rows, columns)
    if matrix.shape != (rows, columns):
        raise TypeError
    return matrix


def _matrix(shape: Sequence[int]) -> tuple[int, int]:
    """Of CasADi, which has two axes."""
    rows, columns = (*shape, 1, 1)[:2]
    return rows, columns


def _hold_against(function: "casadi.Function", name: str, seen: _Seen, known: KnownAhead) -> None:
    """Refuse a function whose forces in the run differ from the controller's."""
    memory: Any = np.zeros(function.numel_in(MEMORY) if MEMORY in function.name_in() else 0)
    largest = 0.0
    for (k, wanted, measured, excess, command, feedforward), expected in zip(seen.rows, seen.forces, strict=True):
        values = {
            "time": k * known.sample_time,
            **_by_name(measured),
            **{OF_REFERENCE + key: value for key, value in _by_name(wanted).items()},
            **dict(
                zip((OF_REFERENCE + key for key in ACCELERATIONS), np.split(wanted[signals.SIZE :], 2), strict=True)
            ),
            "command": command,
            "excess": excess,
            "feedforward": feedforward,
            "force_limit": known.force_limit,
            "rate_limit": known.rate_limit,
            MEMORY: memory,
        }
        outputs = function.call({key: values[key] for key in function.name_in()})
        memory = outputs.get(MEMORY_NEXT, memory)
        force = np.asarray(outputs[FORCE], dtype=float).ravel()
        largest = max(largest, float(np.abs(expected).max()))
        gap = float(np.abs(force - expected).max())
        if not gap <= _AGREES * largest:
            raise ControllerError(
                f"{name} cannot be traced: at sample {k} of a run the traced law differs from it by {gap:.3g} N, of "
                f"forces of {largest:.3g} N; expected the same arithmetic: no arrays that are changed in place under "
                "two names, no random numbers, and nothing that is decided by a value"
            )


def _by_name(values: FloatArray) -> dict[str, FloatArray]:
    return {variable.name: values[signals.positions([variable.name])] for variable in signals.VARIABLES}


def _line_of(error: BaseException, lines: Sequence[tuple[str, int]]) -> tuple[str, int]:
    """The user's line at which it was raised."""
    for frame, number in reversed(list(traceback.walk_tb(error.__traceback__))):
        if str(frame.f_globals.get("__name__", "")).partition(".")[0] not in _LIBRARIES:
            return frame.f_code.co_filename, number
    return lines[-1] if lines else ("", 0)


def _in_one_line(error: BaseException) -> str:
    text = str(error).strip().splitlines()
    return text[-1].rpartition(": ")[2] if text else ""


def _refusal(name: str, line: tuple[str, int], why: str, remedy: str) -> ControllerError:
    file, number = line
    code = linecache.getline(file, number).strip()
    place = f"{Path(file).name}, line {number}{f': `{code}`' if code else ''}" if number else "its call"
    return ControllerError(f"{name} cannot be traced: {place}: {why}; expected arithmetic without branches: {remedy}")
