"""Records made from closed-form motions, for tests of what is drawn from them."""

import re
from typing import Any

import numpy as np
import polars

from gough_stewart.harness.results.record import Record, columns, plain
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray
from tests.support.orientations import rotation_vectors


def waving_record(
    platform: Platform, rows: int = 501, size: float = 0.04, step: float = 1e-3, **metadata: Any
) -> Record:
    """Six sines of different frequencies about home, wanted a little ahead of actual; forces are sines as well."""
    time = step * np.arange(rows)
    length = platform.characteristic_length

    def pose(shift: float) -> tuple[FloatArray, FloatArray]:
        phases = 2 * np.pi * (time[:, None] + shift) * np.arange(1, 7) / 3
        waves = size * np.sin(phases)
        return platform.home_position + length * waves[:, :3], platform.home_orientation + 2 * waves[:, 3:]

    actual, wanted = pose(0.0), pose(5e-3)
    lengths, wanted_lengths = (leg_geometry(platform, *each).length for each in (actual, wanted))
    after, before = (leg_geometry(platform, *pose(shift)).length for shift in (1e-6, -1e-6))
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
        table |= dict(zip(columns(name, values.shape[1]), values.T.copy(), strict=True))
    known = {
        "title": "six sines",
        "plant": "closed form",
        "outcome": {"status": "completed", "time": float(time[-1]), "cause": None},
        "duration": float(time[-1]),
        "force_limit": 100.0,
        "platform": plain(platform),
        "versions": {"python": "3"},
    }
    return Record(polars.DataFrame(table), {**known, **metadata})


def oscillating(record: Record, leg: int = 5, frequency: float = 40.0, amplitude: float = 3e-3) -> Record:
    """The same with a sine as the error of one leg [Hz, m], and errors at rest of the others; the reference stands."""
    wave = amplitude * np.sin(2 * np.pi * frequency * record["time"])
    errors = {f"error.leg_length[{k}]": wave if k == leg else 1e-3 * k + 0 * wave for k in range(1, 7)}
    standing = {name: np.full_like(wave, record[name][0]) for name in columns("reference.leg_length", 6)}
    return Record(record.table.with_columns(**errors, **standing), record.metadata)


def says_it_oscillates(text: str, leg: int = 5, frequency: float = 40.0, amplitude: float = 3e-3) -> bool:
    """Whether a text on an outcome after 0.5 s names what `oscillating` made, to 1 % and what to do."""
    said = re.fullmatch(
        r"completed at 0\.5 s; leg (\d) oscillates at (\S+) Hz by itself, with an amplitude of (\S+) mm\. Lower .*",
        text,
    )
    if said is None:
        return False
    found, expected = [float(each) for each in said.groups()], [leg, frequency, 1e3 * amplitude]
    return bool(np.allclose(found, expected, rtol=0.01))
