"""Chunks on this machine's cores: in this process, and in others that are restarted if one dies."""

import os
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any, Self

from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.ensemble.chunk import chunk
from gough_stewart.harness.ensemble.chunk_files import ChunkBytes
from gough_stewart.harness.ensemble.passing import packed, unpacked
from gough_stewart.harness.errors import EnsembleError
from gough_stewart.harness.experiment.plan import EnsemblePlan
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.plants.isolated import Isolated

# The first member, and the one after the last.
Range = tuple[int, int]
# So many chunks for each process take longer than one needs to import its modules.
_CHUNKS_A_PROCESS = 4
# How often a chunk is tried if its process dies.
_TRIES = 3
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS")
# How often it is looked whether a chunk has come [s], so that Ctrl-C acts soon.
_WAIT = 0.2


def cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processes_for(chunks: int, number: int, experiment: Experiment, controller: Any = None) -> int:
    """Processes that are worth their start, of a number of cores: fewer than two if this one is enough.

    Of loops in machine code threads share the work, but for what Python does for each chunk.
    """
    is_linear = isinstance(controller, LinearController) if controller is not None else not experiment.controller.code
    return min(number, chunks // (_CHUNKS_A_PROCESS if is_linear else 1))


class Worker:
    """The object in each worker process."""

    def chunk(self, plan: str, first: int, last: int, controller: bytes | None = None) -> ChunkBytes:
        """See `chunk.chunk`; a plan as `EnsemblePlan.text`, and its controller from Python as `packed`."""
        return ChunkBytes.of(chunk(unpacked(plan, controller), first, last))

    def close(self) -> None:
        """Nothing to release."""


def chunks_here(
    plan: EnsemblePlan, ranges: Sequence[Range], workers: "int | Workers"
) -> Iterator[tuple[Range, ChunkBytes]]:
    """Finished chunks, in any order, from a number of cores, or from workers that have been started already.

    Raises
    ------
    EnsembleError
        A chunk whose process died repeatedly.
    """
    if isinstance(workers, Workers):
        yield from workers.chunks(plan, ranges)
    elif (
        number := processes_for(len(ranges), workers, plan.prepared.nominal, plan.prepared.preparation.controller)
    ) > 1:
        with Workers(number) as started:
            yield from started.chunks(plan, ranges)
    else:
        for each in ranges:
            yield each, ChunkBytes.of(chunk(plan, *each, workers))


class Workers:
    """Processes for chunks: the present one, and others, one per thread here, which start to import at once."""

    def __init__(self, number: int) -> None:
        """Start one process fewer than `number`, which is two or more."""
        self._own, self._lock = threading.local(), threading.Lock()
        self._open, self._ended = list[Isolated](), False
        self._threads = ThreadPoolExecutor(number - 1)
        for _ in range(number - 1):
            self._threads.submit(self._worker)  # an error here recurs with the first chunk

    def __enter__(self) -> Self:
        """The starting processes."""
        return self

    def __exit__(self, *_: object) -> None:
        """Kill all processes; their work is lost."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        with self._lock:
            self._ended = True
            open_now, self._open = self._open, []
        for worker in open_now:
            worker.kill()

    def chunks(self, plan: EnsemblePlan, ranges: Sequence[Range]) -> Iterator[tuple[Range, ChunkBytes]]:
        """See `chunks_here`. The others begin with the first chunk, this process with the last."""
        controller = packed(plan)
        waiting = {self._threads.submit(self._chunk, plan.text, controller, each): each for each in ranges}
        while waiting:
            own = next((each for each in reversed(waiting) if each.cancel()), None)
            if own is not None:
                own_range = waiting.pop(own)
                yield own_range, ChunkBytes.of(chunk(plan, *own_range))
            for done in wait(waiting, _WAIT if own is None else 0, FIRST_COMPLETED).done:
                yield waiting.pop(done), done.result()

    def _chunk(self, plan: str, controller: bytes | None, members: Range) -> ChunkBytes:
        """A chunk from this thread's process, which is restarted if it dies."""
        for last in (*[False] * (_TRIES - 1), True):
            try:
                found: ChunkBytes = self._worker().call("chunk", plan, *members, controller)
            except _DiedError as error:
                self._forget()
                if last or self._ended:
                    raise EnsembleError(
                        f"members {members[0]} to {members[1] - 1}: {error}; tried {_TRIES} times. Not enough memory? "
                        "Use fewer --workers"
                    ) from error
            else:
                return found
        raise AssertionError

    def _forget(self) -> None:
        """Drop the ended process of this thread."""
        worker: Isolated | None = vars(self._own).pop("worker", None)
        if worker is not None:
            with self._lock:
                if worker in self._open:
                    self._open.remove(worker)
            worker.close()

    def _worker(self) -> Isolated:
        worker: Isolated | None = vars(self._own).get("worker")
        if worker is None:
            name = Path(f"worker {threading.current_thread().name.rpartition('_')[2]}")
            kind = f"{Worker.__module__}:{Worker.__name__}"
            worker = Isolated(name, kind, (), _DiedError, dict.fromkeys(_THREADS, "1"))
            with self._lock:
                if self._ended:
                    worker.kill()
                    raise _DiedError("ended")
                self._open.append(worker)
            self._own.worker = worker
        return worker


class _DiedError(EnsembleError):
    """The process of a worker has ended."""
