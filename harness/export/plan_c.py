"""C of what a machine plans: shipped motions, and forces along them, traced from their one description."""

from collections.abc import Iterator
from typing import Any

import casadi
import numpy as np

from gough_stewart.fmu_build.codegen import in_lanes
from gough_stewart.harness.control.smoothing import Smoothing
from gough_stewart.harness.export import symbols
from gough_stewart.harness.export.machine import N_MOTION, keys_of, motion_variants
from gough_stewart.harness.export.trace import feedforward_of, motion_in, solve_by_orthogonal, vector_of
from gough_stewart.harness.loop.libraries import traced
from gough_stewart.harness.motion.limits.reach import legs_of
from gough_stewart.harness.motion.motion import coordinates_of, extrapolated, motion_of
from gough_stewart.harness.motion.references import AboutPose
from gough_stewart.model import interface
from gough_stewart.model.kinematics import leg_jacobian


def plan_header() -> str:
    """`plan.h`: the motions by kind, and what follows from a motion."""
    functions = [_motion(name, choice) for name, choice in motion_variants()]
    texts = [in_lanes(function, "static void plan_", exact=True) for function in (*functions, *_along())]
    names = ", ".join(["0", "0", *(f"plan_{function.name()}" for function in functions)])
    by_hand, size, _ = traced(Smoothing, "smoothing", 3)
    return (
        f"#define N_SMOOTHING {size}\n{by_hand}"
        + "".join(texts)
        + f"\nstatic void (*const MOTIONS[])(const double[], const double[], double[]) = {{{names}}};\n"
    )


def _motion(name: str, choice: AboutPose) -> casadi.Function:
    keys = keys_of(type(choice), name)
    sizes = [3 if key.startswith(("position", "orientation")) else 1 for key in keys]
    c, time = casadi.SX.sym("coefficients", sum(sizes)), casadi.SX.sym("time")
    values = np.split(symbols.elements(c), np.cumsum(sizes)[:-1])
    fields: dict[str, Any] = {**dict(zip(keys, values, strict=True)), "plane": getattr(choice, "plane", None)}
    with_symbols = type(choice).model_construct(**{"fade_in": 0.0, **fields})
    motion = with_symbols(symbols.elements(time))
    return casadi.Function(name, [c, time], casadi.cse([vector_of(motion)]), ["coefficients", "time"], ["motion"])


def _along() -> Iterator[casadi.Function]:
    """What follows from a motion (18), and a pose with its rates, and the platform's parameters."""
    vector = casadi.SX.sym("motion", N_MOTION)
    p = casadi.SX.sym("platform", interface.size_of(interface.PLATFORM_PARAMETERS))
    ends = np.cumsum([0, *(v.size for v in interface.PLATFORM_PARAMETERS)]).tolist()
    by_name = {v.name: p[a:b] for v, a, b in zip(interface.PLATFORM_PARAMETERS, ends, ends[1:], strict=False)}
    parameters: Any = symbols.parameters_of(by_name)
    at = motion_in(vector)

    def function(name: str, **outputs: Any) -> casadi.Function:
        results = casadi.cse([casadi.densify(symbols.column(array)) for array in outputs.values()])
        return casadi.Function(name, [vector, p], results, ["motion", "platform"], [*outputs])

    legs: Any = legs_of(parameters, at)
    yield function("signals", reference=np.concatenate([*at[:4], *legs, *at[4:]], axis=-1))
    J = leg_jacobian(parameters, at.position, at.orientation)
    transposed = np.swapaxes(J, -1, -2)
    rows = [solve_by_orthogonal(transposed, np.eye(6)[k : k + 1].astype(object)) for k in range(6)]
    yield function("maps", jacobian=J, inverse=np.concatenate(rows, axis=0))
    for kind in ("gravity", "computed_torque"):
        yield function(kind, force=symbols.elements(feedforward_of(kind, parameters, at)))
    ahead = casadi.SX.sym("ahead")
    later = vector_of(extrapolated(at, symbols.row(ahead)))
    yield casadi.Function("extrapolated", [vector, ahead], [later], ["motion", "ahead"], ["later"])
    parts = {name: casadi.SX.sym(name, 6) for name in ("pose", "rate", "acceleration")}
    coordinates = casadi.vertcat(*map(symbols.column, coordinates_of(at)))
    yield casadi.Function("coordinates", [vector], [casadi.densify(coordinates)], ["motion"], ["coordinates"])
    of_pose = vector_of(motion_of(*map(symbols.row, parts.values())))
    yield casadi.Function("motion_of_pose", [*parts.values()], [of_pose], [*parts], ["motion"])
