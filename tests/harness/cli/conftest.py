"""Commands that are invoked in the tests' process draw there, too: it has matplotlib already."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

import pytest

from gough_stewart.harness.cli import run
from gough_stewart.harness.ensemble import files
from gough_stewart.harness.ensemble.figures import ensemble_figures
from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.ensemble.sensitivity import Sensitivity
from gough_stewart.harness.results.drawing import draw_here


@pytest.fixture(autouse=True, scope="module")
def _drawing_here() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "Drawing", lambda: nullcontext(draw_here))
        patch.setattr(files, "figures_aside", _figures_here)
        yield


@contextmanager
def _figures_here(ensemble: Ensemble, by: str, found: Sensitivity | None) -> Iterator[Callable[[], dict[str, bytes]]]:
    yield lambda: ensemble_figures(ensemble, by, found)
