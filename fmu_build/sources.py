"""The C sources of a unit: FMI layers, the component's code, tables of its variables, headers of the standard.

Files that are generated are filled-in templates, `c/*/NAME.in`.
"""

import hashlib
import struct
from collections.abc import Mapping
from importlib.metadata import version
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template
from textwrap import fill

from gough_stewart.fmu_build.cache import RUNNER, BuildError
from gough_stewart.fmu_build.component import PARAMETER_ROLES, SCALAR_REFERENCE, Layout, Role, Sources, UnitComponent
from gough_stewart.model.interface import DEFAULT_TOLERANCE
from gough_stewart.model.platform import LARGEST_NUMBER

GENERATED = "/* Generated from the table of variables: do not edit. */"
# Begins the block of start values in a library.
_MARK = "gough-stewart: start"
_MARK_SIZE, _TOKEN_SIZE = 24, 40
_LAYERS = {"2.0": "fmi2.c", "3.0": "fmi3.c"}
_STANDARD = {
    "2.0": ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    "3.0": ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}


def sources(component: UnitComponent, fmi_version: str | None = None, tokens: tuple[str, str] | None = None) -> Sources:
    """All C files of a unit for one FMI version, or for both; `tokens` and start values as of `model_source`."""
    versions, unit = tuple(_LAYERS) if fmi_version is None else (fmi_version,), c_folder("unit")
    unused = {layer for fmi, layer in _LAYERS.items() if fmi not in versions}
    units = {name: text for name, text in unit.units.items() if name not in unused} | dict(component.code.units)
    headers = {**unit.headers, **component.code.headers, "model.h": model_header(component)}
    for fmi in versions:
        headers |= standard_headers(fmi)
    return Sources({**units, "model.c": model_source(component, tokens)}, headers)


def c_folder(name: str) -> Sources:
    """The C files of a folder below c/."""
    texts = {f.name: f.read_text() for f in files("gough_stewart.fmu_build").joinpath("c", name).iterdir()}
    units = {name: text for name, text in texts.items() if name.endswith(".c")}
    return Sources(units, {name: text for name, text in texts.items() if name.endswith(".h")})


def filled(template: str, **values: object) -> str:
    """A generated file: its template `c/TEMPLATE.in` with values in the places of `$name`."""
    text = files("gough_stewart.fmu_build").joinpath("c", f"{template}.in").read_text()
    return f"{GENERATED}\n{Template(text).substitute(values)}"


def defines(values: Mapping[str, float]) -> str:
    """Macros, one per line."""
    return "\n".join(f"#define {name} {value!r}" for name, value in values.items())


def standard_headers(fmi_version: str) -> dict[str, str]:
    """The headers of the standard, from FMPy's wheel; `BuildError` if FMPy does not have them."""
    spec = find_spec(RUNNER)  # importing it would take half a second
    assert spec is not None
    assert spec.origin is not None
    try:
        return {name: Path(spec.origin).parent.joinpath("c-code", name).read_text() for name in _STANDARD[fmi_version]}
    except FileNotFoundError as error:
        raise BuildError(
            f"FMPy {version(RUNNER)} has no {Path(error.filename).name}; install FMPy 0.3.28 or later"
        ) from None


def model_header(component: UnitComponent) -> str:
    """`model.h`."""
    layout, values = component.layout, _start_values(component)
    time = layout.by_name["time"]
    before_time = Layout(tuple(row for row in layout.rows if row.first < time.first))
    starts, count = dict[str, str](), 0
    for name, numbers in values.items():
        is_vector = name in ("START_INPUTS", "START_STATES", "START_PARAMETERS")
        starts[name] = f"(START.numbers + {count})" if is_vector else f"START.numbers[{count}]"
        count += len(numbers)
    n_inputs, n_states = len(values["START_INPUTS"]), len(values["START_STATES"])
    n_results = sum(row.variable.size for row in before_time.of_role(Role.STATE, Role.RESULT))
    parameters = layout.of_role(*PARAMETER_ROLES)
    later = [row.first for row in parameters if row.first > time.first and row.variable.name not in component.settings]
    sizes = {
        "N_INPUTS": n_inputs,
        "N_STATES": n_states,
        "N_OUTPUTS": sum(row.variable.size for row in before_time.outputs()),
        "N_RESULTS": n_results,
        "N_PARAMETERS": len(values["START_PARAMETERS"]),
        "N_SLOTS": layout.rows[-1].slots.stop,
        "N_VARIABLES": len(layout.rows),
        "SCALAR_REFERENCE": SCALAR_REFERENCE,
    }
    slots = {
        "FIRST_INPUT": 0,
        "FIRST_STATE": n_inputs,
        "FIRST_RESULT": n_inputs,
        "FIRST_PARAMETER": n_inputs + n_results,
        "N_OLDER_PARAMETERS": sum(
            row.variable.size
            for row in before_time.of_role(*PARAMETER_ROLES)
            if row.variable.name not in component.settings
        ),
        "FIRST_LATER_PARAMETER": min(later, default=sizes["N_SLOTS"]),
        "FIRST_DERIVATIVE": time.first - n_states,
        "TIME": time.first,
    }
    return filled(
        "unit/model.h",
        sizes=defines(sizes),
        slots=defines(slots),
        largest_number=repr(LARGEST_NUMBER),
        mark_size=_MARK_SIZE,
        token_size=_TOKEN_SIZE,
        n_numbers=count,
        starts="\n".join(f"#define {name} {text}" for name, text in starts.items()),
    )


_RANGES = {None: "ANY", ">= 0": "NOT_NEGATIVE", "> 0": "POSITIVE"}


def model_source(component: UnitComponent, tokens: tuple[str, str] | None) -> str:
    """`model.c`: the table of variables, and the block of start values, all zero without `tokens`."""
    layout, rows = component.layout, []
    for row in layout.rows:
        v = row.variable
        columns = v.shape[1] if len(v.shape) == 2 else 0
        words = (f'"{v.name}"', f'"{v.unit}"', row.first, v.size, columns, row.role.value, _RANGES[v.lower_bound])
        rows.append(f"    {{{', '.join(map(str, words))}}},")
    references = ", ".join(str(row.reference) for row in layout.rows for _ in row.slots)
    nominal = [f"    {float(row.variable.nominal)!r}," for row in layout.of_role(Role.STATE) for _ in row.slots]
    # 64 bits that change when the meaning of saved states changes
    text = ";".join(f"{r.variable.name}:{r.variable.shape}:{r.role.name}" for r in layout.rows)
    number = int.from_bytes(hashlib.sha256((text + component.saved_form).encode()).digest()[:8], "little")
    fmi2, fmi3 = tokens or ("", "")
    numbers = [0.0 if tokens is None else x for vector in _start_values(component).values() for x in vector]
    return filled(
        "unit/model.c",
        rows="\n".join(rows),
        slots=fill(references, 100, initial_indent="    ", subsequent_indent="    "),
        nominal="\n".join(nominal) or "    0",  # C has no empty arrays
        number=f"{number:#x}",
        mark=_MARK,
        token_of_fmi2=fmi2,
        token_of_fmi3=fmi3,
        numbers="\n".join(f"        {value!r}," for value in numbers),
    )


def start_block(component: UnitComponent, tokens: tuple[str, str] | None) -> bytes:
    """The bytes of the block of `model_source` in a library of any target."""
    numbers = [0.0 if tokens is None else x for vector in _start_values(component).values() for x in vector]
    form = f"<{_MARK_SIZE}s{_TOKEN_SIZE}s{_TOKEN_SIZE}s{len(numbers)}d"
    return struct.pack(form, _MARK.encode(), *(token.encode() for token in tokens or ("", "")), *numbers)


def _start_values(component: UnitComponent) -> dict[str, list[float]]:
    """The numbers of the block, by their macros in C."""
    layout, starts, settings = component.layout, component.starts, component.settings
    parameters = layout.of_role(*PARAMETER_ROLES)
    rows = {
        "START_INPUTS": layout.of_role(Role.INPUT),
        "START_STATES": layout.of_role(Role.STATE),
        "START_PARAMETERS": [row for row in parameters if row.variable.name not in settings],
        **{f"START_{row.variable.name.upper()}": [row] for row in parameters if row.variable.name in settings},
    }
    numbers = {"DEFAULT_TOLERANCE": [float(component.experiment.get("tolerance", DEFAULT_TOLERANCE))]}
    numbers |= {name: [float(value)] for name, value in component.options.items()}
    return numbers | {
        name: [float(x) for row in group for x in starts[row.variable.name].flat] for name, group in rows.items()
    }
