"""Reference results in the format of the FMI cross-check, for testing the unit in other importers.

For each case: `_in.csv` (inputs, linear between rows), `_ref.csv` (results), `_ref.opt` (experiment), and
`_start.csv` (start values to set, if they differ from those in modelDescription.xml).
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.dynamics import states_at
from gough_stewart.model.errors import StepError
from gough_stewart.model.formulations.cases import case_of
from gough_stewart.model.interface import DEFAULT_TOLERANCE, Variant
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.stepping import ScipyStepper
from gough_stewart.model.vectors import Array, FloatArray

# Ten thousand times smaller than the unit's default.
TOLERANCE = 1e-12
FOLDER = "extra/gough_stewart"


@dataclass(frozen=True)
class ReferenceCase:
    """A platform, its start state and inputs over time."""

    name: str
    platform: Platform
    start: State
    time: FloatArray  # (n,) [s]
    inputs: FloatArray  # (n, N_INPUTS), linear between the times

    @property
    def variant(self) -> Variant:
        """The variant of the platform."""
        return Variant.of(self.platform)

    @property
    def states(self) -> dict[str, Array]:
        """All states at the start, by name."""
        return interface.start_values(self.variant.states, self.platform) | states_at(self.platform, self.start)


ReferenceRuns = tuple[tuple[ReferenceCase, FloatArray], ...]


def reference_runs(platform: Platform) -> ReferenceRuns:
    """The paper's open loop on this platform, and varying inputs from the start values of the description.

    Each with its results; a case ends where its motion cannot go on, at a singular pose.
    """
    case = case_of(platform)
    constant = np.tile(case.inputs.to_vector(), (len(case.time), 1))
    home = State(platform.home_position, platform.home_orientation, np.zeros(3), np.zeros(3))
    # static leg forces ± 10 %, each leg at its own frequency, with an external wrench that rises and falls
    turns = case.time[:, None] / case.duration * np.arange(1, 7)
    actuators = platform.home_actuator_force * (1 + 0.1 * np.sin(2 * np.pi * turns))
    weight = platform.platform_mass * 9.81
    bump = np.sin(np.pi * case.time / case.duration)[:, None] ** 2
    force = bump * weight * np.array([0.05, -0.03, 0.1])
    torque = bump * weight * platform.characteristic_length * np.array([0.01, 0.02, -0.01])
    varying = np.concatenate([actuators, force, torque], axis=1)
    cases = (
        ReferenceCase("open_loop", platform, case.start, case.time, constant),
        ReferenceCase("varying_inputs", platform, home, case.time, varying),
    )
    runs = ((whole_case, _results(whole_case)) for whole_case in cases)
    return tuple((replace(c, time=c.time[: len(y)], inputs=c.inputs[: len(y)]), y) for c, y in runs if len(y) > 1)


def _results(case: ReferenceCase) -> FloatArray:
    """Results at the case's times, a column per scalar: the equations, integrated by SciPy instead of the unit."""
    variant, judge = case.variant, ScipyStepper(case.variant, TOLERANCE)
    judge.x[:] = interface.pack(variant.states, case.states)
    judge.u[:] = case.inputs[0]
    judge.begin(case.platform, float(case.time[0]), None)
    rows = [judge.find_results().copy()]
    for (start, end), (first, last) in zip(pairwise(case.time.tolist()), pairwise(case.inputs), strict=True):
        judge.input_rates[:] = (last - first) / (end - start)
        try:
            judge.step(start, end - start)
        except StepError:
            break
        judge.u[:] = last
        rows.append(judge.find_results().copy())
    return np.array(rows)


def reference_files(runs: ReferenceRuns, identifier: str, fmi_version: str) -> dict[str, bytes]:
    """All reference files by their path in the archive, named after the unit."""
    rule = "LSODA" if any(case.variant.bristles for case, _ in runs) else "DOP853"
    readme = _README.format(identifier=identifier, rule=f"SciPy's {rule}", tolerance=TOLERANCE)
    files = {f"{FOLDER}/README.txt": readme.encode()}
    for case, values in runs:
        stem = f"{FOLDER}/{case.name}/{identifier}"
        results = interface.unpack(case.variant.results, values)
        inputs = interface.unpack(interface.INPUTS, case.inputs)
        files[f"{stem}_in.csv"] = _csv(case.time, inputs, fmi_version)
        outputs = {v.name: results[v.name] for v in case.variant.results if v.causality == "output"}
        files[f"{stem}_ref.csv"] = _csv(case.time, outputs, fmi_version)
        options = {
            "StartTime": case.time[0],
            "StopTime": case.time[-1],
            "StepSize": case.time[1] - case.time[0],
            "RelTol": DEFAULT_TOLERANCE,
            "OutputIntervalLength": case.time[1] - case.time[0],
        }
        lines = (f"{name}, {float(value)!r}\n" for name, value in options.items())
        files[f"{stem}_ref.opt"] = "".join(lines).encode()
        starts = {name: value[None] for name, value in case.states.items()}
        files[f"{stem}_start.csv"] = _csv(case.time[:1], starts, fmi_version)
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
