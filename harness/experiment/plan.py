"""The plan of an ensemble, everything that determines its results; what it says of a controller from Python."""

import dis
import hashlib
import inspect
import json
import pickle
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.makers import name_of
from gough_stewart.harness.control.state_space import is_control_system
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.file import digests, experiment_from
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.schema import Experiment

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
