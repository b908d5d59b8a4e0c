"""The native FMUs of the uneven platform, one by one."""

from typing import Any

import pytest

import gough_stewart as gs
from tests.support.fmu_plants import Fmu
from tests.support.real_platforms import real_platform
from tests.support.shared import shared_folder
from tests.support.uneven import UNEVEN

# Softer than a machine's, so that its reference results take a fourth of the time; tests set their own.
SOFT: dict[str, Any] = {"leg_bristle_stiffness": 1e5, "leg_bristle_damping": 40.0, "leg_stribeck_velocity": 0.05}


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


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fmu]:
    """By FMI version, of the uneven platform with stiction and elastic legs."""
    platform = real_platform("lugre", springs=True, **SOFT)
    folder = shared_folder(tmp_path_factory, "whole", lambda folder: gs.build(folder, platform=platform))
    return {unit.version: unit for unit in map(Fmu, sorted(folder.glob("*.fmu")))}


@pytest.fixture(scope="session")
def sticking(tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    """FMI 3.0, of the uneven platform with stiction and rigid legs."""
    return Fmu(gs.build(tmp_path_factory.mktemp("sticking"), platform=real_platform("lugre", **SOFT), fmi=["3.0"])[0])


@pytest.fixture(params=["ideal-2.0", "ideal-3.0", "whole-2.0", "whole-3.0"])
def any_fmu(request: pytest.FixtureRequest, fmus: dict[str, Fmu]) -> Fmu:
    """Both, and both of a platform with all kinds of states."""
    kind, version = request.param.split("-")
    units: dict[str, Fmu] = fmus if kind == "ideal" else request.getfixturevalue("whole")
    return units[version]
