"""Linear systems as matrices: sampled as python-control samples them."""

import control
import numpy as np
import pytest

from gough_stewart.harness.control.pid import Gains, pid, sampled
from gough_stewart.harness.control.state_space import METHODS, Method, StateSpace, discretised
from gough_stewart.harness.errors import ControllerError

T = 0.01


@pytest.mark.parametrize("is_diagonal", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_sampling_is_python_controls(method: Method, is_diagonal: bool) -> None:
    """Expected: the matrices of `control.sample_system`, by SciPy; of a system with three inputs and two outputs.

    Its states depend on each other; or each on itself alone, one integrates and one grows.
    """
    rng = np.random.default_rng(3)
    A = np.diag([-30.0, 0.0, 7.0, -110.0]) if is_diagonal else rng.normal(size=(4, 4)) - 20 * np.eye(4)
    B, C, D = rng.normal(size=(4, 3)), rng.normal(size=(2, 4)), rng.normal(size=(2, 3))
    found = discretised(StateSpace(A, B, C, D), T, method)
    expected = control.sample_system(control.ss(A, B, C, D), T, method)
    for name in "ABCD":
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-12, abs=1e-15)
    assert (found.nstates, found.ninputs, found.noutputs, found.dt) == (4, 3, 2, T)


def test_a_system_that_is_sampled_already_is_refused() -> None:
    with pytest.raises(ControllerError, match=r"already discrete \(dt = 0.01 s\); expected a continuous one"):
        sampled(sampled(pid(Gains(100.0, 20.0)), T), T)
