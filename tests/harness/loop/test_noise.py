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


@pytest.mark.parametrize(("seed", "every"), [(6, 1), (0, 1), (6, 2)], ids=["seed 6", "seed 0", "slower encoders"])
def test_readings_have_the_noise_of_their_elements(seed: int, every: int) -> None:
    """Expected: σ times the numbers of seed, reading and element, of signals of three and six elements; then steps."""
    deviations, coarse = {name: 1e-3 * (k + 1) for k, name in enumerate(SIGNALS)}, "leg_velocity"
    sensors: dict[str, Any] = {"noise": deviations, "seed": seed, "quantisation": {coarse: 2e-3}}
    sensors |= {"sample_time": every * 5e-3} if every > 1 else {}
    loop = {"duration": 0.755, "sample_time": 5e-3, "plant_step": 5e-3}
    record = gs.run(experiment_of("pd", loop=loop, sensors=sensors), controller=lambda _sample: np.full(6, 47.0))
    element = 0
    for name, deviation in deviations.items():
        read, true = record[f"measured.{name}"], record[name]
        for column in range(read.shape[1]):
            for k in (0, 1, 63, 64, 150):
                reading = true[k // every * every, column] + deviation * number_of(seed, k // every, element)
                expected = 2e-3 * np.round(reading / 2e-3) if name == coarse else reading
                assert read[k, column] == pytest.approx(expected, abs=1e-6 * deviation), (k, name, column)
            element += 1


@pytest.mark.parametrize("plant", ["model", "fmu3"])
def test_a_member_has_the_noise_of_its_own_stream(plant: Any) -> None:
    """Expected: σ times the numbers of the ensemble's seed and the member, on both plants."""
    table = {"members": 600, "platform_mass": {"factor": {"uniform": [0.9, 1.1]}}}
    settings: dict[str, Any] = {"loop.duration": 0.01, "loop.plant_step": 0.001, "loop.sample_time": 0.001}
    settings |= {"sensors": {"noise": {"leg_length": "10 um"}, "seed": 9}, "reference.at": 5e-3, "ensemble": table}
    record = gs.run("heave_step", settings, member=5, plant=plant)
    noise = record["measured.leg_length"] - record["leg_length"]
    for k in (0, 1, 9):
        numbers = [number_of(SeedSequence(9, spawn_key=(5,)), k, 12 + leg) for leg in range(6)]
        assert noise[k] == pytest.approx(1e-5 * np.array(numbers), abs=1e-8)


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
