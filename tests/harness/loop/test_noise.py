"""White noise: its numbers by a second Philox in Python, their distribution, and their independence."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from numpy.random import SeedSequence
from scipy import stats

import gough_stewart as gs
from gough_stewart.harness.loop.loop import Sensors
from gough_stewart.harness.loop.python_host import standard_normal, streams_of
from gough_stewart.harness.loop.timing import Seed
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.kinds import PlantKind
from gough_stewart.model.vectors import FloatArray
from tests.support.loops import constant, loop_of, run_with

ALL = range(signals.SIZE)
SEEDS: tuple[Seed, ...] = (0, 1, *(SeedSequence(seed, spawn_key=(k,)) for seed in (0, 1) for k in (0, 1, 2, 7, 511)))


def philox(key: list[int], counter: list[int]) -> list[int]:
    """Philox4x32 of ten rounds, after its definition."""
    (k0, k1), (x0, x1, x2, x3) = key, counter
    for _ in range(10):
        (high0, low0), (high1, low1) = (divmod(a * x, 2**32) for a, x in ((0xD2511F53, x0), (0xCD9E8D57, x2)))
        x0, x1, x2, x3 = high1 ^ x1 ^ k0, low1, high0 ^ x3 ^ k1, low0
        k0, k1 = (k0 + 0x9E3779B9) % 2**32, (k1 + 0xBB67AE85) % 2**32
    return [x0, x1, x2, x3]


def number_of(seed: Seed, reading: int, element: int) -> float:
    """The normal number by the definition of its stream, and SciPy's inverse of the distribution."""
    words = (seed if isinstance(seed, SeedSequence) else SeedSequence(seed)).generate_state(4).tolist()
    high, low = divmod(reading, 2**32)
    counter = [low, (high << 16 | element // 4) % 2**32, *words[2:]]
    return float(stats.norm.ppf((philox(words[:2], counter)[element % 4] + 0.5) / 2**32))


@pytest.mark.parametrize(
    ("key", "counter", "expected"),
    [
        ([0, 0], [0, 0, 0, 0], [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
        ([2**32 - 1] * 2, [2**32 - 1] * 4, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
        (
            [0xA4093822, 0x299F31D0],
            [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
        ),
    ],
)
def test_the_second_philox_gives_the_published_answers(key: list[int], counter: list[int], expected: list[int]) -> None:
    """Expected: the known answers of the authors' library Random123."""
    assert philox(key, counter) == expected


def test_numbers_are_those_of_seed_reading_and_element() -> None:
    """Expected: the second Philox and SciPy's inverse, of all elements; readings of days of a live page included."""
    streams = streams_of(SEEDS)
    for reading in (0, 1, 63, 64, 12345, 2**32 - 1, 2**32, 2**33 + 5):
        found = standard_normal(streams, range(reading, reading + 1), ALL)[0]
        expected = np.array([[number_of(seed, reading, element) for seed in SEEDS] for element in ALL])
        np.testing.assert_allclose(found, expected, rtol=2e-7, atol=1e-12)


def test_readings_have_the_noise_of_their_elements() -> None:
    """Expected: σ times the numbers of the stream, for signals of three and six elements, and blocks of readings."""
    deviations = {name: 1e-3 * (k + 1) for k, name in enumerate(signals.NAMES)}
    run = run_with(constant(np.zeros(6)), loop_of(1.51, 0.01, 0.01, sensors=Sensors(deviations, seed=6)))
    noise = run.measured - run.results[:-1, : signals.SIZE]
    for k in (0, 1, 63, 64, 150):
        for name, deviation in deviations.items():
            for element in signals.positions([name]).tolist():
                expected = deviation * number_of(6, k, element)
                assert noise[k, element] == pytest.approx(expected, rel=2e-7, abs=1e-15), (k, element)


def test_a_members_numbers_depend_on_no_company_block_or_order() -> None:
    """Expected: the bits of each stream alone, of one reading and element at a time, in whatever order."""
    together = standard_normal(streams_of(SEEDS), range(130), ALL)
    for k in (0, 7, len(SEEDS) - 1):
        for reading in (129, 0, 64):
            for element in (23, 3, 12):
                alone = standard_normal(streams_of(SEEDS[k]), range(reading, reading + 1), range(element, element + 1))
                assert alone[0, 0, 0] == together[reading, element, k]


def test_both_loops_and_every_size_of_ensemble_have_a_members_noise() -> None:
    """Expected: readings minus the truth of member 5, in machine code and row by row with an FMU, of 8 and 600 members.

    σ is 1e4 times what the two loops' poses differ by.
    """
    clocks = {"loop.duration": 0.1, "loop.sample_time": 0.002, "loop.plant_step": 0.001}
    settings = {**clocks, "sensors": {"noise": {"leg_length": "10 um"}, "quantisation": {}, "seed": 9}}

    def noise(members: int, plant: PlantKind) -> FloatArray:
        table = {"members": members, "platform_mass": {"factor": {"uniform": [0.9, 1.1]}}}
        record = gs.run("heave_step", {**settings, "ensemble": table}, member=5, plant=plant)
        return np.asarray(record["measured.leg_length"] - record["leg_length"])[:-1:2]

    found = noise(8, "model")
    cases: list[tuple[int, PlantKind]] = [(600, "model"), (8, "fmu3")]
    for members, plant in cases:
        assert noise(members, plant) == pytest.approx(found, abs=1e-8)
    expected = [[number_of(SeedSequence(9, spawn_key=(5,)), k, 12 + leg) for leg in range(6)] for k in (0, 1)]
    assert found[:2] == pytest.approx(1e-5 * np.array(expected), abs=1e-8)


def looks_normal(x: FloatArray) -> bool:
    """Whether the first four moments are within five standard errors, and Kolmogorov and Smirnov find nothing at 1e-5.

    The standard errors of mean, variance, third and fourth moment of n normal numbers are those of √(k/n), k = 1, 2,
    15 and 96.
    """
    n = len(x)
    moments = [(x**power).mean() - true for power, true in ((1, 0), (2, 1), (3, 0), (4, 3))]
    errors = np.sqrt(np.array([1, 2, 15, 96]) / n)
    return bool((np.abs(moments) < 5 * errors).all() and stats.kstest(x, "norm").pvalue > 1e-5)


@pytest.mark.parametrize(
    ("spoil", "is_normal"),
    [
        (lambda x: x, True),
        (lambda x: x + 0.01, False),
        (lambda x: 1.01 * x, False),
        (lambda x: np.clip(x, -3.0, 3.0), False),
        (lambda x: x + 0.004 * (x**2 - 1), False),
        (lambda x: np.round(8 * x) / 8, False),
    ],
    ids=["as drawn", "shifted", "wider", "without tails", "skew", "coarse"],
)
def test_numbers_are_normal(spoil: Callable[[FloatArray], FloatArray], is_normal: bool) -> None:
    """Expected: of a million numbers; what is off by 1 % of σ, in scale, skewness or in the tails is seen as well."""
    x = standard_normal(streams_of(SEEDS[2:]), range(4200), ALL).ravel()
    assert len(x) > 1_000_000
    assert looks_normal(spoil(x)) == is_normal


def largest_correlation(x: FloatArray, lags: tuple[int, ...]) -> float:
    """Of columns (n, k), and of their squares, with all others at a lag, but of each with itself at once; in 1/√n."""
    largest = 0.0
    for values in (x, x**2):
        z = (values - values.mean(axis=0)) / values.std(axis=0)
        for lag in lags:
            found = np.abs(z[: len(z) - lag].T @ z[lag:]) / len(z)
            largest = max(largest, float((found - (0 if lag else np.diag(np.diag(found)))).max()))
    return largest * math.sqrt(len(x))


def test_streams_members_elements_and_readings_are_independent() -> None:
    """Expected: at most 6 standard errors, of 12 seeds and members, 24 elements, 5 lags: 830,000 pairs.

    A pair beyond is found by chance once in 600 seeds; n = 20,000 finds a correlation of 0.07 in 9,999 of 10,000 cases,
    as of the planted ones: of a member that has a part of another's noise, and of readings that have one of the last.
    """
    x = standard_normal(streams_of(SEEDS), range(20_000), ALL).reshape(20_000, -1)
    lags = (0, 1, 2, 64, 100)
    assert largest_correlation(x, lags) < 6
    shares = x.copy()
    shares[:, 30] += 0.07 * shares[:, 200]
    assert largest_correlation(shares, (0,)) > 6
    lagging = x.copy()
    lagging[1:, 17] += 0.07 * x[:-1, 17]
    assert largest_correlation(lagging, (0,)) < 6 < largest_correlation(lagging, (1,))


def test_runs_up_and_down_are_those_of_independent_numbers() -> None:
    """Expected: (2n − 1)/3 ± √((16n − 29)/90) runs of rising or falling numbers of each stream (Levene, 1952)."""
    n = 20_000
    for column in standard_normal(streams_of(SEEDS), range(n), range(12, 18)).reshape(n, -1).T:
        rises = np.diff(column) > 0
        runs = 1 + sum(a != b for a, b in pairwise(rises.tolist()))
        assert abs(runs - (2 * n - 1) / 3) < 5 * np.sqrt((16 * n - 29) / 90)
