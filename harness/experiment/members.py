"""The members of an ensemble: their drawn values, their experiments, and the plan that determines all results."""

import dis
import hashlib
import inspect
import json
import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache, partial
from math import ceil, prod
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.makers import name_of
from gough_stewart.harness.control.state_space import is_control_system
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.file import digests, experiment_from
from gough_stewart.harness.experiment.overrides import Place, Values, place_of
from gough_stewart.harness.experiment.preparation import Batch, Preparation, PreparedMembers, platforms_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.plants.lanes import Stepping
from gough_stewart.harness.sampling.choice import MEMBERS, EnsembleChoice
from gough_stewart.harness.sampling.design import SamplingDesign, correlated, correlation_of, in_turn, reordered
from gough_stewart.harness.sampling.variation import Spread, VariedValue, normal
from gough_stewart.model.platform import Platform
from gough_stewart.model.units import PLAIN
from gough_stewart.model.vectors import FloatArray

# How many members are tried to find one that can run.
_AMONG = 64
# A value outside of all but this share of a distribution, on either side, is none of its values.
_RARE = 1e-6


@dataclass(frozen=True)
class Input:
    """One varied value: its key as written, its place, its distribution."""

    key: str
    place: Place
    spread: Spread

    @property
    def columns(self) -> tuple[str, ...]:
        """Column names: `platform_mass`, `base_points[1,1]`, 1-based, `platform_inertia.factor` if common to all."""
        target = self.place.target
        if not target.shape:
            return (target.name,)
        if self.spread.factor is not None:
            return (f"{target.name}.factor",)
        return tuple(f"{target.name}[{','.join(str(i + 1) for i in at)}]" for at in np.ndindex(target.shape))

    @property
    def outside(self) -> str:
        """A warning if a parameter's present value, unless that is 0, is none of its distribution's; "" if it is.

        That is a distribution about another value, or one of factors without the word.
        """
        nominal = self.place.target.nominal
        if nominal is None or self.place.path[-2:-1] != ("parameters",) or self.spread.factor is not None:
            return ""
        shares = np.concatenate([[_RARE], np.linspace(0.01, 0.99, 99), [1 - _RARE]])
        values = np.asarray(self.spread.draw(np.tile(shares[:, None], self.spread.size)), dtype=float)
        values = values.reshape(len(shares), *self.place.target.shape)
        low, high = values.min(axis=0), values.max(axis=0)
        # of values that are equal but for rounding, and of the rarest that are left out
        room = 1e-9 * np.maximum(np.abs(low), np.abs(high)) + 10 * _RARE * (high - low)
        is_outside = (nominal != 0) & ((nominal < low - room) | (nominal > high + room))
        if not is_outside.any():
            return ""
        at = tuple(int(k) for k in np.argwhere(is_outside)[0])
        column = self.columns[int(np.ravel_multi_index(at, nominal.shape)) if at else 0]
        unit = "" if self.place.target.unit in (None, PLAIN) else f" {self.place.target.unit}"
        return (
            f"the experiment's {column} of {nominal[at]:.4g}{unit} is outside of its distribution from {low[at]:.4g} "
            f"to {high[at]:.4g}{unit}"
        )

    def table(self, u: FloatArray, values: Any) -> dict[str, Any]:
        """Columns (n,) of the drawn values."""
        target = self.place.target
        if target.unit is None:
            return {target.name: values}
        if self.spread.factor is not None and target.shape:
            return {self.columns[0]: self.spread.factor(u)}
        numbers = np.asarray(values, dtype=float).reshape(len(u), -1)
        return {name: numbers[:, k] for k, name in enumerate(self.columns)}


@dataclass(frozen=True)
class Draws:
    """The drawn values of members: table columns, and values by place for each member."""

    columns: dict[str, Any]
    values: list[dict[tuple[str, ...], Any]]


class Members:
    """The members of an experiment's `[ensemble]`.

    Parameters
    ----------
    controller
        Replaces the experiment's, as in `prepare`.

    Raises
    ------
    ExperimentError
        No `[ensemble]`, an unknown key, or an invalid distribution; names the place.
    """

    def __init__(self, experiment: Experiment, controller: Any = None) -> None:
        self.nominal, self.controller = experiment, controller
        self.preparation = Preparation(experiment, controller)
        choice = experiment.ensemble
        if choice is None:
            raise ExperimentError(
                experiment.where,
                "ensemble",
                "is missing; add it to declare what varies, or start from heave_tolerances",
            )
        if experiment.limits.stroke == "stop":
            raise self._error("limits.stroke", "is 'stop', which is for single runs only; expected 'warn' or 'ignore'")
        self.choice: EnsembleChoice = choice
        self.seed = experiment.sensors.seed if choice.seed is None else choice.seed
        self.inputs = self._inputs()
        keys = [varied.key for varied in self.inputs]
        # where each input's columns begin, and the end
        self._ends = np.cumsum([0, *(varied.spread.size for varied in self.inputs)])
        # columns of correlated inputs, and their correlation
        self._correlations = list[tuple[NDArray[np.intp], FloatArray]]()
        tables = [*((table, True) for table in choice.correlation), *((table, False) for table in choice.covariance)]
        correlated_keys = list[str]()
        for table, is_correlation in tables:
            for key in table.of:
                if key not in keys:
                    raise self._error(key, "is correlated but does not vary; add a distribution for it")
            at, names = [keys.index(key) for key in table.of], " and ".join(table.of)
            columns = np.concatenate([np.arange(self._ends[k], self._ends[k + 1]) for k in at])
            if len(columns) != len(table.matrix):
                raise self._error(names, f"have {len(columns)} elements; their matrix has {len(table.matrix)} rows")
            if any(self.inputs[k].spread.levels for k in at):
                raise self._error(names, "are correlated; grids cannot be correlated")
            if is_correlation and not np.allclose(np.diag(table.values), 1):
                raise self._error("correlation", "expected a matrix with 1 on the diagonal, or use covariance")
            self._correlations.append((columns, table.values if is_correlation else correlation_of(table.values)))
            correlated_keys += table.of
        for key in correlated_keys:
            # the second matrix would change the correlation of the first
            if correlated_keys.count(key) > 1:
                raise self._error(
                    key, "is in two matrices; expected one matrix of all inputs that depend on each other"
                )

        # groups of correlated inputs, by index; independent inputs are groups of one
        groups = [{k} for k in range(len(self.inputs))]
        for table, _ in tables:
            members = {k for k, key in enumerate(keys) if key in table.of}
            joined = set().union(*(group for group in groups if group & members))
            groups = [group for group in groups if not group & members] + [joined]
        self.groups = tuple(tuple(sorted(group)) for group in sorted(groups, key=min))

        # how many members, and their points in the unit cube
        grids = prod(varied.spread.levels or 1 for varied in self.inputs)
        # of grids that are run through in the order of members
        self.combinations = 1 if choice.sampling == "saltelli" else grids
        only_grids = bool(self.inputs) and all(varied.spread.levels for varied in self.inputs)
        self.count = choice.members or (grids if only_grids else -(-MEMBERS // grids) * grids)
        try:
            self.design = SamplingDesign(
                choice.sampling,
                self.seed,
                self.count,
                tuple(".".join(varied.place.path) for varied in self.inputs),
                tuple(varied.spread.size for varied in self.inputs),
                self.groups,
            )
        except ValueError as error:
            raise self._error("", str(error)) from None

    def draws(self, first: int, last: int) -> Draws:
        """The draws of members first to last − 1."""
        # a Latin hypercube is correlated as a whole, so that each layer keeps its member
        is_hypercube = self.choice.sampling == "latin_hypercube"
        u = self._hypercube[first:last] if is_hypercube else self.design.points(first, last)
        if self.combinations > 1:
            levels = [level for i in self.inputs for level in (i.spread.levels, *[None] * (i.spread.size - 1))]
            u = in_turn(u, levels, first)
        for columns, R in [] if is_hypercube else self._correlations:
            u[:, columns] = correlated(u[:, columns], R)
        table = dict[str, Any]()
        values: list[dict[tuple[str, ...], Any]] = [{} for _ in u]
        for k, varied in enumerate(self.inputs):
            part = np.ascontiguousarray(u[:, self._ends[k] : self._ends[k + 1]])
            drawn = varied.spread.draw(part)
            table |= varied.table(part, drawn)
            plain = drawn.tolist() if isinstance(drawn, np.ndarray) else drawn
            for member, value in zip(values, plain, strict=True):
                member[varied.place.path] = value
        return Draws(table, values)

    @cached_property
    def _hypercube(self) -> FloatArray:
        """All points of a Latin hypercube, correlated (count, k)."""
        u = self.design.points(0, self.count)
        for columns, R in self._correlations:
            u[:, columns] = reordered(u[:, columns], R)
        return u

    def prepared(self, first: int, last: int) -> PreparedMembers:
        """Members first to last − 1, ready to run, or why they are impossible."""
        return self.prepared_with(self.draws(first, last).values, range(first, last))

    def prepared_with(self, values: Sequence[Values], numbers: Sequence[int | None]) -> PreparedMembers:
        """Members with these values, and the noise and jitter of these numbers; of the nominal one without."""
        seeds = [
            self.nominal.sensors.seed if k is None else np.random.SeedSequence(self.seed, spawn_key=(k,))
            for k in numbers
        ]
        return self.preparation.members(values, seeds)

    def possible(self) -> Batch:
        """The first member that can run.

        Raises
        ------
        ExperimentError
            None of the first members can.
        """
        for last in (1, 8, _AMONG):
            prepared = self.prepared(0, min(self.count, last))
            if len(prepared.batch):
                return prepared.batch.take([0])
        raise ExperimentError(
            self.nominal.where,
            "ensemble",
            f"none of the first {len(prepared.errors)} members is possible; the first: {prepared.reasons[0]}",
        )

    @property
    def stepping(self) -> Stepping:
        """How its members are stepped."""
        fixed, step = self.nominal.plant.fixed_step_size, self.nominal.loop.plant_step or self.nominal.loop.sample_time
        return Stepping(self.choice.tolerance, max(1, ceil(step / fixed - 1e-9)) if fixed else None)

    def _inputs(self) -> tuple[Input, ...]:
        """Inputs in order of their places, independent of the order in the file."""
        inputs = list[Input]()

        def add(key: str, spread: Callable[[VariedValue], Spread]) -> Spread:
            try:
                place = self.place_of(key)
                inputs.append(Input(key, place, spread(place.target)))
            except ValueError as error:
                raise self._error(key, str(error)) from None
            return inputs[-1].spread

        for key, variation in self.choice.varied.items():
            add(key, variation.spread)
        for table in self.choice.covariance:
            deviations = np.sqrt(np.diag(table.values))
            for key in table.of:
                if key in self.choice.varied:
                    raise self._error(key, "has a distribution and a covariance; expected only one of them")
                deviations = deviations[add(key, partial(_normal, deviations)).size :]
        paths = [varied.place.path for varied in inputs]
        for varied in inputs:
            if paths.count(varied.place.path) > 1:
                raise self._error(varied.key, "varies twice; expected one distribution")
            self.check_acts(varied.key, varied.place)
        return tuple(sorted(inputs, key=lambda varied: varied.place.path))

    def check_acts(self, key: str, place: Place) -> None:
        """Refuse a key of a controller that another one replaces.

        Raises
        ------
        ExperimentError
            It would have no effect.
        """
        section, *rest = place.path
        if self.controller is not None and section == "controller" and rest[0] not in ("feedforward", "parameters"):
            raise self._error(key, "has no effect, since controller= replaces the experiment's controller")

    @cached_property
    def platforms(self) -> tuple[Platform, Platform]:
        """The nominal model and the machine, without what varies."""
        return platforms_of(self.nominal)

    def place_of(self, key: str) -> Place:
        """The place that a key of `[ensemble]` or a search names.

        Raises
        ------
        ValueError
            None, or one that is common to all members.
        """
        return place_of(key, self.nominal, *self.platforms)

    def _error(self, key: str, message: str) -> ExperimentError:
        return ExperimentError(self.nominal.where, f"ensemble.{key}".rstrip("."), message)


def _normal(deviations: FloatArray, target: VariedValue) -> Spread:
    """Normal about the present value, with the first of these deviations."""
    if target.nominal is None or target.unit is None:
        raise ValueError("has no value to vary about; set one in the experiment")
    n = prod(target.shape)
    if n > len(deviations):
        raise ValueError(f"has {n} elements; the matrix has {len(deviations)} rows left")
    mean, deviation = target.nominal, deviations[:n].reshape(target.shape)
    return Spread(n, lambda u: normal(u.reshape(len(u), *target.shape), mean, deviation))


FORMAT = 2
_PACKAGE = __name__.partition(".")[0]


@dataclass(frozen=True, eq=False)
class GivenController:
    """A controller from Python that replaces the experiment's; compared by identity."""

    controller: Any


@dataclass(frozen=True)
class EnsemblePlan:
    """Everything that determines the results of an ensemble, as plain values that can be sent to workers."""

    experiment: dict[str, Any]
    where: str
    folder: str
    members: int
    seed: int
    # contents of the files that the experiment names
    files: dict[str, str] = field(default_factory=dict)
    # the controller from Python that replaces the experiment's, in words, and itself, which no file keeps
    controller: str = ""
    given: GivenController | None = field(default=None, compare=False)
    # what was set of the experiment's file, as `Experiment.changed`
    settings: dict[str, Any] = field(default_factory=dict, compare=False)

    @property
    def title(self) -> str:
        """The title of the experiment."""
        return str(self.experiment["title"])

    @property
    def text(self) -> str:
        """The plan as JSON, for workers and files."""
        values = {part.name: getattr(self, part.name) for part in fields(self) if part.name != "given"}
        return json.dumps({"format": FORMAT, **values}, indent=1, sort_keys=True)

    @property
    def decisive(self) -> dict[str, Any]:
        """The part that determines results; without the file's location."""
        names = ("experiment", "members", "seed", "files", *(("controller",) if self.controller else ()))
        return {name: getattr(self, name) for name in names}

    @property
    def hash(self) -> str:
        """A hash of the part that determines results."""
        return hashlib.sha256(json.dumps(self.decisive, sort_keys=True).encode()).hexdigest()

    @property
    def prepared(self) -> Members:
        """The members, prepared once per process.

        Raises
        ------
        ExperimentError
            The plan's files have changed, or it comes from a file and its controller from Python is not there.
        """
        if self.controller and self.given is None:
            raise ExperimentError(
                self.where,
                "controller",
                f"was {self.controller}, given in Python, which files do not keep; expected the same call in Python "
                "with controller=",
            )
        return _members_of(self.text, self.given)


def plan_from(text: str, given: GivenController | None = None) -> EnsemblePlan:
    """The plan of a `EnsemblePlan.text`; a controller from Python is not part of the text.

    Raises
    ------
    ValueError
        Not a plan, or one of another version.
    """
    values = json.loads(text)
    if values.pop("format", None) != FORMAT:
        raise ValueError("a plan of another version")
    return EnsemblePlan(**values, given=given)


def plan_of(experiment: Experiment, controller: Any = None) -> EnsemblePlan:
    """The plan of an experiment with an `[ensemble]`.

    Parameters
    ----------
    controller
        Replaces the experiment's, as in `prepare`.

    Raises
    ------
    ExperimentError
        Nothing varies, or the variation is invalid.
    """
    values = experiment.model_dump(mode="json", exclude_unset=True)
    members = Members(experiment, controller)
    if not members.inputs and not experiment.sensors.noise and not experiment.loop.jitter:
        raise ExperimentError(
            experiment.where,
            "ensemble",
            "nothing varies; expected a distribution, for instance platform_mass = {normal = [120, 10]}, or noise",
        )
    return EnsemblePlan(
        experiment=values,
        where=experiment.where,
        folder=str(experiment.folder.absolute()),
        members=members.count,
        seed=members.seed,
        files=digests(experiment),
        controller="" if controller is None else fingerprint(controller),
        given=None if controller is None else GivenController(controller),
        settings=experiment.changed,
    )


@lru_cache(2)
def _members_of(text: str, given: GivenController | None) -> Members:
    plan = plan_from(text)
    experiment = experiment_from(plan.experiment, plan.where, Path(plan.folder))
    if (files := digests(experiment)) != plan.files:
        names = sorted(name for name in {*files, *plan.files} if files.get(name) != plan.files.get(name))
        raise ExperimentError(plan.where, "", f"names {', '.join(names)}, which has changed since the run began")
    return Members(experiment, None if given is None else given.controller)


def fingerprint(controller: Any) -> str:
    """What a controller from Python is, and a hash of its code and values, as far as they are visible.

    The same code and values have the same hash in another process; code of other modules does not count.
    """
    digest = hashlib.sha256()
    for part in _parts(controller, set()):
        digest.update(part + b"\0")
    name = str(controller) if isinstance(controller, str | Path) else ""
    if isinstance(controller, LinearController) or is_control_system(controller):
        name = type(controller).__name__
    return f"{name or name_of(controller)}, {digest.hexdigest()[:16]}"


def _parts(thing: Any, seen: set[int]) -> Iterator[bytes]:
    if id(thing) in seen:
        return
    seen.add(id(thing))
    if isinstance(thing, MethodType):
        yield from _parts(thing.__self__, seen)
        yield from _parts(thing.__func__, seen)
    elif isinstance(thing, FunctionType):
        yield from _of_code(thing.__code__)
        for name, value in _held_by(thing):
            yield name.encode()
            if isinstance(value, FunctionType):
                yield from _parts(value, seen)
            else:
                yield from _of_value(value)
    elif inspect.isclass(thing):
        yield from _of_class(thing, seen)
    elif isinstance(thing, LinearController):
        yield repr((thing.signals, thing.space)).encode()
        yield from _parts(thing.system, seen)
    elif all(hasattr(thing, name) for name in "ABCD"):
        yield repr([np.asarray(getattr(thing, name)).tolist() for name in "ABCD"] + [thing.dt]).encode()
    else:
        if not is_control_system(thing):
            yield from _parts(type(thing), seen)
        yield from _of_value(thing)


def _held_by(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """What a function encloses and reads, its defaults and attributes: values, and functions of the same module.

    Objects of this package, such as platforms, do not count: they are constant, but keep what they compute on demand.
    """
    code, known_globals = function.__code__, function.__globals__
    held: list[tuple[str, Any]] = [
        (name, known_globals[name]) for name in sorted(_globals_of(code) & known_globals.keys())
    ]
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        with suppress(ValueError):  # not bound yet
            held.append((name, cell.cell_contents))
    held += [("default", value) for value in function.__defaults__ or ()]
    held += [*(function.__kwdefaults__ or {}).items(), *vars(function).items()]
    for name, value in held:
        is_ours = type(value).__module__.partition(".")[0] == _PACKAGE
        is_elsewhere = isinstance(value, FunctionType) and value.__globals__ is not known_globals
        if not (is_ours or is_elsewhere or isinstance(value, type | ModuleType | BuiltinFunctionType)):
            yield name, value


def _globals_of(code: CodeType) -> set[str]:
    """The globals that code names, with the functions inside it."""
    names = {step.argval for step in dis.get_instructions(code) if step.opname.endswith(("_GLOBAL", "_NAME"))}
    return names.union(*(_globals_of(inner) for inner in code.co_consts if isinstance(inner, CodeType)))


def _of_class(thing: type, seen: set[int]) -> Iterator[bytes]:
    """Its methods and values, and those of the classes that it inherits from."""
    yield thing.__qualname__.encode()
    for base in thing.__mro__:
        yield from _parts(base, seen)
    for name, value in vars(thing).items():
        if not name.startswith("__") or isinstance(value, FunctionType):
            yield name.encode()
            inner = getattr(value, "__func__", getattr(value, "fget", value))
            yield from _parts(inner, seen) if isinstance(inner, FunctionType) else _of_value(inner)


def _of_code(code: CodeType) -> Iterator[bytes]:
    """Instructions and constants, without line numbers and file names."""
    yield code.co_code
    yield repr((code.co_names, code.co_varnames, code.co_freevars)).encode()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _of_code(constant)
        else:
            yield repr(sorted(constant, key=repr) if isinstance(constant, frozenset) else constant).encode()


def _of_value(value: Any, outer: tuple[int, ...] = ()) -> Iterator[bytes]:
    try:
        yield pickle.dumps(value)
    except Exception:
        # an object of a class that no module has, such as one of a function or a notebook
        yield type(value).__qualname__.encode()
        if id(value) not in outer and not isinstance(value, type | ModuleType):
            for name, inner in getattr(value, "__dict__", {}).items():
                yield name.encode()
                yield from _of_value(inner, (*outer, id(value)))
