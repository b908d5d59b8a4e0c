"""The native FMUs of the uneven platform, one by one."""

import pytest

import gough_stewart as gs
from tests.support.fmu_plants import Fmu
from tests.support.uneven import UNEVEN


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fmu]:
    """By FMI version: archives and what is in them."""
    units = map(Fmu, gs.build(tmp_path_factory.mktemp("fmus"), platform=UNEVEN))
    return {unit.version: unit for unit in units}


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
