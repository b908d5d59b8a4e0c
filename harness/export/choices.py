"""What can be chosen of an export: forms, where the reference comes from, parts of the machine, bad inputs."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.model.interface import nearest

Form = Literal["fmu", "c", "ssp", "page"]
FORMS: tuple[Form, ...] = get_args(Form)
ReferenceFrom = Literal["inside", "inputs"]
Part = Literal["drives", "sensors", "manual"]
PARTS: tuple[Part, ...] = get_args(Part)
SafeForce = Literal["feedforward", "zero"]
SAFE_FORCES: tuple[SafeForce, ...] = get_args(SafeForce)
# What serves instead of a form that there was.
_REMOVED = {"clocked": "; the unit without a clock serves: form fmu"}
# Steps in a sample of the controller: a unit keeps the forces of all steps that its output waits.
MOST_STEPS = 1000


class Frozen(NamedTuple):
    """A measurement that is the same for some samples while its reference moves farther than that [m] is frozen."""

    samples: int
    movement: float  # [m]


class Faults(NamedTuple):
    """What a controller does about bad inputs: its safe force, and which inputs count as frozen."""

    safe_force: SafeForce = "feedforward"
    frozen: Frozen | None = None  # not watched


def faults_of(safe_force: str = "feedforward", frozen: object = None) -> Faults:
    """The choices about bad inputs, from a user's values."""
    if safe_force not in SAFE_FORCES:
        raise ExportError(f"safe_force is {safe_force!r}; expected {' or '.join(map(repr, SAFE_FORCES))}")
    if frozen is None:
        return Faults(safe_force)
    try:
        samples, movement = map(float, frozen)  # type: ignore[call-overload]
    except (TypeError, ValueError):
        samples, movement = np.nan, np.nan
    if not (1 <= samples <= 1e9 and samples == round(samples) and 0 < movement < np.inf):
        raise ExportError(
            f"frozen is {frozen!r}; expected a number of samples and a movement of the reference in metres that "
            "the sensors resolve, such as (50, 0.001)"
        )
    return Faults(safe_force, Frozen(int(samples), movement))


@dataclass(frozen=True)
class Carried:
    """The parts of the machine that a controller carries, with their designed values; none by default.

    Drives advance at every step of the plant, and sensors with a sample time of their own read at some of them. So a
    controller that carries one of these has the plant's step for its clock. Otherwise its clock is its sample time.
    """

    parts: tuple[Part, ...] = ()
    lag: float = 0.0  # of the drives [s]
    quantisation: Mapping[str, float] = field(default_factory=dict)  # by signal; without the others
    steps_a_sample: int = 1  # of the clock, in a sample of the controller
    steps_a_reading: int | None = None  # None for readings at the samples

    @property
    def has_steps(self) -> bool:
        """Whether its clock is the plant's step, be it as long as a sample."""
        return "drives" in self.parts or self.steps_a_reading is not None


def carried(parts: tuple[Part, ...], prepared: Prepared) -> Carried:
    """The parts of a prepared experiment."""
    timing, sensors = prepared.loop.timing, prepared.loop.sensors
    reading = sensors.sample_time if "sensors" in parts else None
    steps = timing.steps_a_sample if "drives" in parts or reading is not None else 1
    if steps > MOST_STEPS:
        raise ExportError(
            f"{' and '.join(parts)} run at the plant_step of {timing.plant_step:g} s, {steps} times in a sample "
            f"of {timing.sample_time:g} s; expected at most {MOST_STEPS} times: a longer plant_step"
        )
    return Carried(
        parts,
        float(prepared.loop.actuators.lag) if "drives" in parts else 0.0,
        dict(sensors.quantisation) if "sensors" in parts else {},
        steps,
        None if reading is None else timing.steps_in(reading, "the sensors' sample_time"),
    )


NOTHING = Carried()


def requested(kind: Literal["form", "part"], names: Iterable[str] | str) -> tuple[Any, ...]:
    """Forms or parts without repetition, in the order of `FORMS` or `PARTS`; at least one form."""
    known: tuple[str, ...] = FORMS if kind == "form" else PARTS
    if not isinstance(names, Iterable):
        raise ExportError(f"{kind}s is {names!r}; expected one or more of {', '.join(known)}")
    wanted = [names] if isinstance(names, str) else list(names)
    for name in wanted:
        if name not in known:
            raise ExportError(f"no {kind} '{name}'{nearest(name, known)}{_REMOVED.get(name, '')}")
    if kind == "form" and not wanted:
        raise ExportError(f"no form; expected one or more of {', '.join(known)}")
    return tuple(name for name in known if name in wanted)


def name_of(experiment: Experiment) -> str:
    """A C identifier from the name of the experiment or its file."""
    place = experiment.where.removeprefix("experiment").strip() or experiment.title
    words = re.findall(r"[a-z0-9]+", Path(place).stem.lower())
    name = "_".join(words)[:24].strip("_")
    return name if name[:1].isalpha() else f"loop_{name}".rstrip("_")
