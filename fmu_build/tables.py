"""The tables of the C core: `model.h` and `model.c`, which any component has, and the plant's own `plant_table.h`."""

import hashlib
from collections.abc import Iterable, Mapping
from textwrap import fill

from gough_stewart.fmu_build import layout
from gough_stewart.fmu_build.layout import BY_NAME, ROWS, Role, Row
from gough_stewart.model import integrator, interface, kernel, platform, platform_checks, pose_limits
from gough_stewart.model.interface import Variable
from gough_stewart.model.platform import Platform
from gough_stewart.model.tolerance import DEFAULT_TOLERANCE, TOLERANCES

# A second in steps of a microsecond: four seconds of computing.
MOST_FIXED_STEPS = 1_000_000


_GENERATED = "/* Generated from the interface table, gough_stewart.model.interface: do not edit. */"


def layout_number() -> int:
    """64 bits that change when a saved state would mean something else."""
    text = ";".join(f"{r.variable.name}:{r.variable.shape}:{r.role.name}" for r in ROWS)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def model_header() -> str:
    """`model.h`."""
    sizes = {
        "N_INPUTS": kernel.N_INPUTS,
        "N_STATES": kernel.N_STATES,
        "N_OUTPUTS": interface.size_of(interface.OUTPUTS),
        "N_RESULTS": kernel.N_RESULTS,
        "N_PARAMETERS": kernel.N_PARAMETERS,
        "N_SLOTS": layout.N_SLOTS,
        "N_VARIABLES": len(ROWS),
    }
    slots = {
        "FIRST_INPUT": _first(interface.INPUTS),
        "FIRST_STATE": _first(interface.STATES),
        "FIRST_RESULT": _first(interface.RESULTS),
        "FIRST_PARAMETER": _first(interface.PLATFORM_PARAMETERS),
        "FIRST_DERIVATIVE": layout.of_role(Role.DERIVATIVE)[0].first,
        "TIME": layout.TIME.first,
    }
    return f"""{_GENERATED}
#ifndef MODEL_H
#define MODEL_H

#include <stdint.h>

#include "internal.h"
#include "variable.h"

{_defines(sizes)}

/* slots: inputs, results (states first), parameters, others, derivatives, time */
{_defines(slots)}

/* of an experiment that names none; what a value may be at most */
#define DEFAULT_TOLERANCE {DEFAULT_TOLERANCE!r}
#define LARGEST_NUMBER {platform.LARGEST_NUMBER!r}

INTERNAL_BEGIN
extern const variable VARIABLES[N_VARIABLES];
extern const unsigned char VARIABLE_OF_SLOT[N_SLOTS];
extern const double START_INPUTS[N_INPUTS];
extern const double START_STATES[N_STATES];
extern const double START_PARAMETERS[N_PARAMETERS];
extern const double START_FIXED_STEP_SIZE;
extern const double NOMINAL_STATES[N_STATES];
/* what modelDescription.xml and binary have in common (token.c) */
extern const char *const TOKEN;
/* of the variables that a saved state holds */
extern const uint64_t LAYOUT;
INTERNAL_END

#endif
"""


def plant_header() -> str:
    """`plant_table.h`: where the plant's variables lie in the kernel's vectors, and what limits it."""
    results, parameters = interface.RESULTS, interface.PLATFORM_PARAMETERS
    places = {f"X_{v.name.upper()}": _place(v, interface.STATES) for v in interface.STATES}
    places["X_PITCH"] = places["X_ORIENTATION"] + 1
    places |= {f"R_{v.name.upper()}": _place(v, results) for v in results if not v.is_state}
    places |= {f"P_{v.name.upper()}": _place(v, parameters) for v in parameters}
    limits = {
        "SMALLEST_TOLERANCE": TOLERANCES[0],
        "LARGEST_TOLERANCE": TOLERANCES[1],
        "MOST_INTERNAL_STEPS": integrator.MOST_INTERNAL_STEPS,
        "MOST_FIXED_STEPS": MOST_FIXED_STEPS,
        "LARGEST_PITCH": pose_limits.LARGEST_PITCH,
        "SHORTEST_LEG": pose_limits.SHORTEST_LEG,
        "SINGULAR_CONDITION_NUMBER": pose_limits.SINGULAR_CONDITION_NUMBER,
        "INERTIA_SLACK": platform_checks.INERTIA_SLACK,
        "COINCIDENCE": platform_checks.COINCIDENCE,
    }
    return f"""{_GENERATED}
#ifndef PLANT_TABLE_H
#define PLANT_TABLE_H

#define N_LEGS {interface.BY_NAME["leg_length"].size}
#define FIXED_STEP_SIZE {BY_NAME["fixed_step_size"].first} /* its slot */

/* places in the vectors of states, results and parameters */
{_defines(places)}

/* as in gough_stewart.model: lengths in m, angles in rad, the shortest leg relative to the size of the platform */
{_defines(limits)}

#endif
"""


def token_source(token: str) -> str:
    """`token.c`."""
    return f'''/* Generated; modelDescription.xml has the same. */
#include "model.h"

const char *const TOKEN = "{token}";
'''


def model_source(chosen: Platform) -> str:
    """`model.c` with the start values of a platform."""
    rows = "\n".join(f"    {_row(row)}," for row in ROWS)

    def starts(*variables: Variable) -> str:
        return _numbers(interface.pack(variables, interface.start_values(variables, chosen)))

    return f"""{_GENERATED}
#include "model.h"

const variable VARIABLES[N_VARIABLES] = {{
{rows}
}};

const unsigned char VARIABLE_OF_SLOT[N_SLOTS] = {{
{_lines(str(row.reference) for row in ROWS for _ in range(row.variable.size))}
}};

const double START_INPUTS[N_INPUTS] = {{
{starts(*interface.INPUTS)}
}};

const double START_STATES[N_STATES] = {{
{starts(*interface.STATES)}
}};

const double START_PARAMETERS[N_PARAMETERS] = {{
{starts(*interface.PLATFORM_PARAMETERS)}
}};

const double START_FIXED_STEP_SIZE = {starts(interface.BY_NAME["fixed_step_size"]).strip(" ,")};

const double NOMINAL_STATES[N_STATES] = {{
{_numbers([layout.NOMINAL] * kernel.N_STATES)}
}};

const uint64_t LAYOUT = UINT64_C({layout_number():#x});
"""


def _first(variables: tuple[Variable, ...]) -> int:
    """Slot of the first of them."""
    return BY_NAME[variables[0].name].first


def _place(variable: Variable, variables: tuple[Variable, ...]) -> int:
    """Where it begins in the vector of these variables."""
    return BY_NAME[variable.name].first - _first(variables)


_RANGES = {None: "ANY", ">= 0": "NOT_NEGATIVE", "> 0": "POSITIVE"}


def _row(row: Row) -> str:
    v = row.variable
    columns = v.shape[1] if len(v.shape) == 2 else 0
    bound = _RANGES[v.lower_bound]
    return f'{{"{v.name}", "{v.unit}", {row.first}, {v.size}, {columns}, {row.role.value}, {bound}}}'


def _defines(values: Mapping[str, float]) -> str:
    return "\n".join(f"#define {name} {value!r}" for name, value in values.items())


def _numbers(values: Iterable[float]) -> str:
    return "\n".join(f"    {float(v)!r}," for v in values)


def _lines(words: Iterable[str]) -> str:
    return fill(", ".join(words), 100, initial_indent="    ", subsequent_indent="    ")
