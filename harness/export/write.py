"""The C of a controller: NAME.c, NAME.h, and an example program.

NAME.c is the runtime of runtime/, plain C that is the same for all designs, with two parts in the places of its
`#include`: design.c, numbers and switches of one design; and law.c, the functions that CasADi traced, with poses and
lengths relative to home where the type of the numbers is float.
"""

import ctypes
import re
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Any

import casadi
import numpy as np
from jinja2 import Environment, StrictUndefined

from gough_stewart.fmu_build.cache import BuildError
from gough_stewart.fmu_build.codegen import function_source
from gough_stewart.fmu_build.toolchain import FLAGS, compile_library, native
from gough_stewart.harness.control.component import TRANSFER_TIME
from gough_stewart.harness.experiment.preparation import Prepared, prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.design import Designed
from gough_stewart.harness.export.laws import FunctionLaw
from gough_stewart.harness.export.symbols import Home, home_of
from gough_stewart.harness.export.tables import (
    ConstantTables,
    add_motion,
    function_of_time,
    number,
    numbers,
    path_of,
)
from gough_stewart.harness.export.trace import Traced
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.motion.motion import Piecewise
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.open import ModelPlant
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import Variable
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray

# The program that shows how the C is called.
EXAMPLE = "example_main.c"
RUNTIME = {path.name: path.read_text(encoding="utf-8") for path in Path(__file__).parent.joinpath("runtime").iterdir()}


@dataclass(frozen=True)
class ControllerSources:
    """A controller as C99."""

    units: dict[str, str]  # source files to compile: text by file name
    headers: dict[str, str]  # without what single precision costs
    example: str  # a program that runs it
    operations: int  # floating-point operations per step, at most
    header: Callable[[str], str]  # the text of the header with what single precision costs, in words


def controller_sources(designed: Designed, functions: Traced, prefix: str = "controller") -> ControllerSources:
    """The sources of a designed controller as traced; `prefix`: of all public names, and the name of the files."""

    def named(text: str) -> str:
        text = text.replace('"controller.h"', f'"{prefix}.h"')
        return re.sub(r"\bcontroller_(?=\w)", f"{prefix}_", re.sub(r"\bCONTROLLER_", f"{prefix.upper()}_", text))

    home = home_of(designed.platform)
    switches, tables = _switches(designed, functions), _numbers(designed, home)
    if switches["HAS_TABLE"]:
        add_motion(tables, designed.reference, home)  # type: ignore[arg-type]
    design = "\n".join(["", *(f"#define {name} {value}" for name, value in switches.items()), *tables.lines, ""])
    parts = {**RUNTIME, "design.c": design, "law.c": _law(designed, functions)}
    source = re.sub(r'^#include "(\w+\.c)"\n', lambda include: parts[include[1]], parts["controller.c"], flags=re.M)
    operations = operations_of(functions)
    of_kinds = ", ".join(f"{count} {kind}" for kind, count in operations.items() if kind != SIMPLE)
    work = f"at most {sum(operations.values())} floating-point operations, of them {of_kinds}"
    flash = 8 * tables.reals + 4 * tables.words, 4 * tables.reals + 4 * tables.words

    # what the example measures and follows: of a platform at rest in the first reference
    first = ["/* in single precision, relative to home */"]
    first.append("#define FROM(x, home) (controller_real)(CONTROLLER_SINGLE ? (x) - (home) : (x))")
    for name, values, at_home in (
        # C has no empty arrays
        ("MEASURED", np.append(designed.first_measured, 0.0), np.append(_at_home(designed.measured, home), 0.0)),
        ("REFERENCE", designed.first_reference, np.append(home.pose, np.zeros(12))),
    ):
        texts = (f"FROM({x!r}, {zero!r})" for x, zero in zip(values.tolist(), at_home.tolist(), strict=True))
        first.append(f"#define {name} {{{', '.join(texts)}}}")
    first += [f"#define {key} {switches[key]}" for key in ("HAS_REFERENCE_INPUTS", "STEPS_A_SAMPLE")]
    example = RUNTIME[EXAMPLE].replace('#include "design.c"\n', "\n".join([*first, ""]))

    # title, law and feedforward in a comment, which they must not end
    law = "no feedback" if designed.law is None else designed.law.name
    title = " ".join(designed.title.replace("*/", "").replace("/*", "").split())
    title = f"{title}: {law}, feedforward: {designed.feedforward.replace('_', ' ')}"
    template = _TEMPLATES.from_string(named(RUNTIME["controller.h.in"]))
    known = {
        **{"design": designed, "components": [component.coefficients for component in functions.components]},
        **{"title": title, "work": work, "flash": flash, "transfer_time": TRANSFER_TIME},
        **{"ranges": partial(_ranges, designed), "is_function": isinstance(designed.law, FunctionLaw)},
    }

    def header(deviation: str) -> str:
        return f"{template.render(switches, **known, deviation=deviation)}\n"

    units = {f"{prefix}.c": f"/* {title}. */\n{named(source)}"}
    return ControllerSources(units, {f"{prefix}.h": header("")}, named(example), sum(operations.values()), header)


# --- the header -------------------------------------------------------------------------------------------------------

# Comments in ASCII, for every compiler and editor.
_ASCII = str.maketrans({"×": "x", "±": "+-", "°": " deg", "–": "-", "—": "-", "µ": "u"})


def _plain(text: str) -> str:
    """A text that does not end the comment that it is in."""
    text = text.translate(_ASCII).encode("ascii", "replace").decode()
    return text.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")


def _comment(text: str) -> str:
    """A comment, whose paragraphs are filled to at most 120 characters; those with aligned columns stay."""
    lines = list[str]()
    for paragraph in text.replace("\\\n", "").split("\n"):
        if "  " in paragraph:
            lines.append(paragraph.rstrip())
        elif paragraph or (lines and lines[-1]):
            lines += fill(paragraph, 117, subsequent_indent="  " * paragraph.startswith("- ")).split("\n")
    return "/* " + "\n".join(f"   {line}".rstrip() for line in lines)[3:].rstrip() + " */"


def _ranges(designed: Designed, variables: Iterable[Variable]) -> str:
    """Ranges in words, once for all elements of a variable if they are the same."""
    texts = []
    for v in variables:
        ends = [f"{low:.6g} to {high:.6g}" for low, high in zip(*designed.ranges.of(v), strict=True)]
        texts.append(f"{v.name} {ends[0] if len(set(ends)) == 1 else ', '.join(ends)} {v.unit}")
    return "; ".join(texts) or "none, since nothing comes in"


_TEMPLATES = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
_TEMPLATES.filters |= {"comment": _comment, "plain": _plain}


def _at_home(variables: Iterable[Variable], home: Home) -> FloatArray:
    """The values at home of several signals, one after the other."""
    return np.concatenate([np.zeros(0), *(home.of(v.name, v.size) for v in variables)])


# --- design.c ---------------------------------------------------------------------------------------------------------


def _switches(designed: Designed, functions: Traced) -> dict[str, int]:
    carried, law, reference = designed.carried, functions.of_poses.law, designed.reference
    has_feedforward = functions.feedforward is not None
    has_motion = reference is not None and functions.of_poses.needs_motion
    has_constant = any(s.variable.name == "constant_force" for s in designed.settings)
    is_table = isinstance(reference, Piecewise) and (has_feedforward or has_motion)
    reading = (carried.steps_a_reading or 0) if functions.sensors is not None else 0
    common = int(np.lcm(carried.steps_a_sample, max(1, reading)))
    is_place = np.concatenate([np.zeros(0), *(np.full(v.size, "velocity" not in v.name) for v in designed.measured)])
    first_pose = designed.first_reference[:6] if designed.reference_inputs else np.zeros(0)
    legs = leg_geometry(designed.platform, np.zeros(3), np.zeros(3)).length
    low, high = designed.ranges.leg_length
    safe = 0 if designed.faults.safe_force == "zero" else 1 if has_feedforward or has_constant else 2
    switches = {
        "HAS_LAW": law is not None,
        "HAS_START": functions.of_poses.start is not None,
        "HAS_EXCESS": law is not None and "excess" in law.name_in(),
        "HAS_FEEDFORWARD": has_feedforward,
        "HAS_CONSTANT_FORCE": has_constant,
        "HAS_REFERENCE_INPUTS": designed.reference_inputs,
        "HAS_MOTION": has_motion,
        "HAS_TABLE": is_table,
        "HAS_PATH": is_table and path_of(reference) is not None,
        "HAS_DRIVES": functions.drives is not None,
        "HAS_SENSORS": functions.sensors is not None,
        "HAS_STEPS": carried.has_steps,
        "HAS_MANUAL": "manual" in carried.parts,
        "STEPS_A_SAMPLE": carried.steps_a_sample,
        "STEPS_A_READING": reading,
        "STEPS_OF_TURN": common * max(1, 2**23 // common),
        # zeros mean that no values have arrived yet, unless they are at rest: velocities, or a reference at zero
        "SEES_ZEROS": bool((designed.first_measured * is_place).any() or first_pose.any()),
        # also where the legs are in their range in a pose of zeros
        "ZERO_IS_A_REFERENCE": not designed.reference_inputs or bool(((legs >= low) & (legs <= high)).all()),
        "N_MEASURED": sum(variable.size for variable in designed.measured),
        "N_STATES": law.numel_out("next") if law is not None and "next" in law.name_out() else 0,
        "N_COEFFICIENTS": 0 if functions.coefficients is None else functions.coefficients.numel_out(0),
        "N_WATCHED": sum(variable.size for variable in designed.watched),
        **{"SAFE_ZERO": 0, "SAFE_FEEDFORWARD": 1, "SAFE_START": 2, "SAFE_FORCE": safe},
    }
    return {name: int(value) for name, value in switches.items()}


def _numbers(designed: Designed, home: Home) -> ConstantTables:
    """Defaults and checks of the parameters, home, ranges of the inputs."""
    tables, settings = ConstantTables(), designed.settings
    tables.define(SAMPLE_TIME=repr(float(designed.sample_time)))
    tables.define(DEFAULT_SAMPLE_TIME="R(SAMPLE_TIME)", TRANSFER_TIME="R(CONTROLLER_TRANSFER_TIME)")

    # defaults in their places, since C++ has no designators before C++20; no limit is 0
    tables.lines += ["", "const controller_parameters CONTROLLER_DEFAULTS = {"]
    for s in settings:
        text = numbers(np.where(np.isinf(s.value) & s.may_be_infinite, 0.0, s.value).flat)
        tables.lines.append(f"    {f'{{{text}}}' if s.variable.shape else text}, /* {s.variable.name} */")
        tables.reals += s.variable.size
    tables.lines += ["};", ""]

    # home, and the ranges of what comes in
    measured, reference, frozen = designed.measured, designed.reference_variables, designed.faults.frozen
    for name, of_home, variables in (("MEASURED", "HOME", measured), ("REFERENCE", "HOME_POSE", reference)):
        if not variables:
            continue
        at_home, ends = _at_home(variables, home), [designed.ranges.of(v) for v in variables]
        shown = at_home if name == "MEASURED" else home.pose
        tables.lines.append(f"const real CONTROLLER_{of_home}[{len(shown)}] = {{{numbers(shown)}}};")
        tables.define(**{of_home: f"CONTROLLER_{of_home}"})
        tables.reals += len(shown)
        for end, values in (("LOW", [end.low for end in ends]), ("HIGH", [end.high for end in ends])):
            joined = np.concatenate(values)
            pairs = zip(joined.tolist(), at_home.tolist(), strict=True)
            tables.add(f"{name}_{end}", joined, written=", ".join(f"FROM_HOME({x!r}, {at!r})" for x, at in pairs))
    if not reference:
        tables.lines.append(f"MAYBE_UNUSED static const real HOME_POSE[6] = {{{numbers(home.pose)}}};")
    if frozen is not None:
        is_watched = np.concatenate([np.repeat(v in designed.watched, v.size) for v in measured])
        tables.add("WATCHED", np.flatnonzero(is_watched), "int")
        tables.define(FROZEN_SAMPLES=frozen.samples, FROZEN_MOVEMENT=number(frozen.movement))

    # checks of the parameters; if one fails, the function returns its number
    checks = list[str]()
    for place, s in enumerate(settings, 1):
        v, largest = s.variable, "LARGEST" if s.largest == LARGEST_NUMBER else number(s.largest)
        above = {"> 0": "{0} > 0", ">= 0": "{0} >= 0", None: f"{{0}} >= -{largest}"}[v.lower_bound]
        below = "" if s.may_be_infinite else f" && {{0}} <= {largest}"
        bounds = (above + below).format(f"parameters->{v.name}" + ("[k]" if v.shape else ""))
        conditions = [re.sub(r"(?<![\w.])(\d+\.\d*|\d+e-?\d+)", r"R(\1)", text) for text in s.conditions]
        checks.append(f"    {f'for (k = 0; k < {v.size}; ++k) ' if v.shape else ''}if (!({bounds})) return {place};")
        checks += [f"    if (!({condition})) return {place};" for condition in conditions]
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


# --- law.c ------------------------------------------------------------------------------------------------------------

# What a function is computed from besides its arguments: of others than these, nothing.
_CONTEXTS = {
    **dict.fromkeys(("law", "start", "feedforward", "references_watched"), "const instant *at"),
    "motion": "moment now",
}
_OF_PARAMETERS = "const controller_parameters *parameters"
_OF_INSTANT = ("coefficients", "motion", "measured", "excess", "feedforward", "states")


def _law(designed: Designed, functions: Traced) -> str:
    """The traced functions; those that differ in single precision twice."""
    arrays = frozenset(s.variable.name for s in designed.settings if s.variable.shape)
    has_motion = functions.feedforward is not None or functions.of_poses.needs_motion
    texts = [] if functions.coefficients is None else [_function(functions.coefficients, arrays)]
    for plain, of_single in zip(functions.of_poses, functions.relative, strict=True):
        if plain is None or of_single is None or (plain.name().startswith("motion") and not has_motion):
            continue
        is_of_time = plain.name() == "motion" and "time" in of_single.name_in()
        text = _function(plain, arrays)
        in_single = function_of_time(of_single) if is_of_time else _function(of_single, arrays)
        texts.append(text if text == in_single else f"\n#if CONTROLLER_SINGLE{in_single}#else{text}#endif\n")
    shared = [functions.feedforward, *(f for component in functions.components for f in component[:2])]
    return "".join([*texts, *(_function(f, arrays) for f in shared if f is not None)]) + "\n"


def _function(function: casadi.Function, arrays: frozenset[str]) -> str:
    """A traced function in the type of the controller.

    Of one with a context, inputs are members of the instant, or parameters, of which `arrays` have several elements.
    """
    name, inputs, outputs = function.name(), function.name_in(), function.name_out()
    context = _OF_PARAMETERS if name.startswith("coefficients_of_") else _CONTEXTS.get(name, "")
    variable, lines = re.findall(r"\w*$", context)[0], list[str]()
    for key in inputs if context else ():
        if key == "time":
            place = "&now" if variable == "now" else "&at->time"
        elif key in _OF_INSTANT:
            place = f"at->{key}"
        else:
            place = f"{'' if key in arrays else '&'}{'at->' * (variable == 'at')}parameters->{key}"
        lines.append(f"  const real *const {key} = {place};")
    if context and not any(re.search(rf"= &?{variable}\b", line) for line in lines):
        lines.append(f"  (void){variable};")
    arguments = [context] if context else [f"const real {key}[]" for key in inputs]
    arguments += [f"real {key}[]" for key in outputs]
    body = function_source(function, "", "real", call="REAL({})", conditions=True).partition("{\n")[2]
    text = "\n".join([f"\nstatic void {name}({', '.join(arguments)})", "{", *lines, body])
    return re.sub(r"\btrue\b", "exact", text)  # a word of C++


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


def operations_of(functions: Traced) -> dict[str, int]:
    """Floating-point operations per step in double precision, at most, by kind."""
    path, motion, later, start, expected, law = functions.of_poses
    motions = 0 if motion is None else (functions.feedforward is not None) + (law is not None)
    total = {SIMPLE: 6 * _A_FORCE, DIVISIONS: 0, OTHERS: 0}
    if law is not None:
        total[SIMPLE] += _A_CHECK * (law.nnz_in() + law.nnz_out())
    if motion is not None and motion.name() == "motion_of_table":
        total[SIMPLE] += motions * (_A_SEARCH + _A_PIECE)
    if path is not None:  # at both ends of a piece
        total[SIMPLE] += motions * 2 * (_A_SEARCH + 2 * _A_LAW + _A_PIECE)
    of_sample = (later, functions.feedforward, start, expected, law, *(c.step for c in functions.components))
    for function, times in (*((f, 1) for f in of_sample), (motion, motions), (path, 2 * motions)):
        if function is None or not times:
            continue
        kinds = [function.instruction_id(k) for k in range(function.n_instructions())]
        for kind in kinds:
            if kind not in _FREE:
                total[SIMPLE if kind in _SIMPLE else DIVISIONS if kind in _DIVISIONS else OTHERS] += times
        if _DIVISIONS.intersection(kinds):
            # in the written code several quotients of one divisor are products with its reciprocal
            code = function_source(function, conditions=True)
            products = len(re.findall(r"\*r\d+\);$", code, re.M))
            total[SIMPLE] += times * products
            total[DIVISIONS] += times * (len(re.findall(r"^  r\d+=1/", code, re.M)) - products)
    return total


# --- what single precision costs --------------------------------------------------------------------------------------

# Of a run that does not follow a path, at most [s].
_COMPARED = 2.5
# More than any controller's coefficients and memory [bytes].
_ROOM = 1 << 20


def c_files(
    experiment: Experiment, designed: Designed, sources: ControllerSources, prepared: Prepared, controller: Any = None
) -> dict[str, bytes]:
    """The sources of an experiment's controller by file name, with what float costs in the header.

    That is of the forces of the code compiled here, on what a run in the harness measured without disturbances. Both
    precisions are compiled; the forces of double precision are the harness's, but for the rounding of a path, which is
    stated too.
    """
    name = Path(next(iter(sources.units))).stem
    has_path, duration = path_of(designed.reference) is not None, experiment.loop.duration
    if not has_path and duration > _COMPARED:
        loop = experiment.loop.model_copy(update={"duration": _COMPARED})
        quiet: dict[str, Any] = {"change": [], "disturbance": [], "fault": [], "injection": None}
        prepared = prepare(experiment.model_copy(update={"loop": loop, **quiet}), controller)
    with prepared.law_in_a_run() as law:
        plant = ModelPlant(prepared.machine, prepared.start)
        (run,) = simulate(plant, law, replace(prepared.loop, changes=(), injection=None))
    samples = int(run.sample_of_row[-1]) + 1
    names = [v.name for v in designed.measured]
    rows = [run.measured[:samples, signals.positions(names) if names else []]]
    if designed.reference_inputs and prepared.reference is not None:
        rows.append(np.concatenate(prepared.reference(np.arange(samples) * designed.sample_time), axis=1))
    try:
        expected, forces = _forces(designed, sources, rows)
    except BuildError as error:
        text = f"Not measured: how far forces in single precision deviate, since the code was not compiled ({error})."
    else:
        deviation, largest = forces - expected, float(np.abs(expected).max())
        most, mean_square = float(np.abs(deviation).max()), float((deviation**2).mean())
        text = (
            f"With {name.upper()}_REAL=float, forces deviate from those in double precision, in "
            f"{samples * designed.sample_time:g} s of the designed loop, by at most {most:.2g} N, "
            f"{f'{most / largest:.2g}' if largest > 0 else 'all'} of the largest force; in root mean square by "
            f"{mean_square**0.5:.2g} N."
        )
        if has_path and not designed.carried.has_steps:
            commanded = np.clip(run.command[:samples], -designed.force_limit, designed.force_limit)
            share = float(np.abs(expected - commanded).max()) / largest
            text += (
                f" The path is rounded: in double precision, forces differ from those of a run by {share:.2g} of these."
            )
    texts = {**sources.units, **dict.fromkeys(sources.headers, sources.header(text)), EXAMPLE: sources.example}
    return {file: content.encode() for file, content in texts.items()}


def _forces(designed: Designed, sources: ControllerSources, rows: list[FloatArray]) -> list[FloatArray]:
    """Of the compiled code at every sample (m, 6), in double and in single precision; at its last step of many.

    `rows` are measurements and perhaps references.
    """
    name, home = Path(next(iter(sources.units))).stem, home_of(designed.platform)
    # both in one library: the names in single precision have another ending
    public = [f"{name}_{part}" for part in ("prepare", "start", "step")]
    public += [f"{name.upper()}_{part}" for part in ("DEFAULTS", "HOME", "HOME_POSE")]
    renamed = [f"#define {symbol} {symbol}_in_single" for symbol in public]
    code = f'#include "{name}.c"\n'
    units = {"double.c": code, "single.c": "\n".join([f"#define {name.upper()}_REAL float", *renamed, code])}
    # without optimisation, and zig's checks that come with that, forces have the same bits, in half the compiler's time
    flags = [*(flag for flag in FLAGS if flag not in ("-fvisibility=hidden", "-O3")), "-O0", "-fno-sanitize=undefined"]
    library = compile_library("controller", units, {**sources.units, **sources.headers}, native(), flags=flags)
    at_home = _at_home(designed.measured, home), np.concatenate([home.pose, np.zeros(12)])
    with tempfile.TemporaryDirectory(prefix="gough-stewart-", ignore_cleanup_errors=True) as folder:
        path = Path(folder, f"controller{native().suffix}")
        path.write_bytes(library)
        loaded, of_both = ctypes.CDLL(str(path)), list[FloatArray]()
        kinds: tuple[tuple[str, Any, int], ...] = ("", ctypes.c_double, 0), ("_in_single", ctypes.c_float, 1)
        for ending, kind, is_relative in kinds:
            prepare_it, start_it, step_it = (getattr(loaded, f"{function}{ending}") for function in public[:3])
            parameters = ctypes.byref(ctypes.c_char.in_dll(loaded, f"{public[3]}{ending}"))
            coefficients, memory = (ctypes.create_string_buffer(_ROOM) for _ in range(2))
            prepare_it(parameters, coefficients)
            start_it(parameters, memory)
            force, limited, forces = (kind * 6)(), (ctypes.c_ubyte * 6)(), np.empty((len(rows[0]), 6))
            values = [of - is_relative * zero for of, zero in zip(rows, at_home, strict=False)]
            for k, _ in enumerate(forces):
                inputs = [(kind * max(1, of.shape[1]))(*of[k].tolist()) for of in values]
                for _ in range(designed.carried.steps_a_sample):
                    step_it(parameters, coefficients, memory, *inputs, force, limited)
                forces[k] = force[:]
            of_both.append(forces)
    return of_both
