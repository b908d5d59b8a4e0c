"""A page in which an experiment's loop runs, by the C of c/machine as WebAssembly; it loads nothing."""

import base64
import html
import zlib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from gough_stewart.harness.control.by_hand import lengths_for_hands
from gough_stewart.harness.control.component import N_FAULTS
from gough_stewart.harness.control.controllers import OpenLoop
from gough_stewart.harness.experiment.file import without_none
from gough_stewart.harness.experiment.overrides import with_settings
from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.experiment.run import FORMAT
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.machine import (
    FAILURES,
    MOST_DELAY,
    POLES,
    REQUESTED,
    endless_machine,
    fields,
    planned_motion,
)
from gough_stewart.harness.export.machine_c import shipped_wasm
from gough_stewart.harness.paper.open_loop import run_kernel
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.harness.report import page as report_page
from gough_stewart.harness.report.offline import asset, document, three, three_licence
from gough_stewart.harness.report.palette import THEMES
from gough_stewart.harness.section import file_names, plain
from gough_stewart.model import interface
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.errors import StepError
from gough_stewart.model.formulations.cases import OpenLoopCase, paper_case
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.process.installed import versions

# Scripts of the report's page that all pages share, and of its 3-D view; the machine starts before both are read.
_FIRST, _SHARED = ("page.js",), ("state.js", "records.js", "shapes.js", "bodies.js")
_VIEW = ("viewer.js", "scene.js")
_LIVE = ("pictures.js", "controls.js", "download.js", "live.js")
_PACKAGES = ("gough-stewart", "numpy", "casadi", "ziglang")
# Rows that a call computes at most.
KEPT = 512
# The machine's fields that a page reads and writes.
_FIELDS = (
    *("signals", "inputs", "parameters", "feedforward", "plan_reference", "plan_target", "plan_smoothed"),
    *("turn_wanted", "turn_used", "turn_results", "cut", "frozen"),
    *("planned", "target", "driven", "acting", "delayed"),
    *("row_signals", "row_forces", "row_force_limited", "row_rate_limited"),
    *("change_parameters", "change_inputs", "change_faults"),
)
# Files of a download, whose names no file of an experiment may have there.
_DOWNLOADED = ("record.csv", "metadata.json", "experiment.toml", "targets.csv")
# A hand's reach: from home at most a sixth of the mean leg length, and half a radian; so many shares of it are tried.
_FARTHEST = (1 / 6, 0.5)
_TRIED = 24
# What is left free of the stroke at the ends of what a hand may ask for along one axis alone.
_FREE = 0.12
# Of what a chart shows [m, rad].
_DIGITS = 7


def live_page(experiment: Experiment) -> bytes:
    """The page of an experiment; ExportError for what a page cannot run, see `endless_machine`."""
    data = {
        "title": experiment.title,
        "runs": [],
        "scenes": [],
        "palette": {theme: report_page.palette_of(theme) for theme in THEMES},
        "nearness": report_page.NEARNESS,
        "live": _live(experiment),
    }
    used = ", ".join(f"{name} {number}" for name, number in versions().items() if name in _PACKAGES)
    texts = {"title": experiment.title, "about": experiment.description, "licences": three_licence(), "versions": used}
    escaped = {name: html.escape(text) for name, text in texts.items()}
    body = Template(_script("live.html")).substitute(escaped, themes=report_page.THEME_OPTIONS)
    style = report_page.colours() + asset("page.css") + asset("stage.css") + _script("live.css")
    first = "\n".join([*map(asset, _FIRST), _script("engine.js")])
    rest = "\n".join([*map(asset, (*_SHARED, *_VIEW)), *map(_script, _LIVE)])
    return document(experiment.title, body, style, data, [first, three(), rest], computes=True)


def _live(experiment: Experiment) -> dict[str, Any]:
    """The machine of an experiment, what a hand may do to it, and the view, in plain types for the scripts."""
    block, prepared, turned = endless_machine(experiment, KEPT, "a page")
    platform, machine, loop = prepared.platform, prepared.machine, prepared.loop
    home, timing, choice = (platform.home_position, platform.home_orientation), loop.timing, experiment.controller
    limit, is_open = float(np.min(loop.actuators.values["force_limit"])), isinstance(choice, OpenLoop)
    ends = np.cumsum([0, *(v.size for v in interface.PLATFORM_PARAMETERS)]).tolist()
    begins = {v.name: ends[k] for k, v in enumerate(interface.PLATFORM_PARAMETERS)}
    low, high = machine.leg_length_min, machine.leg_length_max
    stroke = None if low is None or high is None else [float(np.max(low)), float(np.min(high))]
    has_gains = turned["variant"] >= 0
    start_force = loop.feedforward[0]
    if prepared.controller is not None:
        start_force = static_leg_forces(machine, prepared.start.position, prepared.start.orientation)
    lengths = np.linalg.norm(machine.platform_points + machine.home_position - machine.base_points, axis=1)
    short, long = (
        float(np.min(0.9 * lengths if low is None else low)),
        float(np.max(1.1 * lengths if high is None else high)),
    )
    lower = min(0.97 * short, 0.53 * long)

    # how far a hand may ask for along and about each axis, from home (6,) [m, rad]: as far, to both sides, as all legs
    # keep clear of the ends of their stroke; without a stroke, of lengths a tenth off
    pose, (shortest, longest) = np.concatenate(home), lengths_for_hands(platform)
    free, reach = _FREE * (longest - shortest), np.zeros(6)
    for axis in range(6):
        most = _FARTHEST[0] * float(leg_geometry(platform, *home).length.mean()) if axis < 3 else _FARTHEST[1]
        for share in np.linspace(1, 0, _TRIED, endpoint=False):
            poses = pose + share * most * np.eye(6)[axis] * np.array([[1.0], [-1.0]])
            tried = leg_geometry(platform, poses[:, :3], poses[:, 3:]).length
            if (tried > shortest + free).all() and (tried < longest - free).all():
                reach[axis] = share * most
                break
    raw = shipped_wasm(block.variant), block.words.astype("<i8").tobytes()
    code, words = (base64.b64encode(zlib.compress(content, 9)).decode() for content in raw)
    return {
        "fields": {name: fields()[name] for name in _FIELDS},
        "plantStep": timing.plant_step,
        "every": timing.steps_a_sample,
        "kept": KEPT,
        "duration": timing.duration,
        # of these a page has no more than the experiment
        "endsWithRun": bool(experiment.loop.jitter or loop.injection is not None),
        "forceLimit": limit if np.isfinite(limit) else None,
        "largestForce": float(np.abs(static_leg_forces(platform, *home)).max()),
        "stroke": stroke,
        # rows of the experiment's changes, and sizes of what they and a hand change
        "changes": sorted({timing.row(change.time, "a change") for change in loop.changes} - {0}),
        "sizes": {
            **{"parameters": ends[-1], "inputs": N_LEGS + 6},
            **{"cut": N_LEGS, "frozen": signals.SIZE, "cut,frozen": N_FAULTS},
        },
        "mass": begins["platform_mass"],
        "gravity": begins["gravity"],
        "platformMass": machine.platform_mass,
        "g": np.asarray(machine.gravity).tolist(),
        "download": _download(experiment, prepared),
        "isOpen": is_open,
        "canTake": prepared.reference is not None and planned_motion(prepared.reference) is not None,
        "reads": list(getattr(prepared.controller, "signals", ())),
        "behind": _behind(experiment, prepared) if is_open else None,
        "startForce": start_force.tolist(),
        "forces": np.ravel(loop.feedforward[0])[:6].tolist() if is_open else [],
        "failures": FAILURES,
        "reach": reach.tolist(),
        "home": np.concatenate(home).tolist(),
        # what may be tuned, and where poles and margins are among the results
        "turn": {
            "wanted": [float(value) if np.isfinite(value) else None for value in turned["wanted"]],
            "names": REQUESTED,
            "gains": has_gains,
            "integral": has_gains and bool(turned["gains"][12] > 0),
            "margins": "results" in turned,
            "poles": POLES,
            "most": turned.get("most_states", 0),
            "mostDelay": max(MOST_DELAY, int(loop.actuators.delay)),
            "sampleTime": turned["sample_time"],
        },
        # the bodies of the view; their motion comes from the machine
        "scene": {
            "base": machine.base_points.tolist(),
            "platform": machine.platform_points.tolist(),
            "lower": lower,
            "upper": min(0.97 * short, 1.06 * long - lower),
        },
        "wasm": code,
        "block": words,
        "worker": _script("session.js") + _script("worker.js"),
    }


def _script(name: str) -> str:
    return (files("gough_stewart.harness.export.live") / "web" / name).read_text(encoding="utf-8")


def _download(experiment: Experiment, prepared: Prepared) -> dict[str, Any]:
    """What goes with a record and an experiment: its own keys, and the files that it names, in base64 by their names.

    They lie beside the experiment, wherever they were; shipped recordings are found by their names.
    """
    names, contents = dict[str, str](), dict[str, str]()
    for key, file in file_names(experiment).items():
        path = experiment.folder / file
        if not path.is_file():
            continue
        name, content, k = Path(file).name, base64.b64encode(path.read_bytes()).decode(), 2
        while contents.get(name, content) != content or name in _DOWNLOADED:
            name, k = f"{Path(file).stem}_{k}{Path(file).suffix}", k + 1
        contents[name] = content
        names[".".join(key)] = name
    keys = without_none(experiment.model_dump(mode="json", exclude_unset=True))
    return {
        "name": Path(experiment.where).stem,
        "experiment": with_settings(keys, names),
        "files": contents,
        "metadata": {
            "format": FORMAT,
            "title": f"{experiment.title}, live",
            "plant": experiment.plant.kind,
            "experiment": experiment.model_dump(mode="json"),
            "sample_time": prepared.loop.timing.sample_time,
            "force_limit": prepared.loop.actuators.force_limit,
            "platform": plain(prepared.platform.as_dict()),
            "machine": plain(prepared.machine.as_dict()),
            "versions": versions(),
        },
    }


def _behind(experiment: Experiment, prepared: Prepared) -> dict[str, Any] | None:
    """Pose and lengths over time under constant forces, by DOP853, which shares no code with the page's C.

    None if they are not constant, something changes them, or they drive the platform into a pose that it cannot pass.
    """
    forces, duration = np.reshape(prepared.loop.feedforward, (-1, 6)), experiment.loop.duration
    if prepared.loop.changes or np.ptp(forces, axis=0).any():
        return None
    case, paper = OpenLoopCase(experiment.title, prepared.machine, prepared.start, forces[0], duration), paper_case()
    try:
        run = run_kernel(case)
    except StepError:
        return None
    is_published = (
        repr(replace(case.platform, name="", source="")) == repr(replace(paper.platform, name="", source=""))
        and np.array_equal(case.start.to_vector(), paper.start.to_vector())
        and np.array_equal(case.actuator_force, paper.actuator_force)
    )
    return {
        "time": run.time.tolist(),
        "pose": np.round(np.concatenate([run["position"], run["orientation"]], axis=1), _DIGITS).tolist(),
        "length": np.round(run["leg_length"], _DIGITS).tolist(),
        "isPublished": is_published,
    }
