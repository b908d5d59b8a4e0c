"""The machine code of loops: c/loop with the components' equations, and the laws that users wrote.

The first is built once from the components' equations, and kept; a loop made of these components is data. A user's
law is compiled when it runs for the first time.
"""

import ctypes
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from gough_stewart.fmu_build.cache import BuildError
from gough_stewart.fmu_build.libraries import WIDTH, law_library, loop_sources, machine_code, vector_library
from gough_stewart.fmu_build.toolchain import Library
from gough_stewart.harness.control.component import Cut, Drive, ForceLimits, Freeze, Sensor, Stepped, Takeover
from gough_stewart.harness.control.linear_controller import Controller, LinearController
from gough_stewart.harness.control.makers import Maker
from gough_stewart.harness.control.traced_law import TracedLaw, is_casadi_function, traced_law_of
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.loop.folds import AT, ROW_PARTS, column_of, joined
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.lanes import CompiledLanes
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.interface import IDEAL, Variant
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.rotations import nearest_angle, rotation_between
from gough_stewart.model.vectors import FloatArray

# Of c/loop: its name, the beginning of its sizes' names, the component, and how many channels one call computes.
_COMPONENTS: tuple[tuple[str, str, type[Stepped], int], ...] = (
    ("sensor", "SENSOR", Sensor, 1),
    ("limits", "LIMIT", ForceLimits, N_LEGS),
    ("drive", "DRIVE", Drive, N_LEGS),
    ("cut", "CUT", Cut, N_LEGS),
    ("freeze", "FREEZE", Freeze, 1),
    ("takeover", "TAKEOVER", Takeover, N_LEGS),
)
# Sources besides those of the plant's machine code.
_SOURCES = ("gough_stewart.harness.control", "component.py"), (str(__package__), "folds.py", "libraries.py")
# Share of the largest number by which a law's machine code may differ from its function; they differ by rounding.
_AGREES = 1e-9
_SEED, _SCALES = 1, (1e-3, 1.0)


@cache
def loop_kernel(variant: Variant) -> CompiledLanes:
    """What runs loops of plants of a variant in machine code, for this processor; it is built if it is missing."""
    return CompiledLanes(machine_code(loop_code(variant)))


def loop_code(variant: Variant = IDEAL) -> Library:
    """The description of the library."""
    return vector_library("loop", lambda: loop_sources(components_header(), variant), "", variant, _SOURCES)


def coefficients_of(component: type[Stepped], values: dict[str, Any], period: float) -> FloatArray:
    """What c/loop wants of a component: its coefficients (n, N) from the values of its keys (N,)."""
    prepared = component.prepare(values, np.full(1, period))
    if not component.by_channel:
        return np.array(np.broadcast_arrays(*prepared), dtype=float)
    n = max(np.shape(value)[-1] for value in values.values())
    # one number, or one for each channel
    rows = [
        np.broadcast_to(coefficient, (N_LEGS if name in component.by_channel else 1, n))
        for name, coefficient in prepared._asdict().items()
    ]
    return np.concatenate(rows, dtype=float)


def components_header() -> str:
    """`components.h`: the equations on vectors of members, and sizes."""
    import casadi  # needed once, to build

    from gough_stewart.fmu_build.codegen import in_lanes
    from gough_stewart.fmu_build.sources import GENERATED, defines

    sizes: dict[str, Any] = {
        "LARGEST_COMMAND": LARGEST_NUMBER,
        "FIRST_LENGTH": AT["leg_length"].start,
        "FIRST_ANGLE": AT["orientation"].start,
        "N_POSE": AT["velocity"].start,
        **{f"ROW_{name}": place for name, place in ROW_PARTS.items()},
        "N_ACCELERATIONS": 6,
        "MOST_ELEMENTS": 6,
    }
    pair = [casadi.SX.sym(name, 3) for name in ("orientation", "to")]
    rotation = rotation_between(*(np.array([casadi.vertsplit(angles)], dtype=object) for angles in pair))
    function = casadi.Function("rotation_between", pair, [casadi.vertcat(*rotation[0])])
    angles = [casadi.SX.sym(name) for name in ("angle", "near")]
    turned = joined([nearest_angle(*map(column_of, angles))])
    turn = casadi.Function("nearest_angle", angles, [turned])
    texts = [in_lanes(angular, "static void component_", exact=True) for angular in (function, turn)]
    for name, macro, component, channels in _COMPONENTS:
        text, n_coefficients, n_states = traced(component, name, channels)
        texts.append(text)
        named = {f"{macro}_COEFFICIENTS": n_coefficients, f"{macro}_STATES": n_states}
        sizes |= {size: n for size, n in named.items() if n}
    return f"{GENERATED}\n{defines(sizes)}\n{''.join(texts)}"


def traced(component: type[Stepped], name: str, channels: int) -> tuple[str, int, int]:
    """The C of a step, `component_NAME(coefficients, states, inputs ..., next states, outputs ...)`, and its sizes.

    Without coefficients or states these arguments are missing.
    """
    import casadi  # needed once, to build

    from gough_stewart.fmu_build.codegen import in_lanes

    any_value = np.ones(1)
    coefficients_type = type(component.prepare(dict.fromkeys(component.keys, any_value), any_value))
    widths = [channels if name in component.by_channel else 1 for name in coefficients_type._fields]
    n_coefficients = sum(widths)
    c = casadi.SX.sym("coefficients", n_coefficients)
    ends = np.cumsum([0, *widths]).tolist()
    coefficients = coefficients_type(*(column_of(c)[first:end] for first, end in pairwise(ends)))
    symbols = {key: casadi.SX.sym(key, channels) for key in component.inputs}
    columns = tuple(map(column_of, symbols.values()))
    states = [casadi.SX.sym("states", channels) for _ in component.start(coefficients, columns)]
    following, results = component.step(coefficients, tuple(map(column_of, states)), columns)
    x = casadi.vertcat(*states)
    inputs = {**({"coefficients": c} if n_coefficients else {}), **({"states": x} if states else {}), **symbols}
    outputs = {"next": joined(following)} if states else {}
    outputs |= {key: joined([result]) for key, result in zip(component.outputs, results, strict=True)}
    function = casadi.Function(name, [*inputs.values()], [*outputs.values()], [*inputs], [*outputs])
    return in_lanes(function, "static void component_", exact=True), n_coefficients, int(x.numel())


@dataclass(frozen=True)
class CompiledLaw:
    """A traced law with its machine code."""

    law: TracedLaw
    library: ctypes.CDLL

    used = signals.NAMES


def are_compiled(controllers: Sequence[Controller | None]) -> bool:
    """Whether machine code can have these controllers: linear ones, or CasADi functions of one form, given or made."""
    if all(controller is None or isinstance(controller, LinearController) for controller in controllers):
        return True
    try:
        made: list[Any] = [
            controller.peek() if isinstance(controller, Maker) else controller for controller in controllers
        ]
    except ControllerError:  # the run says so
        return False
    return all(map(is_casadi_function, made)) and compiled_together(made) is not None


def compiled_together(functions: Sequence[Any]) -> CompiledLaw | None:
    """CasADi functions of all members as one law in machine code; None if they are not alike, or cannot be compiled."""
    together = traced_law_of(functions)
    library = None if together is None else _library(together.function.serialize())
    return None if together is None or library is None else CompiledLaw(together, library)


@lru_cache(64)
def _library(serialized: str) -> ctypes.CDLL | None:
    """The machine code of a law, if it computes what its function does, but for rounding."""
    import casadi  # who has a function of it has imported it

    function = casadi.Function.deserialize(serialized)
    try:
        library = ctypes.CDLL(str(law_library(function).path))
    except (BuildError, OSError, RuntimeError):
        return None
    # for eight points, not alike
    drawn = np.random.default_rng(_SEED)
    memory = np.repeat(_SCALES, WIDTH // len(_SCALES)) * drawn.standard_normal((function.numel_in(0), WIDTH))
    compiled: FloatArray = np.zeros((function.numel_out(0), WIDTH))
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in (memory, compiled))
    library.law_step(*pointers, ctypes.c_int64(WIDTH))  # see c/law/law.c
    expected = np.stack([np.asarray(function(memory[:, k])).ravel() for k in range(WIDTH)], axis=1)
    known, gap = np.isfinite(expected), np.inf
    if np.array_equal(known, np.isfinite(compiled)):
        scale = np.abs(expected[known]).max(initial=0.0)
        gap = float(np.abs(compiled - expected)[known].max(initial=0.0) / scale) if scale else 0.0
    if not gap <= _AGREES:
        warnings.warn(
            f"the machine code of the controller computes forces that differ by {gap:.2g} of the largest one from its "
            "function's; it runs in Python instead, more slowly",
            stacklevel=2,
        )
        return None
    return library
