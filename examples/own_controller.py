"""Controllers of one's own: computed torque as a function, on the FMU; and a PID with anti-windup as a class, as C."""

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


class AntiWindup:
    """A PID in each leg, whose integral takes back what the force limits cut off."""

    def __init__(
        self, platform: gs.Platform, sample_time: float, bandwidth: float = 3.0, tracking: float = 0.1
    ) -> None:
        gains = gs.gains_from_bandwidth(platform, bandwidth, 0.8, integral_time=0.5)
        self.kp, self.ki, self.kd = gains.proportional, gains.integral * sample_time, gains.derivative
        self.back = sample_time / tracking
        self.integral = np.zeros(6)

    def __call__(self, sample: gs.Sample) -> np.ndarray:
        error = sample.reference["leg_length"] - sample.measured["leg_length"]
        self.integral = self.integral + self.ki * error + self.back * sample.excess
        return self.kp * error + self.integral - self.kd * sample.measured["leg_velocity"]


experiment = gs.load_experiment("circle", {"loop.duration": 3, "controller.feedforward": "none"})
for name, controller in (("PD without feedforward", None), ("feedback linearisation", feedback_linearisation)):
    record = gs.run(experiment, plant="fmu3", controller=controller)
    error = 1000 * np.linalg.norm(record["error.position"], axis=1)
    print(f"{name}: peak error {error.max():.2f} mm, at the end {error[-1]:.2f} mm")

print(f"anti-windup: disk margin {gs.margins('heave_step', controller=AntiWindup).disk.alpha:.2f}")
for path in gs.export("heave_step", controller=AntiWindup, forms="c", out="exported"):
    print(path)
