"""Elastic legs, from logs of one side or of both: forces of a Lagrangian, stretch in closed form."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from scipy.interpolate import make_interp_spline

from gough_stewart import GoughStewartError, Log, identify, read_log, run
from tests.harness.identify.machine_logs import MACHINE, Swing
from tests.support.arrays import FloatArray
from tests.support.lagrangian import forces_along, legs_along

K, C, RATE, DURATION = 1.3e7, 3e4, 500.0, 6.0
LEGS = np.array([1.0, 1.2, 0.9, 1.1, 1.1, 0.7])
SPRUNG = MACHINE.with_parameters({"leg_stiffness": K, "leg_damping": C, "leg_coulomb_friction": (130 * LEGS).tolist()})
NAMES = ("platform_mass", "leg_armature", "leg_viscous_friction", "leg_coulomb_friction")


@cache
def _machine() -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Time, lengths of the legs and positions of the motors, forces: k δ + c δ̇ = N by its series, m_a s̈ = F − f − N."""
    swing = Swing(seed=8, frequency=0.3, size=0.02)
    platform = replace(MACHINE, leg_armature=0.0, leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    time, coarse = np.arange(round(DURATION * RATE)) / RATE, np.arange(-0.05, DURATION + 0.06, 0.01)
    N = make_interp_spline(coarse, forces_along(platform, swing.along(platform, coarse, DURATION)), k=7)
    length, velocity = legs_along(platform, swing.along(platform, time, DURATION))
    speed = make_interp_spline(time, velocity, k=5)
    lag = C / K
    stretch, faster, fastest = ((N(time, d) - lag * N(time, d + 1) + lag**2 * N(time, d + 2)) / K for d in (0, 1, 2))
    sliding = velocity + faster
    friction = 560 * sliding + 130 * LEGS * np.tanh(sliding / MACHINE.leg_friction_velocity)
    force = N(time) + MACHINE.leg_armature * (speed(time, 1) + fastest) + friction
    return time, length, length + stretch, force


def elastic_log(sides: str, seed: int = 0) -> Log:
    """What the machine records: "leg", "motor" or "both", whose encoders count from another zero."""
    time, length, motor, force = _machine()
    rng = np.random.default_rng(seed)
    force = force + 5.0 * rng.standard_normal(force.shape)
    length, motor = (values + 1e-6 * rng.standard_normal(values.shape) for values in (length, motor))
    if sides == "both":
        return Log(length, time, force, motor_position=motor + 1e-3 * LEGS)
    return Log(motor if sides == "motor" else length, time, force, side="motor" if sides == "motor" else "leg")


def test_both_sides_of_a_log_show_the_springs() -> None:
    """Expected: the machine's stiffness and damping, from a platform that believes the legs rigid."""
    rigid = SPRUNG.with_parameters({"leg_stiffness": 0.0, "leg_damping": 0.0, "platform_mass": 1200.0})
    found = identify(elastic_log("both"), rigid, [*NAMES, "leg_stiffness", "leg_damping"])
    truth = np.array([MACHINE.platform_mass, MACHINE.leg_armature, 560.0, 130.0 * LEGS.mean(), K, C])
    assert (found.alarms, found.rank) == ((), 6)
    assert (np.abs(found.values - truth) < 4 * found.standard_errors).all()
    assert found.standard_errors[4] < 0.005 * K
    assert found.platform(rigid).leg_stiffness == found["leg_stiffness"][0]
    # the mass, which is not known either, makes the force on a spring: its share is that of a fit with another mass
    platform = found.platform(rigid)
    heavier = replace(platform, platform_mass=platform.platform_mass + 1.0)
    alone, other = (identify(elastic_log("both"), p, ["leg_stiffness", "leg_damping"]) for p in (platform, heavier))
    # fewer than those of the masses
    assert found.freedom == alone.freedom
    by_mass = (other.values - alone.values) * found.standard_errors[0]
    np.testing.assert_allclose(found.standard_errors[4:] ** 2, alone.standard_errors**2 + by_mass**2, rtol=1e-3)
    np.testing.assert_allclose(found.correlation[0, 4:], by_mass / found.standard_errors[4:], rtol=0.01)
    assert f"explained to {1e6 * alone.residuals.rms.max():.2g} µm RMS" in " ".join(found.notes)
    assert found.singular_values[found.directions[:, 4:].any(axis=1)] == pytest.approx(alone.singular_values, rel=0.01)
    # of the readings of each log six zeros are not known: twice n − 6 − 2 is 2 n − 12 − 2, less 2
    twice = identify([elastic_log("both"), elastic_log("both", 1)], platform, ["leg_stiffness", "leg_damping"])
    assert twice.freedom == 2 * alone.freedom + 2


def test_intervals_of_the_springs_hold() -> None:
    """Expected: errors of eight logs in standard errors have a standard deviation of 1, within its sampling error."""
    errors = []
    for seed in range(8):
        found = identify(elastic_log("both", seed), SPRUNG, ["leg_stiffness", "leg_damping"])
        errors.append((found.values - [K, C]) / found.standard_errors)
    spread = np.sqrt((np.array(errors) ** 2).mean(axis=0))
    assert (spread > 0.5).all()
    assert (spread < 1.6).all()


@pytest.mark.parametrize("side", ["leg", "motor"])
def test_lengths_of_one_side_are_brought_to_the_other(side: str) -> None:
    """Expected: the machine's mass and armature with the springs known; read as of the other side, both are off."""
    found = identify(elastic_log(side), SPRUNG, NAMES)
    assert found.alarms == ()
    truth = [MACHINE.platform_mass, MACHINE.leg_armature]
    assert (np.abs(found.values[:2] - truth) < 4 * found.standard_errors[:2]).all()


def test_one_side_shows_no_springs() -> None:
    with pytest.raises(GoughStewartError, match=r"leg_stiffness: not shown by log, which has lengths on one side"):
        identify(elastic_log("motor"), SPRUNG, ["leg_stiffness"])
    found = identify(elastic_log("motor"), SPRUNG, ["platform_mass", "leg_stiffness"])
    assert found.not_excited == ("leg_stiffness",)
    assert found.platform(SPRUNG).leg_stiffness == K
    assert any("one side of the legs only" in note for note in found.notes)
    log = elastic_log("leg")
    with pytest.raises(GoughStewartError, match=r"motor_position and leg_length of this log do not differ"):
        identify(replace(log, motor_position=log.leg_length), SPRUNG, ["leg_stiffness"])


def test_a_log_says_its_side(tmp_path: Path) -> None:
    """Expected: of a record that of its sensors, with their reading; of a file its columns' or the option's."""
    changes = {"plant.parameters.leg_stiffness": 1e7, "loop.duration": 0.1, "sensors.side": "motor"}
    record = run("heave_step", changes)
    record.write_parquet(tmp_path / "record.parquet")
    log = read_log(tmp_path)
    assert (log.side, log.motor_position, read_log(tmp_path, side="leg").side) == ("motor", None, "leg")
    motors = record.table.select([f"motor_position[{k}]" for k in range(1, 7)]).to_numpy()
    # the stretch is 0.25 mm, the sensors' step 10 µm
    assert np.abs(log.leg_length - motors[: len(log)]).max() < 6e-6
    run("heave_step", changes | {"sensors.side": "leg"}).write_parquet(tmp_path / "record.parquet")
    both = read_log(tmp_path)
    assert both.side == "leg"
    assert both.motor_position is not None

    time, _, motor, force = _machine()
    columns = {f"actuator_force[{k + 1}]": force[:, k] for k in range(6)}
    for file, name in (("motors.csv", "motor_position"), ("lengths.csv", "leg_length")):
        lengths = {f"{name}[{k + 1}]": motor[:, k] for k in range(6)}
        polars.DataFrame({"time": time} | columns | lengths).write_csv(tmp_path / file)
    assert read_log(tmp_path / "motors.csv").side == "motor"
    assert read_log(tmp_path / "lengths.csv").side == "leg"
    assert read_log(tmp_path / "lengths.csv", side="motor").side == "motor"
    polars.read_csv(tmp_path / "motors.csv").hstack(polars.DataFrame(lengths)).write_csv(tmp_path / "both.csv")
    cases = ("motors", "leg", "only, but side is 'leg'"), ("both", "motor", "leave side"), ("both", "x", "is 'x'")
    for name, chosen, said in cases:
        with pytest.raises(GoughStewartError, match=said):
            read_log(tmp_path / f"{name}.csv", side=chosen)  # type: ignore[arg-type]


def test_faults_of_the_motors_encoders_are_mended_or_left_out_and_said() -> None:
    """Expected: the stiffness of the log without faults, to a standard error; a spike and a frozen run."""
    log: Any = elastic_log("both")
    motor = log.motor_position.copy()
    motor[700, 2] += 5e-3
    motor[1500:1560, 4] = motor[1500, 4]
    names = ["leg_stiffness", "leg_damping"]
    found, right = (identify(one, SPRUNG, names) for one in (replace(log, motor_position=motor), log))
    assert (np.abs(found.values - right.values) < right.standard_errors).all()
    notes = " ".join(found.notes)
    assert "1 spike in the motor position of leg 3, at 1.4 s; interpolated" in notes
    assert "59 frozen readings of the motor position of leg 5, at 3.002 to 3.118 s; left out" in notes
    noisy = log.motor_position + 2e-4 * np.random.default_rng(1).standard_normal(motor.shape)
    assert identify(replace(log, motor_position=noisy), SPRUNG, names).not_excited == ("leg_damping",)
