"""The platform as a python-control object: exact, named, and usable by python-control's own functions."""

from collections.abc import Callable

import control
import numpy as np
import pytest

from gough_stewart import GoughStewartError, Platform, linearise, load_preset, modes, plant_system, trim
from tests.support.uneven import UNEVEN

PLATFORMS = {name: load_preset(name) for name in ("liu2000", "desktop_hexapod", "motion_base")} | {"uneven": UNEVEN}


def relative(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


@pytest.mark.parametrize("name", PLATFORMS)
def test_the_exact_linearisation_is_that_of_python_controls_differences(name: str) -> None:
    """Expected: control.linearize, by one-sided differences, within 1e-5 of the largest element of each block."""
    platform = PLATFORMS[name]
    size = 0.05 * platform.characteristic_length
    pose = platform.home_position + size * np.array([1, -2, 1.5]), np.array([0.1, -0.05, 0.15])
    exact = linearise(platform, *pose, coulomb_friction=True)
    for blocks, eps in (("AC", 1e-7), ("BD", 1e-2)):  # all is affine in the inputs, where long steps are best
        differences = control.linearize(plant_system(platform), *trim(platform, *pose), eps=eps)
        for block in blocks:
            assert relative(getattr(differences, block), getattr(exact, block)) < 1e-5


@pytest.mark.parametrize("name", PLATFORMS)
def test_trim_is_at_rest(name: str) -> None:
    """Expected: no derivative of the state, also under an external wrench and away from home."""
    platform = PLATFORMS[name]
    size = platform.characteristic_length
    at = (platform.home_position + 0.05 * size, platform.home_orientation + np.array([0.02, -0.03, 0.05]))
    wrench = 9.81 * platform.platform_mass * np.array([0.3, 0, 0, 0, 0, 0.1 * size])
    assert (trim(platform, platform.home_position).state[3:6] == platform.home_orientation).all()
    for point in (trim(platform), trim(platform, *at, external_wrench=wrench)):
        rate = plant_system(platform).dynamics(0, *point)
        assert np.abs(rate).max() < 1e-9
        assert point.state[6:] == pytest.approx(0)


def test_signals_have_the_interfaces_names(paper: Platform) -> None:
    plant, linear = plant_system(paper, ("leg_length", "kinetic_energy")), linearise(paper, outputs="leg_length")
    assert plant.state_labels[3] == "orientation[1]"
    assert plant.input_labels[6] == "external_force[1]"
    assert plant.output_labels[-2:] == ["leg_length[6]", "kinetic_energy"]
    assert plant_system(paper, "joint_force").output_labels[:4:3] == ["joint_force[1,1]", "joint_force[2,1]"]
    assert linear.output_labels == [f"leg_length[{k}]" for k in range(1, 7)]
    assert linearise(paper, outputs=iter(["leg_length"])).output_labels == linear.output_labels
    assert (linear.state_labels, linear.input_labels) == (plant.state_labels, plant.input_labels)
    assert plant.name == linear.name == "plant"
    with pytest.raises(GoughStewartError, match=r"leg_lenght: is not a result.*did you mean 'leg_length'"):
        plant_system(paper, ("leg_lenght",))
    with pytest.raises(GoughStewartError, match="outputs: is empty"):
        plant_system(paper, ())
    with pytest.raises(GoughStewartError, match="leg_length: is named twice"):
        plant_system(paper, ("leg_length", "position", "leg_length"))


@pytest.mark.parametrize("function", [trim, linearise])
def test_poses_that_no_platform_has_are_refused(paper: Platform, function: Callable[..., object]) -> None:
    for position, orientation, name in (
        ([0.0, 0.0], None, "position"),
        ([0.0, 0.0, np.nan], None, "position"),
        (None, [0.0, "much", 0.0], "orientation"),
        (None, [0.0, np.pi / 2 - 1e-3, 0.0], "orientation: has a pitch"),
        (None, [0.0, -np.pi / 2 + 1e-3, 0.0], "orientation: has a pitch of -1"),
        (None, [0.0, np.pi / 2, 0.0], r"orientation: has a pitch of 1\.5708 rad; expected less than 1\.5698"),
    ):
        with pytest.raises(GoughStewartError, match=name):
            function(paper, position, orientation)
    with pytest.raises(GoughStewartError):
        function(paper, np.zeros(3))  # all legs in a plane
    with pytest.raises(GoughStewartError, match=r"external_wrench: has shape \(3,\)"):
        trim(paper, external_wrench=np.ones(3))
    with pytest.raises(GoughStewartError, match="external_wrench: has shape"):
        trim(paper, external_wrench=5.0)
    assert trim(paper, external_wrench=0.0).inputs.tolist() == trim(paper).inputs.tolist()


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


def test_an_integrator_is_a_mode_of_frequency_zero_and_a_delay_is_none() -> None:
    """Expected: 1/s beside 1/(s − 3) and 1/(s + 2): the slowest first, damping 1, −1 where it grows."""
    system = control.append(*(control.ss(control.tf([1], [1, -pole])) for pole in (3.0, 0.0, -2.0)))
    assert [(mode.eigenvalue, mode.damping_ratio) for mode in modes(system)] == [(0, 1.0), (-2, 1.0), (3, -1.0)]
    assert [mode.frequency for mode in modes(system)] == pytest.approx([0, 1 / np.pi, 1.5 / np.pi])
    assert len(modes(control.ss(control.tf([1], [1, -0.5, 0, 0], 0.1)))) == 1
