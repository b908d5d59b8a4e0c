"""The cache of build results: the native FMU for running experiments, built once per state of this package."""

import tempfile
from dataclasses import replace
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from gough_stewart.fmu_build.archive import file_name
from gough_stewart.fmu_build.cache_files import cache_folder, digest_of, kept
from gough_stewart.fmu_build.errors import COMPILER, RUNNER
from gough_stewart.fmu_build.source_state import state_of_texts
from gough_stewart.fmu_build.targets import native
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.process.progress import StepProgress
from gough_stewart.model.variant import ELASTO_PLASTIC, IDEAL, Variant

# Packages on which the bytes of an FMU depend, besides the files of this package.
_PACKAGES = ("gough-stewart", "casadi", RUNNER, "latex2mathml", "numpy", "scipy", COMPILER)


def cached_build(fmi_version: str, progress: StepProgress | None = None, variant: Variant = IDEAL) -> Path:
    """The FMU of the paper's platform, or of another variant, for this machine.

    It comes from the cache if it was built from the same sources before.

    The cache stores its digest; a damaged FMU is rebuilt.

    Parameters
    ----------
    fmi_version
        "2.0" or "3.0".
    progress
        Called with the name of each step of a build.
    variant
        Whether its friction sticks and its legs give.

    Raises
    ------
    BuildError
        As `build`; or files in the cache differ from what was written.
    OSError
        The cache cannot be written.
    """

    def built() -> bytes:
        from gough_stewart.fmu_build.build import build  # imports CasADi, which a cached unit does not need

        with tempfile.TemporaryDirectory(prefix="gough-stewart-") as folder:
            return build(folder, fmi=[fmi_version], platform=platform_of(variant), progress=progress)[0].read_bytes()

    of = "-".join((state_of_sources(), native().name, *variant.parts))
    return kept(cache_folder() / "fmus" / of / file_name(fmi_version), built)


def platform_of(variant: Variant) -> Platform:
    """Any platform of a variant, the paper's if it is ideal: all its parameters are set when it runs."""
    changes: dict[str, Any] = (
        {"leg_friction_model": ELASTO_PLASTIC, "leg_coulomb_friction": 1.0} if variant.bristles else {}
    )
    changes |= {"leg_stiffness": 1e6, "leg_armature": 1.0} if variant.springs else {}
    return replace(load_preset("liu2000"), **changes)


@cache
def state_of_sources() -> str:
    """Digest of all source files of FMUs and of the versions of the packages that build them."""
    there = (version(each) if find_spec(each.replace("-", "_")) else "not installed" for each in _PACKAGES)
    versions = "".join(f"{package} {found}\n" for package, found in zip(_PACKAGES, there, strict=True))
    return digest_of(f"{versions}{state_of_texts()}".encode())[:24]
