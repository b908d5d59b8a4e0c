"""A plant of many platforms, stepped together with internal steps of their own, eight in a vector.

A member's bits depend only on its own numbers, not on the number or choice of the other members.
"""

import ctypes
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.fmu_build.libraries import CONTROLLED, WIDTH, LanesLibrary, lanes_library
from gough_stewart.fmu_build.libraries import MemberFailure as Failure
from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.lane_batch import Batch, rows
from gough_stewart.harness.plants.parameter_changes import changed_parameter, refuse_impossible
from gough_stewart.harness.plants.plant import BoolArray, Plant
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model import interface
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.errors import InterfaceError, MembersError, PlatformError, SingularPoseError, StepError
from gough_stewart.model.kinematics import conditioning, leg_geometry
from gough_stewart.model.machine_dynamics import motors_at
from gough_stewart.model.platform import Platform, Platforms
from gough_stewart.model.platform_checks import check_leg_com_offsets
from gough_stewart.model.pose_limits import leg_collapsed, pitch_reached, singular_pose
from gough_stewart.model.state import State
from gough_stewart.model.step_times import DEFAULT_TOLERANCE, TOLERANCES, end_of_step
from gough_stewart.model.variant import SMOOTH, Variant
from gough_stewart.model.vectors import FloatArray

_ARRAYS = tuple(field.name for field in fields(Batch) if field.name != "variant")
BATCH_FIELDS = ("blocks", "stride", *_ARRAYS)
# The largest number of substeps; a motion that needs more is unsuited to fixed steps.
MOST_SUBSTEPS = 1024


class _CBatch(ctypes.Structure):
    """`batch` of c/lanes/lanes.h."""

    _fields_ = [
        *((name, ctypes.c_int64 if k < 2 else ctypes.c_void_p) for k, name in enumerate(BATCH_FIELDS)),
    ]


class CompiledLanes:
    """A library of c/lanes or c/loop; it releases the GIL while it works.

    Members that do not run, or fail, stay exactly as they were. Poses are checked, and errors estimated, as in
    c/lanes/lanes.h.

    Attributes
    ----------
    features
        The processor features it was compiled for: equal texts mean equal bits.
    """

    def __init__(self, library: LanesLibrary) -> None:
        self.features = library.features
        self.library = ctypes.CDLL(str(library.path))
        self.loop_run = getattr(self.library, "loop_run", None)
        for each in (self.library.lanes_check, self.library.lanes_step, self.library.lanes_advance, self.loop_run):
            if each is not None:
                each.restype = ctypes.c_int64

    def check(self, batch: Batch) -> int:
        """The number of members that cannot start a motion in their state."""
        return int(self.library.lanes_check(reference(batch)))

    def step(self, batch: Batch, size: float, substeps: int, signals: FloatArray | None = None) -> int:
        """Do RK4 substeps of this size [s] and compute the signals at their end; the number of failed members."""
        out = ctypes.c_void_p(None if signals is None else signals.ctypes.data)
        numbers = ctypes.c_double(size), ctypes.c_int64(substeps)
        return int(self.library.lanes_step(reference(batch), *numbers, out))

    def advance(self, batch: Batch, duration: float, tolerance: float, signals: FloatArray | None = None) -> int:
        """Do a step with error-controlled internal steps and compute the signals; the number of failed members."""
        out = ctypes.c_void_p(None if signals is None else signals.ctypes.data)
        numbers = ctypes.c_double(duration), ctypes.c_double(tolerance)
        return int(self.library.lanes_advance(reference(batch), *numbers, out))

    def signals(self, batch: Batch, out: FloatArray) -> None:
        """Write the first part of the results (24, M)."""
        self.library.lanes_signals(reference(batch), ctypes.c_void_p(out.ctypes.data))

    def results(self, batch: Batch, out: FloatArray) -> None:
        """Write all results (N_RESULTS, M)."""
        self.library.lanes_results(reference(batch), ctypes.c_void_p(out.ctypes.data))


def reference(batch: Batch) -> Any:
    """The argument of the library's functions; it must live as long as the batch is used."""
    states = batch.states
    pointers = (getattr(batch, name).ctypes.data for name in _ARRAYS)
    return ctypes.byref(_CBatch(states.shape[1] // WIDTH, states.strides[0] // states.itemsize, *pointers))


class Stepping(NamedTuple):
    """How many platforms are stepped: by error-controlled internal steps, or by a number of RK4 steps of equal size."""

    tolerance: float = DEFAULT_TOLERANCE
    substeps: int | None = None


class LanesPlant(Plant):
    """N platforms as a `Plant` of shape (N,); see `lanes_plant`.

    Attributes
    ----------
    substeps, tolerance
        RK4 steps per plant step; or, if that is None, the tolerance of error-controlled internal steps, each member's
        own.
    features
        Of its machine code, see `CompiledLanes`.
    integration_error
        The largest estimate so far (N,), max |x − x'| / (1 + |x|), to compare with a tolerance that is relative, and
        absolute in SI units: the sum of the internal steps' errors in a plant step, or, with substeps, of their
        distances from a solution of order 5; see c/lanes/lanes.h.
    internal_steps
        Error-controlled internal steps so far (N,), with those that were too large.
    """

    may_overrun = True

    def __init__(
        self,
        kernel: CompiledLanes,
        platforms: Sequence[Platform],
        starts: Sequence[State],
        substeps: int | None,
        tolerance: float,
    ) -> None:
        self.shape = (len(platforms),)
        self.substeps, self.tolerance = substeps, tolerance
        self.features = kernel.features
        self._kernel, self._platforms = kernel, Platforms.of(platforms)
        self._variant = Variant.of(self._platforms[0])
        self.columns = self._variant.columns
        self._batch = batch = Batch.of(len(platforms), self._variant)
        self._signals = rows(signals.SIZE, batch.blocks)
        self._time, self._steps, self._begun = 0.0, 0, False
        for name in (v.name for v in self._variant.parameters):
            batch.put_parameter(name, self._platforms.field(name))
        batch.states[: interface.N_STATES] = batch.padded(np.stack([start.to_vector() for start in starts]))
        self._place_motors(np.ones(batch.states.shape[1], dtype=bool))
        position, orientation = (
            batch.padded(self._platforms.field(f"home_{of}")).T for of in ("position", "orientation")
        )
        batch.inputs[:6] = static_leg_forces(batch.parameters_of(), position, orientation).T
        batch.running[: len(platforms)] = -1

    @property
    def internal_steps(self) -> FloatArray:
        return self._batch.internal_steps[: self.shape[0]]

    @property
    def integration_error(self) -> FloatArray:
        """The largest estimate so far (N,)."""
        return self._batch.error[: self.shape[0]]

    @property
    def batch(self) -> Batch:
        """Its members in memory."""
        return self._batch

    @property
    def loop_run(self) -> Callable[..., int] | None:
        """The function of c/loop in its machine code, if it is there; then call `begin` and, at last, `came_to`."""
        return self._kernel.loop_run

    def begin(self) -> dict[int, StepError]:
        """Failures of members that cannot start a step in their state; they do not run."""
        self._begun = True
        failures = self._stop_failed() if self._kernel.check(self._batch) else {}
        running = self._batch.running[: self.shape[0]]
        for k, error in short_legs(self._batch, self._platforms, running != 0, self._time).items():
            failures[k], running[k] = error, 0
        return failures

    def came_to(self, time: float, now: FloatArray) -> None:
        """The loop's machine code has run it to a time [s], with these signals (24, M)."""
        self._time, self._signals, self._steps = time, now, self._steps + 1

    def failure(self, k: int, time: float) -> StepError:
        """The error of a member whose `failure` is set, in a step that starts at a time [s]."""
        return failure_of(self._batch, k, time, self.substeps, self.tolerance)

    def set_inputs(self, inputs: FloatArray) -> None:
        """Rule 2; a non-finite input fails in the step, for its member only."""
        if inputs.shape != (*self.shape, interface.N_INPUTS):
            raise InterfaceError("inputs", f"have shape {inputs.shape}; expected {(*self.shape, interface.N_INPUTS)}")
        self._batch.inputs[:, : self.shape[0]] = inputs.T

    def set_parameters(self, values: Mapping[str, object]) -> None:
        """Rules 3 and 9."""
        self.set_parameters_of(np.ones(self.shape, dtype=bool), values)

    def set_parameters_of(self, members: BoolArray, values: Mapping[str, object]) -> None:
        """Rule 9."""
        present = self._batch.parameters_of(slice(self.shape[0]))
        known = {
            name: changed_parameter(present, name, value, members, self._variant) for name, value in values.items()
        }
        refuse_impossible(self._platforms, members, known)
        for name, value in known.items():
            self._batch.put_parameter(name, value)
        if not self._begun:
            self._place_motors(self._batch.padded(members[:, None].astype(float))[0] > 0)

    def signals(self) -> FloatArray:
        """Rule 11: a view."""
        if self._steps == 0:  # later, the step provides them
            self._kernel.signals(self._batch, self._signals)
        return self._signals[:, : self.shape[0]].T

    def results(self) -> FloatArray:
        """Rule 4."""
        found = rows(len(self.columns), self._batch.blocks)
        self._kernel.results(self._batch, found)
        return found[:, : self.shape[0]].T

    def do_step(self, time: float, step: float) -> None:
        """Rules 5, 6 and 9."""
        end = end_of_step(time, step, self._time)
        failures = self.begin() if self._steps == 0 else {}
        if self.substeps is None:
            failed = self._kernel.advance(self._batch, step, self.tolerance, self._signals)
        else:
            failed = self._kernel.step(self._batch, step / self.substeps, self.substeps, self._signals)
        if failed:
            failures |= self._stop_failed()
        self._time, self._steps = end, self._steps + 1
        if failures:
            raise MembersError(failures)

    def freeze(self, members: BoolArray) -> None:
        """Rule 9."""
        self._batch.running[: self.shape[0]][members] = 0

    def close(self) -> None:
        """Rule 8; there is nothing to release."""

    def _place_motors(self, members: BoolArray) -> None:
        """Motors of these (M,) hold their pose at rest, and move with it, as `SteppingModel` rule 11."""
        if not self._variant.springs:
            return
        states, x = self._variant.states, self._batch.states
        starts = State.from_vector(x[: interface.N_STATES].T)
        try:
            held = motors_at(self._batch.parameters_of(), starts)
        except SingularPoseError:
            each = [self._motors_of(k) for k in range(x.shape[1])]
            held = {name: np.stack([one[name] for one in each]) for name in each[0]}
        for name, values in held.items():
            begin = interface.size_of(states[: states.index(interface.BY_NAME[name])])
            x[begin : begin + N_LEGS, members] = values.T[:, members]

    def _motors_of(self, k: int) -> dict[str, FloatArray]:
        """Those of one member; not stretched in a singular pose, from which `begin` does not start."""
        own, start = self._batch.parameters_of(k), State.from_vector(self._batch.states[: interface.N_STATES, k])
        try:
            return motors_at(own, start)
        except SingularPoseError:
            return motors_at(replace(own, leg_stiffness=0.0), start)

    def _stop_failed(self) -> dict[int, StepError]:
        batch = self._batch
        found = {
            int(k): failure_of(batch, int(k), self._time, self.substeps, self.tolerance)
            for k in np.flatnonzero(batch.failure)
        }
        batch.running[batch.failure != Failure.GOES_ON] = 0
        batch.failure[:] = Failure.GOES_ON
        return found


def lanes_plant(
    platforms: Sequence[Platform],
    starts: Sequence[State],
    *,
    substeps: int | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    kernel: CompiledLanes | None = None,
) -> LanesPlant:
    """Many platforms as a plant, each in its own start state at time 0.

    Parameters
    ----------
    substeps
        RK4 steps per plant step; None for error-controlled steps.
    tolerance
        Of error-controlled steps, relative, and absolute in SI units.
    kernel
        The machine code that steps them; without it that of the plants alone.

    Raises
    ------
    PlantError
        No platforms, another number of starts, or an invalid number of substeps or tolerance.
    PlatformError
        Some stick or give, and others do not.
    BuildError, OSError
        There is no machine code, and it cannot be built, as `lanes_library`.
    """
    if not platforms or len(platforms) != len(starts):
        raise PlantError(
            f"{len(platforms)} platforms and {len(starts)} starts; expected at least one platform, and a start for each"
        )
    variant = _variant_of(Platforms.of(platforms))
    if variant.parts and substeps is not None:
        raise PlantError(
            f"a plant of many platforms {variant.words} has no steps of a fixed size; remove fixed_step_size, "
            "for error control"
        )
    low, high = TOLERANCES
    if not low <= tolerance <= high:
        raise PlantError(f"tolerance is {tolerance!r}; expected {low:g} to {high:g}, for example {DEFAULT_TOLERANCE:g}")
    if substeps is not None and not (isinstance(substeps, int) and 1 <= substeps <= MOST_SUBSTEPS):
        raise PlantError(f"substeps is {substeps!r}; expected a whole number from 1 to {MOST_SUBSTEPS}")
    return LanesPlant(kernel or _of_plants_alone(variant), platforms, starts, substeps, tolerance)


def _variant_of(platforms: Platforms) -> Variant:
    """Of all members.

    Raises
    ------
    PlatformError
        Members differ in it.
    """
    first = Variant.of(platforms[0])
    sticks, gives = platforms.field("leg_friction_model") != SMOOTH, platforms.field("leg_stiffness") > 0
    for field, own in (("leg_friction_model", sticks), ("leg_stiffness", gives)):
        for k in np.flatnonzero(own != own[0])[:1].tolist():
            raise PlatformError(
                field,
                f"gives platform {k} other states: it has {Variant.of(platforms[k]).words.removeprefix('with ')}, and "
                f"platform 0 {first.words.removeprefix('with ')}; expected one kind, so run each kind for itself",
            )
    return first


@cache
def _of_plants_alone(variant: Variant) -> CompiledLanes:
    return CompiledLanes(lanes_library(variant))


def failure_of(batch: Batch, k: int, begin: float, substeps: int | None, tolerance: float) -> StepError:
    """The error of member `k` in a step that starts at a time [s]; see `LanesPlant`."""
    failure, x, u = int(batch.failure[k]), batch.reached[:, k], batch.inputs[:, k]
    time = begin + float(batch.failed_after[k])
    if failure == Failure.NOT_FINITE:
        if not np.isfinite(u).all():
            return StepError(*_first_not_finite(interface.INPUTS, u), begin, "expected finite numbers")
        remedy = "smaller forces, or smoother friction (leg_friction_velocity)"
        remedy = remedy if substeps is None else f"more than {substeps} substeps, {remedy}"
        return StepError(
            *_first_not_finite(batch.variant.states, x), time, f"the motion is not finite; it needs {remedy}"
        )
    if failure == Failure.TOO_MANY_STEPS:
        most = int(CONTROLLED["MOST_LANE_STEPS"])
        reason = (
            f"too many for one plant step at tolerance {tolerance:g}; forces too large, leg_friction_velocity too "
            "small, or step too long"
        )
        return StepError("internal steps", most, time, reason)
    if failure == Failure.PITCHED:
        return pitch_reached(float(x[4]), time)
    platform, pose = batch.parameters_of([k]), (x[None, :3], x[None, 3:6])
    if failure >= Failure.COLLAPSED:
        leg = failure - Failure.COLLAPSED
        with np.errstate(all="ignore"):
            return leg_collapsed(leg, float(leg_geometry(platform, *pose).length[0, leg]), time)
    number = float(conditioning(platform, *pose).condition_number[0])
    return singular_pose(number, time, passed=failure == Failure.PASSED_SINGULAR)


def short_legs(batch: Batch, platforms: Sequence[Platform], members: BoolArray, time: float) -> dict[int, StepError]:
    """Which members (N,) have a leg too short for a part's centre of mass."""
    n = len(platforms)
    parameters, x = batch.parameters_of(slice(n)), batch.states[:, :n].T
    shortest = leg_geometry(parameters, x[:, :3], x[:, 3:6]).length.min(axis=-1)
    farthest = np.maximum(parameters.leg_lower_com, parameters.leg_upper_com)
    found = {}
    for k in map(int, np.flatnonzero((farthest > shortest) & members)):
        try:
            check_leg_com_offsets(platforms[k], float(shortest[k]), "start")
        except PlatformError as error:
            value = float(getattr(platforms[k], error.field))
            found[k] = StepError(error.field, value, time, str(error).partition(": ")[2])
    return found


def _first_not_finite(variables: Iterable[interface.Variable], values: FloatArray) -> tuple[str, float]:
    """Name and value of the first element that is not finite."""
    names = [name for v in variables for name in v.scalar_names]
    at = int(np.flatnonzero(~np.isfinite(values))[0])
    return names[at], float(values[at])
