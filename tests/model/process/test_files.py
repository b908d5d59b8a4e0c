"""Files are written whole, and as one set: what is there afterwards, whatever went wrong."""

import os
import re
import threading
from pathlib import Path

import pytest

from gough_stewart.model.errors import OutputError
from gough_stewart.model.process.files import check_output_folder, file_set, reserved, write_files, write_whole


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


def test_a_set_that_fails_at_its_first_file_leaves_the_older_one(older: Path) -> None:
    before = contents(older)
    with pytest.raises(ZeroDivisionError), file_set(older, ["table", "figure"], ["page"]):
        raise ZeroDivisionError
    assert contents(older) == before


@pytest.mark.parametrize("error", [OSError(28, "No space left"), ValueError(), KeyboardInterrupt(), MemoryError()])
def test_a_set_that_fails_later_keeps_what_came_first_and_names_what_is_missing(
    older: Path, error: BaseException
) -> None:
    """Expected: the new table without an old figure or page beside it."""

    def fail_after_the_table() -> None:
        with file_set(older, ["table", "figure"], ["page"]) as new:
            new.add("table", b"new")
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


def test_files_that_cannot_be_moved_stay_where_the_note_says(older: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: as on Windows while another program has the old table open: nothing old or new is lost."""
    before = contents(older)

    def refused(self: Path, missing_ok: bool = False) -> None:
        raise PermissionError(13, "in use", str(self), missing_ok)

    monkeypatch.setattr(Path, "unlink", refused)
    with pytest.raises(PermissionError) as caught:
        write_files(older, {"table": b"new"})
    place = Path(caught.value.__notes__[0].removeprefix("the new files are in "))
    assert contents(place) == {"table": b"new"}
    assert {name: (older / name).read_bytes() for name in before} == before


def test_a_place_that_cannot_take_the_files_is_refused_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: a file in the way, a folder with the name of a file, a folder that is closed; else silence."""
    (tmp_path / "file").write_bytes(b"mine")
    (tmp_path / "table").mkdir()
    check_output_folder(tmp_path, ["figure", "file"])
    check_output_folder(tmp_path / "new" / "folder", ["table"])
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(OutputError, match="file is a file; expected a folder"):
            check_output_folder(folder, [])
    with pytest.raises(OutputError, match="table is a folder there; expected a file or nothing"):
        check_output_folder(tmp_path, ["figure", "table"])
    monkeypatch.setattr("os.access", lambda place, mode: not (place == tmp_path and mode & (os.W_OK | os.X_OK)))
    with pytest.raises(OutputError, match="no permission to write in"):
        check_output_folder(tmp_path / "new", [])


def test_a_link_that_leads_nowhere_is_refused_before_the_run(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for folder in (tmp_path / "link", tmp_path / "link" / "below"):
        with pytest.raises(OutputError, match="link is a broken link; expected a folder"):
            check_output_folder(folder, [])


def test_a_set_leaves_no_file_of_its_own(tmp_path: Path) -> None:
    write_files(tmp_path / "new" / "folder", {"a": b"1"})
    assert contents(tmp_path / "new" / "folder") == {"a": b"1"}


def test_an_empty_set_and_one_that_fails_when_it_is_complete_have_no_note(older: Path) -> None:
    """Expected: nothing is missing where nothing was begun, or where all is there; an error stays as it is."""
    before = contents(older)
    with file_set(older, ["table", "figure"], ["page"]):
        pass
    assert contents(older) == before

    def fail(names: list[str]) -> None:
        with file_set(older, names, ["page"]) as new:
            for name in names[:1]:
                new.add(name, b"new")
            raise ZeroDivisionError

    for names in ([], ["table"]):
        with pytest.raises(ZeroDivisionError) as caught:
            fail(names)
        assert not hasattr(caught.value, "__notes__")
    assert contents(older) == {"table": b"new", "figure": b"old", "notes": b"mine"}


def test_a_file_of_a_set_that_has_not_begun_to_replace_is_named_in_its_place(older: Path) -> None:
    """Expected: number, words and place of the user's file, not of the temporary one."""

    def full(path: Path) -> None:
        raise OSError(28, "No space left on device", str(path))

    with pytest.raises(OSError, match="No space") as caught:
        write_whole(older / "table", full)
    assert (caught.value.errno, caught.value.strerror) == (28, "No space left on device")
    assert caught.value.filename == str(older / "table")
    assert contents(older)["table"] == b"old"


def test_a_refused_place_is_told_in_whole_sentences(tmp_path: Path) -> None:
    """Expected: the folder that was asked for, and what is in the way; a link to a file is a file."""
    (tmp_path / "file").write_bytes(b"mine")
    (tmp_path / "to_file").symlink_to(tmp_path / "file")
    (tmp_path / "to_folder").symlink_to(tmp_path)
    for name in ("file", "to_file"):
        folder = tmp_path / name / "a" / "b"
        text = f"output folder {folder}: {tmp_path / name} is a file; expected a folder, existing or new"
        with pytest.raises(OutputError, match=f"^{re.escape(text)}$"):
            check_output_folder(folder, [])
    check_output_folder(tmp_path / "to_folder" / "new", [])


def test_a_reserved_folder_is_of_one_thread_at_a_time(tmp_path: Path) -> None:
    """Expected: others are refused as long as the outermost block lasts; the same thread may enter again."""
    refused: list[str] = []

    def elsewhere(folder: Path) -> None:
        try:
            with reserved(folder):
                refused.append("")
        except OutputError as error:
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


def test_a_reserved_folder_that_was_made_for_nothing_goes_and_others_stay(tmp_path: Path) -> None:
    """Expected: a new one goes if it is empty; one that was there, or has a file, stays."""
    with reserved(tmp_path / "a" / "empty"):
        assert (tmp_path / "a" / "empty").is_dir()
    assert not (tmp_path / "a" / "empty").exists()
    with reserved(tmp_path / "full"):
        (tmp_path / "full" / "record").write_bytes(b"1")
    assert contents(tmp_path / "full") == {"record": b"1"}
    (tmp_path / "old").mkdir()
    with pytest.raises(ZeroDivisionError), reserved(tmp_path / "old"):
        raise ZeroDivisionError
    assert (tmp_path / "old").is_dir()
    with (
        pytest.raises(OutputError, match="record is a file; expected a folder"),
        reserved(tmp_path / "full" / "record"),
    ):
        pass
