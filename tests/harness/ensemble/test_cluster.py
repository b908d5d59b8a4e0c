"""A cluster on this machine's loopback: a real scheduler and real workers as processes, some of which are killed."""

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import gough_stewart as gs
from tests.harness.ensemble.memory import EXPERIMENT, SHORT, Pid
from tests.harness.ensemble.small_ensemble import MANY, SIZE, small
from tools.pages.blocks import ROOT

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")  # those of another project


class Cluster:
    """A scheduler, and workers of one thread each."""

    def __init__(self, folder: Path) -> None:
        self._folder, self.workers = folder, list[subprocess.Popen[bytes]]()
        self._environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
        said = folder / "scheduler.json"
        self._scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", said
        )
        wait_for(lambda: said.exists() and said.read_text().rstrip().endswith("}"))  # it is there before it is written
        self.file = said

    def add_worker(self, beside: str = "") -> None:
        """With a folder of modules beside the sources."""
        options = ("--nthreads", "1", "--no-dashboard", "--no-nanny", "--local-directory", self._folder)
        self._environment["PYTHONPATH"] = os.pathsep.join(filter(None, (beside, str(ROOT))))
        self.workers.append(self._start("worker", "--scheduler-file", self.file, *options))

    @property
    def address(self) -> str:
        """Of the scheduler."""
        return str(json.loads(self.file.read_text())["address"])

    def kill_worker(self) -> None:
        """The oldest."""
        oldest = self.workers.pop(0)
        oldest.kill()
        oldest.wait()

    def close(self) -> None:
        """All of it."""
        for process in (*self.workers, self._scheduler):
            process.kill()
            process.wait()

    def _start(self, what: str, *options: object) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", "distributed.cli.dask_" + what, *map(str, options)]
        with (self._folder / f"{what}.log").open("ab") as log:
            return subprocess.Popen(command, env=self._environment, cwd=self._folder, stdout=log, stderr=log)


def wait_for(there: Any, seconds: float = 60) -> None:
    """Until something is there."""
    end = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < end
        time.sleep(0.02)


OTHER = "import platform\n\nplatform.python_version = lambda: '3.0.1'\n"


@pytest.fixture(scope="module")
def refused(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Cluster, str]]:
    """The cluster, and what it said while its only worker had another version of Python."""
    started, beside = Cluster(tmp_path_factory.mktemp("cluster")), tmp_path_factory.mktemp("beside")
    (beside / "sitecustomize.py").write_text(OTHER)
    started.add_worker(str(beside))
    out = beside / "out"
    with pytest.raises(gs.GoughStewartError) as caught:
        gs.ensemble(small(), out=out, scheduler=started.address)
    assert not list(out.glob("chunks/*"))
    started.kill_worker()
    for _ in range(2):
        started.add_worker()
    yield started, str(caught.value)
    started.close()


@pytest.fixture(scope="module")
def cluster(refused: tuple[Cluster, str]) -> Cluster:
    """With two workers like this process."""
    return refused[0]


def test_a_worker_with_other_versions_is_refused_before_anything_runs(refused: tuple[Cluster, str]) -> None:
    python = ".".join(map(str, sys.version_info[:3]))
    words = rf"tcp://\S+ differs from this machine: python {re.escape(python)} here and 3\.0\.1 there; install the same"
    assert re.search(words, refused[1]), refused[1]


def test_workers_get_a_controller_from_python(cluster: Cluster) -> None:
    """Expected: the members of one process, with a class that no module on their path has."""

    class Local(Pid):
        pass

    there = gs.ensemble(EXPERIMENT, SHORT, controller=Local, members=4, scheduler=cluster.address)
    here = gs.ensemble(EXPERIMENT, SHORT, controller=Local, members=4, workers=1)
    assert there.members.equals(here.members, null_equal=True)


def test_a_worker_killed_in_mid_run_changes_no_byte(cluster: Cluster, tmp_path: Path) -> None:
    """Expected: the files of a run without a cluster. The last that uses it: it has one worker afterwards."""
    done = list[int]()

    def progress(members: int, _total: int) -> None:
        if not done:
            cluster.kill_worker()
        done.append(members)

    for name, options in (("here", {"workers": 1}), ("there", {"scheduler": cluster.address, "progress": progress})):
        gs.ensemble("heave_step", MANY, members=6 * SIZE, out=tmp_path / name, **options)
    assert (len(done), done[-1]) == (6, 6 * SIZE)
    here, there = ({path.name: path.read_bytes() for path in (tmp_path / n).iterdir()} for n in ("here", "there"))
    assert here == there


def test_a_scheduler_that_is_not_there_is_said_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: within the ten seconds, made one here."""
    monkeypatch.setattr("gough_stewart.harness.ensemble.workers.TIMEOUT", 1)
    begin = time.monotonic()
    with pytest.raises(
        gs.GoughStewartError, match=r"no scheduler at tcp://127\.0\.0\.1:9 within 1 s: .*dask scheduler"
    ):
        gs.ensemble(small(members=8), out=tmp_path, scheduler="tcp://127.0.0.1:9")
    assert time.monotonic() - begin < 15


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(gs.GoughStewartError, match=r"pip install 'gough-stewart\[cluster\]'"):
        gs.ensemble(small(members=8), scheduler="tcp://127.0.0.1:9")
