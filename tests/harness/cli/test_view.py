"""The command `view`, and --report, as a user meets them."""

from pathlib import Path

import pytest

from gough_stewart import load_preset
from gough_stewart.model.process.files import write_files
from tests.support.commands import invoke
from tests.support.records import waving_record


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A record in both forms, as `run` leaves it."""
    folder = tmp_path_factory.mktemp("waves")
    record = waving_record(load_preset("desktop_hexapod"), rows=50)
    files = {"record.csv": record.to_csv(), "record.parquet": record.to_parquet()}
    write_files(folder, {**files, "metadata.json": record.to_metadata()})
    return folder


def test_a_folder_and_its_files_make_the_same_page(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the same bytes from Parquet, from CSV, and from the folder; report.html where the user is."""
    monkeypatch.chdir(tmp_path)
    for name, record in (("a", folder), ("b", folder / "record.parquet"), ("c", folder / "record.csv")):
        done = invoke("view", str(record), "--out", f"{name}.html")
        assert done.exit_code == 0, done.output
        assert f"{name}.html" in done.output
    pages = [(tmp_path / f"{name}.html").read_bytes() for name in "abc"]
    assert pages[0] == pages[1] == pages[2]
    assert invoke("view", str(folder)).exit_code == 0
    assert (tmp_path / "report.html").read_bytes() == pages[0]


def test_open_opens_the_page_and_says_so_if_it_cannot(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, opened: list[str]
) -> None:
    page = tmp_path / "new folder" / "page.html"
    assert "by hand" not in invoke("view", str(folder), "--out", str(page), "--open").output
    assert opened == [page.as_uri()]
    monkeypatch.setattr("webbrowser.open", lambda _: False)
    assert "by hand" in invoke("view", str(folder), "--out", str(page), "--open").output


def test_what_is_no_record_is_refused_with_a_remedy(folder: Path, tmp_path: Path) -> None:
    """Expected: the name, what was expected, exit code 1, and no page."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.csv").write_text("a,b\n1,2\n")
    (tmp_path / "text.parquet").write_text("a,b\n1,2\n")
    out = tmp_path / "page.html"
    for name, said in (
        ("nowhere", "no such file"),
        ("empty", "the folder has no record"),
        ("text.csv", "metadata.json"),
        ("text.parquet", "cannot be read as a record"),
    ):
        done = invoke("view", str(folder), str(tmp_path / name), "--out", str(out))
        assert done.exit_code == 1
        assert said in done.output
        assert "expected record.parquet" in done.output
        assert not out.exists()


@pytest.mark.parametrize(
    ("out", "said", "code"),
    [("results/somewhere", "somewhere.html", 2), ("file/page.html", "is a file; expected a folder", 1)],
)
def test_a_place_that_cannot_be_written_is_refused(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, out: str, said: str, code: int
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    done = invoke("view", str(folder), "--out", out)
    assert done.exit_code == code
    assert said in done.output


def test_too_many_records_are_refused(folder: Path, tmp_path: Path) -> None:
    done = invoke("view", *[str(folder)] * 7, "--out", str(tmp_path / "page.html"))
    assert done.exit_code == 1
    assert "7 records; expected 1 to 6" in done.output


def test_what_another_command_wrote_is_shown_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, opened: list[str]
) -> None:
    """Expected: the page of the report beside it, from folder or file; of a folder with a page alone, that page."""
    monkeypatch.chdir(tmp_path)
    assert (
        invoke("check", "pitch_sine", "--set", "loop.sample_time=25 ms", "--report", "--out", "checked").exit_code == 0
    )
    for name, place in (("a", "checked"), ("b", "checked/report.json")):
        done = invoke("view", place, "--out", f"{name}.html", "--open")
        assert done.exit_code == 0, done.output
        page = Path(f"{name}.html").read_text(encoding="utf-8")
        assert "Can be done; leg 3 needs " in page
        assert "sinusoidal pitch" in page
    assert opened == [Path(f"{name}.html").absolute().as_uri() for name in "ab"]
    Path("checked/report.json").unlink()
    done = invoke("view", "checked", "--open")
    assert done.exit_code == 0, done.output
    assert opened[2:] == [Path("checked/report.html").absolute().as_uri()]
    # of which the file is no longer there
    done = invoke("view", "checked/report.json")
    assert (done.exit_code, done.stderr) == (
        1, "error: checked/report.json: no such file; expected the folder of a command, or its report.json\n",
    )  # fmt: skip
    assert not Path("report.html").exists()


@pytest.mark.parametrize("text", ["{", "[]", '{"version": 7}', '{"version": 1}', "ü"])
def test_a_report_that_cannot_be_read_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "report.json").write_text(text, encoding="cp1252")
    done = invoke("view", str(tmp_path), "--out", str(tmp_path / "page.html"))
    assert done.exit_code == 1
    assert "report.json: cannot be read as a report: " in done.stderr
    assert not (tmp_path / "page.html").exists()
