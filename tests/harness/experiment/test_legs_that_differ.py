"""Legs that differ, in experiments: every host has the same six, and limits are those of each leg."""

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.real_platforms import SIX, SIX_SPRINGS
from tests.support.uneven_loops import experiment_of

LOOP = {"duration": 0.05, "sample_time": 5e-3, "delay": 1}


def test_scipy_has_the_same_six_legs_that_stick_and_give() -> None:
    """Expected: the judge of integration, whose equations Newton and Euler judge."""
    machine = {**SIX, **SIX_SPRINGS, "leg_coulomb_friction": 20.0, "leg_friction_model": "lugre"}
    experiment = experiment_of("pd", loop=LOOP, plant={"parameters": machine, "tolerance": 1e-10})
    runs = [gs.run(experiment, {"plant.kind": name}) for name in ("model", "scipy")]
    ends = [np.concatenate([run["position"], run["velocity"]], axis=1) for run in runs]
    assert np.abs(ends[0] - ends[1]).max() < 2e-8


def test_members_draw_limits_of_each_leg() -> None:
    """Expected: the factor times each leg's own limit, of as many members as legs; none is another's."""
    members = 6
    drawn = {"members": members, "platform.actuator_force_max": {"factor": {"uniform": [0.9, 1.1]}}}
    limits = [120.0, 150.0, 140.0, 160.0, 130.0, 125.0]
    six = {"platform.parameters.actuator_force_max": limits}
    table = gs.ensemble(experiment_of("pd", loop=LOOP, ensemble=drawn), six, workers=1).members
    factors = table["varied.platform.actuator_force_max.factor"].to_numpy()
    assert len(np.unique(factors)) == members
    assert table["limits.actuator_force_max.limit"].to_numpy() == pytest.approx(factors * min(limits), rel=1e-12)


@pytest.mark.parametrize("case", ["compiled", "python", "settings that change"])
def test_each_leg_has_its_own_limits(case: str) -> None:
    """Expected: commands clipped to each leg's force, and shares of each leg's limits, by NumPy from the record."""
    forces, speeds = [60.0, 90.0, 70.0, 80.0, 65.0, 75.0], [0.1, 0.2, 0.3, 0.15, 0.25, 0.12]
    # the nearest end is of leg 4, the lower or the upper one; those of others are nearer to other legs
    low, high = [2.3, 2.4, 2.2, 2.95 if case == "compiled" else 2.3, 2.5, 2.4], [3.9, 3.8, 3.9, 3.7, 3.9, 3.6]
    limits = {"leg_velocity_max": speeds, "leg_length_min": low, "leg_length_max": high, "actuator_force_max": forces}
    tables = {"reference": {"type": "hold", "position": [0.0, 0.0, 2.9]}, "limits": {"reference": "warn"}}
    tables |= {"change": [{"at": 0.1, "delay": 2}]} if case == "settings that change" else {}
    settings = {f"platform.parameters.{name}": value for name, value in limits.items()}
    law = (lambda sample: np.full(6, 20 * sample.force_limit)) if case == "python" else None
    run = gs.run(experiment_of("pd", loop={**LOOP, "duration": 0.2}, **tables), settings, controller=law)
    assert (np.abs(run["actuator_force"]).max(axis=0) <= np.array(forces) * (1 + 1e-12)).all()
    assert run["flag.force_limited"].any()
    assert run.metadata["force_limit"] == forces
    if law is not None:  # it knows of the least limit
        assert run["controller.force"] - run["controller.feedforward"] == pytest.approx(20 * 60.0)
    found = gs.metrics(run)
    used = np.abs(run["leg_velocity"]).max(axis=0) / speeds
    assert found["limits"]["leg_velocity_max"]["used"] == pytest.approx(used)
    assert found["limits"]["leg_velocity_max"]["limit"] == speeds
    below, above = (run["leg_length"] - low).min(axis=0), (high - run["leg_length"]).min(axis=0)
    assert (below.min() < above.min()) == (case == "compiled")
    assert found["stroke"]["margin"] == pytest.approx(min(below.min(), above.min()))


def test_a_motion_is_held_against_each_legs_limits() -> None:
    """Expected: the largest share of the leg lengths themselves."""
    sine = {"type": "sine", "position_amplitude": [0.05, 0.02, 0.1], "frequency": 1.0}
    experiment = experiment_of("pd", reference=sine)
    high = np.array([3.9, 3.8, 3.7, 3.9, 3.75, 3.65])
    checked = gs.check(experiment, {"platform.parameters.leg_length_max": high.tolist()})
    motion = gs.run(experiment, {"loop.duration": 1.0})["reference.leg_length"]
    middle, half = (high + 2.3) / 2, (high - 2.3) / 2
    assert checked.shares.peak("stroke").share == pytest.approx((np.abs(motion - middle) / half).max(), rel=1e-3)


def test_what_needs_legs_alike_says_so() -> None:
    six = {"platform.parameters.actuator_force_max": [160, 190, 170, 180, 165, 175]}
    with pytest.raises(gs.GoughStewartError, match=r"force_limit is \[160.*one number"):
        gs.export(experiment_of("pd"), six)
