"""Control laws of many members: linear ones in one computation, functions member by member.

A member's forces equal those of its own law, `laws.law_of`, up to rounding; they do not depend on the other members.
"""

from collections.abc import Callable, Mapping, Sequence
from types import FunctionType
from typing import NamedTuple, Protocol

import numpy as np

from gough_stewart.harness.control.laws import (
    ControlFunction,
    Controller,
    FunctionLaw,
    Known,
    Law,
    LinearController,
    made_from,
)
from gough_stewart.harness.control.linear_law import N_LEGS, as_slice, integrates, integrating_modes, rest
from gough_stewart.harness.control.makers import Copied, Maker, name_of
from gough_stewart.harness.control.shared_memory import Watch, functions_in
from gough_stewart.harness.control.sums import Product
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError, SharedMemoryError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.vectors import FloatArray


class LawOfMany(Law, Protocol):
    """The controllers of N members in a run; as `Law`, with a leading axis, optional for references."""

    @property
    def failures(self) -> Mapping[int, ControllerError]:
        """Members whose controller gave no forces at the last sample, with the error."""

    def force(
        self,
        k: int,
        time: float,
        reference: FloatArray,
        measured: FloatArray,
        excess: FloatArray,
        due: BoolArray | None = None,
    ) -> FloatArray:
        """Forces (N, 6) [N], valid until the next call; `due` (N,) selects the members to sample, None means all."""


def laws_together(
    controllers: Sequence[Controller],
    sample_time: float,
    jacobians: FloatArray,
    known: Sequence[Known] = (),
    copies: int = 0,
) -> Callable[[FloatArray, FloatArray], LawOfMany]:
    """Make the laws of N members from references (30,) or (N, 30) and signals (N, 24) of the first sample.

    Makers are asked then, once for each member. A function must have no memory: all members call the same one.

    Parameters
    ----------
    controllers
        One for each member: linear ones of one structure (states, inputs, signals, space), or functions, or makers.
    sample_time
        Of the run [s].
    jacobians
        Leg Jacobians in the reference poses of all samples, (n, 6, 6) or (n, N, 6, 6).
    known
        What each member's loop tells its controller; left out, nothing.
    copies
        How many copies of the last member follow, which fill up a vector: they get its forces.

    Raises
    ------
    ControllerError
        Another sample time, different structures, or FMUs.
    """
    for controller in controllers:
        _check(controller, sample_time)
    if not any(isinstance(each, Maker) for each in controllers):
        _check_alike(controllers)

    def law_from(reference: FloatArray, measured: FloatArray) -> LawOfMany:
        failures = dict[int, ControllerError]()
        made = list[LinearController | ControlFunction | None]()
        for member, each in enumerate(controllers):
            try:
                made.append(_fresh(each, sample_time))
            except ControllerError as error:
                failures[member] = error
                made.append(None)
        _check_alike([each for each in made if each is not None])
        some = next((each for each in made if isinstance(each, LinearController)), None)
        if some is None:
            watches = [Watch(each) for each in _shared(controllers, made)] if known else []
            return _Functions(made, failures, known, copies, watches)
        # a member without a controller ends at once; until then it counts with that of another
        linear = [each if isinstance(each, LinearController) else some for each in made]
        linear += [linear[-1]] * copies
        kind = _TaskLaws if some.space == "task" else _LegLaws
        law: _LegLaws | _TaskLaws = kind(linear, jacobians, reference, measured)
        law.failures = _with_copies(failures, len(made), copies)
        return law

    return law_from


def _check(controller: Controller, sample_time: float) -> None:
    if isinstance(controller, UnitController):
        raise ControllerError(
            f"{controller.path} is an FMU, which allows one instance per process; expected a linear "
            "controller or a function, class or factory for many members"
        )
    if isinstance(controller, LinearController):
        controller.check_sample_time(sample_time)


def _fresh(controller: Controller, sample_time: float) -> LinearController | ControlFunction:
    made = made_from(controller)
    _check(made, sample_time)
    assert not isinstance(made, UnitController)
    return made


def _shared(
    controllers: Sequence[Controller], made: Sequence[LinearController | ControlFunction | None]
) -> list[FunctionType]:
    """The functions that members share, and that must have no memory.

    Raises
    ------
    SharedMemoryError
        A factory that gave two members the same object.
    """
    found = dict[int, FunctionType]()
    owners = dict[int, int]()
    for member, (controller, own) in enumerate(zip(controllers, made, strict=True)):
        if own is None or isinstance(own, FunctionType):
            pass
        elif owners.setdefault(id(own), member) != member and isinstance(controller, Maker):
            raise SharedMemoryError(
                f"members {owners[id(own)]} and {member} got the same {name_of(own)}; expected a factory that makes a "
                "new controller at each call"
            )
        if isinstance(controller, Copied):
            found |= {id(each): each for each in functions_in(controller.original)}
        elif isinstance(own, FunctionType) and (not isinstance(controller, Maker) or id(own) in owners):
            found[id(own)] = own
        if own is not None:
            owners.setdefault(id(own), member)
    return list(found.values())


def _with_copies(failures: Mapping[int, ControllerError], members: int, copies: int) -> dict[int, ControllerError]:
    """The failures of members, and of the copies of the last one."""
    last = failures.get(members - 1)
    return {**failures, **({} if last is None else dict.fromkeys(range(members, members + copies), last))}


def _check_alike(controllers: Sequence[Controller]) -> None:
    found = {_structure(each) for each in controllers}
    if len(found) > 1:
        raise ControllerError(f"controllers of different structure, {'; '.join(sorted(found))}; expected one for all")


def _structure(controller: Controller) -> str:
    if not isinstance(controller, LinearController):
        return "a function"
    system = controller.system
    return (
        f"linear in {controller.space} space with {system.nstates} states, {system.ninputs} inputs and the signals "
        f"{', '.join(controller.signals)}"
    )


class _Turn(NamedTuple):
    """(x, u) of a sample, and the product that gives x⁺ and forces; samples alternate between two buffers."""

    xu: FloatArray
    x: FloatArray  # views
    u: FloatArray
    next_state: Callable[[], None]
    outputs: Callable[[], None]


class _LinearLaws:
    """As `LinearLaw`, with (x, u) of all members in columns."""

    limited = None
    failures: Mapping[int, ControllerError] = {}

    def __init__(self, controllers: Sequence[LinearController], n_members: int) -> None:
        first = controllers[0]
        # if all members have the same system, one matrix serves all
        same = all(each.system is first.system for each in controllers)
        systems = [each.system for each in (controllers[:1] if same else controllers)]
        A, B, C, D = (np.stack([getattr(system, name) for system in systems]) for name in "ABCD")
        n = first.system.nstates
        self._matrices = np.concatenate([np.concatenate([A, B], axis=2), np.concatenate([C, D], axis=2)], axis=1)
        next_state = Product(self._matrices[:, :n, :], n_members)
        outputs = Product(self._matrices[:, n:, :], n_members)
        self._y = np.zeros((N_LEGS, n_members))
        one, other = np.zeros((2, n + first.system.ninputs, n_members))
        self._now, self._next = (
            _Turn(now, now[:n], now[n:], next_state.of(now, following), outputs.of(now, self._y))
            for now, following in ((one, other), (other, one))
        )
        self.used = first.signals
        self._at = as_slice(signals.positions(first.signals))
        self._form = first.system.ninputs

    def _start(self, reference: FloatArray, measured: FloatArray) -> None:
        """Set the steady state under constant inputs."""
        n = len(self._now.x)
        self._feed(reference, measured, np.zeros((N_LEGS, 1)))
        self._now.next_state()
        forcing = self._next.x.T  # (N, n)
        A = np.broadcast_to(self._matrices[:, :n, :n], (len(forcing), n, n))
        poles = np.diagonal(A, axis1=1, axis2=2)
        free = integrates(poles)
        x = np.where(free, 0.0, forcing / np.where(free, 1.0, 1 - poles))
        for member in np.flatnonzero((A - poles[:, None] * np.eye(n)).any(axis=(1, 2))).tolist():
            x[member] = rest(A[member], integrating_modes(A[member]), forcing[member])
        self._now.x[...] = x.T

    @property
    def state(self) -> FloatArray:
        """A view of x (N, n), valid until the sample after the next."""
        return self._now.x.T

    def _feed(self, reference: FloatArray, measured: FloatArray, excess: FloatArray) -> None:
        u, n = self._now.u, len(measured)
        if self._form == n:
            np.subtract(reference, measured, out=u)
            return
        u[:n], u[n : 2 * n] = reference, measured
        if self._form > 2 * n:
            u[2 * n :] = excess

    def _advance(self, due: BoolArray | None) -> FloatArray:
        now, following = self._now, self._next
        now.outputs()
        now.next_state()
        if due is not None:
            np.copyto(following.x, now.x, where=~due)
        self._now, self._next = following, now
        return self._y


class _LegLaws(_LinearLaws):
    def __init__(
        self,
        controllers: Sequence[LinearController],
        _jacobians: FloatArray,
        reference: FloatArray,
        measured: FloatArray,
    ) -> None:
        super().__init__(controllers, len(controllers))
        self._start(_columns(reference)[self._at], measured.T[self._at])

    def force(
        self,
        _k: int,
        _time: float,
        reference: FloatArray,
        measured: FloatArray,
        excess: FloatArray,
        due: BoolArray | None = None,
    ) -> FloatArray:
        """As `LawOfMany`."""
        self._feed(_columns(reference)[self._at], measured.T[self._at], excess.T)
        return self._advance(due).T


class _TaskLaws(_LinearLaws):
    def __init__(
        self,
        controllers: Sequence[LinearController],
        jacobians: FloatArray,
        reference: FloatArray,
        measured: FloatArray,
    ) -> None:
        super().__init__(controllers, len(controllers))
        # (n, 6, 6, N), or (n, 6, 6, 1) if common to all members
        each = jacobians if jacobians.ndim == 4 else jacobians[:, None]
        self._J = np.ascontiguousarray(np.moveaxis(each, 1, -1))
        self._J_inverse = np.ascontiguousarray(np.moveaxis(np.linalg.inv(each), 1, -1))
        self._lengths = measured.T[self._at].copy()
        self._pose = np.zeros_like(self._lengths)
        self._start(_times(self._J_inverse[0], _columns(reference)[self._at] - self._lengths), self._pose)

    def force(
        self,
        k: int,
        _time: float,
        reference: FloatArray,
        measured: FloatArray,
        excess: FloatArray,
        due: BoolArray | None = None,
    ) -> FloatArray:
        """As `LawOfMany`; see `TaskLaw`."""
        lengths, J, J_inverse = measured.T[self._at], self._J[k], self._J_inverse[k]
        pose = self._pose + _times(J_inverse, lengths - self._lengths)
        error = _times(J_inverse, _columns(reference)[self._at] - lengths)
        hears = self._form > 2 * N_LEGS
        self._feed(pose + error, pose, _times(J.swapaxes(0, 1), excess.T) if hears else pose)
        everyone = True if due is None else due
        np.copyto(self._pose, pose, where=everyone)
        np.copyto(self._lengths, lengths, where=everyone)
        return _times(J_inverse.swapaxes(0, 1), self._advance(due)).T


class _Functions:
    limited = None
    used = signals.NAMES

    def __init__(
        self,
        functions: Sequence[LinearController | ControlFunction | None],
        failures: Mapping[int, ControllerError],
        known: Sequence[Known],
        copies: int,
        watches: Sequence[Watch],
    ) -> None:
        told: Sequence[Known | None] = known or [None] * len(functions)
        self._laws = [
            None if each is None or isinstance(each, LinearController) else FunctionLaw(each, of_member)
            for each, of_member in zip(functions, told, strict=True)
        ]
        self._not_made, self._copies, self._watches = failures, copies, watches
        self._samples = min((len(each.planned) for each in known), default=0)
        self._forces = np.zeros((len(self._laws) + copies, N_LEGS))
        self.failures: dict[int, ControllerError] = {}

    @property
    def state(self) -> FloatArray:
        """Empty: the memory of functions is not visible."""
        return np.zeros((len(self._forces), 0))

    def force(
        self,
        k: int,
        time: float,
        reference: FloatArray,
        measured: FloatArray,
        excess: FloatArray,
        due: BoolArray | None = None,
    ) -> FloatArray:
        """As `LawOfMany`."""
        failures = dict(self._not_made)
        each = np.broadcast_to(reference, (len(self._laws), reference.shape[-1])) if reference.ndim == 1 else reference
        for member, law in enumerate(self._laws):
            if law is None or not (due is None or due[member]):
                continue
            try:
                self._forces[member] = law.force(k, time, each[member], measured[member], excess[member])
            except ControllerError as error:
                failures[member] = error
        n = len(self._laws)
        self._forces[n:] = self._forces[n - 1]
        self.failures = _with_copies(failures, n, self._copies)
        # often at first, then less and less, and at the end: to pickle takes longer than most laws
        if (k + 1) & k == 0 or k == self._samples - 1:
            for watch in self._watches:
                watch.check()
        return self._forces


def _columns(values: FloatArray) -> FloatArray:
    """(size, N) of values of the members (N, size), or (size, 1) of values common to all (size,)."""
    return values.T if values.ndim == 2 else values[:, None]


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """M v of matrices (m, n, N) or (m, n, 1) and vectors (n, N), as a sum of columns in fixed order."""
    total: FloatArray = matrices[:, 0] * vectors[0]
    term = np.empty_like(total)
    for k in range(1, len(vectors)):
        total += np.multiply(matrices[:, k], vectors[k], out=term)
    return total
