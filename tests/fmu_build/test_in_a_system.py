"""A plant beside its controller: zeros in its very first step stand for the forces of the start, and nowhere else."""

import numpy as np
import pytest

from gough_stewart.fmu_build.build import build_units
from gough_stewart.fmu_build.plant.component import plant_component
from tests.support.fmu_plants import Fmu, Plant, plant
from tests.support.uneven import UNEVEN

FORCE = np.array([310.0, 290.0, 320.0, 280.0, 305.0, 295.0])  # [N]
BEGIN, STEP = 12.3, 0.004  # [s]
ZERO = np.zeros(6)


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    component = plant_component(UNEVEN, actuator_force=FORCE, tolerance=1e-9, is_in_a_system=True)
    return Fmu(build_units(component, tmp_path_factory.mktemp("system"), fmi=["2.0"])[0])


def pose_after(unit: Fmu, *forces: np.ndarray) -> np.ndarray:
    """After a step under each of these forces, which are set before it."""
    with plant(unit) as p:
        p.start(time=BEGIN, tolerance=None)
        return stepped(p, *forces)


def stepped(p: Plant, *forces: np.ndarray) -> np.ndarray:
    for k, force in enumerate(forces):
        p.set("actuator_force", force)
        assert p.step(BEGIN + k * STEP, STEP) is None
    return p.pose


def test_zeros_in_the_first_step_are_the_forces_of_the_start(unit: Fmu) -> None:
    """Expected: the same unit under the forces themselves."""
    assert np.array_equal(pose_after(unit, ZERO, FORCE), pose_after(unit, FORCE, FORCE))


def test_zeros_later_are_zeros(unit: Fmu) -> None:
    """Expected: another motion than under the forces of the start, by ½ F t²/m of millimetres."""
    assert np.abs(pose_after(unit, FORCE, ZERO) - pose_after(unit, FORCE, FORCE)).max() > 1e-4


def test_one_force_that_is_not_zero_is_meant(unit: Fmu) -> None:
    one = ZERO.copy()
    one[5] = 1e-3
    assert np.abs(pose_after(unit, one) - pose_after(unit, FORCE)).max() > 1e-4


def test_a_reset_brings_the_first_step_back(unit: Fmu) -> None:
    with plant(unit) as p:
        p.start(time=BEGIN, tolerance=None)
        stepped(p, FORCE)
        p.fmu.reset()
        p.start(time=BEGIN, tolerance=None)
        assert np.array_equal(stepped(p, ZERO), pose_after(unit, FORCE))


def test_the_tolerance_that_nobody_sets_is_that_of_the_build(unit: Fmu) -> None:
    """Expected: the same bits as with it set, other ones than at another."""
    found = []
    for tolerance in (None, 1e-9, 1e-6):
        with plant(unit) as p:
            p.start(time=BEGIN, tolerance=tolerance)
            found.append(stepped(p, *[1.5 * FORCE] * 20))
    assert np.array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])
