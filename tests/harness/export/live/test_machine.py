"""The machine of a live page: against the run, beyond its end, by hand, and what cannot be in a page."""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart import leg_geometry
from gough_stewart.harness.export.live.page import live_machine, reach_of
from tests.harness.export.test_controllers import often
from tests.harness.export.test_machine import Machine, rows_of
from tests.support.random_platforms import random_platform

# Durations [s] of all that are shipped but those whose encoders round, or whose loop diverges.
FOLLOWED = {
    **dict.fromkeys(("circle", "circle_computed_torque", "excitation", "fastest_path", "hold_against_gravity"), 0.4),
    **dict.fromkeys(("paper_open_loop", "pitch_sine", "recorded_ride", "saturation"), 0.4),
    **{"impulse": 0.6, "payload_change": 2.1},
}


# The plan of the fastest path takes its time.
@pytest.mark.parametrize("name", often(FOLLOWED, {*FOLLOWED} - {"fastest_path"}))
def test_a_page_has_the_rows_of_the_run(name: str) -> None:
    """Expected: `run` to 1e-9 of SI units, for all signals of all rows."""
    experiment = gs.load_experiment(name, {"loop.duration": FOLLOWED[name], "sensors.quantisation": {}})
    theirs = rows_of(gs.run(experiment))
    ours = Machine(live_machine(experiment).block).run(len(theirs))["row_signals"]
    assert np.abs(ours - theirs).max() <= 1e-9


def test_it_goes_on_after_the_experiments_end() -> None:
    """Expected: the rows of an experiment that lasts three times as long."""
    ours = Machine(live_machine(gs.load_experiment("pitch_sine", {"loop.duration": 0.2})).block)
    theirs = rows_of(gs.run("pitch_sine", {"loop.duration": 0.6}))
    found = ours.run(len(theirs))["row_signals"]
    assert np.abs(found - theirs).max() <= 1e-9
    assert ours("ended") == -1


def test_jitter_and_injection_end_with_the_run() -> None:
    """Expected: of constant references after the run, forces that no longer change."""
    settings: dict[str, Any] = {
        **{"loop.duration": 3, "loop.jitter": "0.25 ms", "loop.plant_step": "0.25 ms"},
        **{"sensors.noise": {}, "sensors.quantisation": {}},
    }
    ours = Machine(live_machine(gs.load_experiment("frequency_response", settings)).block)
    theirs = gs.run("frequency_response", settings)
    rows = ours.run(16001)
    assert np.abs(rows["row_signals"][:12000] - rows_of(theirs)[:12000]).max() <= 1e-9
    forces = rows["row_forces"]
    assert np.ptp(forces[:12000], axis=0).max() > 100 * np.ptp(forces[15500:], axis=0).max()


def test_a_hand_may_ask_for_what_the_legs_can_reach() -> None:
    """Expected: along each axis to both sides, legs within the stroke of an uneven platform."""
    platform = random_platform(np.random.default_rng(5))
    home = np.concatenate([platform.home_position, platform.home_orientation])
    lengths = leg_geometry(platform, home[:3], home[3:]).length
    reach = reach_of(platform)
    assert (reach > 0).all()
    low = platform.leg_length_min or 0.9 * lengths.min()
    high = platform.leg_length_max or 1.1 * lengths.max()
    for axis in range(6):
        for sign in (1, -1):
            pose = home + sign * reach[axis] * np.eye(6)[axis]
            found = leg_geometry(platform, pose[:3], pose[3:]).length
            assert (found > low).all()
            assert (found < high).all()


def test_behind_an_open_loop_is_its_run_by_other_code() -> None:
    """Expected: `run` to 1e-7 of SI units, the digits that are carried; the paper's own case is known as such."""
    record = gs.run("paper_open_loop")
    behind = live_machine(gs.load_experiment("paper_open_loop")).data["behind"]
    assert behind["isPublished"]
    pose = np.concatenate([record["position"], record["orientation"]], axis=1)
    assert np.abs(np.subtract(behind["pose"], pose)).max() < 1e-7
    assert np.abs(np.subtract(behind["length"], record["leg_length"])).max() < 1e-7
    assert behind["time"] == pytest.approx(record["time"], abs=1e-12)


@pytest.mark.parametrize(
    ("settings", "published"),
    [
        ({"controller.force": [55, 49.5, 55, 49.5, 55, 50]}, False),
        ({"start.velocity": [0, 0.1, 0]}, False),
        ({"plant.parameters": {"platform_mass": 11}}, False),
        ({"disturbance": [{"at": 0.1, "duration": 0.2, "force": [1, 0, 0]}]}, None),
    ],
)
def test_another_case_is_not_called_the_papers(settings: dict[str, Any], published: bool | None) -> None:
    """Expected: other forces, start or machine are told apart; what changes on the way has nothing behind it."""
    behind = live_machine(gs.load_experiment("paper_open_loop", settings)).data["behind"]
    assert behind is None if published is None else behind["isPublished"] is published
