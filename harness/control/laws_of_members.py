"""The control laws of a run's members: linear ones in one computation, functions and FMUs member by member.

A member's forces do not depend on the other members, to the last bit.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Protocol, cast

import numpy as np

from gough_stewart.harness.control.laws import (
    ControlFunction,
    Controller,
    FunctionLaw,
    Known,
    LinearController,
    MemberLaw,
    fresh_controller,
)
from gough_stewart.harness.control.linear_law import LinearLaw
from gough_stewart.harness.control.python.casadi_function import is_casadi_function
from gough_stewart.harness.control.python.makers import Copied, Maker, name_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError, SharedMemoryError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.vectors import FloatArray


class Law(Protocol):
    """The controllers of N members in a run, with their memory."""

    @property
    def used(self) -> tuple[str, ...]:
        """The signals that they use."""

    @property
    def may_overrun(self) -> bool:
        """Whether members that have ended may be sampled, as code of the user must not be."""

    @property
    def state(self) -> FloatArray:
        """Their memory (N, n_states)."""

    @property
    def limited(self) -> BoolArray | None:
        """Which forces (N, 6) they have limited themselves; None if the actuators limit them."""

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
        """Forces (N, 6) [N] at sample k, valid until the next call.

        Parameters
        ----------
        reference, measured, excess
            References (30,) or (N, 30), all signals, then the accelerations [m/s², rad/s²]; measurements (N, 24); what
            the limits cut off the last command (N, 6) [N].
        due
            The members to sample (N,); None means all.
        """


LawFrom = Callable[[FloatArray, FloatArray], Law]


@dataclass(frozen=True)
class LinearLaws:
    """A `LawFrom` of linear controllers, of which it is known before that they use these signals."""

    make: LawFrom
    used: tuple[str, ...]

    def __call__(self, reference: FloatArray, measured: FloatArray) -> Law:
        """As `LawFrom`."""
        return self.make(reference, measured)


def law_of(controller: Controller, sample_time: float, jacobians: FloatArray, known: Known | None = None) -> LawFrom:
    """`laws_of` one member.

    Raises
    ------
    ControllerError
        The controller has another sample time, or its maker fails.
    """
    make = laws_of([controller], sample_time, jacobians, () if known is None else (known,))

    def law_from(reference: FloatArray, measured: FloatArray) -> Law:
        law = make(reference, measured)
        for error in law.failures.values():
            raise error
        return law

    return law_from


def laws_of(
    controllers: Sequence[Controller],
    sample_time: float,
    jacobians: FloatArray,
    known: Sequence[Known] = (),
    copies: int = 0,
) -> LawFrom:
    """Make the laws of N members from references (30,) or (N, 30) and signals (N, 24) of the first sample.

    Makers are asked then, once for each member. All members call the same function.

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

    def law_from(reference: FloatArray, measured: FloatArray) -> Law:
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
            _check_fresh(controllers, made)
            told: Sequence[Known | None] = known or [None] * len(made)
            own = [
                None if each is None else FunctionLaw(cast("ControlFunction", each), of_member)
                for each, of_member in zip(made, told, strict=True)
            ]
            return SeparateLaws(own, failures, copies)
        # a member without a controller ends at once; until then it counts with that of another
        linear = [each if isinstance(each, LinearController) else some for each in made]
        linear += [linear[-1]] * copies
        law = LinearLaw(linear, jacobians, reference, measured)
        law.failures = _with_copies(failures, len(made), copies)
        return law

    linear = [each for each in controllers if isinstance(each, LinearController)]
    if len(linear) == len(controllers):
        return LinearLaws(law_from, linear[0].signals)
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
    made = fresh_controller(controller)
    if isinstance(made, UnitController):
        raise ControllerError("a class or factory made an FMU; expected type = 'fmu', or the path of the FMU")
    _check(made, sample_time)
    return made


def _check_fresh(controllers: Sequence[Controller], made: Sequence[LinearController | ControlFunction | None]) -> None:
    """Refuse a factory that gives two members the same object; a CasADi function keeps nothing itself.

    Raises
    ------
    SharedMemoryError
        Names both members.
    """
    owners = dict[int, int]()
    for member, (controller, law) in enumerate(zip(controllers, made, strict=True)):
        if law is None or not isinstance(controller, Maker) or is_casadi_function(law):
            continue
        owner = owners.setdefault(id(law), member)
        if owner != member:
            raise SharedMemoryError(
                f"members {owner} and {member} got the same {name_of(law)}; expected a factory that makes a new "
                "controller at each call"
            )


def shared_by_members(controller: Controller | None) -> Any:
    """A function, which all members call, or an object, whose copies share the functions in it; None of others."""
    shared = controller.original if isinstance(controller, Copied) else controller
    is_safe = shared is None or isinstance(shared, LinearController | UnitController | Maker)
    return None if is_safe or is_casadi_function(shared) else shared


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


class SeparateLaws:
    """Members' own laws, called one by one."""

    may_overrun = False

    def __init__(
        self,
        laws: Sequence[MemberLaw | None],
        failures: Mapping[int, ControllerError] = MappingProxyType({}),
        copies: int = 0,
    ) -> None:
        self._laws, self._not_made, self._copies = laws, failures, copies
        self._forces = np.zeros((len(laws) + copies, N_LEGS))
        self.failures: dict[int, ControllerError] = {}
        self.used = tuple(name for name in signals.NAMES if any(law is not None and name in law.used for law in laws))

    @property
    def traced(self) -> list[Any] | None:
        """The members' CasADi functions; None if one has another controller, or none."""
        own = [each.traced if isinstance(each, FunctionLaw) else None for each in self._laws]
        return None if any(each is None for each in own) else own + own[-1:] * self._copies

    @property
    def limited(self) -> BoolArray | None:
        """As `Law`."""
        own = [None if law is None else law.limited for law in self._laws]
        if not any(each is not None for each in own):
            return None
        none = np.zeros(N_LEGS, dtype=bool)
        return np.stack([none if each is None else each for each in [*own, *own[-1:] * self._copies]])

    @property
    def state(self) -> FloatArray:
        """Empty: the memory of functions and FMUs is not visible."""
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
        """As `Law`."""
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
        return self._forces
