"""What commands ask of the functions behind them."""

from pathlib import Path

import pytest

from gough_stewart.model.platform import platform_to_toml
from tests.support.noted_calls import Notes
from tests.support.uneven import UNEVEN


@pytest.fixture
def notes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Notes:
    """In a folder with the uneven platform, own.toml."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.toml").write_text(platform_to_toml(UNEVEN))
    return Notes(monkeypatch)
