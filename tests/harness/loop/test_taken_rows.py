"""Folds and kept rows within the machine code of the loop, against NumPy's folds of rows that the same loop writes."""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.ensemble.chunk import LegErrors, limits_of_members
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.preparation import Batch
from gough_stewart.harness.loop import compiled_host
from gough_stewart.harness.loop.folding import FoldsOfRows
from gough_stewart.harness.loop.rows import RowBlock
from gough_stewart.harness.loop.run import Run, observe
from gough_stewart.harness.results.bands import Bands, BandSamples
from gough_stewart.harness.results.metric_folds import folds_of_loop, metric_kernels
from tests.harness.loop.test_compiled_loop import ALL, CASES, MANY, STEPPING, STICKY, TWIST, VARIED, batch_of, run_of
from tests.support.rows import pass_rows

SHOWN = (
    "error.position.norm",
    "error.orientation",
    "orientation",
    "actuator_force",
    "error.leg_length",
    "position",
    "velocity",
)


class Folded:
    """Metrics, bands and leg errors of a batch."""

    def __init__(self, batch: Batch) -> None:
        self.running = batch.in_parallel(STEPPING)
        loop, size = self.running.loop, self.running.size
        self.bands, self.errors = Bands(SHOWN, loop.timing, len(batch), times=40), LegErrors(loop.timing)
        self.folds = [*folds_of_loop(loop, limits_of_members(batch, size)), self.bands, self.errors]
        self.members = len(batch)

    def in_the_loop(self, threads: int = 1) -> "Folded":
        """By machine code, while the loop runs."""
        rows = Blocks(self.running.loop, self.folds, self.running.size, metric_kernels())
        with self.running.plant:
            observe(self.running.plant, self.running.law_from, self.running.loop, rows, threads=threads)
        self.blocks, self.metrics = rows.blocks, rows.results()
        return self

    def of(self, run: Run) -> "Folded":
        """By NumPy, of rows that have been written."""
        loop, size = self.running.loop, self.running.size
        rows = FoldsOfRows(loop, self.folds, size)
        ends = [len(run.of_member(k).time) for k in range(size)]
        limited = np.stack([run.force_limited[_of(run.sample_of_row, k), k] for k in range(size)], axis=1)
        pass_rows(
            rows, loop.timing, zip(run.results[:, :, :24], run.inputs, limited, run.rate_limited, strict=True), ends
        )
        self.metrics = rows.results()
        return self


class Blocks(FoldsOfRows):
    """Counts the blocks of rows that it gets."""

    blocks = 0

    def block(self, _rows: RowBlock) -> None:
        self.blocks += 1


def _of(samples: Any, k: int) -> Any:
    return samples if samples.ndim == 1 else samples[:, k]


def assert_equal(ours: Folded, theirs: Folded) -> None:
    """To the bit, of the members without copies."""
    n = ours.members
    assert list(ours.metrics) == list(theirs.metrics)
    for name, values in ours.metrics.items():
        np.testing.assert_array_equal(values[..., :n], theirs.metrics[name][..., :n], err_msg=name)
    samples = ours.bands.samples(), theirs.bands.samples()
    for field in BandSamples._fields:
        one, other = (getattr(each, field) for each in samples)
        np.testing.assert_array_equal(one, other, err_msg=field)


@pytest.mark.parametrize(("case", "members"), [("PD", 1), ("PD, all", 11), ("task space, all", 8)])
def test_metrics_bands_and_errors_are_those_of_the_rows(case: str, members: int) -> None:
    """Expected: NumPy's folds of the rows of the same loop, to the bit; and no block of rows reaches Python."""
    batch = batch_of(*CASES[case], members)
    ours, theirs = Folded(batch).in_the_loop(), Folded(batch).of(run_of(batch))
    assert ours.blocks == 0
    assert_equal(ours, theirs)
    assert np.array_equal(ours.errors.errors[..., :members], theirs.errors.errors[..., :members])
    assert np.abs(ours.errors.errors).max() > 1e-4
    assert ours.metrics["rows"].tolist()[:members] == [121.0] * members


@pytest.mark.parametrize(
    ("change", "varied"),
    [
        ({"limits.position_error": "40 mm"}, {}),
        ({"disturbance": [TWIST], "limits.position_error": "1e6 m"}, {}),
        ({}, STICKY),
    ],
)
def test_members_that_end_count_up_to_their_last_row(change: dict[str, Any], varied: dict[str, Any]) -> None:
    """Expected: NumPy's folds of the rows up to each end, for limits, singular poses and too many internal steps."""
    settings = {"loop.duration": 0.4, "loop.sample_time": 2e-3, "reference.at": 0.05, **change}
    experiment = gs.load_experiment(
        "heave_step", {**settings, "ensemble": {**VARIED, **varied, "members": 19, "seed": 2}}
    )
    batch = Members(experiment).prepared(0, 19).batch
    run = run_of(batch)
    ours, theirs = Folded(batch).in_the_loop(), Folded(batch).of(run)
    assert_equal(ours, theirs)
    ends = [len(run.of_member(k).time) for k in range(19)]
    assert min(ends) < 200
    assert ours.metrics["rows"].tolist()[:19] == [float(end) for end in ends]
    running = ours.bands.samples().running
    assert running.tolist() == [sum(end > row for end in ends) for row in ours.bands.at]


def test_parts_of_the_work_and_threads_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the same bits in calls of a few internal steps, by threads, and with changes within a chunk of rows."""
    batch = batch_of("pd", ALL, MANY, 41)
    whole = Folded(batch).in_the_loop()
    for work, threads in ((3, 1), (41, 3)):
        monkeypatch.setattr(compiled_host, "_WORK", work)
        part = Folded(batch).in_the_loop(threads)
        assert part.blocks == 0
        assert_equal(part, whole)
        assert np.array_equal(part.errors.errors, whole.errors.errors)
