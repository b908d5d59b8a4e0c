"""Learning without a heavy dependency: the cross-entropy method finds the gains of a linear policy for a heave step.

Each of 64 members of one vector environment tries gains of its own, on a machine and with noise of its own. Needs the
extra `gym`.
"""

import numpy as np

import gough_stewart as gs

experiment = gs.load_experiment(
    "heave_step",
    {
        "loop.duration": 0.6,
        "reference.at": 0.05,
        "sensors.noise.leg_length": "20 um",
        "ensemble.platform_mass": {"factor": {"normal": [1, 0.15]}},
    },
)
OBSERVED = ["leg_length", "leg_velocity", "reference.leg_length"]
SCALES = np.array([500, 5e4, 5e3])  # of a bias [N] and two gains [N/m, N s/m]
MEMBERS, ELITE = 64, 12


def returns(env, gains, seed):
    """Return of each member's first episode under force = bias + kp (reference − length) − kd velocity, in each leg."""
    bias, kp, kd = (SCALES * gains).T[..., None]
    observed, _ = env.reset(seed=seed)
    total, goes_on = np.zeros(len(gains)), np.ones(len(gains), dtype=bool)
    while goes_on.any():
        length, velocity, wanted = np.split(observed, 3, axis=1)
        observed, rewards, terminated, truncated, _ = env.step(bias + kp * (wanted - length) - kd * velocity)
        total += rewards * goes_on
        goes_on &= ~(terminated | truncated)
    return total


def minus_distance(after):
    """Of all members, the platform's distance from its reference [m]."""
    return -np.linalg.norm(after.reference["position"] - after.state["position"], axis=1)


rng, mean, spread = np.random.default_rng(1), np.zeros(3), np.ones(3)
training = gs.vector_env(experiment, MEMBERS, observations=OBSERVED, reward=minus_distance)
for generation in range(8):
    tried = mean + spread * rng.standard_normal((MEMBERS, 3))
    best = tried[np.argsort(returns(training, tried, seed=generation))[-ELITE:]]
    mean, spread = best.mean(axis=0), best.std(axis=0) + 0.02
    print(f"generation {generation}: bias {mean[0] * SCALES[0]:.0f} N, gains {np.round(mean[1:] * SCALES[1:])}")

# 20 seeds that training has not seen: both policies on the same machine with the same noise
test = gs.vector_env(experiment, 1, observations=OBSERVED, reward=minus_distance)
gain = np.array(
    [returns(test, mean[None], seed)[0] - returns(test, np.zeros((1, 3)), seed)[0] for seed in range(1000, 1020)]
)
error = gain.std(ddof=1) / np.sqrt(len(gain))
print(f"the return is better by {gain.mean():.3g} ± {error:.2g} m, {gain.mean() / error:.1f} standard errors")
assert gain.mean() > 3 * error, "nothing was learned"
