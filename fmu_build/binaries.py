"""Changes of compiled libraries: start values and tokens written into one block, one file for Apple's two processors.

Units of the same code differ in that block of bytes only.
"""

import struct
from collections.abc import Iterator, Sequence
from hashlib import sha256

from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.targets import Target

_MACH_O, _UNIVERSAL, _CODE_SIGNATURE = 0xFEEDFACF, 0xCAFEBABE, 0x1D
_SUPER_BLOB, _CODE_DIRECTORY, _SHA_256 = 0xFADE0CC0, 0xFADE0C02, 2
# Processor and subtype in headers of Mach-O.
_PROCESSORS = {"x86_64-darwin": (0x01000007, 3), "aarch64-darwin": (0x0100000C, 0)}


def stamped(library: bytes, blank: bytes, block: bytes) -> bytes:
    """A library in which a block of the same size stands for the blank one, signed anew if it was signed.

    Parameters
    ----------
    library
        ELF, PE or Mach-O for one processor.
    blank, block
        See `sources.start_block`.

    Raises
    ------
    BuildError
        The library does not have the blank block once.
    """
    count = library.count(blank)
    if count != 1 or len(block) != len(blank):
        raise BuildError(
            f"the library has {count} blank blocks of {len(blank)} bytes for one of {len(block)} bytes; "
            "expected one of this size; delete the cache and build again"
        )
    return with_page_digests(library.replace(blank, block))


def with_page_digests(library: bytes) -> bytes:
    """A Mach-O library whose ad-hoc signature has the digests of its pages as they are; others without a change.

    Apple's arm64 systems do not load a page whose SHA-256 differs from that in the signature's code directory
    [xnu, osfmk/kern/cs_blobs.h].
    """
    signed = bytearray(library)
    for directory in _code_directories(library):
        numbers = struct.unpack_from(">9I4B", library, directory)
        first, limit, size, kind, page = numbers[4], numbers[8], numbers[9], numbers[10], 1 << numbers[12]
        if kind != _SHA_256:
            raise BuildError(f"the library's signature has digests of kind {kind}; expected SHA-256, kind {_SHA_256}")
        for k, start in enumerate(range(0, limit, page)):
            place = directory + first + k * size
            signed[place : place + size] = sha256(library[start : min(start + page, limit)]).digest()[:size]
    return bytes(signed)


def _code_directories(library: bytes) -> Iterator[int]:
    """Offsets of the code directories of a Mach-O library's signature, if it has one."""
    if len(library) < 32 or struct.unpack_from("<I", library)[0] != _MACH_O:
        return
    (commands,) = struct.unpack_from("<I", library, 16)
    command = 32
    for _ in range(commands):
        kind, size = struct.unpack_from("<II", library, command)
        if kind == _CODE_SIGNATURE:
            (signature,) = struct.unpack_from("<I", library, command + 8)
            magic, _length, count = struct.unpack_from(">III", library, signature)
            if magic != _SUPER_BLOB:
                raise BuildError(f"the library's signature begins with {magic:#x}; expected {_SUPER_BLOB:#x}")
            for k in range(count):
                directory = signature + struct.unpack_from(">I", library, signature + 16 + 8 * k)[0]
                if struct.unpack_from(">I", library, directory)[0] == _CODE_DIRECTORY:
                    yield directory
        command += size


def universal_binary(libraries: Sequence[tuple[Target, bytes]]) -> bytes:
    """Mach-O file with the libraries of several processors (as from `lipo -create`).

    The header is big-endian: magic, count; per library: processor, subtype, offset, size, alignment as a power of two.
    """
    power = 14  # 16 KiB, the page size of Apple's processors
    entries, content = b"", bytearray(1 << power)
    for target, library in libraries:
        content += bytes(-len(content) % (1 << power))
        entries += struct.pack(">IIIII", *_PROCESSORS[target.name], len(content), len(library), power)
        content += library
    header = struct.pack(">II", _UNIVERSAL, len(libraries)) + entries
    content[: len(header)] = header
    return bytes(content)
