"""The C of a controller: NAME.c, NAME.h, and an example program.

NAME.c is the runtime of runtime/, plain C that is the same for all designs, with two parts in the places of its
`#include`: design.c, numbers and switches of one design; and law.c, the functions that CasADi traced, with poses and
lengths relative to home where the type of the numbers is float.
"""

import ctypes
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.fmu_build.cache import BuildError
from gough_stewart.fmu_build.codegen import Types, function_source
from gough_stewart.fmu_build.toolchain import FLAGS, compile_library, native
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.design import Designed, Ranges
from gough_stewart.harness.export.laws import FunctionLaw
from gough_stewart.harness.export.relative import Home, home_of
from gough_stewart.harness.export.settings import Setting
from gough_stewart.harness.export.tables import ConstantTables, motion_tables, number, numbers, path_deviation, path_of
from gough_stewart.harness.export.trace import Traced, traced
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.motion.motion import Piecewise
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.open import ModelPlant
from gough_stewart.model import interface
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import Variable
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray

# The program that shows how the C is called.
EXAMPLE = "example_main.c"
RUNTIME = {path.name: path.read_text(encoding="utf-8") for path in Path(__file__).parent.joinpath("runtime").iterdir()}
_IDENTIFIER = re.compile(r"[a-z][a-z0-9_]{0,40}")
# Comments in ASCII, for every compiler and editor.
_ASCII = str.maketrans({"×": "x", "±": "+-", "°": " deg", "–": "-", "—": "-", "µ": "u"})


@dataclass(frozen=True)
class ControllerSources:
    """A controller as C99."""

    units: dict[str, str]  # source files to compile: text by file name
    headers: dict[str, str]
    example: str  # a program that runs it
    operations: int  # floating-point operations per step, at most
    n_states: int  # of the law


def controller_sources(designed: Designed, prefix: str = "controller", deviation: str = "") -> ControllerSources:
    """The sources of a designed controller; a pure function.

    Parameters
    ----------
    prefix
        Of all public names, also the name of the files: lower-case letters, digits and underscores.
    deviation
        What single precision costs, in words, for the header.

    Raises
    ------
    ExportError
        A prefix that is not valid in C.
    """
    if not _IDENTIFIER.fullmatch(prefix):
        raise ExportError(
            f"prefix is {prefix!r}; expected a lower-case letter, then lower-case letters, digits or underscores, at "
            "most 41"
        )
    home = home_of(designed.platform)
    functions, of_single = traced(designed), traced(designed, home)
    tables = _numbers(designed, home)
    is_moving = functions.feedforward is not None or _needs_motion(functions)
    if isinstance(designed.reference, Piecewise) and is_moving:
        of_motion = motion_tables(designed.reference, home)
        tables.lines += of_motion.lines
        tables.reals, tables.words = tables.reals + of_motion.reals, tables.words + of_motion.words
    switches = _switches(designed, functions)
    design = "\n".join(["", *(f"#define {name} {value}" for name, value in switches.items()), *tables.lines, ""])
    parts = {**RUNTIME, "design.c": design, "law.c": _law(designed, functions, of_single)}
    operations = operations_of(functions)
    source = re.sub(r'^#include "(\w+\.c)"\n', lambda found: parts[found[1]], parts["controller.c"], flags=re.M)
    header = header_of(designed, functions, prefix, tables, operations, deviation)
    first = [np.concatenate([designed.first_measured, [0.0]]), designed.first_reference]
    relative = [_at_home(designed.measured, home), np.concatenate([home.pose, np.zeros(12)])]
    relative[0] = np.append(relative[0], 0.0)
    starts = {
        name: ", ".join(f"FROM({value!r}, {at!r})" for value, at in zip(map(float, values), map(float, home_values)))
        for name, values, home_values in zip(("MEASURED", "REFERENCE"), first, relative, strict=True)
    }
    example = "\n".join(
        [
            f'#include "{prefix}.h"',
            "",
            "#include <string.h>",
            "",
            "/* in single precision, relative to home */",
            "#define FROM(x, home) (controller_real)(CONTROLLER_SINGLE ? (x) - (home) : (x))",
            *(f"#define {name} {{{values}}}" for name, values in starts.items()),
            *(f"#define {name} {switches[name]}" for name in ("HAS_REFERENCE_INPUTS", "STEPS_A_SAMPLE")),
            "",
        ]
    )
    return ControllerSources(
        {f"{prefix}.c": _named(f"/* {_title(designed)}. */\n", source, prefix)},
        {f"{prefix}.h": header},
        _named("", example + RUNTIME[EXAMPLE], prefix),
        sum(operations.values()),
        _n_states(functions),
    )


def _named(head: str, text: str, prefix: str) -> str:
    """A text of the runtime with the names of a controller."""
    text = text.replace('"controller.h"', f'"{prefix}.h"')
    return head + re.sub(r"\bcontroller_(?=\w)", f"{prefix}_", re.sub(r"\bCONTROLLER_", f"{prefix.upper()}_", text))


def _title(designed: Designed) -> str:
    title = " ".join(designed.title.replace("*/", "").replace("/*", "").split())
    law = "no feedback" if designed.law is None else designed.law.name
    return f"{title}: {law}, feedforward: {designed.feedforward.replace('_', ' ')}"


def _uses(function: casadi.Function | None, name: str) -> bool:
    return function is not None and name in function.name_in()


def _needs_motion(functions: Traced) -> bool:
    """Whether the reference at a sample is computed, not only the one ahead."""
    return any(_uses(f, "motion") for f in (functions.law, functions.start, functions.expected))


def _n_states(functions: Traced) -> int:
    law = functions.law
    return 0 if law is None or "next" not in law.name_out() else int(law.numel_out("next"))


def _at_home(variables: Iterable[Variable], home: Home) -> FloatArray:
    """The values at home of several signals, one after the other."""
    return np.concatenate([np.zeros(0), *(home.of(v.name, v.size) for v in variables)])


# --- design.c ---------------------------------------------------------------------------------------------------------


def _switches(designed: Designed, functions: Traced) -> dict[str, int]:
    """The macros that choose the parts of the runtime."""
    carried, law, reference = designed.carried, functions.law, designed.reference
    has_feedforward = functions.feedforward is not None
    has_motion = reference is not None and _needs_motion(functions)
    has_constant = any(s.variable.name == "constant_force" for s in designed.settings)
    is_table = isinstance(reference, Piecewise) and (has_feedforward or has_motion)
    reading = (carried.steps_a_reading or 0) if functions.sensors is not None else 0
    common = int(np.lcm(carried.steps_a_sample, max(1, reading)))
    safe = 0 if designed.faults.safe_force == "zero" else 1 if has_feedforward or has_constant else 2
    switches = {
        "HAS_LAW": law is not None,
        "HAS_START": functions.start is not None,
        "HAS_EXCESS": _uses(law, "excess"),
        "HAS_COMMAND": _uses(law, "command"),
        "HAS_FEEDFORWARD": has_feedforward,
        "HAS_CONSTANT_FORCE": has_constant,
        "HAS_REFERENCE_INPUTS": designed.reference_inputs,
        "HAS_MOTION": has_motion,
        "HAS_TABLE": is_table,
        "HAS_PATH": is_table and path_of(reference) is not None,
        "HAS_DRIVES": functions.drives is not None,
        "HAS_SENSORS": functions.sensors is not None,
        "HAS_STEPS": carried.has_steps,
        "HAS_MANUAL": carried.manual,
        "STEPS_A_SAMPLE": carried.steps_a_sample,
        "STEPS_A_READING": reading,
        "STEPS_OF_TURN": common * max(1, 2**23 // common),
        "SEES_ZEROS": designed.zeros_are_no_measurement,
        "ZERO_IS_A_REFERENCE": not designed.reference_inputs or _zero_is_a_reference(designed),
        "N_MEASURED": interface.size_of(designed.measured),
        "N_STATES": _n_states(functions),
        "N_COEFFICIENTS": 0 if functions.coefficients is None else functions.coefficients.numel_out(0),
        "N_WATCHED": interface.size_of(designed.watched),
        **{"SAFE_ZERO": 0, "SAFE_FEEDFORWARD": 1, "SAFE_START": 2, "SAFE_FORCE": safe},
    }
    return {name: int(value) for name, value in switches.items()}


def _zero_is_a_reference(designed: Designed) -> bool:
    """Whether a reference of zeros can be one: a pose in which the legs are in their range."""
    legs = leg_geometry(designed.platform, np.zeros(3), np.zeros(3)).length
    low, high = designed.ranges.leg_length
    return bool(((legs >= low) & (legs <= high)).all())


def _numbers(designed: Designed, home: Home) -> ConstantTables:
    """Defaults and checks of the parameters, home, ranges of the inputs."""
    tables, settings = ConstantTables(), designed.settings
    measured, reference, frozen = designed.measured, designed.reference_variables, designed.faults.frozen
    tables.define(SAMPLE_TIME=repr(float(designed.sample_time)))
    tables.define(DEFAULT_SAMPLE_TIME="R(SAMPLE_TIME)", TRANSFER_TIME="R(CONTROLLER_TRANSFER_TIME)")
    tables.lines += ["", "const controller_parameters CONTROLLER_DEFAULTS = {", *map(_default, settings), "};", ""]
    tables.reals += sum(s.variable.size for s in settings)
    of_inputs = (("MEASURED", "HOME", measured), ("REFERENCE", "HOME_POSE", reference))
    for name, of_home, variables in of_inputs:
        if not variables:
            continue
        at_home, ends = _at_home(variables, home), designed.ranges.joined(variables)
        shown = at_home if name == "MEASURED" else home.pose
        tables.lines.append(f"const real CONTROLLER_{of_home}[{len(shown)}] = {{{numbers(shown)}}};")
        tables.define(**{of_home: f"CONTROLLER_{of_home}"})
        tables.reals += len(shown)
        for end, values in (("LOW", ends.low), ("HIGH", ends.high)):
            written = ", ".join(f"FROM_HOME({x!r}, {at!r})" for x, at in zip(values.tolist(), at_home.tolist()))
            tables.add(f"{name}_{end}", values, written=written)
    if not reference:
        tables.lines.append(f"MAYBE_UNUSED static const real HOME_POSE[6] = {{{numbers(home.pose)}}};")
    if frozen is not None:
        ends = np.cumsum([0, *(v.size for v in measured)]).tolist()
        places = [
            k for v, at in zip(measured, ends, strict=False) if v in designed.watched for k in range(at, at + v.size)
        ]
        tables.add("WATCHED", places, "int")
        tables.define(FROZEN_SAMPLES=frozen.samples, FROZEN_MOVEMENT=number(frozen.movement))
    checks = [line for place, s in enumerate(settings, 1) for line in _check(s, place)]
    tables.lines += [
        "",
        "/* The number of the first parameter with an invalid value, from 1; else 0. */",
        "static int wrong_parameter(const controller_parameters *parameters)",
        "{",
        *(["    int k;"] if any("[k]" in line for line in checks) else []),
        *checks,
        "    return 0;",
        "}",
    ]
    return tables


def _default(setting: Setting) -> str:
    """In its place, since C++ has no designators before C++20."""
    finite = np.where(np.isinf(setting.value), 0.0, setting.value) if setting.may_be_infinite else setting.value
    text = numbers(finite.flat)
    return f"    {f'{{{text}}}' if setting.variable.shape else text}, /* {setting.variable.name} */"


def _check(setting: Setting, place: int) -> list[str]:
    """Checks of a parameter; if one fails, the function returns its number."""
    v = setting.variable
    largest = "LARGEST" if setting.largest == LARGEST_NUMBER else number(setting.largest)
    above = {"> 0": "{0} > 0", ">= 0": "{0} >= 0", None: f"{{0}} >= -{largest}"}[v.lower_bound]
    below = "" if setting.may_be_infinite else f" && {{0}} <= {largest}"
    element = f"parameters->{v.name}" + ("[k]" if v.shape else "")
    loop = f"for (k = 0; k < {v.size}; ++k) " if v.shape else ""
    conditions = [re.sub(r"(?<![\w.])(\d+\.\d*|\d+e-?\d+)", r"R(\1)", text) for text in setting.conditions]
    return [
        f"    {loop}if (!({(above + below).format(element)})) return {place};",
        *(f"    if (!({condition})) return {place};" for condition in conditions),
    ]


# --- law.c ------------------------------------------------------------------------------------------------------------

# The arguments of the traced functions; other inputs are members of the instant, or parameters.
_ARGUMENTS = {
    "motion": ("now", "motion"),
    "motion_of_table": ("pose", "rate", "acceleration", "motion"),
    "motion_of_path": ("spline", "slope", "bend", "speed", "change", "pose", "rate", "acceleration"),
    "extrapolated": ("motion", "ahead", "later"),
    "feedforward": ("at", "force"),
    "start": ("at", "states_at_rest"),
    "references_watched": ("at", "expected"),
    "law": ("at", "force"),
    "coefficients_of_law": ("parameters", "law"),
    "coefficients_of_force_limits": ("parameters", "force_limits"),
    "coefficients_of_drives": ("parameters", "drives"),
    "coefficients_of_sensors": ("parameters", "sensors"),
    "force_limits": ("force_limits_coefficients", "command", "allowed", "force_limited"),
    "drives": (
        *("drives_coefficients", "drives_states", "target"),
        *("drives_next", "actuator_force", "rate_limited"),
    ),
    "sensors": ("sensors_coefficients", "true", "reading"),
}
_WITH_STATES = {
    "law": ("at", "force", "next"),
    "force_limits": (
        *("force_limits_coefficients", "force_limits_states", "command"),
        *("force_limits_next", "allowed", "force_limited", "excess"),
    ),
}
_KINDS = {"at": "const instant *", "parameters": "const controller_parameters *", "now": "moment "}
_OF_INSTANT = ("coefficients", "motion", "measured", "excess", "command", "states")


def _law(designed: Designed, functions: Traced, single: Traced) -> str:
    """The traced functions; those that differ in single precision twice."""
    arrays = frozenset(s.variable.name for s in designed.settings if s.variable.shape)
    has_motion = functions.feedforward is not None or _needs_motion(functions)
    texts = []
    for name in (
        "coefficients",
        *(("path", "motion") if has_motion else ()),
        "extrapolated",
        "start",
        "expected",
        "law",
    ):
        plain, of_single = getattr(functions, name), getattr(single, name)
        if plain is None:
            continue
        is_of_time = name == "motion" and _uses(of_single, "time")
        text, other = (_function(f, arrays) for f in (plain, of_single))
        other = _of_time(of_single) if is_of_time else other
        texts.append(text if text == other else f"\n#if CONTROLLER_SINGLE{other}#else{text}#endif\n")
    shared = [functions.feedforward, *(f for component in functions.components for f in component[:2])]
    return "".join([*texts, *(_function(f, arrays) for f in shared if f is not None)]) + "\n"


def _function(function: casadi.Function, arrays: frozenset[str]) -> str:
    """A traced function in the type of the controller, with its arguments in their order.

    Its other inputs are members of the instant, or parameters, of which `arrays` have several elements.
    """
    name, inputs, outputs = function.name(), function.name_in(), function.name_out()
    has_states = bool({"next", "excess"} & {*outputs})
    arguments = _WITH_STATES[name] if has_states else _ARGUMENTS[name]
    body = function_source(function, "", Types("real", call="REAL({})"), conditions=True).partition("{\n")[2]
    context = "" if "parameters" in arguments else "at->"
    lines = []
    for key in inputs:
        if key == "time":
            place = "&now" if "now" in arguments else "&at->time"
        elif key in _OF_INSTANT:
            place = f"at->{key}"
        else:
            place = f"{'' if key in arrays else '&'}{context}parameters->{key}"
        if key not in arguments:
            lines.append(f"  const real *const {key} = {place};")
    used = {*inputs, *outputs, *(key for key in _KINDS if any(re.search(rf"= &?{key}\b", line) for line in lines))}
    lines += [f"  (void){key};" for key in arguments if key not in used]
    declared = [
        f"{_KINDS[key]}{key}" if key in _KINDS else f"{'' if key in outputs else 'const '}real {key}[]"
        for key in arguments
    ]
    text = "\n".join([f"\nstatic void {name}({', '.join(declared)})", "{", *lines, body])
    return re.sub(r"\btrue\b", "exact", text)  # a word of C++


class _Value(NamedTuple):
    """A value of a motion in single precision: a moment, or a single number; constants are both."""

    text: str
    is_moment: bool = True
    constant: float | None = None

    @property
    def moment(self) -> str:
        """As a moment."""
        if self.constant is not None:
            return f"CONSTANT({self.constant!r})"
        return self.text if self.is_moment else f"moment_of({self.text}, 0)"

    @property
    def single(self) -> str:
        """As a single number."""
        if self.constant is not None:
            return number(self.constant)
        return f"moment_value({self.text})" if self.is_moment else self.text


# Sums keep the digits that one of them has, products those that both have. {a} and {b} are moments, {x} and {y} numbers.
_SUMS = {
    casadi.OP_ADD: "moment_sum({a}, {b})",
    casadi.OP_SUB: "moment_sum({a}, moment_minus({b}))",
    casadi.OP_TWICE: "moment_sum({a}, {a})",
    casadi.OP_NEG: "moment_minus({a})",
}
_PRODUCTS = {
    casadi.OP_MUL: "moment_product({a}, {b})",
    casadi.OP_SQ: "moment_product({a}, {a})",
    casadi.OP_DIV: "moment_quotient({a}, {b})",
    casadi.OP_INV: "moment_quotient(CONSTANT(1.0), {a})",
    casadi.OP_FMIN: "moment_less({a}, {b}) ? {a} : {b}",
    casadi.OP_FMAX: "moment_less({a}, {b}) ? {b} : {a}",
}
_OF_MOMENTS = {
    casadi.OP_LT: "moment_less({a}, {b}) ? 1 : 0",
    casadi.OP_LE: "moment_less({b}, {a}) ? 0 : 1",
    casadi.OP_SIN: "REAL(sin)(moment_angle({a}))",
    casadi.OP_COS: "REAL(cos)(moment_angle({a}))",
}
_OF_NUMBERS = {
    casadi.OP_ADD: "{x} + {y}",
    casadi.OP_SUB: "{x} - {y}",
    casadi.OP_TWICE: "{x} + {x}",
    casadi.OP_NEG: "-({x})",
    casadi.OP_MUL: "{x} * {y}",
    casadi.OP_SQ: "{x} * {x}",
    casadi.OP_DIV: "{x} / {y}",
    casadi.OP_INV: "1 / {x}",
    casadi.OP_FMIN: "{x} < {y} ? {x} : {y}",
    casadi.OP_FMAX: "{x} > {y} ? {x} : {y}",
    casadi.OP_LT: "{x} < {y} ? 1 : 0",
    casadi.OP_LE: "{x} <= {y} ? 1 : 0",
    casadi.OP_NOT: "IS_TRUE({x}) ? 0 : 1",
    casadi.OP_AND: "IS_TRUE({x}) && IS_TRUE({y}) ? 1 : 0",
    casadi.OP_OR: "IS_TRUE({x}) || IS_TRUE({y}) ? 1 : 0",
    casadi.OP_IF_ELSE_ZERO: "IS_TRUE({x}) ? {y} : 0",
    **{
        getattr(casadi, f"OP_{name.upper()}"): f"REAL({name})({{x}})"
        for name in ("sqrt", "sin", "cos", "tan", "atan", "asin", "acos", "tanh", "exp", "log", "fabs", "floor")
    },
    casadi.OP_ATAN2: "REAL(atan2)({x}, {y})",
    casadi.OP_POW: "REAL(pow)({x}, {y})",
    casadi.OP_CONSTPOW: "REAL(pow)({x}, {y})",
    casadi.OP_HYPOT: "REAL(hypot)({x}, {y})",
}


def _of_time(function: casadi.Function) -> str:
    """A motion as a function of a moment, of which sums and products of constants keep 48 bits.

    Raises
    ------
    ExportError
        An operation for which there is no rule.
    """
    lines: list[str] = []
    values: dict[int, _Value] = {}
    for k in range(function.n_instructions()):
        kind, written = function.instruction_id(k), function.instruction_output(k)
        if kind == casadi.OP_CONST:
            values[written[0]] = _Value("", constant=float(function.instruction_constant(k)))
        elif kind == casadi.OP_INPUT:
            values[written[0]] = _Value("now")
        elif kind == casadi.OP_OUTPUT:
            lines.append(f"  motion[{written[1]}] = {values[function.instruction_input(k)[0]].single};")
        else:
            operands = [values[place] for place in function.instruction_input(k)]
            value = _operation(kind, operands[0], operands[-1], function.name())
            lines.append(f"  const {'moment' if value.is_moment else 'real'} a{k} = {value.text};")
            values[written[0]] = value._replace(text=f"a{k}")
    return "\n".join(["\nstatic void motion(moment now, real motion[])", "{", *lines, "}\n"])


def _operation(kind: int, a: _Value, b: _Value, name: str) -> _Value:
    one, both = a.is_moment or b.is_moment, a.is_moment and b.is_moment
    if kind == casadi.OP_IF_ELSE_ZERO and b.is_moment:
        return _Value(f"IS_TRUE({a.single}) ? {b.moment} : CONSTANT(0.0)")
    form = _SUMS.get(kind) if one else None
    form = form or (_PRODUCTS.get(kind) if both else None)
    is_moment = form is not None
    form = form or (_OF_MOMENTS.get(kind) if one else None) or _OF_NUMBERS.get(kind)
    if form is None:
        raise ExportError(
            f"the reference has an operation for which there is no single precision (number {kind} of CasADi in "
            f"{name}); expected arithmetic, or an export with reference = 'inputs'"
        )
    return _Value(form.format(a=a.moment, b=b.moment, x=a.single, y=b.single), is_moment)


# --- the header -------------------------------------------------------------------------------------------------------


def header_of(
    designed: Designed,
    functions: Traced,
    p: str,
    tables: ConstantTables,
    operations: Mapping[str, int],
    deviation: str = "",
) -> str:
    """NAME.h: types, parameters, memory, and what the functions do."""
    P, carried, law, faults = p.upper(), designed.carried, functions.law, designed.faults
    n, n_states, frozen = carried.steps_a_sample, _n_states(functions), faults.frozen
    measured, reference = designed.measured, designed.reference_variables
    has_feedforward = functions.feedforward is not None
    reading = carried.steps_a_reading if functions.sensors is not None else None
    inputs = "reference, " if reference else ""
    unit = "step" if carried.has_steps else "sample"
    work = f"at most {sum(operations.values())} floating-point operations, of them " + ", ".join(
        f"{count} {name}" for name, count in operations.items() if name != SIMPLE
    )
    clock = f"every {_ordinal(n)} takes a sample" + (f", every {_ordinal(reading)} a reading" if reading else "")
    path = path_of(designed.reference) if has_feedforward or _needs_motion(functions) else None
    if frozen is None:
        says_frozen = "not used: frozen measurements are not watched for"
    else:
        says_frozen = (
            f"a measurement is the same for {frozen.samples} samples while its reference moves by more than "
            f"{frozen.movement:g} m"
        )
    if faults.safe_force == "zero":
        safe = "0"
    elif designed.feedforward == "none" and not designed.constant_force.any():
        safe = "`start_force`, since there is no feedforward"
    else:
        safe = "the feedforward" + (", of the last good reference if that is the fault" if reference else "")
    ranges = _ranges_in_words(measured, designed.ranges)
    if reference:
        ranges += f"; of the reference: {_ranges_in_words(reference, designed.ranges)}"
    signals_in = ", ".join(f"{v.name}[{v.size}] [{v.unit}]" for v in measured) or "nothing"
    about = [
        f"{_title(designed)}.",
        "Generated by gough-stewart: do not edit. C99, C11, C17 or C++; needs libm only. No allocation, no state but "
        f"`{p}_memory`.",
        "",
        f"Once:            {p}_prepare(&parameters, &coefficients), again after each change of a parameter;",
        f"                 {p}_start(&parameters, &memory).",
        f"At each {unit + ':':8} {p}_step(&parameters, &coefficients, &memory, measured, {inputs}force, limited).",
        *(["", f"A step is {designed.step:g} s, by design; {clock}."] if carried.has_steps else []),
        "",
        f"Work per step, {'in one with a sample' if n > 1 else 'constant'}: {work}.",
        f"Constants in flash: {tables.bytes(8)} bytes, besides those in the code; {tables.bytes(4)} in single precision.",
        *([] if path is None else [path_deviation(designed.platform, designed.reference, path)]),  # type: ignore[arg-type]
        *(["", deviation] if deviation else []),
        *(["", "The loop:", *(f"- {_safe_in_comments(note)}" for note in designed.notes)] if designed.notes else []),
    ]
    fields = [_field(s, p) for s in designed.settings]
    coefficients = [
        ("ahead", 0, "[s] look-ahead of the feedforward: (delay + 1/2) sample_time"),
        *([("law", int(functions.coefficients.numel_out(0)), "")] if functions.coefficients is not None else []),
        *((part[0].name_out(0), int(part[0].numel_out(0)), "") for part in _by_name(functions)),
    ]
    single = [("sample_time_low", 0, "the part of the designed sample time that a float leaves out")]
    memory: list[tuple[str, Any, str]] = [
        ("samples", 0, f"{'steps ' if carried.has_steps else ''}since the start"),
        ("started", 0, "0 until measurements arrive"),
    ]
    if n_states:
        memory.append(("states", f"{P}_N_STATES", ""))
    if _uses(law, "excess"):
        memory.append(("planned", 6, "[N] forces after the last command has acted for one sample"))
        memory.append(("excess", 6, "[N] force allowed by the limits minus the command"))
    if _uses(law, "command"):
        memory.append(("command", 6, "[N] of the last sample"))
    if reading:
        memory.append(("reading", f"{P}_N_MEASURED", "the latest"))
    if carried.has_steps:
        memory.append(("target", 6, "[N] forces of the last sample, within the force limit"))
        memory.append(("force_limited", 6, "1 where that limit was active"))
    if carried.drives:
        memory.append(
            ("drives", 12, "[N] forces at the end of the last step, behind the rate limit and behind the lag")
        )
        memory.append(("rate_limited", 6, "1 where the rate limit was active in the last step"))
    if reference and has_feedforward:
        memory.append(("known", 6, "[N] feedforward of the last good reference"))
    if designed.watched:
        memory.append(("held", f"{P}_N_WATCHED", "measurements that are watched"))
        memory.append(("held_samples", f"{P}_N_WATCHED", "for how many samples they are the same"))
        memory.append(("held_reference", f"{P}_N_WATCHED", "their references since then"))
        memory.append(("held_movement", f"{P}_N_WATCHED", "how far these have moved"))
    if carried.manual:
        memory.append(("enabled", 0, "set it to 0 to switch the controller off, and to 1 to switch it on again"))
        memory.append(("manual_force", 6, "[N] set it while it is off to the force that acts, which its force follows"))
        memory.append(("transfer", 6, "[N] what its command then lacked of that force; fades when it is on"))
    memory.append(("input_status", 0, f"of the last sample, {P}_INPUT_GOOD or another of its values"))
    memory.append(("input_bad_time", 0, "[s] for how long it has not been good, the last sample included; else 0"))
    of_single = [("turns", 0, "how often `samples` began anew")]
    of_single += [("rounded", f"{P}_N_STATES", "what rounding has left out of the states")] if n_states else []
    step = [
        f"Computes a {unit}. `measured`: {signals_in}, in single precision relative to home."
        if measured
        else f"Computes a {unit}. `measured`: {signals_in}.",
    ]
    if reference:
        step.append(
            "`reference`: position [m], orientation [rad], both in single precision relative to home, velocity [m/s], "
            "angular_velocity [rad/s], acceleration [m/s2], angular_acceleration [rad/s2], three of each, world "
            "components; orientation is roll, pitch, yaw about fixed axes."
        )
    step.append(
        "`force`: of the six actuators [N], positive extends the leg. `limited`: 1 where the force limit is active, else 0."
    )
    if carried.drives:
        step.append(
            "The force is that behind the drives, its mean over the step. A delay around the code may be before or "
            "after it."
        )
    if designed.zeros_are_no_measurement:
        step.append("As long as all inputs are exactly 0, no measurements have arrived: the force is `start_force`.")
    with_memory = ", or with its memory" if isinstance(designed.law, FunctionLaw) else ""
    step.append(f"Ranges: {ranges}.")
    step.append(
        f"While `input_status` is not good, all six forces are {safe}, within the force limit, and the law's memory stays "
        "as it is. Afterwards the law goes on by itself: after more than one sample from rest in the new measurements, "
        f"its integrals unchanged{with_memory}."
    )
    if carried.manual:
        step.append(
            "While `enabled` is 0, the force is `manual_force` within the force limit, and the law rests in the present "
            f"measurements. Switched on, it begins with that force, and what it lacked fades with {P}_TRANSFER_TIME."
        )
    relative = [
        "What measurements are relative to in single precision, in their order: the home pose and its leg lengths; 0 for "
        "velocities. Subtract it before rounding to float, or count from there, so that no digits are lost."
    ]
    blocks = [
        _comment(about),
        f"#ifndef {P}_H\n#define {P}_H\n",
        _comment(
            [
                "float or double: the type of all numbers. In single precision poses and lengths are relative to home, "
                "and times are sums of two floats; do not compile that with -ffast-math."
            ]
        ),
        f"#ifndef {P}_REAL\n#define {P}_REAL double\n#endif",
        f"#define {P}_KIND_float 1\n#define {P}_KIND_double 2",
        f"#define {P}_JOINED_(a, b) a##b\n#define {P}_JOINED(a, b) {P}_JOINED_(a, b)",
        f"#define {P}_KIND {P}_JOINED({P}_KIND_, {P}_REAL)\n#define {P}_SINGLE ({P}_KIND == 1)\n",
    ]
    if carried.manual:
        text = "The time constant [s] in which a force fades that was taken over when the controller is switched on."
        blocks += [_comment([text]), f"#ifndef {P}_TRANSFER_TIME\n#define {P}_TRANSFER_TIME 1.0\n#endif\n"]
    blocks += [
        '#ifdef __cplusplus\nextern "C" {\n#endif\n',
        f"typedef {P}_REAL {p}_real;\n",
        f"enum {{ {P}_N_MEASURED = {interface.size_of(measured)}, {P}_N_REFERENCE = {18 if reference else 0}, "
        f"{P}_N_STATES = {n_states} }};",
        *([f"enum {{ {P}_N_WATCHED = {interface.size_of(designed.watched)} }};"] if designed.watched else []),
        *([f"enum {{ {P}_STEPS_A_SAMPLE = {n} }};"] if carried.has_steps else []),
        *([f"enum {{ {P}_STEPS_A_READING = {reading} }};"] if reading else []),
        "",
        "/* Values of `input_status`. */",
        "enum {",
        f"    {P}_INPUT_GOOD = 0,",
        f"    {P}_INPUT_OUT_OF_RANGE = 1, /* an input is NaN, infinite, or not in its range */",
        f"    {P}_INPUT_FROZEN = 2,       /* {says_frozen} */",
        f"    {P}_FORCE_NOT_FINITE = 3,   /* inputs are in their ranges, but the law gives no finite force for them */",
        f"    {P}_NOT_PREPARED = 4        /* the coefficients are zeros: all forces are 0, and nothing is remembered */",
        "};\n",
        "\n".join(["typedef struct {", *fields, f"}} {p}_parameters;\n"]),
        *([_comment(relative), f"extern const {p}_real {P}_HOME[{P}_N_MEASURED];"] if measured else []),
        *([f"/* Likewise of the reference. */\nextern const {p}_real {P}_HOME_POSE[6];"] if reference else []),
        f"/* Designed values. */\nextern const {p}_parameters {P}_DEFAULTS;\n",
        _comment(
            [
                "Values computed from the parameters. Begin with zeros, for which all forces are 0 until "
                f"`{p}_prepare` has accepted the parameters."
            ]
        ),
        _struct(f"{p}_coefficients", p, coefficients, single),
        "/* The complete state. */",
        _struct(f"{p}_memory", p, memory, of_single),
        _comment(
            [
                "Returns 0, or the number of a parameter with an invalid value, counted from 1 in the order of the "
                "struct; then the coefficients stay as they were. A step must not run while they are written."
            ]
        ),
        f"int {p}_prepare(const {p}_parameters *parameters, {p}_coefficients *coefficients);\n",
        "/* Sets the memory before the first sample. */",
        f"void {p}_start(const {p}_parameters *parameters, {p}_memory *memory);\n",
        _comment(step),
        f"void {p}_step(const {p}_parameters *parameters, const {p}_coefficients *coefficients, {p}_memory *memory,",
        f"    const {p}_real *measured, {f'const {p}_real *reference, ' if reference else ''}{p}_real *force, "
        "unsigned char *limited);\n",
        "#ifdef __cplusplus\n}\n#endif\n\n#endif\n",
    ]
    return "\n".join(blocks)


def _by_name(functions: Traced) -> list[Any]:
    """The components whose coefficients are kept."""
    return [c for c in (functions.limits, functions.drives, functions.sensors) if c is not None]


def _struct(name: str, p: str, members: Sequence[tuple[str, Any, str]], single: Sequence[tuple[str, Any, str]]) -> str:
    """A struct of numbers, with members that it has in single precision only at its end."""

    def line(member: str, size: Any, text: str) -> str:
        return f"    {p}_real {member}{f'[{size}]' if size else ''};{f' /* {text} */' if text else ''}"

    lines = [line(*member) for member in members]
    lines += [f"#if {p.upper()}_SINGLE", *(line(*member) for member in single), "#endif"]
    return "\n".join(["typedef struct {", *lines, f"}} {name};\n"])


def _field(setting: Setting, p: str) -> str:
    v = setting.variable
    unit = f"[{v.unit}] " if v.unit else ""
    none = "; 0: none" if setting.may_be_infinite else ""
    return f"    {p}_real {v.name}{f'[{v.size}]' if v.shape else ''}; /* {unit}{v.description}{none} */"


def _comment(paragraphs: Sequence[str]) -> str:
    """A comment of lines of at most 120 characters."""
    lines = [fill(text, 117, subsequent_indent="  " if text[:2] == "- " else "", drop_whitespace=True) if not
             text.startswith(" ") and "  " not in text else text for text in paragraphs]  # fmt: skip
    return "/* " + "\n".join(lines).replace("\n", "\n   ") + " */"


def _safe_in_comments(text: str) -> str:
    plain = text.translate(_ASCII).encode("ascii", "replace").decode()
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")


def _ordinal(n: int) -> str:
    """In words for a comment: `step`, `3rd step`."""
    ending = {1: "st", 2: "nd", 3: "rd"}.get(n % 10 if n % 100 not in (11, 12, 13) else 0, "th")
    return "step" if n == 1 else f"{n}{ending} step"


def _ranges_in_words(variables: Iterable[Variable], ranges: Ranges) -> str:
    texts = []
    for v in variables:
        low, high = ranges.of(v)
        ends = [f"{a:.6g} to {b:.6g}" for a, b in zip(low, high, strict=True)]
        # once for all elements, if it is the same
        texts.append(f"{v.name} {ends[0] if len(set(ends)) == 1 else ', '.join(ends)} {v.unit}")
    return "; ".join(texts) or "none, since nothing comes in"


# --- operations per step ----------------------------------------------------------------------------------------------

# Not counted: CasADi's reads, writes and copies.
_FREE = {casadi.OP_CONST, casadi.OP_INPUT, casadi.OP_OUTPUT, casadi.OP_ASSIGN, casadi.OP_PARAMETER}
_SIMPLE = {
    *(casadi.OP_ADD, casadi.OP_SUB, casadi.OP_MUL, casadi.OP_NEG, casadi.OP_SQ, casadi.OP_TWICE),
    *(casadi.OP_LT, casadi.OP_LE, casadi.OP_EQ, casadi.OP_NE, casadi.OP_NOT, casadi.OP_AND, casadi.OP_OR),
    *(casadi.OP_FMIN, casadi.OP_FMAX, casadi.OP_IF_ELSE_ZERO, casadi.OP_FABS),
}
_DIVISIONS = {casadi.OP_DIV, casadi.OP_SQRT, casadi.OP_INV}
SIMPLE, DIVISIONS, OTHERS = (
    "additions, multiplications and comparisons",
    "divisions and square roots",
    "other functions",
)
# Of the runtime for six forces: sums and checks for finite values, of which there may be many of inputs and states; and
# the search in a table.
_A_FORCE, _A_CHECK, _A_SEARCH, _A_PIECE = 8, 2, 40, 6 * (5 + 4 + 3) * 2
_A_LAW = 25
# In the written code, where several quotients of one divisor are products with its reciprocal.
_RECIPROCAL, _PRODUCT = re.compile(r"^  r\d+=1/", re.M), re.compile(r"\*r\d+\);$", re.M)


def operations_of(functions: Traced) -> dict[str, int]:
    """Floating-point operations per step in double precision, at most, by kind."""
    law, motion, motions = functions.law, functions.motion, 0
    total = {SIMPLE: 6 * _A_FORCE, DIVISIONS: 0, OTHERS: 0}
    if law is not None:
        total[SIMPLE] += _A_CHECK * (
            sum(map(law.numel_in, range(law.n_in()))) + sum(map(law.numel_out, range(law.n_out())))
        )
    if motion is not None:
        motions = (functions.feedforward is not None) + (law is not None)
        if motion.name() == "motion_of_table":
            total[SIMPLE] += motions * (_A_SEARCH + _A_PIECE)
        if functions.path is not None:  # at both ends of a piece
            total[SIMPLE] += motions * 2 * (_A_SEARCH + 2 * _A_LAW + _A_PIECE)
    for function in (
        *(functions.extrapolated, functions.feedforward, functions.start, functions.expected, law),
        *(component.step for component in functions.components),
        *[motion] * motions,
        *[functions.path] * 2 * motions,
    ):
        if function is None:
            continue
        divisions = 0
        for k in range(function.n_instructions()):
            kind = function.instruction_id(k)
            divisions += kind in _DIVISIONS
            if kind not in _FREE:
                total[SIMPLE if kind in _SIMPLE else DIVISIONS if kind in _DIVISIONS else OTHERS] += 1
        if divisions:
            code = function_source(function, conditions=True)
            products = len(_PRODUCT.findall(code))
            total[SIMPLE] += products
            total[DIVISIONS] += len(_RECIPROCAL.findall(code)) - products
    return total


# --- what single precision costs --------------------------------------------------------------------------------------

# More than any controller's coefficients and memory [bytes].
_ROOM = 1 << 20


def deviation_of(experiment: Experiment, designed: Designed, controller: Any = None) -> str:
    """What single precision costs, in words: forces of the code compiled here, on what a run in the harness measured.

    The run is without disturbances. Both precisions are compiled; the forces of double precision are the harness's.
    """
    quiet = experiment.model_copy(update={"change": [], "disturbance": [], "fault": [], "injection": None})
    prepared = prepare(quiet, controller)
    with prepared.law_in_a_run() as law:
        run = simulate(ModelPlant(prepared.machine, prepared.start), law, prepared.loop)
    samples = int(run.sample_of_row[-1]) + 1
    names = [v.name for v in designed.measured]
    measured = run.measured[:samples, signals.positions(names)] if names else np.zeros((samples, 0))
    reference = None
    if designed.reference_inputs and prepared.reference is not None:
        reference = np.concatenate(prepared.reference(np.arange(samples) * designed.sample_time), axis=1)
    try:
        expected, forces = (_forces(designed, real, measured, reference) for real in ("double", "float"))
    except BuildError as error:
        return f"Not measured: how far forces in single precision deviate, since the code was not compiled ({error})."
    error, largest = forces - expected, float(np.abs(expected).max())
    share = f"{float(np.abs(error).max()) / largest:.2g}" if largest > 0 else "all"
    return (
        f"With {{P}}_REAL=float, forces deviate from those in double precision, in {samples * designed.sample_time:g} s "
        f"of the designed loop, by at most {float(np.abs(error).max()):.2g} N, {share} of the largest force; in root "
        f"mean square by {float(np.sqrt((error**2).mean())):.2g} N."
    )


def _forces(designed: Designed, real: str, measured: FloatArray, reference: FloatArray | None) -> FloatArray:
    """Of the compiled code at every sample (m, 6); at its last step, if it has several."""
    kind: Any = {"float": ctypes.c_float, "double": ctypes.c_double}[real]
    home = home_of(designed.platform)
    if real == "float":
        measured = measured - _at_home(designed.measured, home)
        reference = None if reference is None else reference - np.concatenate([home.pose, np.zeros(12)])
    sources = controller_sources(designed)
    flags = [*(flag for flag in FLAGS if flag != "-fvisibility=hidden"), f"-DCONTROLLER_REAL={real}"]
    library = compile_library("controller", sources.units, sources.headers, native(), flags=flags)
    with tempfile.TemporaryDirectory(prefix="gough-stewart-", ignore_cleanup_errors=True) as folder:
        path = Path(folder, f"controller{native().suffix}")
        path.write_bytes(library)
        code = ctypes.CDLL(str(path))
        parameters = ctypes.byref(ctypes.c_char.in_dll(code, "CONTROLLER_DEFAULTS"))
        coefficients, memory = (ctypes.create_string_buffer(_ROOM) for _ in range(2))
        code.controller_prepare(parameters, coefficients)
        code.controller_start(parameters, memory)
        force, limited = (kind * 6)(), (ctypes.c_ubyte * 6)()
        forces = np.empty((len(measured), 6))
        for k, row in enumerate(measured):
            rows = [row] if reference is None else [row, reference[k]]
            inputs = [(kind * max(1, len(values)))(*values.tolist()) for values in rows]
            for _ in range(designed.carried.steps_a_sample):
                code.controller_step(parameters, coefficients, memory, *inputs, force, limited)
            forces[k] = force[:]
    return forces


def c_files(experiment: Experiment, designed: Designed, name: str, controller: Any = None) -> dict[str, bytes]:
    """The C of an experiment's controller and an example program, by file name; what float costs is in the header."""
    deviation = deviation_of(experiment, designed, controller).format(P=name.upper())
    sources = controller_sources(designed, name, deviation)
    return {
        file: text.encode() for file, text in {**sources.units, **sources.headers, EXAMPLE: sources.example}.items()
    }
