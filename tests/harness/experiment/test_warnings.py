"""What a run warns of, before and after it: each condition from both sides, legs and axes unlike."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.commands import invoke
from tests.support.experiments import written
from tests.support.uneven import PARAMETERS, UNEVEN
from tests.support.uneven_loops import experiment_of

REMEDY = "set controller.feedforward = 'gravity', or use a PID, whose integral takes it away"
# A platform that is much damped comes to rest within 3 s.
AT_REST: dict[str, Any] = {
    "title": "at rest",
    "reference": {"type": "hold"},
    "controller": {"type": "pd", "bandwidth": 2, "damping_ratio": 1.2},
    "loop": {"duration": 3, "sample_time": 5e-3, "delay": 0},
}


def said_of(folder: Path, **tables: Any) -> tuple[list[str], gs.Record]:
    """What the command notes of a run of the uneven platform without Coulomb friction, and its record."""
    parameters = {**PARAMETERS, "leg_coulomb_friction": 0.0, **tables.pop("parameters", {})}
    values = {**AT_REST, "platform": {"parameters": parameters}, **tables}
    done = invoke("run", str(written(values, folder / "x.toml")), "--out", str(folder / "out"), "--json")
    return [note["text"] for note in json.loads(done.stdout).get("notes", ())], gs.read_record(folder / "out")


def push(*force: float) -> dict[str, Any]:
    """A force from the start to the end [N]."""
    return {"disturbance": [{"at": 0, "duration": 3, "force": list(force)}]}


# The paper's platform, whose legs are alike, in a stiffer loop.
STIFF: dict[str, Any] = {
    "platform": {"preset": "liu2000"},
    "controller": {"type": "pd", "bandwidth": 5, "damping_ratio": 0.5},
    "loop": {"duration": 3, "sample_time": 3e-3},
}
PID = {"type": "pid", "bandwidth": 2, "damping_ratio": 1.2, "integral_time": 0.3}
STEP = {"type": "step", "at": 0.1, "position_change": [0, 0, 2e-3]}
SLOW = {"type": "sine", "position_amplitude": [0, 0, 1e-3], "frequency": 0.1}
# What differs from a platform whose PD carries its weight, and what is said of it.
RESTS: dict[str, tuple[dict[str, Any], str]] = {
    "its weight": (STIFF, "hangs {} below"),
    "its weight after a step": ({**STIFF, "reference": STEP}, "hangs {} below"),
    "a force aside": ({**STIFF, **push(90, 40, 0)}, "rests {} off"),
    "gravity aslant": ({}, "rests {} off"),
    "a force up": (push(0, 0, 700), "rests {} off"),
    "an integral": ({"controller": PID}, ""),
    "feedforward": ({"controller": {**AT_REST["controller"], "feedforward": "gravity"}}, ""),
    "a run too short": ({"loop": {**AT_REST["loop"], "duration": 0.2}}, ""),
    "a reference that moves": ({"reference": SLOW}, ""),
}


@pytest.mark.parametrize("case", RESTS)
def test_a_platform_hangs_where_its_error_is_against_gravity(case: str, tmp_path: Path) -> None:
    """Expected: the mean error of the last fifth; it hangs where that is within 25.8° = acos 0.9 of the way up."""
    tables, words = RESTS[case]
    notes, record = said_of(tmp_path, **tables)
    error = record["error.position"][int(0.8 * record.table.height) :].mean(axis=0)
    size = float(np.linalg.norm(error))
    gravity = np.asarray(record.metadata["platform"]["gravity"])
    up = -gravity / np.linalg.norm(gravity)
    assert not words or (error @ up > 0.9 * size) == words.startswith("hangs")
    how = words.format(f"{1e3 * size:.3g} mm")
    said = f"the platform {how} its reference at the end: the load over the stiffness of its PD; {REMEDY}"
    assert [note for note in notes if "at the end" in note] == ([said] if words else [])


def test_an_error_counts_from_a_ten_thousandth_of_the_mean_leg(tmp_path: Path) -> None:
    """Expected: of six unlike legs, by loads in proportion, as the loop is nearly linear."""
    error = said_of(tmp_path, parameters={"gravity": [0, 0, -0.1]})[1]["error.position"][-1]
    home = gs.leg_geometry(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation).length
    least = 1e-4 * float(np.mean(home))
    for share, count in ((0.98, 0), (1.02, 1)):
        gravity = [0, 0, -0.1 * share * least / float(np.linalg.norm(error))]
        notes, _ = said_of(tmp_path, parameters={"gravity": gravity})
        assert sum("at the end" in note for note in notes) == count


def test_the_first_leg_out_of_its_stroke_is_said_with_its_length(tmp_path: Path) -> None:
    """Expected: the first row of the record with a flag; nothing where strokes are to be ignored."""
    _, free = said_of(tmp_path)
    low = float(np.sort(free["leg_length"].min(axis=0))[0] + 1e-3)
    for stroke in ("warn", "ignore"):
        notes, record = said_of(tmp_path, parameters={"leg_length_min": low}, limits={"stroke": stroke})
        row, leg = (int(k) for k in np.argwhere(record["leg_length"] < low)[0])
        assert row > 3
        length, time = record["leg_length"][row, leg], record["time"][row]
        said = (
            f"leg {leg + 1} left its stroke at {time:.6g} s with a length of {length:.6g} m; see flag.stroke_exceeded"
        )
        assert [note for note in notes if "stroke" in note] == ([said] if stroke == "warn" else [])


def test_feedforward_beyond_the_limit_is_said_with_its_leg(tmp_path: Path) -> None:
    """Expected: the largest size, here of a pull against a gravity that is turned; nothing of a limit that is met."""
    controller = {**AT_REST["controller"], "feedforward": "gravity"}
    tables = {"controller": controller, "limits": {"reference": "warn", "stroke": "ignore"}}
    gravity = {"gravity": (-np.asarray(UNEVEN.gravity)).tolist()}
    _, free = said_of(tmp_path, parameters=gravity, **tables)
    force = free["controller.feedforward"][0]
    leg, most = int(np.abs(force).argmax()), float(np.abs(force).max())
    assert force[leg] < 0
    for limit, count in ((0.9 * most, 1), (1.001 * most, 0)):
        notes, _ = said_of(tmp_path, parameters=gravity, **tables, actuators={"force_limit": limit})
        said = (
            f"feedforward requires {most:.4g} N of leg {leg + 1} at 0 s; its force limit is {limit:.4g} N. Make the "
            "reference slower or smaller; if it is a noisy recording, smooth it"
        )
        assert notes.count(said) == sum(note.startswith("feedforward") for note in notes) == count


@pytest.mark.parametrize("kind", ["noise", "quantisation"])
@pytest.mark.parametrize(
    ("name", "unit", "scale"),
    [
        ("position", "m", "leg"),
        ("leg_length", "m", "leg"),
        ("orientation", "rad", 1.0),
        ("velocity", "m/s", "leg a tenth of a second"),
        ("leg_velocity", "m/s", "leg a tenth of a second"),
        ("angular_velocity", "rad/s", 10.0),
    ],
)
def test_a_sensor_is_too_coarse_beyond_a_twentieth_of_its_scale(kind: str, name: str, unit: str, scale: Any) -> None:
    """Expected: of the mean leg at home, of a radian, and of either in a tenth of a second; its words whole."""
    arms = UNEVEN.platform_points @ Rotation.from_euler("xyz", UNEVEN.home_orientation).as_matrix().T
    leg = float(np.linalg.norm(UNEVEN.home_position + arms - UNEVEN.base_points, axis=1).mean())
    size = {"leg": leg, "leg a tenth of a second": 10 * leg}.get(scale, scale)
    for share, count in ((0.0499, 0), (0.0501, 1)):
        lines: list[str] = []
        made = experiment_of("pd", plant={}, sensors={kind: {name: share * size}, "seed": 3})
        gs.run(made, {"loop.duration": 0.015, "limits.stroke": "ignore"}, warn=lines.append)
        found = [line for line in lines if line.startswith("sensors.")]
        assert len(found) == count
        if count:
            assert found == [
                f"sensors.{kind}.{name} is {share * size:g} {unit}, 0.0501 of the platform's scale of {size:.3g} "
                f"{unit}; check its unit"
            ]


@pytest.mark.parametrize("is_told", [True, False])
def test_a_function_that_keeps_memory_is_said_once_and_in_the_record(is_told: bool) -> None:
    """Expected: that it keeps memory, after the warnings of the experiment; nothing of one that keeps none."""
    times, lines = list[float](), list[str]()

    def law(sample: gs.Sample) -> FloatArray:
        times.append(sample.time)
        return np.full(6, 4000.0)

    settings = {"loop.duration": 0.02, "reference.at": 0.05}
    record = gs.run("heave_step", settings, controller=law, warn=lines.append if is_told else None)
    late, keeps = record.metadata["warnings"]
    assert late.startswith("reference.at is 0.05 s")
    assert re.match(r"the function .*law\(\) keeps memory, which the run has changed, and another run goes on", keeps)
    assert lines == ([late, keeps] if is_told else [])
    without = gs.run("heave_step", settings, controller=lambda _: np.full(6, 4000.0))
    assert without.metadata["warnings"] == [late]


@pytest.mark.parametrize("plant", [None, "model"])
def test_a_run_of_a_member_warns_as_a_plain_run_does(plant: Any) -> None:
    """Expected: the plain run's limit and hint at its sensors; a function that keeps memory is a plain run's only."""
    settings = {
        "platform.parameters": {"leg_velocity_max": 0.05},
        "limits.reference": "warn",
        "sensors.quantisation.leg_length": 0.6,
        "loop.duration": 0.3,
    }
    plain, of_member = list[str](), list[str]()
    gs.run("heave_tolerances", settings, warn=plain.append)
    record = gs.run("heave_tolerances", settings, member=3, plant=plant, warn=of_member.append)
    assert [text.split(" ")[0] for text in plain] == ["the", "sensors.quantisation.leg_length"]
    assert of_member == plain == record.metadata["warnings"]


def test_a_motion_after_the_end_is_hinted_at_and_refused_in_tune() -> None:
    """A search would find a best bandwidth for a platform that stays at rest."""
    late = {"loop.duration": 0.02, "reference.at": "0.02 s"}
    lines: list[str] = []
    gs.run("heave_step", late, warn=lines.append)
    assert lines == ["reference.at is 0.02 s in a run of 0.02 s, so nothing moves; set it earlier, or run longer"]
    with pytest.raises(gs.GoughStewartError, match=r"reference\.at is 0\.02 s .* nothing moves"):
        gs.tune("heave_step", ["controller.bandwidth=1..6Hz"], "tracking.position.norm_rms", settings=late)


def test_margins_do_not_depend_on_how_fast_the_reference_is() -> None:
    """The loop is linearised at the reference's first pose, which is the same."""
    fast = {"reference.frequency": "20 Hz"}
    with pytest.raises(gs.GoughStewartError):
        gs.run("pitch_sine", fast)
    assert gs.margins("pitch_sine", fast).as_dict() == gs.margins("pitch_sine").as_dict()


def test_a_frozen_signal_that_nobody_reads_is_hinted_at() -> None:
    """A leg-space PD reads lengths, an open loop nothing; a signal that is read has no hint."""
    faults = [{"at": 0.01, "freeze": {"leg_length": [1], "position": [2]}}, {"at": 0, "freeze": {"leg_velocity": [1]}}]
    lines: list[str] = []
    gs.run("heave_step", {"loop.duration": 0.02, "reference.at": 0.01, "fault": faults}, warn=lines.append)
    assert [line.split(":")[0] for line in lines] == ["fault.1.freeze.position", "fault.2.freeze.leg_velocity"]
    assert lines[0].endswith("so this changes nothing; the controller reads leg_length")
    lines.clear()
    gs.run("paper_open_loop", {"loop.duration": 0.02, "fault": faults[:1]}, warn=lines.append)
    assert [line.rpartition("; ")[2] for line in lines] == ["the controller reads no sensor"] * 2
