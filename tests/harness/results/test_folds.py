"""Metrics of many members, folded during their runs: those of each member's own record, to the bit."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars
import pytest

import gough_stewart as gs
from gough_stewart.harness.loop.folding import FoldKernels, FoldsOfRows
from gough_stewart.harness.loop.loop import Limits, Loop
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.results.metric_folds import METRICS, Saturation, folds_of_loop, metric_kernels
from tests.support.metric_definitions import defined_metrics
from tests.support.orientations import rotation_vectors
from tests.support.records import Floats, columns
from tests.support.rows import pass_rows


def one_number(metrics: Mapping[str, Any], path: str) -> float | None:
    """A metric of a record by its path in a table of members: of legs and axes the largest, or the least."""
    part: Any = metrics
    names = path.split(".")
    if names[0] == "step_response":
        part = {step["axis"]: step for step in metrics["step_response"] or ()}
        names = names[1:]
    for name in names:
        part = (part or {}).get(name)
    if not isinstance(part, list):
        return None if part is None else float(part)
    known = [value for value in part if value is not None]
    if path.endswith(("shortest", "first_exceeded")):
        return min(known, default=None)
    return max(known) if len(known) == len(part) else None


LIMITS: dict[str, Any] = {
    "leg_length_min": 0.9,
    "leg_length_max": 2.4,
    "leg_velocity_max": 1.9,
    "actuator_force_max": np.linspace(0.5, 3, 40),
    "actuator_power_max": 4.0,
}
N, MOST = 41, 40
TIMING = Timing((N - 1) * 1e-3, 2e-3, 1e-3)


class Noise:
    """Rows of members that are noise, with references of their own that step; some end, some are not finite."""

    def __init__(self) -> None:
        rng = np.random.default_rng(11)
        self.signals, self.forces = rng.normal(size=(N, MOST, 24)), rng.normal(size=(N, MOST, 12))
        self.signals[..., 12:18] = rng.uniform(0.8, 2.5, (N, MOST, 6))
        self.reference = rng.normal(size=(N, MOST, 30))
        step = np.arange(N)[:, None] < np.arange(MOST) % 9 + 3
        self.reference[..., :6] = np.where(step[..., None], 0.1, [0.6, -0.2, 0.4, 0.2, 0.3, -0.1])
        self.signals[9:, :, 0] = 0.1 + 0.5 * rng.uniform(0.97, 1.02, (N - 9, MOST))
        self.signals[21, 3::7, 14] = np.nan
        self.flags = rng.random((2, N, MOST, 6)) < 0.1
        self.ends = np.where(np.arange(MOST) % 5 == 1, 9 + np.arange(MOST) % 20, N)
        self.ends[11] = 1

    def results(self, folds: Any, number: int, kernels: FoldKernels | None, size: int = 8192) -> dict[str, Floats]:
        """Of the first members, in blocks of so many numbers; `folds` are made for their loop."""
        loop = Loop(TIMING, self.reference[:, :number], np.zeros((20, 6)), np.zeros(6), limits=Limits((0.9, 2.4)))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("gough_stewart.harness.loop.rows._FEWEST", 1)
            patch.setattr("gough_stewart.harness.loop.rows.BLOCK_SIZE", size)
            patch.setattr("gough_stewart.harness.loop.folding._ROWS", 16)
            rows = FoldsOfRows(loop, folds(loop), number, kernels)
            arrays = (self.signals, self.forces, *self.flags)
            pass_rows(rows, TIMING, (tuple(a[k, :number] for a in arrays) for k in range(N)), self.ends[:number])
        return rows.results()

    def record(self, k: int) -> gs.Record:
        """The rows of a member that are finite, as a record."""
        rows = slice(0, min(self.ends[k], 21 if k % 7 == 3 else N))
        signals, wanted = self.signals[rows, k], self.reference[rows, k]
        names = {
            "position": slice(3),
            "orientation": slice(3, 6),
            "leg_length": slice(12, 18),
            "leg_velocity": slice(18, 24),
        }
        parts: dict[str, Any] = {name: signals[:, at] for name, at in names.items()}
        parts |= {f"reference.{name}": wanted[:, at] for name, at in names.items() if name != "leg_velocity"}
        parts |= {f"error.{name}": wanted[:, names[name]] - parts[name] for name in ("position", "leg_length")}
        parts["error.orientation"] = rotation_vectors(parts["orientation"], wanted[:, 3:6])
        parts |= {"actuator_force": self.forces[rows, k, :6]}
        parts |= {f"flag.{name}": self.flags[j, rows, k] for j, name in enumerate(("force_limited", "rate_limited"))}
        parts["flag.stroke_exceeded"] = (parts["leg_length"] < 0.9) | (parts["leg_length"] > 2.4)
        table = {name: v for part, values in parts.items() for name, v in columns(part, values).items()}
        platform = {**LIMITS, "actuator_force_max": LIMITS["actuator_force_max"][k]}
        outcome = {"status": "stopped", "time": 0.0, "cause": None}
        time = TIMING.times[rows]
        return gs.Record(polars.DataFrame({"time": time, **table}), {"outcome": outcome, "platform": platform})


NOISE = Noise()


def metrics_of_members(number: int) -> Any:
    limits = {**LIMITS, "actuator_force_max": LIMITS["actuator_force_max"][:number]}
    return lambda loop: folds_of_loop(loop, limits)


def test_members_bits_are_the_same_among_any_number_in_any_blocks_by_numpy_and_by_machine_code() -> None:
    """Expected: results by leg and axis, to the bit; and by loops over the rows of each member, to rounding."""
    whole = NOISE.results(metrics_of_members(MOST), MOST, metric_kernels())
    assert set(whole) == {metric.path for metric in METRICS if not metric.path.startswith("margins.")}
    for number, size, kernels in ((1, 8192, None), (3, 20, None), (11, 30, metric_kernels()), (8, 1, metric_kernels())):
        found = NOISE.results(metrics_of_members(number), number, kernels, size)
        for name, values in found.items():
            np.testing.assert_array_equal(values, whole[name][..., :number], err_msg=name)
    for k in (0, 1, 3, 11, 16, 17, 39):
        record = NOISE.record(k)
        is_whole = record.table.height == len(TIMING.times)
        expected = defined_metrics(record.table, record.metadata["platform"], is_whole)
        for name, values in whole.items():
            defined = one_number(expected, name)
            legs = values[..., k]
            own = np.fmin.reduce(legs, None) if name.endswith(("shortest", "first_exceeded")) else np.max(legs)
            assert own == pytest.approx(np.nan if defined is None else defined, rel=1e-11, nan_ok=True), (name, k)


def test_a_metric_that_is_wanted_alone_is_the_same_as_among_all() -> None:
    """Expected: its bits among all metrics, with fewer of them beside it."""
    whole = NOISE.results(metrics_of_members(MOST), MOST, metric_kernels())
    for wanted in ("force.rms", "step_response.x.rise_time", "limits.actuator_power_max.used", "rows"):
        found = NOISE.results(lambda loop, wanted=wanted: folds_of_loop(loop, LIMITS, [wanted]), MOST, metric_kernels())
        np.testing.assert_array_equal(found[wanted], whole[wanted])
        assert len(found) < 20


@pytest.mark.parametrize(
    ("levels", "has"),
    [
        ({0: 0.1, 6: 0.6}, True),
        # there and back again before the step of the whole run; on the way; not yet
        ({0: 0.1, 6: 0.6, 20: 0.1, 30: 0.6}, False),
        ({0: 0.1, 6: 0.3, 7: 0.6, 20: 0.9}, False),
        ({0: 0.1, 25: 0.6}, False),
    ],
)
def test_a_member_that_ended_early_has_the_step_of_the_whole_run_or_none(levels: dict[int, float], has: bool) -> None:
    """Expected: of 41 rows and of the first 18 of them; numbers of a response only where both step alike."""
    noise = Noise()
    for row, value in levels.items():
        noise.reference[row:, :, 0] = value
    noise.ends[:2] = (N, 18)
    found = noise.results(metrics_of_members(2), 2, metric_kernels())
    for name in ("from", "to", "at", "overshoot_percent", "final_error"):
        assert np.isfinite(found[f"step_response.x.{name}"]).tolist() == [True, has]


def test_a_fold_of_other_sizes_or_another_name_has_no_machine_code() -> None:
    """Expected: none for five flags, or for a name that nobody has compiled; NumPy folds those."""
    kernels, fold = metric_kernels(), Saturation("force_limited")
    assert kernels.kernel(fold) is not None
    fold.sizes = {"flag": 5}
    assert kernels.kernel(fold) is None
    fold.sizes, fold.kernel = {"flag": 6}, "another"
    assert kernels.kernel(fold) is None
