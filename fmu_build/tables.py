"""The C tables that every component has: `model.h`, `model.c`, `token.c`."""

import hashlib
from collections.abc import Iterable, Mapping
from textwrap import fill

from gough_stewart.fmu_build.component import CLOCK_REFERENCE, SCALAR_REFERENCE, Component
from gough_stewart.fmu_build.layout import PARAMETER_ROLES, Role, Row
from gough_stewart.model import interface, platform
from gough_stewart.model.step_times import DEFAULT_TOLERANCE

GENERATED = "/* Generated from the table of variables: do not edit. */"


def layout_number(component: Component) -> int:
    """64 bits that change when the meaning of saved states changes."""
    text = ";".join(f"{r.variable.name}:{r.variable.shape}:{r.role.name}" for r in component.layout.rows)
    return int.from_bytes(hashlib.sha256((text + component.saved_form).encode()).digest()[:8], "little")


def model_header(component: Component) -> str:
    """`model.h`."""
    layout = component.layout
    tolerance = float(component.experiment.get("tolerance", DEFAULT_TOLERANCE))
    sizes = {
        "N_INPUTS": _size(layout.of_role(Role.INPUT)),
        "N_STATES": _size(layout.of_role(Role.STATE)),
        "N_OUTPUTS": _size(row for row in layout.outputs() if row in layout.in_order),
        "N_RESULTS": _size(row for row in layout.of_role(Role.STATE, Role.RESULT) if row in layout.in_order),
        "N_PARAMETERS": _size(_parameters(component)),
        "N_SLOTS": layout.n_slots,
        "N_VARIABLES": len(layout.rows),
        "HAS_CLOCK": int(component.clock is not None),
        "CLOCK_REFERENCE": CLOCK_REFERENCE,
        "SCALAR_REFERENCE": SCALAR_REFERENCE,
    }
    first_result = sizes["N_INPUTS"]
    slots = {
        "FIRST_INPUT": 0,
        "FIRST_STATE": first_result,
        "FIRST_RESULT": first_result,
        "FIRST_PARAMETER": first_result + sizes["N_RESULTS"],
        "FIRST_DERIVATIVE": layout.time.first - sizes["N_STATES"],
        "TIME": layout.time.first,
    }
    return f"""{GENERATED}
#ifndef MODEL_H
#define MODEL_H

#include <stdint.h>

#include "internal.h"
#include "variable.h"

{defines(sizes)}

/* slots: inputs, results (states first), parameters, others, derivatives, time, what was added later */
{defines(slots)}

/* tolerance of an experiment without one; largest value that is accepted */
#define DEFAULT_TOLERANCE {tolerance!r}
#define LARGEST_NUMBER {platform.LARGEST_NUMBER!r}

INTERNAL_BEGIN
extern const variable VARIABLES[N_VARIABLES];
extern const unsigned char VARIABLE_OF_SLOT[N_SLOTS];
/* a single 0 if there are none */
extern const double START_INPUTS[];
extern const double START_STATES[];
extern const double START_PARAMETERS[];
extern const double NOMINAL_STATES[];
/* the same as in modelDescription.xml (token.c) */
extern const char *const TOKEN;
/* identifies the layout of saved states */
extern const uint64_t LAYOUT;
INTERNAL_END

#endif
"""


def token_source(token: str) -> str:
    """`token.c`."""
    return f'''/* Generated: the same token as in modelDescription.xml. */
#include "model.h"

const char *const TOKEN = "{token}";
'''


def model_source(component: Component) -> str:
    """`model.c` with the component's start values."""
    layout = component.layout
    rows = "\n".join(f"    {_row(row)}," for row in layout.rows)
    states = layout.of_role(Role.STATE)
    return f"""{GENERATED}
#include "model.h"

const variable VARIABLES[N_VARIABLES] = {{
{rows}
}};

const unsigned char VARIABLE_OF_SLOT[N_SLOTS] = {{
{_lines(str(row.reference) for row in layout.rows for _ in row.slots)}
}};

const double START_INPUTS[] = {{
{_starts(component, layout.of_role(Role.INPUT))}
}};

const double START_STATES[] = {{
{_starts(component, states)}
}};

const double START_PARAMETERS[] = {{
{_starts(component, _parameters(component))}
}};

const double NOMINAL_STATES[] = {{
{_numbers([component.nominal] * _size(states))}
}};

const uint64_t LAYOUT = UINT64_C({layout_number(component):#x});
"""


def places(prefix: str, rows: Iterable[Row]) -> dict[str, int]:
    """Offsets of variables in a vector of their own, by the names of their macros."""
    found, at = {}, 0
    for row in rows:
        found[f"{prefix}_{row.variable.name.upper()}"] = at
        at += row.variable.size
    return found


def defines(values: Mapping[str, float]) -> str:
    """Macros, one per line."""
    return "\n".join(f"#define {name} {value!r}" for name, value in values.items())


def _parameters(component: Component) -> tuple[Row, ...]:
    """The parameters without those of the unit itself."""
    return tuple(r for r in component.layout.of_role(*PARAMETER_ROLES) if r.variable.name not in component.settings)


def _size(rows: Iterable[Row]) -> int:
    return interface.size_of(row.variable for row in rows)


_RANGES = {None: "ANY", ">= 0": "NOT_NEGATIVE", "> 0": "POSITIVE"}


def _row(row: Row) -> str:
    v = row.variable
    columns = v.shape[1] if len(v.shape) == 2 else 0
    bound = _RANGES[v.lower_bound]
    return f'{{"{v.name}", "{v.unit}", {row.first}, {v.size}, {columns}, {row.role.value}, {bound}}}'


def _starts(component: Component, rows: Iterable[Row]) -> str:
    return _numbers(number for row in rows for number in component.starts[row.variable.name].flat)


def _numbers(values: Iterable[float]) -> str:
    """Array elements, at least one, since C has no empty arrays."""
    return "\n".join(f"    {float(v)!r}," for v in values) or "    0"


def _lines(words: Iterable[str]) -> str:
    return fill(", ".join(words), 100, initial_indent="    ", subsequent_indent="    ")
