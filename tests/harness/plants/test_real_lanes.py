"""Many platforms that stick or give: each as the stepping model has it.

Expected values are those of the stepping model at a tolerance of 1e-11, which steps by halves and wholes of its own.
"""

from functools import cache
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.ensemble.chunk import chunk
from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.plan import plan_of
from gough_stewart.harness.loop.loop_library import loop_kernel
from gough_stewart.harness.loop.run import Run, simulate
from gough_stewart.harness.plants.lanes import LanesPlant, Stepping, lanes_plant
from gough_stewart.harness.plants.model import ModelPlant
from gough_stewart.model.errors import InterfaceError, PlatformError
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.variant import Variant
from gough_stewart.model.vectors import FloatArray
from tests.support.real_platforms import real_platform
from tests.support.uneven import STATE, UNEVEN

STEP, STEPS = 1e-3, 14
BOTH = Variant(bristles=True, springs=True)


def _rest(platform: Platform) -> State:
    return State(platform.home_position, platform.home_orientation, np.zeros(3), np.zeros(3))


def _forces(platform: Platform) -> FloatArray:
    """Inputs (STEPS, 12) under which each leg sticks, breaks away and reverses at times of its own."""
    k, legs = np.arange(STEPS)[:, None], np.arange(6)
    swing = (90.0 + 7 * legs) * np.sin(2 * np.pi * k / (7 + legs)) * (k > 1)
    return np.concatenate([platform.home_actuator_force + swing, np.broadcast_to([3, -2, 4, 1, -1, 2], (STEPS, 6))], -1)


def _stepped(plant: Any, inputs: FloatArray, payload: float | None = None) -> FloatArray:
    """Results (STEPS, ...) after each step; with a payload half way."""
    found = []
    for k in range(STEPS):
        if payload is not None and k == STEPS // 2:
            plant.set_parameters({"platform_mass": payload})
        plant.set_inputs(inputs[k])
        plant.do_step(k * STEP, STEP)
        found.append(plant.results().copy())
    return np.array(found)


@cache
def _reference(friction: str, springs: bool) -> FloatArray:
    """Of two members: one at home at rest, the other in motion with another payload."""
    found = []
    for k in range(2):
        platform, start = _member(friction, springs, k)
        found.append(_stepped(ModelPlant(platform, start, 1e-11, integrator="scipy"), _forces(platform), 13.0))
    return np.stack(found, axis=1)


def _member(friction: str, springs: bool, k: int) -> tuple[Platform, State]:
    platform = real_platform(friction, springs, **({"platform_mass": 17.0, "leg_coulomb_friction": 20.0} if k else {}))
    return platform, (STATE if k else _rest(platform))


def _plant(friction: str, springs: bool, tolerance: float) -> LanesPlant:
    platforms, starts = zip(*(_member(friction, springs, k) for k in range(2)), strict=True)
    kernel = loop_kernel(Variant.of(platforms[0]))
    return lanes_plant(platforms, starts, tolerance=tolerance, kernel=kernel)


def _inputs(friction: str, springs: bool) -> FloatArray:
    return np.stack([_forces(_member(friction, springs, k)[0]) for k in range(2)], axis=1)


CASES = [("elasto_plastic", False), ("smooth", True), ("elasto_plastic", True), ("lugre", True)]


@pytest.mark.parametrize(("friction", "springs"), CASES)
def test_members_are_the_model(friction: str, springs: bool) -> None:
    """Poses within the tolerance, with a payload that comes in between; columns are the model's."""
    expected = _reference(friction, springs)
    platform = _member(friction, springs, 0)[0]
    names = Variant.of(platform).columns
    plant = _plant(friction, springs, 1e-8)
    assert plant.columns == names
    found = _stepped(plant, _inputs(friction, springs), 13.0)
    gap = np.abs(found - expected) / (1 + np.abs(expected).max(axis=0))
    of = {name: gap[..., k].max() for k, name in enumerate(names)}
    assert max(of[name] for name in names[:6]) < 1e-8
    assert max(of[name] for name in names[:24]) < 1e-6
    # the accelerations of stiff parts differ by their stiffness
    assert max(of.values()) < 1e-3
    own = [of[name] for name in names if name.startswith(("leg_bristle", "motor_position"))]
    assert max(own) < 1e-8
    assert 0 < plant.integration_error.max() < 1e-6
    # legs have moved by more than the bristles bend, or the springs stretch
    assert np.abs(expected[..., 12:18] - expected[0, :, 12:18]).max() > 1e-3


def test_the_error_falls_with_the_tolerance() -> None:
    """Against the model: a thousandth of the tolerance is at most a hundredth of the error."""
    expected, gaps = _reference("elasto_plastic", True), []
    for tolerance in (1e-5, 1e-8):
        plant = _plant("elasto_plastic", True, tolerance)
        found = _stepped(plant, _inputs("elasto_plastic", True), 13.0)
        gaps.append(np.abs(found - expected)[..., :12].max())
        assert np.abs(found - expected)[..., :6].max() < tolerance
    assert gaps[1] < 0.01 * gaps[0]


def test_a_member_has_the_same_bits_in_any_company() -> None:
    platforms = [real_platform("elasto_plastic", True, platform_mass=11.0 + k) for k in range(11)]
    inputs = np.stack([_forces(each) for each in platforms], axis=1)
    kernel = loop_kernel(BOTH)

    def run(members: list[int]) -> FloatArray:
        chosen = [platforms[k] for k in members]
        plant = lanes_plant(chosen, [_rest(each) for each in chosen], tolerance=1e-6, kernel=kernel)
        return _stepped(plant, inputs[:, members])

    every = run([*range(11)])
    for members in ([9], [10, 3, 9]):
        np.testing.assert_array_equal(run(members), every[:, members])


def test_motors_follow_a_payload_at_the_start_and_stay_later() -> None:
    """As in the model, rule 11: where the springs carry it; F/k by the platform's statics."""
    platform, heavy = real_platform("elasto_plastic", True), real_platform("elasto_plastic", True, platform_mass=30.0)
    plant = lanes_plant([platform] * 2, [_rest(platform)] * 2)
    plant.set_parameters_of(np.array([True, False]), {"platform_mass": 30.0})
    names = BOTH.columns
    motors = slice(names.index("motor_position[1]"), names.index("motor_position[6]") + 1)
    found, legs = plant.results()[:, motors], plant.results()[0, 12:18]
    for k, each in enumerate((heavy, platform)):
        stretch = np.asarray(each.home_actuator_force) / each.leg_stiffness
        np.testing.assert_allclose(found[k], legs + stretch, rtol=1e-12)
    plant.do_step(0.0, STEP)
    before = plant.results()[:, motors]
    plant.set_parameters({"platform_mass": 40.0, "leg_static_friction": 33.0})
    np.testing.assert_array_equal(plant.results()[:, motors], before)
    with pytest.raises(InterfaceError, match="leg_stiffness: cannot be set during a run"):
        plant.set_parameters({"leg_stiffness": 1e6})


def test_an_ideal_plant_has_no_friction_that_sticks_to_change() -> None:
    plant = lanes_plant([UNEVEN], [STATE])
    with pytest.raises(InterfaceError, match="leg_static_friction: cannot be set during a run"):
        plant.set_parameters({"leg_static_friction": 3.0})


def test_platforms_of_two_kinds_are_refused() -> None:
    sticking, giving = real_platform("elasto_plastic"), real_platform("elasto_plastic", True)
    for first, second, name, text in (
        (UNEVEN, sticking, "leg_friction_model", "it has friction that sticks .* platform 0 smooth friction"),
        (sticking, giving, "leg_stiffness", "it has friction that sticks and legs that give"),
    ):
        with pytest.raises(PlatformError, match=f"{name}: gives platform 2 other states: {text}"):
            lanes_plant([first, first, second], [STATE] * 3)


def test_steps_of_a_fixed_size_are_refused() -> None:
    with pytest.raises(PlantError, match="with friction that sticks and rigid legs has no steps of a fixed size"):
        lanes_plant([real_platform("lugre")], [STATE], substeps=8)


def _experiment(**tables: Any) -> gs.Experiment:
    """A loop on a machine that sticks and gives, which is let go at once."""
    from tests.support.uneven_loops import experiment_of

    machine = {
        **{"leg_friction_model": "elasto_plastic", "leg_coulomb_friction": 12.0, "leg_static_friction": 17.0},
        **{"leg_bristle_stiffness": 1.7e6, "leg_stiffness": 2.3e6, "leg_armature": 3.1, "platform_mass": 14.5},
    }
    motion = {"type": "sine", "position_amplitude": ["8 mm", "-5 mm", "6 mm"], "frequency": "4 Hz"}
    return experiment_of(
        "pid",
        **{
            "plant": {"parameters": machine},
            "reference": motion,
            "sensors": {"side": "motor", "quantisation": {"leg_length": 1e-9}},
            "loop": {"duration": 0.036, "sample_time": "4 ms", "plant_step": "1 ms", "delay": 1},
            "disturbance": [{"at": 0.024, "duration": 0.008, "force": ["180 N", "-90 N", "120 N"]}],
            "change": [{"at": 0.012, "factors": {"platform_mass": 1.3, "leg_coulomb_friction": 0.9}}],
            "ensemble": {
                "tolerance": 1e-8,
                "leg_static_friction": {"uniform": [14.0, 20.0]},
                "leg_stiffness": {"factor": {"uniform": [0.7, 1.3]}},
                "leg_bristle_damping": {"uniform": [60.0, 90.0]},
                "platform_mass": {"factor": {"uniform": [0.9, 1.2]}},
            },
            **tables,
        },
    )


def test_members_of_an_ensemble_are_runs_on_the_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """In machine code and row by row: all columns of members, with what varies, changes and disturbs."""
    batch = Members(_experiment()).prepared(0, 3).batch
    motors = slice(BOTH.columns.index("motor_position[1]"), BOTH.columns.index("motor_position[6]") + 1)
    runs: list[Run] = []
    for is_row_by_row in (False, True):
        running = batch.in_parallel(Stepping(1e-7))
        if is_row_by_row:
            monkeypatch.setattr(LanesPlant, "loop_run", None)
        runs.append(simulate(running.plant, running.law_from, running.loop))
    for k in range(3):
        own = batch.member(k)
        with ModelPlant(own.machine, own.start, 1e-11, integrator="scipy") as plant, own.law_in_a_run() as law:
            expected = simulate(plant, law, own.loop)
        for run in (each.of_member(k) for each in runs):
            assert run.results.shape == expected.results.shape
            assert np.abs(run.results - expected.results)[:, :12].max() < 2e-6
            bristles = BOTH.columns.index("leg_bristle[1]")
            assert np.abs(run.results - expected.results)[:, bristles : bristles + 6].max() < 1e-8
            np.testing.assert_allclose(run.inputs, expected.inputs, rtol=0, atol=1e-2)
            # encoders read the motors' side, where legs without stretch are
            bent = run.results[::4, motors] - run.results[::4, 12:18]
            read = run.measured[:, 12:18] - run.results[:-1:4, 12:18]
            assert np.abs(read - bent[: len(read)]).max() < 1e-9
            assert np.abs(bent).max() > 1e-6
    assert [run.host == "Python" for run in runs] == [False, True]
    # what varies, varies
    stretch = [
        run.results[-1, BOTH.columns.index("motor_position[1]")] for run in (runs[0].of_member(k) for k in range(3))
    ]
    assert len(set(stretch)) == 3


def test_a_run_takes_the_machine_code_and_says_so() -> None:
    record = gs.run(_experiment())
    assert record.metadata["outcome"]["status"] == "completed"
    assert "compiled" in str(record.metadata)
    assert record["leg_bristle"].shape == record["motor_position"].shape == (37, 6)
    member = gs.run(_experiment(), member=2)
    assert member["position"][-1].tolist() != record["position"][-1].tolist()


def test_members_without_the_parts_of_the_machine_are_impossible() -> None:
    """Whatever chunk they are in: the experiment's machine says which parts all have."""
    varied = {"ensemble": {"leg_stiffness": {"choice": [2.0e6, 0.0]}}}
    found = Members(_experiment(**varied)).prepared(0, 12)
    stiff = [
        k
        for k, each in enumerate(Members(_experiment(**varied)).draws(0, 12).values)
        if each["plant", "parameters", "leg_stiffness"] == 0
    ]
    assert 0 < len(stiff) < 12
    assert sorted(found.errors) == stiff
    text = found.reasons[stiff[0]]
    assert "leg_stiffness: gives a member friction that sticks and rigid legs" in text
    assert "expected one kind in all members" in text


def test_a_chunk_of_sticking_machines_has_their_steps_and_metrics() -> None:
    found = chunk(plan_of(_experiment(), None), 0, 8)
    assert found.rows["outcome"].to_list() == ["completed"] * 8
    assert int(found.rows["internal_steps"].to_numpy().min()) > 36
    assert found.rows["tracking.position.norm_peak"].n_unique() == 8
