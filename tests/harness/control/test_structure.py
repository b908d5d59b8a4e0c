"""Structural modes in `margins`. Expected: k (J M⁻¹ Jᵀ + 1/m_a) in closed form, and margins at other bandwidths."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.control import structure as structure_module
from gough_stewart.harness.control.loop_transfer import loop_transfer
from gough_stewart.harness.control.margins import DiskMargin, disk_margin, loop_margins
from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.harness.control.structure import largest_bandwidth, structural_modes
from gough_stewart.harness.errors import UnstableLoopError
from gough_stewart.harness.experiment.margins import LoopMargins
from gough_stewart.harness.report.table import Table
from gough_stewart.model.dynamics import mass_matrix
from gough_stewart.model.kinematics import leg_jacobian
from tests.support.real_platforms import SPRINGS, real_platform
from tests.support.tables_shown import rows_of

POSE = np.array([0.31, -0.22, 3.05]), np.array([-0.10, 0.08, 0.25])
SOFT = {"platform.parameters.leg_stiffness": 2e7, "platform.parameters.leg_damping": 4e4}


def heave_step(bandwidth: float) -> StateSpace:
    """The loop of the shipped experiment on these legs, put together by hand."""
    values = {"leg_stiffness": 2e7, "leg_damping": 4e4}
    platform = gs.load_preset("motion_base").with_parameters(values)
    controller = gs.PD(bandwidth=bandwidth, damping_ratio=0.8, derivative_on="measurement").controller(platform, 1e-3)
    return loop_transfer(platform, controller, 1e-3, delay=1)


@pytest.mark.parametrize(
    ("changes", "bandwidth"),
    [({}, 1.9), ({"platform.parameters.leg_damping": 8e4}, 7.3), ({"sensors.side": "motor"}, 5.3)],
)
def test_what_the_page_says_that_the_allowed_bandwidth_rests_on(changes: dict[str, Any], bandwidth: float) -> None:
    """Expected: the numbers of docs/machine.md; each loop has its disk margin there, and not at 1.1 times as much."""
    settings = {"platform.parameters.leg_stiffness": 2e7} | changes
    structure = gs.margins("heave_step", settings).structure
    assert structure is not None
    assert structure.bandwidth is not None
    assert structure.bandwidth == pytest.approx(bandwidth, abs=0.05)
    at, beyond = (
        gs.margins("heave_step", settings | {"controller.bandwidth": factor * structure.bandwidth}).disk.alpha
        for factor in (1.0, 1.1)
    )
    assert at >= 0.4 > beyond


@pytest.fixture(scope="module")
def found() -> LoopMargins:
    return gs.margins("heave_step", SOFT)


def test_structural_modes_at_a_pose_are_those_of_the_closed_form() -> None:
    """Damping is c/k of the stiffness, ζ = c ω/(2k), but for friction at the motors and gravity."""
    soft = real_platform("elasto_plastic", True)
    free, held = structural_modes(soft, *POSE)
    J = leg_jacobian(soft, *POSE)
    # the platform's side has no armature
    M = mass_matrix(replace(soft, leg_stiffness=0.0, leg_damping=0.0, leg_armature=0.0), *POSE)
    k, c, m = SPRINGS["leg_stiffness"], SPRINGS["leg_damping"], SPRINGS["leg_armature"]
    relative = J @ np.linalg.solve(M, J.T)
    omega = np.sqrt(k * np.linalg.eigvalsh(relative + np.eye(6) / m))
    assert [mode.frequency for mode in free] == pytest.approx(omega / (2 * np.pi), rel=1e-4)
    assert [mode.damping_ratio for mode in free] == pytest.approx(c * omega / (2 * k), rel=0.1)
    assert held == pytest.approx(np.sqrt(k * np.linalg.eigvalsh(relative)) / (2 * np.pi), rel=1e-4)


def test_margins_have_the_modes_of_the_pose_in_which_the_reference_begins(found: LoopMargins) -> None:
    at = {"type": "hold", "position": [0.25, -0.2, 2.1], "orientation": [0.05, 0.1, 0.2]}
    there = gs.margins("heave_step", SOFT | {"reference": at, "loop.duration": 0.1}).structure
    assert there is not None
    assert found.structure is not None
    soft = gs.load_preset("motion_base").with_parameters({"leg_stiffness": 2e7, "leg_damping": 4e4})
    free, _ = structural_modes(soft, np.array(at["position"]), np.array(at["orientation"]))
    assert [mode.frequency for mode in there.modes] == pytest.approx([mode.frequency for mode in free])
    assert there.modes[0].frequency < 0.98 * found.structure.modes[0].frequency


def test_margins_tell_the_modes_and_the_gain_of_the_loop_there(found: LoopMargins) -> None:
    """Expected: σ_max of C (z − A)⁻¹ B + D at the mode; in the report and the file the same numbers."""
    structure = found.structure
    assert structure is not None
    assert len(structure.modes) == 6
    L = found.transfer
    for mode in structure.modes:
        z = np.exp(2j * np.pi * mode.frequency * 1e-3)
        answer = L.C @ np.linalg.solve(z * np.eye(len(L.A)) - L.A, L.B) + L.D
        assert mode.gain == pytest.approx(np.linalg.svd(answer, compute_uv=False)[0], rel=1e-9)
    report = found.report(charts=False)
    first, largest = structure.modes[0], max(mode.gain for mode in structure.modes)
    assert report.number("structure.first_mode").value == first.frequency == pytest.approx(37.95, abs=0.01)
    assert report.number("structure.damping_ratio").value == first.damping_ratio
    assert report.number("structure.gain").value == pytest.approx(20 * math.log10(largest))
    table = next(part for part in report.parts() if isinstance(part, Table) and part.title == "Structural modes")
    decibels = 20 * math.log10(first.gain)
    row = (f"{first.frequency:.4g}", f"{first.damping_ratio:.3g}", f"{first.held_frequency:.4g}", f"{decibels:.4g}")
    assert rows_of(table)[0] == ("1", *row)
    told = found.as_dict()["structure"]
    assert told["modes"][0] == first._asdict()
    assert told["bandwidth"] == report.number("structure.bandwidth").value == structure.bandwidth


def test_the_bandwidth_that_legs_allow_keeps_the_disk_margin_and_no_more(found: LoopMargins) -> None:
    """Expected: margins of the loop put together by hand just below and above; the text has the number."""
    assert found.structure is not None
    bandwidth = found.structure.bandwidth
    assert bandwidth is not None
    assert (
        loop_margins(heave_step(bandwidth)).disk.alpha >= 0.4 > loop_margins(heave_step(1.011 * bandwidth)).disk.alpha
    )
    told = f"keeps a disk margin of 0.4 up to a bandwidth of {bandwidth:.3g} Hz"
    assert any(told in part.text for part in found.report(charts=False).parts() if hasattr(part, "text"))


@pytest.mark.parametrize("own", [0.7, 1.9, 3.1, 50.0])
def test_it_is_found_from_any_bandwidth_of_the_design(own: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Closed form: L = g/z has max |(1 − L)/(1 + L)| = (1 + g)/(1 − g), so that α = 2 (1 − g)/(1 + g); g = b/4."""

    def made(bandwidth: float) -> StateSpace:
        one = np.eye(6)
        return StateSpace(0 * one, one, bandwidth / 4 * one, 0 * one, 1e-3)

    def closed_form(loop: StateSpace) -> DiskMargin:
        g = float(loop.C[0, 0])
        return DiskMargin(2 * (1 - g) / (1 + g), (0.0, math.inf), 0.0, 0.0)

    assert disk_margin(made(2.0)).alpha == pytest.approx(closed_form(made(2.0)).alpha, rel=1e-6)
    monkeypatch.setattr(structure_module, "disk_margin", closed_form)
    # α = 2/3 at 2 Hz; kept up to the first mode; never
    assert largest_bandwidth(made, 2 / 3, 10.0, own) == pytest.approx(2.0, rel=0.0101)
    assert largest_bandwidth(made, 1e-3, 1.5, own) == pytest.approx(1.5, rel=0.0101)
    assert math.isnan(largest_bandwidth(made, 3.0, 10.0, own))


def test_rigid_legs_and_explicit_gains() -> None:
    rigid = gs.margins("heave_step")
    assert rigid.structure is None
    assert "structure" not in rigid.as_dict()
    assert not any(number.path.startswith("structure") for number in rigid.report(charts=False).numbers)
    gains = {"controller": gs.PD(proportional_gain=2e5, derivative_gain=2e4), **SOFT}
    found = gs.margins("heave_step", gains)
    assert found.structure is not None
    assert found.structure.bandwidth is None
    assert found.report(charts=False).number("structure.bandwidth").value is None


def test_a_loop_that_legs_make_unstable_names_their_first_mode() -> None:
    """Closed form: a quarter of 2e7 N/m, with a mode at 37.95 Hz, has it at half of that."""
    text = r"stable on rigid legs: those of 5e\+06 N/m, whose first structural mode is at 19 Hz, limit the bandwidth"
    with pytest.raises(UnstableLoopError, match=text):
        gs.margins("heave_step", {"platform.parameters.leg_stiffness": 5e6})


def test_the_first_mode_is_marked_in_the_bode_plot(found: LoopMargins) -> None:
    """Expected: at the lowest √(k (J M⁻¹ Jᵀ + 1/m_a)) of the platform at home; none of rigid legs."""
    base = gs.load_preset("motion_base")
    home = base.home_position, base.home_orientation
    J, M = leg_jacobian(base, *home), mass_matrix(replace(base, leg_armature=0.0), *home)
    squares = 2e7 * np.linalg.eigvalsh(J @ np.linalg.solve(M, J.T) + np.eye(6) / base.leg_armature)
    gain = next(chart for chart in found.report().charts if chart.title.startswith("gain of L"))
    (mark,) = [each for each in gain.marks if each.direction == "vertical"]
    assert mark.text == "first structural mode"
    assert mark.value == pytest.approx(np.sqrt(squares[0]) / (2 * np.pi), rel=1e-3)
    rigid = next(chart for chart in gs.margins("heave_step").report().charts if chart.title.startswith("gain of L"))
    assert not [each for each in rigid.marks if each.direction == "vertical"]
