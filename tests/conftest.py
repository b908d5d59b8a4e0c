"""Fixtures and hypothesis profiles for all tests."""

import os

import pytest
from hypothesis import settings

from gough_stewart.fmu_build.build import build
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from tests.support.fmu_plants import Fmu
from tests.support.random_platforms import Sample, random_sample

# derandomize: a failure in CI is the same failure at home. `make evidence` searches wider.
settings.register_profile("test", max_examples=40, deadline=None, derandomize=True)
settings.register_profile("evidence", max_examples=2000, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "test"))


@pytest.fixture(scope="session")
def paper() -> Platform:
    """The published platform."""
    return load_preset("liu2000")


@pytest.fixture(scope="session")
def thousand() -> Sample:
    """1,000 random platforms in random states."""
    return random_sample(1000, seed=2000)


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fmu]:
    """The native FMUs by FMI version, built once for all tests: archives and what is in them."""
    folder = tmp_path_factory.mktemp("fmus")
    return {str(fmu.description.fmiVersion): fmu for fmu in (Fmu(path) for path in build(folder))}
