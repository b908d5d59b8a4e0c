"""The exported controller of an experiment as an FMU, for a run with it."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.export import export
from gough_stewart.model.progress import StepProgress


@contextmanager
def exported_controller(
    experiment: Experiment, fmi_version: str, progress: StepProgress | None = None
) -> Iterator[UnitController]:
    """An FMU of FMI "2.0" or "3.0", which exists while the context is open.

    Raises
    ------
    ControllerError, BuildError
        As `export`.
    """
    with tempfile.TemporaryDirectory(prefix="gough-stewart-", ignore_cleanup_errors=True) as folder:
        (path,) = export(experiment, forms="fmu", out=folder, fmi=fmi_version, progress=progress)
        yield UnitController(path, is_foreign=False)
