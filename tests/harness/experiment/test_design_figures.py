"""Pictures of a design: files of the right kind, the same twice, with the margins said, for every loop that has any."""

import math
from typing import Any
from xml.etree import ElementTree as ET

import control
import numpy as np
import pytest

from gough_stewart.harness.control.gains import gains_from_bandwidth
from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.loop_transfer import loop_transfer
from gough_stewart.harness.control.margins import Margins, loop_margins
from gough_stewart.harness.control.pid import pid, sampled
from gough_stewart.harness.experiment.design_figures import design_figures
from gough_stewart.model.platform_toml import load_preset


def drawn(L: Any, margins: Margins | None = None) -> dict[str, bytes]:
    return design_figures(L, margins or loop_margins(L), "a $design & more_")


def diagonal(one: Any) -> Any:
    return control.append(*[control.ss(one)] * 6)


@pytest.fixture(scope="module")
def real_loop() -> Any:
    platform = load_preset("motion_base")
    controller = LinearController(sampled(pid(gains_from_bandwidth(platform, 4.0, 0.8)), 1e-3))
    return loop_transfer(platform, controller, 1e-3, delay=2)


@pytest.fixture(scope="module")
def real_margins(real_loop: Any) -> Margins:
    return loop_margins(real_loop)


@pytest.fixture(scope="module")
def files(real_loop: Any, real_margins: Margins) -> dict[str, bytes]:
    return drawn(real_loop, real_margins)


def last_time(svg: bytes) -> float:
    """The last label of the time axis [s]; texts are comments in the SVG, the horizontal axis comes first."""
    text = svg.decode()
    labels = text[text.index('id="matplotlib.axis_1"') : text.index('id="matplotlib.axis_2"')].split("<!-- ")[1:-1]
    return float(labels[-1].split(" -->")[0])


def test_files_are_png_and_small_svg(files: dict[str, bytes]) -> None:
    assert sorted(files) == ["bode.png", "bode.svg", "step.png", "step.svg"]
    for name, file in files.items():
        if name.endswith("png"):
            assert file.startswith(b"\x89PNG\r\n\x1a\n")
        else:
            assert ET.fromstring(file).tag.endswith("svg")
            assert len(file) < 300_000


def test_same_design_gives_the_same_bytes(files: dict[str, bytes], real_loop: Any, real_margins: Margins) -> None:
    assert drawn(real_loop, real_margins) == files


def test_margins_and_title_are_said(files: dict[str, bytes], real_margins: Margins) -> None:
    """Expected: those of the leg that has least, which test_margins drives to the edge."""
    bode, margins = files["bode.svg"].decode(), real_margins
    phase, gain = (min(getattr(leg, name) for leg in margins.legs) for name in ("phase", "gain_up"))
    assert f"smallest margins: {math.degrees(phase):.0f}°, × {gain:.3g}" in bode
    assert f"disk margin α = {margins.disk.alpha:.2f}" in bode
    assert all("a $design &amp; more_" in files[name].decode() for name in ("bode.svg", "step.svg"))


def test_loops_without_poles_and_without_margins_are_drawn() -> None:
    """Expected: infinite margins are said, not drawn."""
    assert "all margins infinite" in drawn(control.ss([], [], [], 2 * np.eye(6)))["bode.svg"].decode()


def test_a_mode_of_years_does_not_stretch_the_step() -> None:
    """Expected: 10/(s + 1) closed has settled at 6/11 s, and the picture ends when nothing is to be seen any more."""
    slow = control.sample_system(control.ss(control.tf([1e-4], [1, 1e-9]) + control.tf([10], [1, 1])), 1e-3)
    assert 0.3 < last_time(drawn(diagonal(slow))["step.svg"]) < 3


@pytest.mark.parametrize("sign", [1, -1])
def test_a_step_that_settles_slowly_is_shown_to_its_end_from_above_and_below(sign: int) -> None:
    """Expected: its slow exponential falls below 0.01 after ln(100 |c|)/p, by residues; half as long again is shown."""
    # L = k (s + z)/(s (s + q)), so T = k (s + z)/(s² + (q + k) s + k z): fast at first, then slowly to 1
    k, z, q = 2.0, (0.05 if sign > 0 else 0.4), (0.01 if sign > 0 else 1.0)
    L = control.sample_system(control.ss(control.tf([k, k * z], [1, q, 0])), 1e-2)
    slow, fast = sorted(np.roots([1, q + k, k * z]).real, key=abs)
    residue = k * (slow + z) / (slow * (slow - fast))
    assert np.sign(residue) == sign
    settled = math.log(abs(residue) / 0.01) / -slow
    end = last_time(drawn(diagonal(L))["step.svg"])
    assert 0.8 * 1.5 * settled < end < 1.05 * 1.5 * settled
