"""Whether units of the plant do what they say: FMPy's validation, and their reference results in both kinds.

The reference results are in the file, from the equations under another integrator than the unit's.
"""

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping
from ctypes import c_double
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu

from gough_stewart.fmu_build.plant.plant_component import IDENTIFIER
from gough_stewart.fmu_build.plant.reference_results import FOLDER
from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants.unit import FmiType, FmuInstance, UnitFile, check_archive
from gough_stewart.model import interface
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.interface import IDEAL, NOMINAL
from gough_stewart.model.vectors import FloatArray

# Of a variable's largest value, or of 1 in its SI unit. Sound units differ by 2e-6 at most: with stiction and
# elastic legs, accelerations are that sensitive to tolerances.
BOUND = 1e-5
# Of the unit's integrator and of the importer's: what is left is the unit's error.
_TOLERANCE = 1e-12
VALIDATION = "validation"
EXPLANATION = (
    "Validation by FMPy; largest deviations from the unit's reference results, as a share of a variable's largest "
    f"value or of 1 in its SI unit, of bristles of 1 cm: at most {BOUND:.0e} passes."
)
KINDS: Mapping[FmiType, str] = {"CoSimulation": "Co-Simulation", "ModelExchange": "Model Exchange"}
# FMI 3.0 holds inputs over a step. Two steps with the values at a third of the first and two thirds of the second have
# the mean and the first moment of a linear input, so that the error is of fourth order; of second at middle values.
_STEPS_A_ROW = 120
_Columns = dict[str, FloatArray]


@dataclass(frozen=True)
class UnitCheck:
    """One check of one file."""

    file: str
    name: str
    result: str  # the largest deviation, or the problem
    passed: bool
    deviation: float | None = None  # from the reference results, as a share


def check_units(paths: Iterable[Path | str]) -> Iterator[UnitCheck]:
    """Three checks of each file: validation, Co-Simulation, Model Exchange; a failure is one that has not passed."""
    for path in map(Path, paths):
        try:
            check_archive(path)
            problems = validate_fmu(str(path))
        except PlantError as error:
            problems = [str(error)]
        yield UnitCheck(path.name, VALIDATION, "; ".join(problems) or "no problem", not problems)
        for kind, name in KINDS.items():
            try:
                with UnitFile(path) as file:
                    deviations = dict(_deviations(file, kind))
                worst = max(deviations, key=lambda case: deviations[case])
                result = f"{deviations[worst]:.1e} ({worst})"
                # NaN does not pass
                yield UnitCheck(path.name, name, result, deviations[worst] <= BOUND, deviations[worst])
            except (GoughStewartError, FMICallException, OSError) as error:
                yield UnitCheck(path.name, name, str(error), passed=False)


def _deviations(file: UnitFile, kind: FmiType) -> Iterator[tuple[str, float]]:
    """By case: the largest deviation from its reference results."""
    cases = sorted(path for path in (file.folder / FOLDER).glob("*") if path.is_dir())
    if not cases:
        raise file.refusal(f"has no reference results in {FOLDER}")
    for case in cases:
        expected, inputs, start = (_columns(case / f"{IDENTIFIER}_{part}.csv") for part in ("ref", "in", "start"))
        time = expected.pop("time")[:, 0]
        del inputs["time"], start["time"]
        references = np.concatenate(list(expected.values()), axis=1)
        # of bristles less than 1, as in absolute tolerances
        scales = {name: interface.BY_NAME[name].nominal / NOMINAL for name in expected}
        largest = [max(scales[name], np.abs(values).max()) for name, values in expected.items()]
        scale = np.repeat(largest, [values.shape[1] for values in expected.values()])
        deviation = 0.0
        with FmuInstance(file, kind) as unit:
            unit.write_by_name({name: values[0] for name, values in (inputs | start).items()})
            unit.initialise(_TOLERANCE)
            step = (_by_steps if kind == "CoSimulation" else _by_integration)(unit, inputs, file)
            results = unit.values_of(expected)
            for k in range(len(time) - 1):
                try:
                    step(k, time[k], time[k + 1])
                except FMICallException as error:
                    raise file.refusal(f"{case.name}: {unit.take_messages() or error}") from error
                results.read()
                # keeps NaN, unlike max()
                deviation = float(np.maximum(deviation, (np.abs(results.array - references[k + 1]) / scale).max()))
        yield case.name, deviation if np.isfinite(deviation) else np.inf


def _columns(path: Path) -> _Columns:
    """Whole variables (rows, n) of a file, by name; elements are columns in FMI 2.0, one cell in FMI 3.0."""
    with path.open(newline="") as lines:
        names, *rows = csv.reader(lines)
    parts = dict[str, list[FloatArray]]()
    for name, cells in zip(names, zip(*rows, strict=True), strict=True):
        parts.setdefault(name.split("[")[0], []).append(np.array([[float(w) for w in cell.split()] for cell in cells]))
    return {name: np.concatenate(elements, axis=1) for name, elements in parts.items()}


_Step = Callable[[int, float, float], None]


def _by_steps(unit: FmuInstance, inputs: _Columns, file: UnitFile) -> _Step:
    """Communication steps under inputs that are linear between rows."""
    buffer, rows = unit.values_of(inputs), np.concatenate(list(inputs.values()), axis=1)
    scalars = [reference for name in inputs for reference in file.references(name)]

    def step_to(k: int, begin: float, end: float) -> None:
        if unit.is_fmi2:
            buffer.array[:] = rows[k]
            buffer.write()
            rates = (rows[k + 1] - rows[k]) / (end - begin)
            unit.fmu.setRealInputDerivatives(scalars, [1] * len(scalars), rates.tolist())
            unit.do_step(begin, end - begin)
            return
        step = (end - begin) / _STEPS_A_ROW
        for m in range(_STEPS_A_ROW):
            buffer.array[:] = rows[k] + (m + (1 + m % 2) / 3) / _STEPS_A_ROW * (rows[k + 1] - rows[k])
            buffer.write()
            unit.do_step(begin + m * step, step)
        buffer.array[:] = rows[k + 1]
        buffer.write()

    return step_to


def _by_integration(unit: FmuInstance, inputs: _Columns, file: UnitFile) -> _Step:
    """SciPy integrates the unit's derivatives under inputs that are linear between rows."""
    from scipy.integrate import solve_ivp

    buffer, rows = unit.values_of(inputs), np.concatenate(list(inputs.values()), axis=1)
    n = len(file.variant.scales)
    x, xdot = (c_double * n)(), (c_double * n)()
    absolute, is_stiff = _TOLERANCE * np.array(file.variant.scales), file.variant != IDEAL
    method: Literal["LSODA", "DOP853"] = "LSODA" if is_stiff else "DOP853"

    def integrate(k: int, begin: float, end: float) -> None:
        def derivatives(t: float, state: FloatArray) -> FloatArray:
            buffer.array[:] = rows[k] + (t - begin) / (end - begin) * (rows[k + 1] - rows[k])
            buffer.write()
            unit.fmu.setTime(t)
            x[:] = state.tolist()
            unit.fmu.setContinuousStates(x, n)
            (unit.fmu.getDerivatives if unit.is_fmi2 else unit.fmu.getContinuousStateDerivatives)(xdot, n)
            return np.array(xdot)

        unit.fmu.getContinuousStates(x, n)
        solution = solve_ivp(derivatives, (begin, end), np.array(x), method=method, rtol=_TOLERANCE, atol=absolute)
        derivatives(end, solution.y[:, -1])
        unit.fmu.completedIntegratorStep()

    return integrate
