"""The equations of a machine as C of c/machine: what it plans, and what a page turns while its loop runs.

All are traced from their one description in Python: `plan.h` has shipped motions and forces along them, `design.h` the
gains of a bandwidth, laws of gains, coefficients of components.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import casadi
import numpy as np

from gough_stewart.fmu_build.codegen import in_lanes
from gough_stewart.fmu_build.sources import defines
from gough_stewart.harness.control.by_hand import Smoothing
from gough_stewart.harness.control.component import Notch, Sensor, with_links
from gough_stewart.harness.control.laws_of_members import rest
from gough_stewart.harness.control.pid import (
    channel_matrices,
    default_times,
    gains_of_masses,
)
from gough_stewart.harness.control.state_space import matrices_at
from gough_stewart.harness.export import symbols
from gough_stewart.harness.export.machine import N_MOTION, REQUESTED, VARIANTS, keys_of, motion_variants
from gough_stewart.harness.export.trace import feedforward_of, motion_in, solve_by_orthogonal, vector_of
from gough_stewart.harness.loop.libraries import traced
from gough_stewart.harness.motion.limits.reach import legs_of
from gough_stewart.harness.motion.motion import coordinates_of, extrapolated, motion_of
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model import interface
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.vectors import greater, where

# ---- plan.h ----


def plan_header() -> str:
    """`plan.h`: the motions by kind, and what follows from a motion."""
    functions = []
    for name, choice in motion_variants():
        keys = keys_of(type(choice), name)
        sizes = [3 if key.startswith(("position", "orientation")) else 1 for key in keys]
        c, time = casadi.SX.sym("coefficients", sum(sizes)), casadi.SX.sym("time")
        values = np.split(symbols.elements(c), np.cumsum(sizes)[:-1])
        fields: dict[str, Any] = {**dict(zip(keys, values, strict=True)), "plane": getattr(choice, "plane", None)}
        with_symbols = type(choice).model_construct(**{"fade_in": 0.0, **fields})
        motion = casadi.cse([vector_of(with_symbols(symbols.elements(time)))])
        functions.append(casadi.Function(name, [c, time], motion, ["coefficients", "time"], ["motion"]))
    motions = [f"plan_{function.name()}" for function in functions]

    # what follows from a motion (18), and a pose with its rates, and the platform's parameters
    vector = casadi.SX.sym("motion", N_MOTION)
    p = casadi.SX.sym("platform", interface.N_PARAMETERS)
    ends = np.cumsum([0, *(v.size for v in interface.PLATFORM_PARAMETERS)]).tolist()
    by_name = {v.name: p[a:b] for v, a, b in zip(interface.PLATFORM_PARAMETERS, ends, ends[1:], strict=False)}
    parameters: Any = symbols.parameters_of(by_name)
    at = motion_in(vector)
    legs: Any = legs_of(parameters, at)
    J = leg_jacobian(parameters, at.position, at.orientation)
    transposed = np.swapaxes(J, -1, -2)
    rows = [solve_by_orthogonal(transposed, np.eye(6)[k : k + 1].astype(object)) for k in range(6)]
    forces = {
        kind: {"force": symbols.elements(feedforward_of(kind, parameters, at))}
        for kind in ("gravity", "computed_torque")
    }
    results: dict[str, dict[str, Any]] = {
        "signals": {"reference": np.concatenate([*at[:4], *legs, *at[4:]], axis=-1)},
        "maps": {"jacobian": J, "inverse": np.concatenate(rows, axis=0)},
        **forces,
    }
    for name, arrays in results.items():
        outputs = casadi.cse([casadi.densify(symbols.column(array)) for array in arrays.values()])
        functions.append(casadi.Function(name, [vector, p], outputs, ["motion", "platform"], [*arrays]))
    ahead = casadi.SX.sym("ahead")
    later = vector_of(extrapolated(at, symbols.row(ahead)))
    functions.append(casadi.Function("extrapolated", [vector, ahead], [later], ["motion", "ahead"], ["later"]))
    parts = {name: casadi.SX.sym(name, 6) for name in ("pose", "rate", "acceleration")}
    coordinates = casadi.densify(casadi.vertcat(*map(symbols.column, coordinates_of(at))))
    functions.append(casadi.Function("coordinates", [vector], [coordinates], ["motion"], ["coordinates"]))
    of_pose = vector_of(motion_of(*map(symbols.row, parts.values())))
    functions.append(casadi.Function("motion_of_pose", [*parts.values()], [of_pose], [*parts], ["motion"]))
    arguments = [casadi.SX.sym(name, n) for name, n in (("piece", 36), ("since", 1), ("moves", 1))]
    piece, since, moves = map(symbols.elements, arguments)
    half = slope = value = np.zeros(6)
    for of_power in piece.reshape(6, 6).T:  # Horner
        half, slope, value = half * since + slope, slope * since + value, value * since + of_power
    of_piece = vector_of(motion_of(value[None], moves * slope[None], moves * 2 * half[None]))
    functions.append(casadi.Function("piece", arguments, [of_piece], ["piece", "since", "moves"], ["motion"]))

    texts = [in_lanes(function, "static void plan_", exact=True) for function in functions]
    names = ", ".join(["0", "0", *motions])
    by_hand, *_ = traced(Smoothing, "smoothing", N_LEGS)
    return (
        by_hand
        + "".join(texts)
        + f"\nstatic void (*const MOTIONS[])(const double[], const double[], double[]) = {{{names}}};\n"
        + "static void (*const FEEDFORWARD[])(const double[], const double[], double[]) = "
        + "{0, plan_gravity, plan_computed_torque};\n"
    )


# ---- design.h ----


def design_header() -> str:
    """`design.h`."""
    # laws: (kp, kd, ki, Tf, Tt) of a channel, its notch, the sample time -> its [C D; A B] and rests, row by row
    laws = []
    for number, variant in enumerate(VARIANTS):
        values, notch, T = (
            casadi.SX.sym(key, n) for key, n in (("values", 5), ("notch", len(Notch.keys)), ("period", 1))
        )
        gains = symbols.elements(values)
        actions = [np.array([True]), np.array([variant.integrates])]
        of_channel = [gains[k : k + 1] for k in range(5)]
        continuous, period = channel_matrices(of_channel, variant.derivative_on, actions), symbols.elements(T)
        channel = matrices_at(continuous, period, variant.discretisation, symbols.solve)
        notches = [(Notch, {key: symbols.elements(notch[k]) for k, key in enumerate(Notch.keys)})]
        s = with_links(channel, notches if variant.has_notch else [], period, symbols.solve)
        whole = np.concatenate([np.concatenate([s.C, s.D], axis=1), np.concatenate([s.A, s.B], axis=1)])
        integrating = np.diag([0.0, 1.0][: 1 + variant.integrates] + [0.0, 0.0] * variant.has_notch)
        both = np.concatenate([np.ravel(whole), np.ravel(rest(s.A, integrating, s.B, symbols.solve))])
        matrices = casadi.cse(casadi.densify(symbols.column(both)))
        names_in = ["values", "notch", "period"]
        laws.append(casadi.Function(f"law_{number}", [values, notch, T], [matrices], names_in, ["matrices"]))

    # gains and times of a design, and coefficients of components
    sizes_of_used = {"masses": N_LEGS, "gains": 25, "wanted": len(REQUESTED), "filter_time": 1, "tracking_time": 1}
    sensor = _of_elements("sensor", {"step": 1}, lambda step: Sensor.prepare({"quantisation": step}), "coefficients")
    functions = [_of_elements("used", sizes_of_used, _used, "used"), sensor, *laws]
    texts = [in_lanes(function, "static void design_", exact=True) for function in functions]
    states = ", ".join(f"{{{1 + variant.integrates}, {2 * variant.has_notch}}}" for variant in VARIANTS)
    tustin = ", ".join(str(int(variant.discretisation == "tustin")) for variant in VARIANTS)
    names = ", ".join(f"design_{law.name()}" for law in laws)
    sizes = {
        "MOST_ELEMENTS_OF_CHANNEL": max(law.numel_out(0) for law in laws),
        "SENSOR_COEFFICIENTS": sensor.numel_out(0),
    }
    signature = "const double[], const double[], const double[], double[]"
    return "\n".join(
        [
            defines(sizes),
            *texts,
            f"static const int TUSTIN[] = {{{tustin}}};",
            "/* states of a channel: of its controller, then of its notch */",
            f"static const int STATES[][2] = {{{states}}};",
            f"static void (*const LAWS[])({signature}) = {{{names}}};\n",
        ]
    )


def _used(masses: Any, gains: Any, wanted: Any, filter_time: Any, tracking_time: Any) -> tuple[Any, ...]:
    """Gains and times (25) of what is wanted: those of a bandwidth, or the experiment's (25), and factors on them."""
    bandwidth, damping_ratio, integral_time, wanted_filter = (wanted[k : k + 1] for k in range(4))
    kp, kd, ki = gains_of_masses(masses, bandwidth, damping_ratio, integral_time)
    designed = np.concatenate([kp, kd, where(greater(gains[12:18], 0.0), ki, 0.0)])
    own = where(greater(bandwidth, 0.0), designed, gains[:18]) * np.repeat(wanted[4:7], N_LEGS)
    kp, kd, ki = np.split(own, 3)
    chosen = where(greater(wanted_filter, 0.0), wanted_filter, filter_time)
    default_filter, default_tracking = default_times(kp, kd, ki)
    return (
        own,
        where(greater(chosen, 0.0), chosen, default_filter),
        where(greater(tracking_time, 0.0), tracking_time, default_tracking),
    )


def _of_elements(
    name: str, sizes: Mapping[str, int], equations: Callable[..., Iterable[Any]], result: str
) -> casadi.Function:
    """A function of vectors, by equations of their elements."""
    inputs = [casadi.SX.sym(key, size) for key, size in sizes.items()]
    joined = symbols.column(np.concatenate([*equations(*map(symbols.elements, inputs))]))
    return casadi.Function(name, inputs, [casadi.densify(joined)], [*sizes], [result])
