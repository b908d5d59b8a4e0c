"""Generated C is straight-line arithmetic, refused where it is not; and which files know of which."""

import re
from pathlib import Path

import casadi
import pytest

from gough_stewart.fmu_build import codegen


def test_the_unit_knows_a_component_by_its_interface_only() -> None:
    """Expected: what files of c/unit include is there too, or generated for any component, or a standard's."""
    room = Path(__file__).parents[2] / "fmu_build" / "c" / "unit"
    own = {file.name for file in room.glob("*.h")} | {"model.h"}
    for file in room.iterdir():
        included = set(re.findall(r'#include "((?!fmi[23]).*?)"', file.read_text()))
        assert included <= own, file.name
    assert "component.h" in own


def test_what_is_no_straight_line_is_refused_but_for_conditions_where_they_are_allowed() -> None:
    """Expected: a choice, a negation and a conjunction compare numbers with 0; of functions that call others never."""
    x, y = casadi.SX.sym("x", 2), casadi.MX.sym("y")
    either = casadi.logic_or(casadi.logic_and(x[0], x[1]), casadi.logic_not(x[0]))
    function = casadi.Function("g", [x], [casadi.if_else(either, x[1], 0)], ["x"], ["y"])
    written = codegen.function_source(function, conditions=True)
    for pattern in (r"a\d!=0&&a\d!=0", r"a\d!=0\|\|a\d!=0", r"a\d==0", r"a\d!=0\?a\d:0"):
        assert re.search(rf"=\({pattern}\);", written)
    with pytest.raises(RuntimeError, match=r"^g: unknown construct '\?' in the generated code$"):
        codegen.function_source(function)
    inner = casadi.Function("inner", [y], [casadi.sin(y)], {"never_inline": True})
    outer = casadi.Function("outer", [y], [inner(y) + inner(2 * y)], ["x"], ["y"])
    with pytest.raises(RuntimeError, match=r"^outer: "):
        codegen.function_source(outer)
