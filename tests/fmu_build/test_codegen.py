"""Generated C: straight-line arithmetic, refused where it is not; and which files know of which."""

import re
from pathlib import Path

import casadi
import pytest

from gough_stewart.fmu_build import codegen
from gough_stewart.fmu_build import sources as tables
from gough_stewart.fmu_build.sources import standard_headers


def test_the_unit_knows_a_component_by_its_interface_only() -> None:
    """Expected: what files of c/unit include is there too, or generated for any component, or a standard's."""
    room = Path(tables.__file__).parent / "c" / "unit"
    own = {file.name for file in room.glob("*.h")}
    headers = own | {"model.h"} | set(standard_headers("2.0")) | set(standard_headers("3.0"))
    for file in room.iterdir():
        included = set(re.findall(r'#include "(.*?)"', file.read_text()))
        assert included <= headers, file.name
    assert "component.h" in own


def test_the_kernel_is_arithmetic_only() -> None:
    """Expected: calls of sin, cos, tanh, sqrt and the square; no branch, no loop, no pointer."""
    source = codegen.kernel_source()
    body = source[source.index("void kernel_derivatives") :]
    assert set(re.findall(r"\b(\w+)\(", body)) - {f"kernel_{n}" for n in ("derivatives", "outputs", "legs")} == {
        *("sin", "cos", "tanh", "sqrt", "sq", "kernel_forward", "kernel_reverse")
    }
    assert not re.search(r"\b(if|for|while|goto|static)\b|\?|\*\w+\s*=", body)


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


def test_a_divisor_is_known_by_its_name_and_value() -> None:
    """Expected: by hand; a name that is assigned again is another divisor, and what is no quotient stays."""
    before = ["  a1=(a2/a3);", "  a4=(a1/a3);", "  a3=(a1+a4);", "  a5=(a2/a3);", "  a6=(a2/a7);", "  a8=(a1/a7);"]
    after = [
        *("  real r0, r1;", "  r0=1/a3;", "  a1=(a2*r0);", "  a4=(a1*r0);", "  a3=(a1+a4);", "  a5=(a2/a3);"),
        *("  r1=1/a7;", "  a6=(a2*r1);", "  a8=(a1*r1);"),
    ]
    assert codegen.with_reciprocals("\n".join(before), "real") == "\n".join(after)
    once = "\n".join(before[2:4])
    assert codegen.with_reciprocals(once) == once
