"""Distributions: their quantile functions against scipy's, draws against them by Kolmogorov and Smirnov."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from gough_stewart.harness.sampling.variation import Variation, VariedValue

MASS = VariedValue("platform_mass", "kg", (), np.array(120.0))
U = np.random.default_rng(3).random((4000, 1))
SCIPY = {
    "normal": ({"normal": ["130 kg", 7]}, stats.norm(130, 7)),
    "normal about the present value": ({"normal": "400 g"}, stats.norm(120, 0.4)),
    "uniform": ({"uniform": [100, "0.14 t"]}, stats.uniform(100, 40)),
    "uniform about the present value": ({"uniform": "3 kg"}, stats.uniform(117, 6)),
    "truncated": ({"truncated_normal": [125, 10, 110, 150]}, stats.truncnorm(-1.5, 2.5, 125, 10)),
    "truncated about the present value": ({"truncated_normal": [4, 6]}, stats.truncnorm(-1.5, 1.5, 120, 4)),
    "truncated far up": ({"truncated_normal": [0, 1, 9, 12]}, stats.truncnorm(9, 12, 0, 1)),
    "lognormal": ({"lognormal": ["110 kg", 0.3]}, stats.lognorm(0.3, scale=110)),
    "lognormal about the present value": ({"lognormal": 0.2}, stats.lognorm(0.2, scale=120)),
    "factor": ({"factor": {"uniform": [0.8, 1.3]}}, stats.uniform(96, 60)),
    "offset": ({"offset": {"normal": ["1 kg", "2 kg"]}}, stats.norm(121, 2)),
}


@pytest.mark.parametrize("what", SCIPY)
def test_draws_have_the_distribution_of_scipy(what: str) -> None:
    """Expected: scipy's quantiles at the same probabilities, and no more distance from its distribution than chance."""
    table, reference = SCIPY[what]
    drawn = np.ravel(Variation.model_validate(table).spread(MASS).draw(U))
    assert np.allclose(drawn, reference.ppf(U[:, 0]), rtol=1e-9)
    assert stats.kstest(drawn, reference.cdf).pvalue > 1e-3
    assert abs(drawn.mean() - reference.mean()) < 5 * reference.std() / np.sqrt(len(U))


def test_a_spread_of_points_is_per_joint_and_axis() -> None:
    """Expected: 18 independent deviations of 0.2 mm about the points that are there."""
    points = np.random.default_rng(5).normal(size=(6, 3))
    spread = Variation.model_validate({"normal": "0.2 mm"}).spread(VariedValue("base_points", "m", (6, 3), points))
    assert spread.size == 18
    off = (np.asarray(spread.draw(np.random.default_rng(6).random((5000, 18)))) - points).reshape(-1, 18)
    assert np.allclose(off.std(axis=0), 2e-4, rtol=0.05)
    assert np.abs(np.corrcoef(off.T) - np.eye(18)).max() < 0.06


def test_a_factor_is_one_for_all_elements() -> None:
    """Expected: every member's inertia is a multiple of the present one."""
    J = np.diag([3.0, 4.0, 6.0]) + 0.1
    spread = Variation.model_validate({"factor": {"uniform": [0.5, 2]}}).spread(VariedValue("J", "kg.m2", (3, 3), J))
    ratio = np.asarray(spread.draw(U[:50])) / J
    assert spread.size == 1
    assert np.allclose(ratio, 0.5 + 1.5 * U[:50, :, None])


def test_a_symmetric_matrix_stays_symmetric() -> None:
    J = np.diag([3.0, 4.0, 6.0])
    target = VariedValue("J", "kg.m2", (3, 3), J, is_symmetric=True)
    drawn = np.asarray(
        Variation.model_validate({"normal": 0.1}).spread(target).draw(np.random.default_rng(1).random((9, 9)))
    )
    assert (drawn == np.swapaxes(drawn, 1, 2)).all()
    assert len(np.unique(drawn[0])) == 6


def test_a_choice_takes_each_value_as_often_and_as_it_is() -> None:
    """Expected: a third each within five standard errors; whole numbers stay whole, texts texts."""
    drawn = Variation.model_validate({"choice": [0, 1, 5]}).spread(VariedValue("delay", None, (), None)).draw(U)
    assert {type(each) for each in drawn} == {int}
    shares = np.array([drawn.count(value) for value in (0, 1, 5)]) / len(U)
    assert np.abs(shares - 1 / 3).max() < 5 * np.sqrt(2 / 9 / len(U))
    texts = Variation.model_validate({"choice": ["gravity", "none"]}).spread(VariedValue("f", None, (), None)).draw(U)
    assert set(texts) == {"gravity", "none"}


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no spread": ({"normal": [120, 0]}, "without a spread; expected a standard deviation > 0"),
    "negative": ({"normal": "-1 kg"}, "without a spread"),
    "turned round": ({"uniform": [5, 4]}, "expected the lower bound below the upper one"),
    "one value": ({"choice": [4, "4 kg"]}, "without a spread; expected at least two values that differ"),
    "empty grid": ({"grid": []}, "grid has no values"),
    "unit": ({"normal": ["120 kg", "10 mm"]}, "found the unit 'mm'"),
    "three": ({"normal": [1, 2, 3]}, "expected [mean, standard deviation], or"),
    "nested": ({"factor": {"factor": {"uniform": [1, 2]}}}, "factor of a factor"),
    "median": ({"lognormal": [-3, 1]}, "has the median -3.0; expected a median > 0"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_no_distribution_is_refused(what: str) -> None:
    table, message = WRONG[what]
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the text is what is looked at
        Variation.model_validate(table).spread(MASS)
    assert message in str(caught.value)


def test_about_nothing_there_is_no_deviation() -> None:
    with pytest.raises(ValueError, match="no value to vary about"):
        Variation.model_validate({"normal": 2}).spread(VariedValue("leg_length_max", "m", (), None))
    with pytest.raises(ValueError, match="expected choice or grid"):
        Variation.model_validate({"normal": [2, 1]}).spread(VariedValue("delay", None, (), None))


@settings(deadline=None)
@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.floats(0.001, 0.999))
def test_a_table_says_the_same_after_a_round_trip(mean: float, deviation: float, u: float) -> None:
    """Expected: what pydantic writes reads back to the same draws."""
    once = Variation.model_validate({"normal": [mean, deviation]})
    again = Variation.model_validate(once.model_dump(exclude_unset=True))
    at = np.array([[u]])
    assert (np.asarray(once.spread(MASS).draw(at)) == np.asarray(again.spread(MASS).draw(at))).all()
