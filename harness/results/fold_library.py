"""The machine code of the metrics' folds: built once from the terms that NumPy evaluates, and kept."""

from functools import cache

import numpy as np

from gough_stewart.fmu_build.cache import state_of_files
from gough_stewart.fmu_build.libraries import FoldKernel, Library, folds_sources, machine_code, vector_library
from gough_stewart.harness.loop.fold_kernels import FoldKernels
from gough_stewart.harness.loop.term_folds import TermFold
from gough_stewart.harness.results.metric_folds import metric_folds

# Sources besides those of the plant's machine code.
_OWN = (
    ("gough_stewart.harness.loop", "term_folds.py"),
    (str(__package__), "fold_library.py", "metric_folds.py", "step_fold.py"),
)


@cache
def metric_kernels() -> FoldKernels:
    """The machine code of all metrics for this processor.

    Raises
    ------
    BuildError, OSError
        As `machine_code`.
    """
    return FoldKernels(machine_code(folds_code()).path)


def folds_code() -> Library:
    """The description of the library."""
    return vector_library("folds", lambda: folds_sources(_traced()), state_of_files(*_OWN))


def _traced() -> list[FoldKernel]:
    """The kernels of a run with a reference that steps."""
    steps = np.repeat([[0.0] * 6, [1.0] * 6], 20, axis=0)
    folds = metric_folds(np.arange(40.0), steps, {})
    by_kernel = {fold.kernel: fold for fold in folds if isinstance(fold, TermFold)}
    return [fold.traced() for fold in by_kernel.values()]
