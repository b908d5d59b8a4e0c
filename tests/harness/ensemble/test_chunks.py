"""Members side by side: each has the bits that it has among any others, and steps as small as it needs."""

import re

import numpy as np
import polars
import pytest

import gough_stewart as gs
from tests.harness.ensemble.small_ensemble import small


@pytest.fixture(scope="module")
def whole() -> polars.DataFrame:
    """Forty members, some of them impossible."""
    return gs.ensemble(small(), workers=1).members


@pytest.mark.parametrize("first", [0, 7, 39])
def test_a_member_has_the_same_bits_alone_and_among_others(whole: polars.DataFrame, first: int) -> None:
    """Expected: the row of the whole, of as many members as there are before it and itself; impossible ones, too."""
    found = gs.ensemble(small(), members=first + 1, workers=1).members
    assert found.schema == whole.schema
    assert found.equals(whole.head(first + 1), null_equal=True)
    assert whole["outcome"].to_list().count("impossible") > 1


def test_an_ensemble_of_impossible_members_has_the_columns_of_any_other() -> None:
    """Expected: none is left out, and margins have theirs; without a possible one, the first reason is the error."""
    varied = {"grid": [-3.0] * 3 + [1000.0]}
    members = gs.ensemble(small(platform_mass=varied, margins=True, members=4), workers=1).members
    assert members["outcome"].to_list() == ["impossible"] * 3 + ["completed"]
    assert members["margins.disk"].is_null().to_list() == [True] * 3 + [False]
    with pytest.raises(gs.GoughStewartError, match=r"none of the first 64 members is possible; the first: .*_mass"):
        gs.ensemble(small(platform_mass={"grid": [-3.0] * 64 + [1000.0]}, members=65), workers=1)
    # the most frequent cause first, others by their text, fifty of them
    masses = {"grid": [-20, -40, -30, -30, *range(-99, -40), 1000]}
    causes = gs.ensemble(small(platform_mass=masses, members=64), workers=1).metadata["causes"]
    numbers = [(int(re.findall(r"-\d+", cause)[0]), number) for cause, number in causes.items()]
    assert numbers == [(-30, 2), (-20, 1), *((-mass, 1) for mass in range(40, 88))]


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


def test_internal_steps_hold_the_tolerance_and_are_those_that_each_member_needs(whole: polars.DataFrame) -> None:
    """Expected: one for each of 60 rows; more where legs reverse, other ones of each machine; errors below them."""
    table = {"members": 40, "platform_mass": {"factor": {"uniform": [0.8, 1.2]}}}
    settings = {"loop.duration": 0.1, "reference.at": 0.02, "plant.parameters.leg_friction_velocity": 1e-4}
    stiff = gs.ensemble("heave_step", {**settings, "ensemble": table}, workers=1).members
    for found, rows in ((whole, 60), (stiff, 100)):
        ran = found.filter(polars.col("outcome") == "completed")
        error, steps = ran["integration_error"].to_numpy(), ran["internal_steps"].to_numpy()
        assert (steps >= rows).all()
        assert (error > 0).all()
        assert (error <= 1e-10 * (steps - rows + 1)).all()
    assert len(set(steps.tolist())) > 10
    assert steps.min() > rows + 5


@pytest.mark.parametrize(("size", "number"), [(2.5e-4, 4), (4e-4, 3), (1e-3, 1), (None, None)])
def test_a_fixed_step_of_the_plant_is_that_of_all_members(size: float | None, number: int | None) -> None:
    """Expected: four in a plant step of 1 ms; three of at most 0.4 ms; no internal steps of an error control."""
    settings = {} if size is None else {"plant.fixed_step_size": size}
    found = gs.ensemble(small(tolerance=3e-9), settings, members=8, workers=1)
    assert (found.metadata["tolerance"], found.metadata["substeps"]) == (3e-9, number)
    assert ({0.0} == set(found.members["internal_steps"].drop_nulls())) == (number is not None)
    assert (found.members["integration_error"].drop_nulls() > 0).all()


def test_errors_go_down_with_the_tolerance_where_legs_slip() -> None:
    """Expected: 64 fixed steps a row; of 40 machines whose legs change direction within rows, none is off by chance."""
    varied = {"members": 40, "seed": 1, "platform_mass": {"factor": {"uniform": [0.8, 1.3]}}}
    varied["leg_coulomb_friction"] = {"uniform": ["0 N", "100 N"]}
    settings = {"loop.duration": 0.1, "reference.at": 0.03, "sensors.quantisation": {}, "ensemble": varied}
    exact = gs.ensemble("heave_step", {**settings, "plant.fixed_step_size": 1e-3 / 64}, workers=1)
    names = [name for name in exact.metrics if name.startswith("tracking.") and name.endswith(("_rms", "_final"))]
    assert len(names) >= 4
    worst = []
    for tolerance in (1e-6, 1e-8, 1e-10):
        found = gs.ensemble("heave_step", {**settings, "ensemble.tolerance": tolerance}, workers=1)
        worst.append(max(float(np.abs(found.values(name) - exact.values(name)).max()) for name in names))
    assert all(gap < 20 * tolerance for gap, tolerance in zip(worst, (1e-6, 1e-8, 1e-10), strict=True)), worst
    assert worst[0] > 100 * worst[2]  # coarse steps are coarse
