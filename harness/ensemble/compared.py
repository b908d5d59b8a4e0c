"""Run two experiments over the same members and report their differences."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from gough_stewart.harness.ensemble.compare import Comparison, compare, compare_sheets, difference
from gough_stewart.harness.ensemble.ensemble import ensemble
from gough_stewart.harness.ensemble.files import worst_by, write_report
from gough_stewart.harness.ensemble.page import ensemble_page
from gough_stewart.harness.ensemble.sensitivity import sensitivity
from gough_stewart.harness.errors import ExperimentError, RecordError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.polars_paths import write_to
from gough_stewart.model.files import write_files

DIFFERENCES, PAGE = "differences.parquet", "compare.html"


def run_compared(
    experiments: tuple[Experiment, Experiment],
    names: tuple[str, str],
    folder: Path,
    say: Callable[[str], None],
    **options: Any,
) -> Comparison:
    """Run both over the first one's `[ensemble]` with the same seed; write both, their differences and a page.

    Each has a folder with its name; `options` are those of `ensemble`.

    Raises
    ------
    ExperimentError
        The first has no `[ensemble]`.
    RecordError
        Their members differ nevertheless, for example if factors apply to different platforms.
    """
    first, second = experiments
    choice = first.ensemble
    if choice is None:
        raise ExperimentError(first.where, "ensemble", "is missing; add it to declare what varies in both experiments")
    seed = first.sensors.seed if choice.seed is None else choice.seed
    options = {**options, "seed": seed if options.get("seed") is None else options["seed"]}
    both = []
    for name, experiment in zip(names, (first, second.model_copy(update={"ensemble": choice})), strict=True):
        say(name)
        both.append(ensemble(experiment, out=folder / name, **options))
    found = compare(both[0], both[1], names)
    say("figures and pages")
    for name, each in zip(names, both, strict=True):
        write_report(each, folder / name)
    gaps, by = difference(found), worst_by(both[0])
    try:
        known = [sensitivity(gaps, by)]
    except RecordError:  # too few members, or equal values in all
        known = []
    page = ensemble_page(gaps, by, {}, known, compare_sheets(found, usual=False))
    write_files(folder, {DIFFERENCES: lambda path: write_to(path, found.differences.write_parquet), PAGE: page})
    return found


def names_of(first: str, second: str) -> tuple[str, str]:
    """Names of two experiments: their files' names if they differ, A and B otherwise."""
    stems = Path(first).stem, Path(second).stem
    return stems if stems[0] != stems[1] else ("A", "B")
