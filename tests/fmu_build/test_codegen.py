"""The kernel as C: complete, with plain signatures, and refused where it is not straight-line code."""

import re
from dataclasses import replace
from pathlib import Path

import casadi
import pytest

from gough_stewart.fmu_build import codegen, tables
from gough_stewart.fmu_build.layout import Layout
from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.fmu_build.sources import sources, standard_headers
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform


def test_every_function_that_the_header_declares_is_defined(paper: Platform) -> None:
    """Expected: the declarations of kernel.h, argument by argument."""
    headers = sources(plant_component(paper), "3.0", "token").headers
    declared = dict(re.findall(r"void (kernel_\w+)\((.*?)\);", headers["kernel.h"], re.S))
    defined = dict(re.findall(r"^void (kernel_\w+)\((.*?)\)$", codegen.kernel_source(), re.M))
    assert len(defined) == 5
    assert defined == {name: " ".join(arguments.split()) for name, arguments in declared.items()}
    assert list(defined) == list(declared)


def test_the_code_is_arithmetic_only() -> None:
    """Expected: calls of sin, cos, tanh, sqrt and the square; no branch, no loop, no pointer."""
    source = codegen.kernel_source()
    body = source[source.index("void kernel_derivatives") :]
    assert set(re.findall(r"\b(\w+)\(", body)) - {f"kernel_{n}" for n in ("derivatives", "outputs", "legs")} == {
        *("sin", "cos", "tanh", "sqrt", "sq", "kernel_forward", "kernel_reverse")
    }
    assert not re.search(r"\b(if|for|while|goto|static)\b|\?|\*\w+\s*=", body)


def test_the_unit_knows_a_component_by_its_interface_only() -> None:
    """Expected: what files of c/unit include is there too, or generated for any component, or a standard's."""
    room = Path(tables.__file__).parent / "c" / "unit"
    own = {file.name for file in room.glob("*.h")}
    headers = own | {"model.h"} | set(standard_headers("2.0")) | set(standard_headers("3.0"))
    for file in room.iterdir():
        included = set(re.findall(r'#include "(.*?)"', file.read_text()))
        assert included <= headers, file.name
    assert "component.h" in own


def test_code_that_branches_is_refused() -> None:
    x = casadi.SX.sym("x")
    function = casadi.Function("f", [x], [casadi.if_else(x > 0, casadi.sin(x), casadi.fmod(x, 2))], ["x"], ["y"])
    with pytest.raises(RuntimeError, match="unknown construct"):
        codegen.function_source(function)


def test_slots_follow_each_other_without_gaps() -> None:
    first = 0
    for row in PLANT.rows:
        assert row.first == first
        first += row.variable.size
    assert first == PLANT.n_slots


def test_states_come_first_among_the_results() -> None:
    """Expected by the C core: results begin with the states, in the kernel's order."""
    names = [row.variable.name for row in PLANT.rows]
    results = names[names.index(interface.RESULTS[0].name) :]
    assert results[: len(interface.RESULTS)] == [v.name for v in interface.RESULTS]
    assert results[: len(interface.STATES)] == [v.name for v in interface.STATES]


def test_the_layout_number_changes_with_the_variables_and_the_saved_form(paper: Platform) -> None:
    component = plant_component(paper)
    others = replace(component, layout=Layout(PLANT.rows[:-1])), replace(component, saved_form="another")
    assert len({tables.layout_number(each) for each in (component, *others)}) == 3
