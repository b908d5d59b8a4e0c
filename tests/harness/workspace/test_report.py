"""The report of a workspace as plain data: extents, share and nearest limit from the poses themselves."""

import re

import numpy as np
import pytest

from gough_stewart.harness.report.chart import Chart
from gough_stewart.harness.workspace.report import workspace_report
from gough_stewart.model.platform import load_preset
from gough_stewart.model.workspace import Limit, limits_at, sweep


def test_the_verdict_has_extents_share_and_the_limit_that_keeps_off_most() -> None:
    """Expected: by the limits of every pose of the grid, one by one."""
    platform = load_preset("motion_base")
    found = sweep(platform, {"x": (-1.2, 1.4), "roll": (-0.6, 0.6)}, {"z": 2.05}, 13)
    x, roll = np.linspace(-1.2, 1.4, 13), np.linspace(-0.6, 0.6, 13)
    code = np.array([[limits_at(platform, np.array([a, 0, 2.05]), np.array([b, 0, 0])) for b in roll] for a in x])
    free = code == Limit.NONE
    report = workspace_report(found)
    text = report.verdict.text
    ends = [float(n) for n in re.findall(r"-?[\d.]+(?= m\b|°)", text)][:4]
    of_x, of_roll = x[free.any(axis=1)], np.degrees(roll[free.any(axis=0)])
    assert ends == pytest.approx([of_x[0], of_x[-1], of_roll[0], of_roll[-1]], rel=6e-3)
    assert f"{100 * free.mean():.2g} % of the grid" in text
    codes, counts = np.unique(code[~free], return_counts=True)
    most = Limit(codes[counts.argmax()])
    assert text.endswith(f"{100 * counts.max() / code.size:.2g} % of it is out of reach because of {most.text}")
    assert report.number("reachable").value == pytest.approx(free.mean())
    chart = next(part for part in report.parts() if isinstance(part, Chart))
    assert chart.kind == "heat"
    assert np.array_equal(chart.series[0].values.T, code)
    assert chart.map is not None
    assert chart.map.inside is not None
    assert ((chart.map.inside.T > 0) == free).all()
    assert chart.y is not None
    assert (chart.x.name, chart.y.name) == ("x", "roll")


def test_a_grid_out_of_reach_is_bad() -> None:
    found = sweep(load_preset("motion_base"), {"x": (-1.0, 1.0), "y": (-1.0, 1.0)}, {"z": 5.0}, 5)
    report = workspace_report(found)
    assert report.verdict.text.startswith("Reaches none of 25 poses of this grid; ")
    assert report.verdict.status == "bad"
    assert report.notes[0].text.startswith("No pose of this grid can be reached")
