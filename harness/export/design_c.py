"""The equations of a design as C of c/machine: gains of a bandwidth, laws of gains, coefficients of components.

All are traced from the functions that design in Python; a page turns gains with them while its loop runs.
"""

from functools import cache
from typing import Any

import casadi
import numpy as np

from gough_stewart.fmu_build.codegen import in_lanes
from gough_stewart.fmu_build.sources import defines
from gough_stewart.harness.control.component import Stepped, with_links
from gough_stewart.harness.control.drive import ForceLimits
from gough_stewart.harness.control.notch import Notch
from gough_stewart.harness.control.pid import (
    ChannelGains,
    channel_matrices,
    filter_time_of,
    gains_of_masses,
    tracking_time_of,
)
from gough_stewart.harness.control.sensor import Sensor
from gough_stewart.harness.control.state_space import matrices_at
from gough_stewart.harness.export import symbols
from gough_stewart.harness.export.machine import VARIANTS, TurnableLaw
from gough_stewart.harness.plants.signals import N_LEGS


@cache
def design_header() -> str:
    """`design.h`."""
    laws = [law_function(f"law_{k}", each) for k, each in enumerate(VARIANTS)]
    functions = [_gains(), _times(), _prepared(ForceLimits, "limits"), _prepared(Sensor, "sensor"), *laws]
    texts = [in_lanes(each, "static void design_", exact=True) for each in functions]
    states = ", ".join(f"{{{1 + each.integrates}, {2 * each.has_notch}}}" for each in VARIANTS)
    tustin = ", ".join(str(int(each.discretisation == "tustin")) for each in VARIANTS)
    names = ", ".join(f"design_{each.name()}" for each in laws)
    most = max(each.numel_out(0) for each in laws)
    sensor, limits = (len(_kind(each)._fields) for each in (Sensor, ForceLimits))
    sizes = {"MOST_ELEMENTS_OF_CHANNEL": most, "SENSOR_COEFFICIENTS": sensor, "LIMIT_COEFFICIENTS": limits}
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


def law_function(name: str, variant: TurnableLaw) -> casadi.Function:
    """`values` (kp, kd, ki, Tf, Tt) of a channel, `notch` (3), `sample_time` -> [C D; A B] of it, row by row."""
    values, notch, T = (casadi.SX.sym(key, n) for key, n in (("values", 5), ("notch", len(Notch.keys)), ("period", 1)))
    of = symbols.elements(values)
    actions = [np.array([True]), np.array([variant.integrates])]
    continuous = channel_matrices(ChannelGains(*[*(of[k : k + 1] for k in range(5)), *actions]), variant.derivative_on)
    period = symbols.elements(T)
    channel = matrices_at(continuous, period, variant.discretisation, symbols.solve)
    notches = [(Notch, {key: symbols.elements(notch[k]) for k, key in enumerate(Notch.keys)})]
    s = with_links(channel, notches if variant.has_notch else [], period, symbols.solve)
    whole = np.concatenate([np.concatenate([s.C, s.D], axis=1), np.concatenate([s.A, s.B], axis=1)])
    found = casadi.cse(casadi.densify(symbols.column(whole)))
    return casadi.Function(name, [values, notch, T], [found], ["values", "notch", "period"], ["matrices"])


def _gains() -> casadi.Function:
    m, given = casadi.SX.sym("masses", N_LEGS), [casadi.SX.sym(n) for n in ("bandwidth", "damping", "integral_time")]
    found = gains_of_masses(symbols.elements(m), *(symbols.elements(each) for each in given))
    names = ["masses", "bandwidth", "damping", "integral_time"]
    return casadi.Function("gains", [m, *given], [symbols.column(np.concatenate(found))], names, ["gains"])


def _times() -> casadi.Function:
    given = [casadi.SX.sym(name, N_LEGS) for name in ("kp", "kd", "ki")]
    kp, kd, ki = map(symbols.elements, given)
    found = symbols.column(np.concatenate([filter_time_of(kp, kd), tracking_time_of(kp, kd, ki)]))
    return casadi.Function("times", given, [found], ["kp", "kd", "ki"], ["times"])


def _kind(component: type[Stepped]) -> Any:
    one = np.ones(1)
    return type(component.prepare(dict.fromkeys(component.keys, one), one))


def _prepared(component: type[Stepped], name: str) -> casadi.Function:
    """The values of a component's keys, and its period -> its coefficients."""
    given = {key: casadi.SX.sym(key) for key in component.keys}
    period = casadi.SX.sym("period")
    values = {key: symbols.elements(each) for key, each in given.items()}
    found = symbols.column(np.concatenate(component.prepare(values, symbols.elements(period))))
    return casadi.Function(
        name, [*given.values(), period], [casadi.densify(found)], [*given, "period"], ["coefficients"]
    )
