"""What a machine plans itself, as data for c/machine: a shipped motion's kind and coefficients, and a hand's filter.

A motion's kind is a number of C's functions, see `plan_c`; a table or path is its pieces.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.control.controllers import Feedforward
from gough_stewart.harness.control.smoothing import Smoothing, SmoothingChoice
from gough_stewart.harness.loop.libraries import coefficients_of
from gough_stewart.harness.motion.motion import Piecewise, Reference, end_of
from gough_stewart.harness.motion.references import AboutPose, Chirp, Circle, Hold, PointToPoint, Sine, Step
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

N_MOTION = 18
FEEDFORWARD: tuple[Feedforward, ...] = ("none", "gravity", "computed_torque")
# What the first two numbers of a motion's kinds mean in c/machine.
GIVEN, PIECES = "given", "pieces"
_FADED = "faded"
# Of positions [m] and angles [rad].
BY_HAND = (
    SmoothingChoice(bandwidth=1.5, largest_rate=0.3, largest_acceleration=2.0),
    SmoothingChoice(bandwidth=1.5, largest_rate=0.5, largest_acceleration=4.0),
)


class Plan(NamedTuple):
    """What a run follows, for a machine that computes it itself."""

    reference: Reference
    platform: Platform  # the nominal one
    feedforward: Feedforward
    ahead: float  # by which forces look ahead [s]
    by_hand: "tuple[SmoothingChoice, SmoothingChoice] | None" = None  # limits of positions and angles by hand


class PlannedMotion(NamedTuple):
    """A motion as data."""

    kind: int  # number of its kind
    coefficients: FloatArray
    begins: FloatArray  # of pieces (n,) [s]
    pieces: FloatArray  # (n, 6, 6), highest power first
    end: float  # [s]


def planned_motion(reference: Reference) -> PlannedMotion | None:
    """A motion that C has; None for another one."""
    nothing = np.zeros(0)
    if isinstance(reference, Piecewise):
        begins, pieces = reference.pieces
        return PlannedMotion(kinds().index(PIECES), nothing, begins, pieces, reference.end)
    if not isinstance(reference, AboutPose):
        return None
    name = _name(reference)
    if name not in kinds():
        return None
    values = [np.ravel(getattr(reference, key)) for key in keys_of(type(reference), name)]
    return PlannedMotion(kinds().index(name), np.concatenate(values).astype(float), nothing, nothing, end_of(reference))


def kinds() -> tuple[str, ...]:
    """The kinds of motions by number."""
    return (GIVEN, PIECES, *(name for name, _ in variants()))


def variants() -> Iterator[tuple[str, AboutPose]]:
    """Each kind by name, with symbols or structure in the place of its keys."""
    for kind in (Hold, Step, PointToPoint):
        yield kind.model_fields["type"].default, kind.model_construct()
    for swing in (Sine, Chirp):
        for faded in ("", f"_{_FADED}"):
            yield f"{swing.model_fields['type'].default}{faded}", swing.model_construct()
    for plane in ("xy", "xz", "yz"):
        for faded in ("", f"_{_FADED}"):
            yield f"circle_{plane}{faded}", Circle.model_construct(plane=plane)


def _name(reference: AboutPose) -> str:
    parts = [str(getattr(reference, "type", "")), str(getattr(reference, "plane", ""))]
    parts.append(_FADED if getattr(reference, "fade_in", 0.0) > 0 else "")
    return "_".join(filter(None, parts))


def keys_of(kind: type[AboutPose], name: str) -> list[str]:
    """The keys that are coefficients, in order."""
    structure = {"type", "plane"} | ({"fade_in"} if _FADED not in name else set())
    return [key for key in kind.model_fields if key not in structure]


def smoothing(choice: SmoothingChoice, period: float) -> FloatArray:
    """Coefficients of the filter of a hand's three channels, stepped every `period` [s]."""
    values = {key: np.array([getattr(choice, key)]) for key in Smoothing.keys}
    return coefficients_of(Smoothing, values, period)[:, 0]
