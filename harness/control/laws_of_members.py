"""The control laws of a run's members: linear ones in one computation, functions and FMUs member by member.

A member's forces do not depend on the other members, to the last bit. What a linear controller gets, `inputs_of`, and
what task space makes of the legs, `displacements`, are stated here once, for the arrays of a run, for CasADi symbols
and for small signals.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.control.linear_controller import Controller, LinearController, fresh_controller
from gough_stewart.harness.control.makers import NO_FORCE, Maker, Sample, copied, name_of, place_in_code
from gough_stewart.harness.control.state_space import Solve, stacked_blocks
from gough_stewart.harness.control.traced_law import CasadiFunction, is_casadi_function
from gough_stewart.harness.control.unit_controller import UnitController, UnitLaw
from gough_stewart.harness.errors import ControllerError, SharedMemoryError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import nearest_angle
from gough_stewart.model.vectors import FloatArray

# Limit on (1 − z)² of a pole that counts as an integrator: it leaks at most 1e-6 of itself per sample.
_INTEGRATES = 1e-12
# Above what rounding leaves of a 0 in a projection.
_TAKES = 1e-9


class KnownAhead(NamedTuple):
    """What a loop knows in advance and tells its controllers."""

    platform: Platform  # the nominal model
    sample_time: float  # [s]
    feedforward: FloatArray  # at every sample (m, 6) [N]
    planned: FloatArray  # the same with the injection (m, 6) [N]
    force_limit: float = np.inf  # [N]
    rate_limit: float = np.inf  # [N/s]
    gains: Mapping[str, Any] = MappingProxyType({})  # the parameters of the controller's table


# From the references and signals of the first sample.
LawFrom = Callable[[FloatArray, FloatArray], "Law"]


def laws_of(
    controllers: Sequence[Controller],  # one for each member
    sample_time: float,  # of the run [s]
    jacobians: FloatArray,  # of the legs in the reference poses of all samples, (n, 6, 6) or (n, N, 6, 6)
    known: Sequence[KnownAhead] = (),  # what each member's loop tells its controller; by default nothing
    copies: int = 0,  # of the last member that follow, which fill up a vector: they get its forces
) -> LawFrom:
    """Make the laws of N members from references (30,) or (N, 30) and signals (N, 24) of the first sample.

    Controllers are linear ones of one structure (states, inputs, signals, space), or functions, or makers. Makers are
    asked then, once for each member. All members call the same function.
    """
    _check([controller for controller in controllers if not isinstance(controller, Maker)], sample_time)
    members = np.minimum(np.arange(len(controllers) + copies), len(controllers) - 1)

    def law_from(reference: FloatArray, measured: FloatArray) -> "Law":
        fresh, failures, owners = dict[int, Any](), dict[int, ControllerError](), dict[int, int]()
        for member, controller in enumerate(controllers):
            try:
                law = fresh_controller(controller)
                if isinstance(law, LinearController):
                    law.check_sample_time(sample_time)
                fresh[member] = law
            except ControllerError as error:
                failures[member] = error
                continue
            # a CasADi function keeps nothing itself
            is_made = isinstance(controller, Maker) and not isinstance(law, LinearController)
            if is_made and not is_casadi_function(law) and (owner := owners.setdefault(id(law), member)) != member:
                raise SharedMemoryError(
                    f"members {owner} and {member} got the same {name_of(law)}; expected a factory that makes a new "
                    "controller at each call"
                )
        _check(list(fresh.values()), sample_time)
        linear = [law for law in fresh.values() if isinstance(law, LinearController)]
        if linear:
            # a member without a controller ends at once; until then it counts with that of another
            law_of_all = LinearLaw([fresh.get(k, linear[0]) for k in members.tolist()], jacobians, reference, measured)
            law_of_all.failures = {k: failures[m] for k, m in enumerate(members.tolist()) if m in failures}
            return law_of_all
        called: list[CalledLaw | UnitLaw | None] = [
            CalledLaw(fresh[k], known[k] if known else None) if k in fresh else None for k in range(len(controllers))
        ]
        return SeparateLaws(called, failures, copies)

    return law_from


def _check(controllers: Sequence[Controller], sample_time: float) -> None:
    """Refuse FMUs, other sample times, and different structures, which those of makers show when they are made."""
    structures = set[tuple[Any, ...]]()
    for controller in controllers:
        if isinstance(controller, UnitController):
            raise ControllerError(
                f"{controller.path} is an FMU, which allows one instance per process; expected a linear "
                "controller or a function, class or factory for many members"
            )
        structure: tuple[Any, ...] = ()
        if isinstance(controller, LinearController):
            controller.check_sample_time(sample_time)
            system = controller.system
            structure = controller.space, len(system.A), system.D.shape[1], controller.signals
        structures.add(structure)
    if len(structures) > 1:
        words = [
            f"linear in {one[0]} space with {one[1]} states, {one[2]} inputs and the signals {', '.join(one[3])}"
            if one
            else "a function"
            for one in structures
        ]
        raise ControllerError(f"controllers of different structure, {'; '.join(sorted(words))}; expected one for all")


def shared_by_members(controller: Controller | None) -> Any:
    """A function, which all members call, or an object, whose copies share the functions in it; None of others."""
    shared = controller.original if isinstance(controller, Maker) else controller
    is_safe = shared is None or isinstance(shared, LinearController | UnitController) or is_casadi_function(shared)
    return None if is_safe else shared


class CalledLaw:
    """A control function during a run of one member; exceptions and invalid results become errors of the controller."""

    limited = None
    used = signals.NAMES

    def __init__(self, function: Any, known: KnownAhead | None = None) -> None:
        # a CasADi function, which is all that there is to the law
        self.traced = function if is_casadi_function(function) else None
        self.function = function if self.traced is None else CasadiFunction(function)
        self._known = known
        self.command = NO_FORCE

    def force(self, k: int, time: float, reference: FloatArray, measured: FloatArray, excess: FloatArray) -> FloatArray:
        """Forces (6,) [N] at sample k, from references (30,), measurements (24,) and the last excess (6,) [N]."""
        by_name = interface.unpack(signals.REFERENCES, reference.copy())
        sample = Sample(time, by_name, interface.unpack(signals.VARIABLES, measured.copy()), k)
        if (known := self._known) is not None:
            last = self.command.copy(), excess.copy(), known.feedforward[k].copy()
            limits = known.force_limit, known.rate_limit
            sample = Sample(*sample[:4], known.sample_time, *last, known.platform, *limits, known.gains)
        try:
            result = self.function(sample)
        except (Exception, SystemExit) as error:  # user code may raise anything
            raise ControllerError(
                f"the control function failed at time {time:g} s with {type(error).__name__}: {error}"
                f"{place_in_code(error)}"
            ) from error
        try:
            force = np.array(result)
        except ValueError:  # ragged
            force = np.zeros(0)
        if force.dtype.kind not in "iuf" or force.shape != (N_LEGS,):
            raise ControllerError(
                f"the control function returned {result!r} at time {time:g} s; expected {N_LEGS} forces"
            )
        if self._known is not None:
            self.command = self._known.planned[k] + force  # in this order, as the loop adds them
        return force.astype(float)

    def asked(self, *arguments: Any) -> FloatArray:
        """What `force` would give; the memory stays as it is, in an object or in what a function encloses."""
        function, command = self.function, self.command
        cells = getattr(function, "__closure__", None) or ()
        contents = [cell.cell_contents for cell in cells]
        try:
            copies = [copied(content).original for content in contents]
            self.function = copied(function).original
        except ControllerError as error:
            raise ControllerError(
                f"{name_of(function)} cannot be asked while it is off, which needs a copy of it: {error.__cause__}; "
                "expected a controller without locks and open files, or no change with enabled = false"
            ) from error
        try:
            for cell, content in zip(cells, copies, strict=True):
                cell.cell_contents = content
            return self.force(*arguments)
        finally:
            self.function, self.command = function, command
            for cell, content in zip(cells, contents, strict=True):
                cell.cell_contents = content


class SeparateLaws:
    """Members' own laws, called one by one; members that have ended are not sampled, which user code must not be."""

    def __init__(
        self,
        laws: Sequence[CalledLaw | UnitLaw | None],
        failures: Mapping[int, ControllerError] = MappingProxyType({}),  # of members whose maker gave none
        copies: int = 0,  # of the last member
    ) -> None:
        self._laws, self._not_made, self.failures = laws, failures, dict[int, ControllerError]()
        self._members = np.minimum(np.arange(len(laws) + copies), len(laws) - 1)
        self._forces = np.zeros((len(laws), N_LEGS))
        self.used = tuple(name for name in signals.NAMES if any(law is not None and name in law.used for law in laws))
        # the members' CasADi functions; None if one has another controller, or none
        functions = [law.traced if isinstance(law, CalledLaw) else None for law in laws]
        self.traced = None if any(f is None for f in functions) else [functions[k] for k in self._members.tolist()]
        # the memory of functions and FMUs is not visible
        self.state: FloatArray = np.zeros((0, len(self._members)))

    @property
    def limited(self) -> BoolArray | None:
        """Which forces (N, 6) they have limited themselves; None if the actuators limit them."""
        flags = [None if law is None else law.limited for law in self._laws]
        if all(of_member is None for of_member in flags):
            return None
        none = np.zeros(N_LEGS, dtype=bool)
        return np.stack([none if of_member is None else of_member for of_member in flags])[self._members]

    def force(
        self,
        k: int,
        time: float,
        reference: FloatArray,
        measured: FloatArray,
        excess: FloatArray,
        due: BoolArray | None = None,
        off: BoolArray | None = None,
    ) -> FloatArray:
        """Forces (N, 6) [N] at sample k, by references (30,) or (N, 30), readings (N, 24) and excess (N, 6) [N].

        Of the members that are `due` (N,), by default all; `off` are those of them that are switched off, which are
        only asked. Members that gave none are in `failures`.
        """
        failures = dict(self._not_made)
        references = np.broadcast_to(reference, (len(measured), reference.shape[-1]))
        for member, law in enumerate(self._laws):
            if law is not None and (due is None or due[member]):
                is_off = off is not None and off[member]
                force = law.asked if is_off and isinstance(law, CalledLaw) else law.force
                try:
                    self._forces[member] = force(k, time, references[member], measured[member], excess[member])
                except ControllerError as error:
                    failures[member] = error
        self.failures = {k: failures[m] for k, m in enumerate(self._members.tolist()) if m in failures}
        return self._forces[self._members]

    def hear(self, commands: FloatArray) -> None:
        """Tell the functions the commands (N, 6) [N] that a loop made in place of theirs."""
        for law, command in zip(self._laws, commands, strict=False):
            if isinstance(law, CalledLaw):
                law.command = command.copy()


def inputs_of(kinds: int, reference: Any, measured: Any, excess: Any) -> tuple[Any, ...]:
    """The parts of u by `LinearController.kinds`: errors, or references and measurements, or these and the excess."""
    return (reference - measured,) if kinds == 1 else (reference, measured, excess)[:kinds]


def displacements(to_pose: Callable[[Any], Any], pose: Any, before: Any, wanted: Any, lengths: Any) -> tuple[Any, Any]:
    """References and measurements in task space [m, rad], from those at the last sample and the leg lengths [m].

    The measured displacement is y = Σ J⁻¹ ΔL. Its rate is the twist J⁻¹ L̇; the rate of J⁻¹ (L − L₀) is not, where J
    changes. References are y + J⁻¹ (L_reference − L). `to_pose` is the product with J⁻¹.
    """
    now = pose + to_pose(lengths - before)
    return now + to_pose(wanted - lengths), now


def product_of_members(columns_first: FloatArray, vectors: FloatArray) -> FloatArray:
    """M v (rows, N), a new array, of matrices (columns, rows, N) or (columns, rows, 1) and vectors (columns, N).

    Column by column in ascending order, so that a member's bits do not depend on the others: BLAS sums in an order that
    depends on the sizes, and so does NumPy but along the first axis of arrays with several elements in the others.
    """
    with np.errstate(invalid="ignore"):  # infinity times 0: the host names what is no number
        terms = np.multiply(columns_first, vectors[:, np.newaxis], order="C")
        return np.asarray(np.add.reduce(terms, axis=0))


class LinearLaw:
    """The linear controllers of N members, of one structure, as data: x⁺ = A x + B u, w = C x + D u.

    The memory starts in steady state for constant inputs, those of the first sample, integrators at zero, so that a
    start off the reference gives no derivative kick.
    """

    def __init__(
        self,
        controllers: Sequence[LinearController],
        jacobians: FloatArray,  # of the legs in the reference poses of all samples, (n, 6, 6) or (n, N, 6, 6)
        reference: FloatArray,  # at the first sample (30,) or (N, 30)
        measured: FloatArray,  # at the first sample (N, 24)
    ) -> None:
        first = controllers[0]
        self.failures: Mapping[int, ControllerError] = {}  # members whose maker gave no controller
        self.kinds, self.used = first.kinds, first.signals
        # [C D; A B], (N, 6 + n, n + size of u), or (1, ...) if all members have the same system
        is_common = all(controller.system is first.system for controller in controllers)
        systems = [controller.system for controller in (controllers[:1] if is_common else controllers)]
        self.matrices = np.stack([stacked_blocks(system) for system in systems])
        # by sample (m, 6, 6, N), or (m, 6, 6, 1) if common to all members; in task space only
        self.jacobians: FloatArray | None = None
        self.inverses: FloatArray | None = None
        # the steady state (n, N) under constant inputs
        self.rests = rests_of(systems, first.kinds)
        at = signals.positions(first.signals)
        y, r = measured.T[at], np.broadcast_to(np.atleast_2d(reference).T[at], (len(at), len(measured)))
        self.lengths = y  # at the last sample, in task space [m]
        if first.space == "task":
            by_member = jacobians if jacobians.ndim == 4 else jacobians[:, None]
            self.jacobians, self.inverses = (
                np.ascontiguousarray(np.moveaxis(J, 1, -1)) for J in (by_member, np.linalg.inv(by_member))
            )
            to_pose = partial(product_of_members, self.inverses[0].swapaxes(0, 1))
            r, y = displacements(to_pose, np.zeros_like(y), y, r, y)
        elif "orientation" in first.signals:  # in the turns of their references
            is_angle = np.isin(at, signals.positions(["orientation"]))[:, None]
            y = np.where(is_angle, nearest_angle(y, r), y)
        u = np.concatenate(inputs_of(self.kinds, r, y, np.zeros((N_LEGS, len(measured)))))
        self.state = product_of_members(np.moveaxis(self.rests, 0, -1).swapaxes(0, 1), u)


Law = SeparateLaws | LinearLaw


def rest(A: Any, integrating: FloatArray, forcing: Any, solve: Solve = np.linalg.solve) -> Any:
    """Steady state x = A x + forcing; zero in integrators, on which `integrating` projects."""
    return solve(np.eye(len(A)) - A + integrating, forcing - integrating @ forcing)


def rests_of(systems: Sequence[Any], kinds: int) -> FloatArray:
    """R (k, n, inputs) of x = R u: the steady states of systems under constant inputs, as if no limit acted."""
    A, B = (np.stack([getattr(system, name) for system in systems]) for name in "AB")
    poles = np.diagonal(A, axis1=1, axis2=2)[..., None]
    is_integrator = (1 - poles) ** 2 < _INTEGRATES
    rests = np.where(is_integrator, 0.0, B / np.where(is_integrator, 1.0, 1 - poles))
    for k in np.flatnonzero((A - poles * np.eye(A.shape[1])).any(axis=(1, 2))).tolist():
        rests[k] = rest(A[k], integrators(integrating_modes(A[k])), B[k])
    if kinds == 3:
        rests[:, :, -N_LEGS:] = 0.0
    return rests


def integrating_modes(A: FloatArray) -> FloatArray:
    """Projection (n, n) on the modes whose eigenvalue is 1, along the others.

    With the ordered Schur form A = Q [T₁ T₁₂; 0 T₂] Qᵀ it is Q [1 Y; 0 0] Qᵀ, T₁ Y − Y T₂ = T₁₂ (Golub & Van Loan,
    Matrix Computations, 4th ed. 2013, §7.6.3). Singular values would not do: those of a stable matrix may be smaller
    than the distance of its eigenvalues from 1 by orders of magnitude.
    """
    from scipy.linalg import schur, solve_sylvester  # slow, and rarely needed: poles are often on the diagonal

    T, Q, k = schur(A, sort=lambda re, im: abs(1 - complex(re, im)) ** 2 < _INTEGRATES)
    Y = solve_sylvester(T[:k, :k], -T[k:, k:], T[:k, k:]) if 0 < k < len(A) else np.zeros((k, len(A) - k))
    projection = np.zeros_like(A)
    projection[:k] = np.concatenate([np.eye(k), Y], axis=1)
    return np.asarray(Q @ projection @ Q.T)


def integrators(modes: FloatArray) -> FloatArray:
    """Projection (n, n) on the states that integrate, from P, that on their modes, which has the states behind them.

    For a start: a filter behind an integral that is 0 rests in its first output; in the mode it lags behind a ramp. P
    takes nothing of such a state j: Σ |P_ij P_ji| = 0 over i, in whatever units the states are.
    """
    takes = np.abs(modes * modes.T).sum(axis=0) > _TAKES
    return np.asarray(takes[:, None] * modes)
