"""Chunks on a cluster, by dask.distributed."""

from collections.abc import Iterator, Sequence
from typing import Any

from gough_stewart.harness.ensemble.chunk import chunk
from gough_stewart.harness.ensemble.chunk_files import ChunkBytes
from gough_stewart.harness.ensemble.exact_versions import difference, exact_versions
from gough_stewart.harness.ensemble.local import Range
from gough_stewart.harness.ensemble.passing import packed, unpacked
from gough_stewart.harness.errors import EnsembleError
from gough_stewart.harness.experiment.plan import EnsemblePlan

TIMEOUT = 10  # [s], for an answer of the scheduler, and for its first worker
# Chunks submitted per worker thread: one running, and the next.
_AHEAD = 2


def chunks_there(plan: EnsemblePlan, ranges: Sequence[Range], address: str) -> Iterator[tuple[Range, ChunkBytes]]:
    """Finished chunks of the workers, in any order; if a worker dies, others compute its chunks.

    Raises
    ------
    EnsembleError
        No dask.distributed, no scheduler or worker within `TIMEOUT`, or workers with other versions.
    """
    distributed = _distributed()
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
        for worker, theirs in client.run(_versions_there).items():
            _check(theirs, worker)
        yield from _chunks(client, distributed, plan, ranges)


def _chunks(
    client: Any, distributed: Any, plan: EnsemblePlan, ranges: Sequence[Range]
) -> Iterator[tuple[Range, ChunkBytes]]:
    text, ours, waiting, controller = plan.text, exact_versions(), list(reversed(ranges)), packed(plan)

    def submit() -> Any:
        each = waiting.pop()
        # not pure: results that dask has kept from another run must not be used
        future = client.submit(chunk_there, text, ours, *each, controller, pure=False)
        under_way[future] = each
        return future

    under_way: dict[Any, Range] = {}
    many = _AHEAD * max(1, sum(client.nthreads().values()))
    ready = distributed.as_completed([submit() for _ in range(min(many, len(waiting)))], loop=client.loop)
    for future in ready:
        try:
            found = future.result()
        except (distributed.KilledWorker, distributed.CancelledError) as error:
            first, last = under_way[future]
            raise EnsembleError(
                f"members {first} to {last - 1}: workers died repeatedly ({error}); not enough memory?"
            ) from error
        yield under_way.pop(future), found
        if waiting:
            ready.add(submit())


def chunk_there(text: str, ours: dict[str, str], first: int, last: int, controller: bytes | None = None) -> ChunkBytes:
    """On a worker: compute a chunk of a plan's text; workers that join later are checked here."""
    _check(exact_versions(), "a worker", ours)
    return ChunkBytes.of(chunk(unpacked(text, controller), first, last))


def _versions_there() -> dict[str, str] | None:
    try:
        return exact_versions()
    except ImportError:
        return None


def _check(theirs: dict[str, str] | None, worker: str, ours: dict[str, str] | None = None) -> None:
    differs = "gough-stewart is not installed there" if theirs is None else difference(ours or exact_versions(), theirs)
    if differs:
        raise EnsembleError(f"{worker} differs from this machine: {differs}; install the same versions there")


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise EnsembleError(
            "a scheduler needs dask.distributed; install it: pip install 'gough-stewart[cluster]'"
        ) from None
    return distributed
