"""The tests of a folder: its own, and those of the folders that use it most."""

from pathlib import Path

# Default folders of `make mutants`.
DEFAULT_FOLDERS = ("model", "fmu_build/c", "harness/loop", "harness/control", "harness/motion", "harness/plants")
# Loaded once, before the trials.
LIBRARIES = (
    *("pytest", "hypothesis", "numpy", "scipy.integrate", "scipy.linalg", "scipy.optimize", "scipy.spatial.transform"),
    *("casadi", "control", "fmpy", "lxml.etree", "pydantic"),
)
# Loaded after them, from the copy; contains no mutants of the folder.
_READY = {"harness": ("tools.mutants.ready",)}
# Tests in addition to the folder's mirror in tests/. Other folders have only their mirror.
_NEARBY = {
    "fmu_build/c": ("tests/harness/export/test_fmu.py", "tests/harness/export/test_fmu_samples.py"),
    "harness/loop": ("tests/harness/experiment",),
    "harness/control": ("tests/harness/loop", "tests/harness/experiment"),
    "harness/motion": ("tests/harness/loop", "tests/harness/experiment"),
    "harness/plants": ("tests/harness/loop", "tests/harness/experiment"),
}
# Scripts are tested in a browser only.
_IN_BROWSER = {
    "harness/view/web": ("tests/harness/view/test_in_browser.py",),
    "harness/workspace/web": ("tests/harness/workspace/test_in_browser.py",),
    "harness/output/web": ("tests/harness/view/test_in_browser.py", "tests/harness/workspace/test_in_browser.py"),
}


def loaded_for(folder: str) -> tuple[str, ...]:
    """Modules of the repository that do not depend on a folder, to load before its trials."""
    return _READY.get(Path(folder).parts[0], ())


def tests_of(folder: str, root: Path) -> tuple[str, ...]:
    """Tests of sources: their mirror or that of a folder above, and related ones."""
    if Path(folder).as_posix() in _IN_BROWSER:
        return _IN_BROWSER[Path(folder).as_posix()]
    for above in (Path(folder), *Path(folder).parents):
        if above != Path() and (root / "tests" / above).is_dir():
            nearby = _NEARBY.get(Path(folder).as_posix(), ())
            return (f"tests/{above.as_posix()}", *(each for each in nearby if (root / each).exists()))
    raise LookupError(f"no folder of tests for {folder}; expected tests/{folder}; select tests with --tests")
