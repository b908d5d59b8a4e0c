"""Designs: member k has its numbers, whatever is drawn beside it; each is what it says it is."""

import signal
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from gough_stewart.harness.sampling.correlation import CorrelatedInputs, correlated, correlation_of, reordered
from gough_stewart.harness.sampling.design import Sampling, SamplingDesign, in_turn

NAMES, SIZES, GROUPS = ("a", "b", "c"), (1, 18, 2), ((0,), (1,), (2,))


def design(sampling: Sampling, members: int = 60, seed: int = 4) -> SamplingDesign:
    return SamplingDesign(sampling, seed, members, NAMES, SIZES, GROUPS)


@pytest.mark.parametrize("sampling", ["random", "latin_hypercube", "sobol", "saltelli"])
def test_a_member_is_the_same_alone_and_among_others(sampling: Sampling) -> None:
    whole = design(sampling).points(0, 60)
    assert whole.shape == (60, 21)
    assert ((whole > 0) & (whole < 1)).all()
    for first, last in ((0, 1), (7, 8), (13, 29), (59, 60)):
        assert (design(sampling).points(first, last) == whole[first:last]).all()
    assert not np.isclose(whole, design(sampling, seed=5).points(0, 60)).any(axis=0).all()


def test_random_members_do_not_depend_on_what_else_varies_or_how_many_there_are() -> None:
    some, all_ = SamplingDesign("random", 4, 5, ("b",), (18,)).points(0, 5), design("random", 1000).points(0, 5)
    assert (some == all_[:, 1:19]).all()
    assert stats.kstest(design("random", 1000).points(0, 1000).ravel(), "uniform").pvalue > 1e-3


def test_a_latin_hypercube_has_one_member_in_each_layer() -> None:
    layers = np.floor(design("latin_hypercube").points(0, 60) * 60)
    assert (np.sort(layers, axis=0) == np.arange(60)[:, None]).all()


def test_sobol_points_fill_the_cube_better_than_chance() -> None:
    """Expected: a centred discrepancy far below that of as many random points."""
    sobol, random = (qmc.discrepancy(design(s, 256).points(0, 256)[:, :5]) for s in ("sobol", "random"))
    assert sobol < random / 3


def test_ctrl_c_while_sobol_reads_its_table_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the interrupt, when SciPy has its engine; inside it would be lost, and all points the same."""
    made = list[str]()

    class Sobol(qmc.Sobol):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            signal.raise_signal(signal.SIGINT)
            super().__init__(*arguments, **options)
            made.append("engine")

    monkeypatch.setattr(qmc, "Sobol", Sobol)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            design("sobol").points(0, 3)
    finally:
        signal.signal(signal.SIGINT, before)
    assert made == ["engine"]


def test_saltellis_design_swaps_one_group_after_the_other() -> None:
    """Expected: of five rows each A, A with one group from B, and B, as SALib reads them."""
    rows = design("saltelli", 40).points(0, 40).reshape(8, 5, 21)
    A, B = rows[:, 0], rows[:, 4]
    assert not (A == B).any()
    for group, (start, end) in enumerate(((0, 1), (1, 19), (19, 21))):
        mixed = A.copy()
        mixed[:, start:end] = B[:, start:end]
        assert (rows[:, 1 + group] == mixed).all()


def test_designs_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match=r"members is 61; .*3 inputs plus 2\), expected a multiple, for instance 60"):
        design("saltelli", 61)
    with pytest.raises(ValueError, match="use sampling = 'sobol' or 'random'"):
        design("latin_hypercube", 1_000_000)


def test_grids_go_through_all_combinations() -> None:
    """Expected: counting with the last place fastest, 2 × 3 values, and the rest as it was."""
    u = np.full((13, 3), 0.3)
    done = in_turn(u, [2, None, 3], 6)
    assert (done[:, 1] == 0.3).all()
    assert [(int(2 * a), int(3 * c)) for a, c in done[:6, [0, 2]].tolist()] == [
        (a, c) for a in (0, 1) for c in (0, 1, 2)
    ]
    assert (done[6:12] == done[:6]).all()
    assert (in_turn(u[:1], [2, None, 3], 9) == done[3:4]).all()


R = np.array([[1.0, 0.7, -0.2], [0.7, 1.0, 0.1], [-0.2, 0.1, 1.0]])


def test_a_copula_keeps_the_margins_and_correlates_the_scores() -> None:
    """Expected: uniform columns, and the correlation of their normal scores within its standard error."""
    u = np.random.default_rng(8).random((20_000, 3))
    done = correlated(u, R)
    assert np.abs(np.corrcoef(stats.norm.ppf(done).T) - R).max() < 5 / np.sqrt(len(u))
    assert min(stats.kstest(column, "uniform").pvalue for column in done.T) > 1e-3
    assert (correlated(u[77:78], R) == done[77:78]).all()


@pytest.mark.parametrize("members", [1, 2, 3, 4, 20, 200])
@pytest.mark.parametrize("rho", [-0.4, 0.0, 0.6, 0.999])
def test_a_reordered_design_keeps_each_columns_numbers(members: int, rho: float) -> None:
    """Expected: the same numbers in each column; the correlation, where there are enough members."""
    u = SamplingDesign("latin_hypercube", 3, members, ("x",), (3,)).points(0, members)
    R = np.array([[1.0, rho, 0.0], [rho, 1.0, 0.0], [0.0, 0.0, 1.0]])
    done = reordered(u, R)
    assert (np.sort(done, axis=0) == np.sort(u, axis=0)).all()
    if members == 200:
        assert np.abs(np.corrcoef(stats.norm.ppf(done).T) - R).max() < 0.01
    if rho == 0.999 and members > 3:
        assert stats.spearmanr(done[:, 0], done[:, 1]).statistic > 0.9


NOT_POSITIVE: dict[str, Any] = {
    "indefinite": [[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]],
    "singular": [[1, 1], [1, 1]],
    "negative": [[-1, 0], [0, 1]],
}


@pytest.mark.parametrize("what", NOT_POSITIVE)
def test_a_matrix_that_is_not_positive_definite_is_refused(what: str) -> None:
    matrix = NOT_POSITIVE[what]
    with pytest.raises(ValueError, match="not positive definite"):
        CorrelatedInputs(of=["a", "b", "c"][: len(matrix)], matrix=matrix)


def test_a_covariance_of_very_different_units_is_taken() -> None:
    """Expected: the scaled matrix, by its definition."""
    C = np.diag([1e-4, 1e3]) @ np.array([[1, 0.6], [0.6, 1]]) @ np.diag([1e-4, 1e3])
    assert np.allclose(correlation_of(CorrelatedInputs(of=["a", "b"], matrix=C.tolist()).values), [[1, 0.6], [0.6, 1]])
    with pytest.raises(ValueError, match="not symmetric"):
        CorrelatedInputs(of=["a", "b"], matrix=[[1, 0.5], [0.4, 1]])
    with pytest.raises(ValueError, match="expected different names"):
        CorrelatedInputs(of=["a", "a"], matrix=[[1, 0.5], [0.5, 1]])
