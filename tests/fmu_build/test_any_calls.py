"""Any sequence of calls: the unit has the bits of the stepping model, and both stay with their judge, `scipy`."""

import pickle
from copy import copy, deepcopy
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytest
from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, initialize, precondition, rule, run_state_machine_as_test

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.fmu_plants import DISCARD, ERROR, Fmu, Plant, refused
from tests.support.steppers import MOTION, PLATFORMS, forces

INPUTS = ("actuator_force", "external_force", "external_torque")
# Parameters that change on the way, by factors; a part of them only some platforms have.
TUNED = ("platform_mass", "platform_inertia", "gravity", "leg_viscous_friction", "leg_coulomb_friction_factor")
OF_BRISTLES = ("leg_static_friction", "leg_bristle_damping")
# Twelve calls are read faster than a shorter failure of steps is found.
PHASES = (Phase.explicit, Phase.reuse, Phase.generate)


class Saved(NamedTuple):
    """A moment of all three, with the place in the sequence of forces."""

    model: Any
    judge: Any
    unit: bytes
    k: int


class AnyCalls(RuleBasedStateMachine):
    """A unit, the stepping model and its judge under the same calls."""

    units: ClassVar[dict[str, list[Fmu]]] = {}
    saved = Bundle("saved")

    def __init__(self) -> None:
        super().__init__()
        self.plants: list[Plant] = []

    @initialize(
        name=st.sampled_from(["ideal", "sticking", "both"]),
        version=st.integers(0, 1),
        fixed=st.sampled_from([0.0, 0.0, 4e-4]),
        tolerance=st.sampled_from([1e-7, 1e-9]),
    )
    def begin(self, name: str, version: int, fixed: float, tolerance: float) -> None:
        self.platform, self.fixed, self.tolerance, self.k = PLATFORMS[name], fixed, tolerance, 0
        self.model = gs.SteppingModel(self.platform, tolerance, fixed)
        self.judge = gs.SteppingModel(self.platform, 1e-10, integrator="scipy")
        files = self.units[name]
        self.plants = [Plant(files[version % len(files)]), Plant(files[-1])]
        self.untouched = [plant.everything() for plant in self.plants]
        self.start()

    def start(self) -> None:
        """In motion; motors where they hold the pose and move with it."""
        for model in (self.model, self.judge):
            model.set_many(MOTION)
        self.states = [v for v in self.plants[0].variables if f"der({v})" in self.plants[0].variables]
        values = {name: self.model.get(name) for name in (*self.states, *INPUTS)}
        values["fixed_step_size"] = self.fixed
        self.plants[0].start(values, self.tolerance, platform=self.platform)
        self.step([1e-3])  # the unit's run begins with its initialisation, the model's with a step

    @rule(sizes=st.lists(st.sampled_from([1e-3, 2.5e-4, 3e-3]), min_size=1, max_size=4))
    def go_on(self, sizes: list[float]) -> None:
        self.step(sizes)

    def step(self, sizes: list[float]) -> None:
        """Steps under forces that change; the judge stays near."""
        unit = self.plants[0]
        for size in sizes:
            now, self.k = self.model.time, self.k + 1
            self.put(forces(self.platform, self.k))
            for model in (self.model, self.judge):
                model.do_step(now, size)
            unit.do_step(now, size)
        gap = np.abs(self.model.state - self.judge.state)
        assert gap[:6].max() < 1e-6
        assert gap[6:12].max() < 2e-4

    def put(self, u: FloatArray) -> None:
        for model in (self.model, self.judge):
            model.set_inputs(u)
        for name, values in zip(INPUTS, (u[:6], u[6:9], u[9:]), strict=True):
            self.plants[0].set(name, values)

    @rule(name=st.sampled_from([*TUNED, *OF_BRISTLES]), factor=st.floats(0.95, 1.05))
    def tune(self, name: str, factor: float) -> None:
        if name in OF_BRISTLES and not self.model.variant.bristles:
            return
        value = factor * np.asarray(self.model.get(name))
        for model in (self.model, self.judge):
            model.set(name, value)
        self.plants[0].set(name, value)

    @rule(target=saved)
    def save(self) -> Saved:
        return Saved(self.model.save_state(), self.judge.save_state(), self.plants[0].serialized(), self.k)

    @precondition(lambda self: self.plants)
    @rule(moment=saved, elsewhere=st.booleans())
    def restore(self, moment: Saved, elsewhere: bool) -> None:
        if elsewhere:
            self.plants.reverse()
            self.untouched.reverse()
            self.model = gs.SteppingModel(self.platform, self.tolerance, self.fixed)
        self.plants[0].restore(moment.unit)
        self.model.restore_state(moment.model)
        self.judge.restore_state(moment.judge)
        assert (self.model.save_state(), self.plants[0].serialized()) == (moment.model, moment.unit)
        self.k = moment.k

    @rule(first=st.sampled_from(["leg_length", "acceleration", "potential_energy"]))
    def read(self, first: str) -> None:
        """What is kept of earlier computations never shows; legs alone come from another function of the kernel."""
        fresh = gs.SteppingModel(self.platform, self.tolerance, self.fixed)
        fresh.restore_state(self.model.save_state())
        results = fresh.results()
        for name in (first, *results):
            assert self.plants[0].get(name) == pytest.approx(results[name], rel=1e-13, abs=1e-12), name

    @rule(kind=st.sampled_from([copy, deepcopy, lambda model: pickle.loads(pickle.dumps(model))]))
    def go_on_with_a_copy(self, kind: Any) -> None:
        older, self.model = self.model, kind(self.model)
        self.judge = kind(self.judge)
        older.reset()  # shares nothing

    @rule()
    def reset(self) -> None:
        self.plants[0].fmu.reset()
        begun = self.plants[0].everything()
        assert all(np.array_equal(begun[name], value) for name, value in self.untouched[0].items())
        for model in (self.model, self.judge):
            model.reset()
        fresh = gs.SteppingModel(self.platform, self.tolerance, self.fixed)
        assert self.model.save_state() == fresh.save_state()
        self.start()

    @rule(case=st.sampled_from(["value", "late", "time", "forces"]))
    def refuse(self, case: str) -> None:
        """What cannot be changes nothing."""
        unit, now = self.plants[0], self.model.time
        u = np.concatenate([self.model.get(name) for name in INPUTS])
        before = self.model.save_state(), unit.serialized()
        status = {"value": DISCARD, "forces": DISCARD}.get(case, ERROR)
        if case == "forces":
            self.put(np.append(np.full(6, 1e29), u[6:]))
        for plant in (self.model, unit):
            calls: dict[str, Any] = {
                "value": (plant.set, "platform_mass", -1.0),
                "late": (plant.set, "position", self.platform.home_position),
                "time": (plant.do_step, now + 0.5, 1e-3),
                "forces": (plant.do_step, now, 1e-2),
            }
            call, *arguments = calls[case]
            if plant is unit:
                assert refused(call, *arguments) == status
            else:
                with pytest.raises(gs.GoughStewartError):
                    call(*arguments)
        if case == "forces":
            self.put(u)
        assert (self.model.save_state(), unit.serialized()) == before

    def teardown(self) -> None:
        """The bits at the end, of all results; no instance is left."""
        if self.plants:
            for name, value in self.model.results().items():
                assert np.array_equal(self.plants[0].get(name), value), name
            for plant in self.plants:
                plant.free()


def test_any_sequence_of_calls_keeps_unit_model_and_judge_together(
    fmus: dict[str, Fmu], whole: dict[str, Fmu], sticking: Fmu
) -> None:
    """Expected: equal bits of unit and model; the judge within the tolerance; refused calls leave all as it was."""

    class OfUnits(AnyCalls):
        units: ClassVar[dict[str, list[Fmu]]] = {
            "ideal": list(fmus.values()),
            "sticking": [sticking],
            "both": list(whole.values()),
        }

    run_state_machine_as_test(OfUnits, settings=settings(max_examples=20, stateful_step_count=12, phases=PHASES))
