"""The C source of a controller: NAME.c, NAME.h, and an example program."""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from textwrap import fill

import casadi
import numpy as np

from gough_stewart.fmu_build.codegen import Types, function_source
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.export import table_source
from gough_stewart.harness.export.designed import Designed
from gough_stewart.harness.export.forms import Real
from gough_stewart.harness.export.laws import FunctionLaw
from gough_stewart.harness.export.operations import operations_of, words_of
from gough_stewart.harness.export.path_source import path_deviation, path_of, path_source
from gough_stewart.harness.export.ranges import Range, words_of_ranges
from gough_stewart.harness.export.relative import Home, home_of
from gough_stewart.harness.export.settings import Setting
from gough_stewart.harness.export.single import function_of_time, halves, pairs_source, with_floats
from gough_stewart.harness.export.texts import EXAMPLE, HEADER, SOURCE, comment, filled, number, numbers
from gough_stewart.harness.export.trace import Traced, traced
from gough_stewart.harness.motion.motion import Piecewise
from gough_stewart.model import interface
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import Variable
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray

_IDENTIFIER = re.compile(r"[a-z][a-z0-9_]{0,40}")


@dataclass(frozen=True)
class ControllerSources:
    """A controller as C11."""

    units: dict[str, str]  # source files to compile: text by file name
    headers: dict[str, str]
    example: str  # a program that runs it
    operations: int  # floating-point operations per step, at most
    n_states: int  # of the law


def controller_sources(
    designed: Designed, prefix: str = "controller", real: Real = "double", deviation: str = ""
) -> ControllerSources:
    """The sources of a designed controller; a pure function.

    Parameters
    ----------
    prefix
        Of all public names, also the name of the files: lower-case letters, digits and underscores.
    real
        "float": everything in single precision, relative to home. With "double", a macro chooses the type of the forces
        and of the feedforward.
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
    home = home_of(designed.platform) if real == "float" else None
    functions = traced(designed, home)
    counts = operations_of(functions)
    facts = _facts(designed, functions, prefix, home)
    facts |= {
        "WORK": words_of(counts),
        "DEVIATION": fill(deviation, 118, initial_indent="   ", subsequent_indent="   "),
        "deviates": bool(deviation),
    }
    source, header = filled(SOURCE, facts), filled(HEADER, facts)
    if home is not None:
        source, header = with_floats(source), with_floats(header)
    return ControllerSources(
        {f"{prefix}.c": source},
        {f"{prefix}.h": header},
        filled(EXAMPLE, facts),
        sum(counts.values()),
        _n_states(functions),
    )


def _n_states(functions: Traced) -> int:
    law = functions.law
    return 0 if law is None or "next" not in law.name_out() else int(law.numel_out("next"))


def _facts(designed: Designed, functions: Traced, prefix: str, home: Home | None) -> dict[str, str | bool]:
    """The values of the templates' placeholders, and which optional parts they include."""
    law, n_states = functions.law, _n_states(functions)
    n_coefficients = 0 if functions.coefficients is None else int(functions.coefficients.numel_out(0))
    settings = designed.settings
    call = partial(_call, settings=settings)
    at_time = any(_uses(each, "motion") for each in (law, functions.start, functions.expected))
    uses_excess = _uses(law, "excess")
    is_table = isinstance(designed.reference, Piecewise)
    forward = functions.feedforward is not None
    is_moving = forward or at_time
    inside = designed.reference is not None
    # a motion at rest does not depend on time
    is_timed = functions.motion is not None and functions.motion.n_in() > 0
    has_constant = any(s.variable.name == "constant_force" for s in settings)
    safe, parts = designed.faults.safe_force, designed.carried
    written = "".join(_functions(designed, functions, prefix, home))
    is_table = is_table and is_moving
    path = path_of(designed.reference) if is_table else None
    table = _table(designed.reference, functions, home) if is_table else ""  # type: ignore[arg-type]
    uses_time = _uses(law, "time") or (is_timed and is_moving)
    by_value = is_table or home is not None
    facts: dict[str, str | bool] = {
        "CONSTANTS": f"{constant_bytes(designed, table, 8 if home is None else 4)} bytes, besides those in the code",
        "P": prefix.upper(),
        "REFERENCE": "reference, " if designed.reference_inputs else "",
        "p": prefix,
        "TITLE": " ".join(designed.title.replace("*/", "").replace("/*", "").split()),
        "NOTES": comment(designed.notes),
        "LAW": "no feedback" if designed.law is None else designed.law.name,
        "FEEDFORWARD": designed.feedforward.replace("_", " "),
        "N_MEASURED": str(interface.size_of(designed.measured)),
        "N_REFERENCE": "18" if designed.reference_inputs else "0",
        "N_STATES": str(n_states),
        "N_COEFFICIENTS": str(n_coefficients),
        "MEASURED": ", ".join(f"{v.name}[{v.size}] [{v.unit}]" for v in designed.measured) or "nothing",
        "FIELDS": "\n".join(map(partial(_field, prefix=prefix), settings)),
        "DEFAULTS": "\n".join(map(partial(_default, prefix=prefix), settings)),
        "LARGEST": number(LARGEST_NUMBER),
        **_inputs(designed, home),
        **_relative_to(designed, home, prefix.upper()),
        "CHECKS": "\n".join(map(partial(_check, prefix=prefix), settings, range(1, len(settings) + 1))),
        "SAMPLE_TIME": number(designed.sample_time),
        "FUNCTIONS": written,
        "TABLE": table,
        "CALL_COEFFICIENTS": call(functions.coefficients, {"law": "coefficients->law"}),
        "CALL_MOTION": _call_motion(functions.motion, "time" if home is None else "at", "now", whole=by_value),
        "CALL_AHEAD": _call_motion(functions.motion, "later", "ahead", whole=by_value),
        "CALL_EXTRAPOLATED": "extrapolated(reference, &coefficients->ahead, ahead);",
        "CALL_START": call(functions.start, {"states_at_rest": "states", "states": "memory->states"}),
        "CALL_EXPECTED": call(functions.expected, {}),
        **_steps(designed, functions, call),
        "CALL_LAW": call(law, {"force": "command", "next": "next"}),
        "CALL_FEEDFORWARD": call(functions.feedforward, {"force": "known", "motion": "ahead"}),
    }
    conditions = {
        "law": law is not None,
        "measures": bool(designed.measured),
        "uses_measured": _uses(law, "measured"),
        "uses_time": uses_time,
        "law_uses_time": _uses(law, "time"),
        "single": home is not None,
        "pairs": home is not None and uses_time,
        "states": n_states > 0,
        "start": functions.start is not None,
        "coefficients": n_coefficients > 0,
        "notes": bool(designed.notes),
        "inputs": designed.reference_inputs,
        "inside_now": inside and at_time,
        "inputs_now": designed.reference_inputs and at_time,
        "feedforward": forward,
        "timed_ahead": is_timed and forward,
        "known_ahead": inside and forward and not is_timed,
        "inside_ahead": inside and forward,
        "inputs_ahead": designed.reference_inputs and forward,
        "constant": has_constant,
        "excess": uses_excess,
        "path": path is not None,
        "drives": functions.drives is not None,
        "sensors": functions.sensors is not None,
        "steps": parts.has_steps,
        "reads_at_steps": functions.sensors is not None and parts.steps_a_reading is not None,
        "reads_at_samples": functions.sensors is not None and parts.steps_a_reading is None,
        "table": is_table,
        "fixed_sample_time": any("DEFAULT_SAMPLE_TIME" in c for s in settings for c in s.conditions),
        "sees": designed.zeros_are_no_measurement,
        "checked": bool(designed.measured) or designed.reference_inputs,
        "watches": bool(designed.watched),
        "zero_is_no_reference": designed.reference_inputs and not zero_is_a_reference(designed),
        "safe_is_known": safe == "feedforward" and (forward or has_constant),
        "safe_is_start": safe == "feedforward" and not (forward or has_constant),
        "uses_coefficients": _uses(law, "coefficients") or (forward and (is_timed or designed.reference_inputs)),
        "sign": "sign(" in written,
    }
    facts |= conditions
    if path is not None:
        text = path_deviation(designed.platform, designed.reference, path)  # type: ignore[arg-type]
        facts["PATH_DEVIATION"] = fill(text, 118, initial_indent="   ", subsequent_indent="   ")
    if facts["pairs"]:
        facts["PAIRS"] = pairs_source(filled(SOURCE, {**facts, "PAIRS": ""}))
    return facts


def _steps(designed: Designed, functions: Traced, call: Callable[..., str]) -> dict[str, str]:
    """What is done at a sample or a step beside the law: limits, and what is carried of the machine."""
    parts, n = designed.carried, designed.carried.steps_a_sample
    limits, drives, sensors = functions.limits, functions.drives, functions.sensors
    at_steps = sensors is not None and parts.steps_a_reading is not None
    reading = parts.steps_a_reading or n
    facts = {
        "WHEN": "At each step:  " if parts.has_steps else "At each sample:",
        "SAMPLE_OR_STEP": "step" if parts.has_steps else "sample",
        "PERIOD": f"step of sample_time / {n}" if parts.has_steps and n > 1 else "sample_time",
        "PER_SAMPLE": f" / {n}" if n > 1 else "",
        "WORK_IS": "in one with a sample" if n > 1 else "constant",
        "STEP": f"{designed.step:g}",
        "STEPS_IN_WORDS": f"every {_ordinal(n)} takes a sample"
        + (f", every {_ordinal(reading)} a reading" if at_steps else ""),
        "STEPS_A_SAMPLE": str(n),
        "STEPS_A_READING": str(reading),
        "READING": "memory->reading" if at_steps else "measured",
        "CALL_COEFFICIENTS_OF_LIMITS": call(limits.coefficients, {"force_limits": "coefficients->force_limits"}),
        "CALL_LIMITS": call(
            limits.step,
            {
                **_of_component("force_limits", "memory->planned", "planned"),
                **{"command": "command", "allowed": "allowed", "force_limited": "cut", "excess": "excess"},
            },
        ),
        "N_LIMITS": str(limits.coefficients.numel_out(0)),
    }
    if drives is not None:
        facts |= {
            "CALL_COEFFICIENTS_OF_DRIVES": call(drives.coefficients, {"drives": "coefficients->drives"}),
            "CALL_DRIVES": call(
                drives.step,
                {
                    **_of_component("drives", "memory->drives", "next"),
                    **{"target": "memory->target", "actuator_force": "mean", "rate_limited": "memory->rate_limited"},
                },
            ),
            "N_DRIVES": str(drives.coefficients.numel_out(0)),
        }
    if sensors is not None:
        place = "memory->reading" if at_steps else "reading"
        facts |= {
            "CALL_COEFFICIENTS_OF_SENSORS": call(sensors.coefficients, {"sensors": "coefficients->sensors"}),
            "CALL_SENSORS": call(
                sensors.step, {**_of_component("sensors", "", ""), "true": "measured", "reading": place}
            ),
            "N_SENSORS": str(sensors.coefficients.numel_out(0)),
        }
    return facts


def _of_component(name: str, states: str, following: str) -> dict[str, str]:
    """The places of a component's vectors."""
    return {f"{name}_coefficients": f"coefficients->{name}", f"{name}_states": states, f"{name}_next": following}


def _ordinal(n: int) -> str:
    """In words for a comment: `step`, `3rd step`."""
    ending = {1: "st", 2: "nd", 3: "rd"}.get(n % 10 if n % 100 not in (11, 12, 13) else 0, "th")
    return "step" if n == 1 else f"{n}{ending} step"


def _uses(function: casadi.Function | None, name: str) -> bool:
    return function is not None and name in function.name_in()


def _functions(designed: Designed, functions: Traced, prefix: str, home: Home | None) -> list[str]:
    """The functions generated by CasADi, in the order of their use."""
    real = f"{prefix}_real"
    of_settings = {s.variable.name: real for s in designed.settings if s.is_real}
    doubles = Types("double", of_settings)
    of_platform = dict.fromkeys(("motion", *(v.name for v in interface.PLATFORM_PARAMETERS)), "double")
    parts = [
        (functions.coefficients, doubles),
        (functions.motion, doubles),
        (functions.extrapolated, doubles),
        (functions.feedforward, Types(real, of_platform, "REAL({})" if home is None else "{}")),
        (functions.start, doubles),
        (functions.expected, doubles),
        (functions.law, doubles),
        *((each, doubles) for component in functions.components for each in component[:2]),
    ]
    if functions.feedforward is None and not any(
        _uses(each, "motion") for each in (functions.law, functions.start, functions.expected)
    ):
        parts[1] = (None, doubles)
    if home is not None and functions.motion is not None and parts[1][0] is not None and _is_of_time(functions.motion):
        parts[1] = (None, doubles)
        of_time = [function_of_time(functions.motion)]
    else:
        of_time = []
    written = [function_source(f, "static void ", types, conditions=True) for f, types in parts if f is not None]
    return [*of_time, *written]


def _is_of_time(motion: casadi.Function) -> bool:
    """Whether it is a formula of time; otherwise it is at rest, or of a table."""
    return bool(motion.n_in() == 1 and motion.name_in(0) == "time")


def _table(reference: Piecewise, functions: Traced, home: Home | None) -> str:
    """The numbers of a motion that is not a formula, and `table_at`."""
    path = path_of(reference)
    if path is None or functions.path is None:
        return table_source.table_of(reference, home)
    function = function_source(functions.path, "static void ", conditions=True)
    return f"{function}\n{path_source(reference, path, home)}"


def constant_bytes(designed: Designed, table: str, size: int) -> int:
    """Bytes of constant data: designed values of the parameters, ranges, home where it is subtracted, tables."""
    parameters = sum(s.variable.size for s in designed.settings)
    ranges = (2 if size == 8 else 3) * interface.size_of((*designed.measured, *designed.reference_variables))
    return size * (parameters + ranges) + table_source.array_bytes(table, size)


def zero_is_a_reference(designed: Designed) -> bool:
    """Whether a reference of zeros can be one: a pose in which the legs are in their range."""
    legs = leg_geometry(designed.platform, np.zeros(3), np.zeros(3)).length
    low, high = designed.ranges.leg_length
    return bool(((legs >= low) & (legs <= high)).all())


def _relative_to(designed: Designed, home: Home | None, of: str) -> dict[str, str]:
    """What inputs are relative to, and their first values."""
    if home is None:
        return {
            "V": "double",
            "RELATIVE": "",
            "ZERO": "exactly 0",
            "ZERO_MEASURED": f"is_zero(measured, {of}_N_MEASURED)",
            "ZERO_REFERENCE": f"is_zero(reference, {of}_N_REFERENCE)",
            "FIRST_MEASURED": numbers(designed.first_measured),
            "FIRST_REFERENCE": numbers(designed.first_reference),
        }
    of_measured = _at_home(designed.measured, home)
    high, low = halves(designed.sample_time)
    return {
        "V": "float",
        "RELATIVE": ", relative to home",
        "ZERO": "those of a bus of zeros, less those at home",
        "ZERO_MEASURED": f"is_zero(measured, {of}_HOME, {of}_N_MEASURED)",
        "ZERO_REFERENCE": f"is_zero(reference, {of}_HOME_POSE, 6)",
        "FIRST_MEASURED": numbers(designed.first_measured - of_measured),
        "FIRST_REFERENCE": numbers(designed.first_reference - np.concatenate([home.pose, np.zeros(12)])),
        "HOME": numbers(of_measured),
        "HOME_POSE": numbers(home.pose),
        "SAMPLE_TIME_HIGH": number(high),
        "SAMPLE_TIME_LOW": number(low),
    }


def _at_home(variables: Iterable[Variable], home: Home) -> FloatArray:
    """The values at home of several signals, one after the other."""
    return np.concatenate([np.zeros(0), *(home.of(v.name, v.size) for v in variables)])


def _inputs(designed: Designed, home: Home | None) -> dict[str, str]:
    """What is done about inputs that cannot be, in C and in words."""
    measured, reference = designed.measured, designed.reference_variables
    of_measured, of_reference = (designed.ranges.joined(each) for each in (measured, reference))
    if home is not None:
        of_measured, of_reference = (
            Range(*(values - _at_home(variables, home) for values in of))
            for of, variables in ((of_measured, measured), (of_reference, reference))
        )
    ends = np.cumsum([0, *(v.size for v in measured)]).tolist()
    watched = [
        k for v, at in zip(measured, ends, strict=False) if v in designed.watched for k in range(at, at + v.size)
    ]
    frozen = designed.faults.frozen
    facts = {
        "MEASURED_LOW": numbers(of_measured.low),
        "MEASURED_HIGH": numbers(of_measured.high),
        "REFERENCE_LOW": numbers(of_reference.low),
        "REFERENCE_HIGH": numbers(of_reference.high),
        "RANGES": words_of_ranges(measured, designed.ranges)
        + (f"; of the reference: {words_of_ranges(reference, designed.ranges)}" if reference else ""),
        "SAFE": _safe_force_in_words(designed),
        "IF_FUNCTION": ", or with its memory" if isinstance(designed.law, FunctionLaw) else "",
        "N_WATCHED": str(len(watched)),
        "WATCHED": ", ".join(map(str, watched)),
        "FROZEN": "not used: frozen measurements are not watched for",
    }
    if frozen is not None:
        facts |= {
            "FROZEN_SAMPLES": str(frozen.samples),
            "FROZEN_MOVEMENT": number(frozen.movement),
            "FROZEN": f"a measurement is the same for {frozen.samples} samples while its reference moves by more than "
            f"{frozen.movement:g} m",
        }
    return facts


def _safe_force_in_words(designed: Designed) -> str:
    if designed.faults.safe_force == "zero":
        return "0"
    if designed.feedforward == "none" and not designed.constant_force.any():
        return "`start_force`, since there is no feedforward"
    if designed.reference_inputs:
        return "the feedforward, of the last good reference if that is the fault"
    return "the feedforward"


_PLACES = {
    "time": "&time",
    "motion": "now",
    "measured": "measured",
    "excess": "memory->excess",
    "feedforward": "safe",
    "states": "states",
    "expected": "expected",
    "coefficients": "coefficients->law",
}


def _call(function: casadi.Function | None, places: dict[str, str], settings: Iterable[Setting]) -> str:
    """A call with its arguments, named as in the step function."""
    if function is None:
        return ""
    known = _PLACES | {
        s.variable.name: f"{'' if s.variable.shape else '&'}parameters->{s.variable.name}" for s in settings
    }
    known |= places
    arguments = [known[name] for name in (*function.name_in(), *function.name_out())]
    return f"{function.name()}({', '.join(arguments)});"


def _call_motion(function: casadi.Function | None, time: str, motion: str, *, whole: bool) -> str:
    if function is None:
        return ""
    if whole and function.n_in():  # motion() in step.c, around the traced function; or of a pair
        return f"motion({time}, {motion});"
    return f"motion({f'&{time}, ' if function.n_in() else ''}{motion});"


def _field(each: Setting, prefix: str) -> str:
    v = each.variable
    kind = f"{prefix}_real" if each.is_real else "double"
    size = f"[{v.size}]" if v.shape else ""
    unit = f"[{v.unit}] " if v.unit else ""
    none = "; 0: none" if each.may_be_infinite else ""
    return f"    {kind} {v.name}{size}; /* {unit}{v.description}{none} */"


def _default(each: Setting, prefix: str) -> str:
    """In its place, since C++ has no designators before C++20; with a cast, since numbers in C are double."""
    cast = f"({prefix}_real)" if each.is_real else ""
    finite = np.where(np.isinf(each.value), 0.0, each.value) if each.may_be_infinite else each.value
    values = [cast + number(value) for value in finite.reshape(-1).tolist()]
    text = "{" + ", ".join(values) + "}" if each.variable.shape else values[0]
    return f"    {text}, /* {each.variable.name} */"


def _check(each: Setting, place: int, prefix: str) -> str:
    """Checks of a parameter; if one fails, the generated code returns its number."""
    v = each.variable
    cast = f"({prefix}_real)" if each.is_real else ""
    largest = f"{cast}{'LARGEST' if each.largest == LARGEST_NUMBER else number(each.largest)}"
    above = {"> 0": "{0} > 0", ">= 0": "{0} >= 0", None: f"{{0}} >= -{largest}"}[v.lower_bound]
    below = "" if each.may_be_infinite else f" && {{0}} <= {largest}"
    element = f"parameters->{v.name}" + ("[k]" if v.shape else "")
    test = f"if (!({(above + below).format(element)})) return {place};"
    lines = [f"    for (k = 0; k < {v.size}; ++k) {test}" if v.shape else f"    {test}"]
    lines += [f"    if (!({condition})) return {place};" for condition in each.conditions]
    return "\n".join(lines)
