"""Which tests see a folder: its own, and those of rooms that use it most."""

from pathlib import Path

# What `make mutants` tries when it is not asked for something else.
DEFAULT_FOLDERS = ("model", "fmu_build/c", "harness/loop", "harness/control", "harness/motion", "harness/plants")
# Loaded once, before the trials.
LIBRARIES = (
    *("pytest", "hypothesis", "numpy", "scipy.integrate", "scipy.linalg", "scipy.optimize", "scipy.spatial.transform"),
    *("casadi", "control", "fmpy", "lxml.etree", "pydantic"),
)
# Loaded after them, from the copy; no mutant of the folder is in it.
_READY = {"harness": ("tools.mutants.ready",)}
# Beside the folder's mirror in tests/. Folders that are not here have their mirror alone.
_NEARBY = {
    "fmu_build/c": ("tests/harness/export/test_fmu.py", "tests/harness/export/test_fmu_samples.py"),
    "harness/loop": ("tests/harness/experiment",),
    "harness/control": ("tests/harness/loop", "tests/harness/experiment"),
    "harness/motion": ("tests/harness/loop", "tests/harness/experiment"),
    "harness/plants": ("tests/harness/loop", "tests/harness/experiment"),
}
# Scripts are seen in a browser alone.
_IN_BROWSER = {
    "harness/view/web": ("tests/harness/view/test_in_browser.py",),
    "harness/workspace/web": ("tests/harness/workspace/test_in_browser.py",),
    "harness/output/web": ("tests/harness/view/test_in_browser.py", "tests/harness/workspace/test_in_browser.py"),
}


def loaded_for(folder: str) -> tuple[str, ...]:
    """Modules of the repository that do not depend on a folder, for its trials to begin with."""
    return _READY.get(Path(folder).parts[0], ())


def tests_of(folder: str, root: Path) -> tuple[str, ...]:
    """Tests that see one of the sources: its mirror or that of a folder above, and nearby ones."""
    if Path(folder).as_posix() in _IN_BROWSER:
        return _IN_BROWSER[Path(folder).as_posix()]
    for above in (Path(folder), *Path(folder).parents):
        if above != Path() and (root / "tests" / above).is_dir():
            nearby = _NEARBY.get(Path(folder).as_posix(), ())
            return (f"tests/{above.as_posix()}", *(each for each in nearby if (root / each).exists()))
    raise LookupError(f"no folder of tests for {folder}; expected tests/{folder}, or name some by --tests")
