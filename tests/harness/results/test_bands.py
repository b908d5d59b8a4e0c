"""Quantiles over time of many runs, against those of the trajectories themselves."""

import numpy as np
import pytest

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.loop.observing import Row
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.results.bands import Bands, bands_frame, together
from gough_stewart.model.vectors import FloatArray

N, STEPS = 37, 50
TIMING = Timing(STEPS * 2e-3, 4e-3, 2e-3)
RNG = np.random.default_rng(4)
SIGNALS, FORCES, WANTED = (RNG.normal(size=(STEPS + 1, N, size)) for size in (24, 12, 30))
# Members that end early, in no order.
ENDS = np.where(np.arange(N) % 5 == 2, 13 + np.arange(N), STEPS + 1)


def run(bands: Bands, members: slice = slice(None)) -> Bands:
    for k in range(STEPS + 1):
        flags = np.zeros((N, 6), dtype=bool)
        bands.row(
            Row(
                k,
                0.0,
                SIGNALS[k, members],
                FORCES[k, members],
                WANTED[k, members],
                FORCES[k, members, :6],
                flags,
                flags,
                (k < ENDS)[members],
            )
        )
    return bands


def wanted_of(name: str) -> FloatArray:
    """The trajectories (rows, N) that a column is of."""
    if name == "error.position.norm":
        gap = WANTED[..., :3] - SIGNALS[..., :3]
        return np.asarray(np.linalg.norm(gap, axis=-1))
    if name == "error.leg_length[2]":
        return np.asarray(WANTED[..., 13] - SIGNALS[..., 13])
    return np.asarray({"orientation[3]": SIGNALS[..., 5], "actuator_force[4]": FORCES[..., 3]}[name])


def test_quantiles_and_extremes_are_those_of_the_members_that_still_run() -> None:
    """Expected: the quantiles of the trajectories, time by time, by the median and by sorting."""
    names = ("orientation", "actuator_force", "error.position.norm", "error.leg_length")
    samples = run(Bands(names, TIMING, N, times=11)).samples()
    frame = bands_frame(samples)
    assert samples.time.tolist() == pytest.approx([k * 0.01 for k in range(11)])
    for name in ("orientation[3]", "actuator_force[4]", "error.position.norm", "error.leg_length[2]"):
        found = frame.filter(frame["signal"] == name).sort("time")
        for k, row in enumerate(range(0, STEPS + 1, 5)):
            values = np.sort(wanted_of(name)[row, row < ENDS])
            assert found["running"][k] == len(values)
            assert (found["lowest"][k], found["highest"][k]) == (values[0], values[-1])
            assert found["q50"][k] == pytest.approx(np.median(values), rel=1e-14)
            place = 0.05 * (len(values) - 1)
            low = values[int(place)] + (place % 1) * (values[int(place) + 1] - values[int(place)])
            assert found["q05"][k] == pytest.approx(low, rel=1e-13)


def test_chunks_of_members_make_the_same_bands_as_all_at_once() -> None:
    """Expected: the bands of all members in one."""
    names = ("position", "error.orientation.norm")
    whole = bands_frame(run(Bands(names, TIMING, N)).samples())
    parts = [slice(0, 20), slice(20, N)]
    chunks = [run(Bands(names, TIMING, part.stop - part.start, part.start), part).samples() for part in parts]
    assert bands_frame(together(chunks)).equals(whole)


def test_beyond_ten_thousand_members_quantiles_are_of_the_first_and_extremes_of_all() -> None:
    """Expected: members 9,990 to 10,026 keep the samples of the first ten of them, and all extremes."""
    bands = run(Bands(("position",), TIMING, N, first=9_990)).samples()
    assert bands.values.shape[2] == 10
    assert bands.highest[0].tolist() == SIGNALS[0, :, :3].max(axis=0).tolist()


def test_a_signal_that_is_none_is_refused_with_the_nearest_name() -> None:
    """Expected: the name and the one that was meant."""
    with pytest.raises(RecordError, match=r"no signal 'error\.positon'.*error\.position"):
        Bands(("error.positon",), TIMING)
