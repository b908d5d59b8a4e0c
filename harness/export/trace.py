"""The functions of a sample as CasADi Functions, traced from the Python code that runs in the harness.

Each takes those of the following vectors that it needs, by name:

    time; motion (18) at it; coefficients; states x; measured; excess (6); the platform's parameters
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.harness.control.by_hand import HandMotion
from gough_stewart.harness.control.component import Drive, ForceLimits, Sensor, Stepped
from gough_stewart.harness.control.controllers import Feedforward
from gough_stewart.harness.control.laws_of_members import displacements, inputs_of
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.export import symbols
from gough_stewart.harness.export.design import REFERENCE, Designed
from gough_stewart.harness.export.laws import ExportedLaw, FunctionLaw
from gough_stewart.harness.export.symbols import Home, change_of_lengths, home_of
from gough_stewart.harness.export.tables import path_function, path_of
from gough_stewart.harness.motion.limits.reach import legs_of
from gough_stewart.harness.motion.motion import Motion, Piecewise, Reference, extrapolated, motion_of
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics, static_leg_forces
from gough_stewart.model.interface import State
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.rotations import nearest_angle
from gough_stewart.model.vectors import Array, greater, where

N_MOTION = 18


class TracedComponent(NamedTuple):
    """Functions of a component `name`, whose vectors are `name_coefficients`, `name_states` and `name_next`."""

    coefficients: casadi.Function  # settings -> coefficients
    step: casadi.Function  # coefficients, states, inputs -> next states, outputs
    n_states: int


class PoseFunctions(NamedTuple):
    """The functions of poses and lengths; None if a controller does not need one."""

    path: casadi.Function | None  # of a motion along a path: splines, speed -> pose, rate, acceleration
    motion: casadi.Function | None  # time, or pose, rate, acceleration of a table -> motion
    extrapolated: casadi.Function | None  # motion, ahead -> later
    start: casadi.Function | None  # states -> states at rest in the measurements, at the start and after bad inputs
    expected: casadi.Function | None  # motion, platform -> references of the measurements that are watched
    law: casadi.Function | None  # -> force, next

    @property
    def needs_motion(self) -> bool:
        """Whether the reference at a sample is computed, not only the one ahead."""
        return any(f is not None and "motion" in f.name_in() for f in (self.law, self.start, self.expected))


class Traced(NamedTuple):
    """The functions of a controller; None if it does not need one."""

    of_poses: PoseFunctions
    relative: PoseFunctions  # the same relative to home, where the law gives the changes of its states
    coefficients: casadi.Function | None  # settings -> law
    feedforward: casadi.Function | None  # motion, platform -> force
    limits: TracedComponent  # of the command
    drives: TracedComponent | None
    sensors: TracedComponent | None

    @property
    def components(self) -> tuple[TracedComponent, ...]:
        """Those of them that there are."""
        return tuple(part for part in (self.sensors, self.limits, self.drives) if part is not None)


@interrupts_held_back()
def traced(designed: Designed) -> Traced:
    """All functions of a designed controller."""
    measured = sum(variable.size for variable in designed.measured)
    platform = {v.name: casadi.SX.sym(v.name, v.size) for v in designed.platform_parameters}
    of_motion = {"motion": casadi.SX.sym("motion", N_MOTION), **platform}
    homes = None, home_of(designed.platform)
    of_poses, relative = (_functions_of_poses(designed, of_motion, home) for home in homes)
    feedforward = None
    if designed.feedforward != "none":
        at = motion_in(of_motion["motion"])
        force = feedforward_of(designed.feedforward, symbols.parameters_of(of_motion), at)
        feedforward = symbols.function("feedforward", of_motion, {"force": force})

    # limits on the command, with the excess if the law hears of it; and what is carried of the machine
    settings = {s.variable.name: casadi.SX.sym(s.variable.name, s.variable.size) for s in designed.settings}
    T, parts = symbols.elements(settings["sample_time"]), designed.carried

    def component(kind: type[Stepped], name: str, period: Array, signal: str, **options: Any) -> TracedComponent:
        # a setting (1,) in which 0 means that there is none, with that in its place
        values = {}
        for p in kind.parameters():
            elements = symbols.elements(settings[p.name])
            values[p.key] = where(greater(elements, 0.0), elements, p.none or 0.0)
        return traced_component(kind, name, values, period, settings, {signal: N_LEGS}, **options)

    hears_excess = of_poses.law is not None and "excess" in of_poses.law.name_in()
    options: dict[str, Any] = {} if hears_excess else {"left_out": ("change",), "wanted": ForceLimits.outputs[:2]}
    limits = component(ForceLimits, "force_limits", T, "command", **options)
    drives = component(Drive, "drives", T / parts.steps_a_sample, "target") if "drives" in parts.parts else None
    sensors = None
    if "sensors" in parts.parts and measured:
        steps = (casadi.repmat(settings[f"{v.name}_quantisation"], v.size, 1) for v in designed.measured)
        values = {"quantisation": symbols.elements(casadi.vertcat(*steps))[:, None]}
        sensors = traced_component(Sensor, "sensors", values, T, settings, {"true": measured, "noise": 0})
    coefficients = None if designed.law is None else designed.law.coefficients
    return Traced(of_poses, relative, coefficients, feedforward, limits, drives, sensors)


def _functions_of_poses(designed: Designed, of_motion: symbols.Symbols, home: Home | None) -> PoseFunctions:
    """With a home, poses and lengths are relative to it."""
    path = path_of(designed.reference)
    later = expected = None
    if designed.feedforward != "none" and designed.reference_inputs:
        vector, ahead = of_motion["motion"], casadi.SX.sym("ahead")
        at = _from_home(extrapolated(motion_in(vector, home), symbols.row(ahead)), home)
        later = symbols.function("extrapolated", {"motion": vector, "ahead": ahead}, {"later": vector_of(at)})
    if designed.watched:
        references = _references(of_motion, [v.name for v in designed.watched], home)
        expected = symbols.function("references_watched", of_motion, {"expected": casadi.vertcat(*references)})
    start, step = (None, None) if designed.law is None else _law(designed, home)
    return PoseFunctions(
        None if path is None else path_function(path, home),
        None if designed.reference is None else motion_function(designed.reference, home),
        *(later, start, expected, step),
    )


def traced_component(
    component: type[Stepped],
    name: str,
    values: Mapping[str, Array],  # of its keys, as expressions of the settings, (1,) or (size, 1)
    period: Array,  # time between its steps, likewise (1,)
    settings: symbols.Symbols,  # of the exported parameters, by name
    inputs: Mapping[str, int],  # the sizes of its inputs; one of 0 is absent
    left_out: tuple[str, ...] = (),  # coefficients of parts that are left out
    wanted: tuple[str, ...] | None = None,  # outputs; by default all
) -> TracedComponent:
    """A component's equations, as a run of N members executes them, for one member, whose sizes are fixed."""
    prepared = component.prepare(values, period)._replace(**dict.fromkeys(left_out))
    parts = {key: np.asarray(part) for key, part in prepared._asdict().items() if part is not None}
    c = casadi.SX.sym(f"{name}_coefficients", sum(part.size for part in parts.values()))
    vectors = {key: casadi.SX.sym(key, size) for key, size in inputs.items()}
    columns = tuple(symbols.elements(v)[:, None] if v.numel() else None for v in vectors.values())
    coefficients = prepared._replace(**dict(zip(parts, _shaped_as(parts.values(), c), strict=True)))
    at_rest = component.start(coefficients, columns)
    x = casadi.SX.sym(f"{name}_states", sum(state.size for state in at_rest))
    following, outputs = component.step(coefficients, tuple(_shaped_as(at_rest, x)), columns)
    by_name = dict(zip(component.outputs, outputs, strict=True))
    results = {f"{name}_next": casadi.vertcat(*map(symbols.column, following))} if x.numel() else {}
    results |= {key: symbols.column(by_name[key]) for key in (wanted or component.outputs)}
    return TracedComponent(
        symbols.function(
            f"coefficients_of_{name}", settings, {name: casadi.vertcat(*map(symbols.column, parts.values()))}
        ),
        symbols.function(name, {f"{name}_coefficients": c, f"{name}_states": x, **vectors}, results),
        int(x.numel()),
    )


def _shaped_as(arrays: Any, vector: casadi.SX) -> list[Array]:
    """The elements of a vector in arrays with these shapes, one after the other."""
    ends = np.cumsum([array.size for array in arrays])
    parts = np.split(symbols.elements(vector), ends)
    return [part.reshape(array.shape) for part, array in zip(parts, arrays, strict=False)]


# ---- motions and forces ----


def motion_function(reference: Reference, home: Home | None = None) -> casadi.Function:
    """CasADi Function `motion`: time -> motion; of a table (pose, rate, acceleration) -> motion."""
    if isinstance(reference, Piecewise):
        parts = {name: casadi.SX.sym(name, 6) for name in ("pose", "rate", "acceleration")}
        pose, *rates = (symbols.row(part) for part in parts.values())
        at = motion_of(pose if home is None else pose + home.pose, *rates)
        if home is not None:
            at = at._replace(position=pose[:, :3], orientation=pose[:, 3:])
        return symbols.function("motion_of_table", parts, {"motion": vector_of(at)})
    if isinstance(reference, HandMotion):
        raise ExportError(
            "the reference is a motion by hand, which is no formula and no table; expected reference = 'inputs', with "
            "the poses of a record as inputs, or a motion file"
        )
    time = casadi.SX.sym("time")
    motion = vector_of(_from_home(reference(symbols.elements(time)), home))
    return symbols.function("motion", {"time": time}, {"motion": motion})


def vector_of(motion: Motion) -> casadi.SX:
    """A motion as one vector (18)."""
    return casadi.densify(symbols.column(np.concatenate([np.asarray(part) for part in motion], axis=-1)))


def motion_in(vector: casadi.SX, home: Home | None = None) -> Motion:
    """The motion in the world of a vector (18), relative to a home if there is one."""
    motion = Motion(*np.split(symbols.row(vector), 6, axis=-1))
    return motion if home is None else _from_home(motion, Home(-home.position, -home.orientation, home.leg_length))


def _from_home(motion: Motion, home: Home | None) -> Motion:
    if home is None:
        return motion
    return motion._replace(position=motion.position - home.position, orientation=motion.orientation - home.orientation)


class _Maps:
    """The leg maps of J = Q R, an array (1, 6, 6), for columns of symbols.

    Gram–Schmidt orthogonalisation of the columns of J needs no pivots, and is invariant to the scale of a column, which
    depends on the units of lengths and angles.
    """

    def __init__(self, J: Array) -> None:
        self.J = symbols.sparse(J[0])
        self._Q, self._R = casadi.qr(self.J)

    def to_pose(self, change: casadi.SX) -> casadi.SX:
        """J⁻¹ v: from legs [m] to the platform [m, rad]."""
        return casadi.solve(self._R, self._Q.T @ change)

    def to_force(self, wrench: casadi.SX) -> casadi.SX:
        """J⁻ᵀ w: from a wrench to leg forces."""
        return self._Q @ casadi.solve(self._R.T, wrench)


def solve_by_orthogonal(matrix: Array, vector: Array) -> Array:
    """Solution of Jᵀ x = w, of arrays (1, 6, 6) and (1, 6), from J = Q R: x = Q R⁻ᵀ w, in constant time."""
    return symbols.row(_Maps(np.swapaxes(matrix, -1, -2)).to_force(symbols.column(vector)))


def feedforward_of(kind: Feedforward, parameters: Parameters, at: Motion) -> casadi.SX:
    """Forces (6,) of "gravity" or "computed_torque"."""
    if kind == "gravity":
        force = static_leg_forces(parameters, at.position, at.orientation, solve=solve_by_orthogonal)
    else:
        state, acceleration = State(*at[:4]), Acceleration(*at[4:])
        force = inverse_dynamics(parameters, state, acceleration, solve=solve_by_orthogonal)
    return symbols.column(force)


def _references(
    inputs: Mapping[str, casadi.SX], names: Iterable[str], home: Home | None, *, whole: bool = False
) -> list[casadi.SX]:
    """References of some signals and accelerations; `whole` in the world."""
    at, parameters, names = motion_in(inputs["motion"], home), symbols.parameters_of(inputs), tuple(names)
    values = dict(zip(REFERENCE, at, strict=True))
    if any(name.startswith("leg_") for name in names):
        values |= legs_of(parameters, at)._asdict()  # type: ignore[arg-type]
    references = {name: symbols.column(value) for name, value in values.items()}
    if home is not None and not whole:
        pose = inputs["motion"][:6]
        references |= {"position": pose[:3], "orientation": pose[3:]}
        if "leg_length" in names:
            references["leg_length"] = change_of_lengths(parameters, home, pose)
    return [references[name] for name in names]


# ---- laws ----


def _law(designed: Designed, home: Home | None) -> tuple[casadi.Function | None, casadi.Function]:
    """The start and the step of a law."""
    law, measured = designed.law, casadi.SX.sym("measured", sum(variable.size for variable in designed.measured))
    inputs = {
        "time": casadi.SX.sym("time"),
        "motion": casadi.SX.sym("motion", N_MOTION),
        "measured": measured,
        "excess": casadi.SX.sym("excess", N_LEGS),
        **{v.name: casadi.SX.sym(v.name, v.size) for v in designed.platform_parameters},
    }
    ends = np.cumsum([0, *(v.size for v in designed.measured)]).tolist()
    parts = casadi.vertsplit(measured, ends) if designed.measured else []
    by_name = {v.name: part for v, part in zip(designed.measured, parts, strict=True)}
    if isinstance(law, FunctionLaw):
        inputs |= {
            "states": casadi.SX.sym("states", law.n_states),
            "feedforward": casadi.SX.sym("feedforward", N_LEGS),
            "coefficients": casadi.SX.sym("coefficients", sum(law.constants.values())),
        }
        # a function may use anything but differences, so its signals are whole ones
        names = [name for name in law.function.name_in() if name.startswith("reference_")]
        values = _references(inputs, [name.removeprefix("reference_") for name in names], home, whole=True)
        whole = by_name if home is None else {name: v + home.of(name, v.numel()) for name, v in by_name.items()}
        force, following = law({**inputs, **whole, **dict(zip(names, values, strict=True))})
        if home is not None:
            following = following - inputs["states"]
        outputs = {"force": force, **({"next": following} if law.n_states else {})}
        return None, symbols.function("law", inputs, outputs)
    assert isinstance(law, ExportedLaw)
    references = dict(zip(law.signals, _references(inputs, law.signals, home), strict=True))
    if "orientation" in law.signals:  # in the turns of the reference
        angles = by_name["orientation"], references["orientation"]
        by_name["orientation"] = symbols.column(nearest_angle(*map(symbols.row, angles)))
    r, y = (casadi.vertcat(*(values[name] for name in law.signals)) for values in (references, by_name))
    # whether equal references and measurements leave the law at rest without a force, as they do a PID
    of_differences = law.coefficients is not None or law.space == "task"
    if home is not None and not of_differences:
        unit = np.eye(r.numel())
        equal = np.concatenate(inputs_of(law.kinds, unit, unit, np.zeros((N_LEGS, r.numel()))))
        forced = [np.asarray(block, dtype=float) @ equal for block in (law.system.B, law.system.D)]
        of_differences = not any(np.abs(block).max(initial=0.0) > 0 for block in forced)
    if home is not None and not of_differences:
        at_home = np.concatenate([home.of(name, references[name].numel()) for name in law.signals])
        r, y = r + at_home, y + at_home
    return _linear(law, inputs, r, y, home)


def _linear(
    law: ExportedLaw, inputs: dict[str, casadi.SX], r: casadi.SX, y: casadi.SX, home: Home | None
) -> tuple[casadi.Function | None, casadi.Function]:
    """x⁺ = A x + B u and the forces; in task space, the displacement and the lengths of the last sample are states."""
    n = len(law.system.A)
    extra = 2 * N_LEGS if law.space == "task" else 0
    inputs |= {"states": casadi.SX.sym("states", n + extra), "coefficients": law.symbols}
    x, pose, before = casadi.vertsplit(inputs["states"], [0, n, n + extra // 2, n + extra])
    maps, excess, r_at_rest, y_at_rest = None, inputs["excess"], r, y
    memory = memory_at_rest = casadi.SX(0, 1)
    if extra:
        at, lengths = motion_in(inputs["motion"], home), y
        maps = _Maps(leg_jacobian(symbols.parameters_of(inputs), at.position, at.orientation))
        r_at_rest, y_at_rest = displacements(maps.to_pose, pose, lengths, r, lengths)
        memory_at_rest = casadi.vertcat(pose, lengths)
        r, y = displacements(maps.to_pose, pose, before, r, lengths)
        memory = casadi.vertcat(y, lengths) if home is None else casadi.vertcat(y - pose, lengths - before)
        excess = maps.J.T @ excess  # as a wrench [N, N m]
    u = casadi.vertcat(*inputs_of(law.kinds, r, y, excess))
    of_x = np.asarray(law.system.A) - np.eye(n) if home is not None else np.asarray(law.system.A)
    A, B, C, D = (symbols.sparse(np.asarray(block)) for block in (of_x, law.system.B, law.system.C, law.system.D))
    following, force = A @ x + B @ u, C @ x + D @ u
    outputs = {"force": force if maps is None else maps.to_force(force)}
    if not n + extra:
        return None, symbols.function("law", inputs, outputs)
    step = symbols.function("law", inputs, {**outputs, "next": casadi.vertcat(following, memory)})
    u = casadi.vertcat(*inputs_of(law.kinds, r_at_rest, y_at_rest, casadi.SX.zeros(N_LEGS)))
    # the steady state under constant inputs, with the integrals of a state: none before the first sample
    at_rest = casadi.SX(0, 1)
    if n:
        at_rest = symbols.sparse(law.start) @ u + symbols.sparse(np.asarray(law.integrating)) @ x
    return symbols.function("start", inputs, {"states_at_rest": casadi.vertcat(at_rest, memory_at_rest)}), step
