"""What the unit keeps of earlier computations never shows: each value is that of a fresh instance."""

from collections.abc import Callable

import numpy as np
import pytest

from gough_stewart.fmu_build.component import Role
from gough_stewart.fmu_build.plant.layout import PLANT
from tests.fmu_build.test_trajectories import start_of
from tests.support.fmu_plants import Fmu, Plant, plant
from tests.support.uneven import uneven_case

COMPUTED = [row.variable.name for row in PLANT.of_role(Role.RESULT, Role.DERIVATIVE)]
SETTABLE = PLANT.of_role(Role.INPUT, Role.STATE, Role.FIXED_PARAMETER, Role.TUNABLE_PARAMETER)
# What is computed first decides what is kept for the next.
ORDERS: dict[str, list[str]] = {
    "as listed": COMPUTED,
    "legs first": ["leg_length", "leg_velocity", *COMPUTED],
    "derivatives first": ["der(velocity)", "der(orientation)", *COMPUTED],
    "legs last": sorted(COMPUTED, key=lambda name: name.startswith("leg")),
}


def computed(p: Plant, order: list[str]) -> dict[str, list[float]]:
    return {name: np.ravel(p.get(name)).tolist() for name in order}


def settings(p: Plant) -> dict[str, np.ndarray]:
    return {row.variable.name: p.get(row.variable.name) for row in SETTABLE}


def assert_fresh(p: Plant, order: list[str]) -> None:
    """Expected: a new instance that was given the same settings, and asked in another order."""
    with plant(p.of) as fresh:
        for name, value in settings(p).items():
            fresh.set(name, value)
        expected = computed(fresh, COMPUTED[::-1])
    found = computed(p, order)
    for name in COMPUTED:
        # lengths and rates come from another function of the kernel when they are asked for alone
        assert found[name] == pytest.approx(expected[name], rel=1e-13, abs=1e-12), name


@pytest.mark.parametrize("order", ORDERS)
def test_a_changed_setting_changes_what_depends_on_it(fmu: Fmu, order: str) -> None:
    names = ORDERS[order]
    with plant(fmu) as p:
        for name, value in start_of(uneven_case()).items():
            p.set(name, value)
        for row in SETTABLE:
            computed(p, names)
            name = row.variable.name
            value = p.get(name)
            if name == "platform_inertia":
                changed = value + 0.1 * np.ones((3, 3))
            else:
                changed = value + 0.01 * (1 + np.arange(value.size)).reshape(value.shape)
            p.set(name, changed)
            assert_fresh(p, names)


# States from the start of the runs, by FMI version.
BEFORE: dict[str, bytes] = {}
CHANGES: dict[str, Callable[[Plant], object]] = {
    "a step": lambda p: p.step(0.1, 0.05),
    "inputs": lambda p: p.set("actuator_force", [31.0, 58.0, 44.0, 52.0, 37.0, 49.0]),
    "a load": lambda p: p.set("external_torque", [3.0, -2.0, 1.0]),
    "gravity": lambda p: p.set("gravity", [0.3, 0.4, -9.0]),
    "friction": lambda p: p.set("leg_coulomb_friction", 3.0),
    "a payload": lambda p: p.set("platform_mass", 17.0),
    "another inertia": lambda p: p.set("platform_inertia", [[6.0, 0.4, -0.3], [0.4, 7.0, 0.2], [-0.3, 0.2, 8.0]]),
    "a state from before": lambda p: p.restore(BEFORE[p.of.version]),
    "a reset": lambda p: p.fmu.reset(),
}


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("change", CHANGES)
def test_values_follow_what_happens_in_a_run(fmu: Fmu, change: str, order: str) -> None:
    with plant(fmu) as p:
        p.start(start_of(uneven_case()))
        BEFORE[p.of.version] = p.serialized()
        p.step(0.0, 0.1)
        computed(p, ORDERS[order])
        CHANGES[change](p)
        assert_fresh(p, ORDERS[order])
