"""Quantiles over time of many runs, against those of the trajectories themselves."""

import numpy as np
import polars
import pytest

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.loop.folding import FoldsOfRows
from gough_stewart.harness.loop.loop import Loop
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.results.bands import (
    MOST_KEPT,
    Bands,
    BandSamples,
    bands_frame,
    joined_samples,
    samples_frame,
)
from gough_stewart.model.vectors import FloatArray
from tests.support.orientations import rotation_vectors
from tests.support.rows import pass_rows

N, STEPS = 37, 50
TIMING = Timing(STEPS * 2e-3, 4e-3, 2e-3)
RNG = np.random.default_rng(4)
SIGNALS, FORCES, WANTED = (RNG.normal(size=(STEPS + 1, N, size)) for size in (24, 12, 30))
# Members that end early, in no order.
ENDS = np.where(np.arange(N) % 5 == 2, 13 + np.arange(N), STEPS + 1)


def run(bands: Bands, members: slice = slice(None)) -> Bands:
    """The bands of members in a run of random numbers."""
    loop = Loop(TIMING, WANTED[:, members], np.zeros((26, 6)), np.zeros(6))
    rows = FoldsOfRows(loop, [bands], len(ENDS[members]))
    flags = np.zeros((len(ENDS[members]), 6), dtype=bool)
    given = ((SIGNALS[k, members], FORCES[k, members], flags, flags) for k in range(STEPS + 1))
    pass_rows(rows, TIMING, given, ENDS[members])
    assert rows.results() == {}
    return bands


# Where a row of all signals and references has its variables, and how many numbers they are.
PLACES = {
    "position": (0, 3),
    "orientation": (3, 3),
    "velocity": (6, 3),
    "angular_velocity": (9, 3),
    "leg_length": (12, 6),
    "leg_velocity": (18, 6),
}
NAMES = (
    *PLACES,
    "actuator_force",
    "error.position",
    "error.orientation",
    "error.leg_length",
    "error.position.norm",
    "error.orientation.norm",
)


def wanted_of(name: str) -> dict[str, FloatArray]:
    """The trajectories (rows, N) of a name's columns."""
    if name == "actuator_force":
        return {f"{name}[{k + 1}]": FORCES[..., k] for k in range(6)}
    start, size = PLACES[name.removeprefix("error.").removesuffix(".norm")]
    part = slice(start, start + size)
    values = WANTED[..., part] - SIGNALS[..., part] if name.startswith("error.") else SIGNALS[..., part]
    if name.startswith("error.orientation"):
        values = rotation_vectors(SIGNALS[..., part], WANTED[..., part])
    if name.endswith(".norm"):
        return {name: np.sqrt((values**2).sum(axis=-1))}
    return {f"{name}[{k + 1}]": values[..., k] for k in range(size)}


def test_quantiles_and_extremes_are_those_of_the_members_that_still_run() -> None:
    """Expected: the quantiles of the trajectories, time by time, by sorting; all columns of all names in order."""
    samples = run(Bands(NAMES, TIMING, N, times=11)).samples()
    frame = bands_frame(samples)
    assert samples.time.tolist() == pytest.approx([k * 0.01 for k in range(11)])
    expected = {column: values for name in NAMES for column, values in wanted_of(name).items()}
    assert frame["signal"].to_list() == [*expected] * 11
    assert frame["time"].to_list() == pytest.approx(np.repeat(samples.time, len(expected)).tolist())
    levels = {"q05": 0.05, "q25": 0.25, "q50": 0.5, "q75": 0.75, "q95": 0.95}
    assert frame.columns == ["time", "signal", "running", "lowest", *levels, "highest"]
    for name, trajectories in expected.items():
        found = frame.filter(frame["signal"] == name)
        for k, row in enumerate(range(0, STEPS + 1, 5)):
            values = np.sort(trajectories[row, row < ENDS])
            assert found["running"][k] == len(values)
            assert (found["lowest"][k], found["highest"][k]) == pytest.approx((values[0], values[-1]), rel=1e-14)
            for quantile, level in levels.items():
                place = level * (len(values) - 1)
                low, share = int(place), place % 1
                value = values[low] + (share * (values[low + 1] - values[low]) if share else 0.0)
                assert found[quantile][k] == pytest.approx(value, rel=1e-12), (name, quantile)


def test_values_that_are_not_finite_count_as_none() -> None:
    """Expected: the other members' numbers; none where nobody has one; no error without a reference."""
    bands, flags = Bands(("velocity", "error.leg_length"), TIMING, 3, times=51), np.zeros((3, 6), dtype=bool)
    signals = np.arange(72.0).reshape(3, 24)
    signals[1, 6], signals[:, 7] = np.inf, np.nan
    rows = FoldsOfRows(Loop(TIMING, None, np.zeros((26, 6)), np.zeros(6)), [bands], 3)
    given = ((signals + 100 * (7 - k), FORCES[0, :3], flags, flags) for k in range(8))
    pass_rows(rows, TIMING, given, [8, 8, 8])
    rows.results()
    frame = bands_frame(bands.samples()).filter(polars.col("time") == 7 * 2e-3)
    first, second, third, *errors = frame.iter_rows(named=True)
    assert (first["lowest"], first["q25"], first["q50"], first["highest"]) == (6.0, 18.0, 30.0, 54.0)
    assert {second[name] for name in ("lowest", "q05", "q50", "highest")} == {None}
    assert (third["lowest"], third["q50"], third["highest"], third["running"]) == (8.0, 32.0, 56.0, 3)
    assert [each["signal"] for each in errors] == [f"error.leg_length[{k}]" for k in range(1, 7)]
    assert {each["q50"] for each in errors} == {None}


@pytest.mark.parametrize(("steps", "most"), [(7, 200), (199, 200), (200, 200), (1237, 200), (50, 11)])
def test_times_are_spread_from_the_first_row_to_the_last(steps: int, most: int) -> None:
    """Expected: all rows if they are few enough; else so many, with gaps that differ by one row at most."""
    samples = Bands(("position",), Timing(steps * 2e-3, 2e-3, 2e-3), times=most).samples()
    rows = np.round(samples.time / 2e-3).astype(int)
    assert (rows[0], rows[-1]) == (0, steps)
    assert len(rows) == min(most, steps + 1)
    assert np.ptp(np.diff(rows)) <= 1


def test_chunks_of_members_make_the_same_bands_as_all_at_once() -> None:
    """Expected: the bands of all members in one."""
    names = ("position", "error.orientation.norm")
    whole = bands_frame(run(Bands(names, TIMING, N)).samples())
    parts = [slice(0, 20), slice(20, N)]
    chunks = [run(Bands(names, TIMING, part.stop - part.start, part.start), part).samples() for part in parts]
    assert bands_frame(joined_samples(chunks)).equals(whole)


def test_beyond_ten_thousand_members_quantiles_are_of_the_first_and_extremes_of_all() -> None:
    """Expected: members 9,990 to 10,026 keep the samples of the first ten of them, and all extremes."""
    bands = run(Bands(("position",), TIMING, N, first=9_990)).samples()
    assert bands.values.shape[2] == 10
    assert bands.highest[0].tolist() == SIGNALS[0, :, :3].max(axis=0).tolist()


def test_a_signal_that_is_none_is_refused_with_the_nearest_name() -> None:
    """Expected: the name and the one that was meant."""
    with pytest.raises(RecordError, match=r"no signal 'error\.positon'.*error\.position"):
        Bands(("error.positon",), TIMING)


def test_samples_are_those_of_the_first_members_that_ran_by_their_numbers() -> None:
    """Expected: the values themselves, member by member; of more times every other one, with both ends."""
    rng = np.random.default_rng(8)
    values = rng.normal(size=(201, 2, 3))
    values[120:, :, 1] = np.nan
    time = np.linspace(0, 4, 201)
    samples = BandSamples(time, ("a", "b"), values, values[..., 0], values[..., 0], np.full(201, 3))
    # member 1 was impossible
    frame = samples_frame(samples, [0, 2, 5])
    assert frame["member"].to_list() == [0] * 101 + [2] * 101 + [5] * 101
    for k, member in enumerate((0, 2, 5)):
        own = frame.filter(polars.col("member") == member)
        assert own["time"].to_numpy() == pytest.approx(time[::2])
        for column, name in enumerate("ab"):
            assert own[name].fill_null(np.nan).to_numpy() == pytest.approx(
                values[::2, column, k], rel=1e-6, nan_ok=True
            )
    many = BandSamples(time[:2], ("a",), np.zeros((2, 1, 1500)), np.zeros((2, 1)), np.zeros((2, 1)), np.full(2, 1500))
    assert samples_frame(many, range(1500))["member"].max() == MOST_KEPT - 1
