"""Whole ensembles: the same files whoever computes them, and after whatever went wrong on the way."""

import errno
import json
import os
import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import polars
import pytest

import gough_stewart as gs
from tests.harness.ensemble.small_ensemble import MANY, SIZE, small
from tests.support.commands import invoke
from tests.support.reports import report_in

FOLDER, PLAN = "chunks", "plan.json"
FILES = {"members.parquet", "bands.parquet", "samples.parquet", "ensemble.json"}


def run(**options: Any) -> gs.Ensemble:
    return gs.ensemble("heave_step", MANY, **{"workers": 1, **options})


def files_in(folder: Path) -> Mapping[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, bytes]:
    """The files of a run in one process."""
    folder = tmp_path_factory.mktemp("undisturbed")
    run(out=folder)
    files = files_in(folder)
    assert set(files) == FILES
    said = json.loads(files["ensemble.json"])
    assert sum(said["outcomes"].values()) == 2 * SIZE + 40
    assert said["outcomes"]["impossible"] > 20
    return files


# A controller that ends the other processes, once or always, in the middle of a chunk.
LAW = """
import os, pathlib, signal

mark = pathlib.Path({folder!r}, "str" + "uck")  # whose name is not one of a file that the controller needs

def make(platform, sample_time):
    if os.getpid() != {here} and (not mark.exists() or {always}):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return lambda sample: 1e5 * (sample.reference["leg_length"] - sample.measured["leg_length"])
"""


def with_law(folder: Path, always: bool) -> tuple[dict[str, Any], Any]:
    """Settings with that controller, and a progress that goes on when it has struck."""
    mark = folder / "struck"
    (folder / "law.py").write_text(LAW.format(here=os.getpid(), folder=str(folder), always=always))
    law = {"type": "python", "file": str(folder / "law.py"), "factory": "make"}
    seen = list[int]()

    def progress(done: int, _total: int) -> None:
        end = time.monotonic() + 60
        while not mark.exists() and time.monotonic() < end:
            time.sleep(0.02)
        seen.append(done)

    progress.seen = seen  # type: ignore[attr-defined]
    few = {**MANY["ensemble"], "members": SIZE + 40}
    return {**MANY, "ensemble": few, "controller": law}, progress


def test_two_workers_give_the_same_bytes_as_one_though_one_is_killed(tmp_path: Path) -> None:
    """Expected: this process begins with the last chunk, another one with the first, which is started again."""
    settings, progress = with_law(tmp_path, always=False)
    gs.ensemble("heave_step", settings, workers=1, out=tmp_path / "one")
    found = gs.ensemble("heave_step", settings, workers=2, out=tmp_path / "two", progress=progress)
    assert files_in(tmp_path / "two") == files_in(tmp_path / "one")
    assert (tmp_path / "struck").exists()
    assert progress.seen == [40, SIZE + 40]
    assert found.members["member"].to_list() == list(range(SIZE + 40))
    assert gs.read_ensemble(tmp_path / "two").members.equals(found.members)


def test_a_worker_that_dies_again_and_again_is_an_error(tmp_path: Path) -> None:
    settings, progress = with_law(tmp_path, always=True)
    with pytest.raises(gs.GoughStewartError, match=r"members 0 to 511: .*SIGKILL.*tried 3 times\. Not enough memory"):
        gs.ensemble("heave_step", settings, workers=2, progress=progress)


def interrupted(folder: Path, chunks: int, **options: Any) -> BaseException:
    """What ends a run that is interrupted after so many chunks."""
    seen = list[int]()

    def progress(done: int, _total: int) -> None:
        seen.append(done)
        if len(seen) == chunks:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        run(out=folder, progress=progress, **options)
    return caught.value


def test_an_interrupted_run_goes_on_to_the_same_bytes(undisturbed: Mapping[str, bytes], tmp_path: Path) -> None:
    """Expected: finished chunks are kept, as the note says, not computed again, and the end is the same."""
    caught = interrupted(tmp_path, 2)
    assert "2 finished chunks are kept" in caught.__notes__[0]
    assert "--resume" in caught.__notes__[0]
    assert {path.name for path in tmp_path.iterdir()} == {FOLDER, PLAN}
    kept = files_in(tmp_path / FOLDER)
    with pytest.raises(gs.GoughStewartError, match="finished chunks of an incomplete ensemble"):
        run(out=tmp_path)
    assert files_in(tmp_path / FOLDER) == kept
    done = list[int]()
    run(out=tmp_path, resume=True, progress=lambda members, _: done.append(members))
    assert done == [2 * SIZE + 40]  # the last chunk alone
    assert files_in(tmp_path) == undisturbed
    # all is done: nothing is computed again
    again = run(out=tmp_path, resume=True, workers=2, progress=lambda members, _: done.append(members))
    assert (len(again.members), len(done)) == (2 * SIZE + 40, 1)


@pytest.mark.parametrize(("ending", "left"), [("parquet", -30), ("npz", -30), ("npz", 0), ("npz", None)])
def test_a_torn_chunk_is_made_again(
    undisturbed: Mapping[str, bytes], tmp_path: Path, ending: str, left: int | None
) -> None:
    """Expected: of one that lacks its end, is empty, or is no archive."""
    interrupted(tmp_path, 2)
    torn = tmp_path / FOLDER / f"{SIZE:08d}.{ending}"
    torn.write_bytes(b"no archive" if left is None else torn.read_bytes()[:left])
    done = list[int]()
    run(out=tmp_path, resume=True, progress=lambda members, _: done.append(members))
    assert done == [2 * SIZE, 2 * SIZE + 40]
    assert files_in(tmp_path) == undisturbed


def test_results_of_another_experiment_are_not_gone_on_with(tmp_path: Path) -> None:
    """Expected: what differs by its key and both values, the first three; the finished chunks stay."""
    interrupted(tmp_path, 1)
    before = files_in(tmp_path / FOLDER)

    def refused(message: str, settings: dict[str, Any] | None = None, **options: Any) -> str:
        with pytest.raises(gs.GoughStewartError, match=message) as caught:
            gs.ensemble("heave_step", MANY | (settings or {}), out=tmp_path, resume=True, **options)
        return str(caught.value)

    varied = {**MANY["ensemble"], "platform_mass": {"normal": [1000, 500]}}
    refused(r"another experiment: ensemble\.platform_mass\.normal is \[1", {"ensemble": varied})
    refused(f"members is 80 here and {2 * SIZE + 40} there", members=80)
    many = {"loop": {**MANY["loop"], "delay": 2, "duration": 0.011}, "title": "b", "sensors.seed": 77}
    said = refused("another experiment", {**many, "controller.damping_ratio": 0.9})
    told = re.findall(r"(?:: |; )([\w.]+) is \S+ here and \S+ there", said)
    assert told == ["controller.damping_ratio", "loop.delay", "loop.duration"]
    plan = json.loads((tmp_path / PLAN).read_text())
    plan["made_with"]["numpy"] = "1.0"
    (tmp_path / PLAN).write_text(json.dumps(plan))
    refused(r"results of other versions: numpy .* here and 1\.0 there")
    (tmp_path / PLAN).write_text("{}")
    refused("is not the plan of an ensemble")
    assert files_in(tmp_path / FOLDER) == before


def test_a_full_disk_keeps_what_is_finished(
    undisturbed: Mapping[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: a clear error after the first chunk, no part of the second, and the same end after room was made."""
    write = Path.write_bytes

    def full(self: Path, content: Any) -> int:
        if f"{SIZE:08d}.npz" in self.name:
            write(self, content[:100])
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(self, content)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        said = r"no space left on the disk; 1 finished chunk is kept in .*--resume"
        with pytest.raises(gs.GoughStewartError, match=said):
            run(out=tmp_path)
    assert {path.name for path in (tmp_path / FOLDER).iterdir() if path.suffix == ".npz"} == {"00000000.npz"}
    assert not list((tmp_path / FOLDER).glob("*.part"))
    done = list[int]()
    run(out=tmp_path, resume=True, progress=lambda members, _: done.append(members))
    assert done == [2 * SIZE, 2 * SIZE + 40]
    assert files_in(tmp_path) == undisturbed


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"worst_by": "force.peek"}, r"worst_by: no metric 'force\.peek'; did you mean 'force\.peak'"),
        (
            {"signals": ["velocity", "positon"]},
            r"ensemble\.signals: no signal 'positon' for bands; did you mean 'position'",
        ),
    ],
)
def test_names_that_are_not_there_are_refused_before_anything_runs(
    table: dict[str, Any], said: str, tmp_path: Path
) -> None:
    with pytest.raises(gs.GoughStewartError, match=said):
        gs.ensemble(small(**table), out=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_member_without_margins_is_a_row_with_its_cause(tmp_path: Path) -> None:
    """Expected: 60 samples of delay are 360 states and 18 more, above 300; its requirement counts as not held."""
    delays = ("--set", "ensemble.margins=true", "--set", "ensemble.loop.delay={ grid = [1, 60] }")
    few = ("--set", "loop.duration=0.2", "--members", "4", "--workers", "1", "--out", str(tmp_path))
    done = invoke("ensemble", "heave_step", *delays, *few, "--require", "margins.disk >= 0.1")
    assert done.exit_code == 3
    members = gs.read_ensemble(tmp_path).members
    assert members["outcome"].to_list() == ["completed"] * 4
    assert members["margins.disk"].is_null().to_list() == [False, True, False, True]
    assert members["margins.stable"].to_list() == [1.0, None, 1.0, None]
    assert members["cause"].is_null().to_list() == [True, False, True, False]
    cause = members["cause"][1]
    assert cause.startswith("no margins: a delay of 60 samples")
    assert "378 states" in cause
    report = report_in(tmp_path)
    warning = f"2 of 4 members completed but could not be judged; the first is member 1, {cause}"
    assert [note["text"] for note in report["notes"] if note.get("kind") == "warning"] == [warning]
    (judged,) = report["requirements"]
    assert (judged["status"], judged["value"]) == ("missed", None)
    assert "2 of 4 members hold it; 2 of them without this number" in judged["note"]


def test_samples_belong_to_their_member_where_others_are_impossible() -> None:
    """Expected: the rows of the member run alone, at the same times; masses below zero are no machines."""
    varied = {"members": 12, "seed": 3, "worst": 1, "platform_mass": {"uniform": [-800.0, 1500.0]}}
    settings = {"loop.duration": 0.1, "ensemble": varied}
    found = gs.ensemble("heave_step", settings, workers=1)
    ran = found.members.filter(polars.col("outcome") != "impossible")["member"].to_list()
    assert ran != list(range(len(ran)))
    assert found.samples is not None
    assert found.samples["member"].unique(maintain_order=True).to_list() == ran
    alone = gs.run("heave_step", settings, member=ran[-1])
    rows = found.samples.filter(polars.col("member") == ran[-1])
    at = [int((alone["time"] < time - 1e-9).sum()) for time in rows["time"]]
    error = (alone["error.position"] ** 2).sum(axis=1)[at] ** 0.5
    assert rows["error.position.norm"].to_list() == pytest.approx(error, rel=1e-5, abs=1e-9)
