"""Files are written whole, and as one set; what a killed process leaves goes, what a living one writes stays."""

import logging
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

import gough_stewart as gs
from gough_stewart.model.process.files import check_output_folder, file_set, reserved, write_files

posix = pytest.mark.skipif(sys.platform == "win32", reason="locks are POSIX's")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def older(tmp_path: Path) -> Path:
    """A folder with an older set, and a file of the user's."""
    write_files(tmp_path, {"table": b"old", "figure": b"old", "page": b"old"})
    (tmp_path / "notes").write_bytes(b"mine")
    return tmp_path


def half(path: Path) -> None:
    path.write_bytes(b"ha")
    raise OSError(28, "No space left on device", str(path))


def write_and_draw(folder: Path) -> None:
    def draw(path: Path) -> None:
        path.write_bytes(b"drawn")

    write_files(folder, {"table": b"new", "figure": draw}, ["page"])


def fail_after_the_table(folder: Path) -> None:
    with file_set(folder, ["table", "figure"], ["page"]) as new:
        new.add({"table": b"new"})
        assert (folder / "table").read_bytes() == b"old"
        raise KeyboardInterrupt


# How a new set is written over the older one, the error, and what is there then beside the user's file.
SETS: dict[str, tuple[Callable[[Path], None], type[BaseException] | None, dict[str, bytes]]] = {
    "whole": (*(write_and_draw, None, {"table": b"new", "figure": b"drawn"}),),
    "interrupted": (fail_after_the_table, KeyboardInterrupt, {"table": b"new"}),
    "half": (
        lambda folder: write_files(folder, {"table": b"new", "figure": half, "page": b"new"}),
        *(OSError, {"table": b"new"}),
    ),
}


@pytest.mark.parametrize("case", SETS)
def test_a_set_takes_the_place_of_an_older_one_as_far_as_it_came(case: str, older: Path) -> None:
    """Expected: no file of the older set beside a new one; a note of what is missing; the user's file untouched."""
    write, error, expected = SETS[case]
    if error is None:
        write(older)
    else:
        with pytest.raises(error) as caught:
            write(older)
        assert caught.value.__notes__ == [f"{older} has table; missing: figure{', page' * (case == 'half')}"]
    assert contents(older) == expected | {"notes": b"mine"}


def test_an_interrupt_while_files_are_moved_leaves_a_whole_set(older: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: Ctrl-C at the worst moment, between two moves, and yet all files are there."""
    replace = Path.replace

    def interrupted(self: Path, target: Path) -> Path:
        moved = replace(self, target)
        if target == older / "table":
            raise KeyboardInterrupt
        return moved

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_files(older, {"table": b"new", "figure": b"new"}, ["page"])
    assert contents(older) == {"table": b"new", "figure": b"new", "notes": b"mine"}


def test_a_place_that_cannot_take_the_files_is_refused_before_the_run(tmp_path: Path) -> None:
    """Expected: a file in the way, a folder with the name of a file, a broken link."""
    (tmp_path / "file").write_bytes(b"mine")
    (tmp_path / "gough_stewart_fmi3.fmu").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for folder, text in (
        (tmp_path / "file" / "below", "file is a file"),
        (tmp_path / "link", "link is a broken link; expected a folder"),
        (tmp_path, "gough_stewart_fmi3.fmu is a folder there; expected a file or nothing"),
    ):
        with pytest.raises(gs.GoughStewartError, match=text):
            gs.build(folder, progress=pytest.fail)


def test_a_reserved_folder_is_of_one_thread_at_a_time(tmp_path: Path) -> None:
    """Expected: others are refused as long as the outermost block lasts; the same thread may enter again."""
    refused: list[str] = []

    def elsewhere(folder: Path) -> None:
        try:
            with reserved(folder):
                refused.append("")
        except gs.GoughStewartError as error:
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


@posix
def test_what_a_killed_process_left_is_removed_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: both temporary places go when their process is dead, not before; nothing where locks are refused."""
    mine = {".mine.part", ".hidden", "table.part", ".download.12345678.part.txt"}
    for name in mine:
        (tmp_path / name).write_bytes(b"mine")
    with subprocess.Popen([sys.executable, "-c", _WRITER], cwd=tmp_path, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "ready\n"
        both = {path.name for path in tmp_path.iterdir()} - mine
        assert len(both) == 2
        with caplog.at_level(logging.INFO):
            check_output_folder(tmp_path, ["table"])
            write_files(tmp_path, {"other": b"1"})
            assert both <= {path.name for path in tmp_path.iterdir()}
            writer.kill()
            writer.wait()
            with monkeypatch.context() as patched:
                patched.setattr("fcntl.flock", lambda *_: half(tmp_path / "other"))
                check_output_folder(tmp_path, ())
                write_files(tmp_path, {"other": b"2"})
            assert not caplog.messages
            check_output_folder(tmp_path, ["table"])
    assert {path.name for path in tmp_path.iterdir()} == mine | {"other"}
    (message,) = caplog.messages
    assert all(name in message for name in both)
