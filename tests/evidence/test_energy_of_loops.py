"""Slow evidence: the energy of shipped loops on machines that stick and give is work less losses."""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.results.record import machine_of
from gough_stewart.model.interface import Variant
from tests.support.energy_balance import Balance, energy_balance

pytestmark = pytest.mark.evidence
STICKS: dict[str, Any] = {"plant.parameters.leg_friction_model": "elasto_plastic"}
# Names, with a part of each in which it moves, and its friction.
_LARGE = {"plant.parameters.leg_coulomb_friction": 100, "plant.parameters.leg_static_friction": 150}
_SMALL = {"plant.parameters.leg_coulomb_friction": 2, "plant.parameters.leg_static_friction": 3}
LOOPS: dict[str, dict[str, Any]] = {
    "heave_step": {"loop.duration": 0.6, **_LARGE},
    "pitch_sine": {"loop.duration": 0.8, "reference.fade_in": 0.2, **_LARGE},
    "hold_against_gravity": {"loop.duration": 0.4, **_LARGE},
    "impulse": {"loop.duration": 0.4, "disturbance": [{"at": 0.1, "duration": 0.05, "force": [2e3, 0, 0]}], **_LARGE},
    "saturation": {"loop.duration": 0.6, **_LARGE},
    "fastest_path": {"loop.duration": 0.6, **_LARGE},
    "recorded_ride": {"loop.duration": 0.6, **_LARGE},
    "excitation": {"loop.duration": 0.6, **_LARGE},
    "circle_computed_torque": {"loop.duration": 0.6, "reference.fade_in": 0.2, **_SMALL},
}
_GIVES = {"plant.parameters.leg_stiffness": 1e8}
_GIVES_SMALL = {"plant.parameters.leg_stiffness": 1e6, "plant.parameters.leg_armature": 2}


def balance_of(name: str, settings: dict[str, Any], plant: Any, tolerance: float) -> Balance:
    record = gs.run(name, settings, plant=plant)
    machine = machine_of(record)
    names = [each for v in Variant.of(machine).states for each in v.scalar_names]
    states = np.column_stack([record.table[each].to_numpy() for each in names])
    inputs = np.column_stack([record[each] for each in ("actuator_force", "external_force", "external_torque")])
    time = record["time"]
    return energy_balance(machine, states, inputs[:-1], float(time[1] - time[0]), tolerance)


@pytest.mark.parametrize("springs", [False, True], ids=["rigid", "gives"])
@pytest.mark.parametrize("name", LOOPS)
def test_work_becomes_energy_and_losses(name: str, springs: bool) -> None:
    """Losses by an integration of their own; asked were 1e-9 of the throughput at 1e-11, 1e-5 at steps of 1 ms."""
    small = LOOPS[name]["plant.parameters.leg_coulomb_friction"] < 10
    settings = {**STICKS, **LOOPS[name], **((_GIVES_SMALL if small else _GIVES) if springs else {})}
    controlled = balance_of(name, {**settings, "plant.tolerance": 1e-11}, "model", 1e-11)
    fixed = balance_of(name, {**settings, "plant.fixed_step_size": 1e-3}, "fmu3", 1e-9)
    ratios = [each.gap / each.throughput for each in (controlled, fixed)]
    print(f"{name}, {'gives' if springs else 'rigid'}: {ratios[0]:.1e}, {ratios[1]:.1e} of {fixed.throughput:.3g} J")
    assert ratios[0] <= 1e-9
    assert ratios[1] <= 1e-5
