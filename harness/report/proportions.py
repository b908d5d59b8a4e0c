"""Confidence of shares and quantiles that are known from some members only.

Both intervals are exact for members that are drawn independently, whatever their distribution. Members of a Sobol
sequence or a Latin hypercube cover their ranges more evenly; for them the intervals are as a rule too wide.

Members may also come in n independent blocks of b that share their numbers, as in Saltelli's design. Then k members
count as x = k/b blocks, which need not be whole. The share of a block that holds has a variance of at most p (1 − p),
that of blocks whose members are alike: the design effect 1 + (b − 1) ρ of Kish, Survey Sampling (1965), for ρ = 1.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.model.vectors import FloatArray

CONFIDENCE = 0.95
METHOD = "Clopper–Pearson interval, as if {} were drawn independently"


class Interval(NamedTuple):
    """Ends of a confidence interval; None for one that so few members cannot give."""

    low: float | None
    high: float | None


def share_interval(successes: float, members: float, confidence: float = CONFIDENCE) -> Interval:
    """The interval of a share by Clopper & Pearson (1934): quantiles of beta distributions.

    low: I⁻¹(α/2; x, n − x + 1), 0 for x = 0; high: I⁻¹(1 − α/2; x + 1, n − x), 1 for x = n; of x successes among n
    independent members or blocks, of which both may be fractions.
    """
    from scipy.special import betaincinv

    if not 0 <= successes <= members or not members:
        raise ValueError(f"{successes} of {members} members; expected at least one, and no more than all of them")
    tail = (1 - confidence) / 2
    low = 0.0 if successes == 0 else float(betaincinv(successes, members - successes + 1, tail))
    high = 1.0 if successes == members else float(betaincinv(successes + 1, members - successes, 1 - tail))
    return Interval(low, high)


def quantile_interval(
    values: FloatArray, level: float, confidence: float = CONFIDENCE, independent: float | None = None
) -> Interval:
    """The interval of a quantile between two order statistics (N,), without an assumption on the distribution.

    The number B of members below the quantile is binomial: the r-th smallest is a lower end with
    P(B ≤ r − 1) = I(1 − p; n − r + 1, r) ≤ α/2, the s-th an upper one with P(B ≥ s) = I(p; s, n − s + 1) ≤ α/2. Of N
    members that are worth n `independent` ones, all by default, k count as x = k n/N, as in `share_interval`.
    """
    from scipy.special import betainc

    ordered, tail = np.sort(values), (1 - confidence) / 2
    n = len(values) if independent is None else independent
    worth = n / len(values)
    counts = worth * np.arange(1, len(values) + 1)
    below = betainc(n - counts + worth, counts - worth + 1, 1 - level)
    above = betainc(counts, n - counts + 1, level)
    r, s = int(np.count_nonzero(below <= tail)), int(np.count_nonzero(above > tail))
    return Interval(float(ordered[r - 1]) if r > 0 else None, float(ordered[s]) if s < len(values) else None)
