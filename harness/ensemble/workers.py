"""Chunks on this machine's cores or on a cluster: in this process, in others that are restarted, on workers of dask."""

import hashlib
import os
import pickle
import platform
import threading
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import closing
from functools import cache, lru_cache
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import gough_stewart
from gough_stewart.harness.control.linear_controller import LinearController
from gough_stewart.harness.control.makers import name_of
from gough_stewart.harness.ensemble.chunk import Chunk, chunk
from gough_stewart.harness.errors import ControllerError, EnsembleError
from gough_stewart.harness.experiment.members import Members, members_from
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.plants.isolated import Isolated

# The first member, and the one after the last.
Range = tuple[int, int]
Chunks = Generator[tuple[Range, Chunk], None, None]
# So many chunks for each process take longer than one needs to import its modules.
_CHUNKS_A_PROCESS = 4
# How often a chunk is tried if its process dies.
_TRIES = 3
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS")
# How often it is looked whether a chunk has come [s], so that Ctrl-C acts soon.
_WAIT = 0.2
TIMEOUT = 10  # [s], for an answer of the scheduler, and for its first worker
# Chunks submitted per worker thread: one running, and the next.
_AHEAD = 2
_SOURCES = ("*.py", "*.c", "*.h", "*.toml")


def cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processes_for(chunks: int, number: int, experiment: Experiment, controller: Any = None) -> int:
    """Processes that are worth their start, of a number of cores: fewer than two if this one is enough.

    Of loops in machine code threads share the work, but for what Python does for each chunk.
    """
    is_linear = isinstance(controller, LinearController) if controller is not None else not experiment.controller.code
    return min(number, chunks // (_CHUNKS_A_PROCESS if is_linear else 1))


# --- on this machine


class Worker:
    """The object in each worker process."""

    def chunk(self, plan: str, first: int, last: int, controller: bytes | None = None) -> Chunk:
        """A chunk of a plan, which comes as its text, with its controller from Python as `packed` made it."""
        return chunk(unpacked(plan, controller), first, last)

    def close(self) -> None:
        """Nothing to release."""


class _DiedError(EnsembleError):
    """The process of a worker has ended."""


def chunks_here(members: Members, ranges: Sequence[Range], workers: "int | Workers") -> Chunks:
    """Finished chunks, in any order, from a number of cores, or from workers that have been started already.

    `EnsembleError` if the process of a chunk died repeatedly.
    """
    if isinstance(workers, Workers):
        yield from workers.chunks(members, ranges)
        return
    number = processes_for(len(ranges), workers, members.nominal, members.controller)
    if number > 1:
        with closing(Workers(number)) as started:
            yield from started.chunks(members, ranges)
        return
    for part in ranges:
        yield part, chunk(members, *part, workers)


class Workers:
    """Processes for chunks: the present one, and others, one per thread here, which start to import at once."""

    def __init__(self, number: int) -> None:
        """Start one process fewer than `number`, which is two or more."""
        self._of_thread, self._lock = threading.local(), threading.Lock()
        self._open, self._ended = list[Isolated](), False
        self._threads = ThreadPoolExecutor(number - 1)
        for _ in range(number - 1):
            self._threads.submit(self._worker)  # an error here recurs with the first chunk

    def close(self) -> None:
        """Kill all processes; their work is lost."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        with self._lock:
            self._ended = True
            open_now, self._open = self._open, []
        for worker in open_now:
            worker.kill()

    def chunks(self, members: Members, ranges: Sequence[Range]) -> Chunks:
        """Finished chunks, in any order: the other processes begin with the first range, this one with the last."""
        plan, controller = members.text, packed(members.controller)
        waiting = {self._threads.submit(self._chunk, plan, controller, part): part for part in ranges}
        while waiting:
            taken_back = next((future for future in reversed(waiting) if future.cancel()), None)
            if taken_back is not None:
                part = waiting.pop(taken_back)
                yield part, chunk(members, *part)
            for future in wait(waiting, _WAIT if taken_back is None else 0, FIRST_COMPLETED).done:
                yield waiting.pop(future), future.result()

    def _chunk(self, plan: str, controller: bytes | None, members: Range) -> Chunk:
        """A chunk from this thread's process, which is restarted if it dies."""
        for tries in range(1, _TRIES + 1):
            try:
                content: Chunk = self._worker().call("chunk", plan, *members, controller)
            except _DiedError as error:
                worker: Isolated | None = vars(self._of_thread).pop("worker", None)
                if worker is not None:
                    with self._lock:
                        self._open = [still_open for still_open in self._open if still_open is not worker]
                    worker.close()
                if tries == _TRIES or self._ended:
                    raise EnsembleError(
                        f"members {members[0]} to {members[1] - 1}: {error}; tried {_TRIES} times. Not enough memory? "
                        "Use fewer --workers"
                    ) from error
            else:
                return content
        raise AssertionError

    def _worker(self) -> Isolated:
        """The process of this thread, started if there is none."""
        worker: Isolated | None = vars(self._of_thread).get("worker")
        if worker is None:
            name = Path(f"worker {threading.current_thread().name.rpartition('_')[2]}")
            kind = f"{Worker.__module__}:{Worker.__name__}"
            worker = Isolated(name, kind, (), _DiedError, dict.fromkeys(_THREADS, "1"))
            with self._lock:
                if self._ended:
                    worker.kill()
                    raise _DiedError("ended")
                self._open.append(worker)
            self._of_thread.worker = worker
        return worker


# --- on a cluster


def chunks_there(members: Members, ranges: Sequence[Range], address: str) -> Chunks:
    """Finished chunks of the workers, in any order; if a worker dies, others compute its chunks.

    `EnsembleError` without dask.distributed, without an answer within `TIMEOUT`, or of workers with other versions.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise EnsembleError(
            "a scheduler needs dask.distributed; install it: pip install 'gough-stewart[cluster]'"
        ) from None
    try:
        client = distributed.Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else "no answer"
        raise EnsembleError(
            f"no scheduler at {address} within {TIMEOUT} s: {reason}; expected the address that `dask scheduler` "
            "prints, such as tcp://10.0.0.1:8786"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=TIMEOUT)
        except TimeoutError:
            raise EnsembleError(
                f"the scheduler at {address} has no workers; start some: dask worker {address}"
            ) from None
        for worker, versions in client.run(exact_versions).items():
            _check(exact_versions(), versions, worker)
        text, ours, waiting = members.text, exact_versions(), list(reversed(ranges))
        controller = packed(members.controller)
        under_way: dict[Any, Range] = {}

        def submit() -> Any:
            part = waiting.pop()
            # not pure: results that dask has kept from another run must not be used
            future = client.submit(chunk_there, text, ours, *part, controller, pure=False)
            under_way[future] = part
            return future

        many = _AHEAD * max(1, sum(client.nthreads().values()))
        ready = distributed.as_completed([submit() for _ in range(min(many, len(waiting)))], loop=client.loop)
        for future in ready:
            try:
                content = future.result()
            except (distributed.KilledWorker, distributed.CancelledError) as error:
                first, last = under_way[future]
                raise EnsembleError(
                    f"members {first} to {last - 1}: workers died repeatedly ({error}); not enough memory?"
                ) from error
            yield under_way.pop(future), content
            if waiting:
                ready.add(submit())


def chunk_there(text: str, ours: dict[str, str], first: int, last: int, controller: bytes | None = None) -> Chunk:
    """On a worker: compute a chunk of a plan's text; workers that join later are checked here."""
    _check(ours, exact_versions(), "a worker")
    return chunk(unpacked(text, controller), first, last)


def _check(ours: dict[str, str], theirs: dict[str, str], worker: str) -> None:
    if differs := difference(ours, theirs):
        raise EnsembleError(f"{worker} differs from this machine: {differs}; install the same versions there")


@cache
def exact_versions() -> dict[str, str]:
    """Versions of this project, its sources, Python and NumPy in this process."""
    root, digest = Path(gough_stewart.__file__).parent, hashlib.sha256()
    rooms = [root / room for room in ("model", "fmu_build", "harness")]
    files = {
        path.relative_to(root).as_posix(): path for room in rooms for kind in _SOURCES for path in room.rglob(kind)
    }
    for name in sorted(files):
        digest.update(name.encode() + b"\0" + files[name].read_bytes() + b"\0")
    return {
        "gough-stewart": version("gough-stewart"),
        "sources": digest.hexdigest()[:16],
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def difference(here: dict[str, str], there: dict[str, str]) -> str:
    """Which versions differ, as text; empty if none."""
    names = [name for name in here if here[name] != there.get(name)]
    return ", ".join(f"{name} {here[name]} here and {there.get(name, 'unknown')} there" for name in names)


# --- controllers from Python


def packed(controller: Any) -> bytes | None:
    """A controller from Python, if there is one, for a worker; `ControllerError` if it cannot be pickled.

    cloudpickle, which comes with dask.distributed, is used if it is installed: it also packs what is defined in a
    notebook, in a script or inside a function.
    """
    if controller is None:
        return None
    has_cloudpickle = find_spec("cloudpickle") is not None
    try:
        modules = (type(controller).__module__, getattr(controller, "__module__", ""))
        if not has_cloudpickle and "__main__" in modules:
            raise pickle.PicklingError("it is defined in the program itself, which workers do not run")  # noqa: TRY301
        pickler: Any = import_module("cloudpickle") if has_cloudpickle else pickle
        content: bytes = pickler.dumps(controller)
    except Exception as error:  # user code may raise anything
        remedy = "" if has_cloudpickle else "install cloudpickle, "
        raise ControllerError(
            f"the controller {name_of(controller)} cannot be passed to other processes "
            f"({type(error).__name__}: {error}); {remedy}define it in a module, name it in the experiment file "
            "(type = 'python'), or use workers=1"
        ) from error
    return content


@lru_cache(2)
def unpacked(plan: str, content: bytes | None) -> Members:
    """The members of a plan, with its controller, on a worker; `ControllerError` if its modules are not there."""
    try:
        controller: Any = None if content is None else pickle.loads(content)
    except Exception as error:  # user code may raise anything
        raise ControllerError(
            f"a worker cannot load the controller ({type(error).__name__}: {error}); its modules have to be on the "
            "workers' path"
        ) from error
    return members_from(plan, controller)
