"""The pictures of an ensemble, drawn by a process of its own while the worst members run in this one."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.ensemble.sensitivity import Sensitivity
from gough_stewart.harness.errors import EnsembleError
from gough_stewart.harness.plants.isolated import Isolated


class Artist:
    """What runs in the other process."""

    def figures(self, ensemble: Ensemble, by: str, found: Sensitivity | None) -> dict[str, bytes]:
        """See `ensemble_figures`."""
        return _drawn_here(ensemble, by, found)

    def close(self) -> None:
        """Nothing is open."""


@contextmanager
def figures_aside(ensemble: Ensemble, by: str, found: Sensitivity | None) -> Iterator[Callable[[], dict[str, bytes]]]:
    """Start drawing; what is yielded waits for `ensemble_figures`. They are drawn here if the other process dies."""
    started: list[Isolated] = []

    def drawn() -> dict[str, bytes]:
        started.append(Isolated(Path("pictures"), f"{Artist.__module__}:{Artist.__name__}", (), _DiedError))
        pictures: dict[str, bytes] = started[0].call("figures", ensemble, by, found)
        return pictures

    def pictures() -> dict[str, bytes]:
        try:
            return waiting.result()
        except (_DiedError, OSError):
            return _drawn_here(ensemble, by, found)

    with ThreadPoolExecutor(1) as threads:
        waiting = threads.submit(drawn)
        try:
            yield pictures
        finally:
            for process in started:
                process.kill()


def _drawn_here(ensemble: Ensemble, by: str, found: Sensitivity | None) -> dict[str, bytes]:
    # its import takes as long as some of the pictures
    from gough_stewart.harness.ensemble.figures import ensemble_figures

    return ensemble_figures(ensemble, by, found)


class _DiedError(EnsembleError):
    """The process of the pictures has ended."""
