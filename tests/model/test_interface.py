"""The interface table: the names that are promised, and how they are packed."""

import re
from typing import Any

import numpy as np
import pytest

from gough_stewart import GoughStewartError
from gough_stewart.model import interface
from tests.support.uneven import UNEVEN


def test_every_variable_has_a_unit_of_the_table_and_a_description() -> None:
    units = {"N", "N.m", "m", "rad", "m/s", "rad/s", "m/s2", "rad/s2", "J", "kg", "kg.m2", "N.s/m", "s", "1"}
    assert {v.unit for v in interface.VARIABLES} == units
    assert all(v.description for v in interface.VARIABLES)


def test_finds_wholes_and_elements() -> None:
    assert interface.find("leg_length") == (interface.BY_NAME["leg_length"], None)
    assert interface.find("leg_length[3]") == (interface.BY_NAME["leg_length"], 2)
    assert interface.find("joint_force[2,1]") == (interface.BY_NAME["joint_force"], 3)


# Name, shape, unit, causality, start, whether a state, what the description speaks of: section 7 of the design.
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


def test_each_variable_is_as_the_design_promises_it() -> None:
    """Expected: the design's section 7, and the start of an uneven platform at home."""
    variables = interface.VARIABLES[: len(PROMISED)]
    for v, (name, shape, unit, causality, start, is_state, about) in zip(variables, PROMISED, strict=True):
        assert (v.name, v.shape, v.unit, v.causality, v.is_state) == (name, shape, unit, causality, is_state)
        assert about in v.description
        assert (v.variability, v.lower_bound) == ("continuous", None)
        value = interface.start_values([v], UNEVEN).get(v.name)
        if start is None:
            assert value is None
        else:
            expected = getattr(UNEVEN, f"home_{name}") if start == HOME else np.full(shape, start)
            assert value is not None
            assert value.tolist() == np.asarray(expected).tolist()
    assert [v.name for v in interface.STATES] == [row[0] for row in PROMISED if row[5]]
    assert [v.name for v in interface.OUTPUTS] == [row[0] for row in PROMISED if row[3] == "output"]
    assert [v.name for v in interface.LOCALS] == [row[0] for row in PROMISED if row[3] == "local"]
    step = interface.BY_NAME["fixed_step_size"]
    assert (step.shape, step.unit, step.causality, step.variability) == ((), "s", "parameter", "fixed")
    assert (step.lower_bound, step.start, interface.VARIABLES[-1]) == (">= 0", 0.0, step)
    starts = interface.start_values(interface.VARIABLES, UNEVEN)
    assert list(starts) == [
        v.name for v in interface.VARIABLES if v.name not in {r[0] for r in PROMISED if r[4] is None}
    ]
    assert starts["gravity"].tolist() == [0.9, -1.3, -9.4]
    assert starts["leg_armature"].shape == ()


def test_elements_are_scalars_of_the_same_kind() -> None:
    """Expected: name and shape of the element, all else that of the whole; FMI 2.0 names, 1-based, row by row."""
    columns = interface.RESULT_COLUMNS
    assert len(columns) == len(set(columns)) == 50
    assert columns[:3] == ("position[1]", "position[2]", "position[3]")
    assert columns[30:34] == ("joint_force[1,1]", "joint_force[1,2]", "joint_force[1,3]", "joint_force[2,1]")
    assert columns[-2:] == ("kinetic_energy", "potential_energy")
    joint = interface.BY_NAME["joint_force"]
    assert joint.size == 18
    last = joint.element(17)
    assert (last.name, last.shape, last.size, last.scalar_names) == ("joint_force[6,3]", (), 1, ("joint_force[6,3]",))
    assert (last.unit, last.causality, last.description) == (joint.unit, joint.causality, joint.description)
    assert interface.BY_NAME["base_points"].element(4).name == "base_points[2,2]"
    assert interface.find("base_points[6,3]") == (interface.BY_NAME["base_points"], 17)


def test_vectors_are_packed_in_the_order_of_the_variables() -> None:
    """Expected: element by element, row by row; over leading axes each in its own row."""
    variables = tuple(interface.BY_NAME[name] for name in ("kinetic_energy", "joint_force", "leg_length"))
    assert interface.size_of(variables) == 25
    values: dict[str, Any] = {
        "leg_length": 200 + np.arange(6),
        "joint_force": 100 + np.arange(18).reshape(6, 3),
        "kinetic_energy": 7.5,
    }
    packed = interface.pack(variables, values)
    assert packed.tolist() == [7.5, *range(100, 118), *range(200, 206)]
    many = interface.unpack(variables, np.stack([packed, 10 * packed]))
    assert list(many) == ["kinetic_energy", "joint_force", "leg_length"]
    assert many["kinetic_energy"].tolist() == [7.5, 75]
    assert many["joint_force"][1, 4].tolist() == [1120, 1130, 1140]
    assert many["leg_length"].shape == (2, 6)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("leg_lenght", "leg_lenght: no such variable; did you mean 'leg_length'?"),
        ("base_points[7,1]", "base_points[7,1]: no such variable; did you mean 'base_points[6,1]'?"),
        (3, "3: expected the name of a variable, a text"),
    ],
)
def test_unknown_names_are_told_in_whole_sentences(name: str, text: str) -> None:
    with pytest.raises(GoughStewartError, match=f"^{re.escape(text)}$") as caught:
        interface.find(name)
    assert caught.value.name == text.partition(":")[0]


def test_a_name_like_no_other_gets_the_list_of_wholes() -> None:
    """Expected: every variable once, none of its elements."""
    with pytest.raises(GoughStewartError) as caught:
        interface.find("qqqqq")
    assert str(caught.value).split("expected one of ")[1].split(", ") == list(interface.BY_NAME)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("gravity", [0, 0], "gravity: has shape (2,); expected numbers of shape (3,) [m/s2], acceleration of gravity"),
        ("platform_mass", "1", "platform_mass: is '1'; expected one number [kg], mass of the platform with payload"),
        ("leg_length", [1, 2, 3, 4, 5, np.inf], "leg_length: is [1.0, 2.0, 3.0, 4.0, 5.0, inf]; expected finite numb"),
    ],
)
def test_a_value_that_does_not_fit_is_told_with_unit_and_meaning(name: str, value: object, text: str) -> None:
    with pytest.raises(GoughStewartError, match=f"^{re.escape(text)}"):
        interface.checked_value(interface.BY_NAME[name], value)
    fine = interface.checked_value(interface.BY_NAME["gravity"], [1, 2, -3])
    assert fine.tolist() == [1.0, 2.0, -3.0]
    assert fine.dtype == np.float64
