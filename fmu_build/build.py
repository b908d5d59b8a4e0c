"""Build units: generate sources and documents, compile, write start values into libraries and the archives atomically.

Units of the same code differ in one block of bytes of their libraries only.
"""

import io
import os
import struct
import zipfile
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from itertools import repeat
from pathlib import Path
from threading import Event

from gough_stewart.fmu_build.cache import BuildError, digest_of_texts
from gough_stewart.fmu_build.component import UnitComponent
from gough_stewart.fmu_build.documents import installed_package, model_description, rendered, terminals_and_icons
from gough_stewart.fmu_build.mjcf import mjcf
from gough_stewart.fmu_build.plant.plant_component import plant_component
from gough_stewart.fmu_build.sources import model_source, sources, standard_headers, start_block
from gough_stewart.fmu_build.toolchain import FLAGS, Library, Target, chosen_names, chosen_targets, compiler_of
from gough_stewart.model.platform import Platform, load_preset
from gough_stewart.model.process.files import check_output_folder, write_files
from gough_stewart.model.process.installed import prebuilt
from gough_stewart.model.process.progress import StepProgress

VERSIONS = ("2.0", "3.0")
# What the plant can be built as.
FORMS = ("fmu", "mjcf")
DEFAULT_PRESET = "liu2000"
# The earliest date that the zip format can represent.
_DATE = (1980, 1, 1, 0, 0, 0)
_FIRST = "modelDescription.xml"


def build(
    out: Path | str = ".",
    *,
    forms: Iterable[str] = ("fmu",),
    fmi: Iterable[str] = VERSIONS,
    targets: Iterable[str] = ("native",),
    platform: Platform | None = None,
    progress: StepProgress | None = None,
) -> list[Path]:
    """Build the FMUs `gough_stewart_fmi2.fmu` and `gough_stewart_fmi3.fmu`, or a model for MuJoCo; all files or none.

    Parameters
    ----------
    out
        Output folder; created if needed.
    forms
        "fmu"; "mjcf" for `NAME.xml`, the platform as MuJoCo loads it, in which a comment says what it leaves out.
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
        The files written, one for each version, and the model.

    Raises
    ------
    BuildError
        An unknown form, version or target, a package that is not installed, or a compiler error.
    OutputError
        The files cannot be written there.

    See Also
    --------
    SteppingModel, export, VARIABLES

    Examples
    --------
    >>> gs.build("fmus", fmi=["3.0"], targets=["x86_64-linux", "x86_64-windows"])
    >>> gs.build("models", forms=["mjcf"], platform=gs.load_preset("motion_base"))
    """
    forms, versions = chosen_names("form", forms, FORMS), chosen_names("FMI version", fmi, VERSIONS)
    platform = load_preset(DEFAULT_PRESET) if platform is None else platform
    models = dict([mjcf(platform)]) if "mjcf" in forms else {}
    units = versions if "fmu" in forms else None
    return build_units(
        plant_component(platform), out, fmi=units, targets=targets, progress=progress, extra_files=models
    )


def build_units(
    component: UnitComponent,
    out: Path | str,
    *,
    fmi: Iterable[str] | None = VERSIONS,  # None: no unit
    targets: Iterable[str] = ("native",),
    progress: StepProgress | None = None,
    extra_files: Mapping[str, bytes] | None = None,  # which are written with them
) -> list[Path]:
    """Build the units of a component, `STEM_fmi2.fmu` and `STEM_fmi3.fmu`; see `build` for arguments and errors."""
    folder, extra, systems = Path(out), extra_files or {}, chosen_targets(targets)
    versions = () if fmi is None else chosen_names("FMI version", fmi, VERSIONS)
    check_output_folder(folder, [*extra, *(f"{component.file_stem}_fmi{version[0]}.fmu" for version in versions)])
    contents = {**unit_archives(component, versions, systems, progress), **extra}
    write_files(folder, contents)
    return [folder / name for name in contents]


def unit_archives(
    component: UnitComponent, versions: Iterable[str], systems: Iterable[Target], progress: StepProgress | None = None
) -> dict[str, bytes]:
    """The units as archives, by file name; see `build` for errors.

    FMI 2.0 distinguishes operating systems only: Apple's two processors share a file, Linux's have a folder each.
    Importers on aarch64 Linux look in `aarch64-linux` or, as FMPy does, in `linux64`: if there is no library for
    x86_64, the one for aarch64 is in both.
    """
    report, systems, name = progress or (lambda _text: None), tuple(systems), component.identifier
    code, blank, stop = unit_library(component), start_block(component, None), Event()
    archives = dict[str, bytes]()

    def library(target: Target, version: str, block: bytes) -> bytes:
        carried = prebuilt(f"{target.name}/{code.name}", code.state)
        content = code.kept(target, stop, compiler_of(target)).read_bytes() if carried is None else carried.content
        content = stamped(content, blank, block)
        report(f"FMI {version}: {target.name}")
        return content

    for version in versions:
        report(f"FMI {version}: sources and documents")
        tokens, files = uncompiled_unit(component, version)

        # all libraries of this code are the same but for start values and tokens
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            compiled = pool.map(library, systems, repeat(version), repeat(start_block(component, tokens)))
            try:
                libraries = dict(zip(systems, compiled, strict=True))
            except BaseException:  # an interrupt or a failure: do not wait for the others
                stop.set()
                pool.shutdown(wait=False, cancel_futures=True)
                raise

        for target, content in libraries.items():
            folder = target.fmi2_folder if version == "2.0" else target.name
            files[f"binaries/{folder}/{name}{target.suffix}"] = content
        if version == "2.0":
            apple = {target.name: content for target, content in libraries.items() if target.suffix == ".dylib"}
            if len(apple) > 1:
                files[f"binaries/darwin64/{name}.dylib"] = universal_binary(apple)
            if arm := files.get(f"binaries/aarch64-linux/{name}.so"):
                files.setdefault(f"binaries/linux64/{name}.so", arm)
        archives[f"{component.file_stem}_fmi{version[0]}.fmu"] = to_zip(files)
    return archives


def uncompiled_unit(component: UnitComponent, fmi_version: str) -> tuple[tuple[str, str], dict[str, bytes]]:
    """Tokens of FMI 2.0 and 3.0, one of them empty, and a unit's files without libraries, by path in the archive."""
    blank, is_fmi2 = sources(component, fmi_version, ("", "")), fmi_version == "2.0"
    names = sorted(blank.units)
    description = model_description(component, fmi_version, "", names).decode()
    h = digest_of_texts(blank.files | {"modelDescription.xml": description})
    token = f"{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}"
    token = f"{{{token}}}" if is_fmi2 else token
    tokens = (token, "") if is_fmi2 else ("", token)
    code = blank.files | {"model.c": model_source(component, tokens)}
    build_description = rendered("buildDescription.xml", identifier=component.identifier, source_files=names)
    header = next(iter(standard_headers(fmi_version).values()))
    notice = header[header.index("Copyright") :].partition("*/")[0].rstrip(" -\n")
    files = {
        "modelDescription.xml": model_description(component, fmi_version, token, names),
        "documentation/licenses/license.txt": installed_package()[1].encode(),
        "documentation/licenses/fmi-headers.txt": f"{notice}\n".encode(),
        "terminalsAndIcons/terminalsAndIcons.xml": terminals_and_icons(component, fmi_version),
        "terminalsAndIcons/icon.png": component.icon.png,
        "terminalsAndIcons/icon.svg": component.icon.svg,
        "sources/buildDescription.xml": build_description,
        **{f"sources/{name}": text.encode() for name, text in code.items()},
        **component.documents(fmi_version),
    }
    if is_fmi2:
        files["model.png"] = component.icon.png
    return tokens, files


def unit_library(component: UnitComponent) -> Library:
    """The description of the library of all units of a component's code, without start values and tokens."""
    code = sources(component)
    state = sha256(f"{FLAGS}{digest_of_texts(code.files)}".encode()).hexdigest()[:24]
    return Library(component.identifier, lambda: code, state)


def number_of_steps(fmi: Iterable[str], targets: Iterable[str]) -> int:
    """Number of progress reports of `build_units`."""
    return len(chosen_names("FMI version", fmi, VERSIONS)) * (1 + len(chosen_targets(targets)))


def to_zip(contents: Mapping[str, bytes]) -> bytes:
    """A zip archive of files by path, the model description first; the same contents always give the same bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        for name in sorted(contents, key=lambda name: (name != _FIRST, name)):
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix on every system, since the permissions below are Unix ones
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, contents[name])
    return stream.getvalue()


_MACH_O, _UNIVERSAL, _CODE_SIGNATURE = 0xFEEDFACF, 0xCAFEBABE, 0x1D
_SUPER_BLOB, _CODE_DIRECTORY, _SHA_256 = 0xFADE0CC0, 0xFADE0C02, 2
# Processor and subtype in headers of Mach-O.
_PROCESSORS = {"x86_64-darwin": (0x01000007, 3), "aarch64-darwin": (0x0100000C, 0)}


def stamped(library: bytes, blank: bytes, block: bytes) -> bytes:
    """A library, ELF, PE or Mach-O, in which a block of the same size stands for the blank one, see `start_block`.

    Mach-O with an ad-hoc signature gets the digests of its new pages: Apple's arm64 systems do not load a page whose
    SHA-256 differs from that in the signature's code directory [xnu, osfmk/kern/cs_blobs.h]. `BuildError` if the
    library does not have the blank block once, or its signature is of another kind.
    """
    count = library.count(blank)
    if count != 1 or len(block) != len(blank):
        raise BuildError(
            f"the library has {count} blank blocks of {len(blank)} bytes for one of {len(block)} bytes; "
            "expected one of this size; delete the cache and build again"
        )
    content = bytearray(library.replace(blank, block))
    is_mach_o = len(content) >= 32 and struct.unpack_from("<I", content)[0] == _MACH_O
    signature, command = 0, 32
    for _ in range(struct.unpack_from("<I", content, 16)[0] if is_mach_o else 0):
        kind, size, offset = struct.unpack_from("<III", content, command)
        signature = offset if kind == _CODE_SIGNATURE else signature
        command += size
    if not signature:
        return bytes(content)

    magic, _length, count = struct.unpack_from(">III", content, signature)
    if magic != _SUPER_BLOB:
        raise BuildError(f"the library's signature begins with {magic:#x}; expected {_SUPER_BLOB:#x}")
    for k in range(count):
        directory = signature + struct.unpack_from(">I", content, signature + 16 + 8 * k)[0]
        if struct.unpack_from(">I", content, directory)[0] != _CODE_DIRECTORY:
            continue
        numbers = struct.unpack_from(">9I4B", content, directory)
        first, limit, size, kind, page = numbers[4], numbers[8], numbers[9], numbers[10], 1 << numbers[12]
        if kind != _SHA_256:
            raise BuildError(f"the library's signature has digests of kind {kind}; expected SHA-256, kind {_SHA_256}")
        for number, start in enumerate(range(0, limit, page)):
            place = directory + first + number * size
            content[place : place + size] = sha256(content[start : min(start + page, limit)]).digest()[:size]
    return bytes(content)


def universal_binary(libraries: Mapping[str, bytes]) -> bytes:
    """Mach-O file with a big-endian header and the libraries of several processors, by target."""
    power = 14  # 16 KiB, the page size of Apple's processors
    entries, content = b"", bytearray(1 << power)
    for target, library in libraries.items():
        content += bytes(-len(content) % (1 << power))
        entries += struct.pack(">IIIII", *_PROCESSORS[target], len(content), len(library), power)
        content += library
    header = struct.pack(">II", _UNIVERSAL, len(libraries)) + entries
    content[: len(header)] = header
    return bytes(content)
