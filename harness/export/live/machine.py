"""What a live page runs: an experiment's machine as data, and what a hand may do to it."""

import base64
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.fmu_build.plant.layout import MemberFailure as Failure
from gough_stewart.harness.control.controllers import OpenLoop
from gough_stewart.harness.control.faults import N_FAULTS
from gough_stewart.harness.errors import ControllerError, ExportError
from gough_stewart.harness.experiment.file import without_none
from gough_stewart.harness.experiment.overrides import with_settings
from gough_stewart.harness.experiment.preparation import Prepared, prepare
from gough_stewart.harness.experiment.run import FORMAT
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.live.behind import behind_of
from gough_stewart.harness.export.machine import Block, machine_of
from gough_stewart.harness.export.machine import fields as field_numbers
from gough_stewart.harness.export.machine import MOST_DELAY, POLES, WANTED, turning
from gough_stewart.harness.output.versions import versions
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.harness.results.record import plain
from gough_stewart.harness.section import file_names
from gough_stewart.model import interface
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform

# Rows that a call computes at most.
KEPT = 512
# Names of the machine's fields that a page reads and writes.
_FIELDS = (
    *("signals", "inputs", "parameters", "feedforward", "plan_reference", "plan_target", "plan_smoothed"),
    *("turn_wanted", "turn_used", "turn_results", "cut", "frozen"),
    *("row_signals", "row_forces", "row_force_limited", "row_rate_limited"),
    *("change_parameters", "change_inputs", "change_faults"),
)
# What a page says of a run that ended early.
_FAILURES = {
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
# Files of what is taken home.
_TAKEN = ("record.csv", "metadata.json", "experiment.toml", "reference.csv")
# Tried from home: a sixth part of the mean leg length, and half a radian.
_FARTHEST = (1 / 6, 0.5)
_TRIED = 24
# Forces of the legs, then an external wrench.
N_INPUTS = N_LEGS + 6
# What is left free of the stroke at the ends of what a hand may ask for along one axis alone.
_FREE = 0.12


class Live(NamedTuple):
    """A machine for a page."""

    block: Block
    experiment: Experiment
    prepared: Prepared
    data: dict[str, Any]  # for its scripts, in plain types


def live_machine(experiment: Experiment) -> Live:
    """The machine of an experiment.

    Raises
    ------
    ExportError
        A controller that needs Python or an FMU, another plant than the model, or steps of a fixed size.
    """
    name, kind = experiment.where, getattr(experiment.controller, "type", "")
    if experiment.code:
        raise ExportError(
            f"{name} executes {', '.join(map(str, experiment.code))}, which a page cannot; expected a controller of "
            "the types pd, pid, state_space or open_loop, and the plant 'model'"
        )
    if experiment.plant.kind != "model":
        raise ExportError(f"{name} has the plant '{experiment.plant.kind}'; expected 'model': set plant.kind=model")
    if experiment.plant.fixed_step_size:
        raise ExportError(
            f"{name} has plant.fixed_step_size {experiment.plant.fixed_step_size:g}; a page steps by error control: "
            "set plant.fixed_step_size=0"
        )
    prepared = prepare(experiment)
    try:
        turned = turning(experiment, prepared)
        block = machine_of(experiment, prepared, KEPT, forever=True, turned=turned)
    except ControllerError as error:
        raise ExportError(f"{name}: controller '{kind}': {error}") from error
    if block.law is not None:
        raise ExportError(f"{name}: a page has the laws of shipped components; expected one of them")
    return Live(block, experiment, prepared, {**_data(experiment, prepared), "turn": _turned(turned, prepared)})


def _turned(fields: dict[str, Any], prepared: Prepared) -> dict[str, Any]:
    """What the page may turn, and where it finds poles and margins."""

    return {
        "wanted": [float(value) if np.isfinite(value) else None for value in fields["wanted"]],
        "names": WANTED,
        "gains": fields["variant"] >= 0,
        "integral": fields["variant"] >= 0 and bool(fields["gains"][12] > 0),
        "margins": "results" in fields,
        "poles": POLES,
        "most": fields.get("most_states", 0),
        "mostDelay": max(MOST_DELAY, int(prepared.loop.actuators.delay)),
        "sampleTime": fields["sample_time"],
    }


def _data(experiment: Experiment, prepared: Prepared) -> dict[str, Any]:
    platform, machine, loop = prepared.platform, prepared.machine, prepared.loop
    limit = float(np.min(loop.actuators.values["force_limit"]))
    ends = np.cumsum([0, *(v.size for v in interface.PLATFORM_PARAMETERS)]).tolist()
    begins = {v.name: ends[k] for k, v in enumerate(interface.PLATFORM_PARAMETERS)}
    stroke = [machine.leg_length_min, machine.leg_length_max]
    is_open = isinstance(experiment.controller, OpenLoop)
    return {
        "fields": {name: field_numbers()[name] for name in _FIELDS},
        "plantStep": loop.timing.plant_step,
        "every": loop.timing.steps_a_sample,
        "kept": KEPT,
        "duration": loop.timing.duration,
        "forceLimit": limit if np.isfinite(limit) else None,
        "largestForce": float(
            np.abs(static_leg_forces(platform, platform.home_position, platform.home_orientation)).max()
        ),
        "stroke": stroke if None not in stroke else None,
        # rows of the experiment's changes, and sizes of what they and a hand change
        "changes": sorted({loop.timing.row(change.time, "a change") for change in loop.changes} - {0}),
        "sizes": {
            **{"parameters": ends[-1], "inputs": N_INPUTS},
            **{"cut": N_LEGS, "frozen": signals.SIZE, "cut,frozen": N_FAULTS},
        },
        "mass": begins["platform_mass"],
        "gravity": begins["gravity"],
        "platformMass": machine.platform_mass,
        "g": np.asarray(machine.gravity).tolist(),
        "taken": _taken(experiment, prepared),
        "isOpen": is_open,
        "reads": list(getattr(prepared.controller, "signals", ())),
        "behind": behind_of(experiment, prepared) if is_open else None,
        "forces": np.ravel(loop.feedforward[0])[:6].tolist() if is_open else [],
        "failures": _FAILURES,
        "reach": reach_of(platform).tolist(),
        "home": [*np.asarray(platform.home_position).tolist(), *np.asarray(platform.home_orientation).tolist()],
    }


def _taken(experiment: Experiment, prepared: Prepared) -> dict[str, Any]:
    """What goes with a record and an experiment that are taken home."""
    of_file, files = _carried(experiment)
    actuators, timing = prepared.loop.actuators, prepared.loop.timing
    return {
        "name": Path(experiment.where).stem,
        "experiment": of_file,
        "files": files,
        "metadata": {
            "format": FORMAT,
            "title": f"{experiment.title}, live",
            "plant": experiment.plant.kind,
            "experiment": experiment.model_dump(mode="json"),
            "sample_time": timing.sample_time,
            "force_limit": actuators.force_limit,
            "platform": plain(prepared.platform),
            "machine": plain(prepared.machine),
            "versions": versions(),
        },
    }


def _carried(experiment: Experiment) -> tuple[dict[str, Any], dict[str, str]]:
    """The experiment's own keys, and the files that it names, in base64 by the names that they have there.

    They lie beside the experiment, wherever they were; shipped recordings are found by their names.
    """
    names, found = dict[str, str](), dict[str, str]()
    for key, name in file_names(experiment).items():
        path = experiment.folder / name
        if not path.is_file():
            continue
        own, raw = Path(name).name, base64.b64encode(path.read_bytes()).decode()
        k = 2
        while found.get(own, raw) != raw or own in _TAKEN:
            own, k = f"{Path(name).stem}_{k}{Path(name).suffix}", k + 1
        found[own] = raw
        names[".".join(key)] = own
    of_file = without_none(experiment.model_dump(mode="json", exclude_unset=True))
    return with_settings(of_file, names), found


def reach_of(platform: Platform) -> Any:
    """How far a hand may ask for along and about each axis, from home (6,) [m, rad].

    As far, to both sides, as all legs keep clear of the ends of their stroke; without a stroke, of lengths a tenth off.
    """
    home = np.concatenate([platform.home_position, platform.home_orientation])
    at_home = leg_geometry(platform, home[:3], home[3:]).length
    low = 0.9 * float(at_home.min()) if platform.leg_length_min is None else platform.leg_length_min
    high = 1.1 * float(at_home.max()) if platform.leg_length_max is None else platform.leg_length_max
    free = _FREE * (high - low)
    found = np.zeros(6)
    for axis in range(6):
        most = _FARTHEST[0] * float(at_home.mean()) if axis < 3 else _FARTHEST[1]
        for share in np.linspace(1, 0, _TRIED, endpoint=False):
            poses = home + share * most * np.eye(6)[axis] * np.array([[1.0], [-1.0]])
            lengths = leg_geometry(platform, poses[:, :3], poses[:, 3:]).length
            if (lengths > low + free).all() and (lengths < high - free).all():
                found[axis] = share * most
                break
    return found
