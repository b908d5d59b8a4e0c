"""The exported controller of an experiment as an FMU, for a run with it."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gough_stewart.fmu_build.build import build_units
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.design import designed
from gough_stewart.harness.export.fmu import component_of
from gough_stewart.harness.export.notes import notes_of, refusal
from gough_stewart.harness.export.stability import stability_of
from gough_stewart.model.process.progress import StepProgress


@contextmanager
def exported_controller(
    experiment: Experiment,
    fmi_version: str,
    progress: StepProgress | None = None,
    *,
    anyway: bool = False,
    warn: Callable[[str], None] | None = None,
) -> Iterator[UnitController]:
    """An FMU of FMI "2.0" or "3.0", which exists while the context is open.

    Parameters
    ----------
    anyway
        Do not refuse a loop that is unstable with the unit.
    warn
        Called with an unstable loop that is not refused, and with one that cannot be judged.

    Raises
    ------
    UnstableLoopError
        The loop of the run is unstable with the delay of the experiment.
    ControllerError, BuildError
        As `export`.
    """
    if not experiment.loop.delay:
        raise ControllerError(
            f"{experiment.where}: controller: a unit outputs the forces of a sample after a step over it; expected a "
            "loop.delay of at least 1, for instance by --set loop.delay=1"
        )
    prepared = prepare(experiment)
    law = designed(experiment, prepared=prepared)
    # a run with a unit has the experiment's own machine, and no member of its ensemble
    alone = experiment.model_copy(update={"ensemble": None})
    found = stability_of(alone, prepared, ("run",), margins=False)
    refused = refusal(experiment, found.items())
    if refused is not None and not anyway:
        raise refused
    if warn is not None:
        for text in notes_of(experiment, "run", found["run"]).warnings:
            warn(text)
    with tempfile.TemporaryDirectory(prefix="gough-stewart-", ignore_cleanup_errors=True) as folder:
        unit = component_of(law, "controller", experiment.loop.duration)
        (path,) = build_units(unit, folder, fmi=[fmi_version], progress=progress)
        yield UnitController(path, is_foreign=False)
