"""Drives, limits and sensors as components: many members, one alone, and what CasADi traces of the same equations."""

from typing import Any

import numpy as np
import pytest

from gough_stewart import Notch
from gough_stewart.harness.control.component import Parameter, Stepped
from gough_stewart.harness.control.drive import Drive, ForceLimits
from gough_stewart.harness.control.sensor import Sensor
from gough_stewart.harness.plants.signals import VARIABLES
from gough_stewart.model.interface import BY_NAME
from tests.support.arrays import FloatArray

INF = np.inf
PERIOD = 0.0013
# Members with every combination of limits, each of them with other numbers.
VALUES: dict[type[Stepped], dict[str, FloatArray]] = {
    Drive: {
        "rate_limit": np.array([90.0, 140.0, INF, INF, 25.0]),
        "lag": np.array([0.004, 0.0, 0.0, 0.009, 0.0007]),
    },
    ForceLimits: {
        "force_limit": np.array([0.6, INF, 0.9, INF, 1.1]),
        "rate_limit": np.array([200.0, 450.0, INF, INF, 90.0]),
    },
    Sensor: {"quantisation": np.array([0.01, 0.0, 0.25, 1e-6, 0.0])},
}
N = 5


def signals_of(component: type[Stepped], steps: int = 60) -> list[tuple[Any, ...]]:
    """Six different inputs for each member; some repeat, some lie at a half of the quantiser's step."""
    rng = np.random.default_rng(11)
    values = rng.normal(size=(steps, 6, N)).cumsum(axis=0)
    values[10:14], values[20] = values[10], np.round(values[20], 2) + 0.005
    if component is Sensor:
        return list(zip(values, 0.1 * rng.normal(size=values.shape), strict=True))
    return [(each,) for each in values]


@pytest.mark.parametrize("component", VALUES)
def test_a_step_leaves_what_it_was_given(component: type[Stepped]) -> None:
    """Expected: inputs, states and coefficients as they were, after a step and after its outputs are overwritten."""
    for idle in (True, False):
        c = component.prepare(VALUES[component], PERIOD)
        c = c if idle else component.without_idle(c)
        inputs = tuple(each.copy() for each in signals_of(component)[3])
        states = component.start(c, tuple(each.copy() for each in signals_of(component)[2]))
        before = [np.array(each) for each in (*states, *inputs, *(part for part in c if part is not None))]
        component.step(c, states, inputs)
        after = [np.array(each) for each in (*states, *inputs, *(part for part in c if part is not None))]
        for one, other in zip(before, after, strict=True):
            assert one.tobytes() == other.tobytes()


def test_parameters_have_the_units_and_bounds_of_their_tables() -> None:
    """Expected: as the documentation has them; a limit that need not be there is 0 where it is written."""
    rate = Parameter("force_rate_limit", "rate_limit", "N/s", ">= 0", "rate limit of the drives", "", INF)
    assert Drive.parameters() == (
        rate,
        Parameter("force_lag", "lag", "s", ">= 0", "time constant of the drives", "", 0.0),
    )
    assert ForceLimits.parameters() == (
        Parameter("force_limit", "force_limit", "N", ">= 0", "largest force of an actuator", "", INF),
        rate,
    )
    (found,) = Sensor.parameters((BY_NAME["orientation"],))
    assert found[:5] == (
        *("orientation_quantisation", "quantisation.orientation", "rad", ">= 0"),
        "quantisation step of orientation",
    )
    assert [each.unit for each in Sensor.parameters()] == [v.unit for v in VARIABLES]
    assert [(each.name, each.unit, each.bound) for each in Notch.parameters()] == [
        ("notch_frequency", "Hz", "> 0"),
        ("notch_damping", "", "> 0"),
        ("notch_depth", "1", ">= 0"),
    ]
