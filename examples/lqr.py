"""A linear-quadratic regulator for the whole platform: designed on the linear model, tested in the sampled loop."""

from dataclasses import replace

import control
import numpy as np

import gough_stewart as gs

SAMPLE_TIME = 1e-3
STATE = ("position", "orientation", "velocity", "angular_velocity")

# linearised at rest, smoothed Coulomb friction would act as a very strong damper
platform = replace(gs.load_preset("motion_base"), leg_coulomb_friction=0.0)
linear = gs.linearise(platform, outputs=STATE)
plant = control.sample_system(control.ss(linear.A, linear.B[:, :6], np.eye(12), 0), SAMPLE_TIME)
# equal weights for 1 cm, 0.01 rad, 5 cm/s, 0.05 rad/s and 1 kN in one leg
Q = np.diag([1 / 0.01**2] * 6 + [1 / 0.05**2] * 6)
R = np.eye(6) / 1000**2
gain, _, poles = control.dlqr(plant, Q, R)
print("slowest closed-loop pole [1/s]:", round(np.log(np.abs(poles).max()) / SAMPLE_TIME, 2))

controller = gs.LinearController(control.ss([], [], [], gain, SAMPLE_TIME), signals=STATE)
for name in ("heave_step", "impulse"):
    record = gs.run(name, controller=controller)
    peak = gs.metrics(record)["tracking"]["position"]["norm_peak"]
    print(f"{name}: {record.metadata['outcome']['status']}, peak position error {1000 * peak:.2f} mm")
