"""Signals of many runs over time, against the members' own records."""

from typing import Any

import numpy as np
import polars
import pytest

import gough_stewart as gs


def test_samples_are_those_of_the_first_members_at_every_other_time() -> None:
    """Expected: the records' own numbers with seven digits, none after a member has ended; some are lost."""
    settings: dict[str, Any] = {
        "loop.duration": 0.6, "loop.delay": 20, "loop.plant_step": "1 ms", "limits.position_error": "55 mm",
        "ensemble": {"members": 9, "signals": ["leg_length"], "controller.bandwidth": {"uniform": [0.1, 20]}},
    }  # fmt: skip
    ensemble = gs.ensemble("heave_step", settings, workers=1)
    records = [gs.run("heave_step", settings, member=k) for k in range(9)]
    times = ensemble.bands["time"].unique(maintain_order=True).to_numpy()
    assert len(times) == 200
    assert len({record.table.height for record in records}) > 1
    kept = times[np.unique(np.linspace(0, len(times) - 1, 101).round().astype(int))]
    assert ensemble.samples is not None
    for k, record in enumerate(records):
        samples = ensemble.samples.filter(polars.col("member") == k)
        assert samples["time"].to_numpy() == pytest.approx(kept)
        values = np.append(record["leg_length[5]"], np.full(601 - record.table.height, np.nan))
        found = samples["leg_length[5]"].fill_null(np.nan).to_numpy()
        assert found == pytest.approx(values[np.rint(kept / 1e-3).astype(int)], rel=1e-6, nan_ok=True)


def test_chunks_of_members_make_the_same_bands_as_their_records() -> None:
    """Expected: of 600 members in two chunks, the extremes over all of them, and the number of those that run."""
    settings = {
        "loop.duration": 0.02,
        "ensemble": {"members": 600, "signals": ["position"], "platform_mass": {"factor": {"uniform": [0.9, 1.1]}}},
    }
    whole = gs.ensemble("heave_step", settings, workers=1)
    few = [gs.run("heave_step", settings, member=k)["position[3]"][-1] for k in (0, 511, 512, 599)]
    last = whole.bands.filter(polars.col("signal") == "position[3]").row(-1, named=True)
    assert last["running"] == 600
    assert last["lowest"] <= min(few) <= max(few) <= last["highest"]
    assert whole.samples is not None
    samples = whole.samples.filter(polars.col("time") == whole.samples["time"].max())
    assert samples["position[3]"].to_numpy()[[0, 511, 512, 599]] == pytest.approx(few, rel=1e-6)
    values = samples["position[3]"].to_numpy()
    expected = (values.min(), np.median(values), values.max())
    assert (last["lowest"], last["q50"], last["highest"]) == pytest.approx(expected, rel=1e-6)
