"""What drives do on elastic legs, against sums over the motors' columns and the balance of energy, on every host."""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs

# Soft springs and a loop that is too fast for them, so that the two sides of a leg differ much.
SPEED, POWER = 0.6, 500.0
SOFT: dict[str, Any] = {
    "plant.parameters": {"leg_stiffness": 2e6, "leg_armature": 100.0},
    "platform.parameters": {"leg_velocity_max": SPEED, "actuator_power_max": POWER},
    "loop.duration": 0.6,
}


def law(sample: gs.Sample) -> Any:
    return 4e4 * (sample.reference["leg_length"] - sample.measured["leg_length"])


def of_motors(record: gs.Record) -> dict[str, float]:
    """Work [J], power [W] and shares of the limits, leg by leg and row by row."""
    force, s, ds = (record[name] for name in ("actuator_force", "motor_position", "motor_velocity"))
    n = len(s)
    work = [force[k, i] * (s[k + 1, i] - s[k, i]) for k in range(n - 1) for i in range(6)]
    power = [abs(force[k, i] * ds[at, i]) for k in range(n) for at in (k, k + 1) if at < n for i in range(6)]
    return {
        "energy.net_total": sum(work),
        "energy.absolute_total": sum(map(abs, work)),
        "power.peak": max(power),
        "limits.leg_velocity_max.used": np.abs(ds).max() / SPEED,
        "limits.actuator_power_max.used": max(power) / POWER,
    }


@pytest.mark.parametrize("controller", [None, law], ids=["linear", "Python"])
@pytest.mark.parametrize("plant", [None, "model"])
def test_drives_of_a_run_are_taken_at_the_motors(controller: Any, plant: Any) -> None:
    """Expected: of metrics, charts and nearness; at least the work that is stored, since springs only lose."""
    record = gs.run("heave_step", SOFT, controller=controller, plant=plant)
    found, expected = gs.metrics(record), of_motors(record)
    for path, value in expected.items():
        first, *others = path.split(".")
        part = found[first]
        for name in others:
            part = part[name]
        assert np.max(part) == pytest.approx(value, rel=1e-9), path
    stored = np.ptp(np.add(record["kinetic_energy"], record["potential_energy"])[[0, -1]])
    assert found["energy"]["net_total"] > stored
    report: Any = record.report()
    (power,) = (chart for chart in report.charts if chart.title == "actuator power of legs")
    watts = np.stack([series.values for series in power.series], axis=1)
    assert watts == pytest.approx(record["actuator_force"] * record["motor_velocity"], abs=0)
    (limits,) = (part for part in report.parts() if getattr(part, "title", "") == "Limits")
    shares = {row[0]: [getattr(cell, "value", cell) for cell in row[1:]] for row in limits.rows}
    assert max(shares["velocity, of its limit"]) == pytest.approx(expected["limits.leg_velocity_max.used"])
    assert max(shares["power, of its limit"]) == pytest.approx(expected["limits.actuator_power_max.used"])


@pytest.mark.parametrize("controller", [None, law], ids=["linear", "Python"])
def test_members_do_the_work_of_their_own_runs(controller: Any) -> None:
    """Expected: sums over the motors' columns of a member's record; 20 members have 409 of 601 rows in a block."""
    settings = {**SOFT, "ensemble": {"members": 20, "platform_mass": {"uniform": [1200, 1500]}}}
    members = gs.ensemble("heave_step", settings, controller=controller, workers=1).members
    for k in (0, 1, 19):
        for path, value in of_motors(gs.run("heave_step", settings, controller=controller, member=k)).items():
            assert members[path][k] == pytest.approx(value, rel=1e-6), (path, k)


def test_a_check_says_that_it_plans_with_rigid_legs() -> None:
    """Expected: a note, if the legs of the nominal model give."""
    for stiffness, number in ((2e6, 1), (0.0, 0)):
        found = gs.check("heave_step", {"platform.parameters": {"leg_stiffness": stiffness}})
        assert sum("those of rigid legs" in text for text in found.needs.notes) == number
