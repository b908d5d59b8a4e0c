"""Sessions of a live page, played in its worker by Node: what they save runs again as it is."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright._impl._driver import compute_driver_executable

import gough_stewart as gs
from gough_stewart.harness.export.live.page import page_data

# Encoders do not round, since they would round plants that differ by rounding to different steps sooner or later.
EXACT: dict[str, Any] = {"sensors.quantisation": {}}
PID = {"type": "pid", "bandwidth": 2.0, "integral_time": 1.0, "feedforward": "gravity"}
EVENTS = {
    "change": [{"at": 0.2, "parameters": {"platform_mass": 1500}, "factors": {"gravity": 1.01}}],
    "disturbance": [{"at": 0.25, "duration": 0.2, "force": [300, 0, -100]}],
    "fault": [{"at": 0.3, "duration": 0.05, "cut": [2]}],
}
# Several kinds of laws, rows a sample, noise, drives, feedforward, and what the experiments do themselves.
PAGES: dict[str, tuple[str, dict[str, Any]]] = {
    "step": ("heave_step", {**EXACT, "sensors.noise": {"leg_length": 3e-6}, "actuators.lag": 4e-3}),
    "sine": ("pitch_sine", {**EXACT, "controller.feedforward": "computed_torque", "loop.delay": 1}),
    "integral": ("pitch_sine", {**EXACT, "controller": PID, "actuators.rate_limit": 5e5, "loop.plant_step": 1e-3}),
    "task": ("pitch_sine", {**EXACT, "controller.space": "task", **EVENTS}),
    "notch": ("heave_step", {**EXACT, "controller.notch": {"frequency": 40.0, "damping": 0.4, "depth": 0.2}, **EVENTS}),
    "open": ("paper_open_loop", {"loop.duration": 0.5}),
}
NAMES = ("position", "orientation", "velocity", "angular_velocity", "leg_length", "actuator_force")


def session_of(rng: np.random.Generator, data: dict[str, Any]) -> list[dict[str, Any]]:
    """Messages of a hand that does what comes to its mind, with time that goes on in between."""
    messages: list[dict[str, Any]] = []
    turn, reach, home = data["turn"], np.array(data["reach"]), np.array(data["home"])
    wanted = list(turn["wanted"])

    def tuned(**values: Any) -> None:
        for name, value in values.items():
            wanted[turn["names"].index(name)] = value
        messages.append({"type": "tune", "values": list(wanted)})

    def target() -> None:
        values = home + 0.4 * rng.uniform(-1, 1, 6) * reach
        messages.append({"type": "target", "values": values.tolist()})

    def jump() -> None:
        target()
        axis = int(rng.integers(6))
        messages.append({"type": "jump", "axis": axis, "by": float(0.05 * reach[axis])})

    def payload() -> None:
        load = float(rng.uniform(0, 0.5) * data["platformMass"])
        messages.append({"type": "add", "name": "parameters", "from": data["mass"], "values": [load]})

    def tilt() -> None:
        messages.append({"type": "add", "name": "parameters", "from": data["gravity"], "values": [1.0, 0.0, 0.2]})

    def push() -> None:
        force = (rng.integers(-1, 2, 3) * 0.1 * 9.81 * data["platformMass"]).tolist()
        messages.append({"type": "add", "name": "inputs", "from": 6, "values": force})

    def fault() -> None:
        place, on = int(rng.choice([0, 3, 18 + 4])), int(rng.integers(2))
        messages.append({"type": "add", "name": "faults", "from": place, "values": [on]})

    closed = [
        target, target, jump, fault,
        lambda: tuned(bandwidth=float(rng.uniform(1.5, 3.5)), damping_ratio=float(rng.uniform(0.6, 1.2))),
        lambda: tuned(proportional=float(rng.uniform(0.8, 1.3)), derivative=float(rng.uniform(0.9, 1.4))),
        lambda: tuned(filter_time=float(rng.choice([0.0, 0.006]))),
        lambda: tuned(noise=float(rng.choice([0.0, 2e-6]))),
    ]  # fmt: skip
    shared = [
        payload, tilt, push, push,
        lambda: tuned(delay=int(rng.integers(4))),
        lambda: tuned(force_limit=[None, 1.2 * data["largestForce"], 5 * data["largestForce"]][rng.integers(3)]),
        lambda: messages.append({"type": "again"}),
    ]  # fmt: skip
    forces = [lambda: messages.append({"type": "forces", "values": rng.uniform(45, 60, 6).tolist()})] * 4
    acts = shared + (forces if data["isOpen"] else closed)
    for _ in range(int(rng.integers(6, 16))):
        acts[rng.integers(len(acts))]()
        if rng.random() < 0.8:
            messages.append({"type": "some", "rows": int(rng.integers(1, 120))})
    return [*messages, {"type": "some", "rows": 100}]


def played(sessions: list[dict[str, Any]], folder: Path) -> list[dict[str, str]]:
    """The files of sessions."""
    pages = {name: page_data(gs.load_experiment(*PAGES[name])) for name in {session["page"] for session in sessions}}
    for session in sessions:
        rng = np.random.default_rng(session["seed"])
        session["messages"] = session.get("messages") or session_of(rng, pages[session["page"]])
    (folder / "in.json").write_text(json.dumps({"pages": pages, "sessions": sessions}))
    script = Path(__file__).parents[3] / "support" / "session.mjs"
    command = [compute_driver_executable()[0], str(script), str(folder / "in.json"), str(folder / "out.json")]
    subprocess.run(command, check=True, timeout=300)
    return json.loads((folder / "out.json").read_text())


def assert_runs_again(files: dict[str, str], folder: Path) -> gs.Record:
    """Expected: `run` of the files has their rows to 1e-9 m, rad, m/s and 1e-9 of the largest force."""
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_text(text)
    theirs, again = gs.read_record(folder), gs.run(folder / "experiment.toml")
    rows = theirs.table.height
    assert again.table.height >= rows
    for name in NAMES:
        scale = 9.81 * 1000 if name == "actuator_force" else 1.0
        apart = np.abs(again[name][:rows] - theirs[name]).max(axis=1) / scale
        assert apart.max() < 1e-9, (folder.name, name, int((apart > 1e-9).argmax()), apart.max())
    return theirs


def test_sessions_run_again_as_they_are(tmp_path: Path) -> None:
    """Twenty sessions at random: drag, step, tune, load, push, break, and begin again."""
    sessions = [{"page": page, "seed": seed} for seed, page in enumerate(sorted(PAGES) * 4)][:20]
    moved = 0.0
    for k, files in enumerate(played(sessions, tmp_path)):
        record = assert_runs_again(files, tmp_path / f"{k}_{sessions[k]['page']}")
        moved = max(moved, float(np.ptp(record["position"], axis=0).max()))
    assert moved > 0.02
