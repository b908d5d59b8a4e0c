"""Members of ensembles against single runs of experiments in which their drawn values are written out."""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.uneven import UNEVEN
from tests.support.uneven_loops import experiment_of

VARIED: dict[str, Any] = {
    # of the machine: bare, with its table, whole vectors, one factor for all elements, six values
    "platform_mass": {"uniform": [9, 14]},
    "plant": {"leg_viscous_friction": {"lognormal": 0.3}},
    "base_points": {"normal": "2 mm"},
    "platform_inertia": {"factor": {"uniform": [0.7, 1.4]}},
    "gravity": {"offset": {"uniform": [-0.3, 0.3]}},
    # of the belief
    "platform": {"platform_com": {"normal": "20 mm"}},
    # of other tables
    "loop": {"delay": {"choice": [0, 1, 3]}},
    "controller": {
        "bandwidth": {"uniform": ["1.5 Hz", "2.5 Hz"]},
        "damping_ratio": {"uniform": [0.6, 1.1]},
        "feedforward": {"choice": ["none", "gravity"]},
    },
    "actuators": {
        "force_limit": {"choice": ["66 N", "150 N"]},
        "lag": {"uniform": ["2 ms", "9 ms"]},
        "rate_limit": {"uniform": ["0.4 kN/s", "0.9 kN/s"]},
    },
    "reference": {
        "frequency": {"uniform": [2, 3]},
        "position_amplitude": {"offset": {"normal": [0, ["10 mm", "20 mm", "30 mm"]]}},
        "amplitude_scale": {"choice": [0.5, 0.7, 1.0]},
    },
    "start": {"position": {"normal": "3 mm"}, "orientation": {"normal": "0.1 deg"}},
    "sensors": {"quantisation": {"leg_length": {"choice": ["0.1 mm", "0.2 mm", "0.3 mm"]}}},
    "disturbance": {"2": {"force": {"normal": "5 N"}, "at": {"choice": [0.02, 0.03]}}},
    "change": {"1": {"at": {"choice": [0.03, 0.04]}, "factors": {"platform_mass": {"uniform": [1.1, 1.3]}}}},
    "limits": {"position_error": {"uniform": ["1 m", "2 m"]}},
    "injection": {"amplitude": {"uniform": ["1 N", "6 N"]}},
}
PLANT = {"platform_mass": 12.5, "leg_viscous_friction": 9.0, "base_points": (UNEVEN.base_points + 0.003).tolist()}
START = UNEVEN.home_position + np.array([0.004, -0.006, 0.005])
MEMBERS = 11


def experiment(**ensemble: Any) -> gs.Experiment:
    return experiment_of(
        "pd",
        plant={"parameters": PLANT, "tolerance": 1e-10},
        start={"position": START.tolist(), "orientation": UNEVEN.home_orientation.tolist()},
        reference={"type": "sine", "position_amplitude": [0.03, -0.02, 0.025], "frequency": 2.4, "phase": 0.4},
        controller={"type": "pd", "bandwidth": 2, "damping_ratio": 0.8, "feedforward": "gravity"},
        loop={"duration": 0.06, "sample_time": 0.005, "plant_step": 0.0025, "delay": 2},
        sensors={"quantisation": {"leg_length": 1e-4}},
        actuators={"force_limit": "150 N", "rate_limit": 700, "lag": 0.004},
        disturbance=[
            {"at": 0.01, "duration": 0.02, "torque": [4, -6, 5]},
            {"at": 0.02, "duration": 0.03, "force": [20, -30, 40]},
        ],
        change=[{"at": 0.04, "factors": {"platform_mass": 1.2}}],
        limits={"reference": "warn", "position_error": 1.5},
        injection={"type": "chirp", "leg": 3, "amplitude": "5 N", "band": ["40 Hz", "90 Hz"], "period": "20 ms"},
        **({"ensemble": {"members": MEMBERS, "seed": 9, "tolerance": 1e-10, **ensemble}} if ensemble else {}),
    )


@pytest.fixture(scope="module")
def many() -> gs.Ensemble:
    return gs.ensemble(experiment(**VARIED, worst=0), workers=1)


def drawn(many: gs.Ensemble, member: int) -> dict[str, Any]:
    """The settings of a member, from the columns of the table: numbers, or elements in order."""
    columns: dict[str, list[Any]] = {}
    for name, value in many.members.row(member, named=True).items():
        if name.startswith("varied."):
            columns.setdefault(name.removeprefix("varied.").partition("[")[0], []).append(value)
    inertia = columns.pop("platform_inertia.factor")[0] * UNEVEN.platform_inertia
    settings: dict[str, Any] = {"plant.parameters.platform_inertia": inertia}
    for name, values in columns.items():
        key = name.replace("platform.", "platform.parameters.") if "." in name else f"plant.parameters.{name}"
        elements = np.reshape(values, (6, 3)) if len(values) == 18 else np.array(values)
        settings[key] = values[0] if len(values) == 1 else elements
    return settings


@pytest.mark.parametrize("member", [0, 4, 10])
def test_a_member_is_the_run_of_an_experiment_with_its_values(many: gs.Ensemble, member: int) -> None:
    """Expected: every column of the single run, on the model with its own integrator."""
    alone = gs.run(experiment(), drawn(many, member))
    own, other = (gs.run(experiment(**VARIED), member=member, plant=plant) for plant in (None, "model"))
    np.testing.assert_allclose(other["actuator_force"], alone["actuator_force"], rtol=1e-9)
    assert own.table.columns == alone.table.columns
    for name in alone.table.columns:
        a, b = own.table[name].to_numpy().astype(float), alone.table[name].to_numpy().astype(float)
        scale = max(1.0, float(np.abs(b).max()))
        if name.startswith(("measured", "controller.force", "controller.state", "flag")):
            assert (np.abs(a - b) > 1e-5 * scale).mean() < 0.03, name  # a rounding to the next step
        else:
            assert np.abs(a - b).max() < 2e-5 * scale, name
    assert own.metadata["title"] == f"{alone.metadata['title']}, member {member}"
    assert own.metadata["plant"] == "lanes"
    assert own.metadata["member"] == member
    for name in ("platform", "machine"):
        for key, value in alone.metadata[name].items():
            if value is None or isinstance(value, str):
                assert own.metadata[name][key] == value
            else:
                np.testing.assert_allclose(own.metadata[name][key], value, rtol=1e-12, err_msg=key)
    for key in ("rows", "duration", "sample_time", "plant_step", "force_limit", "versions"):
        assert own.metadata[key] == alone.metadata[key]
    # and its metrics are in the table of the ensemble
    found = gs.metrics(own)
    row = many.members.row(member, named=True)
    assert row["tracking.position.norm_rms"] == pytest.approx(found["tracking"]["position"]["norm_rms"], rel=1e-9)
    assert row["force.peak"] == pytest.approx(np.abs(own["actuator_force"]).max(), rel=1e-9)
    assert row["rows"] == len(own["time"])


def test_a_member_that_is_not_there_impossible_or_injected_into_is_named() -> None:
    few: dict[str, Any] = {"members": 9, "seed": 2, "worst": 0, "platform_mass": {"grid": [-1.0, 11.0, 12.0]}}
    for member, says in ((3, "3: is impossible: plant: platform_mass: is -1"), (9, ": is 9; expected 0 to 8")):
        with pytest.raises(gs.GoughStewartError, match=f"member.?{says}"):
            gs.run(experiment(**few), member=member)
    with pytest.raises(gs.GoughStewartError, match=r"member: has the experiment's injection; remove injection"):
        gs.run(experiment(**VARIED), member=3, injection=lambda _time: np.zeros(6))
