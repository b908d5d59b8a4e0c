"""C of what a machine plans: shipped motions, and forces along them, traced from their one description.

A motion is data, too: its kind, and the values of its keys as coefficients; or the pieces of a table or path.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.fmu_build.lanes import in_lanes
from gough_stewart.harness.control.feedforward import Feedforward
from gough_stewart.harness.control.smoothing import Smoothing, SmoothingChoice
from gough_stewart.harness.export import symbols
from gough_stewart.harness.export.trace import solve_by_orthogonal
from gough_stewart.harness.loop.loop_library import coefficients_of, traced
from gough_stewart.harness.motion.motion import (
    Motion,
    Piecewise,
    Reference,
    coordinates_of,
    end_of,
    extrapolated,
    motion_of,
)
from gough_stewart.harness.motion.references import AboutPose, Chirp, Circle, Hold, PointToPoint, Sine, Step
from gough_stewart.model import interface
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics, static_leg_forces
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
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
    values = [np.ravel(getattr(reference, key)) for key in _keys(type(reference), name)]
    return PlannedMotion(kinds().index(name), np.concatenate(values).astype(float), nothing, nothing, end_of(reference))


def kinds() -> tuple[str, ...]:
    """The kinds of motions by number."""
    return (GIVEN, PIECES, *(name for name, _ in _variants()))


def plan_header() -> str:
    """`plan.h`: the motions by kind, and what follows from a motion."""
    functions = [_motion(name, choice) for name, choice in _variants()]
    texts = [in_lanes(each, "static void plan_", exact=True) for each in (*functions, *_along())]
    names = ", ".join(["0", "0", *(f"plan_{each.name()}" for each in functions)])
    by_hand, size, _ = traced(Smoothing, "smoothing", 3)
    return (
        f"#define N_SMOOTHING {size}\n{by_hand}"
        + "".join(texts)
        + f"\nstatic void (*const MOTIONS[])(const double[], const double[], double[]) = {{{names}}};\n"
    )


def _variants() -> Iterator[tuple[str, AboutPose]]:
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


def _keys(kind: type[AboutPose], name: str) -> list[str]:
    """The keys that are coefficients, in order."""
    structure = {"type", "plane"} | ({"fade_in"} if _FADED not in name else set())
    return [key for key in kind.model_fields if key not in structure]


def _motion(name: str, choice: AboutPose) -> casadi.Function:
    keys = _keys(type(choice), name)
    sizes = [3 if key.startswith(("position", "orientation")) else 1 for key in keys]
    c, time = casadi.SX.sym("coefficients", sum(sizes)), casadi.SX.sym("time")
    values = np.split(symbols.elements(c), np.cumsum(sizes)[:-1])
    fields: dict[str, Any] = {**dict(zip(keys, values, strict=True)), "plane": getattr(choice, "plane", None)}
    with_symbols = type(choice).model_construct(**{"fade_in": 0.0, **fields})
    motion = with_symbols(symbols.elements(time))
    return casadi.Function(name, [c, time], casadi.cse([_vector(motion)]), ["coefficients", "time"], ["motion"])


def _along() -> Iterator[casadi.Function]:
    """What follows from a motion (18), and a pose with its rates, and the platform's parameters."""
    vector = casadi.SX.sym("motion", N_MOTION)
    p = casadi.SX.sym("platform", interface.size_of(interface.PLATFORM_PARAMETERS))
    ends = np.cumsum([0, *(v.size for v in interface.PLATFORM_PARAMETERS)]).tolist()
    by_name = {v.name: p[a:b] for v, a, b in zip(interface.PLATFORM_PARAMETERS, ends, ends[1:], strict=False)}
    parameters: Any = symbols.parameters_of(by_name)
    at = Motion(*np.split(symbols.row(vector), 6, axis=-1))

    def function(name: str, **outputs: Any) -> casadi.Function:
        found = casadi.cse([casadi.densify(symbols.column(each)) for each in outputs.values()])
        return casadi.Function(name, [vector, p], found, ["motion", "platform"], [*outputs])

    legs = legs_of_symbols(parameters, at)
    yield function("signals", reference=np.concatenate([*at[:4], *legs, *at[4:]], axis=-1))
    J = leg_jacobian(parameters, at.position, at.orientation)
    transposed = np.swapaxes(J, -1, -2)
    rows = [solve_by_orthogonal(transposed, np.eye(6)[k : k + 1].astype(object)) for k in range(6)]
    yield function("maps", jacobian=J, inverse=np.concatenate(rows, axis=0))
    yield function(
        "gravity", force=static_leg_forces(parameters, at.position, at.orientation, solve=solve_by_orthogonal)
    )
    state, acceleration = State(*at[:4]), Acceleration(*at[4:])
    yield function(
        "computed_torque", force=inverse_dynamics(parameters, state, acceleration, solve=solve_by_orthogonal)
    )
    ahead = casadi.SX.sym("ahead")
    later = _vector(extrapolated(at, symbols.row(ahead)))
    yield casadi.Function("extrapolated", [vector, ahead], [later], ["motion", "ahead"], ["later"])
    parts = {name: casadi.SX.sym(name, 6) for name in ("pose", "rate", "acceleration")}
    coordinates = casadi.vertcat(*map(symbols.column, coordinates_of(at)))
    yield casadi.Function("coordinates", [vector], [casadi.densify(coordinates)], ["motion"], ["coordinates"])
    of_pose = _vector(motion_of(*map(symbols.row, parts.values())))
    yield casadi.Function("motion_of_pose", [*parts.values()], [of_pose], [*parts], ["motion"])


def smoothing(choice: SmoothingChoice, period: float) -> FloatArray:
    """Coefficients of the filter of a hand's three channels, stepped every `period` [s]."""
    values = {key: np.array([getattr(choice, key)]) for key in Smoothing.keys}
    return coefficients_of(Smoothing, values, period)[:, 0]


def legs_of_symbols(parameters: Any, at: Motion) -> tuple[Any, Any]:
    """Leg lengths and velocities (1, 6), by the function that plans them in Python."""
    from gough_stewart.model.kinematics import leg_geometry, rates_of_legs

    legs = leg_geometry(parameters, at.position, at.orientation)
    return legs.length, rates_of_legs(legs, State(*at[:4])).length_rate


def _vector(motion: Motion) -> casadi.SX:
    return casadi.densify(symbols.column(np.concatenate([np.asarray(part) for part in motion], axis=-1)))
