"""Opens the plant of a run by its kind: in process, or as an FMU, which is built if no file is given.

Each kind is imported when it is opened: the FMU imports FMPy.
"""

import atexit
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from gough_stewart.fmu_build.cached import cached_build
from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants.isolated import IsolatedFmu
from gough_stewart.harness.plants.kinds import FMI_VERSIONS, PlantKind
from gough_stewart.harness.plants.plant import Plant
from gough_stewart.model.interface import DEFAULT_TOLERANCE, Variant
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.progress import StepProgress
from gough_stewart.model.state import State

if TYPE_CHECKING:
    from gough_stewart.harness.plants.unit import UnitFile
    from gough_stewart.model.stepping import Integrator


@contextmanager
def open_plant(
    kind: PlantKind,
    platform: Platform,
    start: State | None = None,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    fixed_step_size: float = 0.0,
    fmu: Path | str | None = None,
    progress: StepProgress | None = None,
) -> Iterator[Plant]:
    """An open plant; an FMU without a file is built for this machine or taken from the cache.

    An FMU from a file is third-party code: it runs in its own process, so that a crash does not end the run.

    Raises
    ------
    PlantError
        An unknown kind, a file for the model, an FMU of the other version, or as `FmuPlant`.
    BuildError
        The FMU cannot be built, or what runs it is not installed.
    """
    if kind in ("model", "scipy"):
        if fmu is not None:
            raise PlantError(f"plant {kind!r} does not accept the file {fmu}; choose the plant fmu2 or fmu3")
        from gough_stewart.harness.plants.model import ModelPlant

        integrator: Integrator = "compiled" if kind == "model" else "scipy"
        with ModelPlant(platform, start, tolerance, fixed_step_size, integrator) as model:
            yield model
        return
    if kind not in FMI_VERSIONS:
        raise PlantError(f"plant is {kind!r}; expected one of {', '.join(get_args(PlantKind))}")
    version = FMI_VERSIONS[kind]
    if fmu is None:
        from gough_stewart.harness.plants.fmu import FmuPlant

        with FmuPlant(
            _cached_unit(cached_build(version, progress, Variant.of(platform))),
            platform,
            start,
            tolerance,
            fixed_step_size,
        ) as built:
            yield built
        return
    with IsolatedFmu(fmu, platform, start, tolerance, fixed_step_size) as unit:
        if unit.fmi_version != version:
            raise PlantError(f"{fmu}: is FMI {unit.fmi_version}; expected FMI {version} for the plant {kind}")
        yield unit


@cache
def _cached_unit(path: Path) -> "UnitFile":
    """The FMU of the cache, unpacked once for all runs of this process."""
    from gough_stewart.harness.plants.unit import UnitFile

    file = UnitFile(path)
    atexit.register(file.close)
    return file
