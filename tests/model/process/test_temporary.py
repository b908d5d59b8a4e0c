"""What a killed process leaves is removed by the next one; what a living process writes never is."""

import json
import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from gough_stewart.model.process.files import (
    check_output_folder,
    file_set,
    lock,
    remove_leftovers,
    temporary_file,
    temporary_folder,
    write_files,
)

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="locks are POSIX's")

# Holds a set with one file, and another file that is half written, until it is killed.
_WRITER = """
import sys, time
from pathlib import Path
from gough_stewart.model.process.files import file_set
from gough_stewart.model.process.files import temporary_file
with file_set(Path("."), ["table"]) as new, temporary_file(Path("figure")) as figure:
    new.add("table", b"whole")
    figure.write_bytes(b"ha")
    print("ready", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def writer(tmp_path: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen([sys.executable, "-c", _WRITER], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


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


def test_what_this_process_writes_stays(tmp_path: Path) -> None:
    """Expected: a thread that begins a command there takes nothing from another."""
    with file_set(tmp_path, ["a", "b"]) as new:
        new.add("a", b"1")
        with temporary_file(tmp_path / "c"):
            before = names(tmp_path)
            remove_leftovers(tmp_path)
            assert names(tmp_path) == before
        new.add("b", b"2")
    assert names(tmp_path) == {"a", "b"}


def test_a_command_says_what_it_removed(tmp_path: Path) -> None:
    """Expected: a run that is killed while it writes; the next one names what is gone, and is otherwise the same."""
    command = [sys.executable, "-m", "gough_stewart", "check", "heave_step", "--out", "out"]
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".check.json.0a1b2c3d.part").write_bytes(b"{")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "removed from out what a command left that was killed: .check.json.0a1b2c3d.part" in done.stderr
    assert not [name for name in names(tmp_path / "out") if name.endswith(".part")]
    assert json.loads((tmp_path / "out" / "check.json").read_bytes())


def test_a_race_between_writing_and_removing_loses_nothing(tmp_path: Path) -> None:
    """Expected: every file is written, though another process removes leftovers all the time."""
    lines = ["from pathlib import Path", "from gough_stewart.model.process.files import remove_leftovers"]
    lines += ["print('ready', flush=True)", "while True: remove_leftovers(Path('.'))"]
    command = [sys.executable, "-c", "\n".join(lines)]
    sweeper = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    assert sweeper.stdout is not None
    sweeper.stdout.readline()
    try:
        for k in range(200):
            write_files(tmp_path, {"a": str(k).encode()})
            assert (tmp_path / "a").read_bytes() == str(k).encode()
    finally:
        sweeper.kill()
        sweeper.communicate()
    assert names(tmp_path) == {"a"}


def test_links_and_pipes_with_the_name_of_a_leftover_stay(tmp_path: Path) -> None:
    """Expected: no command waits for a pipe, or follows a link to remove what it did not write; no log either."""
    (tmp_path / "mine").write_bytes(b"mine")
    (tmp_path / ".a.12345678.part").symlink_to(tmp_path / "mine")
    os.mkfifo(tmp_path / ".b.12345678.part")
    (tmp_path / ".c.12345678.part").write_bytes(b"old")
    # nobody else writes to the pipe: it would be waited for
    done = subprocess.run([sys.executable, "-c", _REMOVER], cwd=tmp_path, timeout=20, check=False)
    assert done.returncode == 0
    assert ".c.12345678.part" not in names(tmp_path)
    assert {"mine", ".a.12345678.part"} <= names(tmp_path)
    remove_leftovers(tmp_path / "not_there")
    remove_leftovers(tmp_path / "mine")


_REMOVER = "from pathlib import Path; from gough_stewart.model.process.files import *; remove_leftovers(Path('.'))"


def test_a_folder_of_a_killed_process_goes_with_what_is_in_it_and_other_names_stay(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Expected: names of eight of a to z, 0 to 9 and _, nothing else; said in order of their names."""
    gone = [".12345678.part", ".b.c.0a_b1c2d.part"]
    stay = [
        ".1234567.part",
        ".123456789.part",
        ".ABCDEFGH.part",
        ".x.1.2",
        "12345678.part",
        "..140.part",
        ".a.12.b.part",
    ]
    for name in gone:
        (tmp_path / name).mkdir()
        (tmp_path / name / "table").write_bytes(b"1")
    for name in stay:
        (tmp_path / name).write_bytes(b"1")
    with caplog.at_level(logging.INFO):
        remove_leftovers(tmp_path)
    assert names(tmp_path) == set(stay)
    assert caplog.messages == [
        f"removed from {tmp_path} what a command left that was killed: .12345678.part, .b.c.0a_b1c2d.part"
    ]


def test_a_temporary_place_is_locked_new_and_gone_afterwards(tmp_path: Path) -> None:
    """Expected: beside its target, under its name, empty; renamed it stays."""
    with temporary_file(tmp_path / "table") as first, temporary_file(tmp_path / "table") as second:
        assert first != second
        assert {first.parent, second.parent} == {tmp_path}
        assert all(re.fullmatch(r"\.table\.[0-9a-f]{8}\.part", each.name) for each in (first, second))
        assert first.read_bytes() == b""
        descriptor = os.open(first, os.O_RDONLY)
        assert lock(descriptor) is False
        os.close(descriptor)
        second.write_bytes(b"2")
        second.replace(tmp_path / "table")
    assert names(tmp_path) == {"table"}
    with temporary_folder(tmp_path) as folder:
        (folder / "inside").write_bytes(b"1")
        assert re.fullmatch(r"\.[0-9a-f]{8}\.part", folder.name)
    assert names(tmp_path) == {"table"}


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


def test_a_place_that_another_process_takes_before_it_is_locked_is_left_for_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: what is removed, exchanged or locked by somebody else in the moment between is not used."""
    real_open, real_lock, happened = os.open, lock, list[str]()

    def removed(path: Path, flags: int, mode: int = 0o777) -> int:
        descriptor = real_open(path, flags, mode)
        if flags & os.O_CREAT:
            return descriptor
        if len(happened) < 1:
            happened.append("removed")
            Path(path).unlink()
        elif len(happened) < 2:
            happened.append("exchanged")
            Path(path).unlink()
            Path(path).write_bytes(b"another's")
        return descriptor

    def refused(descriptor: int) -> bool | None:
        if len(happened) == 2:
            happened.append("locked")
            return False
        return real_lock(descriptor)

    with monkeypatch.context() as patched:
        patched.setattr("os.open", removed)
        patched.setattr("gough_stewart.model.process.files.lock", refused)
        with temporary_file(tmp_path / "table") as path:
            assert happened == ["removed", "exchanged", "locked"]
            assert path.read_bytes() == b""
            assert path.is_file()
    assert not path.exists()


def test_a_leftover_that_was_exchanged_for_a_new_one_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: between finding and locking, another process has removed it and made a new one of the same name."""
    (tmp_path / ".a.12345678.part").write_bytes(b"old")
    real_open = os.open

    def exchanged(path: Path, flags: int) -> int:
        descriptor = real_open(path, flags)
        Path(path).rename(tmp_path / "aside")
        Path(path).write_bytes(b"new")
        return descriptor

    monkeypatch.setattr("os.open", exchanged)
    remove_leftovers(tmp_path)
    assert (tmp_path / ".a.12345678.part").read_bytes() == b"new"
