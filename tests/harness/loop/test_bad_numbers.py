"""Members whose numbers get out of hand end alone, with the words of NumPy's loop."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.errors import ExperimentError, PlantError
from gough_stewart.harness.loop.folding import FoldsOfRows
from gough_stewart.harness.loop.observe import observe
from gough_stewart.harness.plants.lanes import LanesPlant, Stepping
from gough_stewart.harness.results.fold_library import metric_kernels
from gough_stewart.harness.results.metric_folds import folds_of_loop
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


def test_a_plant_refuses_it_likewise() -> None:
    """Expected: the bounds."""
    batch = batch_of("pd", {}, VARIED, 2)
    with pytest.raises(PlantError, match="tolerance is 0; expected 1e-13 to"):
        batch.in_parallel(Stepping(tolerance=0))
