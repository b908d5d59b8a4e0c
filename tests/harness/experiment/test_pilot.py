"""The pilot: the same machines and substeps for any number of members, and no code of the user."""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.batch import Batch
from gough_stewart.harness.experiment.file import experiment_from
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.pilot import pilots, stand_in, substeps_of
from gough_stewart.harness.experiment.plan import plan_of
from gough_stewart.harness.loop.observe import observe_all
from gough_stewart.harness.loop.rows import Observer, Rows
from tests.support.memory import EXPERIMENT, SHORT, Pid
from tests.support.small_ensemble import SMALL, small


def masses(members: Members) -> list[float]:
    return [float(each.platform_mass) for each in pilots(members).machine]


@pytest.mark.parametrize("sampling", ["random", "sobol", "latin_hypercube"])
def test_its_machines_do_not_depend_on_the_number_of_members(sampling: str) -> None:
    """Expected: the nominal machine first, then seven that differ; other ones for another seed."""
    few, many = (masses(Members(small(members=n, sampling=sampling))) for n in (1, 400))
    assert few == many
    assert len(few) == 8
    assert few[0] == gs.load_preset("motion_base").platform_mass
    assert len(set(few)) == 8
    assert masses(Members(small(seed=4)))[1:] != few[1:]


def test_grids_do_not_begin_in_a_corner() -> None:
    """Expected: of ten values of a grid the pilot tries several, whatever else multiplies their number."""
    grid = {"platform_mass": {"grid": [500.0 + 100 * k for k in range(10)]}}
    alone = masses(Members(small(**grid)))
    assert len(set(alone[1:])) >= 4
    finer = {**grid, "controller": {"bandwidth": {"grid": ["2 Hz", "3 Hz", "4 Hz"]}}}
    assert masses(Members(small(**finer))) == alone


@pytest.mark.parametrize("controller", [None, Pid])
def test_every_number_of_members_has_the_same_substeps(controller: Any) -> None:
    """Stiff friction, so that there are several; today's first four members would need fewer than the first eight."""
    stiff = {"plant.parameters": {"leg_friction_velocity": 2e-3}}
    found = {
        plan_of(gs.load_experiment(EXPERIMENT, {**SHORT, **stiff, "ensemble.members": n}), controller).substeps
        for n in (1, 4, 8, 600)
    }
    assert len(found) == 1
    assert found.pop() > 1


def test_the_stand_in_needs_as_many_substeps_as_controllers_that_work() -> None:
    """Expected: its error per step is at least a third of the largest of three PIDs of the user, of other gains."""

    class Nothing(Observer):
        def block(self, rows: Rows) -> None:
            pass

    def error(batch: Batch) -> float:
        running = batch.in_parallel(1)
        with running.plant:
            outcomes = observe_all(running.plant, running.law_from, running.loop, Nothing())
        assert {outcome.status for outcome in outcomes} == {"completed"}
        return float(running.plant.integration_error.max())

    experiment = gs.load_experiment(EXPERIMENT, {"loop.duration": 0.3})
    real = [
        error(pilots(Members(experiment, lambda platform, T, k=k: Pid(platform, T, 3e4 * k, 5e3 * k))))
        for k in (1, 2, 4)
    ]
    assert error(stand_in(pilots(Members(experiment, Pid)))) > max(real) / 3


def test_it_calls_no_code_of_the_user() -> None:
    """Expected: neither made nor called, for a class, an object and a function that count."""
    counted = list[str]()

    class Counts:
        def __init__(self, *_arguments: Any) -> None:
            counted.append("made")

        def __call__(self, _sample: gs.Sample) -> Any:
            counted.append("called")
            return np.zeros(6)

    thing = Counts()
    counted.clear()

    def function(sample: gs.Sample) -> Any:
        return thing(sample)

    for controller in (Counts, thing, function):
        assert substeps_of(Members(gs.load_experiment(EXPERIMENT, SHORT), controller)) >= 1
    assert counted == []


def test_it_stands_in_for_slow_samples_too() -> None:
    """Expected: with samples every 20 ms, a delay and a lag as many as a gentle linear controller, or half or twice."""
    slow = {
        **SMALL,
        "loop": {"duration": 1.0, "sample_time": 0.02, "plant_step": 2e-3, "delay": 2},
        "controller": {"type": "pd", "bandwidth": 0.8, "feedforward": "computed_torque"},
        "actuators": {"lag": 0.02},
        "sensors": {},
        "ensemble": {"members": 4, "seed": 3, "platform_mass": {"factor": {"uniform": [0.8, 1.3]}}},
    }
    linear = substeps_of(Members(experiment_from(slow)))
    assert linear / 2 <= substeps_of(Members(experiment_from(slow), Pid)) <= 2 * linear


def test_members_that_are_all_impossible_are_refused() -> None:
    heavy = small(platform_mass={"uniform": [-20.0, -10.0]})
    with pytest.raises(ExperimentError, match=r"none of the first 40 members is possible; the first: .*platform_mass"):
        pilots(Members(heavy))


def test_a_member_keeps_its_name_in_a_design_of_another() -> None:
    """Expected: the independent draws are those of the design that is random already."""
    members = Members(small())
    independent, own = members.independent_draws(0, 9), members.draws(0, 9)
    for name, values in own.columns.items():
        assert np.array_equal(independent.columns[name], values), name
