"""Of a design what no table shows: few members, near-copies, and interrupts."""

import signal
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from gough_stewart.harness.sampling.design import SamplingDesign, reordered


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
            SamplingDesign("sobol", 4, 60, ("a",), (3,)).points(0, 3)
    finally:
        signal.signal(signal.SIGINT, before)
    assert made == ["engine"]


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
