"""Platforms, models and workspaces that show themselves: lines for a terminal, a table for a notebook."""

import inspect
from dataclasses import replace

import numpy as np
from lxml import html
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from gough_stewart import Platform
from tests.support.uneven import UNEVEN


def test_a_platform_is_told_in_exactly_these_lines() -> None:
    """Expected: written by hand from the numbers of the uneven platform; ranges by NumPy from the joints."""
    base, top = UNEVEN.base_points, UNEVEN.platform_points
    R = Rotation.from_euler("xyz", UNEVEN.home_orientation).as_matrix()
    legs = np.linalg.norm(UNEVEN.home_position + top @ R.T - base, axis=1)
    radii = [np.linalg.norm(points - np.mean(points, axis=0), axis=1) for points in (base, top)]
    assert repr(UNEVEN).splitlines() == [
        "Platform uneven",
        "  masses   platform 11.5 kg, legs 6 × (2.3 + 1.2) kg",
        f"  joints   {min(radii[0]):.4g} to {max(radii[0]):.4g} m about the base's middle, {min(radii[1]):.4g} to "
        f"{max(radii[1]):.4g} m about the platform's",
        f"  home     position (0.08, -0.05, 2.9) m, orientation (0.04, -0.07, 0.11) rad, legs {min(legs):.4g} to "
        f"{max(legs):.4g} m",
        "  limits   leg_length_min 2.3 m, leg_length_max 3.9 m, actuator_force_max 640 N, joint_angle_max 0.7 rad",
    ]
    alike = gs.load_preset("liu2000")
    assert "2 m about the base's middle, 1 m about the platform's" in repr(alike)
    assert repr(alike).splitlines()[3].endswith("rad, legs 3.246 m")


def test_a_notebook_shows_each_number_with_unit_and_meaning() -> None:
    """Expected: the numbers by hand, in the rows of their names; texts that are markup stay texts."""
    page = html.fragment_fromstring(replace(UNEVEN, name="<b>", source="a & b")._repr_html_())
    rows = {row[0].text_content(): [cell.text_content() for cell in row[1:]] for row in page.findall(".//tbody/tr")}
    assert [cell.text_content() for cell in page.findall(".//thead/tr/th")] == ["parameter", "value", "unit", "meaning"]
    assert page.findtext("caption") == "Platform <b> – a & b"
    assert rows["platform_inertia"][:2] == ["4.6, 0.35, -0.28; 0.35, 5.7, 0.41; -0.28, 0.41, 8.1", "kg·m²"]
    assert rows["leg_upper_com"] == ["0.58", "m", "upper part's centre of mass, from the platform joint along the leg"]
    assert rows["leg_viscous_friction_factor"][:2] == ["0.7, 1.4, 0.9, 1.6, 0.5, 1.1", "1"]
    assert list(rows) == list(UNEVEN.as_dict())[2:]
    assert html.fragment_fromstring(replace(UNEVEN, source="")._repr_html_()).findtext("caption") == "Platform uneven"


def test_help_lists_the_parameters_of_a_platform() -> None:
    """Expected: every number of a platform with its unit, as the file of a platform has them."""
    text = inspect.getdoc(Platform) or ""
    assert [name for name in UNEVEN.as_dict() if f"\n{name} : " not in text] == ["name", "source"]
    assert "\nplatform_inertia : (3, 3) [kg.m2]\n" in text


def test_a_stepping_model_says_where_it_is() -> None:
    """Expected: home at 0 s; later the state's own numbers."""
    plant = gs.SteppingModel(UNEVEN)
    at_home = "<SteppingModel of uneven at 0 s: position (0.08, -0.05, 2.9) m, orientation (0.04, -0.07, 0.11) rad>"
    assert repr(plant) == at_home
    plant.do_step(0.0, 0.125)
    x = ", ".join(f"{value:.6g}" for value in plant.state[:3])
    assert repr(plant).startswith(f"<SteppingModel of uneven at 0.125 s: position ({x}) m")
