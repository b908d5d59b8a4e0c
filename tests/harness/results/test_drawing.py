"""Figures drawn by a process of their own: the same as here, whatever becomes of that process."""

import os
import subprocess
from pathlib import Path

import pytest

from gough_stewart.harness.results import drawing
from gough_stewart.harness.results.drawing import FIGURES, Drawing
from gough_stewart.harness.results.figures import run_figures
from tests.harness.results.test_figures import record_of

RECORD = record_of(20)


def refused(_record: object) -> dict[str, bytes]:
    """What must not be called."""
    raise AssertionError("drawn here")


def test_another_process_draws_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawing, "draw_here", refused)
    with Drawing() as draw:
        assert draw(RECORD) == run_figures(RECORD)
    assert {name.partition(".")[0] for name in run_figures(RECORD)} == set(FIGURES)


def test_without_the_process_figures_are_drawn_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the same files if it has died, and if there can be no other process."""
    expected = run_figures(RECORD)
    with Drawing() as draw:
        assert draw._process is not None
        draw._process.kill()
        assert draw(RECORD) == expected
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: (_ for _ in ()).throw(BlockingIOError()))
    with Drawing() as draw:
        assert draw(RECORD) == expected


def test_no_process_is_left_behind() -> None:
    with Drawing() as draw:
        process = draw._process
        assert process is not None
        assert process.poll() is None
    assert process.poll() is not None


def test_what_lies_in_the_users_folder_is_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: Python would look for modules in the current folder first; a file there stays what it is."""
    (tmp_path / "matplotlib.py").write_text("from pathlib import Path; Path('imported').touch(); raise SystemExit(1)")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(drawing, "draw_here", refused)
    with Drawing() as draw:
        assert draw(RECORD)
    assert not Path("imported").exists()


@pytest.mark.skipif(os.name != "posix", reason="sessions are POSIX's")
def test_ctrl_c_is_not_for_the_process() -> None:
    """Expected: a session of its own, since a terminal interrupts all processes of its own."""
    with Drawing() as draw:
        assert draw._process is not None
        assert os.getsid(draw._process.pid) == draw._process.pid
