"""Records made from closed-form motions, for tests of what is drawn from them."""

import re
from typing import Any

import numpy as np
import polars
from numpy.typing import ArrayLike, NDArray

import gough_stewart as gs
from tests.support.orientations import rotation_vectors

Floats = NDArray[np.float64]


def columns(name: str, values: ArrayLike) -> dict[str, Any]:
    """The columns of a vector (n, size) in a record, by their names."""
    return {f"{name}[{k + 1}]": column for k, column in enumerate(np.array(values).T.copy())}


def plain(platform: gs.Platform) -> dict[str, Any]:
    """A platform as the metadata of a run have it."""
    return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in platform.as_dict().items()}


def changed(record: gs.Record, **values: ArrayLike) -> gs.Record:
    """The record with other values of some vectors; names have two underscores for a dot."""
    new: dict[str, Any] = {}
    for name, value in values.items():
        vector = name.replace("__", ".")
        new |= columns(vector, np.broadcast_to(value, record[vector].shape))
    return gs.Record(record.table.with_columns(**{name: polars.Series(v) for name, v in new.items()}), record.metadata)


def log_file(log: gs.Log, path: str) -> str:
    """The log as a file of another origin: other units, underscores."""
    assert log.time is not None
    assert log.actuator_force is not None
    values = {"time [ms]": 1e3 * log.time}
    values |= {f"leg_length_{k + 1} (mm)": 1e3 * log.leg_length[:, k] for k in range(6)}
    values |= {f"actuator_force[{k + 1}] [kN]": 1e-3 * log.actuator_force[:, k] for k in range(6)}
    polars.DataFrame(values).write_csv(path)
    return path


def waving_record(
    platform: gs.Platform, rows: int = 501, size: float = 0.04, step: float = 1e-3, **metadata: Any
) -> gs.Record:
    """Six sines of different frequencies about home, wanted a little ahead of actual; forces are sines as well."""
    time = step * np.arange(rows)
    length = platform.characteristic_length

    def pose(shift: float) -> tuple[Floats, Floats]:
        phases = 2 * np.pi * (time[:, None] + shift) * np.arange(1, 7) / 3
        waves = size * np.sin(phases)
        return platform.home_position + length * waves[:, :3], platform.home_orientation + 2 * waves[:, 3:]

    actual, wanted = pose(0.0), pose(5e-3)
    lengths, wanted_lengths = (gs.leg_geometry(platform, *each).length for each in (actual, wanted))
    after, before = (gs.leg_geometry(platform, *pose(shift)).length for shift in (1e-6, -1e-6))
    force = 100 * np.sin(5 * time[:, None] + np.arange(6))
    parts = {
        "position": actual[0],
        "orientation": actual[1],
        "leg_length": lengths,
        "leg_velocity": (after - before) / 2e-6,
        "actuator_force": force,
        "external_force": np.where(time[:, None] > 0.1, [0.0, 30.0, 0.0], 0.0),
        "reference.position": wanted[0],
        "reference.orientation": wanted[1],
        "reference.leg_length": wanted_lengths,
        "error.position": wanted[0] - actual[0],
        "error.orientation": rotation_vectors(actual[1], wanted[1]),
        "error.leg_length": wanted_lengths - lengths,
        "flag.force_limited": np.abs(force) > 99,
        "flag.stroke_exceeded": np.zeros((rows, 6), dtype=bool),
    }
    table: dict[str, Any] = {"time": time}
    for name, values in parts.items():
        table |= columns(name, values)
    known = {
        "title": "six sines",
        "plant": "closed form",
        "outcome": {"status": "completed", "time": float(time[-1]), "cause": None},
        **{"duration": float(time[-1]), "force_limit": 100.0, "platform": plain(platform), "versions": {"python": "3"}},
    }
    return gs.Record(polars.DataFrame(table), {**known, **metadata})


def stepping(
    platform: gs.Platform, tau: float, size: float, off: float = 0.0, at: int = 100, **others: ArrayLike
) -> gs.Record:
    """A second with a step along z in a row [m], followed with a time constant [s] to a rest that is off; all rests."""
    time = 1e-3 * np.arange(1001)
    wanted = np.where(time < time[at], 0.0, size)
    actual = np.where(time < time[at], 0.0, (size - off) * (1 - np.exp(-(time - time[at]) / tau)))
    z, home, turned = np.array([0.0, 0.0, 1.0]), platform.home_position, platform.home_orientation
    values: dict[str, ArrayLike] = {
        "position": home + np.outer(actual, z), "reference__position": home + np.outer(wanted, z),
        "error__position": np.outer(wanted - actual, z), "orientation": turned, "reference__orientation": turned,
        **dict.fromkeys(("error__orientation", "error__leg_length", "leg_velocity", "flag__force_limited"), 0.0),
    }  # fmt: skip
    return changed(waving_record(platform, rows=1001), **values, **others)


def oscillating(record: gs.Record, leg: int = 5, frequency: float = 40.0, amplitude: float = 3e-3) -> gs.Record:
    """The same with a sine as the error of one leg [Hz, m], and errors at rest of the others; the reference stands."""
    wave = amplitude * np.sin(2 * np.pi * frequency * record["time"])
    errors = {f"error.leg_length[{k}]": wave if k == leg else 1e-3 * k + 0 * wave for k in range(1, 7)}
    standing = columns("reference.leg_length", np.repeat(record["reference.leg_length"][:1], len(wave), axis=0))
    return gs.Record(record.table.with_columns(**errors, **standing), record.metadata)


def says_it_oscillates(text: str, leg: int = 5, frequency: float = 40.0, amplitude: float = 3e-3) -> bool:
    """Whether a text on an outcome after 0.5 s names what `oscillating` made, to 1 % and what to do."""
    motion = r"leg (\d) oscillates at (\S+) Hz without input, with an amplitude of (\S+) mm"
    said = re.fullmatch(rf"completed at 0\.5 s; {motion}\. Lower .*", text)
    return said is not None and np.allclose([*map(float, said.groups())], [leg, frequency, 1e3 * amplitude], rtol=0.01)
