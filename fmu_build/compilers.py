"""Which C compiler makes a unit: `$CC`, else zig, which compiles for every target, else one of the system's.

zig comes before the system's compilers, since its units also run on older systems.
"""

import os
import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from gough_stewart.fmu_build.errors import COMPILER, BuildError
from gough_stewart.fmu_build.targets import Target
from gough_stewart.model.process.prebuilt import this_machine

_SYSTEMS = ("cc", "gcc", "clang", "cl")
# zig's default order of instructions there, of a small processor, spills more: a quarter more code after deflate.
_UNORDERED = {"aarch64-linux": ("-mllvm", "-enable-misched=false")}
_REMEDY = "pip install 'gough-stewart[compile]' brings one for every target"


class Compiler(NamedTuple):
    """A command, and what the bytes of its output depend on."""

    command: tuple[str, ...]
    identity: str
    is_zig: bool = False

    def commands(
        self, library: str, files: Sequence[str], include: str, target: Target, flags: Sequence[str]
    ) -> list[list[str]]:
        """The commands that compile files to a shared library, each in the same folder.

        zig builds the C library of Windows anew for each kind of processor, in minutes; so only the files are compiled
        for that.
        """
        if not (self.is_zig and target.suffix == ".dll" and any(flag.startswith("-mcpu=") for flag in flags)):
            return [self._link(library, files, include, target, flags)]
        plain = [flag for flag in flags if flag not in ("-shared", "-s")]
        objects = [f"{k}.obj" for k in range(len(files))]
        compiled = [
            [*self.command, "-target", target.triple, *plain, "-I", include, "-c", file, "-o", made]
            for file, made in zip(files, objects, strict=True)
        ]
        general = [flag for flag in flags if not flag.startswith("-mcpu=")]
        return [*compiled, self._link(library, objects, include, target, general)]

    def _link(
        self, library: str, files: Sequence[str], include: str, target: Target, flags: Sequence[str]
    ) -> list[str]:
        if self.is_zig:
            aim = (
                "-target",
                target.triple,
                *flags,
                *_UNORDERED.get(target.name, ()),
                *target.flags_of(Path(library).stem),
            )
            return [*self.command, *aim, "-I", include, *files, "-o", library, "-lm"]
        if Path(self.command[0]).stem.lower() == "cl":
            options = ("/nologo", "/LD", "/O2", "/std:c11", "/fp:precise", "/MT")
            return [*self.command, *options, "/I", include, *files, f"/Fe:{library}"]
        own = (flag for flag in flags if not (flag == "-s" and target.suffix == ".dylib"))
        aim = (*own, *target.flags_of(Path(library).stem))
        return [*self.command, *aim, "-I", include, *files, "-o", library, "-lm"]


def zig() -> Compiler:
    """The compiler of the extra `compile`.

    Raises
    ------
    BuildError
        It is not installed.
    """
    if find_spec(COMPILER) is None:
        raise BuildError(f"not installed: {COMPILER} (to compile); install the extra: {_REMEDY}")
    command = (sys.executable, "-m", COMPILER, "cc")
    return Compiler(command, f"{COMPILER} {metadata.version(COMPILER)} {_UNORDERED}", is_zig=True)


def compiler_of(target: Target, environment: Mapping[str, str] | None = None) -> Compiler:
    """The compiler of a unit for a target; compilers of the system compile for this machine only.

    Raises
    ------
    BuildError
        `CC` names no program, or there is no compiler.
    """
    chosen = shlex.split((os.environ if environment is None else environment).get("CC", ""))
    is_here = target.name == this_machine()
    if is_here and chosen:
        found = shutil.which(chosen[0])
        if found is None:
            raise BuildError(f"the environment variable CC is '{' '.join(chosen)}'; expected a C compiler, or unset it")
        return _of_the_system(found, chosen[1:])
    if find_spec(COMPILER) is not None:
        return zig()
    paths = filter(None, map(shutil.which, _SYSTEMS if is_here else ()))
    path = next(paths, None)
    if path is None:
        looked = f"CC, zig, {', '.join(_SYSTEMS)}" if is_here else "zig"
        raise BuildError(f"no C compiler for {target.name} was found ({looked}); {_REMEDY}")
    return _of_the_system(path, ())


def _of_the_system(path: str, options: Sequence[str]) -> Compiler:
    """A compiler by the path of its program, known by size and time of that."""
    found = Path(path).resolve().stat()
    return Compiler((path, *options), f"{path} {' '.join(options)} {found.st_size} {found.st_mtime_ns}")
