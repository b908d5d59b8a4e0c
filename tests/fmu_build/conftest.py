"""The native FMUs of the uneven platform, one by one."""

from pathlib import Path

import pytest

from gough_stewart.fmu_build.build import build
from tests.support.fmu_plants import Fmu
from tests.support.uneven import UNEVEN


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fmu]:
    """By FMI version: archives and what is in them."""
    folder = tmp_path_factory.mktemp("fmus")
    return {str(fmu.description.fmiVersion): fmu for fmu in (Fmu(path) for path in build(folder, platform=UNEVEN))}


@pytest.fixture(scope="session")
def fmu2(fmus: dict[str, Fmu]) -> Fmu:
    """FMI 2.0."""
    return fmus["2.0"]


@pytest.fixture(scope="session")
def fmu3(fmus: dict[str, Fmu]) -> Fmu:
    """FMI 3.0."""
    return fmus["3.0"]


@pytest.fixture(params=["2.0", "3.0"])
def fmu(request: pytest.FixtureRequest, fmus: dict[str, Fmu]) -> Fmu:
    """Both, one after the other."""
    return fmus[request.param]


@pytest.fixture
def fmu_folder(fmus: dict[str, Fmu]) -> Path:
    """Where the archives lie."""
    return next(iter(fmus.values())).path.parent
