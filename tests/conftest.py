"""Fixtures and hypothesis profiles for all tests."""

import os
from collections.abc import Iterator
from pathlib import Path

# Before NumPy comes: six legs keep no second thread busy, and each worker of pytest-xdist has a core of its own.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings
from playwright.sync_api import Browser

from gough_stewart import Platform, build, load_preset
from tests.support.browser import CHROMIUM, chromium
from tests.support.demo import Demo, run_demo
from tests.support.fmu_plants import Fmu
from tests.support.shared import shared_folder

# derandomize: a failure in CI is the same failure at home. `make evidence` searches wider.
settings.register_profile("test", max_examples=25, deadline=None, derandomize=True)
settings.register_profile("evidence", max_examples=2000, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "test"))


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not import slow evidence that is not asked for: it takes seconds, in each worker."""
    if collection_path.name == "evidence" and config.option.markexpr == "not evidence":
        return True
    return None


@pytest.fixture(scope="session")
def paper() -> Platform:
    """The published platform."""
    return load_preset("liu2000")


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fmu]:
    """The native FMUs by FMI version, built once for all tests and workers: archives and what is in them."""
    folder = shared_folder(tmp_path_factory, "fmus", build)
    fmus = (Fmu(path) for path in sorted(folder.glob("*.fmu")))
    return {fmu.version: fmu for fmu in fmus}


@pytest.fixture
def units_in_process(fmus: dict[str, Fmu], monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs through an FMU take the native ones of the session as those of the cache, in this process."""
    monkeypatch.setattr("gough_stewart.harness.plants.open.cached_build", lambda version, *_: fmus[version].path)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium, if there is one; started once, since Playwright runs once in a process."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here; `make evidence` insists on it")
    with chromium() as started:
        yield started


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    """What `make demo` makes, run once for all tests and workers."""
    folder = shared_folder(tmp_path_factory, "demo", run_demo)
    return Demo(folder / "paper", folder / "heave", (folder / "printed.txt").read_text())
