"""Whole ensembles: the same files whoever computes them, and after whatever went wrong on the way."""

import errno
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import polars
import pytest

import gough_stewart as gs
from gough_stewart.harness.ensemble import ensemble as runner
from gough_stewart.harness.ensemble import workers as processes
from gough_stewart.harness.ensemble.chunk import FOLDER, ChunkBytes, ChunkFiles
from gough_stewart.harness.ensemble.chunk import chunk as chunk_of_plan
from gough_stewart.harness.ensemble.data import BANDS, MEMBERS, METADATA, SAMPLES
from gough_stewart.harness.ensemble.workers import Range, chunks_here
from gough_stewart.harness.errors import EnsembleError, ExperimentError
from gough_stewart.harness.experiment.members import EnsemblePlan
from gough_stewart.harness.plants.isolated import Isolated
from gough_stewart.harness.report.requirements import with_requirements
from gough_stewart.model.errors import OutputError
from tests.support.small_ensemble import small

FILES = (MEMBERS, BANDS, SAMPLES, METADATA)


@pytest.fixture(autouse=True)
def _small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "SIZE", 16)


def files_in(folder: Path) -> Mapping[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, bytes]:
    """The files of a run in one process, in chunks of 16, 16 and 8 members."""
    folder = tmp_path_factory.mktemp("undisturbed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "SIZE", 16)
        gs.ensemble(small(), out=folder, workers=1)
    return files_in(folder)


def test_it_leaves_its_files(undisturbed: Mapping[str, bytes]) -> None:
    assert set(undisturbed) == set(FILES)
    said = json.loads(undisturbed[METADATA])
    assert sum(said["outcomes"].values()) == 40
    assert said["seed"] == 3
    assert len(said["features"]) == 1
    assert [len(group) for group in said["groups"]] == [1, 3, 1, 18, 1, 1, 1, 1]


def test_two_workers_give_the_same_bytes_as_one(undisturbed: Mapping[str, bytes], tmp_path: Path) -> None:
    seen = list[int]()
    found = gs.ensemble(small(), out=tmp_path, workers=2, progress=lambda done, _total: seen.append(done))
    assert files_in(tmp_path) == undisturbed
    assert sorted(seen) == seen
    assert seen[-1] == 40
    assert found.members["member"].to_list() == list(range(40))
    assert gs.read_ensemble(tmp_path).members.equals(found.members)


def test_other_chunks_give_the_same_members(undisturbed: Mapping[str, bytes], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "SIZE", 256)
    found = gs.ensemble(small(), workers=1)
    assert found.members.equals(polars.read_parquet(undisturbed[MEMBERS]), null_equal=True)
    assert found.bands.equals(polars.read_parquet(undisturbed[BANDS]), null_equal=True)


def interrupted(folder: Path, after: int, monkeypatch: pytest.MonkeyPatch) -> BaseException:
    """What ends a run that is interrupted after so many chunks."""
    with monkeypatch.context() as patch:

        def fails(*arguments: Any) -> Iterator[Any]:
            for k, found in enumerate(chunks_here(*arguments)):
                if k == after:
                    raise KeyboardInterrupt
                yield found

        patch.setattr(runner, "chunks_here", fails)
        with pytest.raises(KeyboardInterrupt) as caught:
            gs.ensemble(small(), out=folder, workers=1)
    return caught.value


def test_an_interrupted_run_goes_on_to_the_same_bytes(
    undisturbed: Mapping[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: finished chunks are kept, as the note says, not computed again, and the end is the same."""
    caught = interrupted(tmp_path, 2, monkeypatch)
    assert "2 finished chunks are kept" in caught.__notes__[0]
    assert "--resume" in caught.__notes__[0]
    assert not any((tmp_path / name).exists() for name in FILES)
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / FOLDER).iterdir()}
    asked = list[Any]()

    def counted(plan: EnsemblePlan, ranges: Sequence[Range], workers: int) -> Iterator[Any]:
        asked.extend(ranges)
        return chunks_here(plan, ranges, workers)

    monkeypatch.setattr(runner, "chunks_here", counted)
    with pytest.raises(EnsembleError, match="finished chunks of an incomplete ensemble"):
        gs.ensemble(small(), out=tmp_path, workers=1)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / FOLDER).iterdir()} == kept
    gs.ensemble(small(), out=tmp_path, workers=1, resume=True)
    assert asked == [(32, 40)]
    assert files_in(tmp_path) == undisturbed
    # all is done: nothing is computed again
    again = gs.ensemble(small(), out=tmp_path, workers=1, resume=True)
    assert len(again.members) == 40
    assert len(asked) == 1


@pytest.mark.parametrize("ending", ["parquet", "npz", "json"])
def test_a_torn_chunk_is_made_again(
    undisturbed: Mapping[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    interrupted(tmp_path, 2, monkeypatch)
    torn = tmp_path / FOLDER / f"00000016.{ending}"
    torn.write_bytes(torn.read_bytes()[:-30])
    gs.ensemble(small(), out=tmp_path, workers=1, resume=True)
    assert files_in(tmp_path) == undisturbed


def test_causes_are_counted_the_most_frequent_first() -> None:
    """Expected: counts of the table; by name the other one would be the first."""
    many, few = {"choice": [-3.0, -3.0, 1000.0]}, {"choice": [0, 0, 2000]}
    found = gs.ensemble(small(platform_mass=many, loop={"delay": few}), members=16, workers=1)
    causes = found.members["cause"].drop_nulls().to_list()
    first, second = found.metadata["causes"].items()
    assert first == (next(each for each in causes if "platform_mass" in each), sum("mass" in each for each in causes))
    assert second == (next(each for each in causes if "delay" in each), sum("delay" in each for each in causes))
    assert first[1] > second[1] > 0
    assert found.metadata["outcomes"]["impossible"] == first[1] + second[1]


def test_results_of_another_experiment_are_not_gone_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    interrupted(tmp_path, 1, monkeypatch)
    before = files_in(tmp_path / FOLDER)
    other = small(platform_mass={"normal": [1000, 500]})
    with pytest.raises(EnsembleError, match=r"another experiment: ensemble\.platform_mass\.normal is \[1"):
        gs.ensemble(other, out=tmp_path, resume=True)
    with pytest.raises(EnsembleError, match="members is 80 here and 40 there"):
        gs.ensemble(small(), out=tmp_path, members=80, resume=True)
    many = {"loop.delay": 2, "loop.duration": 0.011, "controller.damping_ratio": 0.9, "title": "b", "sensors.seed": 77}
    with pytest.raises(EnsembleError) as caught:
        gs.ensemble(small(), many, out=tmp_path, resume=True)
    told = re.findall(r"(?:: |; )([\w.]+) is \S+ here and \S+ there", str(caught.value))
    assert told == ["controller.damping_ratio", "loop.delay", "loop.duration"]  # the first three
    plan = json.loads((tmp_path / runner.PLAN).read_text())
    plan["made_with"]["numpy"] = "1.0"
    (tmp_path / runner.PLAN).write_text(json.dumps(plan))
    with pytest.raises(EnsembleError, match=r"results of other versions: numpy .* here and 1\.0 there"):
        gs.ensemble(small(), out=tmp_path, resume=True)
    (tmp_path / runner.PLAN).write_text("{}")
    with pytest.raises(EnsembleError, match="is not the plan of an ensemble"):
        gs.ensemble(small(), out=tmp_path, resume=True)
    assert files_in(tmp_path / FOLDER) == before


def test_a_full_disk_keeps_what_is_finished(
    undisturbed: Mapping[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: a clear error after the first chunk, no file of the second, and the same end after room was made."""
    with monkeypatch.context() as patch:
        write = ChunkFiles.write

        def full(self: ChunkFiles, first: int, chunk: ChunkBytes) -> None:
            if first:
                raise OSError(errno.ENOSPC, "No space left on device", str(self.rows(first)))
            write(self, first, chunk)

        patch.setattr(ChunkFiles, "write", full)
        with pytest.raises(OutputError, match=r"no space left on the disk; 1 finished chunk is kept in .*--resume"):
            gs.ensemble(small(), out=tmp_path, workers=1)
    assert {path.stem for path in (tmp_path / FOLDER).iterdir()} == {"00000000"}
    gs.ensemble(small(), out=tmp_path, workers=1, resume=True)
    assert files_in(tmp_path) == undisturbed


def test_a_disk_that_fills_up_leaves_no_torn_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: of a chunk whose second file cannot be written, nothing that counts."""
    whole = ChunkBytes(b"rows", b"bands", "features")
    files = ChunkFiles(tmp_path)
    write = Path.write_bytes

    def full(self: Path, content: bytes) -> int:
        if content == b"bands":
            write(self, content[:2])
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(self, content)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(OSError, match="No space left"):
            files.write(0, whole)
    assert files.features(0) is None
    assert not [path for path in files.folder.iterdir() if path.suffix == ".part"]
    files.write(0, whole)
    assert files.features(0) == "features"


def test_a_killed_worker_is_replaced(
    undisturbed: Mapping[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: its chunk is computed by another process, and the bytes are the same."""
    killed = list[int]()
    call = Isolated.call

    def kills(self: Isolated, method: str, *arguments: Any) -> Any:
        if method == "chunk" and arguments[1] == 16 and not killed:
            killed.append(self._process.pid)
            self._process.kill()
        return call(self, method, *arguments)

    monkeypatch.setattr(Isolated, "call", kills)
    monkeypatch.setattr(Future, "cancel", lambda _: False)  # the other process has to run them all
    gs.ensemble(small(), out=tmp_path, workers=2)
    assert len(killed) == 1
    assert files_in(tmp_path) == undisturbed


def test_this_process_is_one_of_the_workers(
    undisturbed: Mapping[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: it begins with the last chunk, each chunk is computed once, and the bytes are the same."""
    own, elsewhere = list[int](), list[int]()
    call = Isolated.call

    def here(plan: EnsemblePlan, first: int, last: int, threads: int = 1) -> Any:
        own.append(first)
        return chunk_of_plan(plan, first, last, threads)

    def there(self: Isolated, method: str, *arguments: Any) -> Any:
        elsewhere.extend([arguments[1]] if method == "chunk" else [])
        return call(self, method, *arguments)

    monkeypatch.setattr(processes, "chunk", here)
    monkeypatch.setattr(Isolated, "call", there)
    gs.ensemble(small(), out=tmp_path, workers=2)
    assert own[0] == max(own + elsewhere)
    assert sorted(own + elsewhere) == list(range(0, 16 * len(own + elsewhere), 16))
    assert files_in(tmp_path) == undisturbed


def test_a_worker_that_dies_again_and_again_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "_TRIES", 1)
    call = Isolated.call

    def kills(self: Isolated, method: str, *arguments: Any) -> Any:
        if method == "chunk":
            self._process.kill()
        return call(self, method, *arguments)

    monkeypatch.setattr(Isolated, "call", kills)
    monkeypatch.setattr(Future, "cancel", lambda _: False)
    with pytest.raises(EnsembleError, match=r"crashed \(SIGKILL\).*tried 1 times. Not enough memory"):
        gs.ensemble(small(), out=tmp_path, workers=2)


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "metric": (
        {"worst_by": "tracking.position.norm_rmz"},
        "worst_by: no metric 'tracking.position.norm_rmz'; did you mean 'tracking.position.norm_rms'",
    ),
    "signal": ({"signals": ["positon"]}, "ensemble.signals: no signal 'positon' for bands; did you mean 'position'"),
}


@pytest.mark.parametrize("what", BAD)
def test_names_that_are_not_there_are_refused_before_anything_runs(what: str, tmp_path: Path) -> None:
    table, message = BAD[what]
    with pytest.raises(ExperimentError) as caught:
        gs.ensemble(small(**table), out=tmp_path)
    assert message in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_member_without_margins_is_a_row_with_its_cause() -> None:
    """Expected: 60 samples of delay are 360 states and 18 more, above 300; the other members have their margins.

    Its run is what it was; a requirement on the margin counts it as one that does not hold it.
    """
    settings = {"loop.duration": 0.2, "ensemble": {"members": 4, "margins": True, "loop": {"delay": {"grid": [1, 60]}}}}
    found = gs.ensemble("heave_step", settings, workers=1)
    members = found.members
    assert members["outcome"].to_list() == ["completed"] * 4
    assert members["margins.disk"].is_null().to_list() == [False, True, False, True]
    assert members["margins.stable"].to_list() == [1.0, None, 1.0, None]
    assert members["cause"].is_null().to_list() == [True, False, True, False]
    cause = members["cause"][1]
    assert cause.startswith("no margins: a delay of 60 samples")
    assert "378 states" in cause
    report = found.report(charts=False)
    told = f"2 of 4 members completed but could not be judged; the first is member 1, {cause}"
    assert [note.text for note in report.notes if note.kind == "warning"] == [told]
    (judged,) = with_requirements(report, ["margins.disk >= 0.1"]).requirements
    assert (judged.status, judged.value) == ("missed", None)
    assert "2 of 4 members hold it; 2 of them without this number" in judged.note


def test_the_number_of_cores_is_that_of_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: three of eight that the process may use; all eight where a system has no such choice; at least one."""
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {1, 4, 6}, raising=False)
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    assert processes.cores() == 3
    monkeypatch.delattr("os.sched_getaffinity")
    assert processes.cores() == 8
    monkeypatch.setattr("os.cpu_count", lambda: None)
    assert processes.cores() == 1


def test_a_number_of_workers_below_one_is_refused() -> None:
    with pytest.raises(EnsembleError, match="workers is 0"):
        gs.ensemble(small(), workers=0)


@pytest.mark.parametrize("way", ["one worker", "one chunk", "all is done", "elsewhere", "two workers"])
def test_processes_are_started_only_where_chunks_wait_for_them(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: two of them for three chunks; none for one worker or chunk, a finished run, or a scheduler."""
    if way == "all is done":
        gs.ensemble(small(), members=3, workers=1, out=tmp_path)

    class Started(Exception):  # noqa: N818 - no error
        pass

    def start(number: int) -> None:
        raise Started(number)

    def ask(*_: Any) -> Iterator[Any]:
        raise EnsembleError("asked")

    monkeypatch.setattr(runner, "SIZE", 16 if way == "one chunk" else 1)
    monkeypatch.setattr(runner, "Workers", start)
    monkeypatch.setattr(processes.Workers, "__init__", lambda _, number: start(number))
    monkeypatch.setattr(runner, "chunks_there", ask)

    def run(**options: Any) -> gs.Ensemble:
        return gs.ensemble(small(), members=3, out=tmp_path, **options)

    if way == "two workers":
        # they import while the run is planned
        monkeypatch.setattr(runner, "plan_of", lambda *_: pytest.fail("planned before its processes were started"))
        with pytest.raises(Started, match="2"):
            run(workers=2)
    elif way == "elsewhere":
        with pytest.raises(EnsembleError, match="asked"):
            run(workers=2, scheduler="tcp://127.0.0.1:8786")
    else:
        found = run(workers=1 if way == "one worker" else 2, resume=way == "all is done")
        assert found.members["member"].to_list() == [0, 1, 2]
