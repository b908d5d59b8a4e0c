"""Sessions of a live page, played in its worker by Node: what they save runs again as it is."""

import json
import subprocess
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright._impl._driver import compute_driver_executable

import gough_stewart as gs
from gough_stewart.harness.export.live.page import live_machine, page_data
from tests.harness.export.test_machine import Machine

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

    closed: list[Callable[[], None]] = [
        target, target, jump, fault,
        lambda: tuned(bandwidth=float(rng.uniform(1.5, 3.5)), damping_ratio=float(rng.uniform(0.6, 1.2))),
        lambda: tuned(proportional=float(rng.uniform(0.8, 1.3)), derivative=float(rng.uniform(0.9, 1.4))),
        lambda: tuned(filter_time=float(rng.choice([0.0, 0.006]))),
        lambda: tuned(noise=float(rng.choice([0.0, 2e-6]))),
    ]  # fmt: skip
    shared: list[Callable[[], None]] = [
        payload, tilt, push, push,
        lambda: tuned(delay=int(rng.integers(4))),
        lambda: tuned(force_limit=[None, 1.2 * data["largestForce"], 5 * data["largestForce"]][rng.integers(3)]),
        lambda: messages.append({"type": "again"}),
    ]  # fmt: skip
    forces: list[Callable[[], None]] = [
        lambda: messages.append({"type": "forces", "values": rng.uniform(45, 60, 6).tolist()})
    ] * 4
    acts = shared + (forces if data["isOpen"] else closed)
    for _ in range(int(rng.integers(6, 16))):
        acts[rng.integers(len(acts))]()
        if rng.random() < 0.8:
            messages.append({"type": "some", "rows": int(rng.integers(1, 120))})
    return [*messages, {"type": "some", "rows": 100}]


def played(sessions: list[tuple[str, Any]], folder: Path) -> list[dict[str, Any]]:
    """What the worker says in sessions of a page and messages, or a seed of them; at the end its files."""
    pages = {name: page_data(gs.load_experiment(*PAGES[name])) for name in {page for page, _ in sessions}}
    told = []
    for page, hand in sessions:
        messages = session_of(np.random.default_rng(hand), pages[page]) if isinstance(hand, int) else hand(pages[page])
        told.append({"page": page, "messages": [*messages, {"type": "files"}]})
    (folder / "in.json").write_text(json.dumps({"pages": pages, "sessions": told}))
    script = Path(__file__).parents[3] / "support" / "session.mjs"
    command = [compute_driver_executable()[0], str(script), str(folder / "in.json"), str(folder / "out.json")]
    subprocess.run(command, check=True, timeout=300)
    said: list[dict[str, Any]] = json.loads((folder / "out.json").read_text())
    return said


def written(said: dict[str, Any], folder: Path, which: int = -1) -> tuple[gs.Record, dict[str, Any]]:
    """The record that a page saved, and its experiment, in a folder."""
    folder.mkdir()
    for name, text in said["written"][which]["files"].items():
        (folder / name).write_text(text)
    return gs.read_record(folder), tomllib.loads((folder / "experiment.toml").read_text())


def assert_runs_again(record: gs.Record, folder: Path) -> None:
    """Expected: `run` of the experiment has all rows, to 1e-9 m, rad, m/s, rad/s, and of a tonne's weight."""
    again, rows = gs.run(folder / "experiment.toml"), record.table.height
    assert again.table.height >= rows
    for name in NAMES:
        scale = 9.81e3 if name == "actuator_force" else 1.0
        apart = np.abs(again[name][:rows] - record[name]).max(axis=1) / scale
        assert apart.max() < 1e-9, (folder.name, name, int((apart > 1e-9).argmax()), apart.max())


def test_sessions_run_again_as_they_are(tmp_path: Path) -> None:
    """Twenty sessions at random: drag, step, tune, load, push, break, and restart."""
    sessions = [(page, seed) for seed, page in enumerate(sorted(PAGES) * 4)][:20]
    moved, keys = 0.0, set[str]()
    for k, said in enumerate(played(sessions, tmp_path)):
        folder = tmp_path / f"{k}_{sessions[k][0]}"
        record, experiment = written(said, folder)
        assert_runs_again(record, folder)
        moved = max(moved, float(np.ptp(record["position"], axis=0).max()))
        keys |= {key for change in experiment.get("change", []) for key in change} | set(experiment)
    assert moved > 0.02
    assert keys >= {"controller", "delay", "force_limit", "noise", "parameters", "disturbance", "fault", "reference"}


def test_rows_are_those_of_native_code(tmp_path: Path) -> None:
    """Expected: all signals and forces of 3 s, noise included, bit for bit."""
    (said,) = played([("step", lambda _: [{"type": "some", "rows": 3000}])], tmp_path)
    record, _ = written(said, tmp_path / "page")
    native = Machine(live_machine(gs.load_experiment(*PAGES["step"])).block).run(3000)
    names = ("position", "orientation", "velocity", "angular_velocity", "leg_length", "leg_velocity")
    assert np.array_equal(np.concatenate([record[name] for name in names], axis=1), native["row_signals"])
    assert np.array_equal(record["actuator_force"], native["row_forces"])
    assert np.ptp(native["row_forces"][:100], axis=0).min() > 0.1  # noise


def test_what_is_tuned_gives_no_kick_and_is_in_the_file_after_a_restart(tmp_path: Path) -> None:
    """Expected: forces at rest stay within 2 % of the weight at another bandwidth, at the begin and on the way."""
    for_3_hz = {"bandwidth": 3.0, "filter_time": 0.01}

    def hand(data: dict[str, Any]) -> list[dict[str, Any]]:
        turn = data["turn"]
        values = [for_3_hz.get(name, value) for name, value in zip(turn["names"], turn["wanted"], strict=True)]
        tune, some = {"type": "tune", "values": values}, {"type": "some", "rows": 100}
        return [some, tune, some, {"type": "files"}, {"type": "again"}, some]

    (said,) = played([("step", hand)], tmp_path)
    for which, begins in ((0, False), (1, True)):
        record, experiment = written(said, tmp_path / str(which), which)
        forces, weight = record["actuator_force"], record["actuator_force"][0]
        assert np.abs(forces - weight).max() < 0.02 * np.abs(weight).max()
        assert (experiment["controller"]["bandwidth"] == 3.0) is begins
        assert ("change" in experiment) is not begins


def test_a_step_is_measured(tmp_path: Path) -> None:
    """Expected: rise time and overshoot of `gs.metrics` for a run with this step, to a row."""
    by = 0.02
    jump = {"type": "jump", "axis": 2, "by": by}
    (said,) = played(
        [("step", lambda _: [{"type": "some", "rows": 1}, jump, {"type": "some", "rows": 3100}])], tmp_path
    )
    (ours,) = said["response"]
    step = {"reference.position_change": [0, 0, by], "reference.at": 0.1, "loop.duration": 3.2}
    (theirs,) = gs.metrics(gs.run("heave_step", {**PAGES["step"][1], **step}))["step_response"]
    assert ours["rise"] == pytest.approx(theirs["rise_time"], abs=1.5e-3)
    assert 100 * ours["overshoot"] == pytest.approx(theirs["overshoot_percent"], abs=0.05)


def test_a_crash_can_be_saved_after_a_restart(tmp_path: Path) -> None:
    """Expected: the rows until the platform fell, with their end, which `run` repeats; and the new session without."""
    no_forces = {"type": "forces", "values": [0.0] * 6}
    some = {"type": "some", "rows": 300}
    files = {"type": "files", "ofCrash": True}
    (said,) = played(
        [("open", lambda _: [no_forces, some, some, {"type": "again"}, {"type": "some", "rows": 3}, files])], tmp_path
    )
    crash, _ = written(said, tmp_path / "crash", 0)
    assert crash.metadata["outcome"]["status"] == "diverged"
    again = gs.run(tmp_path / "crash" / "experiment.toml")
    assert again.table.height == crash.table.height
    assert np.abs(again["position"] - crash["position"]).max() < 1e-9
    assert written(said, tmp_path / "new", 1)[0].table.height == 3


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"controller": {"type": "python", "file": "law.py"}}, "expected a controller of the types pd, pid"),
        ({"plant.kind": "fmu3"}, "expected 'model': set plant.kind=model"),
        ({"plant.fixed_step_size": 1e-3}, "has plant.fixed_step_size 0.001; a page steps by error control"),
        ({"change": [{"at": 0.1, "delay": 2}]}, "changes settings of its loop during the run"),
    ],
)
def test_what_a_page_cannot_run_is_refused(settings: dict[str, Any], said: str) -> None:
    """Expected: what was found, and what would work."""
    with pytest.raises(gs.GoughStewartError, match=said):
        live_machine(gs.load_experiment("heave_step", settings))
