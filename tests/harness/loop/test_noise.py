"""White noise: its numbers by a second Philox in Python, and what a loop makes of it."""

from dataclasses import replace
from typing import Any

import control
import numpy as np
import polars
import pytest
from numpy.random import SeedSequence
from scipy import stats
from scipy.linalg import block_diag, solve_discrete_lyapunov

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.documented_loop import twist_of_rates
from tests.support.uneven import PARAMETERS, UNEVEN
from tests.support.uneven_loops import experiment_of

SIGNALS = ("position", "orientation", "velocity", "angular_velocity", "leg_length", "leg_velocity")


def philox(key: list[int], counter: list[int]) -> list[int]:
    """Philox4x32 of ten rounds, after its definition."""
    (k0, k1), (x0, x1, x2, x3) = key, counter
    for _ in range(10):
        (high0, low0), (high1, low1) = (divmod(a * x, 2**32) for a, x in ((0xD2511F53, x0), (0xCD9E8D57, x2)))
        x0, x1, x2, x3 = high1 ^ x1 ^ k0, low1, high0 ^ x3 ^ k1, low0
        k0, k1 = (k0 + 0x9E3779B9) % 2**32, (k1 + 0xBB67AE85) % 2**32
    return [x0, x1, x2, x3]


def number_of(seed: int | SeedSequence, reading: int, element: int) -> float:
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
    ],
)
def test_the_second_philox_gives_the_published_answers(key: list[int], counter: list[int], expected: list[int]) -> None:
    """Expected: the known answers of the authors' library Random123."""
    assert philox(key, counter) == expected


@pytest.mark.parametrize("seed", [6, 0])
def test_readings_have_the_noise_of_their_elements(seed: int) -> None:
    """Expected: σ times the numbers of seed, reading and element, of signals of three and six elements."""
    deviations = {name: 1e-3 * (k + 1) for k, name in enumerate(SIGNALS)}
    sensors = {"noise": deviations, "seed": seed}
    loop = {"duration": 0.755, "sample_time": 5e-3, "plant_step": 5e-3}
    record = gs.run(experiment_of("pd", loop=loop, sensors=sensors), controller=lambda _sample: np.full(6, 47.0))
    element = 0
    for name, deviation in deviations.items():
        noise = record[f"measured.{name}"] - record[name]
        for column in range(noise.shape[1]):
            for k in (0, 1, 63, 64, 150):
                expected = deviation * number_of(seed, k, element)
                assert noise[k, column] == pytest.approx(expected, rel=2e-7, abs=1e-14), (k, name, column)
            element += 1


def test_every_size_of_ensemble_and_every_plant_have_a_members_noise() -> None:
    """Expected: readings minus the truth of member 5, of 8 and 600 members, and beside an FMU."""
    clocks = {"loop.duration": 0.1, "loop.sample_time": 0.002, "loop.plant_step": 0.001}
    settings = {**clocks, "sensors": {"noise": {"leg_length": "10 um"}, "quantisation": {}, "seed": 9}}

    def noise(members: int, plant: Any) -> FloatArray:
        table = {"members": members, "platform_mass": {"factor": {"uniform": [0.9, 1.1]}}}
        record = gs.run("heave_step", {**settings, "ensemble": table}, member=5, plant=plant)
        return np.asarray(record["measured.leg_length"] - record["leg_length"])[:-1:2]

    numbers = noise(8, "model")
    for members, plant in ((600, "model"), (8, "fmu3")):
        assert noise(members, plant) == pytest.approx(numbers, abs=1e-8)
    expected = [[number_of(SeedSequence(9, spawn_key=(5,)), k, 12 + leg) for leg in range(6)] for k in (0, 1)]
    assert numbers[:2] == pytest.approx(1e-5 * np.array(expected), abs=1e-8)


def test_the_response_to_white_noise_has_the_covariance_of_the_lyapunov_equation() -> None:
    """Expected: P = Φ P Φᵀ + σ² Γ Γᵀ of the linear loop, plant, controller and a delay of one sample.

    Of N independent Gaussian members the covariance S has the standard error √((P_ij² + P_ii P_jj)/N). Of 78 numbers
    none is farther off than 4.5 of them, which chance passes once in 2,000 seeds; and S is whitened by P, where all
    errors together, of 12 independent directions, tell a few percent of P.
    """
    N, sigma, T = 512, 1e-6, 0.002
    platform = replace(UNEVEN, leg_coulomb_friction=0.0)
    K = gs.sampled(gs.pid(gs.gains_from_bandwidth(platform, 2.0, 0.8)), T)
    signals = ["error.position", "error.orientation", "velocity", "angular_velocity"]
    settings = {
        "platform": {"preset": "liu2000", "parameters": {**PARAMETERS, "leg_coulomb_friction": 0.0}},
        "reference": {"type": "hold"},
        "controller": {"type": "python", "feedforward": "gravity"},
        "loop": {"duration": 1.0, "sample_time": T, "plant_step": T, "delay": 1},
        "sensors": {"noise": {"leg_length": sigma}, "seed": 20},
        "ensemble": {"members": N, "signals": signals, "worst": 0},
    }
    samples: Any = gs.ensemble("heave_step", settings, controller=gs.LinearController(K), workers=1).samples
    last = samples.filter(polars.col("time") == samples["time"].max())
    x = last.select([f"{name}[{k}]" for name in signals for k in (1, 2, 3)]).to_numpy().astype(float)

    linear = gs.linearise(platform, outputs=("leg_length",))
    held = control.sample_system(control.ss(linear.A, linear.B[:, :6], linear.C, linear.D[:, :6]), T)
    A, B, C, By, Dy = held.A, held.B, held.C, K.B[:, 6:12], K.D[:, 6:12]
    # states: of the plant, of the controller, and the command that is on its way
    Phi = np.block([[A, np.zeros((12, 6)), B], [By @ C, K.A, np.zeros((6, 6))], [Dy @ C, K.C, np.zeros((6, 6))]])
    Gamma = np.vstack([np.zeros((12, 6)), By, Dy])
    P = solve_discrete_lyapunov(Phi, sigma**2 * Gamma @ Gamma.T)[:12, :12]
    # of angles as rotations, and with the signs of errors
    home = np.concatenate([platform.home_position, platform.home_orientation])
    shown = block_diag(-twist_of_rates(home), np.eye(6))
    P = shown @ P @ shown.T
    S, variance = x.T @ x / N, np.diag(P)
    assert (np.abs(S - P) < 4.5 * np.sqrt((P**2 + np.outer(variance, variance)) / N)).all()
    L_inverse = np.linalg.inv(np.linalg.cholesky(P))
    assert abs(np.trace(L_inverse @ S @ L_inverse.T) / 12 - 1) < 4.5 * np.sqrt(2 / (12 * N))
