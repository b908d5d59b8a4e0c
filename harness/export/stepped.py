"""Components with a step as CasADi Functions, traced from the equations that a run of N members executes."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.harness.control.component import Stepped
from gough_stewart.harness.export import symbols
from gough_stewart.model.operations import greater, where
from gough_stewart.model.vectors import Array


class TracedComponent(NamedTuple):
    """Functions of a component `name`, whose vectors are `name_coefficients`, `name_states` and `name_next`."""

    coefficients: casadi.Function  # settings -> coefficients
    step: casadi.Function  # coefficients, states, inputs -> next states, outputs
    n_states: int


def traced_component(
    component: type[Stepped],
    name: str,
    values: Mapping[str, Array],
    period: Array,
    settings: symbols.Symbols,
    inputs: Mapping[str, int],
    left_out: tuple[str, ...] = (),
    wanted: tuple[str, ...] | None = None,
) -> TracedComponent:
    """Its functions for one member, whose sizes are fixed.

    Parameters
    ----------
    values
        Of its keys, as expressions of the settings, (1,) or (size, 1).
    period
        Time between its steps, likewise (1,).
    settings
        Symbols of the exported parameters, by name.
    inputs
        The sizes of its inputs; one of 0 is absent.
    left_out
        Coefficients of parts that are left out.
    wanted
        Outputs; by default all.
    """
    prepared = component.prepare(values, period)
    prepared = prepared._replace(**dict.fromkeys(left_out))
    parts = {key: np.asarray(part) for key, part in prepared._asdict().items() if part is not None}
    c = casadi.SX.sym(f"{name}_coefficients", sum(part.size for part in parts.values()))
    of_c = _split(c, [part.shape for part in parts.values()])
    given = {key: casadi.SX.sym(key, size) for key, size in inputs.items()}
    columns = tuple(_column(each) if each.numel() else None for each in given.values())
    coefficients = prepared._replace(**dict(zip(parts, of_c, strict=True)))
    at_rest = component.start(coefficients, columns)
    x = casadi.SX.sym(f"{name}_states", sum(each.size for each in at_rest))
    following, outputs = component.step(coefficients, tuple(_split(x, [each.shape for each in at_rest])), columns)
    found = {f"{name}_next": _joined(following)} if x.numel() else {}
    known = dict(zip(component.outputs, outputs, strict=True))
    found |= {key: _joined((known[key],)) for key in (wanted or component.outputs)}
    vectors = {f"{name}_coefficients": c, f"{name}_states": x, **given}
    return TracedComponent(
        symbols.function(f"coefficients_of_{name}", settings, {name: _joined(parts.values())}),
        symbols.function(name, vectors, found),
        int(x.numel()),
    )


def none_as(value: float, setting: casadi.SX) -> Array:
    """A setting (1,) in which 0 means that there is none, with this value in its place."""
    given = symbols.elements(setting)
    return where(greater(given, 0.0), given, value)


def _column(vector: casadi.SX) -> Array:
    return symbols.elements(vector)[:, None]


def _joined(arrays: Any) -> casadi.SX:
    return casadi.vertcat(*(symbols.column(each) for each in arrays))


def _split(vector: casadi.SX, shapes: list[tuple[int, ...]]) -> list[Array]:
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
    parts = np.split(symbols.elements(vector), ends)[: len(shapes)]
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
