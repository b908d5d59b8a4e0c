"""Chunks: member k has the same bits whoever runs beside it; its row holds the figures of merit of its record."""

from pathlib import Path

import numpy as np
import polars
import pytest

import gough_stewart as gs
from gough_stewart.harness.ensemble.chunk import SIZE, Chunk, chunk
from gough_stewart.harness.experiment.file import experiment_of
from gough_stewart.harness.experiment.members import EnsemblePlan, Members, plan_from, plan_of
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.plants.lanes import Stepping
from gough_stewart.harness.results.bands import MOST_MEMBERS, MOST_TIMES
from gough_stewart.harness.sampling.choice import EnsembleChoice
from gough_stewart.harness.tuning.tune import FRESH
from gough_stewart.harness.tuning.tune import MEMBERS as CANDIDATE_MEMBERS
from tests.support.small_ensemble import small


@pytest.fixture(scope="module")
def plan() -> EnsemblePlan:
    return plan_of(small())


@pytest.fixture(scope="module")
def whole(plan: EnsemblePlan) -> Chunk:
    return chunk(plan, 0, 40)


def same(a: polars.DataFrame, b: polars.DataFrame) -> bool:
    return a.select(sorted(a.columns)).equals(b.select(sorted(b.columns)), null_equal=True)


@pytest.mark.parametrize(("first", "last"), [(0, 1), (39, 40), (3, 13), (13, 40)])
def test_a_member_has_the_same_bits_alone_and_among_others(
    plan: EnsemblePlan, whole: Chunk, first: int, last: int
) -> None:
    part = chunk(plan, first, last)
    assert same(part.rows, whole.rows[first:last])
    possible = np.cumsum(whole.rows["outcome"].to_numpy() != "impossible")
    a, b = (int(possible[k - 1]) if k else 0 for k in (first, last))
    assert np.array_equal(part.bands.values, whole.bands.values[:, :, a:b], equal_nan=True)


def test_a_plan_reads_back_from_its_text(plan: EnsemblePlan, whole: Chunk) -> None:
    again = plan_from(plan.text)
    assert again == plan
    assert same(chunk(again, 20, 25).rows, whole.rows[20:25])


def test_a_chunk_of_which_nobody_can_run_is_like_any_other(plan: EnsemblePlan, whole: Chunk) -> None:
    """Expected: the row that the member has among others, with the same columns and types, and bands of nobody."""
    k = whole.rows["outcome"].to_list().index("impossible", 7)
    part = chunk(plan, k, k + 1)
    assert part.rows.schema == whole.rows.schema
    assert part.rows.equals(whole.rows[k : k + 1], null_equal=True)
    assert part.bands.columns == whole.bands.columns
    assert part.bands.time.tolist() == whole.bands.time.tolist()
    assert part.bands.values.shape == (*whole.bands.values.shape[:2], 0)
    with_margins = chunk(plan_of(small(margins=True)), k, k + 1)
    assert with_margins.rows.columns == [*whole.rows.columns, "margins.stable", "margins.disk"]


@pytest.mark.usefixtures("units_in_process")
def test_a_member_is_its_experiment_in_another_plant() -> None:
    """Expected: the stepping model and the FMU, another integrator, within 1e-8 m and rad."""
    # which would round on two sides of a step sooner or later
    fixed = {"sensors.quantisation.leg_length": 0.0}
    experiment = gs.load_experiment("heave_tolerances", {"loop.duration": 0.2, "ensemble.members": 64, **fixed})
    lanes, *others = (gs.run(experiment, member=5, plant=plant) for plant in (None, "model", "fmu3"))
    assert lanes.metadata["plant"] == "lanes"
    for name in ("position", "orientation"):
        for other in others:
            assert np.abs(lanes[name] - other[name]).max() < 1e-8
    assert (lanes["measured.leg_length"] != lanes["leg_length"]).any()


def test_internal_steps_hold_the_tolerance_and_are_those_that_each_member_needs(whole: Chunk) -> None:
    """Expected: one for each of 60 rows; more where legs reverse, other ones of each machine; errors below them."""
    table = {"members": 40, "platform_mass": {"factor": {"uniform": [0.8, 1.2]}}}
    settings = {"loop.duration": 0.1, "reference.at": 0.02, "plant.parameters.leg_friction_velocity": 1e-4}
    stiff = chunk(plan_of(gs.load_experiment("heave_step", {**settings, "ensemble": table})), 0, 40)
    for found, rows in ((whole, 60), (stiff, 100)):
        ran = found.rows.filter(polars.col("outcome") == "completed")
        error, steps = ran["integration_error"].to_numpy(), ran["internal_steps"].to_numpy()
        assert (steps >= rows).all()
        assert (error > 0).all()
        assert (error <= 1e-10 * (steps - rows + 1)).all()
    assert len(set(steps.tolist())) > 10
    assert steps.min() > rows + 5


def test_a_fixed_step_of_the_plant_is_that_of_all_members() -> None:
    """Expected: four in a plant step of 1 ms; three of at most 0.4 ms; no internal steps of an error control."""
    for size, number in ((2.5e-4, 4), (4e-4, 3), (1e-3, 1)):
        experiment = experiment_of(small(), {"plant.fixed_step_size": size})
        assert Members(experiment).stepping.substeps == number
    rows = chunk(plan_of(experiment), 0, 8).rows
    assert set(rows["internal_steps"].drop_nulls()) == {0.0}
    assert (rows["integration_error"].drop_nulls() > 0).all()
    assert Members(small(tolerance=3e-9)).stepping == (3e-9, None)


def test_errors_go_down_with_the_tolerance_where_legs_slip() -> None:
    """Expected: 64 fixed steps a row; of 40 machines whose legs change direction within rows, none is off by chance.

    A row's forces turn the friction of all legs within less than a row, where one estimate alone may vanish.
    """
    varied = {"members": 40, "seed": 1, "platform_mass": {"factor": {"uniform": [0.8, 1.3]}}}
    varied["leg_coulomb_friction"] = {"uniform": ["0 N", "100 N"]}
    settings = {"loop.duration": 0.1, "reference.at": 0.03, "sensors.quantisation": {}, "ensemble": varied}
    batch = Members(gs.load_experiment("heave_step", settings)).prepared(0, 40).batch
    found = []
    for stepping in (Stepping(substeps=64), *(Stepping(tolerance=each) for each in (1e-6, 1e-8, 1e-10))):
        running = batch.in_parallel(stepping)
        with running.plant:
            found.append(simulate(running.plant, running.law_from, running.loop).results[..., :12])
    exact, *own = found
    worst = [float((np.abs(each - exact) / (1 + np.abs(exact))).max()) for each in own]
    assert all(gap < 20 * tolerance for gap, tolerance in zip(worst, (1e-6, 1e-8, 1e-10), strict=True)), worst
    assert worst[0] > 100 * worst[2]  # coarse steps are coarse


def test_an_ensemble_of_which_nobody_can_run_says_why() -> None:
    with pytest.raises(
        gs.GoughStewartError, match=r"none of the first 40 members is possible; the first: .*platform_mass"
    ):
        gs.ensemble(small(platform_mass={"uniform": [-3, -1]}), workers=1)


def test_the_documentation_states_the_sizes_that_the_code_has() -> None:
    """Expected: each constant as the page on ensembles writes it."""
    text = Path("docs/ensembles.md").read_text()
    for said in (
        f"in chunks of {SIZE},",
        f"at {MOST_TIMES} times at most",
        f"exact up to {MOST_MEMBERS:,} members",
        f"{FRESH}) members that the search did not use",
        f"the same members, {CANDIDATE_MEMBERS} at most by default",
        f"of the `worst` ({EnsembleChoice.model_fields['worst'].default}) members",
    ):
        assert said in text, said
