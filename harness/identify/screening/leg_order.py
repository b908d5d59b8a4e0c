"""Whether two legs' forces are in each other's columns."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from gough_stewart.harness.errors import LogError
from gough_stewart.harness.identify.log import Part, force_of, sample_time_of
from gough_stewart.harness.identify.regression import cutoff_of, edge, smoothed
from gough_stewart.harness.identify.regressor import motion_of_lengths
from gough_stewart.model.dynamics import inverse_dynamics
from gough_stewart.model.platform import Platform

# Lengths and forces are low-passed at this share of the rows' cut-off, just above the motion.
_OF_CUTOFF = 1 / 8
_ROWS_A_PERIOD = 10
# Two forces are exchanged if what the motion does not explain of them falls to this share, and was at least so much.
_FALLS_TO, _AT_LEAST = 0.25, 0.05


def check_order_of_forces(parts: Sequence[Part], platform: Platform, cutoff: float | None = None) -> None:
    """Refuse logs in which two legs' forces follow each other's motion instead of their own.

    The forces of the nominal platform along the motion, up to an offset and a factor, are compared with those of the
    log, r² leg by leg. Masses that are not nominal hardly matter; legs that move alike are not told apart.

    Raises
    ------
    LogError
        Names the two legs.
    """
    measured, expected = [], []
    for part in parts:
        h = sample_time_of(part.log)
        low = _OF_CUTOFF * (cutoff_of(part.log.leg_length, h) if cutoff is None else cutoff)
        every = max(1, int(1 / (_ROWS_A_PERIOD * low * h)))
        if len(part.log) <= 2 * edge(h, low) + 10 * every:
            continue
        motion = motion_of_lengths(platform, *(smoothed(part.log.leg_length, h, low, every, k) for k in range(3)))
        expected.append(np.asarray(inverse_dynamics(platform, *motion)))
        measured.append(smoothed(force_of(part.log), h, low, every))
    if not measured:
        return
    both = np.concatenate([np.concatenate(measured), np.concatenate(expected)], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        unexplained = 1 - np.nan_to_num(np.corrcoef(both.T)[:6, 6:]) ** 2
    for i, j in combinations(range(6), 2):
        now, exchanged = unexplained[[i, j], [i, j]], unexplained[[i, j], [j, i]]
        if now.min() > _AT_LEAST and exchanged.max() < _FALLS_TO * now.min():
            raise LogError(
                f"{parts[0].log.where}: the forces of legs {i + 1} and {j + 1} look exchanged: the motion leaves "
                f"{100 * now.min():.0f} % and more of their changes unexplained, but {100 * exchanged.max():.2g} % and "
                "less if each is the other's; exchange the columns of these forces, or of these lengths"
            )
