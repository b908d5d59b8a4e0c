"""The C tables that every component has: `model.h`, `model.c`, `start.c`."""

import hashlib
import struct
from collections.abc import Iterable, Mapping
from textwrap import fill

from gough_stewart.fmu_build.component import SCALAR_REFERENCE, Component
from gough_stewart.fmu_build.layout import PARAMETER_ROLES, Role, Row
from gough_stewart.model import interface, platform
from gough_stewart.model.step_times import DEFAULT_TOLERANCE

# Begins the block of start values in a library.
_MARK = "gough-stewart: start"
_MARK_SIZE, _TOKEN_SIZE = 24, 40

GENERATED = "/* Generated from the table of variables: do not edit. */"


def layout_number(component: Component) -> int:
    """64 bits that change when the meaning of saved states changes."""
    text = ";".join(f"{r.variable.name}:{r.variable.shape}:{r.role.name}" for r in component.layout.rows)
    return int.from_bytes(hashlib.sha256((text + component.saved_form).encode()).digest()[:8], "little")


def model_header(component: Component) -> str:
    """`model.h`."""
    layout = component.layout
    sizes = {
        "N_INPUTS": _size(layout.of_role(Role.INPUT)),
        "N_STATES": _size(layout.of_role(Role.STATE)),
        "N_OUTPUTS": _size(row for row in layout.outputs() if row in layout.in_order),
        "N_RESULTS": _size(row for row in layout.of_role(Role.STATE, Role.RESULT) if row in layout.in_order),
        "N_PARAMETERS": _size(_parameters(component)),
        "N_SLOTS": layout.n_slots,
        "N_VARIABLES": len(layout.rows),
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

/* largest value that is accepted */
#define LARGEST_NUMBER {platform.LARGEST_NUMBER!r}

/* What differs between units of the same code: one block of the library (start.c), into which a build writes it. A
   vector without elements has a single 0. */
typedef struct {{
    char mark[{_MARK_SIZE}];
    char tokens[2][{_TOKEN_SIZE}]; /* of FMI 2.0 and 3.0, as in modelDescription.xml; empty for the other version */
{_members(component)}
}} start_block;

/* the tolerance is of an experiment without one */
{defines_of_start(component)}

INTERNAL_BEGIN
extern const start_block START;
extern const variable VARIABLES[N_VARIABLES];
extern const unsigned char VARIABLE_OF_SLOT[N_SLOTS];
/* a single 0 if there are none */
extern const double NOMINAL_STATES[];
/* identifies the layout of saved states */
extern const uint64_t LAYOUT;
INTERNAL_END

#endif
"""


def start_source(component: Component, tokens: tuple[str, str] | None) -> str:
    """`start.c` with the component's start values and the tokens of FMI 2.0 and 3.0; None for a block of zeros."""
    numbers = _start_numbers(component)
    if tokens is None:
        tokens, numbers = ("", ""), {name: [0.0] * len(values) for name, values in numbers.items()}
    rows = "\n".join(f"    {{\n{_indented(values)}\n    }}," for values in numbers.values())
    return f"""{GENERATED}
#include "model.h"

const start_block START = {{
    "{_MARK}",
    {{"{tokens[0]}", "{tokens[1]}"}},
{rows}
}};
"""


def start_block(component: Component, tokens: tuple[str, str] | None) -> bytes:
    """The bytes of the block of `start_source` in a library of any target."""
    numbers = [number for values in _start_numbers(component).values() for number in values]
    if tokens is None:
        tokens, numbers = ("", ""), [0.0] * len(numbers)
    form = f"<{_MARK_SIZE}s{_TOKEN_SIZE}s{_TOKEN_SIZE}s{len(numbers)}d"
    return struct.pack(form, _MARK.encode(), *(token.encode() for token in tokens), *numbers)


def defines_of_start(component: Component) -> str:
    """Macros of the vectors of the block, and of its single numbers."""
    names = {"DEFAULT_TOLERANCE": "START.tolerance[0]"}
    names |= {f"START_{name.upper()}": f"START.{name}" for name in ("inputs", "states", "parameters")}
    names |= {name: f"START.options[{k}]" for k, name in enumerate(component.options)}
    at = 0
    for row in _settings(component):
        names[f"START_{row.variable.name.upper()}"] = f"START.settings[{at}]"
        at += row.variable.size
    return "\n".join(f"#define {name} {text}" for name, text in names.items())


def _start_numbers(component: Component) -> dict[str, list[float]]:
    """The numbers of the block, at least one in each vector, since C has no empty arrays."""
    layout = component.layout
    tolerance = float(component.experiment.get("tolerance", DEFAULT_TOLERANCE))
    rows = {
        "inputs": layout.of_role(Role.INPUT),
        "states": layout.of_role(Role.STATE),
        "parameters": _parameters(component),
        "settings": _settings(component),
    }
    numbers = {"tolerance": [tolerance], "options": [float(each) for each in component.options.values()]}
    numbers |= {name: _starts(component, each) for name, each in rows.items()}
    return {name: values or [0.0] for name, values in numbers.items()}


def _members(component: Component) -> str:
    return "\n".join(f"    double {name}[{len(values)}];" for name, values in _start_numbers(component).items())


def model_source(component: Component) -> str:
    """`model.c`."""
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

const double NOMINAL_STATES[] = {{
{_numbers(row.variable.nominal for row in states for _ in row.slots)}
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


def _settings(component: Component) -> tuple[Row, ...]:
    """The parameters of the unit itself."""
    return tuple(r for r in component.layout.of_role(*PARAMETER_ROLES) if r.variable.name in component.settings)


def _size(rows: Iterable[Row]) -> int:
    return interface.size_of(row.variable for row in rows)


_RANGES = {None: "ANY", ">= 0": "NOT_NEGATIVE", "> 0": "POSITIVE"}


def _row(row: Row) -> str:
    v = row.variable
    columns = v.shape[1] if len(v.shape) == 2 else 0
    bound = _RANGES[v.lower_bound]
    return f'{{"{v.name}", "{v.unit}", {row.first}, {v.size}, {columns}, {row.role.value}, {bound}}}'


def _starts(component: Component, rows: Iterable[Row]) -> list[float]:
    return [float(number) for row in rows for number in component.starts[row.variable.name].flat]


def _numbers(values: Iterable[float]) -> str:
    """Array elements, at least one, since C has no empty arrays."""
    return "\n".join(f"    {float(v)!r}," for v in values) or "    0"


def _indented(values: Iterable[float]) -> str:
    return "\n".join(f"        {value!r}," for value in values)


def _lines(words: Iterable[str]) -> str:
    return fill(", ".join(words), 100, initial_indent="    ", subsequent_indent="    ")
