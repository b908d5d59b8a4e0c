"""Design a PD controller on the linear model, look at its margins, run it on the FMU, draw what happened."""

from pathlib import Path

from gough_stewart.harness.control.gains import gains_from_bandwidth
from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.loop_transfer import loop_transfer
from gough_stewart.harness.control.margins import loop_margins
from gough_stewart.harness.control.pid import pid, sampled
from gough_stewart.harness.experiment.file import shipped_experiment
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.results.figures import run_figures
from gough_stewart.harness.results.metrics import metrics
from gough_stewart.model.platform_toml import load_preset

platform = load_preset("motion_base")
gains = gains_from_bandwidth(platform, bandwidth=2.0, damping_ratio=0.8)  # Hz
controller = LinearController(sampled(pid(gains, "measurement"), 1e-3))
print(loop_margins(loop_transfer(platform, controller, 1e-3, delay=1)).as_dict()["disk"])

record = run(shipped_experiment("heave_step"), plant="fmu3", controller=controller)
print(metrics(record)["step_response"])
Path("heave.png").write_bytes(run_figures(record)["pose.png"])
