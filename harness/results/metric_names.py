"""Display names of metrics: words, unit, scale."""

from typing import NamedTuple


class Shown(NamedTuple):
    """How a value in SI units is displayed."""

    text: str
    unit: str
    factor: float


_POSE = {"position": ("mm", 1e3), "orientation": ("mrad", 1e3), "leg_length": ("mm", 1e3)}
_KINDS = {
    "rms": "RMS of an axis",
    "peak": "peak of an axis",
    "norm_rms": "RMS",
    "norm_peak": "peak",
}
_STEP = {
    "overshoot_percent": ("overshoot", "%"),
    "rise_time": ("rise time", "s"),
    "settling_time": ("settling time", "s"),
    "at": ("step at", "s"),
}
_OTHER = {
    "tracking.leg_length.rms": ("leg error, RMS", "mm", 1e3),
    "tracking.leg_length.peak": ("leg error, peak", "mm", 1e3),
    "force.peak": ("peak force", "N", 1.0),
    "force.rms": ("RMS force", "N", 1.0),
    "power.peak": ("peak power", "W", 1.0),
    "power.mean": ("mean power", "W", 1.0),
    "energy.absolute_total": ("work, absolute", "J", 1.0),
    "energy.net_total": ("work, net", "J", 1.0),
    "saturation.force_limited.any": ("force limited", "%", 100.0),
    "saturation.rate_limited.any": ("rate limited", "%", 100.0),
    "stroke.margin": ("stroke margin", "mm", 1e3),
    "stroke.exceeded.any": ("beyond stroke", "%", 100.0),
    "margins.disk": ("disk margin", "", 1.0),
    "margins.stable": ("stable", "", 1.0),
}


def shown_metric(path: str) -> Shown:
    """Words, unit and scale of a metric, by its path."""
    if path in _OTHER:
        return Shown(*_OTHER[path])
    first, *middle, last = path.split(".") if "." in path else (path, "")
    found = Shown(path, "", 1.0)
    if first == "tracking":
        unit, factor = _POSE[middle[0]]
        found = Shown(f"{middle[0]} error, {_KINDS.get(last, last)}", unit, factor)
    elif first == "step_response" and last in _STEP:
        found = Shown(f"{middle[0]}: {_STEP[last][0]}", _STEP[last][1], 1.0)
    elif first == "step_response":
        found = Shown(f"{middle[0]}: {last.replace('_', ' ')}", "mm" if middle[0] in "xyz" else "mrad", 1e3)
    elif first == "limits" and last == "used":
        found = Shown(f"{middle[0].removesuffix('_max').replace('_', ' ')}, of its limit", "%", 100.0)
    return found
