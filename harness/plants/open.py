"""Opens the plant of a run by its kind: in process, or as an FMU, which is built if no file is given."""

import atexit
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from gough_stewart.fmu_build.cache import cache_folder, kept, state_of_sources
from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants import FMI_VERSIONS, PlantKind
from gough_stewart.harness.plants.isolated import IsolatedFmu
from gough_stewart.harness.plants.plant import Plant
from gough_stewart.model.interface import DEFAULT_TOLERANCE, IDEAL, State, Variant
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.installed import THIS_MACHINE
from gough_stewart.model.process.progress import StepProgress
from gough_stewart.model.stepping import Integrator, SteppingModel
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from gough_stewart.harness.plants.unit import UnitFile


class ModelPlant(Plant):
    """The stepping model with one of its integrators as a `Plant`."""

    def __init__(
        self,
        platform: Platform,
        start: State | None = None,
        tolerance: float = DEFAULT_TOLERANCE,
        fixed_step_size: float = 0.0,
        integrator: Integrator = "compiled",
    ) -> None:
        self._model = model = SteppingModel(platform, tolerance, fixed_step_size, integrator)
        self.columns = model.variant.columns
        if start is not None:
            model.set_many(start._asdict())

    def set_inputs(self, inputs: FloatArray) -> None:
        self._model.set_inputs(inputs)

    def set_parameters(self, values: Mapping[str, object]) -> None:
        self._model.set_many(values)

    def results(self) -> FloatArray:
        return self._model.result_vector()

    def do_step(self, time: float, step: float) -> None:
        self._model.do_step(time, step)


def open_plant(
    kind: PlantKind,
    platform: Platform,
    start: State | None = None,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    fixed_step_size: float = 0.0,
    fmu: Path | str | None = None,
    progress: StepProgress | None = None,
) -> Plant:
    """An open plant; an FMU without a file is built for this machine or taken from the cache.

    An FMU from a file is third-party code: it runs in its own process, so that a crash does not end the run.
    `PlantError` for a kind and a file that do not fit, or one that `FmuPlant` refuses; `BuildError` from building one.
    """
    if kind in ("model", "scipy"):
        if fmu is not None:
            raise PlantError(f"plant {kind!r} does not accept the file {fmu}; choose the plant fmu2 or fmu3")
        return ModelPlant(platform, start, tolerance, fixed_step_size, "compiled" if kind == "model" else "scipy")
    if kind not in FMI_VERSIONS:
        raise PlantError(f"plant is {kind!r}; expected one of {', '.join(get_args(PlantKind))}")
    version = FMI_VERSIONS[kind]
    if fmu is None:
        from gough_stewart.harness.plants.unit import FmuPlant  # imports FMPy

        built = _cached_unit(cached_build(version, progress, Variant.of(platform)))
        return FmuPlant(built, platform, start, tolerance, fixed_step_size)
    unit = IsolatedFmu(fmu, platform, start, tolerance, fixed_step_size)
    if unit.fmi_version != version:
        unit.close()
        raise PlantError(f"{fmu}: is FMI {unit.fmi_version}; expected FMI {version} for the plant {kind}")
    return unit


def cached_build(fmi_version: str, progress: StepProgress | None = None, variant: Variant = IDEAL) -> Path:
    """The FMU of a variant for this machine, built once per state of this package."""

    def built() -> bytes:
        from gough_stewart.fmu_build.build import build  # imports what a cached unit does not need
        from gough_stewart.fmu_build.plant.plant_component import platform_of

        with tempfile.TemporaryDirectory(prefix="gough-stewart-") as folder:
            return build(folder, fmi=[fmi_version], platform=platform_of(variant), progress=progress)[0].read_bytes()

    state = "-".join((state_of_sources(), THIS_MACHINE, *variant.parts))
    return kept(cache_folder() / "fmus" / state / f"gough_stewart_fmi{fmi_version[0]}.fmu", built)


@cache
def _cached_unit(path: Path) -> "UnitFile":
    """The FMU of the cache, unpacked once for all runs of this process."""
    from gough_stewart.harness.plants.unit import UnitFile

    file = UnitFile(path)
    atexit.register(file.close)
    return file
