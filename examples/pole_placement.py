"""State feedback by pole placement, and the decay rate in the simulation."""

import control
import numpy as np

import gough_stewart as gs

SAMPLE_TIME = 1e-3
STATE = ("position", "orientation", "velocity", "angular_velocity")

platform = gs.load_preset("liu2000")
at_rest = gs.trim(platform).state
linear = gs.linearise(platform, outputs=STATE)
plant = control.sample_system(control.ss(linear.A, linear.B[:, :6], np.eye(12), 0), SAMPLE_TIME)
# two poles for each degree of freedom; the slowest is at −4/s
poles = -np.concatenate([np.linspace(4, 6, 6), np.linspace(12, 18, 6)])
gain = control.place(plant.A, plant.B, np.exp(poles * SAMPLE_TIME))

# start along the eigenvector of the slowest pole, so the run has only this mode
values, vectors = np.linalg.eig(plant.A - plant.B @ gain)
slowest = np.real(vectors[:, np.abs(values).argmax()])
start = at_rest + 1e-3 * slowest / np.abs(slowest).max()
settings = {"reference": {"type": "hold"}, "loop.duration": 1, "change": []}
settings |= {f"start.{name}": start[3 * k : 3 * k + 3] for k, name in enumerate(STATE)}

controller = gs.LinearController(control.ss([], [], [], gain, SAMPLE_TIME), signals=STATE)
record = gs.run("payload_change", settings, controller=controller)
error, time = np.linalg.norm(record["error.position"], axis=1), record["time"]
rate = np.polyfit(time, np.log(error), 1)[0]
print(f"slowest pole: {poles.max():.2f} 1/s by design, {rate:.2f} 1/s in the simulation")
