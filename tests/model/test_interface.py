"""The interface table: the names that are promised, and how they are packed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart.model import interface
from gough_stewart.model.errors import InterfaceError


def test_outputs_and_locals_are_the_promised_ones_in_order() -> None:
    """Expected: the design's section 7."""
    assert [v.name for v in interface.RESULTS] == [
        "position",
        "orientation",
        "velocity",
        "angular_velocity",
        "leg_length",
        "leg_velocity",
        "acceleration",
        "angular_acceleration",
        "joint_force",
        "kinetic_energy",
        "potential_energy",
    ]
    assert [(v.name, v.shape) for v in interface.INPUTS] == [
        ("actuator_force", (6,)),
        ("external_force", (3,)),
        ("external_torque", (3,)),
    ]


def test_columns_are_fmi_2_names_one_based_and_row_major() -> None:
    columns = interface.RESULT_COLUMNS
    assert len(columns) == len(set(columns)) == 50
    assert columns[:3] == ("position[1]", "position[2]", "position[3]")
    assert columns[30:34] == ("joint_force[1,1]", "joint_force[1,2]", "joint_force[1,3]", "joint_force[2,1]")
    assert columns[-2:] == ("kinetic_energy", "potential_energy")


def test_every_variable_has_a_unit_of_the_table_and_a_description() -> None:
    units = {"N", "N.m", "m", "rad", "m/s", "rad/s", "m/s2", "rad/s2", "J", "kg", "kg.m2", "N.s/m", "s", "1"}
    assert {v.unit for v in interface.VARIABLES} == units
    assert all(v.description for v in interface.VARIABLES)


@given(st.integers(0, 2**32 - 1))
def test_unpack_is_the_inverse_of_pack(seed: int) -> None:
    vector = np.random.default_rng(seed).normal(size=interface.size_of(interface.PLATFORM_PARAMETERS))
    values = interface.unpack(interface.PLATFORM_PARAMETERS, vector)
    assert np.array_equal(interface.pack(interface.PLATFORM_PARAMETERS, values), vector)


def test_finds_wholes_and_elements() -> None:
    assert interface.find("leg_length") == (interface.BY_NAME["leg_length"], None)
    assert interface.find("leg_length[3]") == (interface.BY_NAME["leg_length"], 2)
    assert interface.find("joint_force[2,1]") == (interface.BY_NAME["joint_force"], 3)


@pytest.mark.parametrize(
    ("name", "hint"),
    [("leg_lenght", "did you mean 'leg_length'"), ("leg_length[7]", "did you mean"), ("q", "expected one of")],
)
def test_unknown_names_get_a_hint(name: str, hint: str) -> None:
    with pytest.raises(InterfaceError, match=hint):
        interface.find(name)
