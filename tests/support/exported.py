"""Exported controllers from the files that `gs.export` writes: compiled here, and called by what their header says."""

import ctypes
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.experiments import experiment_from
from tests.support.uneven import PARAMETERS

WARNINGS = ("-std=c11", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-pedantic", "-Werror")
ZIG = (sys.executable, "-m", "ziglang", "cc")
GCC = shutil.which("gcc")
COMPILER: tuple[str, ...] = ZIG if GCC is None else (GCC,)
REALS: dict[str, Any] = {"double": np.float64, "float": np.float32}
# Gains of six unequal channels for the uneven platform.
KP = [800.0, 650.0, 900.0, 720.0, 1000.0, 850.0]
KD = [60.0, 45.0, 71.0, 52.0, 83.0, 66.0]
KI = [900.0, 0.0, 1100.0, 700.0, 1300.0, 0.0]
PD: dict[str, Any] = {"type": "pd", "proportional_gain": KP, "derivative_gain": KD}
PID: dict[str, Any] = {**PD, "type": "pid", "integral_gain": KI}
HOLD: dict[str, Any] = {"type": "hold", "position": [0.1, -0.07, 2.93], "orientation": [0.06, -0.09, 0.13]}
CIRCLE: dict[str, Any] = {"type": "circle", "radius": 0.04, "frequency": 3.0, "plane": "xz", "fade_in": 0.06}
SINE: dict[str, Any] = {
    "type": "sine",
    "position_amplitude": [0.03, -0.02, 0.04],
    "orientation_amplitude": [0.02, 0.05, -0.03],
    "frequency": 4.0,
    "phase": 0.4,
    "fade_in": 0.05,
}
# Of the largest force of a sample; single precision loses of lengths what a float does, times the gain.
TOLERANCE = {"double": 1e-9, "float": 2e-4}


def uneven_experiment(**tables: Any) -> gs.Experiment:
    """Of the uneven platform, off its reference, with noise; 0.15 s at 1.5 ms, in plant steps of 0.5 ms."""
    return experiment_from(
        {
            "title": "uneven",
            "platform": {"preset": "liu2000", "parameters": PARAMETERS},
            "start": {"position": [0.09, -0.04, 2.88], "orientation": [0.05, -0.06, 0.1]},
            "loop": {"duration": 0.15, "sample_time": 0.0015, "plant_step": 0.0005, "delay": 2},
            "sensors": {"noise": {"leg_length": 1e-5, "leg_velocity": 1e-3, "position": 1e-5, "orientation": 1e-5}},
            **tables,
            # motions and delays are there to reach force limits
            "limits": {"reference": "warn", **tables.get("limits", {})},
        }
    )


def source_of(experiment: Any, controller: Any = None, folder: Path | None = None, **options: Any) -> Path:
    """The C of a controller, beside its header and its example, however its loop does; once, if nobody says where."""
    options = {"allow_unstable": True, "reference": "inside", "parts": (), "safe_force": "feedforward", **options}
    key = repr((experiment, options)) if folder is None and controller is None else None
    if key is None or key not in _WRITTEN:
        folder = folder or Path(tempfile.mkdtemp(dir=_scratch()))
        source = gs.export(experiment, forms="c", out=folder, controller=controller, **options)[0]
        if key is None:
            return source
        _WRITTEN[key] = source
    return _WRITTEN[key]


def words_of(path: Path) -> str:
    """A text in one line."""
    return " ".join(path.read_text(encoding="utf-8").split())


class Exported:
    """A compiled controller with its parameters, coefficients and memory, whose structs are read from the header."""

    def __init__(self, source: Path, real: str = "double") -> None:
        self.name, self.header = source.stem, source.with_suffix(".h").read_text()
        self._real, self._is_single = REALS[real], real == "float"
        self._library = ctypes.CDLL(str(_shared_library(source, real)))
        self.sizes = {key: int(n) for key, n in re.findall(rf"{self.name.upper()}_(N_\w+) = (\d+)", self.header)}
        self._parameters, self._memory = self._struct("parameters"), self._struct("memory")
        self.parameters = self._constant("DEFAULTS", self._parameters.itemsize).view(self._parameters).copy()
        self.coefficients, self.memory = np.zeros(2000), np.zeros(2000)
        # in single precision what comes in is relative to home
        self._home: Any = 0.0
        self._home_pose: Any = np.zeros(6)
        if self._is_single and self.sizes["N_MEASURED"]:
            self._home = self._constant("HOME", 4 * self.sizes["N_MEASURED"]).view(self._real)
        if self._is_single and self.sizes["N_REFERENCE"]:
            self._home_pose = self._constant("HOME_POSE", 4 * 6).view(self._real)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters, in their order."""
        return self._parameters.names or ()

    def prepare(self) -> int:
        """0, or the number of the parameter that cannot be."""
        return int(self._call("prepare", self.parameters, self.coefficients))

    def start(self) -> "Exported":
        """The memory before the first sample, and coefficients of the parameters as they are."""
        assert self.prepare() == 0
        self._call("start", self.parameters, self.memory)
        return self

    def step(self, measured: Any, reference: Any = None) -> tuple[FloatArray, NDArray[np.uint8]]:
        """Forces (6,) and which of them are limited (6,) at the next sample."""
        force, limited = np.zeros(6, dtype=self._real), np.zeros(6, dtype=np.uint8)
        inputs = [np.asarray(measured, dtype=float) - self._home]
        if reference is not None:
            inputs.append(np.asarray(reference, dtype=float) - np.append(self._home_pose, np.zeros(12)))
        rows = [np.ascontiguousarray(row, dtype=self._real) for row in inputs]
        self._call("step", self.parameters, self.coefficients, self.memory, *rows, force, limited)
        return np.asarray(force, dtype=float), limited

    def steps(self, measured: FloatArray) -> tuple[FloatArray, NDArray[np.uint8]]:
        """Forces and flags from the start, at every row of measurements (m, 6)."""
        self.start()
        force, limited = zip(*map(self.step, measured), strict=True)
        return np.array(force), np.array(limited)

    def remembered(self, name: str) -> FloatArray:
        """A member of the memory."""
        return np.atleast_1d(np.asarray(self._members[name][0], dtype=float).copy())

    def set(self, name: str, value: Any) -> None:
        """Set a member of the memory."""
        self._members[name] = value

    def set_samples(self, samples: int) -> None:
        """Go to a later sample."""
        if self._is_single:
            self.set("turns", samples // 2**23)
        self.set("samples", samples % 2**23 if self._is_single else samples)

    @property
    def status(self) -> tuple[int, float]:
        """Of the inputs of the last sample, and for how long they have not been good [s]."""
        return int(self.remembered("input_status")[0]), float(self.remembered("input_bad_time")[0])

    @property
    def _members(self) -> NDArray[Any]:
        return self.memory.view(np.uint8)[: self._memory.itemsize].view(self._memory)

    def _struct(self, name: str) -> np.dtype[Any]:
        """A struct of the header, as C aligns it."""
        declared = re.search(rf"typedef struct \{{([^}}]*)\}} {self.name}_{name};", self.header)
        assert declared is not None
        common, of_single = [*re.split(r"#if \w+_SINGLE|#endif", declared[1]), ""][:2]
        rows = re.findall(r"^ +\w+ (\w+)(?:\[(\w+)\])?;", common + of_single * self._is_single, re.M)
        sizes = {f"{self.name.upper()}_{key}": n for key, n in self.sizes.items()}
        return np.dtype([(key, self._real, (int(sizes.get(n, n)),) if n else ()) for key, n in rows])

    def _constant(self, name: str, size: int) -> NDArray[np.uint8]:
        at = ctypes.addressof(ctypes.c_char.in_dll(self._library, f"{self.name.upper()}_{name}"))
        return np.frombuffer(ctypes.string_at(at, size), np.uint8)

    def _call(self, name: str, *arrays: NDArray[Any]) -> Any:
        function = getattr(self._library, f"{self.name}_{name}")
        return function(*(ctypes.c_void_p(array.ctypes.data) for array in arrays))


def samples_of(record: gs.Record, name: str) -> FloatArray:
    """A column at the samples of the controller whose forces act within the run."""
    every = round(record.metadata["sample_time"] / record.metadata["plant_step"])
    return np.asarray(record[name][:-1:every])


def commanded(record: gs.Record) -> FloatArray:
    """The forces of every sample (m, 6) behind the force limit."""
    limit = record.metadata["force_limit"]
    return np.clip(samples_of(record, "controller.force"), -(limit or np.inf), limit or np.inf)


def measured_by(record: gs.Record, *names: str) -> FloatArray:
    """What the controller saw at every sample: by default leg lengths."""
    return np.concatenate([samples_of(record, f"measured.{name}") for name in names or ("leg_length",)], axis=1)


def largest_difference(forces: FloatArray, expected: FloatArray) -> float:
    """Relative to the largest force of a sample, at worst."""
    assert forces.shape == expected.shape
    return float((np.abs(forces - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())


def compiled(command: Sequence[str], folder: Path) -> None:
    """Run a compiler; fails with what it says."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env={**os.environ})
    assert done.returncode == 0, done.stderr[:3000]


@cache
def _shared_library(source: Path, real: str) -> Path:
    """Without a warning."""
    library = source.with_name(f"{source.stem}_{real}.so")
    flags = [*WARNINGS, "-O0", "-shared", "-fPIC", f"-D{source.stem.upper()}_REAL={real}"]
    compiled([*COMPILER, *flags, source.name, "-o", library.name, "-lm"], source.parent)
    return library


@cache
def _scratch() -> str:
    _SCRATCH.append(tempfile.TemporaryDirectory(prefix="gough-stewart-exported-"))
    return _SCRATCH[0].name


_WRITTEN: dict[str, Path] = {}
_SCRATCH: list[tempfile.TemporaryDirectory[str]] = []
