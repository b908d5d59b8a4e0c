"""The files of a check: numbers, needs and figure."""

import json
from typing import Any

from gough_stewart.harness.experiment.checking import MotionCheck
from gough_stewart.harness.motion.limits.needs import Needs
from gough_stewart.harness.motion.limits.shares_figure import shares_pictures
from gough_stewart.harness.motion.limits.shares_tables import LEGS, finite
from gough_stewart.harness.output.versions import versions

FILES = ("check.json", "needs.csv", "shares.png", "shares.svg")


def check_files(found: MotionCheck) -> dict[str, bytes]:
    """Numbers and figure by file name."""
    numbers = {**as_dict(found), "versions": versions()}
    return {
        "check.json": (json.dumps(numbers, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode(),
        "needs.csv": _needs_csv(found.needs),
        **shares_pictures(found.shares, f"{found.experiment.title}: shares of the limits of {found.platform.name}"),
    }


def _needs_csv(needs: Needs) -> bytes:
    """One row for each leg, one column for each figure with its unit: "actuator_force_peak [N]"."""
    import polars

    columns = {f"{name} [{need.unit}]": need.of_leg for name, need in needs.of.items()}
    return polars.DataFrame({"leg": LEGS, **columns}).fill_nan(None).write_csv().encode()


def as_dict(found: MotionCheck) -> dict[str, Any]:
    """The largest share of every limit, its time, and all needs, as plain numbers; None for what is not finite."""
    limits = {}
    for name, share in found.shares.of.items():
        peaks = [found.shares.peak(name, leg) for leg in LEGS] if share.ndim == 2 else [found.shares.peak(name)]
        used, times = [finite(peak.share) for peak in peaks], [peak.time for peak in peaks]
        limits[name] = {"share": used, "time": times} if share.ndim == 2 else {"share": used[0], "time": times[0]}
    largest = found.shares.largest
    return {
        "title": found.experiment.title,
        "platform": found.platform.name,
        "within": found.within,
        "margin": found.margin,
        "keeps_margin": found.keeps_margin,
        "not_stated": list(found.not_stated),
        "largest": {**largest._asdict(), "share": finite(largest.share)},
        "time_factor": found.time_factor,
        "amplitude_factor": found.amplitude_factor,
        "limits": limits,
        "needs": {
            name: {"unit": need.unit, "of_leg": [finite(float(value)) for value in need.of_leg]}
            for name, need in found.needs.of.items()
        },
        "needs_notes": list(found.needs.notes),
    }
