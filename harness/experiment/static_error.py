"""The static error of a PD without feedforward: the load over the controller's stiffness."""

import numpy as np

from gough_stewart.harness.results.record import Record, platform_of

# The last part of a run, in which a platform at rest moves less than this share of its error.
_PART = 0.2
_AT_REST = 0.02
# A noticeable error, as a share of the mean leg length.
_NOTICEABLE = 1e-4


def static_error(record: Record) -> list[str]:
    """What a platform that rests off its reference needs: a feedforward of gravity, or an integral; empty otherwise.

    At rest a PD acts as a spring, F = kp e, so the error is what the load, here the platform's weight, takes of it.
    """
    choice = record.metadata["experiment"]["controller"]
    if choice.get("type") != "pd" or choice.get("feedforward", "none") != "none" or "error.position" not in record:
        return []
    first = int((1 - _PART) * record.table.height)
    error, reference = record["error.position"][first:], record["reference.position"][first:]
    if len(error) < 2 or np.ptp(reference, axis=0).any() or not np.isfinite(error).all():
        return []
    mean = error.mean(axis=0)
    distance, scale = float(np.linalg.norm(mean)), float(record["leg_length"][0].mean())
    if distance < _NOTICEABLE * scale or np.abs(error - mean).max() > _AT_REST * distance:
        return []
    gravity = platform_of(record).gravity
    # e = reference − position points against gravity where the platform hangs below
    along = -float(mean @ gravity) / (distance * float(np.linalg.norm(gravity)) or 1.0)
    how = "hangs {:.3g} mm below" if along > 0.9 else "rests {:.3g} mm off"
    return [
        f"the platform {how.format(1000 * distance)} its reference at the end: the load over the stiffness of its PD; "
        "set controller.feedforward = 'gravity', or use a PID, whose integral takes it away"
    ]
