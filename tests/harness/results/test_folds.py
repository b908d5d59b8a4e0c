"""Metrics of many members, folded during their runs, against loops over the rows of each member's record."""

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import polars
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.run import run_prepared
from gough_stewart.harness.loop.fold_kernels import FoldKernels
from gough_stewart.harness.loop.folding import FoldsOfRows
from gough_stewart.harness.loop.loop import Limits, Loop
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants import signals
from gough_stewart.harness.results.fold_library import metric_kernels
from gough_stewart.harness.results.metric_folds import METRICS, columns_of, folds_of_loop
from gough_stewart.harness.results.metrics import flattened, metrics
from gough_stewart.harness.results.record import Record, columns
from gough_stewart.model.rotations import rotation_between
from gough_stewart.model.vectors import FloatArray
from tests.support.metric_definitions import as_one_number, defined_metrics
from tests.support.rows import pass_rows

LIMITS: dict[str, Any] = {
    "leg_length_min": 0.9,
    "leg_length_max": 2.4,
    "leg_velocity_max": 1.9,
    "actuator_force_max": 2.3,
    "actuator_power_max": 4.0,
}
RUNS: tuple[dict[str, Any], ...] = (
    {},
    {"reference.position_change": [0.004, -0.003, 0.011], "plant.parameters.platform_mass": 230.0},
    # saturated in force and rate, and late
    {"actuators.force_limit": 11000, "actuators.rate_limit": 9000, "loop.delay": 4},
    # reaches nothing: the reference steps, the platform hardly follows
    {"controller.bandwidth": 0.15, "controller.feedforward": "none"},
    # unstable, until it is too far away
    {"controller.bandwidth": 16, "loop.delay": 20, "limits.position_error": "30 mm"},
)


@dataclass(frozen=True)
class Member:
    """A run to be seen again: its numbers over time, and its record."""

    signals: FloatArray
    forces: FloatArray
    wanted: FloatArray | None
    force_limited: FloatArray
    rate_limited: FloatArray
    record: Record


def seen_again(
    loop: Loop, limits: dict[str, Any], members: list[Member], names: list[str] | None = None
) -> dict[str, FloatArray]:
    """The metrics of members side by side; those that have ended stay as they are, as a loop has it.

    NumPy and machine code give the same bits.
    """
    by_numpy, compiled = (_seen_again(loop, limits, members, names, kernels) for kernels in (None, metric_kernels()))
    assert list(by_numpy) == list(compiled)
    for name, values in by_numpy.items():
        np.testing.assert_array_equal(values, compiled[name], err_msg=name)
    return compiled


def _seen_again(
    loop: Loop, limits: dict[str, Any], members: list[Member], names: list[str] | None, kernels: FoldKernels | None
) -> dict[str, FloatArray]:
    rows = FoldsOfRows(loop, folds_of_loop(loop, limits, names), len(members), kernels)
    ends = [len(member.signals) for member in members]

    def together(values: list[FloatArray]) -> Any:
        return np.stack(values, axis=1).T

    def row(k: int) -> tuple[Any, ...]:
        at = [(member, min(k, end - 1)) for member, end in zip(members, ends, strict=True)]
        return (
            together([member.signals[i] for member, i in at]),
            together([np.append(member.forces[i], np.zeros(6)) for member, i in at]),
            together([member.force_limited[i] for member, i in at]),
            together([member.rate_limited[i] for member, i in at]),
        )

    pass_rows(rows, loop.timing, map(row, range(max(ends))), ends)
    return columns_of(rows.results())


def check(found: dict[str, FloatArray], members: list[Member]) -> None:
    """By loops over the rows of each record, written from the documentation; and to the bit what its record says."""
    known = set[str]()
    for k, member in enumerate(members):
        table, platform = member.record.table, member.record.metadata["platform"]
        used = [name for name in table.columns if table[name].dtype == polars.Float64]
        finite = np.isfinite(table.select(used).to_numpy()).all(axis=1)
        expected = as_one_number(defined_metrics(table.head(int(np.append(finite, False).argmin())), platform))
        numbers = {name: None if np.isnan(values[k]) else values[k] for name, values in found.items()}
        assert {name for name, number in numbers.items() if number is not None} <= set(expected)
        for name, value in expected.items():
            close = None if value is None else pytest.approx(value, rel=1e-12, abs=1e-12)
            assert numbers.get(name) == close, f"{name} of member {k}"
        same = flattened(metrics(member.record))
        assert {name: numbers.get(name) for name in same} == same
        known |= set(expected)
    assert set(found) == known


@pytest.fixture(scope="module")
def runs() -> tuple[list[Member], list[Loop], dict[str, Any]]:
    """Runs of a shipped experiment that end as differently as runs can."""
    members, loops, platform = [], [], {}
    for options in RUNS:
        experiment = load_experiment("heave_step", {"loop.duration": 0.6, "loop.plant_step": "1 ms", **options})
        prepared = prepare(experiment)
        record = run_prepared(experiment, prepared)
        platform = record.metadata["platform"]
        everything = np.concatenate([record[name] for name in signals.NAMES], axis=1)
        limited, held_back = (record[f"flag.{name}"] for name in ("force_limited", "rate_limited"))
        force = record["actuator_force"]
        members.append(Member(everything, force, prepared.loop.reference, limited, held_back, record))
        loops.append(prepared.loop)
    return members, loops, platform


def test_members_that_end_differently_have_the_figures_of_their_records(
    runs: tuple[list[Member], list[Loop], dict[str, Any]],
) -> None:
    """Expected: `metrics` of each record. One diverges, one saturates, one never rises."""
    members, loops, platform = runs
    status = [member.record.metadata["outcome"]["status"] for member in members]
    assert status == ["completed"] * 4 + ["diverged"]
    wanted = np.stack([loop.reference for loop in loops if loop.reference is not None], axis=1)
    found = seen_again(replace(loops[0], reference=wanted), platform, members)
    assert found["saturation.rate_limited.any"][2] > 0
    assert found["saturation.force_limited.any"][2] > 0
    assert np.isnan(found["step_response.z.rise_time"][3])
    assert np.isfinite(found["step_response.z.rise_time"][0])
    check(found, members)


def test_a_single_run_has_the_figures_of_its_record(runs: tuple[list[Member], list[Loop], dict[str, Any]]) -> None:
    """Expected: loops over its rows; the loop's reference has no member axis."""
    members, loops, platform = runs
    check(seen_again(loops[2], platform, members[2:3]), members[2:3])


def noise(
    n: int,
    rows: int,
    rng: np.random.Generator,
    broken: int | None = None,
    at: int = 6,
    limits: dict[str, Any] | None = None,
) -> Member:
    """A member of random numbers whose reference steps on three axes, of so many of n rows; one of them not finite."""
    limits = LIMITS if limits is None else limits
    low, high = limits.get("leg_length_min", 0.0), limits.get("leg_length_max", np.inf)
    everything = rng.normal(size=(n, 24))
    everything[:, 12:18] = rng.uniform(0.8, 2.5, (n, 6))
    wanted = rng.normal(size=(n, 30))
    wanted[:, :6] = 0.1
    wanted[at:, :6] += [0.5, -0.3, 0, 0, 0.2, 0]
    everything[9:, 0] = 0.1 + 0.5 * rng.uniform(0.97, 1.02, n - 9)
    if broken is not None:
        everything[broken, 14] = np.nan
    forces = rng.normal(size=(n, 6)) * np.arange(1, 7) / 3
    flags = rng.random((2, n, 6)) < np.arange(1, 7) / 30
    parts = {
        "position": everything[:, :3],
        "orientation": everything[:, 3:6],
        "leg_length": everything[:, 12:18],
        "leg_velocity": everything[:, 18:],
        "actuator_force": forces,
        "reference.position": wanted[:, :3],
        "reference.orientation": wanted[:, 3:6],
        "reference.leg_length": wanted[:, 12:18],
        "error.position": wanted[:, :3] - everything[:, :3],
        "error.orientation": rotation_between(everything[:, 3:6], wanted[:, 3:6]),
        "error.leg_length": wanted[:, 12:18] - everything[:, 12:18],
        "flag.force_limited": flags[0],
        "flag.rate_limited": flags[1],
        "flag.stroke_exceeded": (everything[:, 12:18] < low) | (everything[:, 12:18] > high),
    }
    table = {"time": 1e-3 * np.arange(rows)}
    for name, values in parts.items():
        table |= dict(zip(columns(name, values.shape[1]), values[:rows].T.copy(), strict=True))
    outcome = {"status": "completed", "time": 1e-3 * (rows - 1), "cause": None}
    record = Record(polars.DataFrame(table), {"outcome": outcome, "platform": dict(limits)})
    return Member(everything[:rows], forces[:rows], wanted, flags[0][:rows], flags[1][:rows], record)


def test_numbers_that_are_noise_have_the_figures_of_their_records_limits_and_rows_that_break_off_included() -> None:
    """Expected: `metrics`: whole, ended early, a single row, not finite from a row on, and one that never was."""
    rng = np.random.default_rng(5)
    n = 41
    members = [noise(n, n, rng), noise(n, 29, rng), noise(n, 1, rng), noise(n, n, rng, broken=17), noise(n, 33, rng)]
    loop = Loop(
        Timing((n - 1) * 1e-3, 2e-3, 1e-3),
        members[0].wanted,
        np.zeros((20, 6)),
        np.zeros(6),
        limits=Limits((0.9, 2.4)),
    )
    wanted = np.stack([member.wanted for member in members if member.wanted is not None], axis=1)
    check(seen_again(replace(loop, reference=wanted), LIMITS, members), members)
    of_each = {**LIMITS, "actuator_force_max": np.array([2.3, 2.0, 1.0, 3.0, 0.5])}
    found = seen_again(replace(loop, reference=wanted), of_each, members)
    for name in ("first_exceeded", "used"):
        assert np.isfinite(found[f"limits.actuator_power_max.{name}"]).sum() >= 4
    assert np.isfinite(found["step_response.x.settling_time"]).sum() >= 2
    for k, member in enumerate(members):
        member.record.metadata["platform"] = {**LIMITS, "actuator_force_max": of_each["actuator_force_max"][k]}
    check(found, members)


def test_references_of_members_that_step_at_other_rows_have_the_figures_of_their_records() -> None:
    """Expected: `metrics`; before its own step, a member's response is none, however far it is from there."""
    rng = np.random.default_rng(6)
    n = 41
    members = [noise(n, n, rng, at=at) for at in (6, 11, 4, 17)] + [noise(n, 25, rng, at=13)]
    wanted = np.stack([member.wanted for member in members if member.wanted is not None], axis=1)
    loop = Loop(Timing((n - 1) * 1e-3, 2e-3, 1e-3), wanted, np.zeros((20, 6)), np.zeros(6), limits=Limits((0.9, 2.4)))
    found = seen_again(loop, LIMITS, members)
    check(found, members)
    assert found["step_response.y.at"] == pytest.approx([0.006, 0.011, 0.004, 0.017, 0.013])


@pytest.mark.parametrize(
    ("levels", "has"),
    [
        ({0: 0.1, 6: 0.6}, True),
        # there and back again before the step of the whole run: another row
        ({0: 0.1, 6: 0.6, 20: 0.1, 30: 0.6}, False),
        # on the way: another value at the end, from the same row on
        ({0: 0.1, 6: 0.3, 7: 0.6, 20: 0.9}, False),
        # not yet
        ({0: 0.1, 25: 0.6}, False),
    ],
)
def test_a_member_that_ended_early_has_the_step_of_the_whole_run_or_none(levels: dict[int, float], has: bool) -> None:
    """Expected: of 41 rows and of the first 18 of them; numbers of a response only where both step alike."""
    rng = np.random.default_rng(7)
    n = 41
    whole, early = noise(n, n, rng), noise(n, 18, rng)
    for member in (whole, early):
        assert member.wanted is not None
        for row, value in levels.items():
            member.wanted[row:, 0] = value
    assert whole.wanted is not None
    loop = Loop(Timing((n - 1) * 1e-3, 2e-3, 1e-3), whole.wanted, np.zeros((20, 6)), np.zeros(6))
    found = seen_again(loop, {}, [whole, early])
    for name in ("from", "to", "at", "overshoot_percent", "final_error"):
        assert np.isfinite(found[f"step_response.x.{name}"]).tolist() == [True, has]
    final = 0.6 - early.signals[17, 0]
    assert not has or found["step_response.x.final_error"][1] == pytest.approx(final)


def test_without_a_reference_there_is_neither_tracking_nor_a_step() -> None:
    """Expected: all else as with one, and as `metrics` of a record without these columns."""
    with_one = noise(30, 30, np.random.default_rng(8))
    kept = [name for name in with_one.record.table.columns if not name.startswith(("error.", "reference."))]
    record = Record(with_one.record.table.select(kept), with_one.record.metadata)
    member = replace(with_one, wanted=None, record=record)
    loop = Loop(Timing(0.029, 1e-3, 1e-3), with_one.wanted, np.zeros((29, 6)), np.zeros(6), limits=Limits((0.9, 2.4)))
    expected = {
        name: values
        for name, values in seen_again(loop, LIMITS, [with_one]).items()
        if not name.startswith(("tracking.", "step_response."))
    }
    found = seen_again(replace(loop, reference=None), LIMITS, [member])
    assert found == expected
    assert flattened(metrics(record)) == {name: value[0] for name, value in expected.items()}


def test_of_a_single_row_the_force_and_flags_count() -> None:
    """Expected: |F|, and the legs whose flags are set, by hand; of two rows, those of the first."""
    one, two = noise(12, 1, np.random.default_rng(3)), noise(12, 2, np.random.default_rng(4))
    flags = np.array([[0, 1, 0, 0, 1, 0], [1, 1, 1, 1, 1, 1]], dtype=bool)
    members = [replace(each, force_limited=flags, rate_limited=~flags) for each in (one, two)]
    loop = Loop(Timing(11e-3, 1e-3, 1e-3), None, np.zeros((11, 6)), np.zeros(6))
    rows = seen_again(loop, {}, members)
    assert rows["force.rms"] == pytest.approx([np.abs(each.forces[0]).max() for each in members])
    assert rows["saturation.force_limited.legs"].tolist() == rows["saturation.rate_limited.any"].tolist() == [1.0, 1.0]
    only = replace(members[0], force_limited=flags[:1] * 0, rate_limited=flags[:1] * 0)
    assert seen_again(loop, {}, [only])["saturation.force_limited.any"].tolist() == [0.0]


LACKING = [(), ("leg_length_min",), ("leg_length_max",), ("leg_length_min", "leg_length_max", "leg_velocity_max")]


@given(st.data())
@settings(max_examples=20)
def test_random_members_in_blocks_of_any_size_have_the_figures_of_their_records(data: st.DataObject) -> None:
    """Expected: loops over rows; to the bit those of each member alone, in one block, and of its record.

    Members end at any row, or before one that is not finite; limits are on both sides, on one, or none.
    """
    n = 41
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    lacking, size = data.draw(st.sampled_from(LACKING)), data.draw(st.integers(1, 5 * n))
    limits = {name: value for name, value in LIMITS.items() if name not in lacking}
    members = [noise(n, n, rng, limits=limits)]
    for _ in range(data.draw(st.integers(0, 4))):
        rows, broken = data.draw(st.sampled_from([n, n, 2, 19])), data.draw(st.one_of(st.none(), st.integers(1, n - 1)))
        members.append(noise(n, rows, rng, broken=broken, limits=limits))
    wanted = np.stack([member.wanted for member in members if member.wanted is not None], axis=1)
    loop = Loop(Timing((n - 1) * 1e-3, 2e-3, 1e-3), wanted, np.zeros((20, 6)), np.zeros(6), limits=Limits((0.9, 2.4)))
    each = [seen_again(replace(loop, reference=member.wanted), limits, [member]) for member in members]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gough_stewart.harness.loop.rows.CHECKED", 1)
        patch.setattr("gough_stewart.harness.loop.rows._SIZE", size)
        found = seen_again(loop, limits, members)
    for name, values in found.items():
        assert values.tolist() == pytest.approx([own[name][0] for own in each], rel=0, abs=0, nan_ok=True), name
    check(found, members)


@pytest.mark.parametrize("wanted", ["force.rms", "step_response.x.rise_time", "limits.actuator_power_max.used", "rows"])
def test_a_metric_that_is_wanted_alone_is_the_same_as_among_all(wanted: str) -> None:
    """Expected: its bits among all metrics, also of a member that ends and one that is not finite."""
    rng = np.random.default_rng(9)
    members = [noise(41, 41, rng), noise(41, 25, rng), noise(41, 41, rng, broken=13)]
    wants = np.stack([member.wanted for member in members if member.wanted is not None], axis=1)
    loop = Loop(Timing(0.04, 2e-3, 1e-3), wants, np.zeros((20, 6)), np.zeros(6), limits=Limits((0.9, 2.4)))
    every, alone = (seen_again(loop, LIMITS, members, names=names) for names in (None, [wanted]))
    assert len(alone) < len(every)
    np.testing.assert_array_equal(alone[wanted], every[wanted])


def test_a_members_bits_are_the_same_among_any_number_by_numpy_and_by_machine_code() -> None:
    """Expected: results by leg and axis of each number of members, to the bit; some end, some are not finite."""
    n, most = 37, 600
    rng = np.random.default_rng(11)
    values, wanted = rng.normal(size=(n, 24, most)), rng.normal(size=(n, most, 30))
    values[:, 12:18] = rng.uniform(0.8, 2.5, (n, 6, most))
    wanted[:, :, :6] = np.where(np.arange(n) < 6, 0.1, 0.7)[:, None, None]
    values[21, 14, 3::7] = np.nan
    forces, ends = rng.normal(size=(n, 12, most)), np.where(np.arange(most) % 5 == 1, 9 + np.arange(most) % 20, n)
    flags = rng.random((2, n, 6, most)) < 0.1
    timing = Timing((n - 1) * 1e-3, 2e-3, 1e-3)

    def results(number: int, kernels: FoldKernels | None = None) -> dict[str, FloatArray]:
        loop = Loop(timing, wanted[:, :number], np.zeros((18, 6)), np.zeros(6))
        rows = FoldsOfRows(loop, folds_of_loop(loop, LIMITS), number, kernels)
        given = (
            (values[k, :, :number].T, forces[k, :, :number].T, *flags[:, k, :, :number].swapaxes(1, 2))
            for k in range(n)
        )
        pass_rows(rows, timing, given, ends[:number])
        return rows.results()

    whole = results(most)
    for number, kernels in product((1, 3, 8, 11, 512, most), (None, metric_kernels())):
        for name, found in results(number, kernels).items():
            np.testing.assert_array_equal(found, whole[name][..., :number], err_msg=name)


def test_every_metric_of_a_run_is_declared_once_and_every_declared_one_is_there() -> None:
    """Expected: the paths of a run with all columns; those of margins come from the linear loop."""
    members = [noise(41, 41, np.random.default_rng(2))]
    wanted = members[0].wanted
    assert wanted is not None
    wanted[6:, :6] = 0.5
    loop = Loop(Timing(0.04, 2e-3, 1e-3), wanted, np.zeros((20, 6)), np.zeros(6))
    found = seen_again(loop, LIMITS, members)
    declared = [metric.path for metric in METRICS if not metric.path.startswith("margins.")]
    assert len(set(declared)) == len(declared)
    assert set(found) == set(declared)
    assert all(metric.text and metric.sentence for metric in METRICS)
