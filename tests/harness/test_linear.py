"""The platform as a python-control object: exact, named, and usable by python-control's own functions."""

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough_stewart.harness.linear import leg_space_mass, linearise, modes, plant_system, trim
from gough_stewart.model.errors import InterfaceError
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from tests.random_platforms import random_platform

PRESETS = ("liu2000", "desktop_hexapod", "motion_base")


def relative(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


def assert_linearisations_agree(platform: Platform, bound: float) -> None:
    """By blocks; python-control's differences are one-sided with a step of 1e-6."""
    exact = linearise(platform)
    differences = control.linearize(plant_system(platform), *trim(platform), eps=1e-7)
    for block in "ABCD":
        assert relative(getattr(differences, block), getattr(exact, block)) < bound


@pytest.mark.parametrize("name", ["liu2000", "motion_base"])
def test_the_exact_linearisation_is_that_of_python_controls_differences(name: str) -> None:
    """Expected: control.linearize, within 1e-5 of the largest element of each block."""
    assert_linearisations_agree(load_preset(name), 1e-5)


@settings(max_examples=8)
@given(seed=st.integers(0, 10_000))
def test_so_it_is_on_any_platform(seed: int) -> None:
    """Expected: as above, with friction smoothed over at least a centimetre a second."""
    assert_linearisations_agree(random_platform(np.random.default_rng(seed)), 1e-5)


@pytest.mark.parametrize("name", PRESETS)
def test_trim_is_at_rest(name: str) -> None:
    """Expected: no derivative of the state, also under an external wrench and away from home."""
    platform = load_preset(name)
    size = platform.characteristic_length
    at = (platform.home_position + 0.05 * size, platform.home_orientation + np.array([0.02, -0.03, 0.05]))
    weight = 9.81 * platform.platform_mass
    for point in (
        trim(platform),
        trim(platform, *at, external_wrench=weight * np.array([0.3, 0, 0, 0, 0, 0.1 * size])),
    ):
        rate = Kernel().derivatives(*point, parameter_vector(platform))
        assert np.abs(rate).max() < 1e-9
        assert point.state[6:] == pytest.approx(0)


def test_python_controls_own_trim_agrees(paper: Platform) -> None:
    """Expected: find_operating_point with the pose held and the forces free."""
    plant = plant_system(paper)
    point = trim(paper)
    state = point.state + 0.0
    found = control.find_operating_point(
        plant, state, np.append(np.full(6, 20.0), np.zeros(6)), state[:6], iy=range(6), iu=range(6, 12), idx=range(12),
        dx0=np.zeros(12),
    )  # fmt: skip
    assert np.abs(found.inputs[:6] - point.inputs[:6]).max() < 1e-6


def test_signals_have_the_interfaces_names(paper: Platform) -> None:
    plant, linear = plant_system(paper, ("leg_length", "kinetic_energy")), linearise(paper, outputs="leg_length")
    assert plant.state_labels[3] == "orientation[1]"
    assert plant.input_labels[6] == "external_force[1]"
    assert plant.output_labels[-2:] == ["leg_length[6]", "kinetic_energy"]
    assert linear.output_labels == [f"leg_length[{k}]" for k in range(1, 7)]
    with pytest.raises(InterfaceError, match=r"leg_lenght: is no result.*did you mean 'leg_length'"):
        plant_system(paper, ("leg_lenght",))
    with pytest.raises(InterfaceError, match="position"):
        linearise(paper, position=[0.0, 0.0])  # type: ignore[arg-type]


def test_interconnect_joins_whole_signals_by_name(paper: Platform) -> None:
    """Expected: u = k (r − L), so that ẋ of the interconnection is the kernel's under these forces."""
    plant = plant_system(paper, ("leg_length",))
    gain = control.ss([], [], [], 50 * np.eye(6), inputs=6, outputs=6, name="gain")
    closed = control.interconnect(
        [plant, gain],
        connections=[["gain.u", "-plant.leg_length"], ["plant.actuator_force", "gain.y"]],
        inplist=["gain.u"],
        outlist=["plant.leg_length"],
        inputs=6,
        outputs=6,
        check_unused=False,
    )
    x, r = trim(paper).state, np.full(6, 3.5)
    lengths = plant.output(0, x, np.zeros(12))
    expected = plant.dynamics(0, x, np.append(50 * (r - lengths), np.zeros(6)))
    assert closed.dynamics(0, x, r) == pytest.approx(expected)


@pytest.mark.parametrize("name", PRESETS)
def test_the_leg_space_mass_is_what_a_newton_meets(name: str) -> None:
    """Expected: at rest, without gravity and friction, L̈ = J [v̇; ω̇] = M_leg⁻¹ F for the kernel's accelerations."""
    platform = load_preset(name)
    p = parameter_vector(type(platform)(**(platform.as_dict() | {"gravity": np.zeros(3), "leg_coulomb_friction": 0.0})))
    J = leg_jacobian(platform, platform.home_position, platform.home_orientation)
    x = trim(platform).state
    for k in range(6):
        a = Kernel().derivatives(x, np.eye(12)[k], p)[6:].copy()
        assert pytest.approx(np.linalg.inv(leg_space_mass(platform))[:, k], rel=1e-9, abs=1e-15) == J @ a


def test_modes_of_an_oscillator() -> None:
    """Expected: s² + 2 ζ ω s + ω², and the same sampled; an overdamped one has two."""
    omega, zeta = 2 * np.pi * 3, 0.2
    system = control.ss(control.tf([1], [1, 2 * zeta * omega, omega**2]))
    for each in (system, control.sample_system(system, 1e-3)):
        (mode,) = modes(each)
        assert mode.frequency == pytest.approx(3.0)
        assert mode.damping_ratio == pytest.approx(0.2)
        assert mode.eigenvalue.imag == pytest.approx(omega * np.sqrt(1 - zeta**2))
    slow, fast = modes(control.ss(control.tf([1], np.poly([-1.0, -9.0]))))
    assert (slow.eigenvalue.real, fast.eigenvalue.real) == pytest.approx((-1, -9))


def test_a_delay_is_no_mode() -> None:
    assert len(modes(control.ss(control.tf([1], [1, -0.5, 0, 0], 0.1)))) == 1
