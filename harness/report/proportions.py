"""Confidence of shares and quantiles that are known from some members only.

Both intervals are exact for members that are drawn independently, whatever their distribution. Members of a Sobol
sequence or a Latin hypercube cover their ranges more evenly; for them the intervals are as a rule too wide.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.model.vectors import FloatArray

CONFIDENCE = 0.95
METHOD = "Clopper–Pearson interval, as if members were drawn independently"


class Interval(NamedTuple):
    """Ends of a confidence interval; None for one that so few members cannot give."""

    low: float | None
    high: float | None


def share_interval(successes: int, members: int, confidence: float = CONFIDENCE) -> Interval:
    """The interval of a share by Clopper & Pearson (1934): quantiles of beta distributions.

    low: I⁻¹(α/2; k, n − k + 1), 0 for k = 0; high: I⁻¹(1 − α/2; k + 1, n − k), 1 for k = n.

    Raises
    ------
    ValueError
        No members, or more successes than members.
    """
    from scipy.special import betaincinv

    if not 0 <= successes <= members or not members:
        raise ValueError(
            f"{successes} of {members} members; expected at least one member, and no more than all of them"
        )
    tail = (1 - confidence) / 2
    low = 0.0 if successes == 0 else float(betaincinv(successes, members - successes + 1, tail))
    high = 1.0 if successes == members else float(betaincinv(successes + 1, members - successes, 1 - tail))
    return Interval(low, high)


def quantile_interval(values: FloatArray, level: float, confidence: float = CONFIDENCE) -> Interval:
    """The interval of a quantile between two order statistics (n,), without an assumption on the distribution.

    The number of members below the quantile is binomial: the r-th smallest is a lower end with
    P(B ≥ r) ≥ 1 − α/2, the s-th an upper one with P(B ≤ s − 1) ≥ 1 − α/2.
    """
    from scipy.special import bdtr

    ordered, n, tail = np.sort(values), len(values), (1 - confidence) / 2
    # P(B <= k) for k = 0 … n
    cumulative = bdtr(np.arange(n + 1.0), n, level)
    r = int(np.searchsorted(cumulative, tail, side="right"))  # the largest r with P(B <= r - 1) <= tail
    s = int(np.searchsorted(cumulative, 1 - tail)) + 1  # the smallest s with P(B <= s - 1) >= 1 - tail
    return Interval(float(ordered[r - 1]) if r > 0 else None, float(ordered[s - 1]) if s <= n else None)
