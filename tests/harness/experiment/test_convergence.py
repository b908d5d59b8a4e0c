"""The sampled loop against python-control's continuous one, and against the eigenvalues of the linear model."""

import control
import numpy as np
import pytest

from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.linear import leg_space_mass, modes, plant_system
from gough_stewart.harness.control.loop_transfer import loop_transfer
from gough_stewart.harness.control.margins import closed_loop
from gough_stewart.harness.control.pid import Gains, pid, sampled
from gough_stewart.harness.experiment.file import experiment_from
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.vectors import FloatArray

pytestmark = pytest.mark.usefixtures("units_in_process")
GAINS = Gains(4000.0, 400.0, derivative_filter=0.01)
START = np.array([0.02, -0.01, 3.03])
DURATION = 0.2


def back_home(start: list[float], sample_time: float, duration: float, tolerance: float) -> Experiment:
    """From a displaced start to home under static forces; the controller comes from outside."""
    return experiment_from(
        {
            "title": "back home",
            "plant": {"tolerance": tolerance},
            "start": {"position": start},
            "reference": {"type": "hold"},
            "controller": {"type": "open_loop", "feedforward": "gravity"},
            "loop": {"duration": duration, "sample_time": sample_time},
        }
    )


def sampled_run(sample_time: float) -> FloatArray:
    """Pose at the end."""
    controller = LinearController(sampled(pid(GAINS), sample_time))
    experiment = back_home(START.tolist(), sample_time, DURATION, 1e-11)
    record = run(experiment, plant="fmu3", controller=controller)
    return np.hstack([record["position"][-1], record["orientation"][-1]])


def continuous_run() -> FloatArray:
    """The same by python-control: interconnection of nlsys and the continuous controller, solved by RK45 at 1e-10."""
    platform = load_preset("liu2000")
    plant = plant_system(platform, ("position", "orientation", "leg_length"))
    controller = pid(GAINS)
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
    constant = np.concatenate([leg_geometry(platform, *home).length, static_leg_forces(platform, *home)])
    start = np.concatenate([START, platform.home_orientation, np.zeros(6)])
    time = np.linspace(0, DURATION, 3)
    # the derivative's filter starts at rest under the first error, as that of the sampled loop does
    first = np.concatenate([constant[:6], leg_geometry(platform, START, platform.home_orientation).length])
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


def test_the_decay_of_the_run_is_that_of_an_eigenvalue() -> None:
    """Expected: late heave of 0.1 mm decays as its slow real eigenvalue in the sampled linear loop says, within 1 %.

    Heave is the mode in which all legs move alike; m and with it the pole without sampling follow from J⁻ᵀ M J⁻¹.
    """
    platform, T = load_preset("liu2000"), 1e-3
    controller = LinearController(sampled(pid(GAINS), T))
    eigenvalues = np.array([mode.eigenvalue for mode in modes(closed_loop(loop_transfer(platform, controller, T)))])
    (m,) = {round(float(row.sum()), 6) for row in leg_space_mass(platform)}
    continuous = max(np.roots([m * 0.01, m, 400 + 4000 * 0.01, 4000]), key=lambda root: root.real)
    expected = eigenvalues[np.abs(eigenvalues - continuous).argmin()]
    record = run(back_home([0, 0, 3.0001], T, 0.6, 1e-12), plant="fmu3", controller=controller)
    late = record["time"] > 0.35
    rate = np.polyfit(record["time"][late], np.log(np.abs(record["error.position[3]"][late])), 1)[0]
    print("eigenvalue", expected, "decay", rate)
    assert expected.imag == 0
    assert rate == pytest.approx(expected.real, rel=0.01)
