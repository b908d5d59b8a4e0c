"""A CasADi function as a controller in a run, against its formula in NumPy."""

import casadi
import numpy as np
import pytest

import gough_stewart as gs


def test_a_function_gets_its_signals_by_name_and_keeps_its_memory() -> None:
    """Expected: of every sample its own readings, reference and time, and a memory that has counted from zero.

    Its inputs are in another order than the signals, the memory is a matrix, and no two gains are alike.
    """
    names = ("memory", "reference_leg_length", "time", "leg_velocity", "leg_length")
    memory, wanted, time = casadi.SX.sym("m", 2, 3), casadi.SX.sym("r", 6), casadi.SX.sym("t")
    velocity, length = casadi.SX.sym("v", 6), casadi.SX.sym("l", 6)
    stiffness, damping = 1e4 * np.arange(1.0, 7), 100.0 * np.arange(7.0, 1, -1)
    force = stiffness * (wanted - length) - damping * velocity + 50 * time + casadi.vec(memory)
    counted = memory + np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    function = casadi.Function(
        "law",
        [memory, wanted, time, velocity, length],
        [counted, force],
        list(names),
        ["memory_next", "actuator_force"],
    )
    settings = {"loop.duration": 0.06, "loop.sample_time": 2e-3, "loop.plant_step": 1e-3, "loop.delay": 1}
    record = gs.run("circle", settings, controller=function)
    rows = slice(0, -1, 2)
    samples = np.arange(len(record["time"][rows]))[:, None]
    error = record["reference.leg_length"][rows] - record["measured.leg_length"][rows]
    expected = stiffness * error - damping * record["measured.leg_velocity"][rows] + 50 * record["time"][rows][:, None]
    expected += samples * np.array([1.0, 4.0, 2.0, 5.0, 3.0, 6.0])
    found = (record["controller.force"] - record["controller.feedforward"])[rows]
    assert len(samples) == 30
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-6)
