"""Start values and tokens written into a compiled library: units of the same code differ in one block of bytes."""

import struct
from collections.abc import Iterator
from hashlib import sha256
from typing import NamedTuple

from gough_stewart.fmu_build.errors import BuildError

_MACH_O, _CODE_SIGNATURE = 0xFEEDFACF, 0x1D
_SUPER_BLOB, _CODE_DIRECTORY, _SHA_256 = 0xFADE0CC0, 0xFADE0C02, 2


def stamped(library: bytes, blank: bytes, block: bytes) -> bytes:
    """A library in which a block of the same size stands for the blank one, signed anew if it was signed.

    Parameters
    ----------
    library
        ELF, PE or Mach-O for one processor.
    blank, block
        See `tables.start_block`.

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
    at = library.index(blank)
    return with_page_digests(library[:at] + block + library[at + len(block) :])


def with_page_digests(library: bytes) -> bytes:
    """A Mach-O library whose ad-hoc signature has the digests of its pages as they are; others without a change.

    Apple's arm64 systems do not load a page whose SHA-256 differs from that in the signature's code directory
    [xnu, osfmk/kern/cs_blobs.h].
    """
    found = bytearray(library)
    for directory in _code_directories(library):
        for k, at in enumerate(range(0, directory.limit, directory.page)):
            digest = sha256(library[at : min(at + directory.page, directory.limit)]).digest()
            place = directory.digests + k * directory.size
            found[place : place + directory.size] = digest[: directory.size]
    return bytes(found)


class _CodeDirectory(NamedTuple):
    digests: int  # offset of the first page's
    size: int  # of a digest
    page: int  # bytes
    limit: int  # of the signed bytes


def _code_directories(library: bytes) -> Iterator[_CodeDirectory]:
    """The code directories of a Mach-O library's signature, if it has one."""
    if len(library) < 32 or struct.unpack_from("<I", library)[0] != _MACH_O:
        return
    (commands,) = struct.unpack_from("<I", library, 16)
    at = 32
    for _ in range(commands):
        kind, size = struct.unpack_from("<II", library, at)
        if kind == _CODE_SIGNATURE:
            (signature,) = struct.unpack_from("<I", library, at + 8)
            yield from _directories_at(library, signature)
        at += size


def _directories_at(library: bytes, signature: int) -> Iterator[_CodeDirectory]:
    magic, _length, count = struct.unpack_from(">III", library, signature)
    if magic != _SUPER_BLOB:
        raise BuildError(f"the library's signature begins with {magic:#x}; expected {_SUPER_BLOB:#x}")
    for k in range(count):
        (offset,) = struct.unpack_from(">I", library, signature + 16 + 8 * k)
        at = signature + offset
        numbers = struct.unpack_from(">9I4B", library, at)
        if numbers[0] != _CODE_DIRECTORY:
            continue
        first, limit, size, kind, page = numbers[4], numbers[8], numbers[9], numbers[10], 1 << numbers[12]
        if kind != _SHA_256:
            raise BuildError(f"the library's signature has digests of kind {kind}; expected SHA-256, kind {_SHA_256}")
        yield _CodeDirectory(at + first, size, page, limit)
