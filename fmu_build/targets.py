"""Systems for which binaries can be built."""

from collections.abc import Iterable
from dataclasses import dataclass

from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.model.process.installed import this_machine


@dataclass(frozen=True)
class Target:
    """One operating system on one processor."""

    name: str  # FMI 3.0's platform tuple, and its folder under binaries/
    triple: str  # for zig, with the oldest supported C library or system
    fmi2_folder: str
    suffix: str

    def flags_of(self, library: str) -> tuple[str, ...]:
        """Compiler flags for a library of this name."""
        if self.suffix == ".dylib":
            return (f"-Wl,-install_name,@rpath/{library}.dylib",)
        return ("-fPIC",) if self.suffix == ".so" else ()


TARGETS = (
    Target("x86_64-linux", "x86_64-linux-gnu.2.17", "linux64", ".so"),
    Target("aarch64-linux", "aarch64-linux-gnu.2.17", "aarch64-linux", ".so"),
    Target("x86_64-windows", "x86_64-windows-gnu", "win64", ".dll"),
    Target("x86_64-darwin", "x86_64-macos.10.15", "darwin64", ".dylib"),
    Target("aarch64-darwin", "aarch64-macos.11.0", "darwin64", ".dylib"),
)
BY_NAME = {target.name: target for target in TARGETS}
# Of live pages; no units are built for it.
WEB_ASSEMBLY = Target("WebAssembly", "wasm32-wasi", "", ".wasm")


def native() -> Target:
    """The target of this machine.

    Raises
    ------
    BuildError
        This machine is not among the targets.
    """
    name = this_machine()
    if name not in BY_NAME:
        raise BuildError(f"this machine is {name}; expected one of {', '.join(BY_NAME)}; choose targets by name")
    return BY_NAME[name]


def chosen_targets(names: Iterable[str]) -> tuple[Target, ...]:
    """Targets by name, `native` or `all`, without duplicates, in the order of the table.

    Raises
    ------
    BuildError
        An unknown name, or none.
    """
    requested = set[Target]()
    for name in [names] if isinstance(names, str) else names:
        if name not in ("native", "all", *BY_NAME):
            raise BuildError(f"no target '{name}'; expected native, all, or one of {', '.join(BY_NAME)}")
        requested.update(TARGETS if name == "all" else [native() if name == "native" else BY_NAME[name]])
    if not requested:
        raise BuildError("no target; expected native, all, or one of " + ", ".join(BY_NAME))
    return tuple(target for target in TARGETS if target in requested)
