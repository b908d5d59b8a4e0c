"""The library that runs the sampled loop of many members: c/loop with the components' equations as machine code.

It is built once from the equations that NumPy's loop executes, and kept; a loop made of these components is data.
"""

from functools import cache
from typing import Any

import numpy as np

from gough_stewart.fmu_build.cache import state_of_files
from gough_stewart.fmu_build.component import Sources
from gough_stewart.fmu_build.libraries import LanesLibrary, Library, machine_code, vector_library
from gough_stewart.harness.control.component import Stepped
from gough_stewart.harness.control.drive import Drive, ForceLimits
from gough_stewart.harness.control.faults import Cut, Freeze
from gough_stewart.harness.control.sensor import Sensor
from gough_stewart.harness.loop.folds import AT, ROW_PARTS
from gough_stewart.harness.plants.lanes import CompiledLanes
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.interface import IDEAL, Variant
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.rotations import rotation_between
from gough_stewart.model.vectors import FloatArray

# Of c/loop: its name, the component, and how many channels one call computes.
_COMPONENTS: tuple[tuple[str, type[Stepped], int], ...] = (
    ("sensor", Sensor, 1),
    ("limits", ForceLimits, N_LEGS),
    ("drive", Drive, N_LEGS),
    ("cut", Cut, N_LEGS),
    ("freeze", Freeze, 1),
)
# Sources besides those of the plant's machine code.
_OWN = (
    ("gough_stewart.harness.control", "component.py", "drive.py", "faults.py", "sensor.py"),
    (str(__package__), "folds.py", "loop_library.py"),
)


@cache
def loop_library(variant: Variant = IDEAL) -> LanesLibrary:
    """The library for this processor and plants of a variant; see `libraries.machine_code`.

    Raises
    ------
    BuildError, OSError
        See `libraries.machine_code`.
    """
    return machine_code(loop_code(variant))


@cache
def loop_kernel(variant: Variant) -> CompiledLanes:
    """What runs loops of plants of a variant in machine code.

    Raises
    ------
    BuildError, OSError
        As `loop_library`.
    """
    return CompiledLanes(loop_library(variant))


def loop_code(variant: Variant = IDEAL) -> Library:
    """The description of the library."""

    def sources() -> Sources:
        from gough_stewart.fmu_build.libraries import loop_sources

        return loop_sources(components_header(), variant)

    return vector_library("loop", sources, state_of_files(*_OWN), variant)


def coefficients_of(component: type[Stepped], values: dict[str, Any], period: float) -> FloatArray:
    """What c/loop wants of a component: its coefficients (n, N) from the values of its keys (N,)."""
    prepared = component.prepare(values, np.full(1, period))
    return np.array(np.broadcast_arrays(*prepared), dtype=float)


def components_header() -> str:
    """`components.h`: the equations on vectors of members, and sizes."""
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
    texts = [_traced_rotation()]
    for name, component, channels in _COMPONENTS:
        text, n_coefficients, n_states = traced(component, name, channels)
        texts.append(text)
        macro = {"limits": "LIMIT"}.get(name, name.upper())
        sizes |= {f"{macro}_{what}": n for what, n in (("COEFFICIENTS", n_coefficients), ("STATES", n_states)) if n}
    return f"{GENERATED}\n{defines(sizes)}\n{''.join(texts)}"


def _traced_rotation() -> str:
    """The C of `component_rotation_between(orientation, to, rotation)`."""
    import casadi  # needed once, to build

    from gough_stewart.fmu_build.codegen import in_lanes

    pair = [casadi.SX.sym(name, 3) for name in ("orientation", "to")]
    rotation = rotation_between(*(np.array([casadi.vertsplit(each)], dtype=object) for each in pair))
    function = casadi.Function("rotation_between", pair, [casadi.vertcat(*rotation[0])])
    return in_lanes(function, "static void component_", exact=True)


def traced(component: type[Stepped], name: str, channels: int) -> tuple[str, int, int]:
    """The C of a step, `component_NAME(coefficients, states, inputs ..., next states, outputs ...)`, and its sizes.

    Without coefficients or states these arguments are missing.
    """
    import casadi  # needed once, to build

    from gough_stewart.fmu_build.codegen import in_lanes

    def column(symbol: Any) -> Any:
        return np.array([[symbol[k]] for k in range(symbol.numel())], dtype=object)

    def joined(arrays: Any) -> Any:
        return casadi.vertcat(*(element for array in arrays for element in np.ravel(array)))

    one = np.ones(1)
    kind = type(component.prepare(dict.fromkeys(component.keys, one), one))
    c = casadi.SX.sym("coefficients", len(kind._fields))
    coefficients = kind(*column(c))
    inputs = {key: casadi.SX.sym(key, channels) for key in component.inputs}
    states = [
        casadi.SX.sym("states", channels) for _ in component.start(coefficients, tuple(map(column, inputs.values())))
    ]
    x = casadi.vertcat(*states)
    following, outputs = component.step(coefficients, tuple(map(column, states)), tuple(map(column, inputs.values())))
    of_states = {"states": x} if states else {}
    given = {**({"coefficients": c} if kind._fields else {}), **of_states, **inputs}
    found = {**({"next": joined(following)} if states else {})}
    found |= {key: joined([each]) for key, each in zip(component.outputs, outputs, strict=True)}
    function = casadi.Function(name, [*given.values()], [*found.values()], [*given], [*found])
    return in_lanes(function, "static void component_", exact=True), len(kind._fields), int(x.numel())
