"""White noise: its numbers by a second Philox in Python, and what a loop makes of it."""

from dataclasses import replace

import control
import numpy as np
import pytest
from numpy.random import SeedSequence
from scipy import stats
from scipy.linalg import solve_discrete_lyapunov

import gough_stewart as gs
from gough_stewart import LinearController
from gough_stewart.harness.control.laws_of_members import laws_of
from gough_stewart.harness.loop.loop import Actuators, Loop, Sensors
from gough_stewart.harness.loop.python_host import standard_normal, streams_of
from gough_stewart.harness.loop.rows import Observer, RowBlock
from gough_stewart.harness.loop.run import observe
from gough_stewart.harness.loop.timing import Seed, Timing
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.kinds import PlantKind
from gough_stewart.harness.plants.lanes import BatchPlant
from tests.support.arrays import FloatArray
from tests.support.loops import constant, loop_of, run_with
from tests.support.uneven import UNEVEN

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


class Last(Observer):
    """Keeps the signals of the last row."""

    def block(self, rows: RowBlock) -> None:
        self.signals = rows.signals[rows.count].T.copy()


def test_the_response_to_white_noise_has_the_covariance_of_the_lyapunov_equation() -> None:
    """Expected: P = Φ P Φᵀ + σ² Γ Γᵀ of the linear loop, plant, controller and a delay of one sample.

    Of N independent Gaussian members the covariance S has the standard error √((P_ij² + P_ii P_jj)/N). Of 78 numbers
    none is farther off than 4.5 of them, which chance passes once in 2,000 seeds; and S is whitened by P, where all
    errors together, of 12 independent directions, tell a few percent of P.
    """
    N, sigma, m, T = 512, 1e-6, 500, 0.002
    platform = replace(UNEVEN, leg_coulomb_friction=0.0)
    K = gs.sampled(gs.pid(gs.gains_from_bandwidth(platform, 2.0, 0.8)), T)
    position, orientation, still = platform.home_position, platform.home_orientation, np.zeros(3)
    force = gs.trim(platform).inputs[:6]
    lengths = gs.leg_geometry(platform, position, orientation).length
    wanted = np.concatenate([position, orientation, np.zeros(6), lengths, np.zeros(12)])
    loop = Loop(
        Timing(m * T, T, T),
        np.tile(wanted, (m + 1, 1)),
        np.tile(force, (m, 1)),
        force,
        Sensors({"leg_length": sigma}, seed=tuple(SeedSequence(20).spawn(N))),
        Actuators(delay=1),
        shape=(N,),
    )
    plant = BatchPlant([platform] * N, [gs.State(position, orientation, still, still)] * N, substeps=1)
    last = Last()
    outcomes = observe(plant, laws_of([LinearController(K)] * N, T, np.zeros((0, 6, 6))), loop, last)
    assert {outcome.status for outcome in outcomes} == {"completed"}

    linear = gs.linearise(platform, outputs=("leg_length",))
    held = control.sample_system(control.ss(linear.A, linear.B[:, :6], linear.C, linear.D[:, :6]), T)
    A, B, C, By, Dy = held.A, held.B, held.C, K.B[:, 6:12], K.D[:, 6:12]
    # states: of the plant, of the controller, and the command that is on its way
    Phi = np.block([[A, np.zeros((12, 6)), B], [By @ C, K.A, np.zeros((6, 6))], [Dy @ C, K.C, np.zeros((6, 6))]])
    Gamma = np.vstack([np.zeros((12, 6)), By, Dy])
    P = solve_discrete_lyapunov(Phi, sigma**2 * Gamma @ Gamma.T)[:12, :12]
    x = last.signals[:, :12] - wanted[:12]
    S, variance = x.T @ x / N, np.diag(P)
    assert (np.abs(S - P) < 4.5 * np.sqrt((P**2 + np.outer(variance, variance)) / N)).all()
    L_inverse = np.linalg.inv(np.linalg.cholesky(P))
    assert abs(np.trace(L_inverse @ S @ L_inverse.T) / 12 - 1) < 4.5 * np.sqrt(2 / (12 * N))
