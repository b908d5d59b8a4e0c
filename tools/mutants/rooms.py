"""Which tests see a file: its room's own, and those of rooms that use it most."""

from pathlib import Path

# What `make mutants` tries when it is not asked for something else.
DEFAULT_FOLDERS = ("model", "fmu_build/c", "harness/loop", "harness/control", "harness/motion", "harness/plants")
# Beside the folder's mirror in tests/. Folders that are not here have their mirror alone.
_NEARBY = {
    "harness/loop": ("tests/harness/experiment",),
    "harness/control": ("tests/harness/loop", "tests/harness/experiment"),
    "harness/motion": ("tests/harness/loop", "tests/harness/experiment"),
    "harness/plants": ("tests/harness/loop", "tests/harness/experiment"),
    "harness/output/web": ("tests/harness/view", "tests/harness/workspace"),
}


def tests_of(file: Path, root: Path) -> tuple[str, ...]:
    """Folders of tests that see a file, from the root of the repository: the mirror of its own or a folder above."""
    for folder in file.parents:
        if folder != Path() and (root / "tests" / folder).is_dir():
            nearby = _NEARBY.get(file.parent.as_posix(), ())
            return (f"tests/{folder.as_posix()}", *(each for each in nearby if (root / each).is_dir()))
    raise LookupError(
        f"no folder of tests for {file}; expected tests/{file.parent.as_posix()}, or name some by --tests"
    )
