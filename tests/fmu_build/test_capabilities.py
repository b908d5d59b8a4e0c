"""Every capability that the model descriptions declare, tried by FMPy in both versions."""

import struct
from collections.abc import Callable
from ctypes import POINTER, byref, c_bool, c_double, c_int
from functools import partial
from typing import Any

import numpy as np
import pytest

from tests.support.fmu_plants import DISCARD, ERROR, OK, Fmu, Plant, plant, refused
from tests.support.lagrangian import FloatArray
from tests.support.plain_motion import trajectory
from tests.support.saved_bytes import KIND, MODE, accepts, numbers_of, sealed, with_numbers
from tests.support.uneven import INPUT_VALUES, MOVING, STATE, UNEVEN

INPUTS = tuple(INPUT_VALUES)
U = np.concatenate(list(INPUT_VALUES.values()))


def test_a_restored_state_goes_on_where_it_was_in_every_respect(fmu: Fmu) -> None:
    """Expected: mode, time, stop time, tolerance; and not in an instance of the other kind."""
    with plant(fmu) as p, plant(fmu) as q, plant(fmu, co_simulation=False) as other:
        p.start(MOVING, tolerance=3e-7, stop=0.5)
        p.do_step(0.0, 0.1)
        q.restore(p.serialized())
        assert q.time == 0.1
        q.refuses("stop time", ERROR, q.do_step, 0.1, 0.5)
        for instance in (p, q):
            assert refused(instance.do_step, 0.1, 0.3) == OK
        assert p.serialized() == q.serialized()
        other.start()
        p.refuses("Model Exchange", ERROR, p.restore, other.serialized())


@pytest.fixture
def stepped(fmu: Fmu) -> tuple[Fmu, bytes]:
    with plant(fmu) as p:
        p.start(MOVING, tolerance=3e-7)
        p.do_step(0.0, 0.01)
        return fmu, p.serialized()


def test_foreign_bytes_are_refused_and_change_nothing(stepped: tuple[Fmu, bytes]) -> None:
    """Expected: the format by its magic number, version, variables and checksum, in whole words."""
    fmu, blob = stepped
    assert blob == sealed(blob[:-8])
    assert blob[:8] == b"GSTEWART"

    def flipped(at: int) -> bytes:
        return blob[:at] + bytes([blob[at] ^ 1]) + blob[at + 1 :]

    cases = [
        *((other, "not a state") for other in (b"", blob[:20], b"x" * len(blob))),
        *((other, "bytes; expected") for other in (blob[:-1], blob + b"\0")),
        *((flipped(at), "version") for at in (8, 24)),
        *((flipped(at), "damaged") for at in (100, len(blob) - 1)),
    ]
    with plant(fmu) as p:
        p.restore(blob)
        for damaged, expected in cases:
            p.refuses(expected, ERROR, p.fmu.deserializeFMUState, damaged)
        assert p.serialized() == blob


def test_numbers_that_no_state_has_are_refused(stepped: tuple[Fmu, bytes]) -> None:
    """Expected: no NaN; infinity for a stop time alone; no step below 0; 1e-13 ≤ tolerance ≤ 1e-2."""
    fmu, blob = stepped
    good = numbers_of(blob)
    never_below_0 = []
    with plant(fmu) as p:

        def takes(place: int, value: float) -> bool:
            changed = good.copy()
            changed[place] = value
            return accepts(p, with_numbers(blob, changed))

        for k, value in enumerate(good):
            assert not takes(k, np.nan)
            assert takes(k, np.inf) == np.isinf(value), k
            if not takes(k, -1.0):
                never_below_0.append(value)
        step, tolerance, *fixed = sorted(never_below_0, reverse=True)
        assert 1e-3 < step < 1  # the internal step, of a hundredth of a second or so
        assert (tolerance, fixed) == (3e-7, [0.0, 0.0])  # the size of fixed steps, and the largest that is stable
        (place,) = np.flatnonzero(good == 3e-7).tolist()
        assert [takes(place, value) for value in (0.9e-13, 1e-13, 1e-2, 1.1e-2)] == [False, True, True, False]


def test_a_mode_that_the_kind_cannot_be_in_is_refused(stepped: tuple[Fmu, bytes]) -> None:
    """Expected: kinds 1 (Model Exchange) and 2; modes are bits, instantiated 1 … terminated 64, one at a time."""
    fmu, blob = stepped
    possible = {1: {1, 2, 4, 8, 64}, 2: {1, 2, 16, 64}}
    with plant(fmu) as p:
        for kind in (0, 1, 2, 3, 256, 2**31):
            for mode in (0, 1, 2, 3, 4, 8, 12, 16, 18, 32, 64, 65, 80, 128, 256, 2**31):
                header = blob[:KIND] + struct.pack("<II", kind, mode) + blob[MODE + 4 : -8]
                assert accepts(p, sealed(header)) == (mode in possible.get(kind, set())), (kind, mode)


# At home, where motors may begin, with bristles bent and everything in motion.
HELD: dict[str, Any] = {
    **{"position": UNEVEN.home_position, "orientation": UNEVEN.home_orientation},
    **{"leg_bristle": 1e-6 * np.array([2.0, -1.0, 3.0, 1.5, -2.5, 1.0]), "motor_velocity": 0.02 * np.arange(1, 7)},
    "leg_stribeck_velocity": 0.05,
    "leg_static_friction_factor": np.linspace(1.0, 1.3, 6),
}


@pytest.mark.parametrize("mode", ["initialisation", "Co-Simulation", "Model Exchange"])
def test_directional_derivatives_are_difference_quotients(any_fmu: Fmu, mode: str) -> None:
    """Expected: central differences of the unit's own results, by each known together with all others before the start.

    During a run states and parameters are fixed; what they were before the start is expected there.
    """
    rng, h = np.random.default_rng(6), 1e-6
    smooth = {"leg_friction_velocity": 0.1}  # or else friction bends within the difference
    values = {**smooth, **MOVING, **(HELD if "leg_bristle" in any_fmu.variables else {})}
    with plant(any_fmu) as before, plant(any_fmu, mode != "Model Exchange") as p:
        for name, value in values.items():
            before.set(name, value)
        if before.is_fmi2:
            before.fmu.setupExperiment()
        before.fmu.enterInitializationMode()
        asked = before if mode == "initialisation" else p.start(values)
        kinds = {name: whole.declared[0].causality for name, whole in p.variables.items()}
        is_state = {name: whole.declared[0].start is not None for name, whole in p.variables.items()}
        unknowns = [name for name, kind in kinds.items() if kind in ("output", "local") and not is_state[name]]
        knowns = [
            name
            for name, kind in kinds.items()
            if is_state[name] and name not in ("fixed_step_size", "leg_friction_model")
        ]
        for known in knowns:
            value, seed = before.get(known), rng.uniform(0.5, 1.5, before.variables[known].shape)
            if known == "platform_inertia":
                seed = seed + seed.T
            ends = []
            for sign in (1, -1):
                before.set(known, value + sign * h * seed)
                ends.append({name: before.get(name) for name in unknowns})
            before.set(known, value)
            for unknown in unknowns:
                expected = np.ravel((ends[0][unknown] - ends[1][unknown]) / (2 * h))
                scale = np.abs(expected).max() + np.abs(ends[0][unknown]).max()
                found = asked.directional(unknown, known, seed)
                assert found == pytest.approx(expected, rel=1e-5, abs=1e-7 * scale + 1e-7), (unknown, known)


def test_adjoint_and_directional_derivatives_are_transposes(fmu3: Fmu) -> None:
    """Expected: w·(J v) = (Jᵀ w)·v for every pair of unknown and known."""
    rng = np.random.default_rng(7)
    with plant(fmu3) as p:
        p.start(MOVING).fmu.terminate()
        for unknown in ("acceleration", "der(orientation)", "leg_length", "joint_force", "potential_energy"):
            for known in ("orientation", "velocity", "external_torque", "platform_points", "leg_upper_mass_factor"):
                v, w = rng.normal(size=p.size(known)), rng.normal(size=p.size(unknown))
                forward = p.directional(unknown, known, v)
                arguments = p.references(unknown), p.references(known), w.tolist()
                reverse = p.fmu.getAdjointDerivative(*arguments, nSensitivity=len(v))
                assert w @ forward == pytest.approx(np.array(reverse) @ v, rel=1e-10, abs=1e-10)


def test_what_is_no_unknown_or_known_is_an_error(fmu: Fmu) -> None:
    with plant(fmu) as p:
        p.refuses("not allowed in the instantiated state", ERROR, p.directional, "acceleration", "velocity", np.ones(3))
        p.start()
        if not p.is_fmi2:
            for seed, n, words in ((3, 2, "2 values of the unknowns; expected 3"), (4, 3, "4 values of the knowns")):
                variables = p.references("acceleration"), p.references("velocity")
                asked = partial(p.fmu.getDirectionalDerivative, *variables, [1.0] * seed, nSensitivity=n)
                p.refuses(words, ERROR, asked)
        for pair in (("actuator_force", "position"), ("position", "leg_length"), ("position", "fixed_step_size")):
            p.refuses("expected", ERROR, p.directional, *pair, [1.0] * p.size(pair[1]))


def test_output_derivatives_are_difference_quotients_over_time(fmu: Fmu) -> None:
    """Expected: central differences along the unit's own trajectory; in FMI 2.0 under forces that change."""
    h, points = 1e-4, []
    outputs = [name for name, whole in fmu.variables.items() if whole.declared[0].causality == "output"]
    with plant(fmu) as p:
        if p.is_fmi2:
            p.set_input_rates("actuator_force", [30.0, -20.0, 50.0, -70.0, 10.0, 90.0])
        p.start(MOVING, tolerance=1e-12)
        p.do_step(0.0, 0.3 - h)
        for k in range(3):
            points.append({name: np.ravel(p.get(name)) for name in outputs})
            if k == 1:
                rates = {name: p.output_rates(name) for name in outputs}
            p.do_step(0.3 + (k - 1) * h, h)
        for name in outputs:
            expected = (points[2][name] - points[0][name]) / (2 * h)
            assert rates[name] == pytest.approx(expected, rel=1e-5, abs=1e-5), name


def test_rates_of_other_orders_or_other_variables_are_errors(fmu2: Fmu) -> None:
    with plant(fmu2) as p:
        p.start()
        force, position = p.references("actuator_force")[:1], p.references("position")
        wrong = ((force, [2], [1.0], "order 2"), (position[:1], [1], [1.0], ""), (force, [1], [np.nan], ""))
        for references, orders, rates, text in wrong:
            p.refuses(text, ERROR, p.fmu.setRealInputDerivatives, references, orders, rates)
        for references, orders, text in ((force, [1], ""), (position[:1], [0], ""), (position, [1, 1, 2], "order 2")):
            p.refuses(text, ERROR, p.fmu.getRealOutputDerivatives, references, orders)


FEWER = [20.0, 28.0, 17.0, 33.0, 25.0, 12.0]
Act = Callable[[Plant, float, tuple[bool, ...]], float | None]


def updated(fmu: Fmu, act: Act, *, early_return: bool = False) -> Plant:
    """An instance in motion that calls `act(plant, time, what may be done) -> time of early return or None`."""
    instances: list[Plant] = []

    def update(_environment: Any, time: float, *arguments: Any) -> None:
        *may, wanted, at = arguments
        answer = act(instances[0], time, tuple(may))
        if answer is not None:
            wanted[0], at[0] = True, answer

    options: dict[str, Any] = {"requiredIntermediateVariables": [0, 3], "earlyReturnAllowed": early_return}
    instances.append(Plant(fmu, intermediateUpdate=update, **options))
    return instances[0].start(MOVING)


@pytest.mark.parametrize("early_return", [True, False])
def test_intermediate_updates_come_at_the_states_that_a_step_passes(fmu3: Fmu, early_return: bool) -> None:
    """Expected: states of the Lagrangian's motion; inputs may be set there, and steps ended early if allowed."""
    seen: list[tuple[float, FloatArray]] = []

    def act(p: Plant, time: float, may: tuple[bool, ...]) -> None:
        assert may == (True, True, True, early_return and time < 0.5)
        assert p.time == time
        seen.append((time, p.pose))
        assert p.output_rates("position") == pytest.approx(p.get("velocity"), rel=1e-12)
        assert refused(p.set, "platform_mass", 12.0) == refused(p.set, "actuator_force", np.nan) == ERROR

    with updated(fmu3, act, early_return=early_return) as p:
        p.do_step(0.0, 0.5)
    times = np.array([0.0, *(time for time, _ in seen)])
    assert len(seen) > 5
    assert times[-1] == 0.5
    path = trajectory(UNEVEN, np.concatenate(list(STATE)), lambda _t: U, times)[1:, :6]
    assert np.array([pose for _, pose in seen]) == pytest.approx(path, abs=1e-7)


@pytest.mark.parametrize("wanted", ["at once", "later", "too late", "not allowed"])
def test_a_step_ends_early_when_the_importer_asks_and_may(fmu3: Fmu, wanted: str) -> None:
    asked: list[float] = []

    def act(_p: Plant, time: float, may: tuple[bool, ...]) -> float | None:
        asked.append(time)
        if wanted == "not allowed":
            return None if may[3] else time
        return {"at once": time, "later": 0.333, "too late": 2.0}[wanted]

    with updated(fmu3, act, early_return=wanted != "not allowed") as p, plant(fmu3) as q:
        _, _, early, last = p.do_step(0.0, 0.5)
        assert early == (wanted in ("at once", "later"))
        assert p.time == last == {"at once": asked[0], "later": 0.333}.get(wanted, 0.5)
        q.start(MOVING)
        q.do_step(0.0, last)
        assert p.pose == pytest.approx(q.pose, abs=1e-8)


def test_inputs_set_between_hold_from_there_on_and_a_failed_step_undoes_them(fmu3: Fmu) -> None:
    """Expected: the same forces set between two steps."""
    switched = list[float]()

    def act(p: Plant, time: float, _may: tuple[bool, ...]) -> None:
        if time > 0.2 and not switched:
            switched.append(time)
            p.set("actuator_force", FEWER)

    with updated(fmu3, act) as p, plant(fmu3) as q:
        p.do_step(0.0, 0.5)
        q.start(MOVING)
        q.do_step(0.0, switched[0])
        q.set("actuator_force", FEWER)
        q.do_step(switched[0], 0.5 - switched[0])
        assert p.pose == pytest.approx(q.pose, abs=1e-8)
    with updated(fmu3, lambda p, *_: p.set("actuator_force", -3000.0)) as p:
        before = p.serialized()
        p.refuses("fmi3DoStep: at time", DISCARD, p.do_step, 0.0, 1.0)
        assert p.serialized() == before


def test_model_exchange_has_the_states_and_derivatives_of_the_description(any_fmu: Fmu) -> None:
    """Expected: values by name, in the order of the Derivatives, of the states to which they belong."""
    with plant(any_fmu, co_simulation=False) as p:
        p.start({**MOVING, **(HELD if "leg_bristle" in p.variables else {})})
        derivatives = [unknown.variable for unknown in any_fmu.description.derivatives]
        references = {v.name: v.valueReference for v in any_fmu.description.modelVariables}
        n = len(derivatives) if p.is_fmi2 else p.fmu.getNumberOfContinuousStates()
        p.fmu.terminate()
        for found, names in (
            (p.get_states(n), [v.derivative.name for v in derivatives]),
            (p.state_rates(n), [v.name for v in derivatives]),
        ):
            asked = [references[name] for name in names]
            assert list(found) == (p.fmu.getReal(asked) if p.is_fmi2 else p.fmu.getFloat64(asked, nValues=n))
        assert {float(v.derivative.nominal) for v in derivatives} == set(p.nominals(n))


def test_states_that_cannot_be_are_discarded(fmu: Fmu) -> None:
    with plant(fmu, co_simulation=False) as p:
        p.start()
        before = p.get_states()
        assert refused(p.set_states, [*before[:2], np.nan, *before[3:]]) == DISCARD
        assert np.array_equal(p.get_states(), before)
        assert refused(p.set_states, before[:11]) == ERROR
        assert refused(p.fmu.setContinuousStates, POINTER(c_double)(), 12) == ERROR


def test_parameters_change_in_event_mode_and_in_fmi_2_in_continuous_time_too(fmu: Fmu) -> None:
    """Expected: FMI 3.0 asks for an error; FMI 2.0 does not, and CasADi sets parameters there."""
    with plant(fmu, co_simulation=False) as p:
        p.start()
        assert refused(p.fmu.getEventIndicators, (c_double * 1)(), 0) == OK  # there are none
        assert refused(p.fmu.getEventIndicators, (c_double * 1)(), 1) == ERROR
        p.fmu.enterEventMode()
        p.set("platform_mass", 11.0)
        p.leave_event_mode()
        p.set("actuator_force", 1.0)
        assert refused(p.set, "leg_lower_mass", 12.0) == ERROR
        expected = OK if p.is_fmi2 else ERROR
        assert refused(p.set, "platform_mass", 12.0) == expected
        assert p.get("platform_mass") == (12.0 if p.is_fmi2 else 11.0)
        assert refused(p.set, "platform_inertia", np.diag([1.0, 1.0, 3.0])) == expected
        # the inertia as a whole is looked at when a step has been completed
        assert refused(p.fmu.completedIntegratorStep) == (ERROR if p.is_fmi2 else OK)


def test_states_are_set_by_name_in_continuous_time_like_all_at_once(fmu: Fmu) -> None:
    """Expected: the derivatives after setContinuousStates; nowhere else during a run, with the rules for a value."""
    with plant(fmu, co_simulation=False) as p, plant(fmu, co_simulation=False) as q:
        p.start()
        q.start()
        for name, value in STATE._asdict().items():
            p.set(name, value)
        q.set_states(np.concatenate(list(STATE)))
        assert np.array_equal(p.state_rates(), q.state_rates())
        p.refuses("pitch", DISCARD, p.set, "orientation", [0.0, 1.6, 0.0])
        p.fmu.enterEventMode()
        p.refuses("not allowed in event mode", ERROR, p.set, "position", STATE.position)


def test_a_completed_step_answers_both_questions_and_says_why_a_simulation_has_to_end(fmu: Fmu) -> None:
    """Expected: no event whatever was in the memory; by the standards a flag, no error; each pose is judged anew."""
    flag = c_int if fmu.is_fmi2 else c_bool
    with plant(fmu, co_simulation=False) as p:
        p.start()
        p.fmu.setTime(2.5)
        x, completed = p.get_states(), getattr(p.fmu, f"fmi{fmu.version[0]}CompletedIntegratorStep")
        for yaw, terminate in ((-2.5, True), (x[5], False)):  # beyond the singular pose, and at home
            p.set_states([*x[:5], yaw, *x[6:]])
            events, ends = flag(1), flag(1)
            completed(p.fmu.component, flag(1), byref(events), byref(ends))
            assert (bool(events.value), bool(ends.value)) == (False, terminate)
        (message,) = p.messages
        assert "must end: at time 2.5 s: " in message.text
        assert "singular" in message.text
        assert (message.status, message.category) == (OK, "logStatusWarning")
