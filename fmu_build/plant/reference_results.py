"""Reference results in the format of the FMI cross-check, for testing the unit in other importers.

For each case: `_in.csv` (inputs, linear between rows), `_ref.csv` (results), `_ref.opt` (experiment), and
`_start.csv` (start values to set, if they differ from those in modelDescription.xml).
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.dynamics import states_at
from gough_stewart.model.errors import StepError
from gough_stewart.model.formulations.cases import case_of
from gough_stewart.model.interface import DEFAULT_TOLERANCE, State, Variant
from gough_stewart.model.platform import Platform
from gough_stewart.model.stepping import ScipyStepper
from gough_stewart.model.vectors import Array, FloatArray

# Ten thousand times smaller than the unit's default.
TOLERANCE = 1e-12
FOLDER = "extra/gough_stewart"


class ReferenceRun(NamedTuple):
    """A motion of a platform under inputs over time, and its results."""

    name: str
    variant: Variant
    start: dict[str, Array]  # all states, by name
    time: FloatArray  # (n,) [s]
    inputs: FloatArray  # (n, N_INPUTS), linear between the times
    results: FloatArray  # (n, N_RESULTS)


@lru_cache(maxsize=8)  # the units of both FMI versions have them in common
def reference_runs(platform: Platform) -> tuple[ReferenceRun, ...]:
    """The paper's open loop on this platform, and varying inputs, by SciPy; a run ends before a singular pose."""
    case = case_of(platform)
    constant = np.tile(np.concatenate(case.inputs), (len(case.time), 1))
    home = State(platform.home_position, platform.home_orientation, np.zeros(3), np.zeros(3))
    # static leg forces ± 10 %, each leg at its own frequency, with an external wrench that rises and falls
    turns = case.time[:, None] / case.duration * np.arange(1, 7)
    actuators = platform.home_actuator_force * (1 + 0.1 * np.sin(2 * np.pi * turns))
    weight = platform.platform_mass * 9.81
    bump = np.sin(np.pi * case.time / case.duration)[:, None] ** 2
    force = bump * weight * np.array([0.05, -0.03, 0.1])
    torque = bump * weight * platform.characteristic_length * np.array([0.01, 0.02, -0.01])
    varying = np.concatenate([actuators, force, torque], axis=1)

    runs, variant, time = list[ReferenceRun](), Variant.of(platform), case.time
    for name, begin, inputs in (("open_loop", case.start, constant), ("varying_inputs", home, varying)):
        start = interface.start_values(variant.states, platform) | states_at(platform, begin)
        judge = ScipyStepper(variant, TOLERANCE)
        judge.x[:] = interface.pack(variant.states, start)
        judge.u[:] = inputs[0]
        judge.begin(platform, float(time[0]), None)
        rows = [judge.find_results().copy()]
        for (now, after), (first, last) in zip(pairwise(time.tolist()), pairwise(inputs), strict=True):
            judge.input_rates[:] = (last - first) / (after - now)
            try:
                judge.step(now, after - now)
            except StepError:
                break
            judge.u[:] = last
            rows.append(judge.find_results().copy())
        if len(rows) > 1:
            runs.append(ReferenceRun(name, variant, start, time[: len(rows)], inputs[: len(rows)], np.array(rows)))
            for array in runs[-1][3:]:
                array.setflags(write=False)
    return tuple(runs)


def reference_files(runs: Sequence[ReferenceRun], identifier: str, fmi_version: str) -> dict[str, bytes]:
    """All reference files by their path in the archive, named after the unit."""
    rule = "LSODA" if any(run.variant.bristles for run in runs) else "DOP853"
    readme = _README.format(identifier=identifier, rule=f"SciPy's {rule}", tolerance=TOLERANCE)
    files = {f"{FOLDER}/README.txt": readme.encode()}
    for run in runs:
        stem, time = f"{FOLDER}/{run.name}/{identifier}", run.time
        results = interface.unpack(run.variant.results, run.results)
        outputs = {v.name: results[v.name] for v in run.variant.results if v.causality == "output"}
        options = {
            "StartTime": time[0],
            "StopTime": time[-1],
            "StepSize": time[1] - time[0],
            "RelTol": DEFAULT_TOLERANCE,
            "OutputIntervalLength": time[1] - time[0],
        }
        lines = (f"{name}, {float(value)!r}\n" for name, value in options.items())
        files |= {
            f"{stem}_in.csv": _csv(time, interface.unpack(interface.INPUTS, run.inputs), fmi_version),
            f"{stem}_ref.csv": _csv(time, outputs, fmi_version),
            f"{stem}_ref.opt": "".join(lines).encode(),
            f"{stem}_start.csv": _csv(time[:1], {name: x[None] for name, x in run.start.items()}, fmi_version),
        }
    return files


def _csv(time: FloatArray, columns: dict[str, FloatArray], fmi_version: str) -> bytes:
    """A column per scalar in FMI 2.0, a column per array with blanks between its elements in FMI 3.0."""
    names, texts = ["time"], [[repr(float(t)) for t in time]]
    for name, values in columns.items():
        flat = values.reshape(len(time), -1)
        if fmi_version == "2.0":
            names += interface.BY_NAME[name].scalar_names
            texts += [[repr(float(v)) for v in column] for column in flat.T]
        else:
            names.append(name)
            texts.append([" ".join(repr(float(v)) for v in row) for row in flat])
    rows = [",".join(f'"{name}"' for name in names), *(",".join(row) for row in zip(*texts, strict=True))]
    return ("\n".join(rows) + "\n").encode()


_README = """Reference results of the unit, in the format of the FMI cross-check.

open_loop        the simulation of Liu, Li & Li (2000), scaled to the size of the platform; needs the start
                 values in {identifier}_start.csv
varying_inputs   varying forces and a varying external wrench, from the start values in modelDescription.xml

*_in.csv    inputs, linear between the rows
*_ref.csv   results: the equations integrated by {rule} at tolerance {tolerance:g}
*_ref.opt   experiment
*_start.csv start values of the states
"""
