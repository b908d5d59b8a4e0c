"""Files are written whole, and as one set; what a killed process leaves goes, what a living one writes stays."""

import logging
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from gough_stewart import GoughStewartError
from gough_stewart.model.process.files import (
    check_output_folder,
    file_set,
    remove_leftovers,
    reserved,
    write_files,
)

posix = pytest.mark.skipif(sys.platform == "win32", reason="locks are POSIX's")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def older(tmp_path: Path) -> Path:
    """A folder with an older set, and a file of the user's."""
    write_files(tmp_path, {"table": b"old", "figure": b"old", "page": b"old"})
    (tmp_path / "notes").write_bytes(b"mine")
    return tmp_path


def test_a_set_takes_the_place_of_an_older_one(older: Path) -> None:
    """Expected: new files, none of the older set's, and what is not of the set untouched."""

    def draw(path: Path) -> None:
        path.write_bytes(b"drawn")

    write_files(older, {"table": b"new", "figure": draw}, ["page"])
    assert contents(older) == {"table": b"new", "figure": b"drawn", "notes": b"mine"}


@pytest.mark.parametrize("error", [OSError(28, "No space left"), ValueError(), KeyboardInterrupt(), MemoryError()])
def test_a_set_that_fails_later_keeps_what_came_first_and_names_what_is_missing(
    older: Path, error: BaseException
) -> None:
    """Expected: the new table without an old figure or page beside it."""

    def fail_after_the_table() -> None:
        with file_set(older, ["table", "figure"], ["page"]) as new:
            new.add({"table": b"new"})
            assert (older / "table").read_bytes() == b"old"
            raise error

    with pytest.raises(type(error)) as caught:
        fail_after_the_table()
    assert caught.value.__notes__ == [f"{older} has table; missing: figure"]
    assert contents(older) == {"table": b"new", "notes": b"mine"}


def test_a_file_that_cannot_be_written_whole_is_not_written(older: Path) -> None:
    def half(path: Path) -> None:
        path.write_bytes(b"ha")
        raise OSError(28, "No space left on device", str(path))

    with pytest.raises(OSError, match="No space left on device") as caught:
        write_files(older, {"table": b"new", "figure": half, "page": b"new"})
    assert caught.value.filename == str(older / "figure")
    assert contents(older) == {"table": b"new", "notes": b"mine"}


def test_an_interrupt_while_files_are_moved_leaves_a_whole_set(older: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: Ctrl-C at the worst moment, between two moves, and yet all files are there."""
    replace, calls = Path.replace, []

    def interrupted(self: Path, target: Path) -> Path:
        moved = replace(self, target)
        calls.append(target)
        if target == older / "table":
            raise KeyboardInterrupt
        return moved

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_files(older, {"table": b"new", "figure": b"new"}, ["page"])
    assert contents(older) == {"table": b"new", "figure": b"new", "notes": b"mine"}


def test_a_place_that_cannot_take_the_files_is_refused_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: a file in the way, a folder with the name of a file, a folder that is closed; else silence."""
    (tmp_path / "file").write_bytes(b"mine")
    (tmp_path / "table").mkdir()
    check_output_folder(tmp_path, ["figure", "file"])
    check_output_folder(tmp_path / "new" / "folder", ["table"])
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for name, text in (("file", "is a file"), ("link", "is a broken link")):
        for folder in (tmp_path / name, tmp_path / name / "below"):
            with pytest.raises(GoughStewartError, match=f"{name} {text}; expected a folder"):
                check_output_folder(folder, [])
    with pytest.raises(GoughStewartError, match="table is a folder there; expected a file or nothing"):
        check_output_folder(tmp_path, ["figure", "table"])
    monkeypatch.setattr("os.access", lambda place, mode: not (place == tmp_path and mode & (os.W_OK | os.X_OK)))
    with pytest.raises(GoughStewartError, match="no permission to write in"):
        check_output_folder(tmp_path / "new", [])


def test_a_reserved_folder_is_of_one_thread_at_a_time(tmp_path: Path) -> None:
    """Expected: others are refused as long as the outermost block lasts; the same thread may enter again."""
    refused: list[str] = []

    def elsewhere(folder: Path) -> None:
        try:
            with reserved(folder):
                refused.append("")
        except GoughStewartError as error:
            refused.append(str(error))

    def other_thread(folder: Path) -> str:
        thread = threading.Thread(target=elsewhere, args=(folder,))
        thread.start()
        thread.join()
        return refused.pop()

    folder = tmp_path / "out"
    folder.mkdir()
    (tmp_path / "link").symlink_to(folder)
    sentence = "another command is writing there; wait for its end, or choose another folder"
    with reserved(folder):
        with reserved(tmp_path / "link"):
            assert other_thread(folder) == f"output folder {folder}: {sentence}"
        assert other_thread(tmp_path / "link") == f"output folder {tmp_path / 'link'}: {sentence}"
        assert other_thread(tmp_path / "another") == ""
    assert other_thread(folder) == ""


# Holds a set with one file, and another file that is half written, until it is killed.
_WRITER = """
import time
from pathlib import Path
from gough_stewart.model.process.files import file_set, write_whole
def half(figure):
    figure.write_bytes(b"ha")
    print("ready", flush=True)
    time.sleep(60)
with file_set(Path("."), ["table"]) as new:
    new.add({"table": b"whole"})
    write_whole(Path("figure"), half)
"""


@pytest.fixture
def writer(tmp_path: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen([sys.executable, "-c", _WRITER], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@posix
def test_what_a_killed_process_left_is_removed_and_said(
    tmp_path: Path, writer: subprocess.Popen[str], caplog: pytest.LogCaptureFixture
) -> None:
    """Expected: both temporary places go when their process is dead, not before; other hidden files stay."""
    for other in (".mine.part", ".hidden", "table.part", ".download.12345678.part.txt"):
        (tmp_path / other).write_bytes(b"mine")
    both = {name for name in names(tmp_path) if name not in (".mine.part", "table.part") and name.endswith(".part")}
    assert len(both) == 2
    with caplog.at_level(logging.INFO):
        check_output_folder(tmp_path, ["table"])
        write_files(tmp_path, {"other": b"1"})
        assert both <= names(tmp_path)
        assert not caplog.messages
        writer.kill()
        writer.communicate()
        check_output_folder(tmp_path, ["table"])
    assert names(tmp_path) == {".mine.part", ".hidden", "table.part", ".download.12345678.part.txt", "other"}
    assert len(caplog.messages) == 1
    assert all(name in caplog.messages[0] for name in both)


@posix
def test_without_locks_nothing_is_removed_and_files_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: as on Windows, where there is no such module, and on file systems that refuse to lock."""
    (tmp_path / ".c.12345678.part").write_bytes(b"old")

    def refuse(*_: object) -> None:
        raise OSError(95, "Operation not supported")

    with monkeypatch.context() as patched:
        patched.setattr("fcntl.flock", refuse)
        write_files(tmp_path, {"a": b"1"})
        remove_leftovers(tmp_path)
    monkeypatch.setattr("gough_stewart.model.process.files.fcntl", None)
    write_files(tmp_path, {"b": b"2"})
    remove_leftovers(tmp_path)
    assert names(tmp_path) == {"a", "b", ".c.12345678.part"}
