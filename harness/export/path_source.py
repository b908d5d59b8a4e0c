"""C source of a motion along a path: the quintics of the harness, computed again from the path and its time law.

The harness plays a path as quintics between the knots of its time law. There are thousands of them; the path's splines
and the law from which they were made are a tenth of that. At every time the code finds the piece, evaluates the motion
at its ends, and joins them by the same quintic.
"""

from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.harness.export import symbols
from gough_stewart.harness.export.relative import Home
from gough_stewart.harness.export.single import halves
from gough_stewart.harness.export.table_source import first_step, parted
from gough_stewart.harness.export.texts import filled, number, numbers, read
from gough_stewart.harness.motion.motion import ROUNDING, Piecewise, coordinates_of, smaller
from gough_stewart.harness.motion.paths.polynomials import PIECES, SHORT, SHORTEST, Polynomials
from gough_stewart.harness.motion.paths.time_law import Averaged, Quintic, Stepwise, Stretched, TimedPath, TimeLaw

_TEXT, _SINGLE = read("path.c"), read("path_single.c")


class Law(NamedTuple):
    """A time law taken apart."""

    steps: Stepwise | None  # None for a quintic law
    window: float  # over which it is averaged [s], 0 without
    stretch: float
    duration: float  # without the stretch [s]


def path_of(reference: object) -> TimedPath | None:
    """The path that a motion follows by a law that C has; None if it is another motion."""
    source = reference.source if isinstance(reference, Polynomials) else None
    return None if source is None or _taken_apart(source.law) is None else source


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
    """The splines, the law, and their evaluation; `motion_of_path` stands before it.

    In single precision the path is evaluated at the time itself, since differences of poses at the ends of a short
    piece are rounding; the law then is a table of its own values at the knots, for the same reason.
    """
    law = _taken_apart(source.law)
    assert law is not None
    begins, pieces = source.path.pieces
    if home is not None:
        pieces = pieces.copy()
        pieces[:, :3, -1] -= home.position
    rows = ["    {" + ", ".join("{" + numbers(each) + "}" for each in piece) + "}," for piece in pieces]
    facts: dict[str, str | bool] = {
        "END": number(reference.end),
        "ROUNDING": number(ROUNDING),
        "START": number(source.start),
        "STRETCH": number(law.stretch),
        "DURATION": number(law.duration),
        "N_KNOTS": str(PIECES + 1),
        "LONGEST": number(law.duration / PIECES),
        "SHORT": number(SHORT / law.stretch),
        "SHORTEST": number(SHORTEST / law.stretch),
        "N_SPLINES": str(len(begins)),
        "N_POWERS": str(pieces.shape[2]),
        "SPLINE_AT": numbers(begins),
        "SPLINES": "\n".join(rows),
        "SPLINE_STEP": str(first_step(len(begins))),
        "stepwise": law.steps is not None,
        "averaged": law.window > 0,
    }
    if home is not None:
        return filled(_SINGLE, facts | _in_single(reference, source, law))
    if law.steps is not None:
        knots = law.steps.knots
        facts |= {
            "N_KNOTS": str(len(knots)),
            "STEP": str(first_step(len(knots))),
            "WINDOW": number(law.window),
            "TIMES": numbers(knots),
            "VALUES": numbers(law.steps.grid),
            "RATES": numbers(np.sqrt(law.steps.squared_rate)),
            "AREAS": numbers(law.steps.integral(knots)),
        }
    return filled(_TEXT, facts)


def _in_single(reference: Piecewise, source: TimedPath, law: Law) -> dict[str, str | bool]:
    """Times as sums of two numbers, and the law at every knot."""
    (end, end_low), (start, start_low) = halves(reference.end), halves(source.start)
    facts: dict[str, str | bool] = {
        "END": number(end),
        "END_LOW": number(end_low),
        "START_HIGH": number(start),
        "START_LOW": number(start_low),
        "DURATION": number(source.law.duration),
    }
    if law.steps is None:
        return facts
    knots = source.law.knots
    at = source.law(knots)
    high, low = parted(knots)
    begins, _ = source.path.pieces
    piece = np.searchsorted(begins, at.value, side="right") - 1
    return facts | {
        "N_KNOTS": str(len(knots)),
        "STEP": str(first_step(len(knots) - 1)),
        "TIMES": numbers(high),
        "TIMES_LOW": numbers(low),
        "FIRST_KNOTS": ", ".join(map(str, np.searchsorted(piece, np.arange(len(begins))).tolist())),
        "VALUES": numbers(at.value - begins[piece]),
        "RATES": numbers(at.rate),
        "CHANGES": numbers(at.acceleration),
    }


def _taken_apart(law: TimeLaw) -> Law | None:
    stretch, window = 1.0, 0.0
    while isinstance(law, Stretched):
        stretch, law = stretch * law.factor, law.law
    duration = law.duration
    if isinstance(law, Averaged):
        window, law = law.window, law.law
    if isinstance(law, Stepwise):
        return Law(law, window, stretch, duration)
    return Law(None, 0.0, stretch, duration) if isinstance(law, Quintic) else None
