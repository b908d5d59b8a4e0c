"""What varies in an ensemble: places, units, messages for what is not there."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

import gough_stewart as gs
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.preparation import prepare
from tests.support.small_ensemble import SMALL, small

NORMAL = {"normal": [1, 1]}
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "unknown parameter": (
        {"platform_mas": {"normal": [1, 1]}},
        "ensemble.platform_mas: no such parameter; did you mean 'platform_mass'?",
    ),
    "unknown key": (
        {"controller": {"bandwith": {"normal": [1, 1]}}},
        "controller.bandwith: no such key of [controller]; did you mean",
    ),
    "unknown section": ({"sensor": {"noise": {"uniform": [1, 2]}}}, "no such parameter; did you mean 'sensors'?"),
    "unknown signal": (
        {"sensors": {"noise": {"leg_lenth": {"uniform": [0, 1]}}}},
        "no signal 'leg_lenth'; did you mean",
    ),
    "no spread": (
        {"platform_mass": {"normal": ["120 kg", "0 kg"]}},
        "platform_mass: is ['120 kg', '0 kg'], without a spread",
    ),
    "wrong unit": ({"controller": {"bandwidth": {"uniform": ["2 m", "3 Hz"]}}}, "found the unit 'm'"),
    "empty grid": ({"platform_mass": {"grid": []}}, "platform_mass: grid has no values"),
    "a clock": ({"loop": {"sample_time": {"uniform": [1e-3, 2e-3]}}}, "loop.sample_time: is common to all members"),
    "a whole number": (
        {"loop": {"delay": {"uniform": [0, 2]}}},
        "loop.delay: uniform applies to numbers only; expected choice or grid",
    ),
    "twice": ({"plant": {"platform_mass": {"uniform": [1, 2]}}}, "varies twice"),
    "no disturbance": ({"disturbance": {"3": {"force": {"normal": "2 N"}}}}, "expected disturbance.1 to disturbance.1"),
    **{
        f"disturbance {'.'.join(inner)}": (
            {"disturbance": {inner[0]: dict.fromkeys(inner[1:], NORMAL) or NORMAL}},
            f"ensemble.disturbance.{'.'.join(inner)}: expected disturbance.1 to disturbance.1 and a key of it",
        )
        for inner in (["0", "force"], ["2", "force"], ["x", "force"], ["1"])
    },
    "no list": ({"change": {"1": {"factors": {"platform_mass": NORMAL}}}}, "platform_mass: no [[change]]"),
    "no table": ({"injection": {"amplitude": NORMAL}}, "amplitude: the experiment has no [injection]"),
    "a key of a number": ({"loop": {"delay": {"x": {"choice": [1, 2]}}}}, "delay.x: loop.delay is not a table"),
    "a key of a parameter": ({"plant": {"platform_com": {"x": NORMAL}}}, "platform_com.x: no such parameter; expected"),
    "unknown parameter of the machine": (
        {"plant": {"parameters": {"platform_mss": NORMAL}}},
        "plant.parameters.platform_mss: no such parameter; did you mean 'platform_mass'?",
    ),
    "unknown parameter of the belief": ({"platform": {"parameters": {"x": NORMAL}}}, "parameters.x: no such parameter"),
    "a key of a signal": ({"sensors": {"noise": {"leg_length": {"x": NORMAL}}}}, "x: expected one name after noise"),
    "no signal": ({"sensors": {"noise": NORMAL}}, "sensors.noise: expected one name after noise"),
    "a whole table": ({"sensors": NORMAL}, "ensemble.sensors: is common to all members"),
    "itself": ({"ensemble": {"members": NORMAL}}, "ensemble.members: is common to all members"),
    "another number of elements": ({"platform_com": {"normal": [[1, 2], [1]]}}, "is [1, 2]; expected 3 elements"),
    "a word": ({"controller": {"feedforward": {"uniform": [1, 2]}}}, "feedforward: uniform applies to numbers only"),
    "a factor of a word": (
        {"actuators": {"force_limit": {"factor": NORMAL}}},
        "force_limit: has no value to vary about",
    ),
    "nothing there": (
        {
            "plant": {
                "leg_length_max": {"factor": {"uniform": [1, 2]}},
            },
            "actuators": {"rate_limit": {"normal": 3}},
        },
        "actuators.rate_limit: has no value to vary about",
    ),
    "not correlated with what varies": (
        {"correlation": [{"of": ["platform_mass", "gravity"], "matrix": [[1, 0], [0, 1]]}]},
        "gravity: is correlated but does not vary",
    ),
    "too few rows": (
        {"correlation": [{"of": ["platform_mass", "base_points"], "matrix": [[1, 0], [0, 1]]}]},
        "have 19 elements; their matrix has 2 rows",
    ),
    "no correlation": (
        {"correlation": [{"of": ["platform_mass", "leg_viscous_friction"], "matrix": [[2, 0], [0, 1]]}]},
        "with 1 on the diagonal",
    ),
    "two matrices": (
        {
            "correlation": [
                {"of": ["platform_mass", "leg_viscous_friction"], "matrix": [[1, 0.5], [0.5, 1]]},
                {"of": ["leg_viscous_friction", "platform_mass"], "matrix": [[1, 0.1], [0.1, 1]]},
            ]
        },
        "is in two matrices",
    ),
    "both": ({"covariance": [{"of": ["platform_mass"], "matrix": [[2]]}]}, "has a distribution and a covariance"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_cannot_vary_is_named(what: str) -> None:
    table, message = WRONG[what]
    with pytest.raises(ExperimentError) as caught:
        Members(small(**table))
    assert str(caught.value).startswith("experiment: ensemble.")
    assert message in str(caught.value)


SCHEMA: dict[str, tuple[dict[str, Any], str]] = {
    "two distributions": (
        {"platform_mass": {"normal": [1, 1], "uniform": [1, 2]}},
        "platform_mass: expected one of normal,",
    ),
    "an unknown one": ({"platform_mass": {"normal": [1, 1], "gauss": [1, 1]}}, "gauss: unknown key"),
    "not a table": ({"platform_mas": 3}, "platform_mas: is 3; expected a setting of the ensemble (members,"),
    "negative": ({"members": -3}, "members: is -3"),
    "not positive": (
        {"covariance": [{"of": ["a", "b"], "matrix": [[1, 2], [2, 1]]}]},
        "not positive definite (smallest eigenvalue -1",
    ),
    "sampling": ({"sampling": "sobel"}, "sampling: is 'sobel'"),
}


@pytest.mark.parametrize("what", SCHEMA)
def test_what_is_no_ensemble_is_refused_as_the_file_is_read(what: str) -> None:
    table, message = SCHEMA[what]
    with pytest.raises(ExperimentError) as caught:
        small(**table)
    assert message in str(caught.value)


def test_numbers_of_saltellis_design_count_what_varies() -> None:
    """Expected: of eight inputs, with those that are correlated as one."""
    with pytest.raises(ExperimentError, match=r"Saltelli's design needs 10 per point \(8 inputs plus 2\)"):
        Members(small(sampling="saltelli", members=41))
    pair = {"of": ["platform_mass", "leg_viscous_friction"], "matrix": [[1, 0.5], [0.5, 1]]}
    assert len(Members(small(sampling="saltelli", correlation=[pair], members=45)).groups) == 7


def test_without_an_ensemble_there_are_no_members() -> None:
    with pytest.raises(ExperimentError, match="ensemble: is missing"):
        gs.run("heave_step", member=3)


def test_grids_give_the_number_of_members() -> None:
    """Expected: 2 × 3 combinations, each once; with something random as many of them as fill a thousand."""
    table = {"loop": {"delay": {"grid": [0, 1]}}, "platform_mass": {"grid": ["1 t", 1200, 1300]}}
    quiet = {name: values for name, values in SMALL.items() if name != "ensemble"}
    members = Members(gs.load_experiment("heave_step", {**quiet, "ensemble": table}))
    assert members.count == 6
    drawn = members.draws(0, 6).columns
    pairs = zip(drawn["loop.delay"], np.asarray(drawn["platform_mass"]).tolist(), strict=True)
    assert set(pairs) == {(d, m) for d in (0, 1) for m in (1000.0, 1200.0, 1300.0)}
    assert Members(gs.load_experiment("heave_step", {"ensemble": {**table, "gravity": {"normal": 0.1}}})).count == 1002


def test_a_grid_in_saltellis_design_has_the_values_of_its_points() -> None:
    """Expected: of A, A with one input of B each, and B, a value of the grid differs from A's in two at most."""
    table = {"loop": {"delay": {"grid": [0, 1, 2]}}, "platform_mass": {"uniform": ["1 t", "2 t"]}}
    members = Members(gs.load_experiment("heave_step", {"ensemble": {**table, "sampling": "saltelli", "members": 400}}))
    drawn = members.draws(0, 400).columns
    delay, mass = (np.asarray(drawn[name]).reshape(100, 4) for name in ("loop.delay", "platform_mass"))
    assert (delay[:, 2] == delay[:, 0]).all()
    assert (delay[:, 1] == delay[:, 3]).all()
    assert (mass[:, 1] == mass[:, 0]).all()
    assert set(delay.ravel().tolist()) == {0, 1, 2}
    assert 0.5 < (delay[:, 0] != delay[:, 3]).mean() < 0.8  # two thirds


def test_a_covariance_gives_draws_of_that_covariance() -> None:
    """Expected: mean and covariance of the draws, within five standard errors."""
    C = np.array([[400.0, -30.0, 0.0, 0.0], [-30.0, 4.0, 0.0, 0.0], [0, 0, 1e-4, 5e-5], [0, 0, 5e-5, 1e-4]])
    C = np.block([[C, np.zeros((4, 1))], [np.zeros((1, 4)), np.array([[1e-4]])]])
    table = {
        "members": 4000,
        "covariance": [{"of": ["leg_armature", "platform_mass", "platform_com"], "matrix": C.tolist()}],
    }
    members = Members(gs.load_experiment("heave_step", {"ensemble": table}))
    drawn = members.draws(0, 4000).columns
    names = ("leg_armature", "platform_mass", "platform_com[1]", "platform_com[2]", "platform_com[3]")
    values = np.array([drawn[name] for name in names])
    spread = np.sqrt(np.diag(C))
    found = np.cov(values) / spread / spread[:, None]
    assert np.abs(found - C / spread / spread[:, None]).max() < 5 / np.sqrt(4000)
    machine = prepare(members.nominal).machine
    assert np.abs(values[:2].mean(axis=1) - [machine.leg_armature, machine.platform_mass]).max() < 5 * 20 / np.sqrt(
        4000
    )


def test_a_correlated_latin_hypercube_has_one_member_in_each_layer() -> None:
    """Expected: of 200 members one in each of 200 layers of each input, by the inverse of its distribution.

    Normal scores are correlated to 0.02, where 200 independent draws scatter by 0.05. A member alone is the same.
    """
    R = np.array([[1.0, 0.8, -0.3], [0.8, 1.0, 0.1], [-0.3, 0.1, 1.0]])
    C = np.array([[4.0, 1.2], [1.2, 1.0]])
    names = ("platform_mass", "leg_viscous_friction", "controller.bandwidth")
    table: dict[str, Any] = {
        "members": 200,
        "sampling": "latin_hypercube",
        "platform_mass": {"uniform": [900, 1100]},
        "leg_viscous_friction": {"normal": [300, 20]},
        "controller": {"bandwidth": {"lognormal": [2, 0.1]}},
        "leg_coulomb_friction": {"uniform": [0, 100]},
        "correlation": [{"of": list(names), "matrix": R.tolist()}],
        "covariance": [{"of": ["leg_armature", "platform.platform_mass"], "matrix": C.tolist()}],
    }
    experiment = gs.load_experiment("heave_step", {"ensemble": table})
    members = Members(experiment)
    drawn = {name: np.asarray(values) for name, values in members.draws(0, 200).columns.items()}
    machine = prepare(experiment).machine
    u = {
        names[0]: (drawn[names[0]] - 900) / 200,
        names[1]: stats.norm.cdf(drawn[names[1]], 300, 20),
        names[2]: stats.norm.cdf(np.log(drawn[names[2]] / 2) / 0.1),
        "leg_coulomb_friction": drawn["leg_coulomb_friction"] / 100,
        "leg_armature": stats.norm.cdf(drawn["leg_armature"], machine.leg_armature, 2),
        "platform.platform_mass": stats.norm.cdf(drawn["platform.platform_mass"], machine.platform_mass, 1),
    }
    for values in u.values():
        assert (np.sort(np.floor(200 * values + 1e-9)) == np.arange(200)).all()
    scores = stats.norm.ppf([u[name] for name in u])
    found = np.corrcoef(scores)
    assert np.abs(found[:3, :3] - R).max() < 0.02
    assert np.abs(found[4, 5] - 0.6) < 0.02
    assert np.abs(found[3, [0, 1, 2, 4, 5]]).max() < 5 / np.sqrt(200)  # of its own alone
    for first, last in ((0, 1), (17, 19), (199, 200)):
        part = Members(experiment).draws(first, last).columns
        assert all((np.asarray(part[name]) == drawn[name][first:last]).all() for name in drawn)


def test_belief_and_machine_vary_each_for_itself() -> None:
    """Expected: a machine that has a mass of its own keeps it when the belief varies."""
    settings = {"plant.parameters.platform_mass": 1234.0, "ensemble": {"platform": {"platform_mass": {"normal": 50}}}}
    members = Members(gs.load_experiment("heave_step", settings))
    batch = members.prepared(0, 3).batch
    assert {each.platform_mass for each in batch.machine} == {1234.0}
    assert len({each.platform_mass for each in batch.platform}) == 3
