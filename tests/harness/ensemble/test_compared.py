"""Two controllers over the same machines, run and compared."""

from pathlib import Path

import numpy as np
import pytest

from gough_stewart.harness.ensemble.compare import names_of, run_compared
from gough_stewart.harness.ensemble.ensemble_report import read_ensemble
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.file import load_experiment

PEAK = "tracking.position.norm_rms"
SHORT = {"loop.duration": 0.3, "loop.sample_time": "2 ms"}
VARIES = {
    **SHORT,
    "sensors.seed": 11,
    "ensemble": {"members": 9, "worst": 1, "platform_mass": {"uniform": [1000, 3000]}},
}


def test_both_have_the_same_machines_and_the_difference_is_member_by_member(tmp_path: Path) -> None:
    """Expected: the mean of the differences of the two tables read back; the first one's machines, by its seed."""
    slow, fast = (
        load_experiment("heave_step", {**each, "controller.bandwidth": f})
        for each, f in ((VARIES, 1), ({**SHORT, "sensors.seed": 12}, 4))
    )
    found = run_compared((slow, fast), ("slow", "fast"), tmp_path, lambda _: None, workers=1)
    a, b = (read_ensemble(tmp_path / name) for name in ("slow", "fast"))
    assert a.values("platform_mass").tolist() == b.values("platform_mass").tolist()
    assert (a.metadata["seed"], b.metadata["seed"]) == (11, 11)
    gaps = b.values(PEAK) - a.values(PEAK)
    assert (gaps < 0).all()
    row = found.differences.filter(found.differences["metric"] == PEAK).row(0, named=True)
    assert row["mean"] == pytest.approx(np.mean(gaps))
    assert row["mean_low"] < row["mean"] < row["mean_high"] < 0
    assert (tmp_path / "differences.parquet").is_file()


def test_an_experiment_without_an_ensemble_cannot_be_compared(tmp_path: Path) -> None:
    """Expected: the message names what is missing; names of the same file in two folders are A and B."""
    one = load_experiment("heave_step", SHORT)
    with pytest.raises(ExperimentError, match="ensemble: is missing"):
        run_compared((one, one), ("A", "B"), tmp_path, lambda _: None)
    assert names_of("x/a.toml", "y/a.toml") == ("A", "B")
    assert names_of("x/slow.toml", "fast") == ("slow", "fast")
