"""The search against an exhaustive one with another plant; what it writes; what it refuses."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart.harness.errors import TuningError
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.results.metrics import flattened, metrics
from gough_stewart.harness.tuning.candidates import Candidates, Goal
from gough_stewart.harness.tuning.conditions import condition_of
from gough_stewart.harness.tuning.files import tuning_files
from gough_stewart.harness.tuning.search import search
from gough_stewart.harness.tuning.space import axes_of
from gough_stewart.harness.tuning.tables import statement, tuning_sheets
from gough_stewart.harness.tuning.tune import Tuning, tune

SHORT = {"loop.duration": 0.5, "loop.sample_time": "2 ms"}
DAMPING = "controller.damping_ratio"
SETTLING, RMS = "step_response.z.settling_time", "tracking.position.norm_rms"


@pytest.fixture(scope="module")
def found() -> Tuning:
    return tune("heave_step", [f"{DAMPING}=0.3..1.5"], RMS, SHORT, generations=7, population=8)


def test_the_search_finds_the_optimum_of_a_fine_grid_of_single_runs(found: Tuning) -> None:
    """Expected: the best of 13 runs through the stepping model, one by one; the RMS has one minimum inside."""
    grid = np.linspace(0.3, 1.5, 13)
    values = [flattened(metrics(run("heave_step", {**SHORT, DAMPING: float(x)})))[RMS] for x in grid]
    numbers = np.array(values, dtype=float)
    best = int(numbers.argmin())
    assert 0 < best < 12
    assert abs(found.values[DAMPING] - grid[best]) <= grid[1] - grid[0]
    # between two points of the grid the search may be a little better, never worse
    assert numbers[best] * (1 - 1e-2) <= found.seen.value <= numbers[best] * (1 + 5e-4)
    assert found.before is not None
    assert found.before.value == pytest.approx(numbers[5], rel=1e-6)


def test_conditions_bound_the_optimum(found: Tuning) -> None:
    """Expected: the free optimum overshoots more than is allowed, so that the best that is allowed is at the bound."""
    overshoot = "step_response.z.overshoot_percent"
    free = flattened(metrics(run("heave_step", {**SHORT, **found.values})))[overshoot]
    assert free is not None
    bound = 0.4 * free
    assert bound > 0
    bounded = tune(
        "heave_step",
        [f"{DAMPING}=0.3..1.5"],
        RMS,
        SHORT,
        subject_to=[f"{overshoot} <= {bound:.6f}"],
        generations=8,
        population=8,
    )
    assert 0.7 * bound < bounded.seen.conditions[0] <= bound
    assert bounded.seen.value > found.seen.value
    assert not bounded.candidates["kept"].all()


def test_the_files_run_and_keep_the_comments(found: Tuning, tmp_path: Path) -> None:
    """Expected: the same value by a run of the file alone; the comments of the shipped text."""
    files = tuning_files(found, "heave_step", tmp_path, SHORT)
    path = tmp_path / "tuned.toml"
    path.write_bytes(files["tuned.toml"])
    assert load_experiment(path).model_dump()["controller"]["damping_ratio"] == found.values[DAMPING]
    assert flattened(metrics(run(path)))[RMS] == pytest.approx(found.seen.value, rel=1e-6)
    assert b"# samples from measurement to force" in files["tuned.toml"]
    assert files["search.png"].startswith(b"\x89PNG")
    assert len(files["candidates.csv"].splitlines()) == 1 + found.candidates.height
    assert "nothing is random" in statement(found)
    assert [sheet.title for sheet in tuning_sheets(found)] == ["Tuned", "Worth"]
    assert repr(found).splitlines()[-1] == statement(found)
    assert found._repr_html_().count("<table>") == 2


@pytest.mark.parametrize("table", ["platform", "plant"])
def test_a_tuned_parameter_of_a_platform_is_written_with_its_unit_and_runs(tmp_path: Path, table: str) -> None:
    """Expected: the same value by a run of the file alone."""
    key = f"{table}.platform_mass"
    short = {"loop.duration": 0.1, "reference.at": 0.02}
    tuned = tune("heave_step", [f"{key}=900..1100kg"], RMS, short, generations=1, population=5)
    path = tmp_path / "tuned.toml"
    path.write_bytes(tuning_files(tuned, "heave_step", tmp_path, short)["tuned.toml"])
    assert tomllib.loads(path.read_text())[table]["parameters"]["platform_mass"] == f"{tuned.values[key]!r} kg"
    assert flattened(metrics(run(path)))[RMS] == pytest.approx(tuned.seen.value, rel=1e-6)


def test_files_that_an_experiment_names_are_found_from_where_the_tuned_one_is(found: Tuning, tmp_path: Path) -> None:
    """Expected: platform.file of an experiment in another folder leads to the same file."""
    there, here = tmp_path / "mine", tmp_path / "results" / "tuned"
    there.mkdir()
    (there / "x.toml").write_text(
        Path("harness/experiment/shipped/heave_step.toml")
        .read_text()
        .replace('preset = "motion_base"', 'file = "p.toml"')
    )
    experiment = found.experiment.from_file(str(there / "x.toml"), there)
    moved = Tuning(**{**vars(found), "experiment": experiment})
    text = tuning_files(moved, there / "x.toml", here, SHORT)["tuned.toml"].decode()
    assert 'file = "../../mine/p.toml"' in text


def test_over_members_the_value_is_their_quantile_and_fresh_members_are_others() -> None:
    """Expected: quantiles of single runs of the members' machines, which are drawn again here by their experiments."""
    short = {**SHORT, "loop.duration": 0.2, "reference.at": 0.05}
    experiment = load_experiment(
        "heave_step", {**short, "ensemble": {"members": 5, "seed": 4, "platform_mass": {"uniform": [800, 3000]}}}
    )
    tuned = tune(
        experiment, [f"{DAMPING}=0.5..1.2"], RMS, generations=1, population=5, quantile=0.7, members=5, fresh=5
    )

    def worth(seed: int) -> float:
        from gough_stewart.harness.tuning.candidates import members_for

        drawn = members_for(experiment, 5, seed).draws(0, 5).columns["platform_mass"]
        values = [
            flattened(metrics(run(experiment, {**tuned.values, "plant.parameters.platform_mass": float(m)})))[RMS]
            for m in drawn
        ]
        # the fourth of five: the nearest that is not below 0.7
        return float(np.sort(np.array(values, dtype=float))[3])

    assert tuned.seen.value == pytest.approx(worth(4), rel=1e-6)
    assert tuned.fresh is not None
    assert tuned.fresh.value == pytest.approx(worth(5), rel=1e-6)
    assert tuned.fresh.value != tuned.seen.value
    assert "5 fresh members" in statement(tuned)


def test_ctrl_c_ends_the_search_with_the_best_so_far() -> None:
    """Expected: two generations of five, and the best of them."""
    experiment = load_experiment("heave_step", SHORT)
    here = Candidates(experiment, 1)
    axes = axes_of([f"{DAMPING}=0.3..1.5"], here.members)

    def stop(found: Any) -> None:
        if found.generation[-1] == 1:
            raise KeyboardInterrupt

    done = search(here, axes, Goal(RMS, (), 0.95), population=5, generations=9, seed=0, status=stop)
    assert done.is_interrupted
    assert len(done.tried) == 10
    assert done.best is not None
    assert done.best.value == min(each.value for each in done.tried)


@pytest.mark.parametrize(
    ("vary", "minimise", "subject_to", "message"),
    [
        (["controller.bandwith=1..6Hz"], RMS, [], r"bandwith.*no such key.*bandwidth"),
        (["controller.bandwidth=6..1Hz"], RMS, [], r"the bounds are 6 and 1; expected the lower one first"),
        (["controller.bandwidth=1-6Hz"], RMS, [], r"expected KEY=LOW\.\.HIGH"),
        (["controller.bandwidth=1..6kg"], RMS, [], r"found the unit 'kg'"),
        (["controller.bandwidth=0..6Hz,log"], RMS, [], r"expected > 0 for a logarithmic scale"),
        (["loop.delay=0.5..3"], RMS, [], r"whole number"),
        ([f"{DAMPING}=0.3..1", f"{DAMPING}=0.4..1"], RMS, [], r"is repeated"),
        ([], RMS, [], r"nothing to vary"),
        ([f"{DAMPING}=0.3..1"], "tracking.position.norm_rsm", [], r"no metric .*norm_rms"),
        ([f"{DAMPING}=0.3..1"], RMS, ["disk_margin ~ 2"], r"cannot be read; expected METRIC < NUMBER"),
        (
            [f"{DAMPING}=0.3..1"],
            RMS,
            ["stroke.margin > 10 kg"],
            r"the bound is '10 kg'; expected a number, or one with",
        ),
        ([f"{DAMPING}=0.3..1"], RMS, ["force.peek < 10"], r"no metric 'force.peek'"),
        (
            [f"{DAMPING}=0.3..1"],
            RMS,
            ["force.peak < 10 N"],
            r"no candidate meets.*'force.peak < 10 N' was not met by 5 of 5",
        ),
    ],
)
def test_what_cannot_be_is_refused_with_its_reason(
    vary: list[str], minimise: str, subject_to: list[str], message: str
) -> None:
    """Expected: the text that names what was found and what was expected."""
    with pytest.raises(TuningError, match=message):
        tune("heave_step", vary, minimise, {"loop.duration": 0.3}, subject_to=subject_to, generations=1, population=5)


def test_units_and_scales_of_what_is_varied() -> None:
    """Expected: milliseconds as seconds, the middle of 1 to 100 on a logarithmic scale 10, whole numbers alike."""
    members = Candidates(load_experiment("heave_step", SHORT), 1).members
    lag, wide, delay = axes_of(["actuators.lag=1..5 ms", "controller.bandwidth=1..100,log", "loop.delay=0..3"], members)
    assert (lag.low, lag.high) == pytest.approx((1e-3, 5e-3))
    assert wide.value(0.5) == pytest.approx(10)
    assert [delay.value(u) for u in (0, 0.24, 0.26, 0.51, 0.99, 1.0)] == [0, 0, 1, 2, 3, 3]
    shares: Callable[[float], float] = wide.share
    assert shares(10.0) == pytest.approx(0.5)


def test_conditions_are_read_with_units_and_measure_how_far_they_are_broken() -> None:
    """Expected: 10 mm is 0.01 m; a value of half a lower bound is half of it away; NaN breaks every condition."""
    margin = condition_of("stroke.margin >= 10 mm")
    assert (margin.metric, margin.is_upper, margin.bound) == ("stroke.margin", False, 0.01)
    assert margin.violation(0.005) == pytest.approx(0.5)
    assert margin.violation(0.01) == 0
    assert condition_of("disk_margin>0.5").metric == "margins.disk"
    assert not condition_of("force.peak < 5 kN").holds(5000.0)
    assert not margin.holds(float("nan"))
