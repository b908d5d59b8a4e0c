"""Exported controllers sample by sample: units in FMPy, and the compiled source."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.support.arrays import FloatArray
from tests.support.exported import Exported
from tests.support.fmu_plants import Fmu, plant

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
    """Outputs at the end of each sample's step, made in some parts, and the start values of all variables by name."""
    names, found = ("actuator_force", "force_limited", "input_status", "input_bad_time", *more), []
    with plant(Fmu(path)) as unit:
        unit.initialise(time=start)
        begun = {name: np.ravel(value) for name, value in unit.everything().items()}
        for k, values in enumerate(inputs):
            for part in range(parts):
                for name, value in values.items():
                    unit.set(name, value if part == 0 else 0 * value)
                unit.do_step(start + k * step + part * step / parts, step / parts)
            found.append([unit.get(name) for name in names])
    force, limited, status, bad, *others = (np.array(each) for each in zip(*found, strict=True))
    return Outputs(force, limited, status, bad), begun | dict(zip(more, others, strict=True))


def run_source(source: Path, measured: FloatArray, reference: FloatArray | None, *, real: str = "double") -> Outputs:
    """Outputs of each sample of measurements (n, …) and references (n, 18), by C in numbers `real`, no warning."""
    code, found = Exported(source, real).start(), []
    for k, row in enumerate(measured):
        force, limited = code.step(row, None if reference is None else reference[k])
        found.append((force, limited.astype(float), *code.status))
    return Outputs(*(np.array(each) for each in zip(*found, strict=True)))
