"""Functions of time in single precision: every operation, with time as a sum of two floats and with single numbers.

Expected: the same function evaluated by CasADi in double precision.
"""

import ctypes
import re
from pathlib import Path

import casadi
import numpy as np
import pytest

from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.export.single import function_of_time, halves, pairs_source, with_floats
from tests.support.exported import COMPILER, compiled

TIMES = (0.7, 3.0, 5.25, 250_000 + 1 / 3, 1e6 + 0.3125)
_CALLER = "\nvoid run(double high, double low, double *found)\n{\n    motion(pair_of(high, low), found);\n}\n"


def _of_time(t: casadi.SX) -> dict[str, casadi.SX]:
    """Operations on the time itself, which keep 48 bits, up to the phase of a motion."""
    phase = 2 * np.pi * 7.3 * t
    return {
        "sum": t + 0.3,
        "difference": 1.7 - t,
        "other difference": t - 250_000.1,
        "twice": (t + t) - 500_000.2,
        "negative": -t,
        "product": (1.3 * t) - 325_000.03,
        "square": t**2 - 6.25e10,
        "quotient": (t / 3.7) - 67_567.5,
        "other quotient": 2.5 / t,
        "inverse": 1 / t,
        "smaller": casadi.fmin(t, 3),
        "larger": casadi.fmax(3, t),
        "if": casadi.if_else(t < 3, 2 * t, -t),
        "less": t < 3,
        "not more": t <= 3,
        "more": t > 3,
        "sine": casadi.sin(phase),
        "cosine": casadi.cos(phase + 0.4),
        "of a difference": casadi.sin(2.5 * (t - 250_000)),
        "equal parts": (t * 0.1) / (t * 0.2),
    }


def _of_numbers(t: casadi.SX) -> dict[str, casadi.SX]:
    """Operations on single numbers, and of these with the time."""
    x, y = casadi.sin(1.1 * t), 0.5 * casadi.cos(0.7 * t)
    return {
        "sum": x + y,
        "difference": x - y,
        "twice": 2 * x,
        "negative": -x,
        "product": x * y,
        "square": x**2,
        "quotient": x / (2 + y),
        "inverse": 1 / (2 + x),
        "smaller": casadi.fmin(x, y),
        "larger": casadi.fmax(x, y),
        "less": x < y,
        "not more": x <= y,
        "not": casadi.logic_not(x < y),
        "and": casadi.logic_and(x < y, t < 4),
        "or": casadi.logic_or(x < y, t < 4),
        "if": casadi.if_else(x < y, 3 * x, y - 2),
        "sine": casadi.sin(x),
        "cosine": casadi.cos(x),
        "root": casadi.sqrt(2 + x),
        "tangent": casadi.tan(x),
        "angle": casadi.atan2(x, y),
        "arc tangent": casadi.atan(x),
        "arc sine": casadi.asin(y),
        "arc cosine": casadi.acos(y),
        "hyperbolic": casadi.tanh(x),
        "exponential": casadi.exp(x),
        "logarithm": casadi.log(2 + x),
        "power": (2 + x) ** y,
        "constant power": (2 + x) ** 2.5,
        "size": casadi.fabs(x),
        "hypotenuse": casadi.hypot(x, y),
        "floor": casadi.floor(5 * x),
        "of time and a number": (x + t) - 250_000,
        "of a number and time": x * (1e-6 * t),
        "a number over time": y / t,
    }


@pytest.mark.parametrize("of", [_of_time, _of_numbers])
def test_every_operation_gives_its_value_after_days_of_samples(of: object, tmp_path: Path) -> None:
    """To 2e-6 of the value, or of 1: a float alone has no digit of these differences and phases left."""
    t = casadi.SX.sym("time")
    expressions = of(t)  # type: ignore[operator]
    function = casadi.Function("motion", [t], [casadi.vertcat(*expressions.values())], ["time"], ["motion"])
    text = function_of_time(function)
    source = with_floats(f"#include <math.h>\n{pairs_source(text + _CALLER)}{text}{_CALLER}")
    assert "double" not in source
    (tmp_path / "motion.c").write_text(source)
    flags = ("-std=c99", "-O0", "-Wall", "-Werror", "-Wdouble-promotion", "-shared", "-fPIC")
    compiled([*COMPILER, *flags, "motion.c", "-o", "motion.so", "-lm"], tmp_path)
    code = ctypes.CDLL(str(tmp_path / "motion.so"))
    found = (ctypes.c_float * len(expressions))()
    for time in TIMES:
        code.run(*map(ctypes.c_float, halves(time)), found)
        expected = np.asarray(function(time)).ravel()
        for name, one, value in zip(expressions, found, expected, strict=True):
            assert abs(one - value) < 2e-6 * max(1.0, abs(value)), (name, time, one, value)


def test_an_operation_without_a_rule_is_refused_with_a_remedy() -> None:
    t = casadi.SX.sym("time")
    function = casadi.Function("motion", [t], [casadi.sinh(t)], ["time"], ["motion"])
    with pytest.raises(
        ExportError, match=r"no single precision \(number \d+ of CasADi in motion\).*reference = 'inputs'"
    ):
        function_of_time(function)


@pytest.mark.parametrize(
    ("used", "needed"),
    [
        ("pair_value(a)", {"pair_value"}),
        ("pair_less(a, b)", {"pair_less", "pair_sum", "pair_minus", "pair_of"}),
        ("pair_quotient(a, b)", {"pair_quotient", "pair_sum", "pair_minus", "pair_product", "pair_of"}),
    ],
)
def test_only_the_functions_that_are_used_are_written(used: str, needed: set[str]) -> None:
    """Otherwise a compiler warns of the others."""
    text = pairs_source(used)
    assert set(re.findall(r"^static \w+ (\w+)\(", text, re.M)) == needed
    assert ("An angle less its whole turns" in text) == ("pair_angle" in needed)


def test_numbers_are_split_in_two_floats() -> None:
    """Expected: 48 bits of a number, each half a float."""
    for value in (0.1, -np.pi, 1e6 + 1 / 3, 86_400.000_1):
        high, low = halves(value)
        assert high == np.float32(high)
        assert low == np.float32(low)
        assert abs(high + low - value) <= abs(value) * 2.0**-47
        assert abs(high - value) <= abs(value) * 2.0**-24


def test_text_becomes_single_and_comments_stay() -> None:
    """Expected: by hand; names that contain a function's, integers and comments are not changed."""
    text = '/* a double 1.5 */ double x[3] = {1.5, 2e-3, 7}; #define A "1.5" my_sqrt(sqrt(2.0)) + fmax(a, -HUGE_VAL)'
    assert with_floats(text) == (
        '/* a double 1.5 */ float x[3] = {1.5f, 2e-3f, 7}; #define A "1.5" my_sqrt(sqrtf(2.0f)) + fmaxf(a, -HUGE_VALF)'
    )
