"""The metrics of a record a second time, from the words of `gs.metrics`: plain loops over the rows of its table."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import polars
import pytest

from tests.support.orientations import rotation_vectors

AXES = {axis: f"position[{k}]" for k, axis in enumerate(("x", "y", "z"), 1)}
AXES |= {axis: f"orientation[{k}]" for k, axis in enumerate(("roll", "pitch", "yaw"), 1)}
LEGS = range(1, 7)


def defined_metrics(table: polars.DataFrame, platform: Mapping[str, Any], is_whole: bool = True) -> dict[str, Any]:
    """All metrics but the outcome, of a closed loop's record whose numbers are finite."""
    rows = table.to_dicts()
    held = rows[:-1] or rows  # the last row lasts for no time
    time = [row["time"] for row in rows]
    duration = time[-1] - time[0]
    work = [[_work(a, b, leg) for a, b in pairwise(rows)] for leg in LEGS]
    net, absolute = list(map(sum, work)), [sum(map(abs, of_leg)) for of_leg in work]
    lengths = [_column(rows, f"leg_length[{leg}]") for leg in LEGS]
    return {
        "rows": len(rows),
        "duration": duration,
        "tracking": {
            name: _errors(rows, name, size, is_whole)
            for name, size in (("position", 3), ("orientation", 3), ("leg_length", 6))
        },
        "step_response": [step for axis in AXES if (step := _step(rows, axis)) is not None],
        "force": {
            "peak": [_largest(_column(rows, f"actuator_force[{leg}]")) for leg in LEGS],
            "rms": [_rms(_column(held, f"actuator_force[{leg}]")) for leg in LEGS],
        },
        "power": {
            "peak": [max(max(_powers(rows, k, leg)) for k in range(len(rows))) for leg in LEGS],
            "mean": [total / duration if duration else None for total in net],
        },
        "energy": {"net": net, "absolute": absolute, "net_total": sum(net), "absolute_total": sum(absolute)},
        "saturation": {name: _shares(held, name) for name in ("force_limited", "rate_limited")},
        "stroke": {
            "shortest": list(map(min, lengths)),
            "longest": list(map(max, lengths)),
            "margin": _margin(lengths, platform.get("leg_length_min"), platform.get("leg_length_max")),
            "exceeded": _shares(rows, "stroke_exceeded"),
        },
        "limits": _limits(rows, platform) or None,
    }


def same_to_rounding(found: Any, wanted: Any, at: str = "") -> None:
    """Compare two trees of numbers to rounding, with their keys and lengths."""
    if isinstance(wanted, Mapping):
        assert set(found) == set(wanted), at
        for key in wanted:
            same_to_rounding(found[key], wanted[key], f"{at}.{key}")
    elif isinstance(wanted, Sequence) and not isinstance(wanted, str):
        assert len(found) == len(wanted), at
        for k, part in enumerate(wanted):
            same_to_rounding(found[k], part, f"{at}[{k}]")
    elif isinstance(wanted, float):
        assert found == pytest.approx(wanted, rel=1e-11, abs=1e-13), at
    else:
        assert found == wanted, at


def as_one_number(found: Mapping[str, Any]) -> dict[str, float | None]:
    """The same by path, as in an ensemble's table: of a list the largest number, or of two paths the least."""
    flat: dict[str, float | None] = {}
    for name, part in found.items():
        if name == "step_response":
            flat |= {f"{name}.{step['axis']}.{key}": step[key] for step in part for key in step if key != "axis"}
        elif isinstance(part, Mapping):
            flat |= {f"{name}.{key}": value for key, value in as_one_number(part).items()}
        elif isinstance(part, Sequence):
            known = [value for value in part if value is not None]
            whole = len(known) == len(part) or name == "first_exceeded"
            least = name in ("shortest", "first_exceeded")
            flat[name] = (min(known) if least else max(known)) if known and whole else None
        else:
            flat[name] = part
    return flat


def _column(rows: Sequence[Mapping[str, Any]], name: str) -> list[float]:
    return [float(row[name]) for row in rows]


def _largest(values: Sequence[float]) -> float:
    return max(abs(value) for value in values)


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(math.fsum(value * value for value in values) / len(values))


def _errors(rows: Sequence[Mapping[str, Any]], name: str, size: int, is_whole: bool) -> dict[str, Any]:
    """Of reference minus actual, which are columns of their own; of orientations the rotation from actual to it."""
    wanted, actual = (
        [[row[f"{prefix}{name}[{k}]"] for k in range(1, size + 1)] for row in rows] for prefix in ("reference.", "")
    )
    gaps = [[a - b for a, b in zip(*each, strict=True)] for each in zip(wanted, actual, strict=True)]
    if name == "orientation":
        gaps = rotation_vectors(actual, wanted).tolist()
    found: dict[str, Any] = {
        "rms": [_rms([gap[k] for gap in gaps]) for k in range(size)],
        "peak": [_largest([gap[k] for gap in gaps]) for k in range(size)],
    }
    if name != "leg_length":
        norms = [math.hypot(*gap) for gap in gaps]
        # the last tenth of the rows of a run that came to its end
        last = norms[-max(2, -(-len(norms) // 10)) :]
        found |= {"norm_rms": _rms(norms), "norm_peak": max(norms), "norm_final": max(last) if is_whole else None}
    return found


def _work(row: Mapping[str, Any], following: Mapping[str, Any], leg: int) -> float:
    return float(row[f"actuator_force[{leg}]"] * (following[f"leg_length[{leg}]"] - row[f"leg_length[{leg}]"]))


def _powers(rows: Sequence[Mapping[str, Any]], k: int, leg: int) -> list[float]:
    """|F L̇| at both ends of a row, over which F is held."""
    force = rows[k][f"actuator_force[{leg}]"]
    return [abs(force * row[f"leg_velocity[{leg}]"]) for row in rows[k : k + 2]]


def _shares(rows: Sequence[Mapping[str, Any]], name: str) -> dict[str, Any]:
    flags = [[bool(row[f"flag.{name}[{leg}]"]) for leg in LEGS] for row in rows]
    of_legs = [sum(flag[k] for flag in flags) / len(flags) for k in range(6)]
    return {"legs": of_legs, "any": sum(any(flag) for flag in flags) / len(flags)}


def _margin(lengths: Sequence[Sequence[float]], least: float | None, most: float | None) -> float | None:
    room = [] if least is None else [min(map(min, lengths)) - least]
    room += [] if most is None else [most - max(map(max, lengths))]
    return min(room) if room else None


def _limits(rows: Sequence[Mapping[str, Any]], platform: Mapping[str, Any]) -> dict[str, Any]:
    found = {}
    values: dict[str, Any] = {
        "leg_velocity_max": lambda k, leg: abs(rows[k][f"leg_velocity[{leg}]"]),
        "actuator_force_max": lambda k, leg: abs(rows[k][f"actuator_force[{leg}]"]),
        "actuator_power_max": lambda k, leg: max(_powers(rows, k, leg)),
    }
    for name, value in values.items():
        limit = platform.get(name)
        if limit is None:
            continue
        used = [[value(k, leg) / limit for k in range(len(rows))] for leg in LEGS]
        beyond = [[row["time"] for row, share in zip(rows, of, strict=True) if share > 1] for of in used]
        first = [times[0] if times else None for times in beyond]
        found[name] = {"limit": limit, "used": [max(of) for of in used], "first_exceeded": first}
    return found


def _step(rows: Sequence[Mapping[str, Any]], axis: str) -> dict[str, Any] | None:
    """Of an axis whose reference goes from one value to another, where it stays for the last tenth of the rows."""
    column = AXES[axis]
    time, wanted, actual = (_column(rows, name) for name in ("time", f"reference.{column}", column))
    first, last = wanted[0], wanted[-1]
    rest = wanted[-max(2, math.ceil(len(rows) / 10)) :]
    if abs(last - first) <= 1e-9 or any(abs(value - last) > 1e-9 for value in rest):
        return None
    start = max(k for k, value in enumerate(wanted) if abs(value - first) <= 1e-9)
    if abs(wanted[start + 1] - last) <= 1e-9:
        start += 1  # a jump
    y = [(value - first) / (last - first) for value in actual[start:]]
    t = [value - time[start] for value in time[start:]]
    rose = max(y) >= 0.9
    outside = [k for k, value in enumerate(y) if abs(value - 1) >= 0.02]
    settled = outside[-1] + 1 if outside else 0
    return {
        **{"axis": axis, "from": first, "to": last, "at": time[start]},
        "overshoot_percent": max(0.0, 100 * (max(y) - 1)) if rose else 0.0,
        "rise_time": _first(t, y, 0.9) - _first(t, y, 0.1) if rose else None,
        "settling_time": t[settled] if rose and settled < len(y) else None,
        "final_error": last - actual[-1],
    }


def _first(t: Sequence[float], y: Sequence[float], level: float) -> float:
    return next(time for time, value in zip(t, y, strict=True) if value >= level)
