"""What single precision costs: forces of an exported controller, compiled here, against the harness in a run."""

import ctypes
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.fmu_build.toolchain import FLAGS, compile_library, native
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.c_source import controller_sources
from gough_stewart.harness.export.designed import Designed
from gough_stewart.harness.export.relative import home_of
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.open import ModelPlant
from gough_stewart.model.vectors import FloatArray

# More than any controller's coefficients and memory [bytes].
_ROOM = 1 << 20


class Deviation(NamedTuple):
    """Of the forces in a run."""

    duration: float  # [s]
    largest: float  # [N]
    root_mean_square: float  # [N]
    largest_force: float  # of the harness [N]

    def __str__(self) -> str:
        """For the header of the source."""
        share = f"{self.largest / self.largest_force:.2g}" if self.largest_force > 0 else "all"
        return (
            f"Forces deviate from those in double precision, in {self.duration:g} s of the designed loop, by at most "
            f"{self.largest:.2g} N, {share} of the largest force; in root mean square by {self.root_mean_square:.2g} N."
        )


def deviation_of(experiment: Experiment, designed: Designed, controller: Any = None) -> Deviation:
    """Run a loop in the harness, without its disturbances, and the exported code on what was measured there.

    Raises
    ------
    BuildError
        The code cannot be compiled here.
    """
    calm = experiment.model_copy(update={"change": [], "disturbance": [], "fault": [], "injection": None})
    prepared = prepare(calm, controller)
    with prepared.law_in_a_run() as law:
        run = simulate(ModelPlant(prepared.machine, prepared.start), law, prepared.loop)
    samples = int(run.sample_of_row[-1]) + 1
    limit = designed.force_limit
    expected = np.clip(run.command[:samples], -limit, limit)
    names = [v.name for v in designed.measured]
    measured = run.measured[:samples, signals.positions(names)] if names else np.zeros((samples, 0))
    home = home_of(designed.platform)
    at_home = np.concatenate([np.zeros(0), *(home.of(v.name, v.size) for v in designed.measured)])
    times = np.arange(samples) * designed.sample_time
    reference = None
    if designed.reference_inputs and prepared.reference is not None:
        reference = np.concatenate(prepared.reference(times), axis=1) - np.concatenate([home.pose, np.zeros(12)])
    forces = _forces(designed, measured - at_home, reference)
    error = forces - expected
    return Deviation(
        samples * designed.sample_time,
        float(np.abs(error).max()),
        float(np.sqrt((error**2).mean())),
        float(np.abs(expected).max()),
    )


def _forces(designed: Designed, measured: FloatArray, reference: FloatArray | None) -> FloatArray:
    """Of the compiled code at every sample (m, 6)."""
    sources = controller_sources(designed, "controller", "float")
    flags = [flag for flag in FLAGS if flag != "-fvisibility=hidden"]
    library = compile_library("controller", sources.units, sources.headers, native(), flags=flags)
    with tempfile.TemporaryDirectory(prefix="gough-stewart-", ignore_cleanup_errors=True) as folder:
        path = Path(folder, f"controller{native().suffix}")
        path.write_bytes(library)
        code = ctypes.CDLL(str(path))
        parameters = ctypes.byref(ctypes.c_char.in_dll(code, "CONTROLLER_DEFAULTS"))
        coefficients, memory = (ctypes.create_string_buffer(_ROOM) for _ in range(2))
        code.controller_prepare(parameters, coefficients)
        code.controller_start(parameters, memory)
        force, limited = (ctypes.c_float * 6)(), (ctypes.c_ubyte * 6)()
        found = np.empty((len(measured), 6))
        for k, row in enumerate(measured):
            given = [row] if reference is None else [row, reference[k]]
            inputs = [(ctypes.c_float * max(1, len(each)))(*each.tolist()) for each in given]
            code.controller_step(parameters, coefficients, memory, *inputs, force, limited)
            found[k] = force[:]
    return found
