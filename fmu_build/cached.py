"""The native FMU for running experiments, built once per state of this package."""

import tempfile
from dataclasses import replace
from pathlib import Path

from gough_stewart.fmu_build.cache import cache_folder, kept, state_of_sources
from gough_stewart.model.interface import ELASTO_PLASTIC, IDEAL, Variant
from gough_stewart.model.platform import Platform, load_preset
from gough_stewart.model.process.installed import this_machine
from gough_stewart.model.process.progress import StepProgress


def cached_build(fmi_version: str, progress: StepProgress | None = None, variant: Variant = IDEAL) -> Path:
    """The FMU of the paper's platform, or of another variant, for this machine; see `build` and `kept` for errors."""

    def built() -> bytes:
        from gough_stewart.fmu_build.build import build  # imports what a cached unit does not need

        with tempfile.TemporaryDirectory(prefix="gough-stewart-") as folder:
            return build(folder, fmi=[fmi_version], platform=platform_of(variant), progress=progress)[0].read_bytes()

    state = "-".join((state_of_sources(), this_machine(), *variant.parts))
    return kept(cache_folder() / "fmus" / state / f"gough_stewart_fmi{fmi_version[0]}.fmu", built)


def platform_of(variant: Variant) -> Platform:
    """Any platform of a variant, the paper's if it is ideal: all its parameters are set when it runs."""
    platform = load_preset("liu2000")
    if variant.bristles:
        platform = replace(platform, leg_friction_model=ELASTO_PLASTIC, leg_coulomb_friction=1.0)
    if variant.springs:
        platform = replace(platform, leg_stiffness=1e6, leg_armature=1.0)
    return platform
