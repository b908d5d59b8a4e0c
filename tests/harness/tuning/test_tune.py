"""The search against an exhaustive one with another plant, and what it refuses."""

import numpy as np
import pytest

import gough_stewart as gs

SHORT = {"loop.duration": 0.5, "loop.sample_time": "2 ms"}
DAMPING = "controller.damping_ratio"
RMS = "tracking.position.norm_rms"


@pytest.fixture(scope="module")
def found() -> gs.Tuning:
    return gs.tune("heave_step", [f"{DAMPING}=0.3..1.5"], RMS, SHORT, generations=7, population=8)


def test_the_search_finds_the_optimum_of_a_fine_grid_of_single_runs(found: gs.Tuning) -> None:
    """Expected: the best of 13 runs through the stepping model, one by one; the RMS has one minimum inside."""
    grid = np.linspace(0.3, 1.5, 13)
    numbers = np.array(
        [gs.metrics(gs.run("heave_step", {**SHORT, DAMPING: x}))["tracking"]["position"]["norm_rms"] for x in grid]
    )
    best = int(numbers.argmin())
    assert 0 < best < 12
    assert abs(found.values[DAMPING] - grid[best]) <= grid[1] - grid[0]
    # between two points of the grid the search may be a little better, never worse
    assert numbers[best] * (1 - 1e-2) <= found.seen.value <= numbers[best] * (1 + 5e-4)
    assert found.before is not None
    assert found.before.value == pytest.approx(numbers[5], rel=1e-6)


def test_drives_without_a_limit_and_the_largest_integration_error_of_all_members() -> None:
    """Expected: of the experiment as it is the quantile of its ensemble, and an error that is none of its least."""
    varied = {"members": 3, "seed": 2, "platform_mass": {"uniform": [600, 2500]}}
    settings = {"loop.duration": 0.2, "reference.at": 0.01, "actuators.force_limit": "none", "ensemble": varied}
    of_members = gs.ensemble("heave_step", settings, workers=1)
    found = gs.tune("heave_step", ["controller.bandwidth=1.9..2.1"], RMS, settings, generations=1, population=5)
    assert found.before is not None
    assert found.before.value == pytest.approx(of_members.values(RMS).max(), rel=1e-6)
    assert found.integration_error >= of_members.members["integration_error"].max()  # type: ignore[operator]


def test_conditions_bound_the_optimum(found: gs.Tuning) -> None:
    """Expected: the free optimum overshoots more than is allowed, so that the best that is allowed is at the bound."""
    overshoot = "step_response.z.overshoot_percent"
    (step,) = gs.metrics(gs.run("heave_step", {**SHORT, **found.values}))["step_response"]
    free = step["overshoot_percent"]
    bound = 0.4 * free
    assert bound > 0
    vary, allowed = [f"{DAMPING}=0.3..1.5"], [f"{overshoot} <= {bound:.6f}"]
    bounded = gs.tune("heave_step", vary, RMS, SHORT, subject_to=allowed, generations=8, population=8)
    assert 0.7 * bound < bounded.seen.conditions[0] <= bound
    assert bounded.seen.value > found.seen.value
    assert not bounded.candidates["kept"].all()


def test_a_machine_that_sticks_and_gives_is_tuned_as_it_is() -> None:
    """Expected: the metric of the tuned experiment's own run; its disk margin is that of the machine's legs."""
    machine = {
        "plant.parameters.leg_friction_model": "elasto_plastic",
        "plant.parameters.leg_coulomb_friction": [60, 80, 100, 120, 90, 110],
        "plant.parameters.leg_stiffness": 5e7,
        "loop.duration": 0.05,
        "reference.at": 0.01,
    }
    found = gs.tune("heave_step", ["controller.bandwidth=1..3Hz"], RMS, machine, generations=1, population=5)
    alone = gs.run(found.experiment)
    assert found.seen.value == pytest.approx(gs.metrics(alone)["tracking"]["position"]["norm_rms"], rel=1e-4)
    assert len({round(each.value, 9) for each in found.search.tried}) > 1
    margins = gs.margins(found.experiment)
    assert margins.believed is not None
    assert found.report(charts=False).number("margins.disk").value == pytest.approx(margins.disk.alpha)
    assert margins.disk.alpha < 0.9 * margins.believed.disk.alpha
