"""Build the FMU: sources and documents purely, then compile, then write the archive whole."""

import hashlib
import os
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from gough_stewart.fmu_build.archive import file_name, to_zip
from gough_stewart.fmu_build.companions import build_description, terminals_and_icons
from gough_stewart.fmu_build.documentation import documentation_page
from gough_stewart.fmu_build.drawing import icon_png, icon_svg
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.fmi2_description import fmi2_description
from gough_stewart.fmu_build.fmi3_description import fmi3_description
from gough_stewart.fmu_build.model_description import Identity
from gough_stewart.fmu_build.package import package_license
from gough_stewart.fmu_build.reference_results import ReferenceRuns, reference_files, reference_runs
from gough_stewart.fmu_build.sources import Sources, sources, standard_headers, standard_license
from gough_stewart.fmu_build.targets import Target, chosen_targets
from gough_stewart.fmu_build.toolchain import LIBRARY, compile_library, universal_binary
from gough_stewart.model.files import check_output_folder, write_files
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.progress import StepProgress

VERSIONS = ("2.0", "3.0")
DEFAULT_PRESET = "liu2000"
_DESCRIPTIONS = {"2.0": fmi2_description, "3.0": fmi3_description}


@dataclass(frozen=True)
class Unit:
    """One FMU before it is compiled."""

    fmi_version: str
    sources: Sources
    documents: dict[str, bytes]  # by path in the archive


def build(
    out: Path | str = ".",
    *,
    fmi: Iterable[str] = VERSIONS,
    targets: Iterable[str] = ("native",),
    platform: Platform | None = None,
    progress: StepProgress | None = None,
) -> list[Path]:
    """Write `gough_stewart_fmi2.fmu` and `gough_stewart_fmi3.fmu`; both, or none on an error.

    Parameters
    ----------
    out
        Folder, made if needed.
    fmi
        "2.0", "3.0".
    targets
        Systems that the FMU shall run on: "native", "all", or "x86_64-linux", "aarch64-linux", "x86_64-windows",
        "x86_64-darwin", "aarch64-darwin".
    platform
        Gives the start values of the parameters; the paper's by default. Others can be set at run time.
    progress
        Called with what is being done.

    Raises
    ------
    BuildError
        An unknown version or target, or the compiler's complaint.
    OutputError
        The files cannot be written there.

    Examples
    --------
    >>> gs.build("fmus", fmi=["3.0"], targets=["x86_64-linux", "x86_64-windows"])
    """
    folder, told = Path(out), progress or (lambda _text: None)
    if platform is not None and not isinstance(platform, Platform):
        raise BuildError(f"platform is {platform!r}; expected a Platform, such as load_preset('liu2000')")
    versions, systems = chosen_versions(fmi), chosen_targets(targets)
    chosen = load_preset(DEFAULT_PRESET) if platform is None else platform
    check_output_folder(folder, [file_name(version) for version in versions])
    archives, runs = {}, reference_runs(chosen)
    for version in versions:
        told(f"FMI {version}: sources and documents")
        unit = unit_of(chosen, version, runs)
        libraries = _compile(unit, systems, told)
        archives[file_name(version)] = to_zip(contents(unit, libraries))
    write_files(folder, archives)
    return [folder / name for name in archives]


def number_of_steps(fmi: Iterable[str], targets: Iterable[str]) -> int:
    """How often `build` reports progress."""
    return len(chosen_versions(fmi)) * (1 + len(chosen_targets(targets)))


def chosen_versions(fmi: Iterable[str]) -> tuple[str, ...]:
    """Versions, each once, in order.

    Raises
    ------
    BuildError
        Another than "2.0" and "3.0", or none.
    """
    wanted = [fmi] if isinstance(fmi, str) else list(fmi)
    for version in wanted:
        if version not in VERSIONS:
            raise BuildError(f"no FMI version '{version}'; expected {' or '.join(VERSIONS)}")
    if not wanted:
        raise BuildError(f"no FMI version; expected {' or '.join(VERSIONS)}")
    return tuple(version for version in VERSIONS if version in wanted)


def unit_of(platform: Platform, fmi_version: str, runs: ReferenceRuns) -> Unit:
    """Sources and documents of a unit, with reference results; its token is a digest of sources and description."""
    describe = _DESCRIPTIONS[fmi_version]
    blank = sources(platform, fmi_version, "")
    token = _token(blank, describe(platform, Identity("", blank.unit_names)), fmi_version)
    own = sources(platform, fmi_version, token)
    description = describe(platform, Identity(token, own.unit_names))
    icon = icon_png(platform)
    documents = {
        "modelDescription.xml": description,
        "documentation/index.html": documentation_page(platform, fmi_version),
        "documentation/licenses/license.txt": package_license().encode(),
        "documentation/licenses/fmi-headers.txt": standard_license(fmi_version).encode(),
        "terminalsAndIcons/terminalsAndIcons.xml": terminals_and_icons(fmi_version),
        "terminalsAndIcons/icon.png": icon,
        "terminalsAndIcons/icon.svg": icon_svg(platform),
        "sources/buildDescription.xml": build_description(own.unit_names),
        **{f"sources/{name}": text.encode() for name, text in {**own.units, **own.headers}.items()},
        **reference_files(runs, fmi_version),
    }
    if fmi_version == "2.0":
        documents["model.png"] = icon
    return Unit(fmi_version, own, documents)


def contents(unit: Unit, libraries: Mapping[Target, bytes]) -> dict[str, bytes]:
    """Everything in the archive by its path."""
    return unit.documents | (_fmi2_binaries(libraries) if unit.fmi_version == "2.0" else _fmi3_binaries(libraries))


def _fmi3_binaries(libraries: Mapping[Target, bytes]) -> dict[str, bytes]:
    return {f"binaries/{t.name}/{LIBRARY}{t.suffix}": library for t, library in libraries.items()}


def _fmi2_binaries(libraries: Mapping[Target, bytes]) -> dict[str, bytes]:
    """FMI 2.0 knows operating systems only: Apple's two processors share a file, Linux's have a folder each.

    Importers on aarch64 Linux look in `aarch64-linux` or, as FMPy does, in `linux64`: without a library for x86_64
    it is there as well.
    """
    files, apple = {}, []
    for target, library in libraries.items():
        if target.fmi2_folder == "darwin64":
            apple.append((target, library))
        else:
            files[f"binaries/{target.fmi2_folder}/{LIBRARY}{target.suffix}"] = library
    if apple:
        whole = apple[0][1] if len(apple) == 1 else universal_binary(apple)
        files[f"binaries/darwin64/{LIBRARY}.dylib"] = whole
    if f"binaries/aarch64-linux/{LIBRARY}.so" in files:
        files.setdefault(f"binaries/linux64/{LIBRARY}.so", files[f"binaries/aarch64-linux/{LIBRARY}.so"])
    return files


def _compile(unit: Unit, targets: Iterable[Target], told: StepProgress) -> dict[Target, bytes]:
    # those of both versions, so that the kernel is the same compilation for both
    headers = unit.sources.headers | standard_headers("2.0") | standard_headers("3.0")

    stop = Event()

    def library(target: Target) -> bytes:
        compiled = compile_library(unit.sources.units, headers, target, stop)
        told(f"FMI {unit.fmi_version}: {target.name}")
        return compiled

    targets = tuple(targets)
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        compiled = pool.map(library, targets)
        try:
            return dict(zip(targets, compiled, strict=True))
        except BaseException:  # an interrupt, or one that failed: nobody waits for the others
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _token(own: Sources, description: bytes, fmi_version: str) -> str:
    digest = hashlib.sha256(description)
    for name, text in sorted({**own.units, **own.headers}.items()):
        digest.update(f"{name}\0{text}\0".encode())
    h = digest.hexdigest()
    uuid = f"{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}"
    return f"{{{uuid}}}" if fmi_version == "2.0" else uuid
