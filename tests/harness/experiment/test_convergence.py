"""The sampled loop against python-control's continuous one, and against the eigenvalues of the linear model."""

from typing import Any

import control
import numpy as np
import pytest
from numpy.typing import NDArray

import gough_stewart as gs

FloatArray = NDArray[np.float64]


pytestmark = pytest.mark.usefixtures("units_in_process")
GAINS = gs.Gains(4000.0, 400.0, derivative_filter=0.01)
START = np.array([0.02, -0.01, 3.03])
DURATION = 0.2


def back_home(start: list[float], sample_time: float, duration: float, tolerance: float) -> gs.Experiment:
    """From a displaced start to home under static forces; the controller comes from outside."""
    values: dict[str, Any] = {
        "title": "back home",
        "plant": {"tolerance": tolerance},
        "start": {"position": start},
        "reference": {"type": "hold"},
        "controller": {"type": "open_loop", "feedforward": "gravity"},
        "loop": {"duration": duration, "sample_time": sample_time},
    }
    return gs.Experiment(**values)


def sampled_run(sample_time: float) -> FloatArray:
    """Pose at the end."""
    controller = gs.sampled(gs.pid(GAINS), sample_time)
    experiment = back_home(START.tolist(), sample_time, DURATION, 1e-11)
    record = gs.run(experiment, plant="fmu3", controller=controller)
    return np.hstack([record["position"][-1], record["orientation"][-1]])


def continuous_run() -> FloatArray:
    """The same by python-control: interconnection of nlsys and the continuous controller, solved by RK45 at 1e-10."""
    platform = gs.load_preset("liu2000")
    plant = gs.plant_system(platform, ("position", "orientation", "leg_length"))
    controller = gs.pid(GAINS)
    # forces are the controller's plus the static ones
    legs = [f"[{k}]" for k in range(1, 7)]
    loop = control.interconnect(
        [plant, controller],
        connections=[
            *([f"plant.actuator_force{k}", f"controller.actuator_force{k}"] for k in legs),
            *([f"controller.leg_length{k}", f"plant.leg_length{k}"] for k in legs),
        ],
        inplist=[
            *(f"controller.reference_leg_length{k}" for k in legs),
            *(f"plant.actuator_force{k}" for k in legs),
        ],
        outlist=["plant.position", "plant.orientation"],
        inputs=12,
        outputs=6,
        check_unused=False,
    )
    home = (platform.home_position, platform.home_orientation)
    constant = np.concatenate([gs.leg_geometry(platform, *home).length, gs.static_leg_forces(platform, *home)])
    start = np.concatenate([START, platform.home_orientation, np.zeros(6)])
    time = np.linspace(0, DURATION, 3)
    # the derivative's filter starts at rest under the first error, as that of the sampled loop does
    first = np.concatenate([constant[:6], gs.leg_geometry(platform, START, platform.home_orientation).length])
    x0 = np.concatenate([start, -np.linalg.solve(controller.A, controller.B @ first)])
    response = control.input_output_response(
        loop,
        time,
        np.tile(constant[:, None], 3),
        x0,
        solve_ivp_kwargs={"rtol": 1e-10, "atol": 1e-12},
    )
    return np.asarray(response.outputs[:, -1])


def test_the_sampled_loop_tends_to_the_continuous_one_linearly() -> None:
    """Expected: control.input_output_response of the continuous loop; a hold lags by half a sample: order 1."""
    exact = continuous_run()
    times = (1e-3, 5e-4, 2e-4, 1e-4)
    errors = [float(np.abs(sampled_run(T) - exact).max()) for T in times]
    order = np.polyfit(np.log(times), np.log(errors), 1)[0]
    print("sample times", times, "differences", errors, "order", order)
    assert order == pytest.approx(1.0, abs=0.1)
    assert errors[-1] < 2e-5
