"""Commands that are invoked in the tests' process draw there, too: it has matplotlib already."""

from contextlib import nullcontext

import pytest

from gough_stewart.harness.cli import run
from gough_stewart.harness.results.drawing import draw_here


@pytest.fixture(autouse=True)
def _drawing_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "Drawing", lambda: nullcontext(draw_here))
