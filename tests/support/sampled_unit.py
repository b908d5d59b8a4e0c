"""Clients of exported controllers that know nothing but their files: FMPy for FMUs, a few lines of C for the source."""

import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import fmpy
import numpy as np
from fmpy.simulation import instantiate_fmu

from tests.support.arrays import FloatArray
from tests.support.exported import COMPILER, WARNINGS, compiled

Values = Mapping[str, FloatArray]


class Outputs(NamedTuple):
    """What came out of every sample."""

    force: FloatArray  # (n, 6)
    limited: FloatArray  # (n, 6)
    status: FloatArray  # (n,)
    bad_time: FloatArray  # (n,)


def run_unit(
    path: Path, inputs: Sequence[Values], step: float, start: float, parts: int = 1, more: Sequence[str] = ()
) -> tuple[Outputs, Values]:
    """Outputs at the end of each sample's step, and the start values of all variables by name; more outputs likewise.

    Inputs are set before a step, which is made in some parts; between these nobody looks at them.
    """
    folder = fmpy.extract(str(path), str(path.with_suffix("")))
    description = fmpy.read_model_description(folder)
    is_fmi2 = description.fmiVersion == "2.0"
    unit: Any = instantiate_fmu(folder, description, "CoSimulation")
    references: dict[str, list[int]] = {}
    for variable in description.modelVariables:
        references.setdefault(variable.name.partition("[")[0], []).append(variable.valueReference)
    sizes = {v.name: int(np.prod([d.start for d in v.dimensions or []], dtype=int)) for v in description.modelVariables}

    def get(name: str) -> FloatArray:
        if is_fmi2:
            return np.array(unit.getReal(references[name]))
        return np.array(unit.getFloat64(references[name], nValues=sizes[name]))

    def put(name: str, value: FloatArray) -> None:
        (unit.setReal if is_fmi2 else unit.setFloat64)(references[name], np.asarray(value, dtype=float).tolist())

    if is_fmi2:
        unit.setupExperiment(startTime=start)
        unit.enterInitializationMode()
    else:
        unit.enterInitializationMode(startTime=start)
    unit.exitInitializationMode()
    begun = {name: get(name) for name in references}
    found = []
    for k, values in enumerate(inputs):
        for part in range(parts):
            for name, value in values.items():
                put(name, value if part == 0 else 0 * value)
            unit.doStep(start + k * step + part * step / parts, step / parts)
        names = ("actuator_force", "force_limited", "input_status", "input_bad_time", *more)
        found.append([get(name) for name in names])
    unit.terminate()
    unit.freeInstance()
    force, limited, status, bad, *others = (np.array(each) for each in zip(*found, strict=True))
    return Outputs(force, limited, status[:, 0], bad[:, 0]), begun | dict(zip(more, others, strict=True))


_CLIENT = """
#include "@p@.h"
static @p@_parameters parameters;
static @p@_coefficients coefficients;
static @p@_memory memory;

int client_start(void);
void client_step(const double *measured, const double *reference, double *force, unsigned char *limited, double *input);

int client_start(void)
{
    parameters = @P@_DEFAULTS;
    @p@_start(&parameters, &memory);
    return @p@_prepare(&parameters, &coefficients);
}

void client_step(const double *measured, const double *reference, double *force, unsigned char *limited, double *input)
{
    @V@ values[@P@_N_MEASURED + 1], wanted[@P@_N_REFERENCE + 1];
    @p@_real found[6];
    int k;
    (void)wanted;
    (void)measured;
    (void)reference;
    values[0] = 0;
    for (k = 0; k < @P@_N_MEASURED; ++k)
        values[k] = (@V@)(measured[k]@HOME@);
    for (k = 0; k < @P@_N_REFERENCE; ++k)
        wanted[k] = (@V@)(reference[k]@HOME_POSE@);
    @p@_step(&parameters, &coefficients, &memory, values, @REQUESTED@found, limited);
    for (k = 0; k < 6; ++k)
        force[k] = (double)found[k];
    input[0] = (double)memory.input_status;
    input[1] = (double)memory.input_bad_time;
}
"""


def run_source(source: Path, measured: FloatArray, reference: FloatArray | None, *, real: str = "double") -> Outputs:
    """Outputs of each sample of measurements (n, …) and references (n, 18) that come in, compiled without a warning.

    `real`: of all numbers; as float, poses and lengths are relative to home.
    """
    name, single = source.stem, real == "float"
    places = {
        "p": name,
        "P": name.upper(),
        "V": "float" if single else "double",
        "HOME": f" - (double){name.upper()}_HOME[k]" if single else "",
        "HOME_POSE": f" - (k < 6 ? (double){name.upper()}_HOME_POSE[k] : 0)"
        if single and reference is not None
        else "",
        "REQUESTED": "" if reference is None else "wanted, ",
    }
    text = _CLIENT
    for key, value in places.items():
        text = text.replace(f"@{key}@", value)
    (source.parent / "client.c").write_text(text)
    flags = [*WARNINGS, "-O0", "-shared", "-fPIC", f"-D{name.upper()}_REAL={real}"]
    compiled([*COMPILER, *flags, source.name, "client.c", "-o", "client.so", "-lm"], source.parent)
    code = ctypes.CDLL(str(source.parent / "client.so"))
    assert code.client_start() == 0
    n = len(measured)
    force, limited, report = np.zeros((n, 6)), np.zeros((n, 6), dtype=np.uint8), np.zeros((n, 2))
    given = np.ascontiguousarray(measured), np.ascontiguousarray(measured if reference is None else reference)
    for k in range(n):
        rows = (*(each[k] for each in given), force[k], limited[k], report[k])
        code.client_step(*(ctypes.c_void_p(row.ctypes.data) for row in rows))
    return Outputs(force, limited.astype(float), report[:, 0], report[:, 1])
