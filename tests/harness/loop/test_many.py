"""Many members in one loop, against single runs of each of them in a loop of its own."""

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.pid import pid, sampled
from tests.support.members import (
    FEATURES,
    T,
    alone,
    assert_same,
    gains_of_member,
    jacobians_of,
    law_of_member,
    member_of,
    side_by_side,
)


@settings(max_examples=8, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(features=st.sets(st.sampled_from(FEATURES)))
def test_members_are_single_runs_of_theirs_to_the_last_bit(features: set[str]) -> None:
    """Expected: a loop of one member alone, whatever is on; functions, whose arithmetic is the same in both."""
    some = [member_of(k, law_of_member(k), sorted(features)) for k in range(5)]
    many = side_by_side(some)
    for k, each in enumerate(some):
        assert_same(many, k, alone(each))


def test_with_everything_on_members_are_single_runs_of_theirs() -> None:
    some = [member_of(k, law_of_member(k), FEATURES) for k in range(7)]
    many = side_by_side(some)
    for k, each in enumerate(some):
        assert_same(many, k, alone(each))


@pytest.mark.parametrize("space", ["leg", "task"])
@pytest.mark.parametrize("integral", [False, True])
@pytest.mark.parametrize("features", [[], FEATURES])
def test_linear_laws_side_by_side_are_those_of_single_runs(space: Any, integral: bool, features: list[str]) -> None:
    """Expected: the same to 1e-10 of the largest number, as products are summed up in another order.

    Without quantisation, whose steps would make much of a last bit.
    """
    on = [each for each in features if each != "quantisation"]
    some = []
    for k in range(6):
        system = sampled(pid(gains_of_member(k, integral), "error" if k % 2 else "measurement"), T)
        some.append(member_of(k, LinearController(system, space=space), on))
    J = np.stack([jacobians_of(k) for k in range(6)], axis=1)
    many = side_by_side(some, J)
    for k, each in enumerate(some):
        assert_same(many, k, alone(each, J[:, k]), 1e-10)


@pytest.mark.parametrize("space", ["leg", "task"])
def test_members_have_the_same_bits_in_any_company_and_order(space: Any) -> None:
    """Expected: bits of the batch of all; alone in a batch, in another order, among copies."""

    def run_of(numbers: list[int]) -> Any:
        systems = {k: sampled(pid(gains_of_member(k)), T) for k in numbers}
        J = np.stack([jacobians_of(k) for k in numbers], axis=1)
        some = [member_of(k, LinearController(systems[k], space=space), FEATURES) for k in numbers]
        return side_by_side(some, J)

    everyone = run_of([0, 1, 2, 3, 4, 5])
    for numbers in ([3], [5, 2, 0], [1, 1, 4, 1, 1, 1, 1, 1]):
        others = run_of(numbers)
        for at, k in enumerate(numbers):
            assert others.results[:, at].tobytes() == everyone.results[:, k].tobytes()
            assert others.command[:, at].tobytes() == everyone.command[:, k].tobytes()
            assert others.controller_state[:, at].tobytes() == everyone.controller_state[:, k].tobytes()
            assert others.inputs[:, at].tobytes() == everyone.inputs[:, k].tobytes()
            assert others.outcomes[at] == everyone.outcomes[k]
