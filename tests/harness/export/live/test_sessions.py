"""Live pages as `gs.export` writes them, played in their worker by Node: rows against runs, margins, what they save."""

import json
import re
import subprocess
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright._impl._driver import compute_driver_executable

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.uneven_loops import experiment_of as uneven_experiment

# Encoders do not round, since they would round plants that differ by rounding to different steps sooner or later.
EXACT: dict[str, Any] = {"sensors.quantisation": {}}
PID = {"type": "pid", "bandwidth": 2.0, "integral_time": 1.0, "feedforward": "gravity"}
NOTCH = {"frequency": 40.0, "damping": 0.4, "depth": 0.2}
EVENTS = {
    "change": [{"at": 0.2, "parameters": {"platform_mass": 1500}, "factors": {"gravity": 1.01}}],
    "disturbance": [{"at": 0.25, "duration": 0.2, "force": [300, 0, -100]}],
    "fault": [{"at": 0.3, "duration": 0.05, "cut": [2]}],
}
Page = tuple[Any, dict[str, Any]]
# Several kinds of laws, rows a sample, noise, drives, feedforward, and what the experiments do themselves.
PAGES: dict[str, Page] = {
    "step": ("heave_step", {**EXACT, "sensors.noise": {"leg_length": 3e-6}, "actuators.lag": 4e-3}),
    "sine": ("pitch_sine", {**EXACT, "controller.feedforward": "computed_torque", "loop.delay": 1}),
    "integral": ("pitch_sine", {**EXACT, "controller": PID, "actuators.rate_limit": 5e5, "loop.plant_step": 1e-3}),
    "task": ("pitch_sine", {**EXACT, "controller.space": "task", **EVENTS}),
    "notch": ("heave_step", {**EXACT, "controller.notch": NOTCH, **EVENTS}),
    "open": ("paper_open_loop", {"loop.duration": 0.5}),
}
UNEQUAL_ENDS = np.array([0.02, 0.0, 0.03, 0.01, 0.04, 0.02])  # of the strokes of legs [m]
NAMES = ("position", "orientation", "velocity", "angular_velocity", "leg_length", "actuator_force")
Hand = Callable[[dict[str, Any]], list[dict[str, Any]]]


def data_of(page: Page, folder: Path) -> dict[str, Any]:
    """What the scripts of a page get."""
    (file,) = gs.export(*page, forms="page", out=folder)
    found = re.search(r'<script[^>]*id="data"[^>]*>(.*?)</script>', file.read_text(), re.S)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])["live"]
    return data


def played(sessions: list[tuple[Page, Hand | int]], folder: Path) -> list[dict[str, Any]]:
    """What the worker says in sessions of a page and a hand, or the seed of one; at the end its files."""
    pages, told = dict[str, dict[str, Any]](), []
    for page, hand in sessions:
        name = repr(page)
        data = pages[name] if name in pages else pages.setdefault(name, data_of(page, folder))
        messages = session_of(np.random.default_rng(hand), data) if isinstance(hand, int) else hand(data)
        told.append({"page": list(pages).index(name), "messages": [*messages, {"type": "files"}]})
    (folder / "in.json").write_text(json.dumps({"pages": list(pages.values()), "sessions": told}))
    script = str(Path(__file__).with_name("session.mjs"))
    command = [compute_driver_executable()[0], script, str(folder / "in.json"), str(folder / "out.json")]
    subprocess.run(command, check=True, timeout=300)
    said: list[dict[str, Any]] = json.loads((folder / "out.json").read_text())
    return said


def written(said: dict[str, Any], folder: Path, which: int = -1) -> tuple[gs.Record, dict[str, Any]]:
    """The record that a page saved, and its experiment, in a folder."""
    folder.mkdir()
    for name, text in said["written"][which]["files"].items():
        (folder / name).write_text(text)
    return gs.read_record(folder), tomllib.loads((folder / "experiment.toml").read_text())


def assert_same_rows(record: gs.Record, again: gs.Record, where: str) -> None:
    """Rows that a page kept, at least a millisecond apart, are those of a run, to 1e-9 SI, and of a tonne's weight."""
    every = round(record.metadata["plant_step"] / again.metadata["plant_step"])
    rows = min(record.table.height, (len(again["time"]) - 1) // every)  # a run's last row has forces of no sample
    assert rows > 30
    for name in NAMES:
        scale, expected = 9.81e3 if name == "actuator_force" else 1.0, again[name][::every]
        apart = np.abs(expected[:rows] - record[name][:rows]).max(axis=1) / scale
        assert apart.max() < 1e-9, (where, name, int((apart > 1e-9).argmax()), apart.max())


def some(rows: int) -> dict[str, Any]:
    """Rows at once."""
    return {"type": "some", "rows": rows}


def tune(data: dict[str, Any], **values: Any) -> dict[str, Any]:
    """Settings of the loop, beside those of the file."""
    turn = data["turn"]
    wanted = dict(zip(turn["names"], turn["wanted"], strict=True))
    return {"type": "tune", "values": list({**wanted, **values}.values())}


# ---- rows ----

SWING = {"position_amplitude": ["8 mm", "-5 mm", "6 mm"], "orientation_amplitude": ["1 deg", "0.5 deg", "-0.7 deg"]}
CHANGES = {key.replace("amplitude", "change"): values for key, values in SWING.items()}
SLOWER = {"time_scale": 1.3, "amplitude_scale": 0.7}
ROUND = {"type": "circle", "radius": "5 mm", "frequency": "3 Hz"}
CHIRP = {"type": "chirp", **SWING, "from_frequency": "1 Hz", "to_frequency": "6 Hz", "duration": "80 ms"}
MOTIONS: dict[str, dict[str, Any]] = {
    "hold": {"type": "hold"},
    "step": {"type": "step", **CHANGES, "at": "0.031 s"},
    "point to point": {"type": "point_to_point", **CHANGES, "at": "0.01 s", "duration": "0.07 s", **SLOWER},
    "sine": {"type": "sine", **SWING, "frequency": "4 Hz", "phase": "30 deg"},
    "faded sine": {"type": "sine", **SWING, "frequency": "4 Hz", "phase": "30 deg", "fade_in": "50 ms", **SLOWER},
    "chirp": CHIRP,
    "faded chirp": {**CHIRP, "fade_in": "60 ms", **SLOWER},
    **{f"circle in {plane}": {**ROUND, "plane": plane, **SLOWER} for plane in ("xy", "yz")},
    **{f"faded circle in {plane}": {**ROUND, "plane": plane, "fade_in": "40 ms"} for plane in ("xz", "yz")},
}
FASTEST = {
    **{"type": "path", "relative_to": "home", "timing": "fastest", "margin": 0.3},
    "poses": [[0, 0, 0, 0, 0, 0], [0.03, 0, 0.06, 0, 0.05, 0]],
}
STICKS_AND_GIVES = {
    **{"friction_model": "elasto_plastic", "coulomb_friction": 90.0, "static_friction": 120.0},
    **{"stiffness": 6e7, "armature": 25.0},
}


def loops(kind: str) -> dict[str, Page]:
    """Pages whose rows are those of runs: motions of an uneven platform, shipped experiments, and variants."""
    if kind == "motions":
        around: dict[str, Any] = {
            "loop": {"duration": 0.12, "sample_time": "4 ms", "plant_step": "1 ms", "delay": 2},
            "limits": {"reference": "warn", "position_error": "5 m"},
            "sensors": {"noise": {"leg_length": "2 um"}, "seed": 3},
        }
        pages: dict[str, Page] = {}
        for name, motion in MOTIONS.items():
            loop, feedforward = ("task", "computed_torque") if "faded" in name else ("pid", "gravity")
            experiment = uneven_experiment(loop, reference=motion, **around)
            pages[name] = experiment, {"controller.feedforward": feedforward}
        return pages
    if kind == "shipped":
        names = ("circle_computed_torque", "excitation", "paper_open_loop", "recorded_ride", "saturation")
        return {name: (name, {"loop.duration": 0.4, **EXACT}) for name in names} | {
            "payload_change": ("payload_change", {"loop.duration": 2.1, **EXACT}),
            # it brakes until its end, and rests then
            "fastest path": (
                "heave_step",
                {"reference": FASTEST, "controller.feedforward": "computed_torque", "loop.duration": 0.4, **EXACT},
            ),
        }
    sticks = {f"plant.parameters.leg_{name}": value for name, value in STICKS_AND_GIVES.items()}
    heavier = {"change": [{"at": 0.03, "factors": {"platform_mass": 1.5}}]}
    jitter: dict[str, Any] = {"loop.jitter": "0.25 ms", "loop.plant_step": "0.25 ms", "sensors.noise": {}, **EXACT}
    return {
        "sticks": ("heave_step", {"loop.duration": 0.06, "reference.at": 0.01, **EXACT, **sticks, **heavier}),
        "jitter": ("frequency_response", {"loop.duration": 3, **jitter}),
    }


@pytest.mark.parametrize("kind", ["motions", "shipped", "variants"])
def test_a_page_has_the_rows_of_the_run(kind: str, tmp_path: Path) -> None:
    """Expected: `run`, whose references and feedforward NumPy computes in advance."""
    records = {name: gs.run(*page) for name, page in loops(kind).items()}
    sessions: list[tuple[Page, Hand | int]] = [
        (page, lambda _, n=records[name].table.height: [some(n)])  # type: ignore[misc]
        for name, page in loops(kind).items()
    ]
    for (name, record), said in zip(records.items(), played(sessions, tmp_path), strict=True):
        ours, _ = written(said, tmp_path / name)
        assert ours.table.height >= min(record.table.height, 800)
        assert_same_rows(ours, record, name)
        assert name == "hold" or np.ptp(record["leg_length"], axis=0).max() > 1e-5


def test_it_goes_on_after_the_experiments_end_and_keeps_the_last_minute(tmp_path: Path) -> None:
    """Expected: of 64 s in rows of 20 ms, those of a minute, with one more, of an experiment that lasts so long."""
    slow = {"loop.sample_time": 0.02, "loop.plant_step": 0.02, "loop.delay": 0, "controller.bandwidth": 0.5, **EXACT}
    (said,) = played([(("heave_step", slow), lambda _: [some(3200)])], tmp_path)
    ours, theirs = written(said, tmp_path / "page")[0], gs.run("heave_step", {**slow, "loop.duration": 65})
    assert ours.metadata["outcome"]["status"] == "completed"
    for name in ("time", *NAMES):
        np.testing.assert_allclose(ours[name], theirs[name][199:3200], rtol=1e-9, atol=1e-9)


# ---- settings ----

UNEQUAL: dict[str, Any] = {
    **{"type": "pid", "proportional_gain": [3e5, 2e5, 2.5e5, 3e5, 2e5, 2.2e5], "derivative_on": "measurement"},
    **{"derivative_gain": [2e4, 3e4, 2.5e4, 2e4, 2.1e4, 2.6e4], "integral_gain": [1e5, 2e5, 1e5, 3e5, 2e5, 1e5]},
}
FACTORS = {"proportional": 1.5, "derivative": 0.8, "integral": 2.0}
SCALED = {f"{name}_gain": [factor * k for k in UNEQUAL[f"{name}_gain"]] for name, factor in FACTORS.items()}
# An experiment, what it begins with, what is tuned; and settings of the file that say the same, besides their keys.
TUNED: dict[str, tuple[str, dict[str, Any], dict[str, float], dict[str, Any]]] = {
    "bandwidth and damping": ("pitch_sine", {}, {"bandwidth": 2.6, "damping_ratio": 0.9}, {}),
    "an integral with a delay": (
        *("pitch_sine", {"controller": PID}, {"bandwidth": 3.0, "integral_time": 0.7, "delay": 3, "filter_time": 4e-3}),
        {},
    ),
    "a task-space loop with a notch": (
        *("pitch_sine", {"controller.space": "task", "controller.notch": NOTCH}, {"bandwidth": 1.5, "delay": 1}, {}),
    ),
    "held inputs": (
        *("pitch_sine", {"controller.discretisation": "zoh", "actuators.lag": 4e-3}, {"bandwidth": 2.5}, {}),
    ),
    "a derivative of measurements": (
        *("heave_step", {"loop.plant_step": 5e-4}, {"bandwidth": 3.0, "filter_time": 0.01}, {}),
    ),
    "unequal gains": (
        *("pitch_sine", {"controller": UNEQUAL}, {**FACTORS, "delay": 2}),
        {f"controller.{name}": values for name, values in SCALED.items()},
    ),
}
KEYS = {"delay": "loop.delay", "filter_time": "controller.derivative_filter"}


def settings_of(case: str) -> dict[str, Any]:
    """The settings of the file that say what is tuned."""
    _, begin, values, same = TUNED[case]
    keys = {KEYS.get(name, f"controller.{name}"): value for name, value in values.items() if name not in FACTORS}
    return {**begin, **keys, **same}


def results(said: dict[str, Any]) -> FloatArray:
    """The latest margins and modes; NaN where there are none."""
    return np.array(said["margins"][-1]["values"], dtype=float)


def test_margins_and_rows_follow_what_is_tuned(tmp_path: Path) -> None:
    """Expected: `gs.margins` with these settings, to 1e-4, by another eigenvalue solver; `run`, up to a force limit."""
    limit, hear = 4100.0, {"type": "hear", "what": "margins"}
    sessions: list[tuple[Page, Hand | int]] = []
    for name, begin, values, _ in TUNED.values():
        page = name, {**begin, **EXACT, "loop.duration": 0.4, "limits.reference": "warn"}
        sessions.append((page, lambda d, v=values: [tune(d, **v), hear, tune(d, **v, force_limit=limit), some(400)]))  # type: ignore[misc]
    for case, (page, _), said in zip(TUNED, sessions, played(sessions, tmp_path), strict=True):
        theirs, found = gs.margins(page[0], settings_of(case)), results(said)
        legs = [[leg.gain_up, leg.gain_down, leg.phase, leg.delay, leg.crossover] for leg in theirs.legs]
        assert found[4:34].reshape(6, 5) == pytest.approx(np.array(legs), rel=1e-4), case
        assert found[2:4] == pytest.approx([theirs.sensitivity_peak, theirs.complementary_peak], rel=1e-5)
        n, most = int(found[1]), (len(found) - 35) // 4
        poles = found[35 : 35 + 2 * n : 2] + 1j * found[36 : 36 + 2 * n : 2]
        assert np.abs(poles).max() == pytest.approx(found[0], rel=1e-12)
        modes = found[35 + 2 * most :].reshape(-1, 2)[: int(found[34])]
        assert modes[0] == pytest.approx([theirs.modes[0].frequency, theirs.modes[0].damping_ratio], rel=1e-6)
        # some pole near each of the slow modes: those of delays are defective, and have few digits
        for mode in theirs.modes:
            apart = np.abs(poles - np.exp(mode.eigenvalue * theirs.sample_time)).min()
            assert apart < 1e-6 or mode.frequency >= 30
        ours, _ = written(said, tmp_path / case)
        settings = {**page[1], **settings_of(case), "actuators.force_limit": limit}
        assert_same_rows(ours, gs.run(page[0], settings), case)


def test_encoders_are_as_they_are_told(tmp_path: Path) -> None:
    """Expected: a page whose file says so, to 1e-12, since gains are rounded otherwise; without, another one."""
    common = {"sensors.noise": {}, "sensors.quantisation": {}, "sensors.seed": 5}
    sessions: list[tuple[Page, Hand | int]] = [(("pitch_sine", common), lambda _: [some(200)])]
    for key, size in (("noise", 2e-6), ("quantisation", 2e-5)):
        made = ("pitch_sine", {**common, f"sensors.{key}": {"leg_length": size}})
        sessions.append((("pitch_sine", common), lambda d, v={key: size}: [tune(d, **v), some(200)]))  # type: ignore[misc]
        sessions.append((made, lambda _: [some(200)]))
    rows = [written(s, tmp_path / str(k))[0]["leg_length"] for k, s in enumerate(played(sessions, tmp_path))]
    for tuned, made_so in ((1, 2), (3, 4)):
        assert np.abs(rows[tuned] - rows[made_so]).max() <= 1e-12
        assert np.abs(rows[tuned] - rows[0]).max() > 1e-7


def test_what_is_beyond_its_bounds_changes_nothing(tmp_path: Path) -> None:
    """Expected: the position of what is refused, and the rows of a run; a null is infinite."""
    refused = [
        *(("bandwidth", -1.0), ("damping_ratio", 0.0), ("delay", 1.5), ("delay", 99.0), ("force_limit", 0.0)),
        *(("noise", None), ("filter_time", 1e-4), ("proportional", 0.0), ("integral_time", 0.01)),
    ]
    page = ("pitch_sine", {**EXACT, "controller": PID, "loop.duration": 0.5})
    (said,) = played([(page, lambda data: [*(tune(data, **{key: v}) for key, v in refused), some(200)])], tmp_path)
    names = data_of(page, tmp_path)["turn"]["names"]
    assert [answer["status"] for answer in said["tuned"]] == [1 + names.index(key) for key, _ in refused]
    assert_same_rows(written(said, tmp_path / "page")[0], gs.run(*page), "refused")


def test_an_unstable_loop_has_poles_and_no_margins(tmp_path: Path) -> None:
    """Expected: `gs.margins` refuses the same loop as unstable, with this worst eigenvalue."""
    page: Page = ("heave_step", {})
    hear = {"type": "hear", "what": "margins"}
    (said,) = played([(page, lambda data: [tune(data, bandwidth=15.0, delay=12), hear])], tmp_path)
    with pytest.raises(gs.UnstableLoopError) as error:
        gs.margins("heave_step", {"controller.bandwidth": 15.0, "loop.delay": 12})
    assert results(said)[0] == pytest.approx(abs(error.value.eigenvalue), rel=1e-9)
    assert np.isnan(results(said)[2:34]).all()


# ---- sessions ----


def session_of(rng: np.random.Generator, data: dict[str, Any]) -> list[dict[str, Any]]:
    """Messages of a hand that does what comes to its mind, with time that goes on in between."""
    messages: list[dict[str, Any]] = []
    turn, reach, home = data["turn"], np.array(data["reach"]), np.array(data["home"])
    wanted = list(turn["wanted"])

    def send(kind: str, **values: Any) -> None:
        messages.append({"type": kind, **values})

    def tuned(**values: Any) -> None:
        for name, value in values.items():
            wanted[turn["names"].index(name)] = value
        send("tune", values=list(wanted))

    def target() -> None:
        send("target", values=(home + 0.4 * rng.uniform(-1, 1, 6) * reach).tolist())

    def jump() -> None:
        target()
        axis = int(rng.integers(6))
        send("jump", axis=axis, by=float(0.05 * reach[axis]))

    def add(name: str, place: int, *values: Any) -> None:
        send("add", name=name, **{"from": place}, values=list(values))

    def push() -> None:
        add("inputs", 6, *(rng.integers(-1, 2, 3) * 0.1 * 9.81 * data["platformMass"]).tolist())

    closed: list[Callable[[], None]] = [
        target, target, jump, lambda: add("faults", int(rng.choice([0, 3, 18 + 4, 24])), int(rng.integers(2))),
        lambda: tuned(bandwidth=float(rng.uniform(1.5, 3.5)), damping_ratio=float(rng.uniform(0.6, 1.2))),
        lambda: tuned(proportional=float(rng.uniform(0.8, 1.3)), derivative=float(rng.uniform(0.9, 1.4))),
        lambda: tuned(filter_time=float(rng.choice([0.0, 0.006]))),
        lambda: tuned(noise=float(rng.choice([0.0, 2e-6]))),
    ]  # fmt: skip
    shared: list[Callable[[], None]] = [
        lambda: add("parameters", data["mass"], float(rng.uniform(0, 0.5) * data["platformMass"])),
        lambda: add("parameters", data["gravity"], 1.0, 0.0, 0.2), push, push,
        lambda: tuned(delay=int(rng.integers(4))),
        lambda: tuned(force_limit=[None, 1.2 * data["largestForce"], 5 * data["largestForce"]][rng.integers(3)]),
        lambda: send("again"),
    ]  # fmt: skip
    forces: list[Callable[[], None]] = [lambda: send("forces", values=rng.uniform(45, 60, 6).tolist())] * 4
    acts = shared + (forces if data["isOpen"] else closed)
    for _ in range(int(rng.integers(6, 16))):
        acts[rng.integers(len(acts))]()
        if rng.random() < 0.8:
            send("some", rows=int(rng.integers(1, 120)))
    return [*messages, some(100)]


def test_sessions_run_again_as_they_are(tmp_path: Path) -> None:
    """Sessions at random: drag, step, tune, load, push, break, and restart; `run` of what they save has their rows."""
    pages = sorted(PAGES) * 2
    sessions: list[tuple[Page, Hand | int]] = [(PAGES[page], seed) for seed, page in enumerate(pages)]
    moved, keys = 0.0, set[str]()
    for k, said in enumerate(played(sessions, tmp_path)):
        folder = tmp_path / f"{k}_{pages[k]}"
        record, experiment = written(said, folder)
        assert_same_rows(record, gs.run(folder / "experiment.toml"), folder.name)
        moved = max(moved, float(np.ptp(record["position"], axis=0).max()))
        keys |= {key for change in experiment.get("change", []) for key in change} | set(experiment)
    assert moved > 0.02
    assert keys >= {"controller", "delay", "force_limit", "parameters", "disturbance", "fault", "reference"}


def test_what_is_tuned_gives_no_kick_and_is_in_the_file_after_a_restart(tmp_path: Path) -> None:
    """Expected: forces at rest stay within 2 % of the weight at another bandwidth, at the begin and on the way."""

    def hand(data: dict[str, Any]) -> list[dict[str, Any]]:
        for_3_hz = tune(data, bandwidth=3.0, filter_time=0.01)
        return [some(100), for_3_hz, some(100), {"type": "files"}, {"type": "again"}, some(100)]

    (said,) = played([(PAGES["step"], hand)], tmp_path)
    for which, begins in ((0, False), (1, True)):
        record, experiment = written(said, tmp_path / str(which), which)
        forces, weight = record["actuator_force"], record["actuator_force"][0]
        assert np.abs(forces - weight).max() < 0.02 * np.abs(weight).max()
        assert np.ptp(forces[:100], axis=0).min() > 0.1  # noise
        assert (experiment["controller"]["bandwidth"] == 3.0) is begins
        assert ("change" in experiment) is not begins


def test_a_step_is_measured(tmp_path: Path) -> None:
    """Expected: rise time and overshoot of `gs.metrics` for a run with this step, to a row."""
    by = 0.02
    jump = {"type": "jump", "axis": 2, "by": by}
    (said,) = played([(PAGES["step"], lambda _: [some(1), jump, some(3100)])], tmp_path)
    (ours,) = said["response"]
    step = {"reference.position_change": [0, 0, by], "reference.at": 0.1, "loop.duration": 3.2}
    (theirs,) = gs.metrics(gs.run("heave_step", {**PAGES["step"][1], **step}))["step_response"]
    assert ours["rise"] == pytest.approx(theirs["rise_time"], abs=1.5e-3)
    assert 100 * ours["overshoot"] == pytest.approx(theirs["overshoot_percent"], abs=0.05)


def test_a_crash_can_be_saved_after_a_restart(tmp_path: Path) -> None:
    """Expected: the rows until the platform fell, with their end, which `run` repeats; and the new session without."""
    no_forces, files = {"type": "forces", "values": [0.0] * 6}, {"type": "files", "ofCrash": True}
    hand = [no_forces, some(300), some(300), *[{"type": "again"}, some(3)] * 2, files]
    (said,) = played([(PAGES["open"], lambda _: hand)], tmp_path)
    crash, _ = written(said, tmp_path / "crash", 0)
    assert crash.metadata["outcome"]["status"] == "diverged"
    again = gs.run(tmp_path / "crash" / "experiment.toml")
    assert again.table.height == crash.table.height
    assert_same_rows(crash, again, "crash")
    assert written(said, tmp_path / "new", 1)[0].table.height == 3


# ---- what a page is told ----


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"controller": {"type": "python", "file": "law.py"}}, "expected a controller of the types pd, pid"),
        ({"plant.kind": "fmu3"}, "expected 'model': set plant.kind=model"),
        ({"plant.fixed_step_size": 1e-3}, "has plant.fixed_step_size 0.001; a page steps by error control"),
        ({"change": [{"at": 0.1, "delay": 2}]}, "changes settings of its loop during the run"),
        (
            {"actuators.force_limit": "platform", "platform.parameters.actuator_force_max": [9e3, 8e3, *[9e3] * 4]},
            "a page has one for all legs; expected one number, for instance actuators.force_limit = that of the weak",
        ),
    ],
)
def test_what_a_page_cannot_run_is_refused(settings: dict[str, Any], said: str, tmp_path: Path) -> None:
    """Expected: what was found, and what would work."""
    with pytest.raises(gs.GoughStewartError, match=said):
        gs.export("heave_step", settings, forms="page", out=tmp_path)


def test_a_file_of_the_experiment_keeps_its_place_beside_the_record(tmp_path: Path) -> None:
    """Expected: under another name than the record's; the saved experiment follows it."""
    (tmp_path / "record.csv").write_text(gs.run("heave_step", {"loop.duration": 0.2}).table.write_csv())
    motion = {"type": "file", "file": str(tmp_path / "record.csv")}
    page: Page = ("heave_step", {"reference": motion, "loop.duration": 0.1, **EXACT})
    (said,) = played([(page, lambda _: [some(50)])], tmp_path)
    _, saved = written(said, tmp_path / "page")
    assert list(data_of(page, tmp_path)["download"]["files"]) == [saved["reference"]["file"]] == ["record_2.csv"]


def test_a_hand_may_ask_for_what_the_legs_can_reach(tmp_path: Path) -> None:
    """Expected: along each axis to both sides, legs within the stroke of an uneven platform, whichever end is near."""
    experiment = uneven_experiment("pd", reference={"type": "hold"}, limits={"stroke": "ignore"})
    believed = gs.Platform(name="uneven", source="", **experiment.platform.parameters)
    at_home = gs.leg_geometry(believed, believed.home_position, believed.home_orientation).length
    for low, high in ((at_home.min() - 0.2, 3.9), (2.3, at_home.max() + 0.2)):
        ends = {"leg_length_min": (low - UNEQUAL_ENDS).tolist(), "leg_length_max": (high + UNEQUAL_ENDS).tolist()}
        data = data_of((experiment, {f"platform.parameters.{key}": end for key, end in ends.items()}), tmp_path)
        assert data["stroke"] == pytest.approx([low, high])
        reach, home = np.array(data["reach"]), np.array(data["home"])
        assert (reach > 0).all()
        for axis in range(6):
            for sign in (1, -1):
                pose = home + sign * reach[axis] * np.eye(6)[axis]
                lengths = gs.leg_geometry(believed, pose[:3], pose[3:]).length
                assert (lengths > low).all()
                assert (lengths < high).all()


def test_behind_an_open_loop_is_its_run_by_other_code(tmp_path: Path) -> None:
    """Expected: `run` to 1e-7 of SI units, the digits carried; other forces, start or machine are told apart."""
    record, behind = gs.run("paper_open_loop"), data_of(("paper_open_loop", {}), tmp_path)["behind"]
    assert behind["isPublished"]
    pose = np.concatenate([record["position"], record["orientation"]], axis=1)
    assert np.abs(np.subtract(behind["pose"], pose)).max() < 1e-7
    assert np.abs(np.subtract(behind["length"], record["leg_length"])).max() < 1e-7
    assert behind["time"] == pytest.approx(record["time"], abs=1e-12)
    others: list[dict[str, Any]] = [
        {"controller.force": [55, 49.5, 55, 49.5, 55, 50]},
        {"start.velocity": [0, 0.1, 0]},
        {"plant.parameters": {"platform_mass": 11}},
    ]
    assert not any(data_of(("paper_open_loop", s), tmp_path)["behind"]["isPublished"] for s in others)
    push = {"disturbance": [{"at": 0.1, "duration": 0.2, "force": [1, 0, 0]}]}
    assert data_of(("paper_open_loop", push), tmp_path)["behind"] is None
