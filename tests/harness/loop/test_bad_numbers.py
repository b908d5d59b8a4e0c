"""Members whose numbers get out of hand end alone, with the words of NumPy's loop."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.loop.folding import FoldsOfRows
from gough_stewart.harness.loop.run import observe
from gough_stewart.harness.plants.lanes import LanesPlant, Stepping
from gough_stewart.harness.plants.open import ModelPlant
from gough_stewart.harness.results.metric_folds import folds_of_loop, metric_kernels
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray
from tests.harness.loop.test_compiled_loop import VARIED, batch_of

LOOPS: dict[str, Any] = {"compiled": LanesPlant.loop_run, "NumPy": property(lambda _: None)}


def run(noise: np.ndarray[Any, Any] | None, push: float, monkeypatch: pytest.MonkeyPatch, loop_run: Any) -> Any:
    """Outcomes and metrics of nine members, with noise of the leg lengths [m] and a force on the fifth [N]."""
    monkeypatch.setattr(LanesPlant, "loop_run", loop_run)
    running = batch_of("pd", {}, VARIED, 9).in_parallel(Stepping(tolerance=1e-9))
    loop = running.loop
    if noise is not None:
        loop = replace(loop, sensors=replace(loop.sensors, noise={"leg_length": np.resize(noise, running.size)}))
    force = np.zeros((running.size, 6))
    force[4, 0] = push
    loop = replace(loop, start_force=loop.start_force + force)
    rows = FoldsOfRows(loop, folds_of_loop(loop, {}), running.size, metric_kernels())
    with running.plant:
        return observe(running.plant, running.law_from, loop, rows)[:9], rows.results()


def test_a_noise_that_makes_forces_infinite_ends_its_members_at_their_first_sample(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Expected: of 1e306 m, whose forces no number holds, one row; without noise the whole run."""
    noise = np.where(np.arange(9) % 3 == 1, 1e306, 0.0)
    found = [run(noise, 0.0, monkeypatch, each) for each in LOOPS.values()]
    for outcomes, metrics in found:
        for k, outcome in enumerate(outcomes):
            assert outcome.status == ("diverged" if k % 3 == 1 else "completed"), k
            assert metrics["rows"][k] == (1 if k % 3 == 1 else 121)
        assert "the controller's forces are [" in str(outcomes[1].cause)
    assert [each.cause for each in found[0][0]] == [each.cause for each in found[1][0]]


class Broken(ModelPlant):
    """The machine of `heave_step`, of which one result is wrong from some time [s] on."""

    def __init__(self, name: str, value: float, since: float = 0.0995, **parameters: float) -> None:
        machine = gs.load_preset("motion_base").with_parameters(parameters)
        still = np.zeros(3)
        super().__init__(machine, State(machine.home_position, machine.home_orientation, still, still))
        self._at, self._value, self._since, self._now = self.columns.index(name), value, since, 0.0

    def do_step(self, time: float, step: float) -> None:
        super().do_step(time, step)
        self._now = time + step

    def results(self) -> FloatArray:
        found = np.array(super().results())
        found[self._at] = self._value if self._now >= self._since else found[self._at]
        return found


ELASTIC = {"leg_stiffness": 1e7, "leg_armature": 100.0}


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, -1e300])
@pytest.mark.parametrize(
    ("name", "unit", "parameters"),
    [
        ("position[2]", "m", {}),
        ("leg_length[3]", "m", {}),
        ("angular_velocity[1]", "rad/s", {}),  # which nobody reads
        ("motor_position[6]", "m", ELASTIC),
        ("motor_velocity[1]", "m/s", ELASTIC),
    ],
)
def test_what_a_plant_breaks_is_said_of_the_plant(
    name: str, unit: str, parameters: dict[str, float], value: float
) -> None:
    """Expected: its result by name, value and unit, at the row that has it; not what the controller makes of it."""
    settings = {"loop.duration": 0.2, "plant.parameters": parameters, "sensors.side": "motor"}
    record = gs.run("heave_step", settings, plant=Broken(name, value, **parameters))
    outcome = record.metadata["outcome"]
    assert (outcome["status"], outcome["cause"]) == ("diverged", f"the plant gave {name} = {value:g} {unit}")
    assert outcome["time"] == pytest.approx(0.1)
    assert record.table.height == 101


@pytest.mark.parametrize("since", [0.0, 0.0995])
def test_a_controller_is_not_asked_about_a_broken_plant(since: float) -> None:
    """Expected: its samples before that row only; what it would make of the plant's number is not the cause."""
    told: list[float] = []

    def law(sample: gs.Sample) -> FloatArray:
        told.append(sample.time)
        return np.full(6, sample.measured["leg_length"][2])

    plant = Broken("leg_length[3]", np.nan, since=since)
    record = gs.run("heave_step", {"loop.duration": 0.2}, plant=plant, controller=law)
    assert record.metadata["outcome"]["cause"] == "the plant gave leg_length[3] = nan m"
    assert told == pytest.approx(np.arange(0, since, 1e-3))


def test_forces_that_are_no_numbers_are_said_of_who_made_them() -> None:
    """Expected: the injection if it is too large, and the controller if its own forces are none."""
    forces = [0.0, 1e300, 0.0, 0.0, 0.0, 0.0]
    for given, cause in (
        ({"injection": lambda _time: forces}, f"the injection's forces are {forces} N"),
        ({"controller": lambda _sample: np.full(6, np.nan)}, f"the controller's forces are {[np.nan] * 6} N"),
    ):
        outcome = gs.run("heave_step", {"loop.duration": 0.1}, **given).metadata["outcome"]
        assert (outcome["status"], outcome["time"], outcome["cause"]) == ("diverged", 0.0, cause)


def test_a_member_that_diverges_in_the_first_step_ends_there_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the row at the start counts, with the force; the others complete their run with numbers."""
    for each in LOOPS.values():
        outcomes, metrics = run(None, 1e14, monkeypatch, each)
        assert [outcome.status for outcome in outcomes] == ["diverged" if k == 4 else "completed" for k in range(9)]
        assert outcomes[4].time == 0.0
        assert metrics["rows"][:9].tolist() == [1.0 if k == 4 else 121.0 for k in range(9)]
        assert metrics["force.peak"][0, 4] == pytest.approx(1e14, rel=1e-6)
        assert np.isfinite(metrics["tracking.position.norm_rms"][:9]).all()


@pytest.mark.parametrize("key", ["ensemble.tolerance", "plant.tolerance"])
@pytest.mark.parametrize("value", [0, -1e-9, float("nan"), float("inf")])
def test_a_tolerance_that_no_step_can_hold_is_refused(key: str, value: float) -> None:
    """Expected: the key and the value, before anything runs."""
    with pytest.raises(ExperimentError, match=f"{key}: is {value:g}".replace("e-09", "e-0?9")):
        gs.ensemble("heave_tolerances", {key: value}, members=2, workers=1)
