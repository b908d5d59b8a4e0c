"""The folder of a search."""

from pathlib import Path

import pytest

import gough_stewart as gs
from tests.harness.tuning.uneven_search import FILE
from tests.support.uneven import UNEVEN


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With mine.toml, an experiment, and the platform that it names."""
    made = tmp_path_factory.mktemp("tune")
    gs.save_platform(UNEVEN, made / "uneven.toml")
    (made / "mine.toml").write_text(FILE)
    return made
