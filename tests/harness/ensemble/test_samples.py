"""Signals of single members that an ensemble keeps: those of the member whose number they have."""

from pathlib import Path

import numpy as np
import polars
import pytest

import gough_stewart as gs


def test_samples_belong_to_their_member_where_others_are_impossible(tmp_path: Path) -> None:
    """Expected: the rows of the member run alone, at the same times; masses below zero are no machines."""
    text = gs.load_experiment("heave_step")
    settings = {
        "loop.duration": 0.1,
        "ensemble": {"members": 12, "seed": 3, "worst": 1, "platform_mass": {"uniform": [-800.0, 1500.0]}},
    }
    found = gs.ensemble(text, settings, workers=1, out=tmp_path)
    impossible = found.members.filter(polars.col("outcome") == "impossible")["member"].to_list()
    ran = [member for member in range(12) if member not in impossible]
    assert impossible
    assert min(impossible) < max(ran)
    assert found.samples is not None
    assert found.samples["member"].unique(maintain_order=True).to_list() == ran
    last = ran[-1]
    alone = gs.run(text, settings, member=last)
    own = found.samples.filter(polars.col("member") == last)
    at = np.searchsorted(alone["time"], own["time"].to_numpy() - 1e-9)
    error = np.linalg.norm(alone["error.position"], axis=1)[at]
    assert own["error.position.norm"].to_numpy() == pytest.approx(error, rel=1e-5, abs=1e-9)
    again = gs.read_ensemble(tmp_path)
    assert again.samples is not None
    assert again.samples.equals(found.samples)
