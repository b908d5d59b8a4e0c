"""Motions along a path in exported C: from splines and time law, against the pieces that the harness plays."""

import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart import load_experiment
from gough_stewart.harness.control.controllers import feedforward
from gough_stewart.harness.export.design import Designed, designed
from gough_stewart.harness.export.write import controller_sources, deviation_of
from gough_stewart.harness.motion.paths.time_law import Polynomials
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
    """Expected: inverse dynamics in NumPy of the harness's motion, to 1e-6 of the largest force.

    From before the motion to after its end, at the middle of every sample's action.
    """
    made = made_along(motion)
    reference = made.reference
    assert isinstance(reference, Polynomials)
    samples = np.arange(int(reference.end / made.sample_time) + 20)
    times = np.minimum((samples + made.delay + 0.5) * made.sample_time, reference.end)
    after = samples * made.sample_time > reference.end
    at = reference(np.where(after, reference.end + 1.0, times))
    expected = feedforward("computed_torque", made.platform, at)
    forces = Exported(made).forces(np.zeros((len(samples), 0)))
    assert np.abs(forces - expected).max() < 1e-6 * np.abs(expected).max()


def test_the_header_says_what_the_rounding_of_a_path_costs() -> None:
    """Expected: what was found above, of these 0.5 s, which is not nothing; in words by `deviation_of`."""
    experiment = load_experiment("fastest_path", {**OPEN, "loop.duration": 0.5, "reference.at": 0.0})
    stated = re.search(
        r"forces differ from those of a run by (\S+) of these", deviation_of(experiment, designed(experiment), "p")
    )
    assert stated is not None
    assert 1e-12 < float(stated[1]) < 1e-6


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
