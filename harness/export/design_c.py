"""The equations of a design as C of c/machine: gains of a bandwidth, laws of gains, coefficients of components.

All are traced from the functions that design in Python; a page turns gains with them while its loop runs.
"""

from functools import cache

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
from gough_stewart.harness.loop.libraries import widths_of
from gough_stewart.harness.plants.signals import N_LEGS


@cache
def design_header() -> str:
    """`design.h`."""
    laws = [law_function(f"law_{k}", variant) for k, variant in enumerate(VARIANTS)]
    functions = [_gains(), _times(), _prepared(ForceLimits, "limits"), _prepared(Sensor, "sensor"), *laws]
    texts = [in_lanes(function, "static void design_", exact=True) for function in functions]
    states = ", ".join(f"{{{1 + variant.integrates}, {2 * variant.has_notch}}}" for variant in VARIANTS)
    tustin = ", ".join(str(int(variant.discretisation == "tustin")) for variant in VARIANTS)
    names = ", ".join(f"design_{law.name()}" for law in laws)
    sizes = {"MOST_ELEMENTS_OF_CHANNEL": max(law.numel_out(0) for law in laws)}
    for name, component in (("SENSOR", Sensor), ("LIMIT", ForceLimits)):
        sizes[f"{name}_COEFFICIENTS"] = sum(widths_of(component, N_LEGS))
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
    gains = symbols.elements(values)
    actions = [np.array([True]), np.array([variant.integrates])]
    continuous = channel_matrices(
        ChannelGains(*[*(gains[k : k + 1] for k in range(5)), *actions]), variant.derivative_on
    )
    period = symbols.elements(T)
    channel = matrices_at(continuous, period, variant.discretisation, symbols.solve)
    notches = [(Notch, {key: symbols.elements(notch[k]) for k, key in enumerate(Notch.keys)})]
    s = with_links(channel, notches if variant.has_notch else [], period, symbols.solve)
    whole = np.concatenate([np.concatenate([s.C, s.D], axis=1), np.concatenate([s.A, s.B], axis=1)])
    matrices = casadi.cse(casadi.densify(symbols.column(whole)))
    return casadi.Function(name, [values, notch, T], [matrices], ["values", "notch", "period"], ["matrices"])


def _gains() -> casadi.Function:
    names = ["masses", "bandwidth", "damping", "integral_time"]
    inputs = [casadi.SX.sym(name, size) for name, size in zip(names, (N_LEGS, 1, 1, 1), strict=True)]
    gains = symbols.column(np.concatenate(gains_of_masses(*map(symbols.elements, inputs))))
    return casadi.Function("gains", inputs, [gains], names, ["gains"])


def _times() -> casadi.Function:
    names = ["kp", "kd", "ki"]
    inputs = [casadi.SX.sym(name, N_LEGS) for name in names]
    kp, kd, ki = map(symbols.elements, inputs)
    times = symbols.column(np.concatenate([filter_time_of(kp, kd), tracking_time_of(kp, kd, ki)]))
    return casadi.Function("times", inputs, [times], names, ["times"])


def _prepared(component: type[Stepped], name: str) -> casadi.Function:
    """The values of a component's keys, and its period -> its coefficients."""
    names = [*component.keys, "period"]
    inputs = [casadi.SX.sym(key) for key in names]
    *values, period = map(symbols.elements, inputs)
    prepared = component.prepare(dict(zip(component.keys, values, strict=True)), period)
    coefficients = casadi.densify(symbols.column(np.concatenate(prepared)))
    return casadi.Function(name, inputs, [coefficients], names, ["coefficients"])
