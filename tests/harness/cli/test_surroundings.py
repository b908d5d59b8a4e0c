"""Unusual surroundings: closed streams, other locales, folders that are not UTF-8, and variables of the environment."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from lxml import etree

from gough_stewart import read_record
from gough_stewart.fmu_build.documents import xml_text
from tests.support.commands import invoke

pytestmark = pytest.mark.skipif(os.name != "posix", reason="streams, locales and bytes in names are POSIX's")

COMMAND = [sys.executable, "-m", "gough_stewart"]
SHORT = ("--set", "loop.duration=0.02", "--set", "reference.at=0.01")


def started(*arguments: str, cwd: Path, code: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own, or lines of Python."""
    command = [sys.executable, "-c", code] if code else [*COMMAND, *arguments]
    return subprocess.run(
        command, cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )


def test_umlauts_in_a_locale_of_ascii_and_the_backend_of_a_notebook_that_is_not_installed(tmp_path: Path) -> None:
    """Expected: folder and title as given, as in cron and containers; figures, though Jupyter sets this."""
    arguments = ("run", "heave_step", *SHORT, "--set", 'title="Größe"', "--out", "umläut")
    surroundings = {"LC_ALL": "C", "PYTHONUTF8": "0", "MPLBACKEND": "module://no_such_package.backend_inline"}
    done = started(*arguments, cwd=tmp_path, **surroundings)
    assert done.returncode == 0, done.stderr
    assert read_record(tmp_path / "umläut").metadata["title"] == "Größe"
    assert (tmp_path / "umläut" / "metrics.json").is_file()


def test_a_folder_that_is_not_utf_8(tmp_path: Path) -> None:
    """Expected: a record there that can be viewed, as in a folder from an archive of another system."""
    place = os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9")
    lines = ["import gough_stewart as gs", f"place = {place!r}"]
    lines += ["record = gs.run('heave_step', {'loop.duration': 0.3})", "gs.save_record(record, place, report=True)"]
    lines += ["print(gs.read_record(place).table.equals(gs.read_record(place + '/record.csv').table))"]
    lines += ["gs.view(place, place + '/page.html')"]
    lines += ["found = gs.ensemble('heave_tolerances', {'loop.duration': 0.3}, members=3, workers=1, out=place)"]
    lines += ["print(gs.read_ensemble(place).members.equals(found.members))"]
    done = started(cwd=tmp_path, code="\n".join(lines))
    assert (done.returncode, done.stdout) == (0, "True\nTrue\n"), done.stderr


def test_a_title_that_is_not_utf_8_is_refused() -> None:
    done = invoke("run", "heave_step", "--set", "title=" + os.fsdecode(b"caf\xe9"))
    assert done.exit_code == 1
    assert "expected text in UTF-8" in done.stderr


@pytest.mark.parametrize("closed", [(1,), (2,), (0, 1, 2)])
def test_closed_streams_change_nothing(closed: tuple[int, ...], tmp_path: Path) -> None:
    """Expected: exit code 0 and whole files, none of which has taken the place of a stream."""
    lines = [f"import os, sys; [os.close(k) for k in {closed}]"]
    lines += [f"os.execv(sys.executable, {[*COMMAND, 'presets', 'liu2000']!r})"]
    done = started(cwd=tmp_path, code="\n".join(lines))
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert bool(done.stdout) == (1 not in closed)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("POLARS_MAX_THREADS", "0", "POLARS_MAX_THREADS is '0'; expected a number of threads of at least 1; unset it"),
        ("SOURCE_DATE_EPOCH", "abc", "SOURCE_DATE_EPOCH is 'abc'; expected a whole number of seconds since 1970"),
    ],
)
def test_variables_that_libraries_cannot_read_are_refused(name: str, value: str, says: str, tmp_path: Path) -> None:
    """Expected: one line at the command, one error of the package in Python."""
    done = started("run", "heave_step", cwd=tmp_path, **{name: value})
    assert done.returncode == 1
    assert done.stderr.startswith("error: the environment variable " + says)
    assert done.stderr.count("\n") == 1
    code = "import gough_stewart as gs\ntry: gs.run\nexcept gs.GoughStewartError as error: print(error)"
    assert says in started(cwd=tmp_path, code=code, **{name: value}).stdout


def test_every_character_of_a_title_can_be_exported() -> None:
    """Expected: lxml, which refuses what XML cannot have, takes all; letters stay, others get a mark."""
    for k in (*range(0x180), 0xD800, 0xDFFF, 0xFFFE, 0xFFFF, 0x1F600):
        text = xml_text(chr(k))
        assert etree.Element("a", b=text).get("b") == text
        assert (text == chr(k)) == (chr(k).isprintable() or chr(k) in "\t\n\r\xa0\xad")
