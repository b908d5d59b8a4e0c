"""Design a PD controller on the linear model, print its margins, run it on the FMU, and save the results."""

import gough_stewart as gs

platform = gs.load_preset("motion_base")
gains = gs.gains_from_bandwidth(platform, bandwidth=2.0, damping_ratio=0.8)  # Hz
controller = gs.sampled(gs.pid(gains, "measurement"), 1e-3)
print(gs.margins("heave_step", controller=controller))

record = gs.run("heave_step", plant="fmu3", controller=controller)
print(gs.metrics(record)["step_response"])
gs.save_record(record, "results/designed")  # record and metrics
