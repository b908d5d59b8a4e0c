"""The covariance of innovations: white noise of forces and lengths through the filters and the corrected simulation.

In leg coordinates the α-β filter has innovations ε with

    d_k = ε_{k+1} − (2 − α − β) ε_k + (1 − α) ε_{k−1} = n_{k+1} − 2 n_k + n_{k−1} − (h²/3) A (f_{k−½} + f_k + f_{k+½})

n and f the filtered noises of lengths and forces, A = J M⁻¹ Jᵀ the mobility of the legs; the forces are those of the
parabola through three of them. So A⁻¹ d/h², the force that explains few innovations, has a block-banded covariance, as
the rows of the linear method have. Friction within a step is neglected in it. Where a leg reverses, forces that are
low-passed and friction that is not differ, for that leg alone: its steps there are left out.
"""

import numpy as np

from gough_stewart.harness.identify.noise import KernelCorrelations, TwoNoises, kernel_correlations, two_noises
from gough_stewart.harness.identify.smoothing import kernel_of
from gough_stewart.model.vectors import FloatArray


def unexplained_forces(innovations: FloatArray, alpha: float, beta: float, apparent: FloatArray) -> FloatArray:
    """A⁻¹ d/h² (n − 2, 6, k) of innovations (n, 6, k), with A⁻¹/h² at the inner steps (n − 2, 6, 6)."""
    e = innovations
    return np.asarray(apparent @ (e[2:] - (2 - alpha - beta) * e[1:-1] + (1 - alpha) * e[:-2]))


def difference_correlations(sample_time: float, cutoff: float, every: int) -> KernelCorrelations:
    """Correlations of A⁻¹ d/h² for unit noise of forces, and of d for unit noise of lengths.

    Parameters
    ----------
    sample_time
        Of the raw signals [s].
    cutoff
        Of their low-pass [Hz].
    every
        Samples of a step; even.
    """
    kernel = kernel_of(sample_time, cutoff)
    force, length = (np.zeros(len(kernel) + 2 * every) for _ in range(2))
    for shift in (every // 2, every, 3 * every // 2):
        force[shift : shift + len(kernel)] += kernel / 3
    for shift, weight in ((0, 1.0), (every, -2.0), (2 * every, 1.0)):
        length[shift : shift + len(kernel)] += weight * kernel
    return kernel_correlations(force, length[None], every)


def difference_noise(
    correlations: KernelCorrelations, apparent: FloatArray, force: FloatArray, length: float, used: FloatArray
) -> TwoNoises:
    """The covariance of the unexplained forces at n steps, by noise of forces and of lengths.

    Parameters
    ----------
    apparent
        A⁻¹/h² (n, 6, 6) [N/m].
    force, length
        Standard deviations of the raw forces (6,) [N] and lengths [m].
    used
        1 for steps of a leg that are used, else 0 (n, 6).
    """
    return two_noises(correlations, apparent[:, :, None, :], force, length, used)
