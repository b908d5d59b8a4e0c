"""A controller as a function: computed torque from the measured state, for a circle, on the FMU."""

import numpy as np

import gough_stewart as gs

OMEGA, ZETA = 2 * np.pi * 3, 1.0


def feedback_linearisation(sample: gs.Sample) -> np.ndarray:
    """F from inverse dynamics at the measured state, for the acceleration a_r + 2 ζ ωn ė + ωn² e."""
    r, y, platform = sample.reference, sample.measured, sample.platform
    J = gs.leg_jacobian(platform, y["position"], y["orientation"])
    # pose errors computed from the leg errors, in world components
    e, de = (np.linalg.solve(J, r[name] - y[name]) for name in ("leg_length", "leg_velocity"))
    a_r = np.concatenate([r["acceleration"], r["angular_acceleration"]])
    a = a_r + 2 * ZETA * OMEGA * de + OMEGA**2 * e
    state = gs.State(y["position"], y["orientation"], y["velocity"], y["angular_velocity"])
    return gs.inverse_dynamics(platform, state, gs.Acceleration(a[:3], a[3:]))


experiment = gs.load_experiment("circle", {"loop.duration": 3, "controller.feedforward": "none"})
for name, controller in (("PD without feedforward", None), ("feedback linearisation", feedback_linearisation)):
    record = gs.run(experiment, plant="fmu3", controller=controller)
    error = 1000 * np.linalg.norm(record["error.position"], axis=1)
    print(f"{name}: peak error {error.max():.2f} mm, at the end {error[-1]:.2f} mm")
