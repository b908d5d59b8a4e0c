"""How members end: each for its own cause, while the others go on as if they were alone."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from numpy.random import SeedSequence

from gough_stewart import GoughStewartError, LinearController, Sample, pid, sampled
from gough_stewart.harness.control.laws_of_members import laws_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.loop.loop import Limits
from gough_stewart.harness.loop.rows import Observer, RowBlock
from gough_stewart.harness.loop.run import observe
from gough_stewart.harness.loop.timing import Seeds, Timing
from tests.support.arrays import FloatArray
from tests.support.fake_plants import ManyMasses, Masses
from tests.support.loops import FORCES, constant, loop_of
from tests.support.members import (
    FEATURES,
    Member,
    T,
    alone,
    assert_same,
    gains_of_member,
    law_of_member,
    loop_of_members,
    member_of,
    side_by_side,
)

NO_JACOBIANS = np.zeros((0, 6, 6))


def failing(sample: Sample) -> FloatArray:
    """Gives up at 0.1 s."""
    if sample.time > 0.095:
        raise RuntimeError("no more")
    return FORCES


def no_number_from(start: float) -> Callable[[Sample], FloatArray]:
    """One force is none from a time on."""
    return lambda sample: np.where((np.arange(6) == 3) & (sample.time > start), np.nan, FORCES)


LATE = ["jitter", "delays", "force_limit", "rate_limit", "noise", "feedforward"]


def late_members() -> list[Member]:
    """The same ends, of members whose samples are late, each in its own way, behind delays and rate limits."""
    some = []
    several = [replace(ending_members()[4], controller=no_number_from(start)) for start in (0.055, 0.105, 0.195, 0.225)]
    for k, each in enumerate([*ending_members(), *several]):
        loop = member_of(k + 1, each.controller, LATE).loop  # those at ease with a delay of one sample
        some.append(replace(each, loop=replace(loop, limits=each.loop.limits)))
    return some


def ending_members() -> list[Member]:
    """Two that run to their end among five that do not."""
    at_ease = member_of(0, law_of_member(0))
    loop = replace(at_ease.loop, limits=Limits((0.5, 1.75), "stop", 0.5))
    return [
        Member(loop, law_of_member(0)),
        Member(loop, law_of_member(0), fails_at=0.05),
        Member(replace(loop, limits=Limits((0.5, 1.601), "stop", 0.5)), constant(-FORCES)),
        Member(loop, failing),
        Member(loop, no_number_from(0.145)),
        Member(replace(loop, limits=Limits((0.0, 9.0), "stop", 1e-3)), constant()),
        Member(loop, law_of_member(2), 1.3),
    ]


def featured_members() -> list[Member]:
    """With everything on."""
    return [member_of(k, law_of_member(k), FEATURES) for k in range(7)]


@pytest.mark.parametrize(("members_of", "ends"), [(featured_members, 1), (ending_members, 6), (late_members, 4)])
def test_members_are_single_runs_of_theirs(members_of: Callable[[], list[Member]], ends: int) -> None:
    """Expected: outcome, words and rows of a loop of one member alone, to the bit; they end at so many times."""
    some = members_of()
    many = side_by_side(some)
    for k, member in enumerate(some):
        single = alone(member)
        assert_same(many, k, single)
        assert many.outcomes[k] == single.outcome
    assert len({outcome.time for outcome in many.outcomes}) >= ends


def test_members_end_each_for_its_cause_and_the_others_go_on() -> None:
    outcomes = side_by_side(ending_members()).outcomes
    statuses = [outcome.status for outcome in outcomes]
    assert statuses == ["completed", "diverged", "stopped", "stopped", "diverged", "diverged", "completed"]
    assert "failed at time 0.1 s with RuntimeError: no more" in str(outcomes[3].cause)


def test_members_that_have_ended_stand_still() -> None:
    """Expected: the plant's signals of the row behind their end, in all rows that follow.

    At that row a controller may have failed, to which it does not count; all others stand there from their end on.
    """
    many = side_by_side(ending_members())
    for k, outcome in enumerate(many.outcomes):
        last = round(outcome.time / 0.002) + (k == 3)
        after = many.results[last:, k, :24]
        assert (after == after[0]).all()


def observed(some: list[Member], plant: ManyMasses, observer: Observer, *progress: Any, **options: Any) -> Any:
    """The outcomes of members, whose rows go to an observer."""
    law_from = laws_of([member.controller for member in some], T, NO_JACOBIANS)
    return observe(plant, law_from, loop_of_members([member.loop for member in some]), observer, *progress, **options)


def plant_of(some: list[Member]) -> ManyMasses:
    return ManyMasses([member.platform_mass for member in some], [member.fails_at for member in some])


class Counting(Observer):
    """Counts the rows of each member."""

    def __init__(self, n: int) -> None:
        self.rows, self.all = np.zeros(n, dtype=int), 0

    def block(self, rows: RowBlock) -> None:
        self.rows += rows.counting
        self.all += rows.count


def test_rows_count_up_to_the_row_of_the_outcome() -> None:
    """Expected: as many as a single run records; the loop ends when nobody is left."""
    some = ending_members()
    for who in (range(7), range(1, 6)):
        chosen = [some[k] for k in who]
        counting, plant = Counting(len(chosen)), plant_of(chosen)
        outcomes = observed(chosen, plant, counting)
        assert counting.rows.tolist() == [len(alone(each).time) for each in chosen]
        assert counting.all == counting.rows.max()
        if len(chosen) == 7:  # with nobody left nothing is frozen
            assert plant.frozen.tolist() == [outcome.status != "completed" for outcome in outcomes]


def test_the_first_outcome_of_a_member_is_its_outcome() -> None:
    """Expected: a force that is no number comes before the bound that the same row is beyond."""
    far = replace(member_of(0, law_of_member(0)).loop, limits=Limits(largest_position_error=1e-12))
    starting = replace(far, reference=None if far.reference is None else far.reference + 0.1)
    nan = np.full(6, np.nan)
    for outcome in side_by_side([Member(starting, constant(nan)), Member(starting, constant(nan))]).outcomes:
        assert outcome.status == "diverged"
        assert "the controller's forces are [nan" in str(outcome.cause)


def test_a_function_that_gives_no_forces_at_first_ends_its_member_alone() -> None:
    """Expected: no row of its own, an outcome at time 0; the other one as alone."""
    fine = member_of(1, law_of_member(1))
    many = side_by_side([Member(fine.loop, lambda _sample: None), fine])
    assert many.outcomes[0].status == "stopped"
    assert many.outcomes[0].time == 0.0
    assert "time 0 s; expected 6 forces" in str(many.outcomes[0].cause)
    assert_same(many, 1, alone(fine))


def test_ctrl_c_ends_those_that_still_run() -> None:
    def interrupt(time: float) -> None:
        if time > 0.2:
            raise KeyboardInterrupt

    some = ending_members()
    outcomes = observed(some, plant_of(some), Counting(7), interrupt)
    assert [outcome.status == "interrupted" for outcome in outcomes] == [True, *[False] * 5, True]


def test_ctrl_c_where_no_outcome_is_read_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the interrupt itself, at a step in the middle of the run."""
    some = ending_members()
    plant = plant_of(some)
    do_step = plant.do_step

    def interrupted(time: float, step: float) -> None:
        if time > 0.2:
            raise KeyboardInterrupt
        do_step(time, step)

    monkeypatch.setattr(plant, "do_step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        observed(some, plant, Counting(7), keeps_interrupted=False)


@pytest.mark.parametrize("seed", [9, SeedSequence(9, spawn_key=(3,)), tuple(SeedSequence(9).spawn(3))])
def test_members_are_late_by_their_jitter_and_seed_alone(seed: Seeds) -> None:
    """Expected: rows of samples as of a single run with the member's jitter, and its seed or that of all."""
    jitter = np.array([0.004, 0.0, 0.009])
    rows = Timing(1.0, T, 0.001, jitter, seed).rows_of_samples
    for k in range(3):
        own = seed[k] if isinstance(seed, tuple) else seed
        np.testing.assert_array_equal(rows[:, k], Timing(1.0, T, 0.001, float(jitter[k]), own).rows_of_samples)
    assert len(np.unique(rows[:, 2] % 10)) == 10
    late = rows - 10 * np.arange(100)[:, None]
    assert late.max(axis=0).tolist() == [4, 0, 9]
    assert late.min() == 0


def test_controllers_that_cannot_be_together_are_refused() -> None:
    pd_only, pid_too = (LinearController(sampled(pid(gains_of_member(0, integral)), T)) for integral in (False, True))
    with pytest.raises(GoughStewartError, match=r"different structure.*12 states, 18 inputs.*6 states, 12 inputs"):
        laws_of([pid_too, pd_only], T, NO_JACOBIANS)
    with pytest.raises(GoughStewartError, match="different structure, a function; linear"):
        laws_of([pid_too, constant()], T, NO_JACOBIANS)
    with pytest.raises(GoughStewartError, match=r"mine.fmu is an FMU.*linear controller or a function"):
        laws_of([UnitController("mine.fmu")], T, NO_JACOBIANS)  # type: ignore[arg-type]
    with pytest.raises(GoughStewartError, match="the controller's sample time is 0\\.01 s, the loop's 0\\.02 s"):
        laws_of([pd_only, pd_only], 0.02, NO_JACOBIANS)


def test_a_loop_of_another_shape_than_the_plant_is_refused() -> None:
    loop = loop_of_members([loop_of(0.1), loop_of(0.1)])
    for plant in (ManyMasses([1.0, 1.0, 1.0]), Masses()):
        with pytest.raises(GoughStewartError, match=r"a loop of shape \(2,\) with a plant of shape \("):
            observe(plant, None, loop, Counting(2))


def test_features_name_what_the_tests_of_members_turn_on() -> None:
    """Expected: with a feature on, its numbers differ from member to member; a misspelt one would test nothing."""
    plain = loop_of_members([member_of(k, law_of_member(k)).loop for k in range(4)])
    for feature in FEATURES:
        featured = loop_of_members([member_of(k, law_of_member(k), [feature]).loop for k in range(4)])
        assert repr(featured) != repr(plain), feature


def test_each_controller_starts_at_rest_under_its_own_error() -> None:
    """Expected: the bits of each member alone, where integrators feed filters and each member starts off its path."""
    rng = np.random.default_rng(7)
    controllers = []
    for k in range(3):
        A = np.diag([1.0, 0.9, 0.8 - 0.1 * k]) + np.tril(0.1 * rng.normal(size=(3, 3)), -1)
        system = control.append(*[control.ss(A, rng.normal(size=(3, 1)), rng.normal(size=(1, 3)), 0, T)] * 6)
        controllers.append(LinearController(system))
    wanted, measured = rng.normal(1.0, 0.01, (2, 3, 30))
    many = laws_of(controllers, T, NO_JACOBIANS)(wanted, measured[:, :24])
    for k, controller in enumerate(controllers):
        single = laws_of([controller], T, NO_JACOBIANS)(wanted[k : k + 1], measured[k : k + 1, :24])
        assert single.state.any()
        assert single.state[0].tobytes() == np.ascontiguousarray(many.state[k]).tobytes()
