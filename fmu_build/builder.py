"""Build the units of a component: generate sources and documents, compile, and write the archives atomically."""

import hashlib
import os
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from gough_stewart.fmu_build.archive import file_name, to_zip
from gough_stewart.fmu_build.cache_files import cache_folder, digest_of, kept
from gough_stewart.fmu_build.compilers import compiler_of
from gough_stewart.fmu_build.component import Component
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.fmi2_description import fmi2_description
from gough_stewart.fmu_build.fmi3_description import fmi3_description
from gough_stewart.fmu_build.model_description import Identity, build_description, terminals_and_icons
from gough_stewart.fmu_build.package import package_license
from gough_stewart.fmu_build.sources import Sources, library_sources, sources, standard_license
from gough_stewart.fmu_build.stamp import stamped
from gough_stewart.fmu_build.tables import start_block
from gough_stewart.fmu_build.targets import Target, chosen_targets
from gough_stewart.fmu_build.toolchain import FLAGS, compile_library, universal_binary
from gough_stewart.model.process.files import check_output_folder, write_files
from gough_stewart.model.process.prebuilt import prebuilt_content
from gough_stewart.model.process.progress import StepProgress

VERSIONS = ("2.0", "3.0")
_DESCRIPTIONS = {"2.0": fmi2_description, "3.0": fmi3_description}


@dataclass(frozen=True)
class Unit:
    """One FMU before it is compiled."""

    fmi_version: str
    token: str
    library: str  # its name without suffix
    sources: Sources
    documents: dict[str, bytes]  # by path in the archive


def build_units(
    component: Component,
    out: Path | str,
    *,
    fmi: Iterable[str] = VERSIONS,
    targets: Iterable[str] = ("native",),
    progress: StepProgress | None = None,
) -> list[Path]:
    """Build the units of a component, `STEM_fmi2.fmu` and `STEM_fmi3.fmu`; on an error, none is written.

    Parameters
    ----------
    component
        The component.
    out
        Output folder; created if needed.
    fmi
        FMI versions: "2.0", "3.0".
    targets
        Systems to build for: "native", "all", or names of `targets.TARGETS`.
    progress
        Called with the name of each step.

    Raises
    ------
    BuildError
        An unknown version or target, a package that is not installed, or a compiler error.
    OutputError
        The files cannot be written there.
    """
    folder = Path(out)
    versions, systems = chosen_versions(fmi), chosen_targets(targets)
    check_output_folder(folder, [file_name(version, component.file_stem) for version in versions])
    archives = unit_archives(component, versions, systems, progress)
    write_files(folder, archives)
    return [folder / name for name in archives]


def unit_archives(
    component: Component, versions: Iterable[str], systems: Iterable[Target], progress: StepProgress | None = None
) -> dict[str, bytes]:
    """The units as archives, by file name; see `build_units` for errors."""
    report, systems = progress or (lambda _text: None), tuple(systems)
    archives = {}
    for version in versions:
        report(f"FMI {version}: sources and documents")
        unit = unit_of(component, version)
        libraries = libraries_of(component, unit, systems, report)
        archives[file_name(version, component.file_stem)] = to_zip(contents(unit, libraries))
    return archives


def number_of_steps(fmi: Iterable[str], targets: Iterable[str]) -> int:
    """Number of progress reports of `build_units`."""
    return len(chosen_versions(fmi)) * (1 + len(chosen_targets(targets)))


def chosen_versions(fmi: Iterable[str]) -> tuple[str, ...]:
    """The requested versions, in order and without duplicates.

    Raises
    ------
    BuildError
        A version other than "2.0" and "3.0", or none.
    """
    requested = [fmi] if isinstance(fmi, str) else list(fmi)
    for version in requested:
        if version not in VERSIONS:
            raise BuildError(f"no FMI version '{version}'; expected {' or '.join(VERSIONS)}")
    if not requested:
        raise BuildError(f"no FMI version; expected {' or '.join(VERSIONS)}")
    return tuple(version for version in VERSIONS if version in requested)


def unit_of(component: Component, fmi_version: str) -> Unit:
    """Sources and documents of a unit; its token is a digest of the sources and the description."""
    describe = _DESCRIPTIONS[fmi_version]
    blank = sources(component, fmi_version, "")
    token = _token(blank, describe(component, Identity("", blank.unit_names)), fmi_version)
    own = sources(component, fmi_version, token)
    documents = {
        "modelDescription.xml": describe(component, Identity(token, own.unit_names)),
        "documentation/licenses/license.txt": package_license().encode(),
        "documentation/licenses/fmi-headers.txt": standard_license(fmi_version).encode(),
        "terminalsAndIcons/terminalsAndIcons.xml": terminals_and_icons(component, fmi_version),
        "terminalsAndIcons/icon.png": component.icon.png,
        "terminalsAndIcons/icon.svg": component.icon.svg,
        "sources/buildDescription.xml": build_description(component, own.unit_names),
        **{f"sources/{name}": text.encode() for name, text in {**own.units, **own.headers}.items()},
        **component.documents(fmi_version),
    }
    if fmi_version == "2.0":
        documents["model.png"] = component.icon.png
    return Unit(fmi_version, token, component.identifier, own, documents)


def contents(unit: Unit, libraries: Mapping[Target, bytes]) -> dict[str, bytes]:
    """Everything in the archive by its path."""
    if unit.fmi_version == "2.0":
        return unit.documents | _fmi2_binaries(unit.library, libraries)
    return unit.documents | {f"binaries/{t.name}/{unit.library}{t.suffix}": each for t, each in libraries.items()}


def _fmi2_binaries(name: str, libraries: Mapping[Target, bytes]) -> dict[str, bytes]:
    """FMI 2.0 distinguishes operating systems only: Apple's two processors share a file, Linux's have a folder each.

    Importers on aarch64 Linux look in `aarch64-linux` or, as FMPy does, in `linux64`: if there is no library for
    x86_64, the one for aarch64 is in both.
    """
    files, apple = {}, []
    for target, library in libraries.items():
        if target.fmi2_folder == "darwin64":
            apple.append((target, library))
        else:
            files[f"binaries/{target.fmi2_folder}/{name}{target.suffix}"] = library
    if apple:
        whole = apple[0][1] if len(apple) == 1 else universal_binary(apple)
        files[f"binaries/darwin64/{name}.dylib"] = whole
    if f"binaries/aarch64-linux/{name}.so" in files:
        files.setdefault(f"binaries/linux64/{name}.so", files[f"binaries/aarch64-linux/{name}.so"])
    return files


def libraries_of(
    component: Component, unit: Unit, targets: Iterable[Target], report: StepProgress
) -> dict[Target, bytes]:
    """The compiled libraries of a unit: those of its code, kept once they are compiled, with its start values."""
    own, stop = library_sources(component), Event()
    state = _state(unit.library, own)
    blank = start_block(component, None)
    block = start_block(component, (unit.token, "") if unit.fmi_version == "2.0" else ("", unit.token))

    def library(target: Target) -> bytes:
        content = prebuilt_content(f"{target.name}/{unit.library}", state)
        if content is None:
            compiler = compiler_of(target)

            def compiled() -> bytes:
                return compile_library(unit.library, own.units, own.headers, target, stop, compiler=compiler)

            key = digest_of(f"{state} {compiler.identity}".encode())[:24]
            path = cache_folder() / "libraries" / f"{key}-{target.name}" / f"{unit.library}{target.suffix}"
            content = kept(path, compiled).read_bytes()
        found = stamped(content, blank, block)
        report(f"FMI {unit.fmi_version}: {target.name}")
        return found

    targets = tuple(targets)
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        compiled = pool.map(library, targets)
        try:
            return dict(zip(targets, compiled, strict=True))
        except BaseException:  # an interrupt or a failure: do not wait for the others
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _state(library: str, own: Sources) -> str:
    """A digest of what the bytes of a library depend on, besides target and compiler."""
    texts = (f"{name}\0{text}\0" for name, text in sorted({**own.units, **own.headers}.items()))
    return digest_of("".join([library, *FLAGS, *texts]).encode())[:24]


def blank_state(component: Component) -> str:
    """The state of the sources of a component's library, see `prebuilt`."""
    return _state(component.identifier, library_sources(component))


def blank_library(component: Component, target: Target) -> bytes:
    """The library of a component without start values and tokens; see `toolchain.compile_library` for errors."""
    own = library_sources(component)
    return compile_library(component.identifier, own.units, own.headers, target)


def _token(own: Sources, description: bytes, fmi_version: str) -> str:
    digest = hashlib.sha256(description)
    for name, text in sorted({**own.units, **own.headers}.items()):
        digest.update(f"{name}\0{text}\0".encode())
    h = digest.hexdigest()
    uuid = f"{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}"
    return f"{{{uuid}}}" if fmi_version == "2.0" else uuid
