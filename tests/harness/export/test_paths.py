"""Motions along a path in exported C: from splines and time law, against the pieces that the harness plays."""

import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart.harness.control.controllers import feedforward
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.export.design import Designed, designed
from gough_stewart.harness.export.tables import path_of
from gough_stewart.harness.export.write import controller_sources
from gough_stewart.harness.motion.motion import coordinates_of
from gough_stewart.harness.motion.paths.polynomials import Polynomials
from tests.harness.export.test_toolchains import M4F
from tests.support.exported import Exported, compiled, write_sources

OPEN = {"controller": {"type": "open_loop", "feedforward": "computed_torque"}}
MOTIONS: dict[str, dict[str, Any]] = {
    "as shipped": {},
    "without a ramp": {"reference.ramp": 0.0},
    "slower and smaller, through cubic splines": {
        "reference.interpolation": "cubic",
        "reference.time_scale": 1.3,
        "reference.amplitude_scale": -0.6,
    },
    "in a chosen time from the beginning": {
        "reference.timing": 5.0,
        "reference.margin": 0.0,
        "reference.ramp": 0.0,
        "reference.at": 0.0,
    },
}


@cache
def made_along(motion: str) -> Designed:
    """A controller of nothing but the feedforward; plans take their time."""
    return designed(load_experiment("fastest_path", {**OPEN, **MOTIONS[motion], "loop.duration": 0.5}))


@pytest.mark.parametrize("motion", MOTIONS)
def test_forces_along_a_path_are_those_of_a_run(motion: str) -> None:
    """Expected: inverse dynamics in NumPy of the harness's motion, to the share of the largest force in the header.

    That is at most 1e-6. From before the motion to after its end, at the middle of every sample's action; the header's
    figure is the largest at other instants.
    """
    made = made_along(motion)
    reference = made.reference
    assert isinstance(reference, Polynomials)
    samples = np.arange(int(reference.end / made.sample_time) + 20)
    times = np.minimum((samples + made.delay + 0.5) * made.sample_time, reference.end)
    after = samples * made.sample_time > reference.end
    at = reference(np.where(after, reference.end + 1.0, times))
    exported = Exported(made)
    expected = feedforward("computed_torque", made.platform, at)
    found = np.abs(exported.forces(np.zeros((len(samples), 0))) - expected).max() / np.abs(expected).max()
    stated = re.search(r"torque by at most\s+(\S+)\s+of\s+the\s+largest", exported.sources.headers["controller.h"])
    assert stated is not None
    assert found < 1e-6
    assert found / 3 < float(stated[1]) < 1e-6


@pytest.mark.parametrize("motion", MOTIONS)
def test_pieces_follow_their_path(motion: str) -> None:
    """Expected: the path at the law's parameter, evaluated itself; 0.1 nm, and accelerations to 1e-5 m/s²."""
    reference = made_along(motion).reference
    source = path_of(reference)
    assert isinstance(reference, Polynomials)
    assert source is not None
    times = np.random.default_rng(4).uniform(source.start, source.end, 20000)
    found, expected = (np.stack(coordinates_of(each(times))) for each in (reference, source))
    assert (np.abs(found - expected).max(axis=(1, 2)) < [1e-10, 1e-8, 1e-5]).all()


def test_a_path_takes_little_flash(tmp_path: Path) -> None:
    """Expected: constants of at most 64 KiB, as stated; what a compiler for a Cortex-M4F makes holds them and code."""
    made = made_along("as shipped")
    assert isinstance(made.reference, Polynomials)
    assert made.reference.coefficients.nbytes > 800_000
    sources = controller_sources(made)
    stated = re.search(r"Constants in flash: (\d+) bytes", sources.headers["controller.h"])
    assert stated is not None
    assert 0 < int(stated[1]) <= 64 * 1024
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("arm-none-eabi-gcc is not installed")
    write_sources(sources, tmp_path)
    compiled(["arm-none-eabi-gcc", *M4F, "-std=c11", "-Os", "-c", "controller.c"], tmp_path)
    sizes = subprocess.run(
        ["arm-none-eabi-size", "controller.o"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    flash = int(sizes.stdout.splitlines()[1].split()[0])
    assert int(stated[1]) < flash < 128 * 1024
