"""The members of an ensemble: what varies, their drawn values, and the plan that determines all results.

Of a controller from Python the plan has a fingerprint.
"""

import dis
import hashlib
import inspect
import json
import pickle
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from math import ceil, prod
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.linear_controller import LinearController
from gough_stewart.harness.control.makers import name_of
from gough_stewart.harness.control.state_space import is_control_system
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.file import digests, experiment_from
from gough_stewart.harness.experiment.overrides import Place, place_of
from gough_stewart.harness.experiment.preparation import Batch, Preparation, platforms_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.plants.lanes import Stepping
from gough_stewart.harness.sampling.variation import (
    MEMBERS,
    EnsembleChoice,
    SamplingDesign,
    Spread,
    VariedValue,
    correlated,
    correlation_of,
    normal,
    reordered,
)
from gough_stewart.model.units import PLAIN
from gough_stewart.model.vectors import FloatArray

FORMAT = 2
# How many members are tried to find one that can run.
_AMONG = 64
# A value outside of all but this share of a distribution, on either side, is none of its values.
_RARE = 1e-6
_PACKAGE = __name__.partition(".")[0]


@dataclass(frozen=True)
class Input:
    """One varied value: its key as written, its place, its distribution, its columns in tables."""

    key: str
    place: Place
    spread: Spread
    columns: tuple[str, ...]  # `platform_mass`, `base_points[1,1]`, 1-based, `platform_inertia.factor` if common to all

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


class Draws(NamedTuple):
    """The drawn values of members."""

    columns: dict[str, Any]  # of a table
    values: list[dict[tuple[str, ...], Any]]  # by place for each member


class Members:
    """The members of an experiment's `[ensemble]`; a controller replaces the experiment's, as in `prepare`.

    An `ExperimentError` names the place of an unknown key or an invalid distribution.
    """

    def __init__(  # noqa: PLR0912, PLR0915 - inputs, correlations, design
        self, experiment: Experiment, controller: Any = None
    ) -> None:
        self.nominal, self.controller = experiment, controller
        choice = experiment.ensemble
        if choice is None:
            raise self._error("", "is missing; add it to declare what varies, or start from heave_tolerances")
        if experiment.limits.stroke == "stop":
            raise self._error("limits.stroke", "is 'stop', which is for single runs only; expected 'warn' or 'ignore'")
        self.choice: EnsembleChoice = choice
        self.seed = experiment.sensors.seed if choice.seed is None else choice.seed
        self.preparation = Preparation(experiment, controller, self.seed)
        fixed, step = experiment.plant.fixed_step_size, experiment.loop.plant_step or experiment.loop.sample_time
        self.stepping = Stepping(choice.tolerance, max(1, ceil(step / fixed - 1e-9)) if fixed else None)
        self.platforms = platforms_of(experiment)  # the nominal model and the machine, without what varies

        # inputs in order of their places, independent of the order in the file
        inputs = list[Input]()

        def add(key: str, spread: Callable[[VariedValue], Spread]) -> Spread:
            try:
                place = place_of(key, experiment, *self.platforms, controller is not None)
                distribution = spread(place.target)
            except ValueError as error:
                raise self._error(key, str(error)) from None
            name, shape = place.target.name, place.target.shape
            columns = [f"{name}[{','.join(str(i + 1) for i in at)}]" for at in np.ndindex(shape)] if shape else [name]
            if shape and distribution.factor is not None:
                columns = [f"{name}.factor"]
            inputs.append(Input(key, place, distribution, tuple(columns)))
            return distribution

        for key, variation in choice.varied.items():
            add(key, variation.spread)
        for table in choice.covariance:
            deviations = np.sqrt(np.diag(table.values))
            for key in table.of:
                if key in choice.varied:
                    raise self._error(key, "has a distribution and a covariance; expected only one of them")
                deviations = deviations[add(key, partial(_normal, deviations)).size :]
        paths = [varied.place.path for varied in inputs]
        for varied in inputs:
            if paths.count(varied.place.path) > 1:
                raise self._error(varied.key, "varies twice; expected one distribution")
        self.inputs = tuple(sorted(inputs, key=lambda varied: varied.place.path))
        keys = [varied.key for varied in self.inputs]
        # where each input's columns begin, and the end
        self._ends = np.cumsum([0, *(varied.spread.size for varied in self.inputs)])

        # columns of correlated inputs with their correlation; groups of them by index, of independent inputs of one
        self._correlations, groups = list[tuple[NDArray[np.intp], FloatArray]](), [{k} for k in range(len(keys))]
        tables = [*((table, True) for table in choice.correlation), *((table, False) for table in choice.covariance)]
        correlated_keys = [key for table, _ in tables for key in table.of]
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
            joined = set().union(*(group for group in groups if group & {*at}))
            groups = [group for group in groups if not group & {*at}] + [joined]
        for key in correlated_keys:
            if correlated_keys.count(key) > 1:  # the second matrix would change the correlation of the first
                raise self._error(
                    key, "is in two matrices; expected one matrix of all inputs that depend on each other"
                )
        self.groups = tuple(tuple(sorted(group)) for group in sorted(groups, key=min))

        # how many members, and their points in the unit cube; grids are run through in the order of members
        grids = prod(varied.spread.levels or 1 for varied in self.inputs)
        self.combinations = 1 if choice.sampling == "saltelli" else grids
        only_grids = bool(self.inputs) and all(varied.spread.levels for varied in self.inputs)
        self.count = choice.members or (grids if only_grids else -(-MEMBERS // grids) * grids)
        places = tuple(".".join(varied.place.path) for varied in self.inputs)
        sizes = tuple(varied.spread.size for varied in self.inputs)
        try:
            self.design = SamplingDesign(choice.sampling, self.seed, self.count, places, sizes, self.groups)
        except ValueError as error:
            raise self._error("", str(error)) from None

    @cached_property
    def plan(self) -> dict[str, Any]:
        """All that determines their results, as plain values that files keep; a controller from Python in words."""
        experiment = self.nominal
        return {
            "format": FORMAT,
            "experiment": experiment.model_dump(mode="json", exclude_unset=True),
            "where": experiment.where,
            "folder": str(experiment.folder.absolute()),
            "members": self.count,
            "seed": self.seed,
            # contents of the files that the experiment names
            "files": digests(experiment),
            "controller": "" if self.controller is None else fingerprint(self.controller),
            # what was set of its file, as `Experiment.changed`
            "settings": experiment.changed,
        }

    @property
    def text(self) -> str:
        """The plan as JSON, for workers and files."""
        return json.dumps(self.plan, indent=1, sort_keys=True)

    def _error(self, key: str, message: str) -> ExperimentError:
        return ExperimentError(self.nominal.where, f"ensemble.{key}".rstrip("."), message)

    def draws(self, first: int, last: int) -> Draws:
        """The draws of members first to last − 1."""
        # a Latin hypercube is correlated as a whole, so that each layer keeps its member
        is_hypercube = self.choice.sampling == "latin_hypercube"
        u = self._hypercube[first:last] if is_hypercube else self.design.points(first, last)
        if self.combinations > 1:  # grids go through all combinations of their levels, the last one fastest
            u, index = u.copy(), np.arange(first, first + len(u))
            for k in reversed(range(len(self.inputs))):
                if n := self.inputs[k].spread.levels:
                    u[:, self._ends[k]] = (index % n + 0.5) / n
                    index = index // n
        for at, R in [] if is_hypercube else self._correlations:
            u[:, at] = correlated(u[:, at], R)
        columns, values = dict[str, Any](), [dict[tuple[str, ...], Any]() for _ in u]
        for k, varied in enumerate(self.inputs):
            part, target, spread = u[:, self._ends[k] : self._ends[k + 1]], varied.place.target, varied.spread
            part = np.ascontiguousarray(part)
            drawn = spread.draw(part)
            if target.unit is None:
                columns[target.name] = list(map(str, drawn)) if spread.is_mixed else drawn
            elif spread.factor is not None and target.shape:
                columns[varied.columns[0]] = spread.factor(part)
            else:
                columns |= zip(varied.columns, np.asarray(drawn, dtype=float).reshape(len(u), -1).T, strict=True)
            for member, value in zip(values, drawn.tolist() if isinstance(drawn, np.ndarray) else drawn, strict=True):
                member[varied.place.path] = value
        return Draws(columns, values)

    @cached_property
    def _hypercube(self) -> FloatArray:
        """All points of a Latin hypercube, correlated (count, k)."""
        u = self.design.points(0, self.count)
        for columns, R in self._correlations:
            u[:, columns] = reordered(u[:, columns], R)
        return u

    def possible(self) -> Batch:
        """The first member that can run; an `ExperimentError` if none of the first can."""
        for last in (1, 8, _AMONG):
            numbers = range(min(self.count, last))
            batch = self.preparation.members(self.draws(0, len(numbers)).values, numbers)
            if batch.setups:
                return batch.take([0])
        text = f"none of the first {len(batch.errors)} members is possible; the first: {batch.reasons[0]}"
        raise self._error("", text)


def _normal(deviations: FloatArray, target: VariedValue) -> Spread:
    """Normal about the present value, with the first of these deviations."""
    if target.nominal is None or target.unit is None:
        raise ValueError("has no value to vary about; set one in the experiment")
    n = prod(target.shape)
    if n > len(deviations):
        raise ValueError(f"has {n} elements; the matrix has {len(deviations)} rows left")
    mean, deviation = target.nominal, deviations[:n].reshape(target.shape)
    return Spread(n, lambda u: normal(u.reshape(len(u), *target.shape), mean, deviation))


def varying_members(experiment: Experiment, controller: Any = None) -> Members:
    """The members of an experiment with an `[ensemble]`; an `ExperimentError` if they would all be the same."""
    members = Members(experiment, controller)
    if not members.inputs and not experiment.sensors.noise and not experiment.loop.jitter:
        raise ExperimentError(
            experiment.where,
            "ensemble",
            "nothing varies; expected a distribution, for instance platform_mass = {normal = [120, 10]}, or noise",
        )
    return members


def members_from(text: str, controller: Any = None) -> Members:
    """The members of a plan's text, with its controller from Python; refuses changed files, and one that is missing."""
    plan = json.loads(text)
    if plan["controller"] and controller is None:
        raise ExperimentError(
            plan["where"],
            "controller",
            f"was {plan['controller']}, given in Python, which files do not keep; expected the same call in Python "
            "with controller=",
        )
    experiment = experiment_from(plan["experiment"], plan["where"], Path(plan["folder"]), changed=plan["settings"])
    files, known = digests(experiment), plan["files"]
    if files != known:
        names = sorted(name for name in {*files, *known} if files.get(name) != known.get(name))
        raise ExperimentError(plan["where"], "", f"names {', '.join(names)}, which has changed since the run began")
    return Members(experiment, controller)


def decisive(plan: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a plan that determines results: without the experiment's place, and what was set of its file."""
    if plan.get("format") != FORMAT:
        raise ValueError("a plan of another version")
    names = ("experiment", "members", "seed", "files", *(("controller",) if plan["controller"] else ()))
    return {name: plan[name] for name in names}


# --- controllers from Python -----------------------------------------------------------------------------------------


def fingerprint(controller: Any) -> str:
    """What a controller is in words, and a hash: the same in another process for the same code and values.

    Code of other modules does not count.
    """
    digest = hashlib.sha256()
    for part in _parts(controller, set()):
        digest.update(part + b"\0")
    name = str(controller) if isinstance(controller, str | Path) else ""
    if isinstance(controller, LinearController) or is_control_system(controller):
        name = type(controller).__name__
    return f"{name or name_of(controller)}, {digest.hexdigest()[:16]}"


def _parts(thing: Any, seen: set[int]) -> Iterator[bytes]:  # noqa: PLR0912 - a section for each kind
    if id(thing) in seen:
        return
    seen.add(id(thing))
    if isinstance(thing, MethodType):
        yield from _parts(thing.__self__, seen)
        yield from _parts(thing.__func__, seen)
    elif isinstance(thing, FunctionType):
        yield from _of_code(thing.__code__)
        # what it encloses and reads, its defaults and attributes: values, and functions of the same module
        code, known_globals = thing.__code__, thing.__globals__
        names, codes = set[str](), [code]
        while codes:  # the globals that it names, also in the functions inside it
            inside = codes.pop()
            steps = dis.get_instructions(inside)
            names |= {step.argval for step in steps if step.opname.endswith(("_GLOBAL", "_NAME"))}
            codes += [constant for constant in inside.co_consts if isinstance(constant, CodeType)]
        held: list[tuple[str, Any]] = [(name, known_globals[name]) for name in sorted(names & known_globals.keys())]
        for name, cell in zip(code.co_freevars, thing.__closure__ or (), strict=True):
            with suppress(ValueError):  # not bound yet
                held.append((name, cell.cell_contents))
        held += [("default", value) for value in thing.__defaults__ or ()]
        held += [*(thing.__kwdefaults__ or {}).items(), *vars(thing).items()]
        for name, value in held:
            # objects of this package, such as platforms, are constant, but keep what they compute on demand
            is_ours = type(value).__module__.partition(".")[0] == _PACKAGE
            is_elsewhere = isinstance(value, FunctionType) and value.__globals__ is not known_globals
            if not (is_ours or is_elsewhere or isinstance(value, type | ModuleType | BuiltinFunctionType)):
                yield name.encode()
                yield from _parts(value, seen) if isinstance(value, FunctionType) else _of_value(value)
    elif inspect.isclass(thing):
        yield thing.__qualname__.encode()
        for base in thing.__mro__:
            yield from _parts(base, seen)
        for name, value in vars(thing).items():
            if not name.startswith("__") or isinstance(value, FunctionType):
                yield name.encode()
                function = getattr(value, "__func__", getattr(value, "fget", value))
                yield from _parts(function, seen) if isinstance(function, FunctionType) else _of_value(function)
    elif isinstance(thing, LinearController):
        yield repr((thing.signals, thing.space)).encode()
        yield from _parts(thing.system, seen)
    elif all(hasattr(thing, name) for name in "ABCD"):
        yield repr([np.asarray(getattr(thing, name)).tolist() for name in "ABCD"] + [thing.dt]).encode()
    else:
        if not is_control_system(thing):
            yield from _parts(type(thing), seen)
        yield from _of_value(thing)


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
