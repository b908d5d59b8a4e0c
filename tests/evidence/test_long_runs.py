"""Slow evidence: many more random platforms, a minute on springs for every preset, a soak of the stepping model."""

import resource

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import gough_stewart as gs
from gough_stewart import State, SteppingModel, load_preset
from gough_stewart.model import dynamics
from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.state import Inputs
from tests.support.fmu_plants import Fmu
from tests.support.formulations import largest_difference
from tests.support.random_platforms import random_platform

pytestmark = pytest.mark.evidence


def test_formulations_agree_on_20_000_random_platforms() -> None:
    """Expected: as `test_formulations`, on other seeds; the largest difference is printed."""
    rng = np.random.default_rng(1)
    worst = max(largest_difference(random_platform(rng), rng) for _ in range(20_000))
    print(f"\nlargest difference {worst:.2e}")
    assert worst <= 1e-10


def spring_energy_error(platform: gs.Platform, start: State, stiffness: float, duration: float) -> tuple[float, float]:
    """Largest relative change of the total energy with legs as springs F = F0 + k (L0 − L), and the largest travel.

    The springs store V = Σ ½ k (L0 − L)² − F0 L; relative to the largest kinetic energy. rtol 1e-12.
    """
    home = platform.home_position, platform.home_orientation
    F0, L0 = dynamics.static_leg_forces(platform, *home), gs.leg_geometry(platform, *home).length
    kernel, p, u = Kernel(), parameter_vector(platform), np.zeros(12)

    def derivative(_t: float, x: np.ndarray) -> np.ndarray:
        u[:6] = F0 + stiffness * (L0 - gs.leg_geometry(platform, x[:3], x[3:6]).length)
        return kernel.derivatives(x, u, p).copy()

    run = solve_ivp(derivative, (0, duration), start.to_vector(), method="DOP853", rtol=1e-12, atol=1e-12)
    state = State.from_vector(run.y.T)
    L = gs.leg_geometry(platform, *state[:2]).length
    _, results = plant_equations(IDEAL, platform, run.y.T, Inputs.from_vector(np.zeros((len(L), 12))))
    kinetic = results["kinetic_energy"]
    springs = (0.5 * stiffness * (L0 - L) ** 2 - F0 * L).sum(axis=1)
    E = kinetic + results["potential_energy"] + springs
    return float(np.abs(E - E[0]).max() / kinetic.max()), float(np.abs(L - L0).max())


@pytest.mark.parametrize(("preset", "stiffness"), [("liu2000", 1e3), ("desktop_hexapod", 2e4), ("motion_base", 1e6)])
def test_energy_on_springs_is_constant_over_a_minute_on_every_preset(preset: str, stiffness: float) -> None:
    """Expected: conservative without friction; bounded motion of a start beside home."""
    from dataclasses import replace

    platform = replace(load_preset(preset), leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    size = platform.characteristic_length
    start = State(
        platform.home_position.copy(), np.array([0, 0, -0.05]), np.array([0, 0.1, 0]) * size, np.array([0, 0.1, 0])
    )
    error, travel = spring_energy_error(platform, start, stiffness, 60.0)
    print(f"\n{preset}: relative energy error {error:.2e}, largest leg travel {travel:.3g} m")
    assert travel < 0.3 * size
    assert error <= 1e-9


def test_soak_of_the_stepping_model_leaks_nothing_and_stays_deterministic() -> None:
    """Expected: memory of the process does not grow over 30,000 steps and 300 resets; every round is the same."""
    model = SteppingModel(load_preset("liu2000"))
    grown, end = [], set()
    for round_ in range(300):
        model.reset()
        model.set("actuator_force", [30.0] * 6)
        for k in range(100):
            snapshot = model.save_state()
            model.do_step(k * 1e-3, 1e-3)
            if k % 10 == 0:
                model.restore_state(snapshot)
                model.do_step(k * 1e-3, 1e-3)
        end.add(model.state.tobytes())
        if round_ % 100 == 99:
            grown.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    print(f"\npeak memory after 100, 200, 300 rounds: {grown} KiB")
    assert len(end) == 1
    assert grown[-1] - grown[0] <= 1024


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_shipped_experiments_end_alike_on_model_and_unit(version: str, fmus: dict[str, Fmu]) -> None:
    """Expected: whole, with the same steps, so within 1e-11 m, rad; the largest difference is printed.

    All but `too_slow`, which diverges: there any difference grows to the size of the motion. Encoders do not quantise:
    rounding would decide which of two steps a reading has.
    """
    worst = 0.0
    for name in sorted(set(gs.experiment_names()) - {"too_slow"}):
        quantises = "quantisation" in gs.load_experiment(name).model_dump(exclude_unset=True).get("sensors", {})
        settings = {"sensors.quantisation.leg_length": 0} if quantises else {}
        model, unit = (
            gs.run(name, settings, plant=kind, fmu=fmu)  # type: ignore[arg-type]
            for kind, fmu in (("model", None), (f"fmu{version[0]}", fmus[version].path))
        )
        assert len(model.table) == len(unit.table)
        worst = max(worst, *(float(np.abs(model[each] - unit[each]).max()) for each in ("position", "orientation")))
    print(f"FMI {version}: {worst:.2g} m, rad")
    assert worst < 1e-11
