"""Linear models of legs that give or stick. Expected: another program's printed frequencies, and closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

import gough_stewart as gs
from gough_stewart.harness.control.linear import leg_space_mass, linearise, plant_system
from gough_stewart.harness.errors import UnstableLoopError
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray
from tests.support.real_platforms import SPRINGS, real_platform

# T. Dehaeze, stewart-simscape, org/identification.org: "Resonance Frequency [Hz]", from Simscape's linearisation
PRINTED = [780.6, 780.6, 903.9, 1061.4, 1061.4, 1269.6]


@pytest.fixture(scope="module")
def simscape() -> Platform:
    return gs.load_platform(Path(__file__).parent / "stewart_simscape.toml")


def frequencies(A: FloatArray) -> FloatArray:
    """Of oscillating modes [Hz], ascending."""
    values = np.linalg.eigvals(A)
    return np.sort(np.abs(values[values.imag > 1.0])) / (2 * np.pi)


def test_with_held_motors_modes_are_those_that_simscape_printed(simscape: Platform) -> None:
    A = np.asarray(linearise(simscape).A)
    # held: their states, the last twelve, do not move
    assert frequencies(A[:12, :12]) == pytest.approx(PRINTED, rel=1e-3)


@pytest.mark.parametrize("platform", [real_platform(springs=True), None])
def test_with_free_motors_modes_are_those_of_two_masses_a_leg(platform: Platform | None, simscape: Platform) -> None:
    """Expected: ω² of K (1/m_a + W⁻¹) with the mass W that the legs see; without damping, friction and gravity."""
    of = simscape if platform is None else platform
    of = replace(of, leg_damping=1e-9, gravity=np.zeros(3), leg_viscous_friction=0.0)
    W = leg_space_mass(replace(of, leg_armature=0.0, leg_stiffness=0.0, leg_damping=0.0))
    squares = eigh(of.leg_stiffness * (np.eye(6) / of.leg_armature + np.linalg.inv(W)), eigvals_only=True)
    assert frequencies(np.asarray(linearise(of).A)) == pytest.approx(np.sqrt(squares) / (2 * np.pi), rel=1e-6)


def test_legs_that_stick_stand_on_the_springs_of_their_bristles() -> None:
    """Expected: ω² of σ0 W⁻¹, W with the armature; sliding legs have no such modes."""
    rigid = real_platform(
        "lugre", leg_bristle_damping=1e-6, gravity=np.zeros(3), leg_viscous_friction=0.0, leg_static_friction=26.0
    )
    sticks = linearise(rigid, coulomb_friction=True)
    squares = eigh(rigid.leg_bristle_stiffness * np.linalg.inv(leg_space_mass(rigid)), eigvals_only=True)
    assert frequencies(np.asarray(sticks.A)) == pytest.approx(np.sqrt(squares) / (2 * np.pi), rel=1e-6)
    assert sticks.state_labels[12:14] == ["leg_bristle[1]", "leg_bristle[2]"]
    slides = linearise(rigid)
    assert slides.nstates == 12
    assert len(frequencies(np.asarray(slides.A))) == 0


def test_the_nonlinear_system_has_the_states_of_its_platform() -> None:
    """Expected: at rest, the rates are 0; a stretched spring pushes platform and motor apart."""
    platform = real_platform("elasto_plastic", True)
    system = plant_system(platform, outputs=("leg_force", "leg_bristle"))
    x = np.concatenate(
        [
            *(platform.home_position, platform.home_orientation, np.zeros(6), np.zeros(6)),
            *(platform.home_motor_position, np.zeros(6)),
        ]
    )
    u = np.concatenate([platform.home_actuator_force, np.zeros(6)])
    assert np.abs(system.dynamics(0, x, u)).max() < 1e-6
    stretched = x + np.concatenate([np.zeros(18), 1e-6 * np.eye(6)[2], np.zeros(6)])
    force = system.output(0, stretched, u)[:6] - system.output(0, x, u)[:6]
    assert force == pytest.approx(1e-6 * SPRINGS["leg_stiffness"] * np.eye(6)[2], abs=1e-6)
    rates = system.dynamics(0, stretched, u)
    assert rates[26] == pytest.approx(-1e-6 * SPRINGS["leg_stiffness"] / SPRINGS["leg_armature"], rel=1e-6)


def test_a_bandwidth_that_rigid_legs_bear_is_refused_on_legs_that_give() -> None:
    """Expected: stable on rigid legs; on soft ones a run grows, no faster than the worst eigenvalue says."""
    rigid, stiff = gs.margins("heave_step"), gs.margins("heave_step", {"platform.parameters.leg_stiffness": 2e7})
    assert stiff.disk.alpha < 0.5 * rigid.disk.alpha
    soft = {"platform.parameters.leg_stiffness": 5e6}
    with pytest.raises(UnstableLoopError, match="choose a lower bandwidth") as caught:
        gs.margins("heave_step", soft)
    # without what the linear model leaves out, and small enough for the force limit
    own = {"plant.parameters.leg_coulomb_friction": 0, "loop.duration": 0.8, "reference.position_change": [0, 0, 1e-3]}
    record = gs.run("heave_step", soft | own)
    shaking = record["leg_force"][:, 0] - record["controller.force"][:, 0]
    early, late = np.ptp(shaking[500:600]), np.ptp(shaking[700:800])
    growth = (late / early) ** (1 / 200)
    # heave is not the worst of the six modes
    assert 1.005 < growth <= abs(caught.value.eigenvalue) + 1e-4


def test_encoders_at_the_motors_do_not_see_the_stretch_of_their_legs() -> None:
    """Expected: what is measured are the motors' positions, or the lengths of the legs; margins differ accordingly."""
    soft = {
        "platform.parameters.leg_stiffness": 2e7,
        "loop.duration": 0.25,
        "sensors.quantisation.leg_length": 0,
        "sensors.noise.leg_length": 0,
    }
    for side, name in (("leg", "leg_length"), ("motor", "motor_position")):
        record = gs.run("heave_step", soft | {"sensors.side": side})
        # the last row has no sample of its own
        assert np.array_equal(record["measured.leg_length"][:-1], record[name][:-1])
    at_leg, at_motor = (gs.margins("heave_step", soft | {"sensors.side": side}) for side in ("leg", "motor"))
    # a motor's encoder is collocated with its force: structural modes take no phase from it
    assert at_motor.disk.alpha > 1.2 * at_leg.disk.alpha
    rigid = [gs.margins("heave_step", {"sensors.side": side}).disk.alpha for side in ("leg", "motor")]
    assert rigid[0] == rigid[1]


def test_margins_are_those_of_legs_that_only_the_machine_has() -> None:
    """Expected: the disk margin that a design with these legs has; the believed beside it; or instability."""
    found = gs.margins("heave_step", {"plant.parameters.leg_stiffness": 2e7})
    known = gs.margins(
        "heave_step", {"platform.parameters.leg_stiffness": 2e7, "platform.parameters.leg_coulomb_friction": 0}
    )
    assert found.disk.alpha == pytest.approx(known.disk.alpha, rel=1e-6)
    assert found.structure is not None
    assert found.believed is not None
    assert found.believed.disk.alpha == gs.margins("heave_step").disk.alpha
    with pytest.raises(
        UnstableLoopError, match=r"it is stable with the believed platform as machine, with a disk margin"
    ):
        gs.margins("heave_step", {"plant.parameters.leg_stiffness": 5e6})
