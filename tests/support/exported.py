"""Exported controllers compiled here, and called through ctypes; their experiments on the uneven platform."""

import ctypes
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import nullcontext
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart import Experiment
from gough_stewart.fmu_build.toolchain import compiler_environment, compiling
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.export.design import Designed
from gough_stewart.harness.export.symbols import home_of
from gough_stewart.harness.export.write import ControllerSources, controller_sources
from gough_stewart.harness.loop.run import Run, simulate
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.open import ModelPlant
from gough_stewart.model.parameters import TABLE
from tests.support.arrays import FloatArray
from tests.support.c_hosts import ZIG
from tests.support.experiments import experiment_from
from tests.support.uneven import UNEVEN

WARNINGS = ("-std=c11", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-pedantic", "-Werror")
GCC = shutil.which("gcc")
COMPILER: tuple[str, ...] = ZIG if GCC is None else (GCC,)
REALS: dict[str, Any] = {"double": np.float64, "float": np.float32}
# Gains of six unequal channels for the uneven platform.
KP = [800.0, 650.0, 900.0, 720.0, 1000.0, 850.0]
KD = [60.0, 45.0, 71.0, 52.0, 83.0, 66.0]
KI = [900.0, 0.0, 1100.0, 700.0, 1300.0, 0.0]
# Of the largest force of a sample; single precision loses of lengths what a float does, times the gain.
TOLERANCE = {"double": 1e-9, "float": 2e-4}


def uneven_experiment(**tables: Any) -> Experiment:
    """Of the uneven platform, off its reference, with noise; 0.15 s at 1.5 ms, in plant steps of 0.5 ms."""
    parameters = {name: getattr(UNEVEN, name) for name in TABLE if getattr(UNEVEN, name) is not None}
    plain = {name: np.asarray(value).tolist() for name, value in parameters.items()}
    return experiment_from(
        {
            "title": "uneven",
            "platform": {"preset": "liu2000", "parameters": plain},
            "start": {"position": [0.09, -0.04, 2.88], "orientation": [0.05, -0.06, 0.1]},
            "loop": {"duration": 0.15, "sample_time": 0.0015, "plant_step": 0.0005, "delay": 2},
            "sensors": {"noise": {"leg_length": 1e-5, "leg_velocity": 1e-3, "position": 1e-5, "orientation": 1e-5}},
            **tables,
            # motions and delays are there to reach force limits
            "limits": {"reference": "warn", **tables.get("limits", {})},
        }
    )


def run_in_python(experiment: Experiment, controller: Any = None) -> Run:
    """The loop of the harness around the model."""
    prepared = prepare(experiment, controller)
    plant = ModelPlant(prepared.machine, prepared.start)
    with prepared.law_in_a_run() as law:
        return simulate(plant, law, prepared.loop)


def commanded(run: Run, designed: Designed) -> FloatArray:
    """The forces of every sample (m, 6) behind the force limit."""
    samples = run.sample_of_row[-1] + 1
    return np.clip(run.command[:samples], -designed.force_limit, designed.force_limit)


def measured_by(run: Run, designed: Designed) -> FloatArray:
    """What the controller saw at every sample, as the exported one takes it."""
    names = [v.name for v in designed.measured]
    rows = run.measured[: run.sample_of_row[-1] + 1]
    return rows[:, signals.positions(names)] if names else rows[:, :0]


def largest_difference(forces: FloatArray, expected: FloatArray) -> float:
    """Relative to the largest force of a sample, at worst."""
    assert forces.shape == expected.shape
    return float((np.abs(forces - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())


class Exported:
    """A compiled controller with its parameters, coefficients and memory."""

    def __init__(self, designed: Designed, real: str = "double", prefix: str = "controller") -> None:
        self.designed, self.prefix, self.is_single = designed, prefix, real == "float"
        self.sources = _sources(designed, prefix)
        self._library = ctypes.CDLL(str(_shared_library(_key(self.sources), real, prefix)))
        self._real = REALS[real]
        # in single precision what comes in is relative to home
        home = home_of(designed.platform)
        at_home = [home.of(v.name, v.size) for v in designed.measured] if self.is_single else []
        self._home = np.concatenate([np.zeros(0), *at_home]) if self.is_single else 0.0
        self._home_pose = np.concatenate([home.pose, np.zeros(12)]) if self.is_single else 0.0
        # the fields of the struct, in its order, as C aligns them
        fields = [(s.variable.name, s.variable) for s in designed.settings]
        self._kind = np.dtype([(name, self._real, v.shape and (v.size,)) for name, v in fields])
        defaults = ctypes.c_char.in_dll(self._library, f"{prefix.upper()}_DEFAULTS")
        self.parameters = np.frombuffer(
            ctypes.string_at(ctypes.addressof(defaults), self._kind.itemsize), self._kind
        ).copy()
        self.coefficients, self.memory = np.zeros(2000), np.zeros(2000)

    def prepare(self) -> int:
        """0, or the number of the parameter that cannot be."""
        return int(self._function("prepare")(_at(self.parameters), _at(self.coefficients)))

    def start(self) -> "Exported":
        """The memory before the first sample, and coefficients of the parameters as they are."""
        assert self.prepare() == 0
        self._function("start")(_at(self.parameters), _at(self.memory))
        return self

    def step(self, measured: Any, reference: Any = None) -> tuple[FloatArray, NDArray[np.uint8]]:
        """Forces (6,) and which of them are limited (6,) at the next sample."""
        force, limited = np.zeros(6, dtype=self._real), np.zeros(6, dtype=np.uint8)
        measured = np.ascontiguousarray(np.asarray(measured, dtype=float) - self._home, dtype=self._real)
        arguments = [_at(self.parameters), _at(self.coefficients), _at(self.memory), _at(measured)]
        if self.designed.reference_inputs:
            reference = np.ascontiguousarray(np.asarray(reference, dtype=float) - self._home_pose, dtype=self._real)
            arguments.append(_at(reference))
        self._function("step")(*arguments, _at(force), _at(limited))
        return np.asarray(force, dtype=float), limited

    def remembered(self, name: str) -> FloatArray:
        """A member of the memory, by the declaration in the header."""
        found = self.memory.view(np.uint8)[: self._memory.itemsize].view(self._memory)[name]
        return np.atleast_1d(np.asarray(found[0], dtype=float).copy())

    @cached_property
    def _memory(self) -> np.dtype[Any]:
        text = next(iter(self.sources.headers.values()))
        declared = re.search(rf"typedef struct \{{([^}}]*)\}} {self.prefix}_memory;", text)
        assert declared is not None
        members, of_single, _ = re.split(r"#if \w+_SINGLE|#endif", declared[1])
        sizes = {key: int(value) for key, value in re.findall(r"(\w+) = (\d+)", text)}
        rows = re.findall(r"^ +\w+ (\w+)(?:\[(\w+)\])?;", members + of_single * self.is_single, re.M)
        return np.dtype([(name, self._real, (int(sizes.get(size, size)),) if size else ()) for name, size in rows])

    def set_samples(self, samples: int) -> None:
        """Go to a later sample."""
        memory = self.memory.view(np.uint8)[: self._memory.itemsize].view(self._memory)
        if self.is_single:
            memory["turns"], samples = divmod(samples, 2**23)
        memory["samples"] = samples

    def set(self, name: str, value: Any) -> None:
        """Set a member of the memory."""
        self.memory.view(np.uint8)[: self._memory.itemsize].view(self._memory)[name] = value

    @property
    def status(self) -> int:
        """Of the inputs of the last sample."""
        return int(self.remembered("input_status")[0])

    @property
    def bad_time(self) -> float:
        """For how long they have not been good [s]."""
        return float(self.remembered("input_bad_time")[0])

    def forces(self, measured: FloatArray, reference: FloatArray | None = None) -> FloatArray:
        """From the start, at every sample (m, 6)."""
        self.start()
        return np.array(
            [self.step(row, None if reference is None else reference[k])[0] for k, row in enumerate(measured)]
        )

    def _function(self, name: str) -> Any:
        return getattr(self._library, f"{self.prefix}_{name}")


def write_sources(sources: ControllerSources, folder: Path) -> None:
    """All files, the program among them."""
    for name, text in {**sources.units, **sources.headers, "example_main.c": sources.example}.items():
        (folder / name).write_text(text, encoding="utf-8")


def compiled(command: Sequence[str], folder: Path) -> None:
    """Run a compiler; fails with what it says."""
    # only zig has a cache, whose objects take time to look through
    with compiling() if tuple(command[: len(ZIG)]) == ZIG else nullcontext():
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False, env=compiler_environment()
        )
    assert done.returncode == 0, done.stderr[:3000]


def _key(sources: ControllerSources) -> tuple[tuple[str, str], ...]:
    return tuple(sorted({**sources.units, **sources.headers}.items()))


_sources = cache(controller_sources)  # of a designed controller, one and the same


@cache
def _shared_library(files: tuple[tuple[str, str], ...], real: str, prefix: str) -> Path:
    """Without a warning."""
    folder = Path(tempfile.mkdtemp(dir=_scratch()))
    for name, text in files:
        (folder / name).write_text(text, encoding="utf-8")
    flags = [*WARNINGS, "-O0", "-shared", "-fPIC", f"-D{prefix.upper()}_REAL={real}"]
    compiled([*COMPILER, *flags, f"{prefix}.c", "-o", "controller.so", "-lm"], folder)
    return folder / "controller.so"


@cache
def _scratch() -> str:
    _SCRATCH.append(tempfile.TemporaryDirectory(prefix="gough-stewart-exported-"))
    return _SCRATCH[0].name


_SCRATCH: list[tempfile.TemporaryDirectory[str]] = []


def _at(array: Any) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
