"""The interface table: the names that are promised, and how they are packed."""

import numpy as np

import gough_stewart as gs
from tests.support.uneven import UNEVEN

# Name, shape, unit, causality, start, whether a state, what the description speaks of: docs/notation.md.
HOME = "home"
PROMISED = [
    ("actuator_force", (6,), "N", "input", HOME, False, "extends the leg"),
    ("external_force", (3,), "N", "input", 0.0, False, "force at Op"),
    ("external_torque", (3,), "N.m", "input", 0.0, False, "torque about Op"),
    ("position", (3,), "m", "output", HOME, True, "origin Op"),
    ("orientation", (3,), "rad", "output", HOME, True, "roll, pitch, yaw"),
    ("velocity", (3,), "m/s", "output", 0.0, True, "velocity of Op"),
    ("angular_velocity", (3,), "rad/s", "output", 0.0, True, "angular velocity"),
    ("leg_length", (6,), "m", "output", None, False, "distance from base joint to platform joint"),
    ("leg_velocity", (6,), "m/s", "output", None, False, "rate of the leg length"),
    ("acceleration", (3,), "m/s2", "output", None, False, "acceleration of Op"),
    ("angular_acceleration", (3,), "rad/s2", "output", None, False, "angular acceleration"),
    ("joint_force", (6, 3), "N", "local", None, False, "force of leg i on the platform"),
    ("kinetic_energy", (), "J", "local", None, False, "kinetic energy"),
    ("potential_energy", (), "J", "local", None, False, "potential"),
]


def test_each_variable_is_as_the_documentation_promises_it() -> None:
    """Expected: the documented rows, and the start of an uneven platform at home; parameters follow."""
    model = gs.SteppingModel(UNEVEN)
    for v, (name, shape, unit, causality, start, is_state, about) in zip(gs.VARIABLES, PROMISED, strict=False):
        assert (v.name, v.shape, v.unit, v.causality, v.is_state) == (name, shape, unit, causality, is_state)
        assert about in v.description
        assert (v.variability, v.lower_bound) == ("continuous", None)
        if start is not None:
            expected = getattr(UNEVEN, f"home_{name}") if start == HOME else np.full(shape, start)
            assert np.array_equal(model.get(name), expected)
    step = gs.VARIABLES[-1]
    assert (step.name, step.shape, step.unit, step.causality) == ("fixed_step_size", (), "s", "parameter")
    assert (step.variability, step.lower_bound, step.start) == ("fixed", ">= 0", 0.0)
    assert {v.causality for v in gs.VARIABLES[len(PROMISED) :]} == {"parameter"}
    assert all(v.description for v in gs.VARIABLES)


def test_results_are_packed_in_the_order_of_the_variables_by_names_of_fmi_2() -> None:
    """Expected: element by element, row by row, 1-based; an element has name and shape of its own, all else alike."""
    columns = gs.SteppingModel(UNEVEN).variant.columns
    shapes = {name: shape for name, shape, _, causality, *_ in PROMISED if causality != "input"}
    indices = {name: [tuple(k + 1 for k in index) for index in np.ndindex(shape)] for name, shape in shapes.items()}
    assert list(columns) == [
        f"{name}[{','.join(map(str, index))}]" if index else name for name, many in indices.items() for index in many
    ]
    joint = next(v for v in gs.VARIABLES if v.name == "joint_force")
    last = joint.element(17)
    assert (joint.size, last.name, last.shape, last.size) == (18, "joint_force[6,3]", (), 1)
    assert (last.unit, last.causality, last.description) == (joint.unit, joint.causality, joint.description)
