"""The sampled loop against python-control's continuous one."""

import control
import numpy as np
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray

GAINS = gs.Gains(4000.0, 400.0, derivative_filter=0.01)
START, DURATION = np.array([0.02, -0.01, 3.03]), 0.2


def sampled_run(sample_time: float) -> FloatArray:
    """Pose at the end of a way home from a displaced start, under static forces beside the controller's."""
    values = {
        "plant": {"kind": "fmu3", "tolerance": 1e-11},
        "start": {"position": START.tolist()},
        "reference": {"type": "hold"},
        "controller": {"type": "open_loop", "feedforward": "gravity"},
        "loop": {"duration": DURATION, "sample_time": sample_time},
    }
    experiment = gs.Experiment.model_validate({"title": "back home", **values})
    record = gs.run(experiment, controller=gs.sampled(gs.pid(GAINS), sample_time))
    return np.hstack([record["position"][-1], record["orientation"][-1]])


def continuous_run() -> FloatArray:
    """The same by python-control: interconnection of nlsys and the continuous controller, solved by RK45 at 1e-10."""
    platform, legs = gs.load_preset("liu2000"), [f"[{k}]" for k in range(1, 7)]
    plant, controller = gs.plant_system(platform, ("position", "orientation", "leg_length")), gs.pid(GAINS)
    joined = [("plant.actuator_force", "controller.actuator_force"), ("controller.leg_length", "plant.leg_length")]
    loop = control.interconnect(
        [plant, controller],
        connections=[[to + leg, source + leg] for to, source in joined for leg in legs],
        inplist=[name + leg for name in ("controller.reference_leg_length", "plant.actuator_force") for leg in legs],
        outlist=["plant.position", "plant.orientation"],
        inputs=12,
        outputs=6,
        check_unused=False,
    )
    home = (platform.home_position, platform.home_orientation)
    constant = np.concatenate([gs.leg_geometry(platform, *home).length, gs.static_leg_forces(platform, *home)])
    # the derivative's filter starts at rest under the first error, as that of the sampled loop does
    first = np.concatenate([constant[:6], gs.leg_geometry(platform, START, home[1]).length])
    x0 = np.concatenate([START, home[1], np.zeros(6), -np.linalg.solve(controller.A, controller.B @ first)])
    accuracy = {"rtol": 1e-10, "atol": 1e-12}
    inputs = np.tile(constant[:, None], 3)
    time = np.linspace(0, DURATION, 3)
    return np.asarray(control.input_output_response(loop, time, inputs, x0, solve_ivp_kwargs=accuracy).outputs[:, -1])


@pytest.mark.usefixtures("units_in_process")
def test_the_sampled_loop_tends_to_the_continuous_one_linearly() -> None:
    """Expected: control.input_output_response of the continuous loop; a hold lags by half a sample: order 1."""
    exact, times = continuous_run(), (1e-3, 5e-4, 2e-4, 1e-4)
    errors = [float(np.abs(sampled_run(T) - exact).max()) for T in times]
    order = np.polyfit(np.log(times), np.log(errors), 1)[0]
    print("sample times", times, "differences", errors, "order", order)
    assert order == pytest.approx(1.0, abs=0.1)
    assert errors[-1] < 2e-5
