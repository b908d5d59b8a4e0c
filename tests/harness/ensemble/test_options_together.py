"""Every pair of options of `[ensemble]` and of `gs.ensemble`: expectations from members run alone."""

from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from allpairspy import AllPairs

import gough_stewart as gs
from gough_stewart import Experiment, Sample
from tests.support.arrays import FloatArray
from tests.support.covering import covering
from tests.support.experiments import experiment_from
from tests.support.metric_definitions import as_one_number, defined_metrics
from tests.support.uneven import GAINS, UNEVEN

# Each in all its forms; that draws are those of the distribution is shown where draws are.
MASS: dict[str, Any] = {
    "normal": {"normal": [13.0, 0.8]},
    "half": {"uniform": 1.5},
    "factor": {"factor": {"lognormal": 0.1}},
    "offset": {"offset": {"normal": [0.4, 0.3]}},
}
VISCOUS: dict[str, Any] = {
    "about": {"normal": 0.7},
    "bounds": {"uniform": [6.0, 14.0]},
    "median": {"lognormal": [8.0, 0.2]},
    "truncated": {"truncated_normal": [8.0, 2.0, 7.0, 12.0]},
}
COULOMB: dict[str, Any] = {
    "truncated about": {"truncated_normal": [0.4, 0.5]},
    "choice": {"choice": [1.0, 1.7, 2.9]},
    "normal": {"normal": [2.0, 0.2]},
    "grid": {"grid": [1.0, 1.7, 2.9]},
}
OPTIONS: dict[str, list[Any]] = {
    "mass": list(MASS),
    "viscous": list(VISCOUS),
    "coulomb": list(COULOMB),
    "sampling": ["random", "sobol", "latin_hypercube", "saltelli"],
    "joint": [None, "correlation"],
    "seed": [None, 41],
    "worst_by": [None, "stroke.margin", "force.rms"],
    "signals": [None, ["leg_velocity", "error.orientation.norm"]],
    "margins": [False, True],
    "change": [False, True],
    "belief": [False, True],
    "controller": ["pd", "class"],
}
ROWS = [dict(zip(OPTIONS, row, strict=True)) for row in AllPairs(list(OPTIONS.values()))]
# Each takes a second: those that hold every value always run, all of them with the evidence.
_ALWAYS = covering(ROWS)
_CHANGED = {"platform_mass": 15.2, "platform_com": [-0.03, -0.02, 0.21]}
_BANDS = ("position", "orientation", "error.position.norm", "error.orientation.norm", "actuator_force")


class Law:
    """A PD of the legs with gains of its own and memory: its force goes a part of the way to the new one."""

    def __init__(self, platform: gs.Platform, sample_time: float, share: float = 0.6) -> None:
        self.share, self.force = min(share, 200 * sample_time), 4.0 * platform.platform_mass * np.ones(6)

    def __call__(self, sample: Sample) -> FloatArray:
        """Forces [N]."""
        error = sample.reference["leg_length"] - sample.measured["leg_length"]
        self.force = self.force + self.share * (50.0 + GAINS * error - self.force)
        return self.force


def experiment_of(row: dict[str, Any], folder: Path) -> Experiment:
    """An uneven machine that is not the nominal one, and differs among members in three parameters or more."""
    gs.save_platform(UNEVEN, folder / "uneven.toml")
    varied: dict[str, Any] = {
        "platform_mass": MASS[row["mass"]],
        "leg_viscous_friction": VISCOUS[row["viscous"]],
        "leg_coulomb_friction": COULOMB[row["coulomb"]],
    }
    if row["belief"]:
        varied["platform.platform_mass"] = {"uniform": [10.0, 12.0]}
    groups = len(varied) - (1 if row["joint"] else 0)
    chosen: dict[str, Any] = {
        "members": 2 * (groups + 2) if row["sampling"] == "saltelli" else 8,
        "sampling": row["sampling"],
        "margins": row["margins"],
        "worst": 3,
    }
    chosen |= {name: row[name] for name in ("seed", "worst_by", "signals") if row[name] is not None}
    if row["joint"]:
        chosen["correlation"] = [{"of": ["platform_mass", "leg_viscous_friction"], "matrix": [[1.0, 0.8], [0.8, 1.0]]}]
    values: dict[str, Any] = {
        "title": "options together",
        "platform": {"file": folder / "uneven.toml"},
        "plant": {"parameters": {"platform_mass": 13.9, "leg_viscous_friction": 9.0, "leg_coulomb_friction": 2.0}},
        "reference": {"type": "sine", "position_amplitude": [0.01, -0.02, 0.03], "frequency": 3.0, "phase": 0.7},
        "controller": {
            "type": "pd",
            "proportional_gain": GAINS.tolist(),
            "derivative_gain": (0.1 * GAINS).tolist(),
            "feedforward": "gravity",
        },
        "loop": {"duration": 0.06, "sample_time": 0.004, "plant_step": 0.002, "delay": 1},
        "sensors": {"noise": {"leg_length": 1e-5}, "seed": 5},
        "limits": {"reference": "warn", "position_error": 10.0},
        "ensemble": {**chosen, **varied},
    }
    if row["change"]:
        values["change"] = [{"at": 0.02, "parameters": _CHANGED}]
    return experiment_from(values)


def _name(row: dict[str, Any]) -> str:
    return "-".join(str(value) for value in row.values())


@pytest.mark.parametrize(
    "row",
    [pytest.param(row, marks=() if k in _ALWAYS else pytest.mark.evidence) for k, row in enumerate(ROWS)],
    ids=_name,
)
def test_every_pair_of_options_does_what_the_documentation_says(row: dict[str, Any], tmp_path: Path) -> None:
    """Expected: metrics by definition of members that run alone, whose machines are those of the table."""
    controller = Law if row["controller"] == "class" else None
    found = gs.ensemble(experiment_of(row, tmp_path), controller=controller, workers=1, out=tmp_path / "out")
    members = found.members
    check_draws(row, members)
    assert found.metadata["seed"] == (5 if row["seed"] is None else row["seed"])
    assert found.metadata["sampling"] == row["sampling"]
    k = members.height - 1
    record = gs.run(experiment_of(row, tmp_path), member=k, controller=controller)
    check_member(row, members.row(k, named=True), record)
    completed = members.filter(polars.col("outcome") == "completed")
    assert completed.height == members.height
    columns = [name for name in SIGNAL_COLUMNS if name.partition("[")[0] in (row["signals"] or _BANDS)]
    bands = found.bands
    assert bands["signal"].unique(maintain_order=True).to_list() == columns
    assert set(bands["running"].to_list()) == {members.height}
    at_end = bands.filter(polars.col("time") == bands["time"].max())
    for name, low, high in at_end.select("signal", "lowest", "highest").iter_rows():
        value = np.linalg.norm(record[name.removesuffix(".norm")][-1]) if ".norm" in name else record[name][-1]
        assert low - 1e-9 <= value <= high + 1e-9
    assert ("margins.disk" in members.columns) == row["margins"]
    if row["margins"]:
        assert members["margins.stable"].is_in([0.0, 1.0]).all()
        assert (members["margins.disk"].is_not_null() == (members["margins.stable"] == 1.0)).all()
    again = gs.read_ensemble(tmp_path / "out")
    assert again.members.equals(members)
    tables = {"members.parquet", "bands.parquet", "samples.parquet", "ensemble.json"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == tables


SIGNAL_COLUMNS = [
    *(f"position[{k}]" for k in (1, 2, 3)),
    *(f"orientation[{k}]" for k in (1, 2, 3)),
    "error.position.norm",
    *(f"leg_velocity[{k}]" for k in range(1, 7)),
    "error.orientation.norm",
    *(f"actuator_force[{k}]" for k in range(1, 7)),
]


def check_draws(row: dict[str, Any], members: polars.DataFrame) -> None:
    """A column for each that varies; of Saltelli's design A, then A with a group of B each, then B."""
    names = ["platform_mass", "leg_viscous_friction", "leg_coulomb_friction"]
    names += ["platform.platform_mass"] if row["belief"] else []
    assert {name for name in members.columns if name.startswith("varied.")} == {f"varied.{name}" for name in names}
    for name in names:
        drawn = members[f"varied.{name}"].to_numpy()
        is_listed = name == "leg_coulomb_friction" and row["coulomb"] in ("choice", "grid")
        if is_listed:
            assert set(drawn.tolist()) <= {1.0, 1.7, 2.9}
        elif row["sampling"] == "saltelli":
            # a column has B's value in its own group's member and in the last
            values = drawn.reshape(-1, len(names) - (1 if row["joint"] else 0) + 2)
            assert (np.abs(values - values[:, :1]) > 0).sum(axis=1).tolist() == [2, 2]
            assert (values[:, -1] != values[:, 0]).all()


def check_member(row: dict[str, Any], values: dict[str, Any], record: gs.Record) -> None:
    """A member's row has the metrics of its record, whose machine is the drawn one."""
    machine, platform = record.metadata["machine"], record.metadata["platform"]
    for name in ("platform_mass", "leg_viscous_friction", "leg_coulomb_friction"):
        assert machine[name] == values[f"varied.{name}"]
    believed = values["varied.platform.platform_mass"] if row["belief"] else UNEVEN.platform_mass
    assert platform["platform_mass"] == believed
    assert platform["leg_viscous_friction"] == UNEVEN.leg_viscous_friction
    assert ("platform_mass" in record) == row["change"]
    if row["change"]:
        expected = np.where(record["time"] < 0.02 - 1e-9, machine["platform_mass"], 15.2)
        np.testing.assert_allclose(record["platform_mass"], expected, rtol=1e-14)
    assert values["outcome"] == record.metadata["outcome"]["status"] == "completed"
    for name, value in as_one_number(defined_metrics(record.table, platform)).items():
        assert values[name] == (None if value is None else pytest.approx(value, rel=1e-11, abs=1e-13)), name
