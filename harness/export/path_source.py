"""C source of a motion along a path: its splines, and its time law at the knots, in both precisions.

The harness plays a path as quintics between the knots of its time law. There are thousands of them; the path's splines
and the law at its knots are a tenth of that. What the law keeps in 32 bits changes forces by less than 1e-6 of the
largest, see `path_deviation`. A table of the platform's coordinates would be larger: along a fastest path,
accelerations have a kink or jump at every knot, and 1e-6 of the forces takes 380 kB of six coordinates.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.harness.control.controllers import feedforward
from gough_stewart.harness.export import symbols
from gough_stewart.harness.export.relative import Home
from gough_stewart.harness.export.single import halves
from gough_stewart.harness.export.table_source import first_step, parted
from gough_stewart.harness.export.texts import filled, number, numbers, read
from gough_stewart.harness.motion.limits.reach import legs_of
from gough_stewart.harness.motion.motion import ROUNDING, Piecewise, coordinates_of, smaller
from gough_stewart.harness.motion.paths.polynomials import Polynomials
from gough_stewart.harness.motion.paths.time_law import AlongPath, Averaged, Quintic, Stretched, TimedPath, TimeLaw
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

_TEXT = read("path.c")
# Of the path parameter, which is at most 1, in 32 bits with a sign: a float of that size would move legs by 30 nm.
_UNIT = 2.0**-31
# Instants at which motions are compared.
_COMPARED = 20_000


class KnotTable(NamedTuple):
    """A time law at its knots in 32-bit numbers, as C has it; each (n,)."""

    knots: FloatArray  # since the start [s]
    begins: FloatArray  # path parameter at which the spline's piece begins
    values: FloatArray  # path parameter since then, in units of 2⁻³¹
    rates: FloatArray  # [1/s]
    accelerations: FloatArray  # [1/s²]
    jerks: FloatArray  # from a knot to the next [1/s³] (n − 1,)

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.knots[-1])

    def __call__(self, time: FloatArray) -> AlongPath:
        """At times (n,) [s], as C computes in double precision."""
        knot = np.searchsorted(self.knots[:-1], time, side="right") - 1
        since, jerk = time - self.knots[knot], self.jerks[knot]
        rate, acceleration = self.rates[knot], self.accelerations[knot]
        value = self.begins[knot] + _UNIT * self.values[knot]
        value = value + since * (rate + since * (acceleration / 2 + since * jerk / 6))
        return AlongPath(value, rate + since * (acceleration + since * jerk / 2), acceleration + since * jerk)


def path_of(reference: object) -> TimedPath | None:
    """The path that a motion follows; None if it is another motion."""
    return reference.source if isinstance(reference, Polynomials) else None


def path_function(source: TimedPath, home: Home | None = None) -> casadi.Function:
    """CasADi Function `motion_of_path`: splines and two derivatives, ṡ, s̈ -> pose, rate, acceleration."""
    parts = {name: casadi.SX.sym(name, 6) for name in ("spline", "slope", "bend")}
    speed = {name: casadi.SX.sym(name) for name in ("speed", "change")}
    splines = [symbols.row(part) for part in parts.values()]
    if home is not None:  # the splines of positions are relative
        splines[0] = splines[0] + np.concatenate([home.position, np.zeros(3)])
    point = source.path.point(*splines)
    motion: Any = point.motion(*(symbols.elements(each) for each in speed.values()))
    if source.amplitude != 1:
        motion = smaller(
            motion, source.amplitude, np.concatenate([source.path.position[0], source.path.orientation[0]])
        )
    pose, *rates = coordinates_of(motion)
    if home is not None:
        pose = pose - home.pose
        if source.amplitude == 1:
            pose[:, :3] = symbols.row(parts["spline"])[:, :3]
    outputs = zip(("pose", "rate", "acceleration"), (pose, *rates), strict=True)
    return symbols.function("motion_of_path", {**parts, **speed}, {name: symbols.column(v) for name, v in outputs})


def path_source(reference: Piecewise, source: TimedPath, home: Home | None = None) -> str:
    """The splines, the law, and their evaluation; `motion_of_path` stands before it."""
    begins, pieces = source.path.pieces
    end, start = (reference.end, 0.0), (source.start, 0.0)
    if home is not None:
        end, start = halves(reference.end), halves(source.start)
        pieces = pieces.copy()
        pieces[:, :3, -1] -= home.position
    rows = ["    {" + ", ".join("{" + numbers(each) + "}" for each in piece) + "}," for piece in pieces]
    law = _unstretched(source.law)
    facts: dict[str, str | bool] = {
        "END": number(end[0]),
        "END_LOW": number(end[1]),
        "ROUNDING": number(ROUNDING),
        "START": number(start[0]),
        "START_LOW": number(start[1]),
        "DURATION": number(source.law.duration),
        "N_SPLINES": str(len(begins)),
        "N_POWERS": str(pieces.shape[2]),
        "SPLINE_AT": numbers(begins),
        "SPLINES": "\n".join(rows),
        "STEP": str(first_step(len(begins))),
        "stepwise": not isinstance(law, Quintic),
        "averaged": isinstance(law, Averaged),
        "single": home is not None,
    }
    if not isinstance(law, Quintic):
        table = _at_knots(source)
        high, low = (table.knots, table.knots) if home is None else parted(table.knots)
        facts |= {
            "N_KNOTS": str(len(table.knots)),
            "STEP": str(first_step(len(table.knots) - 1)),
            "TIMES": numbers(high),
            "TIMES_LOW": numbers(low),
            "FIRST_KNOTS": ", ".join(map(str, np.searchsorted(table.begins, begins).tolist())),
            "UNIT": number(_UNIT),
            "VALUES": ", ".join(map(str, table.values.astype(int).tolist())),
            "RATES": numbers(table.rates),
            "CHANGES": numbers(table.accelerations),
        }
    return filled(_TEXT, facts)


def path_deviation(platform: Platform, reference: Polynomials, source: TimedPath) -> str:
    """What rounding of the law costs in double precision, for the header."""
    exported = source if isinstance(_unstretched(source.law), Quintic) else replace(source, law=_at_knots(source))
    times = source.start + np.linspace(0, 1, _COMPARED + 1)[1:-1] * source.law.duration
    motions = exported(times), reference(times)
    forces = [feedforward("computed_torque", platform, motion) for motion in motions]
    force = np.abs(forces[0] - forces[1]).max() / np.abs(forces[1]).max()
    length, velocity = (
        np.abs(a - b).max() for a, b in zip(*(legs_of(platform, each) for each in motions), strict=True)
    )
    return (
        f"The motion along the path differs from that of a run, in double precision: its computed torque by at most "
        f"{force:.2g} of the largest, leg lengths by {length:.2g} m, leg velocities by {velocity:.2g} m/s."
    )


def _at_knots(source: TimedPath) -> KnotTable:
    knots, (begins, _) = source.law.knots, source.path.pieces
    at = source.law(knots)
    begin = begins[np.searchsorted(begins, at.value, side="right") - 1]
    rates, accelerations = parted(at.rate)[0], parted(at.acceleration)[0]
    is_linear = isinstance(_unstretched(source.law), Averaged)
    jerks = is_linear * np.diff(accelerations) / np.diff(knots)
    return KnotTable(knots, begin, np.rint((at.value - begin) / _UNIT), rates, accelerations, jerks)


def _unstretched(law: TimeLaw) -> TimeLaw:
    while isinstance(law, Stretched):
        law = law.law
    return law
