"""Names and units of metrics in the printed table of an ensemble."""

import re

import numpy as np
import polars
import pytest

from tests.support.ensembles import ensemble_of

# As the table names them, with unit and the number that stands for 0.0123 in SI units.
SHOWN = {
    "tracking.position.norm_rms": ("position error, RMS mm", 12.3),
    "tracking.position.norm_peak": ("position error, peak mm", 12.3),
    "tracking.orientation.norm_rms": ("orientation error, RMS deg", 0.0123 * 180 / np.pi),
    "tracking.orientation.norm_peak": ("orientation error, peak deg", 0.0123 * 180 / np.pi),
    "tracking.leg_length.peak": ("leg error, peak mm", 12.3),
    **{
        f"step_response.{axis}.{name}": (f"{axis}: {words}", 0.0123)
        for axis in ("x", "y", "z", "roll", "pitch", "yaw")
        for name, words in (
            ("overshoot_percent", "overshoot %"),
            ("rise_time", "rise time s"),
            ("settling_time", "settling time s"),
        )
    },
    "force.peak": ("peak force N", 0.0123),
    "power.peak": ("peak power W", 0.0123),
    "energy.absolute_total": ("work, absolute J", 0.0123),
    "stroke.margin": ("stroke margin mm", 12.3),
    "saturation.force_limited.any": ("force limited %", 1.23),
    "saturation.rate_limited.any": ("rate limited %", 1.23),
    "stroke.exceeded.any": ("beyond stroke %", 1.23),
    "margins.stable": ("stable", 0.0123),
    "margins.disk": ("disk margin", 0.0123),
}


def test_a_table_names_metrics_with_their_units() -> None:
    """Expected: words and units of docs/ensembles.md, and numbers in them: of each metric another multiple of 0.0123.

    Metrics that are not for the terminal are left out: the mean power, the time of a step, the use of a limit.
    """
    made = ensemble_of(np.zeros((4, 4)))
    kept = made.members.select("member", "outcome", "ended", "cause")
    columns = [polars.lit(0.0123 * (k + 1)).alias(name) for k, name in enumerate(SHOWN)]
    others = ("power.mean", "step_response.z.at", "limits.leg_velocity_max.used", "force.rms", "energy.net_total")
    table = kept.with_columns(*columns, *(polars.lit(5.0).alias(name) for name in others))
    text = str(type(made)(table, made.bands, made.metadata))
    rows = {cells[1].strip(): cells[2:8] for line in text.splitlines() if len(cells := re.split("[│┃]", line)) == 9}
    assert set(rows) - {""} == {name for name, _ in SHOWN.values()}
    assert [cell.strip() for cell in rows[""]] == ["5 %", "25 %", "50 %", "75 %", "95 %", "members"]
    for k, (name, value) in enumerate(SHOWN.values()):
        *quantiles, defined = (cell.strip() for cell in rows[name])
        assert [float(cell) for cell in quantiles] == [pytest.approx(value * (k + 1), rel=6e-3)] * 5, name
        assert defined == "4"
