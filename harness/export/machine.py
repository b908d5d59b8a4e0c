"""A machine with its loop as one block of words, and the plain C of c/machine that runs it: pages and streams.

The block has everything that a run needs: coefficients, motion, noise, changes, start values and memory, and what may
be turned while it runs. The C is the same for all loops of shipped components; see c/machine/machine.h. A motion's kind
is a number of C's functions, see `machine_equations`; a table or path is its pieces.
"""

import ctypes
import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from hashlib import sha256
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.plant.layout import MemberFailure as Failure
from gough_stewart.harness.control.by_hand import HAND_FILTERS, Smoothing
from gough_stewart.harness.control.component import N_FAULTS, Notch
from gough_stewart.harness.control.controllers import Feedforward, OpenLoop, SixChannels
from gough_stewart.harness.control.linear import held_plant, space_of
from gough_stewart.harness.control.linear_controller import linear_of
from gough_stewart.harness.control.pid import DAMPING_RATIO, DerivativeOn, modal_masses
from gough_stewart.harness.control.state_space import METHODS, Method
from gough_stewart.harness.errors import ControllerError, ExportError
from gough_stewart.harness.experiment.preparation import Prepared, prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.host import MEMORY, LoopBlock, LoopHost
from gough_stewart.harness.loop.libraries import are_compiled, loop_kernel
from gough_stewart.harness.loop.loop import Actuators, Change, Loop, LoopSettings, ScheduledChanges, Sensors
from gough_stewart.harness.motion.motion import Piecewise, Reference
from gough_stewart.harness.motion.references import AboutPose, Chirp, Circle, Hold, PointToPoint, Sine, Step
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.lanes import BATCH_FIELDS, BatchPlant
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model import interface
from gough_stewart.model.errors import MembersError
from gough_stewart.model.interface import IDEAL, Variant
from gough_stewart.model.vectors import FloatArray

# Of a block: its version, number of words, and whether it is open; then room for what C makes of its fields.
HEAD, ROOM, _VERSION = 4, 352, 4
# The last row of a machine without an end.
_NEVER = 2**53
N_MOTION = 18
# Places in the results of `machine_margins`, see machine.h.
POLES = 4 + 5 * N_LEGS + 1
# Samples of delay for which there is room.
MOST_DELAY = 12
# What may be turned, in the order of C.
REQUESTED = (
    *("bandwidth", "damping_ratio", "integral_time", "filter_time", "proportional", "derivative", "integral"),
    *("delay", "force_limit", "noise", "quantisation"),
)
_ENCODERS = "leg_length"
# There has to be room in the loop for what is turned.
_TURNED = LoopSettings(None, Sensors({_ENCODERS: 1.0}, {_ENCODERS: 1.0}), Actuators(1.0, delay=MOST_DELAY))
_FEEDFORWARD: tuple[Feedforward, ...] = ("none", "gravity", "computed_torque")
# What the first two numbers of a motion's kinds mean; with a faded one C has a function of its own.
_GIVEN, _PIECES, _FADED = "given", "pieces", "faded"

# In words why a run ended early.
FAILURES: dict[int, str] = {
    Failure.NOT_FINITE: "a number is not finite",
    Failure.PITCHED: "the pitch is near 90°",
    Failure.SINGULAR: "the platform is in a singular pose",
    Failure.PASSED_SINGULAR: "the platform passed a singular pose",
    Failure.TOO_MANY_STEPS: "the motion is too fast to follow",
    Failure.COMMAND: "the loop diverged: the controller's forces grew beyond all limits",
    Failure.STROKE: "a leg is beyond its stroke, which ends the run",
    Failure.AWAY: "the loop diverged: the platform is too far from its reference",
    Failure.NOT_STARTED: "the platform cannot start from there",
}

# Fields of structures of C by their kinds: WHOLE numbers, NUMBERs, PLACEs of arrays.
_MACHINE_FIELDS = {
    "WHOLE": ("n_changes", "kept", "forever", "n_samples"),
    "PLACE": (
        *("change_rows", "change_parameters", "change_inputs", "change_faults"),
        *("sample_rows", "injected", "clock", "injections"),
    ),
}
_PLAN_FIELDS = {
    "WHOLE": ("kind", "n_pieces", "feedforward"),
    "NUMBER": ("end", "last", "ahead"),
    "PLACE": (
        *("coefficients", "begins", "pieces", "platform", "given", "given_at", "target", "smoothing", "smoothed"),
        *("samples", "reference", "forces", "jacobians", "inverses"),
    ),
}
_TURN_FIELDS = {
    "WHOLE": ("variant", "n_plant", "most_states"),
    "NUMBER": ("sample_time", "filter_time", "tracking_time"),
    "PLACE": (
        *("channels", "masses", "gains", "notch", "wanted", "used"),
        *("A", "B", "C", "to_force", "work", "results"),
    ),
}


class Block(NamedTuple):
    """A machine as words (n,), and the variant of plants that its C has to have."""

    words: NDArray[np.int64]
    variant: Variant = IDEAL


class BlockField(NamedTuple):
    name: str  # `reference`, `reference.row`, `plan_kind`
    kind: str
    member: str  # of `machine` in C


# ---- fields ----


@cache
def fields() -> dict[str, int]:
    """The number of each field, by name: `reference`, `reference.row`, `signals`."""
    return {field.name: k for k, field in enumerate(all_fields())}


@cache
def all_fields() -> tuple[BlockField, ...]:
    """Fields of the plant, of the loop and its tables, and of the structures above."""
    rows = [(name, "WHOLE" if k < 2 else "PLACE", f"members.{name}") for k, name in enumerate(BATCH_FIELDS)]
    kinds = {ctypes.c_double: "NUMBER", ctypes.c_void_p: "PLACE"}
    for name, kind, *_ in LoopBlock._fields_:
        if issubclass(kind, ctypes.Structure):
            rows.append((name, "PLACE", f"loop.{name}.at"))
            parts = [part for part, *_ in kind._fields_ if part != "at"]
            rows += [(f"{name}.{part}", "WHOLE", f"loop.{name}.{part}") for part in parts]
        elif name != "law":
            rows.append((name, kinds.get(kind, "WHOLE"), f"loop.{name}"))
    for prefix, structure, by_kind in (
        *(("", "", _MACHINE_FIELDS), ("plan_", "plan.", _PLAN_FIELDS), ("turn_", "turned.", _TURN_FIELDS)),
    ):
        rows += [(prefix + name, kind, structure + name) for kind, names in by_kind.items() for name in names]
    return tuple(BlockField(*row) for row in rows)


@cache
def version(variant: Variant = IDEAL) -> int:
    """Of the layout of blocks: a digest of all fields, and of the parts of the plant, which give sizes."""
    text = " ".join([f"{_VERSION} {all_fields()}", *variant.parts])
    return int(sha256(text.encode()).hexdigest()[:12], 16)


# ---- a run as a block ----


def endless_machine(experiment: Experiment, kept: int, host: str) -> tuple[Block, Prepared, dict[str, Any]]:
    """The machine of an experiment that goes on until its host ends it, what is prepared of it, and what may be turned.

    A call keeps at most so many rows. `host` is what errors say of who runs it, such as "a page".
    """
    name, plant = experiment.where, experiment.plant
    changes = [change.has_settings or change.enabled is not None for change in experiment.change]
    for is_so, text in (
        (
            experiment.code,
            f"executes {', '.join(map(str, experiment.code))}, which {host} cannot; expected a controller of the types "
            "pd, pid, state_space or open_loop, and the plant 'model'",
        ),
        (plant.kind != "model", f"has the plant '{plant.kind}'; expected 'model': set plant.kind=model"),
        (
            plant.fixed_step_size,
            f"has plant.fixed_step_size {plant.fixed_step_size:g}; {host} steps by error control: set "
            "plant.fixed_step_size=0",
        ),
        (
            any(changes),
            f"changes settings of its loop during the run, which {host} cannot; expected [[change]] of parameters "
            "alone",
        ),
    ):
        if is_so:
            raise ExportError(f"{name} {text}")
    prepared = prepare(experiment)
    try:
        turned = turning(experiment, prepared, host)
        return _block(experiment, prepared, kept, turned), prepared, turned
    except ControllerError as error:
        kind = getattr(experiment.controller, "type", "")
        raise ExportError(f"{name}: controller '{kind}': {error}") from error


def _block(  # noqa: PLR0912 - one road, in sections
    experiment: Experiment, prepared: Prepared, kept: int, turned: Mapping[str, Any]
) -> Block:
    """A run of an experiment; it does not end with the run, if it has a plan or needs none.

    Jitter and injection end with the run.
    """
    loop, planned = prepared.loop, _planned(experiment, prepared, kept)
    batch_plant = BatchPlant(
        [prepared.machine],
        [prepared.start],
        tolerance=experiment.plant.tolerance,
        kernel=loop_kernel(Variant.of(prepared.machine)) if are_compiled([prepared.controller]) else None,
    )
    with batch_plant as plant, prepared.law_in_a_run() as law_from:
        changes, room = _changes(plant, loop), Change(0.0, faults=np.zeros(N_FAULTS), settings=_TURNED)
        host = LoopHost(plant, replace(loop, changes=(room, *loop.changes)))
        host.control(None if law_from is None or loop.reference is None else law_from(loop.reference[0], host.reading))
        plant.set_inputs(changes["inputs"][:1])
        host.follow(changes["faults"][:1], np.zeros((1, 0)))
        if failures := plant.begin():
            raise MembersError(failures)
        values: dict[str, Any] = {
            **{name: getattr(plant.batch, name)[..., 0] for name in BATCH_FIELDS[2:]},
            **{"blocks": 1, "stride": 1, "parameters": plant.batch.parameters[0, :, 0]},
            **{"kept": kept, "n_changes": len(changes["rows"]) - 1},
            **{f"change_{name}": array[1:] for name, array in changes.items()},
            "plan_kind": -1,
            **{f"turn_{name}": value for name, value in turned.items()},
        }

        # the loop: members are left out, and tables begin at their first row
        c = host.structure
        for name, kind, *_ in LoopBlock._fields_:
            value = getattr(c, name)
            if issubclass(kind, ctypes.Structure):
                array = host.arrays.get(value.at or 0)
                if array is not None:
                    values[name] = array[..., 0] if array.ndim > 1 else array
                    values[f"{name}.row"], values[f"{name}.element"] = math.prod(array.shape[1:-1]), 1
            elif kind is not ctypes.c_void_p:
                values[name] = value
            elif value and name != "law":
                array = host.arrays[value]
                values[name] = array if name not in MEMORY else array[:1] if array.ndim == 1 else array[:, 0]
        tables: dict[str, NDArray[Any] | None] = {
            "row_signals": np.zeros((kept, signals.SIZE)),
            "row_forces": np.zeros((kept, N_LEGS)),
            "row_force_limited": np.zeros((kept, N_LEGS), np.uint8),
            "row_rate_limited": np.zeros((kept, N_LEGS), np.uint8),
        }
        if turned["variant"] >= 0:
            values["turn_channels"] = _channels_of(host, VARIANTS[turned["variant"]])

        # beyond the run samples are regular, nothing is injected, and constant forces are those of each sample
        if planned is not None or loop.reference is None:
            samples = kept // loop.timing.steps_a_sample + 2
            rows = np.ascontiguousarray(np.atleast_2d(loop.timing.rows_of_samples)[0], np.int64)
            injected = np.zeros(0)
            if loop.injection is not None:
                injected = loop.injection.reshape(len(loop.injection), -1)[:, :N_LEGS]
            values |= {
                **{"last": _NEVER, "feedforward.row": 0, "forever": 1, "n_samples": len(rows), "sample_rows": rows},
                **{"injected": injected, "clock": np.zeros(samples, np.int64)},
                "injections": np.zeros((samples if injected.size else 0, N_LEGS)),
            }
        if planned is not None:
            values |= {f"plan_{name}": value for name, value in planned.items()}
            tables |= {name: planned.get(of_plan) for name, of_plan in _TABLES.items()}
        for name, table in tables.items():
            values |= {name: table, f"{name}.row": 0, f"{name}.element": int(table is not None)}
            if table is not None:
                values[f"{name}.row"] = table.shape[1]
            if name in _TABLES:  # C sets the places of these tables in each call
                values[name] = None
        return Block(_words(values, plant.batch.variant), plant.batch.variant)


# Tables of the loop that a plan replaces, and where C computes them.
_TABLES = {"reference": "reference", "feedforward": "forces", "jacobian": "jacobians", "inverse": "inverses"}


def _words(values: Mapping[str, Any], variant: Variant) -> NDArray[np.int64]:
    """The words of a block: its head, its fields, then the arrays that these point to."""
    words, data = list[int](), list[NDArray[np.int64]]()
    end = HEAD + ROOM + len(all_fields())
    for field in all_fields():
        value = values.get(field.name)
        if field.kind == "PLACE":
            raw = b"" if value is None else np.ascontiguousarray(value).tobytes()
            array = np.frombuffer(raw + bytes(-len(raw) % 8), np.int64)
            words.append(end if array.size else 0)
            data.append(array)
            end += len(array)
        else:
            number = value or 0
            words.append(int(np.float64(number).view(np.int64)) if field.kind == "NUMBER" else int(number))
    head = np.zeros(HEAD + ROOM, np.int64)
    head[:2] = version(variant), end
    return np.concatenate([head, np.array(words, np.int64), *data])


def _changes(plant: BatchPlant, loop: Loop) -> dict[str, NDArray[Any]]:
    """Rows of the start and of each change, and parameters, inputs (n, 12) and faults from there on.

    The plant has those of the start again. Without faults in the loop there are none (n, 0), and those of a hand stay.
    """
    scheduled, batch = ScheduledChanges(loop, plant), plant.batch
    rows = sorted({0, *scheduled.by_row})
    parameters, inputs, faults = list[FloatArray](), list[FloatArray](), list[FloatArray]()
    first: tuple[FloatArray, FloatArray] = batch.parameters, batch.states
    for row in rows:
        scheduled.apply(row)
        parameters.append(batch.parameters[0, :, 0].copy())
        inputs.append(scheduled.inputs[0].copy())
        faults.append(scheduled.faults[0, : N_FAULTS * loop.has_faults].copy())
        if row == 0:
            first = batch.parameters.copy(), batch.states.copy()
    # a plant that has not begun moves its motors with its parameters
    batch.parameters[...], batch.states[...] = first
    return {
        **{"rows": np.array(rows, np.int64), "parameters": np.array(parameters)},
        **{"inputs": np.array(inputs), "faults": np.array(faults)},
    }


# ---- motions ----


def _planned(experiment: Experiment, prepared: Prepared, kept: int) -> dict[str, Any] | None:
    """The fields of `planned` of C: what a run follows; None if C lacks its motion, or forces are constant."""
    reference, loop = prepared.reference, prepared.loop
    motion = None if reference is None or isinstance(experiment.controller, OpenLoop) else planned_motion(reference)
    if motion is None:
        return None
    every, T = loop.timing.steps_a_sample, loop.timing.sample_time
    samples = kept // every + 2
    parameters = [np.ravel(getattr(prepared.platform, v.name)) for v in interface.PLATFORM_PARAMETERS]
    maps = ("jacobians", "inverses") if getattr(prepared.controller, "space", "leg") == "task" else ()
    return {
        **motion,
        "n_pieces": len(motion["begins"]),
        "platform": np.concatenate(parameters).astype(float),
        "feedforward": _FEEDFORWARD.index(experiment.controller.feedforward),
        "ahead": (experiment.loop.delay + 0.5) * T,
        "given": np.zeros(N_MOTION),
        "given_at": np.zeros(1),
        "target": np.zeros(6),
        "smoothing": np.hstack(Smoothing.prepare(HAND_FILTERS, T)),
        "smoothed": np.zeros(18),
        "samples": -np.ones(1, np.int64),
        "reference": np.zeros((kept + every, 30)),
        "forces": np.zeros((samples, N_LEGS)),
        **{name: np.zeros((samples, 36)) for name in maps},
    }


def planned_motion(reference: Reference) -> dict[str, Any] | None:
    """A motion by its kind, coefficients, pieces (when each begins, and (n, 6, 6), highest power first) and end [s].

    None for a motion that C lacks.
    """
    kinds = (_GIVEN, _PIECES, *(name for name, _ in motion_variants()))
    coefficients = begins = pieces = np.zeros(0)
    if isinstance(reference, Piecewise):
        name = _PIECES
        begins, pieces = reference.pieces
    elif isinstance(reference, AboutPose):
        parts = [str(getattr(reference, "type", "")), str(getattr(reference, "plane", ""))]
        name = "_".join(filter(None, [*parts, _FADED if getattr(reference, "fade_in", 0.0) > 0 else ""]))
        if name not in kinds:
            return None
        values = [np.ravel(getattr(reference, key)) for key in keys_of(type(reference), name)]
        coefficients = np.concatenate(values).astype(float)
    else:
        return None
    arrays = {"coefficients": coefficients, "begins": begins, "pieces": pieces}
    return {
        "kind": kinds.index(name),
        **arrays,
        "end": float(getattr(reference, "end", math.inf)),
        "last": reference.defined_until,
    }


def motion_variants() -> list[tuple[str, AboutPose]]:
    """Each kind by name, with structure in the place of its keys."""
    plain: list[AboutPose] = [kind.model_construct() for kind in (Hold, Step, PointToPoint)]
    fading: list[tuple[str, AboutPose]] = [("sine", Sine.model_construct()), ("chirp", Chirp.model_construct())]
    fading += [(f"circle_{plane}", Circle.model_construct(plane=plane)) for plane in ("xy", "xz", "yz")]
    names = [str(type(motion).model_fields["type"].default) for motion in plain]
    both = [(f"{name}{ending}", motion) for name, motion in fading for ending in ("", f"_{_FADED}")]
    return [*zip(names, plain, strict=True), *both]


def keys_of(kind: type[AboutPose], name: str) -> list[str]:
    """The keys that are coefficients, in order."""
    structure = {"type", "plane"} | ({"fade_in"} if _FADED not in name else set())
    return [key for key in kind.model_fields if key not in structure]


# ---- what is turned ----


class TurnableLaw(NamedTuple):
    """What of a law is fixed while its gains are turned; C has the laws by number."""

    derivative_on: DerivativeOn
    integrates: bool
    discretisation: Method
    has_notch: bool


_DERIVATIVES: tuple[DerivativeOn, ...] = ("error", "measurement")
VARIANTS = tuple(TurnableLaw(*fixed) for fixed in product(_DERIVATIVES, (False, True), METHODS, (False, True)))


def _channels_of(host: LoopHost, law: TurnableLaw) -> NDArray[np.int64]:
    """Of each entry of a law (n, 2) its channel, and its place in that one's [C D; A B].

    The states of all channels' controllers come first, then those of their notches.
    """
    rows, columns, of_controllers, of_notches = *host.entries, 1 + law.integrates, 2 * law.has_notch

    def channel_of(states: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        beyond = states - N_LEGS * of_controllers
        notch, its_state = np.divmod(beyond, of_notches or 1)
        channel, state = np.divmod(states, of_controllers)
        return np.where(beyond < 0, channel, notch), np.where(beyond < 0, state, of_controllers + its_state)

    of_channel, n = of_controllers + of_notches, host.structure.n_states
    channel, state = channel_of(rows - N_LEGS)
    row = np.where(rows < N_LEGS, 0, 1 + state)
    column = np.where(columns < n, channel_of(columns)[1], of_channel + (columns - n) // N_LEGS)
    place = row * (of_channel + host.structure.kinds) + column
    return np.stack([np.where(rows < N_LEGS, rows, channel), place], axis=1)


def turning(experiment: Experiment, prepared: Prepared, host: str = "a page") -> dict[str, Any]:
    """The fields of what may be turned while an experiment's loop runs, and of its linear loop: see machine.h."""
    linear, loop, choice = linear_of(prepared.controller), prepared.loop, experiment.controller
    gains, actuators, timing = choice.gains(prepared.platform), loop.actuators, loop.timing
    limit, encoders = actuators.force_limit, (loop.sensors.noise, loop.sensors.quantisation)
    if limit is not None and np.ndim(limit) > 1:
        raise ExportError(
            f"force_limit is {np.ravel(limit).tolist()} N, and {host} has one for all legs; expected one number, "
            "for instance actuators.force_limit = that of the weakest leg"
        )
    wanted = {
        "bandwidth": getattr(choice, "bandwidth", None) or 0.0,
        "damping_ratio": getattr(choice, "damping_ratio", None) or DAMPING_RATIO,
        "integral_time": getattr(choice, "integral_time", None) or 1.0,
        "filter_time": 0.0,
        **dict.fromkeys(("proportional", "derivative", "integral"), 1.0),
        "delay": actuators.delay,
        "force_limit": math.inf if limit is None else limit,
        **{name: sizes.get(_ENCODERS, 0.0) for name, sizes in zip(REQUESTED[-2:], encoders, strict=True)},
    }
    values = {
        "variant": -1,
        "sample_time": timing.sample_time,
        "wanted": np.array([float(wanted[name]) for name in REQUESTED]),
    }

    # gains of channels, if all have the same actions
    if isinstance(choice, SixChannels) and gains is not None:
        differentiates, integrates = np.asarray(gains.derivative) > 0, np.asarray(gains.integral) > 0
        if differentiates.all() and integrates.any() == integrates.all():
            notch = choice.notch
            law = TurnableLaw(choice.derivative_on, bool(integrates.all()), choice.discretisation, notch is not None)
            used = np.concatenate([*gains.channels[:3], [gains.filter_time], gains.tracking_time])
            values |= {
                "variant": VARIANTS.index(law),
                "masses": modal_masses(prepared.platform, choice.space),
                "gains": used,
                "used": used,
                "filter_time": choice.derivative_filter or 0.0,
                "tracking_time": getattr(choice, "anti_windup_time", None) or 0.0,
                "notch": np.zeros(3) if notch is None else np.array([getattr(notch, key) for key in Notch.keys]),
            }

    # the plant in the first pose of the reference, as `margins` has it, and room for its analysis; the linear loop in C
    # knows neither the sensors' own clock nor jitter
    motion = prepared.motion
    if linear is not None and motion is not None and not loop.worst_delay:
        pose = motion.position[0], motion.orientation[0]
        lag, side = float(actuators.lag), loop.sensors.side
        plant = held_plant(prepared.machine, linear, timing.sample_time, pose, lag=lag, side=side)
        (_, readings), to_force = space_of(prepared.platform, linear, pose)
        n, both = len(plant.A), len(plant.A) + len(linear.system.A)
        most = both + N_LEGS * max(int(actuators.delay), MOST_DELAY)
        work = 2 * (2 * both * (both + 2 * N_LEGS) + most**2 + most)
        values |= {"n_plant": n, "A": plant.A, "B": plant.B, "C": readings @ plant.C, "to_force": to_force}
        values |= {"work": np.zeros(work), "results": np.zeros(POLES + 4 * most), "most_states": most}
    return values
