"""Build the plant's FMU."""

from collections.abc import Iterable
from pathlib import Path

from gough_stewart.fmu_build.builder import VERSIONS, build_units
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.process.progress import StepProgress

DEFAULT_PRESET = "liu2000"


def build(
    out: Path | str = ".",
    *,
    fmi: Iterable[str] = VERSIONS,
    targets: Iterable[str] = ("native",),
    platform: Platform | None = None,
    progress: StepProgress | None = None,
) -> list[Path]:
    """Build the FMUs `gough_stewart_fmi2.fmu` and `gough_stewart_fmi3.fmu`; on an error, neither is written.

    Parameters
    ----------
    out
        Output folder; created if needed.
    fmi
        FMI versions: "2.0", "3.0".
    targets
        Systems to build for: "native", "all", or "x86_64-linux", "aarch64-linux", "x86_64-windows",
        "x86_64-darwin", "aarch64-darwin".
    platform
        The platform whose parameters are the start values; the paper's by default. They can be changed at run time.
    progress
        Called with the name of each step.

    Returns
    -------
    list of Path
        The files written, one for each version.

    Raises
    ------
    BuildError
        An unknown version or target, a package that is not installed, or a compiler error.
    OutputError
        The files cannot be written there.

    Examples
    --------
    >>> gs.build("fmus", fmi=["3.0"], targets=["x86_64-linux", "x86_64-windows"])
    """
    if platform is not None and not isinstance(platform, Platform):
        raise BuildError(f"platform is {platform!r}; expected a Platform, such as load_preset('liu2000')")
    component = plant_component(load_preset(DEFAULT_PRESET) if platform is None else platform)
    return build_units(component, out, fmi=fmi, targets=targets, progress=progress)
