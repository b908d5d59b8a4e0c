"""How commands end."""

import os
from pathlib import Path

import pytest

from gough_stewart.harness.cli.command import Command, duration_text, size_text


def test_closing_lines_name_files_sizes_pages_and_what_comes_next(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: 3 kB in two files and a folder, names folded within 80 columns, the folder whole in one line."""
    monkeypatch.setenv("COLUMNS", "80")
    folder = tmp_path / ("a long name " * 8)
    (folder / "worst" / "member-1").mkdir(parents=True)
    (folder / "worst" / "member-1" / "record.csv").write_bytes(b"x" * 1000)
    names = [f"figure-{k}.png" for k in range(12)]
    for name in names:
        (folder / name).write_bytes(b"")
    (folder / "page.html").write_bytes(b"x" * 2000)
    Command().close([*names, "worst", "page.html"], folder, done="Swept", then="gough-stewart presets")
    first, *files, page, then = capsys.readouterr().out.splitlines()
    assert first == f"Swept in 0.0 s. Wrote to {folder} (3 kB):"
    assert " ".join(line.strip() for line in files) == ", ".join([*names, "worst", "page.html"])
    assert max(map(len, files)) <= 80
    assert page == f"Open {folder}{os.sep}page.html in a browser."
    assert then == "Next: gough-stewart presets"


def test_one_file_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "tuned.toml").write_bytes(b"x" * 1234567)
    Command().close(["tuned.toml"], tmp_path, done=None)
    assert capsys.readouterr().out == f"Wrote {tmp_path / 'tuned.toml'} (1.2 MB).\n"


@pytest.mark.parametrize(("seconds", "text"), [(0.04, "0.0 s"), (59.9, "59.9 s"), (125.4, "2 min 5 s")])
def test_durations(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


@pytest.mark.parametrize(("size", "text"), [(0, "0 kB"), (12345, "12.3 kB"), (2_345_678, "2.3 MB")])
def test_sizes(size: int, text: str) -> None:
    assert size_text(size) == text
