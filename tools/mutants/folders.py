"""The tests of a folder: its own, and those of the folders that use it most."""

from pathlib import Path

_TREES = ("model", "fmu_build", "harness")
_COMPILED = "fmu_build/c"
# Loaded once, before the trials.
LIBRARIES = (
    *("pytest", "hypothesis", "numpy", "scipy.integrate", "scipy.linalg", "scipy.optimize", "scipy.spatial.transform"),
    *("casadi", "control", "fmpy", "lxml.etree", "pydantic"),
)
# Loaded after them, from the copy; contains no mutants of the folder.
_READY = {"harness": ("tools.mutants.ready",)}
# Tests in addition to the folder's mirror in tests/. Other folders have only their mirror.
_NEARBY = {
    "fmu_build/c": (
        "tests/harness/export/test_fmu.py",
        "tests/harness/export/test_fmu_samples.py",
        "tests/harness/plants/test_lanes.py",  # the only users of c/lanes
        "tests/harness/loop/test_compiled_loop.py",  # of c/loop
        "tests/harness/results/test_folds.py",  # of c/folds
    ),
    "harness": ("tests/test_wrong_arguments.py",),
    "harness/loop": (
        "tests/harness/control/test_controllers_at_work.py",
        "tests/harness/experiment/test_options_together.py",
        "tests/harness/experiment/test_truth_and_belief.py",
        # of the folds over rows
        "tests/harness/results/test_folds.py",
        "tests/harness/results/test_bands.py",
        "tests/harness/results/test_metrics.py",
    ),
    "harness/control": (
        "tests/harness/loop",
        "tests/harness/ensemble/test_memory.py",
        "tests/harness/experiment/test_frf.py",
        "tests/harness/experiment/test_named_files.py",
        "tests/harness/experiment/test_options_together.py",
        "tests/harness/experiment/test_truth_and_belief.py",
    ),
    "harness/control/python": ("tests/harness/ensemble/test_memory.py", "tests/harness/experiment/test_named_files.py"),
    "harness/experiment": (
        "tests/harness/control/test_whole_responses.py",
        "tests/harness/ensemble/test_chunks.py",
        "tests/harness/ensemble/test_python_controllers.py",
    ),
    **{
        f"harness/identify/{room}": ("tests/harness/identify",)
        for room in ("diagnosis", "geometry", "rows", "screening")
    },
    **{f"harness/motion/{room}": ("tests/harness/motion",) for room in ("limits", "paths", "recorded")},
    "model": ("tests/model/formulations",),
    "model/process": ("tests/model/test_platform_toml.py",),
}
# Scripts are tested in a browser only.
_IN_BROWSER = {
    "harness/report/web": (
        "tests/harness/view/test_charts_in_browser.py",
        "tests/harness/view/test_in_browser.py",
        "tests/harness/workspace/test_in_browser.py",
    ),
}


def rooms(root: Path) -> tuple[str, ...]:
    """Folders that are measured by themselves: packages, the C of units, the scripts of pages."""
    inside = {folder for tree in _TREES for folder in (root / tree, *(root / tree).rglob("*")) if folder.is_dir()}
    names = {folder.relative_to(root).as_posix(): folder for folder in inside}
    return tuple(
        name
        for name, folder in sorted(names.items())
        if name == _COMPILED
        or any(folder.glob("*.js"))
        or {path.name for path in folder.glob("*.py")} - {"__init__.py"}
    )


def is_of_another_room(file: Path, folder: str, all_rooms: tuple[str, ...]) -> bool:
    """Whether a file below a folder belongs to a room inside it."""
    parents = {parent.as_posix() for parent in file.parents}
    return any(Path(folder) in Path(room).parents and room in parents for room in all_rooms)


def loaded_for(folder: str) -> tuple[str, ...]:
    """Modules of the repository that do not depend on a folder, to load before its trials."""
    return _READY.get(Path(folder).parts[0], ()) if Path(folder).as_posix() not in _TREES else ()


def tests_of(folder: str, root: Path) -> tuple[str, ...]:
    """Tests of sources: their mirror or that of a folder above, and related ones.

    Of a room with rooms inside, such as `harness`, only the tests beside those of the inner rooms.
    """
    name = Path(folder).as_posix()
    if name in _IN_BROWSER:
        return _IN_BROWSER[name]
    for above in (Path(folder), *Path(folder).parents):
        if above != Path() and (mirror := root / "tests" / above).is_dir():
            nearby = tuple(each for each in _NEARBY.get(name, ()) if (root / each).exists())
            if above.as_posix() in _TREES and above == Path(folder):
                return (*(path.relative_to(root).as_posix() for path in sorted(mirror.glob("test_*.py"))), *nearby)
            return (f"tests/{above.as_posix()}", *nearby)
    raise LookupError(f"no folder of tests for {folder}; expected tests/{folder}; select tests with --tests")
