"""A machine with its loop as one block of words, for the plain C of c/machine: exports, units, pages.

The block has everything that a run needs: coefficients, motion, noise, changes, start values and memory. The C is the
same for all loops of shipped components; see c/machine/machine.h.
"""

import ctypes
import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.cache import COMPILER, check_installed, digest_of
from gough_stewart.fmu_build.component import Sources
from gough_stewart.fmu_build.libraries import machine_library, machine_sources
from gough_stewart.fmu_build.toolchain import WEB_ASSEMBLY
from gough_stewart.harness.control.controllers import Feedforward, OpenLoop
from gough_stewart.harness.control.faults import N_FAULTS
from gough_stewart.harness.control.laws_of_members import LawFrom, LinearLaw
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.plan import BY_HAND, FEEDFORWARD, N_MOTION, Plan, planned_motion, smoothing
from gough_stewart.harness.export.turned import FIELDS as TURNING
from gough_stewart.harness.export.turned import Turned
from gough_stewart.harness.loop.compiled_host import MEMORY, CompiledHost, LoopBlock
from gough_stewart.harness.loop.libraries import CompiledLaw, compiled_form, components_header
from gough_stewart.harness.loop.loop import Loop, ScheduledChanges
from gough_stewart.harness.loop.python_host import SensorReadings
from gough_stewart.harness.motion.motion import ROUNDING
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.lanes import BATCH_FIELDS, LanesPlant
from gough_stewart.harness.plants.plant import seen
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model import interface
from gough_stewart.model.errors import MembersError
from gough_stewart.model.interface import IDEAL, Variant
from gough_stewart.model.process.installed import TRACER, prebuilt_content, state_of_package, state_of_texts
from gough_stewart.model.vectors import FloatArray

# In the manifest of prebuilt files.
MACHINE = "machine.wasm"
# Packages besides the model and its units from which the C is made.
_TRACED = tuple(f"gough_stewart.harness.{name}" for name in ("control", "export", "loop", "motion", "plants"))
# Of a block: its version, number of words, and whether it is open; then room for what C makes of its fields.
_HEAD, _ROOM, _VERSION = 4, 352, 3
# The last row of a machine without an end.
_NEVER = 2**53
_CHANGES = (
    ("n_changes", "WHOLE"),
    ("kept", "WHOLE"),
    ("change_rows", "PLACE"),
    ("change_parameters", "PLACE"),
    ("change_inputs", "PLACE"),
    ("change_faults", "PLACE"),
    ("forever", "WHOLE"),
    ("n_samples", "WHOLE"),
    ("sample_rows", "PLACE"),
    ("injected", "PLACE"),
    ("clock", "PLACE"),
    ("injections", "PLACE"),
)
# `planned` of c/machine/machine.c.
_PLAN = (
    ("kind", "WHOLE"),
    ("coefficients", "PLACE"),
    ("n_pieces", "WHOLE"),
    ("begins", "PLACE"),
    ("pieces", "PLACE"),
    ("end", "NUMBER"),
    ("platform", "PLACE"),
    ("feedforward", "WHOLE"),
    ("ahead", "NUMBER"),
    ("given", "PLACE"),
    ("given_at", "PLACE"),
    ("target", "PLACE"),
    ("smoothing", "PLACE"),
    ("smoothed", "PLACE"),
    ("samples", "PLACE"),
    ("reference", "PLACE"),
    ("forces", "PLACE"),
    ("jacobians", "PLACE"),
    ("inverses", "PLACE"),
)


class Block(NamedTuple):
    """A machine as words (n,), and the user's law and the variant of plants that its C has to have."""

    words: NDArray[np.int64]
    law: Any = None
    variant: Variant = IDEAL


class _Field(NamedTuple):
    name: str  # of C: `with.reference.at`
    kind: str  # WHOLE, NUMBER, PLACE, or LAW


@cache
def fields() -> dict[str, int]:
    """The number of each field, by name: `reference`, `reference.row`, `signals`."""
    return {each.name.partition(".")[2].removesuffix(".at"): k for k, each in enumerate(_all_fields())}


def machine_c(law: Any = None, variant: Variant = IDEAL) -> Sources:
    """Units and headers of c/machine for plants of a variant, with a user's law if there is one."""
    return _shipped_c(variant) if law is None else machine_sources(*_headers(variant), law, variant)


def shipped_wasm(variant: Variant = IDEAL) -> bytes:
    """The C of shipped components as WebAssembly: what came with the package, else from the cache, else compiled.

    The package has that of ideal plants.

    Raises
    ------
    BuildError, OSError
        It is not in the cache and cannot be compiled, or the cache cannot be written.
    """
    content = None if variant.parts else prebuilt_content(MACHINE, machine_texts())
    if content is None:
        check_installed(TRACER, COMPILER)
        module = machine_library(machine_c(variant=variant), WEB_ASSEMBLY)
        content = module.kept(WEB_ASSEMBLY).read_bytes()
    return content


@cache
def machine_texts() -> str:
    """The state of all sources that the C depends on, for `prebuilt`."""
    return digest_of("".join([state_of_texts(), *map(state_of_package, _TRACED)]).encode())


@cache
def _shipped_c(variant: Variant) -> Sources:
    return machine_sources(*_headers(variant), variant=variant)


@cache
def _headers(variant: Variant) -> tuple[str, str, str, str]:
    from gough_stewart.harness.export.design_c import design_header  # these import CasADi
    from gough_stewart.harness.export.plan_c import plan_header

    return components_header(), _fields_header(variant), plan_header(), design_header()


def machine_block(
    plant: LanesPlant,
    law_from: LawFrom | None,
    loop: Loop,
    plan: Plan | None = None,
    kept: int = 64,
    forever: bool = False,
    turned: Turned | None = None,
) -> Block:
    """A run of one member as a block.

    Parameters
    ----------
    plant
        At its start, of one member.
    plan
        What it follows, which C computes row by row if it has this kind of motion; otherwise tables.
    kept
        Rows that a call of `machine_run` keeps, at most.
    forever
        It does not end with the run, if it has a plan or needs none; jitter and injection do.
    turned
        What may be turned while it runs, and the linear loop.

    Raises
    ------
    ControllerError
        The controller has no plain operations.
    MembersError
        The plant cannot start.
    """
    changes = _changes(plant, loop)
    readings = SensorReadings(loop, 1, np.zeros((1, N_FAULTS)))
    reading = readings.read(0, seen(plant, loop.sensors.side))
    law = None if law_from is None or loop.reference is None else law_from(loop.reference[0], reading)
    form = law if law is None or isinstance(law, LinearLaw) else compiled_form(law)
    if law is not None and form is None:
        raise ControllerError(
            "the controller has no plain operations; expected a linear one, or a CasADi function, which C can have"
        )
    plant.set_inputs(changes.inputs[:1])
    own = CompiledHost(plant, form, loop if turned is None else turned.with_room(loop), reading)
    own.fail(changes.faults[:1])
    if failures := plant.begin():
        raise MembersError(failures)
    arrays = own.arrays
    if turned is not None:
        turned.begin(own.structure, arrays)
    outputs: dict[str, NDArray[Any]] = {
        "row_signals": np.zeros((kept, signals.SIZE)),
        "row_forces": np.zeros((kept, N_LEGS)),
        "row_force_limited": np.zeros((kept, N_LEGS), np.uint8),
        "row_rate_limited": np.zeros((kept, N_LEGS), np.uint8),
    }
    planned = _planned(plan, loop, own.structure, kept)
    made = _Words()
    c = own.structure
    endless = forever and (bool(planned) or loop.reference is None)
    if endless:
        c.last = _NEVER
    beyond = _beyond(loop, kept) if endless else {}
    own_parts: dict[str, dict[str, Any]] = {
        "own": {**beyond, **changes.words, "kept": kept},
        "plan": {f"plan_{key}": value for key, value in (planned or {"kind": -1}).items()},
        "turn": {} if turned is None else {f"turn_{key}": value for key, value in turned.fields.items()},
    }
    for name, kind in _all_fields():
        part, _, rest = name.partition(".")
        if part in own_parts:
            made.value(kind, own_parts[part].get(rest, 0))
        elif planned and rest.partition(".")[0] in _TABLES:
            made.planned_table(rest, planned)
        elif endless and rest == "feedforward.row":
            made.add(0)  # of constant forces
        elif part == "of":
            made.batch(rest, plant)
        elif rest.partition(".")[0] in outputs:
            made.output(rest, outputs[rest.partition(".")[0]])
        elif kind == "LAW":
            made.add(int(bool(c.law)))
        else:
            made.loop(rest, kind, c, arrays)
    law_function = form.law.function if isinstance(form, CompiledLaw) else None
    return Block(made.block(plant.batch.variant), law_function, plant.batch.variant)


# Tables of the loop that a plan replaces, and where C computes them.
_TABLES = {"reference": "reference", "feedforward": "forces", "jacobian": "jacobians", "inverse": "inverses"}


def _planned(plan: Plan | None, loop: Loop, c: Any, kept: int) -> dict[str, Any]:
    """The fields of `planned`; none without a plan, or if C lacks its motion."""
    motion = None if plan is None else planned_motion(plan.reference)
    if plan is None or motion is None:
        return {}
    every = loop.timing.steps_a_sample
    samples = kept // every + 2
    parameters = [np.ravel(getattr(plan.platform, v.name)) for v in interface.PLATFORM_PARAMETERS]
    maps = {name: np.zeros((samples, 36)) for name in ("jacobians", "inverses") if c.inverse.at}
    return {
        **motion._asdict(),
        "n_pieces": len(motion.begins),
        "platform": np.concatenate(parameters).astype(float),
        "feedforward": FEEDFORWARD.index(plan.feedforward),
        "ahead": plan.ahead,
        "given": np.zeros(N_MOTION),
        "given_at": np.zeros(1),
        "target": np.zeros(6),
        "smoothing": np.concatenate([smoothing(each, loop.timing.sample_time) for each in (plan.by_hand or BY_HAND)]),
        "smoothed": np.zeros(18),
        "samples": -np.ones(1, np.int64),
        "reference": np.zeros((kept + every, 30)),
        "forces": np.zeros((samples, N_LEGS)),
        **maps,
    }


def _beyond(loop: Loop, kept: int) -> dict[str, Any]:
    """What C needs for samples beyond the run."""
    samples = kept // loop.timing.steps_a_sample + 2
    rows = np.ascontiguousarray(np.atleast_2d(loop.timing.rows_of_samples)[0], np.int64)
    injected = np.zeros(0) if loop.injection is None else loop.injection.reshape(len(loop.injection), -1)[:, :N_LEGS]
    return {
        "forever": 1,
        "n_samples": len(rows),
        "sample_rows": rows,
        "injected": injected,
        "clock": np.zeros(samples, np.int64),
        "injections": np.zeros((samples if injected.size else 0, N_LEGS)),
    }


class _Changes(NamedTuple):
    """What changes at rows, at the begin (row 0) first."""

    rows: NDArray[np.int64]
    parameters: FloatArray  # (n, N_PARAMETERS)
    inputs: FloatArray  # (n, 12)
    faults: FloatArray  # (n, N_FAULTS), or (n, 0) if the loop has none, so that those of a hand stay

    @property
    def words(self) -> dict[str, Any]:
        """What is after the begin, by field."""
        names = ("change_rows", "change_parameters", "change_inputs", "change_faults")
        return {"n_changes": len(self.rows) - 1, **{name: each[1:] for name, each in zip(names, self, strict=True)}}


def _changes(plant: LanesPlant, loop: Loop) -> _Changes:
    """Parameters, inputs and faults from the start and from each change on; the plant has those of the start again."""
    scheduled = ScheduledChanges(loop, plant)
    batch, found = plant.batch, []
    first: tuple[FloatArray, FloatArray] = batch.parameters, batch.states
    for row in sorted({0, *scheduled.by_row}):
        scheduled.apply(row)
        faults = scheduled.faults[0, : N_FAULTS * loop.has_faults]
        found.append((row, batch.parameters[0, :, 0].copy(), scheduled.inputs[0].copy(), faults.copy()))
        if row == 0:
            first = batch.parameters.copy(), batch.states.copy()
    # a plant that has not begun moves its motors with its parameters
    batch.parameters[...], batch.states[...] = first
    return _Changes(np.array([row for row, *_ in found], np.int64), *(np.array(each) for each in list(zip(*found))[1:]))  # noqa: B905


class _Words:
    """The words of a block while it is made: its fields, then what they point to."""

    def __init__(self) -> None:
        self._fields: list[int] = []
        self._data: list[NDArray[np.int64]] = []
        self._end = _HEAD + _ROOM + len(_all_fields())

    def add(self, value: int) -> None:
        self._fields.append(value)

    def number(self, value: float) -> None:
        self.add(int(np.float64(value).view(np.int64)))

    def array(self, values: NDArray[Any]) -> None:
        """A place, and the values there; none of an empty array."""
        raw = np.ascontiguousarray(values).tobytes()
        raw += bytes(-len(raw) % 8)
        words = np.frombuffer(raw, np.int64)
        self.add(self._end if words.size else 0)
        self._data.append(words)
        self._end += len(words)

    def value(self, kind: str, value: Any) -> None:
        """A field by its kind; a place without an array is none."""
        if kind == "NUMBER":
            self.number(value)
        elif kind == "PLACE":
            self.array(np.asarray(value) if np.ndim(value) else np.zeros(0))
        else:
            self.add(int(value))

    def planned_table(self, name: str, planned: dict[str, Any]) -> None:
        """A table that C fills: its place is set in a call."""
        head, _, part = name.partition(".")
        values = planned.get(_TABLES[head])
        self.add(0 if values is None or part in ("at", "member") else values.shape[1] if part == "row" else 1)

    def batch(self, name: str, plant: LanesPlant) -> None:
        if name in ("blocks", "stride"):
            self.add(1)
        elif name == "parameters":
            self.array(plant.batch.parameters[0, :, 0])
        else:
            self.array(getattr(plant.batch, name)[..., 0])

    def output(self, name: str, values: NDArray[Any]) -> None:
        _, _, part = name.partition(".")
        if part == "at":
            self.array(values)
        else:
            self.add(values.shape[1] if part == "row" else 1)

    def loop(self, name: str, kind: str, c: Any, arrays: dict[int, NDArray[Any]]) -> None:
        """A field of the loop: members are left out, and tables begin at their first row."""
        head, _, part = name.partition(".")
        value = getattr(c, head)
        if part:
            values = arrays.get(value.at or 0)
            if values is None:
                self.add(0)
            elif part == "at":
                self.array(values[..., 0] if values.ndim > 1 else values)
            elif part == "row":
                self.add(math.prod(values.shape[1:-1]))
            else:
                self.add(int(part == "element"))
        elif kind == "NUMBER":
            self.number(value)
        elif kind == "WHOLE":
            self.add(int(value))
        elif value:
            values = arrays[value]
            is_memory = head in MEMORY
            self.array(values if not is_memory else values[:1] if values.ndim == 1 else values[:, 0])
        else:
            self.add(0)

    def block(self, variant: Variant) -> NDArray[np.int64]:
        head = np.zeros(_HEAD + _ROOM, np.int64)
        head[:2] = version(variant), self._end
        return np.concatenate([head, np.array(self._fields, np.int64), *self._data])


@cache
def version(variant: Variant = IDEAL) -> int:
    """Of the layout of blocks: a digest of the names of all fields, and of the parts of the plant, which give sizes."""
    return int(digest_of(" ".join([f"{_VERSION} {_all_fields()}", *variant.parts]).encode())[:12], 16)


@cache
def _all_fields() -> tuple[_Field, ...]:
    found = [_Field(f"of.{name}", "WHOLE" if k < 2 else "PLACE") for k, name in enumerate(BATCH_FIELDS)]
    for name, kind, *_ in LoopBlock._fields_:
        if name == "law":
            found.append(_Field("with.law", "LAW"))
        elif isinstance(kind, type) and issubclass(kind, ctypes.Structure):
            for part in (each[0] for each in kind._fields_):
                found.append(_Field(f"with.{name}.{part}", "PLACE" if part == "at" else "WHOLE"))
        else:
            kinds = {ctypes.c_double: "NUMBER", ctypes.c_void_p: "PLACE"}
            found.append(_Field(f"with.{name}", kinds.get(kind, "WHOLE")))
    found += [_Field(f"own.{name}", kind) for name, kind in _CHANGES]
    found += [_Field(f"plan.plan_{name}", kind) for name, kind in _PLAN]
    found += [_Field(f"turn.turn_{name}", kind) for name, kind in TURNING]
    return tuple(found)


def _fields_header(variant: Variant) -> str:
    """`machine_fields.h`: the number of each field, and how C reads them."""
    from gough_stewart.fmu_build.sources import defines

    known = {f"MACHINE_{name.upper().replace('.', '_')}": k for name, k in fields().items()}
    sizes = {
        "MACHINE_HEAD": _HEAD,
        "MACHINE_ROOM": _ROOM,
        "MACHINE_FIELDS": _HEAD + _ROOM,
        "MACHINE_N_FIELDS": len(_all_fields()),
        "MACHINE_LAW_FIELD": fields()["law"],
        "MACHINE_VERSION": version(variant),
        "N_MOTION": N_MOTION,
        "MOTION_ROUNDING": ROUNDING,
    }
    parts = {"of.": "members.", "with.": "loop.", "own.": "", "plan.plan_": "plan.", "turn.turn_": "turned."}
    reads = " \\\n    ".join(
        f"m->{next(parts[part] + name.removeprefix(part) for part in parts if name.startswith(part))} = {kind}({k});"
        for k, (name, kind) in enumerate(_all_fields())
        if kind != "LAW"
    )
    return f"{defines(sizes)}\n\n{defines(known)}\n\n#define MACHINE_READ \\\n    {reads}\n"


def machine_of(
    experiment: Experiment,
    prepared: Prepared,
    kept: int = 64,
    forever: bool = False,
    turned: Turned | None = None,
) -> Block:
    """A run of an experiment as a block, with its plan.

    Raises
    ------
    ControllerError, MembersError
        As `machine_block`.
    """
    choice, loop = experiment.plant, prepared.loop
    kind: Feedforward = getattr(experiment.controller, "feedforward", "none")
    ahead = (experiment.loop.delay + 0.5) * loop.timing.sample_time
    plan = None
    # constant forces are not planned from a motion
    if prepared.reference is not None and not isinstance(experiment.controller, OpenLoop):
        plan = Plan(prepared.reference, prepared.platform, kind, ahead)
    plant = LanesPlant([prepared.machine], [prepared.start], tolerance=choice.tolerance, kernel=prepared.kernel)
    with plant, prepared.law_in_a_run() as law_from:
        return machine_block(plant, law_from, loop, plan, kept, forever, turned)
