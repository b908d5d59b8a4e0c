"""The native FMUs, one by one."""

from pathlib import Path

import pytest

from tests.support.fmu_plants import Fmu


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
