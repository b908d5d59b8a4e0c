"""A plant of many platforms, stepped together with internal steps of their own, eight in a vector.

A member's bits depend only on its own numbers, not on the number or choice of the other members.
"""

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.libraries import CONTROLLED, WIDTH, LanesLibrary, lanes_code, machine_code
from gough_stewart.fmu_build.plant.layout import MemberFailure as Failure
from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray, Plant, tunable
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model import interface
from gough_stewart.model.dynamics import motors_at, static_leg_forces
from gough_stewart.model.errors import InterfaceError, MembersError, PlatformError, SingularPoseError, StepError
from gough_stewart.model.interface import DEFAULT_TOLERANCE, IDEAL, SMOOTH, TOLERANCES, State, Variant, end_of_step
from gough_stewart.model.kinematics import COLLAPSED, PITCHED, conditioning, leg_geometry, singular_pose
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.platform import Platform, Platforms
from gough_stewart.model.platform_checks import check_leg_com_offsets
from gough_stewart.model.vectors import FloatArray, real_array

# The largest number of substeps; a motion that needs more is unsuited to fixed steps.
MOST_SUBSTEPS = 1024
_ARRAYS = (
    *("parameters", "states", "inputs", "running", "side", "failure", "reached", "failed_after"),
    *("error", "proposed", "internal_steps"),
)
BATCH_FIELDS = ("blocks", "stride", *_ARRAYS)


class _CBatch(ctypes.Structure):
    """`batch` of c/lanes/lanes.h."""

    _fields_ = [(name, ctypes.c_int64 if k < 2 else ctypes.c_void_p) for k, name in enumerate(BATCH_FIELDS)]


class LaneArrays:
    """M members, a multiple of eight, as kernels use them, see c/lanes/lanes.h; members contiguous in rows.

    All are of one variant, which gives the sizes. Everything is zero at first: `running` (M) is 0 or -1, `side` (M) the
    sign of det J, 0 where not known yet; `failure` (M), see `Failure`, with the state `reached` there (N_STATES, M) and
    the time `failed_after` the begin of the step [s]; `error` (M) the largest estimate of a step's error so far;
    `proposed` (M) the size of the next internal step [s], 0 before the first.
    """

    def __init__(self, members: int, variant: Variant = IDEAL) -> None:
        self.variant, self.blocks = variant, -(-members // WIDTH)
        # whose values each lane has (M,): the last member fills the last vector
        self.member_of_lane = np.minimum(np.arange(self.blocks * WIDTH), members - 1)
        n_states, n_parameters = variant.n_states, variant.n_parameters
        self._rows = {name: rows.ravel() for name, rows in interface.places(variant.parameters).items()}
        m, size = self.blocks * WIDTH, self.blocks * n_parameters * WIDTH
        raw = np.zeros(size + WIDTH)
        start = -raw.ctypes.data % 64 // raw.itemsize  # aligned to 64 bytes
        self.parameters = raw[start : start + size].reshape(self.blocks, n_parameters, WIDTH)
        self.states, self.reached = lane_rows(n_states, self.blocks), lane_rows(n_states, self.blocks)
        self.inputs = lane_rows(interface.N_INPUTS, self.blocks)
        self.running, self.failure = np.zeros(m, np.int64), np.zeros(m, np.int64)
        self.side, self.failed_after, self.error, self.proposed, self.internal_steps = (np.zeros(m) for _ in range(5))
        stride = self.states.strides[0] // self.states.itemsize
        pointers = (getattr(self, name).ctypes.data for name in _ARRAYS)
        # the argument of the library's functions
        self.reference = ctypes.pointer(_CBatch(self.blocks, stride, *pointers))

    def put_parameter(self, name: str, values: NDArray[np.float64]) -> None:
        """Write one parameter of N members (N, *shape)."""
        of_lanes = values[self.member_of_lane].reshape(self.blocks, WIDTH, -1)
        self.parameters[:, self._rows[name]] = of_lanes.swapaxes(1, 2)

    def parameters_of(self, members: Any = slice(None)) -> Parameters:
        """The parameters of some members by name, with a leading axis; a copy with contiguous elements."""
        by_element = self.parameters.swapaxes(0, 1)
        values = by_element.reshape(len(by_element), -1)[:, members]
        return Parameters(**interface.unpack(self.variant.parameters, values.T))


def lane_rows(size: int, blocks: int) -> FloatArray:
    """Zeros (size, 8 `blocks`) with a stride of an odd number of vectors: see c/lanes/lanes.h."""
    return np.zeros((size, (blocks | 1) * WIDTH))[:, : blocks * WIDTH]


class CompiledLanes:
    """A library of c/lanes or c/loop, see c/lanes/lanes.h; it releases the GIL while it works."""

    def __init__(self, library: LanesLibrary) -> None:
        self.features = library.features  # of the processor that it was compiled for: equal texts mean equal bits
        self.library = ctypes.CDLL(str(library.path))
        number, count, array = ctypes.c_double, ctypes.c_int64, ctypes.c_void_p
        if hasattr(self.library, "loop_run"):
            self.library.loop_run.restype = count
            for name in ("loop_read", "loop_act"):
                getattr(self.library, name).argtypes = (ctypes.POINTER(_CBatch), array, count)
        for name, result, arguments in (
            ("check", count, tuple[Any, ...]()),
            ("step", count, (number, count, number, array)),
            ("results", None, (array,)),
        ):
            function = getattr(self.library, f"lanes_{name}")
            function.argtypes, function.restype = (ctypes.POINTER(_CBatch), *arguments), result


class Stepping(NamedTuple):
    """How many platforms are stepped: by error-controlled internal steps, or by a number of RK4 steps of equal size."""

    tolerance: float = DEFAULT_TOLERANCE
    substeps: int | None = None


class BatchPlant(Plant):
    """N platforms of one kind as a `Plant` of shape (N,), each in its own start state at time 0.

    `internal_steps` (N,) counts error-controlled steps so far, with those that were too large; `integration_error` (N,)
    is the largest estimate so far, max |x − x'| / (1 + |x|): the sum of the internal steps' errors in a plant step, or,
    with substeps, of their distances from a solution of order 5. `PlantError` or `PlatformError` for platforms or
    options that do not fit, errors of `machine_code` if there is none.
    """

    def __init__(
        self,
        platforms: Sequence[Platform],
        starts: Sequence[State],
        *,
        substeps: int | None = None,  # RK4 steps per plant step; None for error-controlled steps, each member's own
        tolerance: float = DEFAULT_TOLERANCE,  # of error-controlled steps, relative, and absolute in SI units
        kernel: CompiledLanes | None = None,  # the machine code that steps them; by default that of the plants alone
    ) -> None:
        if not platforms or len(platforms) != len(starts):
            raise PlantError(
                f"{len(platforms)} platforms and {len(starts)} starts; expected at least one platform, and a start for "
                "each"
            )
        self._platforms = platforms if isinstance(platforms, Platforms) else Platforms(platforms)
        self._variant = variant = Variant.of(platforms[0])
        for field, has_part in (
            ("leg_friction_model", self._platforms.field("leg_friction_model") != SMOOTH),
            ("leg_stiffness", self._platforms.field("leg_stiffness") > 0),
        ):
            for k in np.flatnonzero(has_part != has_part[0])[:1].tolist():
                its, of_first = (Variant.of(platforms[m]).words.removeprefix("with ") for m in (k, 0))
                raise PlatformError(
                    field,
                    f"gives platform {k} other states: it has {its}, and platform 0 {of_first}; expected one kind, "
                    "so run each kind for itself",
                )
        if variant.parts and substeps is not None:
            raise PlantError(
                f"a plant of many platforms {variant.words} has no steps of a fixed size; remove fixed_step_size, "
                "for error control"
            )
        low, high = TOLERANCES
        if not low <= tolerance <= high:
            raise PlantError(
                f"tolerance is {tolerance!r}; expected {low:g} to {high:g}, for example {DEFAULT_TOLERANCE:g}"
            )
        if substeps is not None and not (isinstance(substeps, int) and 1 <= substeps <= MOST_SUBSTEPS):
            raise PlantError(f"substeps is {substeps!r}; expected a whole number from 1 to {MOST_SUBSTEPS}")
        self.shape = (len(platforms),)
        self.substeps, self.tolerance = substeps, tolerance
        self._kernel = kernel or _of_plants_alone(variant)
        self.features, self.columns = self._kernel.features, variant.columns
        # the machine code with c/loop, if it is there; then call `begin` and, at last, `came_to`
        self.loop_library: Any = self._kernel.library if hasattr(self._kernel.library, "loop_run") else None
        self.batch = batch = LaneArrays(len(platforms), variant)
        self._signals = lane_rows(signals.SIZE, batch.blocks)
        self._time, self._steps, self._begun = 0.0, 0, False
        for variable in variant.parameters:
            batch.put_parameter(variable.name, self._platforms.field(variable.name))
        states = np.array([np.concatenate(start) for start in starts])
        batch.states[: interface.N_STATES] = states[batch.member_of_lane].T
        if variant.springs:
            self._place_motors(np.ones(batch.states.shape[1], dtype=bool))
        position, orientation = (
            self._platforms.field(name)[batch.member_of_lane] for name in ("home_position", "home_orientation")
        )
        batch.inputs[:N_LEGS] = static_leg_forces(batch.parameters_of(), position, orientation).T
        batch.running[: len(platforms)] = -1
        # views
        self.internal_steps, self.integration_error = (
            numbers[: len(platforms)] for numbers in (batch.internal_steps, batch.error)
        )

    def begin(self) -> dict[int, StepError]:
        """Failures of members that cannot start a step in their state; they do not run."""
        if not self._begun:
            self._starts = self.batch.states.copy()
        self._begun = True
        failures = self._stop_failed() if self._kernel.library.lanes_check(self.batch.reference) else {}
        running = self.batch.running[: self.shape[0]]
        # legs too short for a part's centre of mass
        parameters, x = self.batch.parameters_of(slice(self.shape[0])), self.batch.states[:, : self.shape[0]].T
        lengths = leg_geometry(parameters, x[:, :3], x[:, 3:6]).length
        for k in np.flatnonzero(check_leg_com_offsets(parameters, lengths, "start") & (running != 0)).tolist():
            platform = self._platforms[k]
            try:
                check_leg_com_offsets(platform, lengths[k], "start")
            except PlatformError as error:
                value, reason = float(getattr(platform, error.field)), str(error).partition(": ")[2]
                failures[k], running[k] = StepError(error.field, value, self._time, reason), 0
        return failures

    def came_to(self, time: float, now: FloatArray) -> None:
        """The loop's machine code has run it to a time [s], with these signals (24, M)."""
        self._time, self._signals, self._steps = time, now, self._steps + 1

    def set_inputs(self, inputs: FloatArray) -> None:
        """Hold these inputs (N, 12) from now on; one that is not finite fails in the step, for its member only."""
        if inputs.shape != (*self.shape, interface.N_INPUTS):
            raise InterfaceError("inputs", f"have shape {inputs.shape}; expected {(*self.shape, interface.N_INPUTS)}")
        self.batch.inputs[:, : self.shape[0]] = inputs.T

    def set_parameters(self, values: Mapping[str, object]) -> None:
        self.set_parameters_of(np.ones(self.shape, dtype=bool), values)

    def set_parameters_of(self, members: BoolArray, values: Mapping[str, object]) -> None:
        present, changed = self.batch.parameters_of(slice(self.shape[0])), dict[str, FloatArray]()
        for name, value in values.items():
            variable, new = tunable(self._variant, name), np.array(getattr(present, name))
            try:
                rows = np.array(value)
                # one value for these members, or the rows of all
                has_members = rows.ndim > len(variable.shape) and len(rows) == len(members)
                shape = new[members].shape if has_members else variable.shape
                new[members] = real_array(rows[members] if has_members else value, shape)
            except ValueError as error:
                raise InterfaceError(name, f"{error} [{variable.unit}], {variable.description}") from None
            changed[name] = new
        # platforms are made, which raises their errors, only of members that fail the checks of all at once
        platforms = self._platforms.having(changed)
        for k in np.flatnonzero(platforms.doubtful(changed) & members).tolist():
            try:
                replace(self._platforms[k], **{name: value[k] for name, value in changed.items()})
            except PlatformError as error:
                text = str(error).partition(": ")[2]
                raise PlatformError(error.field, f"{text} (number {k} of the platforms)") from None
        self._platforms = platforms
        for name, new in changed.items():
            self.batch.put_parameter(name, new)
        if self._variant.springs and not self._begun:
            self._place_motors(members[self.batch.member_of_lane])

    def signals(self) -> FloatArray:
        if self._steps == 0:  # later, the step provides them; here, one of duration 0
            self._kernel.library.lanes_step(self.batch.reference, 0.0, 0, self.tolerance, self._signals.ctypes.data)
        return self._signals[:, : self.shape[0]].T

    def results(self) -> FloatArray:
        results = lane_rows(len(self.columns), self.batch.blocks)
        self._kernel.library.lanes_results(self.batch.reference, results.ctypes.data)
        return results[:, : self.shape[0]].T

    def do_step(self, time: float, step: float) -> None:
        end = end_of_step(time, step, self._time)
        failures = self.begin() if self._steps == 0 else {}
        size, out = step / (self.substeps or 1), self._signals.ctypes.data
        if self._kernel.library.lanes_step(self.batch.reference, size, self.substeps or 0, self.tolerance, out):
            failures |= self._stop_failed()
        self._time, self._steps = end, self._steps + 1
        if failures:
            raise MembersError(failures)

    def freeze(self, members: BoolArray) -> None:
        self.batch.running[: self.shape[0]][members] = 0

    def restart(self, members: BoolArray) -> None:
        """Put these members (N,) back into their states at `begin`; they run again, whatever had ended them."""
        batch, at = self.batch, np.flatnonzero(members)
        batch.states[:, at] = self._starts[:, at]
        # what a step leaves to the next one
        batch.side[at] = batch.proposed[at] = 0.0
        batch.failure[at], batch.running[at] = Failure.GOES_ON, -1
        # their signals, by a step of duration 0
        self._kernel.library.lanes_step(batch.reference, 0.0, 0, self.tolerance, self._signals.ctypes.data)

    def failure(self, k: int, begin: float) -> StepError:
        """The error of member k, whose `failure` is set, in a step that begins at a time [s]."""
        batch = self.batch
        failure, x, inputs = int(batch.failure[k]), batch.reached[:, k], batch.inputs[:, k]
        time = begin + float(batch.failed_after[k])
        if failure == Failure.NOT_FINITE:
            is_of_inputs = not np.isfinite(inputs).all()
            variables, values = (interface.INPUTS, inputs) if is_of_inputs else (self._variant.states, x)
            first = int(np.flatnonzero(~np.isfinite(values))[0])
            quantity = [name for variable in variables for name in variable.scalar_names][first], float(values[first])
            if is_of_inputs:
                return StepError(*quantity, begin, "expected finite numbers")
            remedy = "smaller forces, or smoother friction (leg_friction_velocity)"
            remedy = remedy if self.substeps is None else f"more than {self.substeps} substeps, {remedy}"
            return StepError(*quantity, time, f"the motion is not finite; it needs {remedy}")
        if failure == Failure.TOO_MANY_STEPS:
            most = int(CONTROLLED["MOST_LANE_STEPS"])
            reason = (
                f"too many for one plant step at tolerance {self.tolerance:g}; forces too large, leg_friction_velocity "
                "too small, or step too long"
            )
            return StepError("internal steps", most, time, reason)
        if failure == Failure.PITCHED:
            return StepError("orientation[2]", float(x[4]), time, PITCHED)
        platform, pose = batch.parameters_of([k]), (x[None, :3], x[None, 3:6])
        if failure >= Failure.COLLAPSED:
            leg = failure - Failure.COLLAPSED
            with np.errstate(all="ignore"):
                length = float(leg_geometry(platform, *pose).length[0, leg])
            return StepError(f"leg_length[{leg + 1}]", length, time, COLLAPSED)
        number = float(conditioning(platform, *pose).condition_number[0])
        return singular_pose(number, time, passed=failure == Failure.PASSED_SINGULAR)

    def _place_motors(self, members: BoolArray) -> None:
        """Place the motors of these members (M,) where they hold the pose at rest, moving with it."""
        x = self.batch.states

        def motors_of(columns: Any) -> FloatArray:
            parameters, start = self.batch.parameters_of(columns), State.from_vector(x[: interface.N_STATES, columns].T)
            try:
                motors = motors_at(parameters, start)
            except SingularPoseError:
                if not isinstance(columns, int):
                    return np.stack([motors_of(k) for k in range(x.shape[1])], axis=-1)
                # not stretched, in a pose from which `begin` does not start
                motors = motors_at(replace(parameters, leg_stiffness=0.0), start)
            return np.concatenate([motors["motor_position"], motors["motor_velocity"]], axis=-1).T

        # the last states
        x[-2 * N_LEGS :, members] = motors_of(slice(None))[:, members]

    def _stop_failed(self) -> dict[int, StepError]:
        batch = self.batch
        failures = {int(k): self.failure(int(k), self._time) for k in np.flatnonzero(batch.failure)}
        batch.running[batch.failure != Failure.GOES_ON] = 0
        batch.failure[:] = Failure.GOES_ON
        return failures


@cache
def _of_plants_alone(variant: Variant) -> CompiledLanes:
    return CompiledLanes(machine_code(lanes_code(variant)))
