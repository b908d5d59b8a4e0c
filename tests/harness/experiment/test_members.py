"""Members of ensembles: what may vary, each member as if it were alone, and why others cannot run."""

from typing import Any

import pytest

import gough_stewart as gs
from tests.harness.ensemble.small_ensemble import small

NORMAL = {"normal": [1, 1]}
COMMON = (
    *("loop.duration", "loop.sample_time", "loop.plant_step", "sensors.seed", "sensors.sample_time", "sensors.side"),
    *("plant.kind", "plant.fmu", "plant.file", "plant.tolerance", "plant.fixed_step_size", "platform.preset"),
    *("platform.file", "limits.stroke", "limits.condition_number", "controller.type", "controller.space"),
    *("reference.type", "sensors", "ensemble.members"),
)
PAIR, UNIT = ["platform_mass", "leg_viscous_friction"], [[1, 0], [0, 1]]
# A key with how it varies, or a whole table, and the message after its name.
WRONG: list[tuple[str, Any, str]] = [
    *((key, NORMAL, "is common to all members; expected a parameter of the machine, or a number of") for key in COMMON),
    ("platform_mas", NORMAL, "no such parameter; did you mean 'platform_mass'?"),
    ("plant.parameters.platform_mss", NORMAL, "no such parameter; did you mean 'platform_mass'?"),
    ("platform.parameters.x", NORMAL, "no such parameter"),
    ("plant.platform_com.x", NORMAL, "no such parameter; expected"),
    ("sensor.noise", NORMAL, "no such parameter; did you mean 'sensors'?"),
    ("controller.bandwith", NORMAL, "no such key of [controller]; did you mean"),
    ("sensors.noise.leg_lenth", NORMAL, "no signal 'leg_lenth'; did you mean"),
    ("sensors.noise.leg_length.x", NORMAL, "expected one name after noise"),
    ("sensors.noise", NORMAL, "expected one name after noise"),
    *(
        (f"disturbance.{inner}", NORMAL, "expected disturbance.1 to disturbance.1 and a key of it")
        for inner in ("0.force", "2.force", "x.force", "1")
    ),
    ("change.1.factors.platform_mass", NORMAL, "no [[change]]"),
    ("injection.amplitude", NORMAL, "the experiment has no [injection]"),
    ("loop.delay.x", {"choice": [1, 2]}, "loop.delay is not a table"),
    ("loop.delay", {"uniform": [0, 2]}, "uniform applies to numbers only; expected choice or grid"),
    ("controller.feedforward", {"uniform": [1, 2]}, "uniform applies to numbers only"),
    ("actuators.force_limit", {"factor": NORMAL}, "has no value to vary about"),
    ("actuators.rate_limit", {"normal": 3}, "has no value to vary about"),
    ("plant.parameters.platform_mass", {"uniform": [1, 2]}, "varies twice"),
    ("correlation", [{"of": ["platform_mass", "gravity"], "matrix": UNIT}], "is correlated but does not va"),
    ("correlation", [{"of": ["platform_mass", "base_points"], "matrix": UNIT}], "have 19 elements; their m"),
    ("correlation", [{"of": PAIR, "matrix": [[2, 0], [0, 1]]}], "expected a matrix with 1 on the diagonal"),
    ("correlation", [{"of": PAIR, "matrix": UNIT}, {"of": PAIR[::-1], "matrix": UNIT}], "is in two matrices"),
    ("covariance", [{"of": ["leg_armature", "gravity"], "matrix": UNIT}], "has 3 elements; the matrix has 1 rows le"),
    ("covariance", [{"of": ["platform_mass"], "matrix": [[2]]}], "has a distribution and a covariance"),
]


@pytest.mark.parametrize(("key", "how", "says"), WRONG)
def test_what_cannot_vary_is_named(key: str, how: Any, says: str) -> None:
    for name in reversed(key.split(".")):
        how = {name: how}
    with pytest.raises(gs.GoughStewartError) as caught:
        gs.run(small(**how), member=0)
    place, _, message = str(caught.value).removeprefix("experiment: ensemble.").partition(": ")
    assert place == key or says == "varies twice" or isinstance(how[name], list)
    assert message.startswith(says)


def test_numbers_of_saltellis_design_count_what_varies() -> None:
    """Expected: of eight inputs, those that are correlated as one; a power of two of points, above or below."""
    with pytest.raises(gs.GoughStewartError, match=r"Saltelli's design needs 10 per .*8 inputs plus 2.* 40$"):
        gs.run(small(sampling="saltelli", members=41), member=0)
    pair = {"of": PAIR, "matrix": [[1, 0.5], [0.5, 1]]}
    with pytest.raises(gs.GoughStewartError, match=r"Saltelli's design needs 9 per .*7 inputs plus 2.* 72$"):
        gs.run(small(sampling="saltelli", members=59, correlation=[pair]), member=0)


def test_an_ensemble_in_which_nothing_varies_is_refused() -> None:
    """Expected: noise or jitter alone are enough."""
    still: dict[str, Any] = {"loop.duration": 0.02, "reference.at": 0.01, "sensors": {}, "ensemble": {"members": 2}}
    with pytest.raises(gs.GoughStewartError, match=r"ensemble: nothing varies; expected a distribution, for instance"):
        gs.run("heave_step", still, member=0)
    noisy = gs.run("heave_step", {**still, "sensors": {"noise": {"leg_length": 1e-6}}}, member=1)
    assert noisy.metadata["seed"] == {"entropy": 0, "spawn_key": [1]}
    gs.run("heave_step", {**still, "loop.plant_step": 5e-4, "loop.jitter": 5e-4}, member=1)
    with pytest.raises(gs.GoughStewartError, match=r"limits\.stroke: is 'stop', which is for single runs only"):
        gs.run("heave_step", {**still, "limits": {"stroke": "stop"}}, member=0)


def test_the_number_of_members_is_that_of_the_grids_or_fills_a_thousand() -> None:
    """Expected: 2 × 3 combinations, each once; with something random as many of them as fill a thousand."""
    grids = {"loop": {"delay": {"grid": [0, 1]}}, "platform_mass": {"grid": ["1 t", 1200, 1300]}}
    settings = {"loop.duration": 4e-3, "reference.at": 1e-3, "ensemble": grids}
    found = gs.ensemble("heave_step", settings, workers=1).members
    pairs = zip(found["varied.loop.delay"], found["varied.platform_mass"], strict=True)
    assert sorted(pairs) == [(d, m) for d in (0, 1) for m in (1000.0, 1200.0, 1300.0)]
    settings["ensemble"] = {**grids, "gravity": {"normal": 0.1}}
    with pytest.raises(gs.GoughStewartError, match="expected 0 to 1001"):
        gs.run("heave_step", settings, member=1002)


SHORT: dict[str, Any] = {
    "loop.duration": 0.05,
    "loop.plant_step": "0.25 ms",
    "reference.at": 0.01,
    "reference.duration": 0.03,
    "reference.position_change": [0, 0, 2e-4],
    "plant.tolerance": 1e-10,
    "change": [{"at": 0.02, "factors": {"platform_mass": 1.2}}],
}


# What varies, the value that cannot be, and the part that its own experiment names.
IMPOSSIBLE: dict[str, tuple[dict[str, Any], str, Any]] = {
    "controller": ({"controller": {"bandwidth": {"choice": [2.0, -1.0, 3.0]}}}, "controller.bandwidth", -1.0),
    "platform": ({"platform": {"platform_mass": {"choice": [1e3, -5.0]}}}, "platform.platform_mass", -5.0),
    "plant": ({"leg_lower_com": {"choice": [0.5, 40.0, 0.6]}}, "leg_lower_com", 40.0),
    "loop": ({"loop": {"jitter": {"choice": [0.0, 0.7, 3e-4]}}}, "loop.jitter", 0.7),
    "sensors": ({"sensors": {"noise": {"leg_length": {"choice": [1e-6, 1e-20]}}}}, "sensors.noise.leg_length", 1e-20),
    "reference": ({"reference": {"amplitude_scale": {"choice": [0.5, 1e4, 1.0]}}}, "reference.amplitude_scale", 1e4),
    "change": ({"change": {"1": {"at": {"choice": [0.01, 0.0101, 0.02]}}}}, "change.1.at", 0.0101),
}


@pytest.mark.parametrize("part", IMPOSSIBLE)
def test_an_impossible_member_has_the_error_of_its_own_experiment(part: str) -> None:
    """Expected: those with that value, in the words of a run of their own; the others complete."""
    varied, key, bad = IMPOSSIBLE[part]
    mass = {"platform_mass": {"factor": {"uniform": [0.8, 1.3]}}}
    settings = {**SHORT, "ensemble": {"members": 12, "worst": 0, **mass, **varied}}
    found = gs.ensemble("heave_tolerances", settings, workers=1).members
    is_bad = found[f"varied.{key}"] == bad
    assert 0 < is_bad.sum() < 12
    assert ((found["outcome"] == "impossible") == is_bad).all()
    assert (found.filter(~is_bad)["outcome"] == "completed").all()
    place = {"leg_lower_com": "plant.parameters.leg_lower_com"}
    place["platform.platform_mass"] = "platform.parameters.platform_mass"
    with pytest.raises(gs.GoughStewartError) as caught:
        gs.run("heave_tolerances", {**SHORT, place.get(key, key): bad, "ensemble": mass})
    (cause,) = found.filter(is_bad)["cause"].unique()
    own = str(caught.value).removeprefix("experiment 'heave_tolerances': ")
    # in a file its key has all its tables
    assert own.replace(": ", ".") == cause.replace(": ", ".")


def test_a_machine_that_cannot_hold_its_start_is_alone_impossible() -> None:
    """Expected: of two machines the one whose legs are all in one plane, which has no static forces."""
    nominal = gs.load_preset("motion_base")
    flat, base = nominal.platform_points.copy(), nominal.base_points.copy()
    base[:, 2], flat[:, 2] = nominal.home_position[2], 0.0
    plant = {"platform_points": flat.tolist(), "home_position": [0, 0, 9.0], "leg_length_max": 20.0}
    settings: dict[str, Any] = {"loop.duration": 0.05, "reference.at": 0.01, "plant.parameters": plant}
    choice = [nominal.base_points.tolist(), base.tolist()]
    settings["ensemble"] = {"base_points": {"grid": choice}, "worst": 0}
    found = gs.ensemble("heave_step", settings, workers=1).members
    assert found["outcome"][1] == "impossible"
    assert "leg Jacobian has condition number" in str(found["cause"][1])
    assert found["outcome"][0] != "impossible"


def test_belief_and_machine_vary_each_for_itself() -> None:
    """Expected: a machine that has a mass of its own keeps it when the belief varies."""
    settings: dict[str, Any] = {"loop.duration": 0.01, "reference.at": 5e-3, "plant.parameters.platform_mass": 1234.0}
    settings["ensemble"] = {"platform": {"platform_mass": {"normal": 50}}}
    records = [gs.run("heave_step", settings, member=k) for k in range(3)]
    assert {record.metadata["machine"]["platform_mass"] for record in records} == {1234.0}
    assert len({record.metadata["platform"]["platform_mass"] for record in records}) == 3
