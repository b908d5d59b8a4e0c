"""Every capability that the model descriptions declare, tried by FMPy in both versions."""

import subprocess
import sys
from ctypes import POINTER, c_double, c_size_t, c_void_p
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from gough_stewart.fmu_build.component import Role
from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.harness.errors import PlantError
from gough_stewart.model import interface
from gough_stewart.model.kernel import Kernel, Linearisation, parameter_vector
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import Inputs
from tests.fmu_build.test_trajectories import start_of
from tests.support.fmu_plants import DISCARD, ERROR, OK, Fmu, Plant, plant, refused
from tests.support.uneven import STATE, UNEVEN, uneven_case

# --- saved states --------------------------------------------------------------------------------------------------


def test_a_step_taken_again_after_a_rollback_has_the_same_bits(fmu: Fmu) -> None:
    with plant(fmu) as p:
        p.start(start_of(uneven_case()))
        p.step(0.0, 0.1)
        state = p.fmu.getFMUState()
        p.step(0.1, 0.3)
        once = p.serialized()
        p.set("actuator_force", [0.0] * 6)
        p.step(0.4, 0.2)
        p.fmu.setFMUState(state)
        p.step(0.1, 0.3)
        assert p.serialized() == once
        p.fmu.freeFMUState(state)


@given(before=st.lists(st.floats(1e-4, 0.05), min_size=1, max_size=6), after=st.floats(1e-4, 0.1))
def test_a_restored_state_has_the_same_future_from_any_history(fmu2: Fmu, before: list[float], after: float) -> None:
    with plant(fmu2) as p, plant(fmu2) as fresh:
        p.start(start_of(uneven_case()))
        time = 0.0
        for step in before:
            p.step(time, step)
            time = p.get("time").item()
        blob = p.serialized()
        fresh.restore(blob)
        for each in (p, fresh):
            each.step(time, after)
        assert p.serialized() == fresh.serialized()


def test_a_state_restored_in_another_process_has_the_same_future(fmu: Fmu, tmp_path: Path) -> None:
    """Expected: the bytes of a run that was never interrupted."""
    with plant(fmu) as p:
        p.start(start_of(uneven_case()))
        p.step(0.0, 0.2)
        (tmp_path / "state").write_bytes(p.serialized())
        p.step(0.2, 0.3)
        whole = p.serialized()
    script = f"""
from pathlib import Path
from tests.support.fmu_plants import Fmu, plant
with plant(Fmu(Path({str(fmu.path)!r}))) as p:
    p.restore(Path("state").read_bytes())
    p.step(0.2, 0.3)
    Path("end").write_bytes(p.serialized())
"""
    root = Path(__file__).parents[2]
    subprocess.run([sys.executable, "-c", script], cwd=tmp_path, env={"PYTHONPATH": str(root)}, check=True)
    assert (tmp_path / "end").read_bytes() == whole


def test_a_state_of_fmi_2_continues_in_fmi_3(fmu2: Fmu, fmu3: Fmu) -> None:
    with plant(fmu2) as p, plant(fmu3) as q:
        p.start(start_of(uneven_case()))
        p.step(0.0, 0.2)
        q.restore(p.serialized())
        p.step(0.2, 0.2)
        q.step(0.2, 0.2)
        assert p.serialized() == q.serialized()


def _damaged(blob: bytes) -> list[tuple[bytes, str]]:
    """Blobs with what their message has to say; bytes 8 to 11 are the format, 24 to 31 the variables."""
    return [
        (b"", "not a state"),
        (blob[:20], "not a state"),
        (b"x" * len(blob), "not a state"),
        (blob[:-1], "bytes; expected"),
        (blob + b"\0", "bytes; expected"),
        (blob[:8] + b"\2" + blob[9:], "version"),
        (blob[:24] + bytes([blob[24] ^ 1]) + blob[25:], "version"),
        (blob[:100] + bytes([blob[100] ^ 1]) + blob[101:], "damaged"),
        (blob[:-1] + bytes([blob[-1] ^ 1]), "damaged"),
    ]


def test_foreign_bytes_are_refused_and_change_nothing(fmu: Fmu) -> None:
    with plant(fmu) as p:
        p.start(start_of(uneven_case()))
        p.step(0.0, 0.2)
        blob = p.serialized()
        for damaged, expected in _damaged(blob):
            assert refused(p.fmu.deserializeFMUState, damaged) == ERROR
            assert expected in p.messages[-1].text
        assert p.serialized() == blob


def test_a_state_of_model_exchange_does_not_go_into_co_simulation(fmu: Fmu) -> None:
    with plant(fmu) as p, plant(fmu, co_simulation=False) as q:
        q.start()
        assert refused(p.restore, q.serialized()) == ERROR
        assert "Model Exchange" in p.messages[-1].text


def test_a_state_is_written_over_when_given_again(fmu: Fmu) -> None:
    from ctypes import byref

    with plant(fmu) as p:
        p.start()
        state = p.fmu.getFMUState()
        address = state.value
        save = p.fmu.fmi2GetFMUstate if p.is_fmi2 else p.fmu.fmi3GetFMUState
        save(p.fmu.component, byref(state))
        assert state.value == address
        p.fmu.freeFMUState(state)
        assert state.value is None
        p.fmu.freeFMUState(state)


def test_deserialising_makes_a_state_of_its_own(fmu: Fmu) -> None:
    """Expected: the standards call the pointer an output, so that what lies there before is not looked at."""
    with plant(fmu) as p:
        p.start()
        blob = p.serialized()
        one = p.fmu.deserializeFMUState(blob)
        kept, one.value = one.value, 1
        other = p.fmu.deserializeFMUState(blob, one)
        assert other.value not in (1, kept)
        for address in (kept, other.value):
            p.fmu.freeFMUState(type(one)(address))


# --- sensitivities -------------------------------------------------------------------------------------------------


def jacobians(p: Plant, platform: Platform) -> Linearisation:
    """The kernel's, at the present state and inputs of an instance."""
    x = np.concatenate([p.get(v.name) for v in interface.STATES])
    u = np.concatenate([p.get(v.name) for v in interface.INPUTS])
    return Linearisation(*(b.copy() for b in Kernel().jacobians(x, u, parameter_vector(platform))))


def by_name(p: Plant, platform: Platform) -> dict[tuple[str, str], NDArray[np.float64]]:
    """Blocks of the Jacobians by (unknown, known)."""
    A, B, C, D = jacobians(p, platform)
    blocks = {}
    for rows, across_x, across_u, variables in (
        ("der({})", A, B, interface.STATES),
        ("{}", C, D, interface.RESULTS),
    ):
        for name, transposed in interface.unpack(variables, np.hstack([across_x, across_u]).T).items():
            block = np.moveaxis(transposed, 0, -1).reshape(-1, 24)
            at = 0
            for known in (*interface.STATES, *interface.INPUTS):
                blocks[rows.format(name), known.name] = block[:, at : at + known.size]
                at += known.size
    return blocks


@pytest.mark.parametrize("co_simulation", [True, False])
def test_directional_derivatives_are_the_kernels_jacobians(fmu: Fmu, co_simulation: bool) -> None:
    """Expected: another differentiation, of CasADi's whole Jacobian."""
    rng = np.random.default_rng(5)
    with plant(fmu, co_simulation) as p:
        p.start(start_of(uneven_case()))
        for (unknown, known), block in by_name(p, UNEVEN).items():
            seed = rng.normal(size=block.shape[1])
            expected = block @ seed
            assert p.directional(unknown, known, seed) == pytest.approx(
                expected, rel=1e-10, abs=1e-10 * (1 + np.abs(block).max())
            )


def test_directional_derivatives_by_parameters_are_difference_quotients(fmu: Fmu) -> None:
    """Expected: central differences of the unit's own results, in initialisation mode."""
    rng = np.random.default_rng(6)
    for row in PLANT.of_role(Role.FIXED_PARAMETER, Role.TUNABLE_PARAMETER):
        name = row.variable.name
        if name == "fixed_step_size":
            continue
        with plant(fmu) as p:
            for state, value in start_of(uneven_case()).items():
                p.set(state, value)
            # where friction is smooth
            p.set("leg_friction_velocity", 0.1)
            p.set("leg_coulomb_friction", 1.0)
            if p.is_fmi2:
                p.fmu.setupExperiment()
            p.fmu.enterInitializationMode()
            value, seed = p.get(name), rng.normal(size=row.variable.size)
            if name == "platform_inertia":
                seed = (seed.reshape(3, 3) + seed.reshape(3, 3).T).ravel()
            sensitivity = p.directional("acceleration", name, seed)
            h, ends = 1e-5, []
            for sign in (1, -1):
                changed = value + sign * h * seed.reshape(value.shape)
                p.set(name, np.maximum(changed, 0) if row.variable.lower_bound else changed)
                ends.append(p.get("acceleration"))
            if row.variable.lower_bound and not np.ravel(value)[0] > 0:
                continue  # at its bound there is no central difference
            assert sensitivity == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-5, abs=1e-5)


def test_adjoint_and_directional_derivatives_are_transposes(fmu3: Fmu) -> None:
    """Expected: w·(J v) = (Jᵀ w)·v for every pair of unknown and known."""
    rng = np.random.default_rng(7)
    with plant(fmu3) as p:
        p.start(start_of(uneven_case()))
        for unknown in ("acceleration", "der(orientation)", "leg_length", "joint_force", "potential_energy"):
            for known in ("actuator_force", "orientation", "velocity", "platform_mass", "platform_points"):
                m, n = (PLANT.by_name[name].variable.size for name in (unknown, known))
                v, w = rng.normal(size=n), rng.normal(size=m)
                forward = p.directional(unknown, known, v)
                reverse = p.fmu.getAdjointDerivative(
                    p.references(unknown), p.references(known), w.tolist(), nSensitivity=n
                )
                assert w @ forward == pytest.approx(np.array(reverse) @ v, rel=1e-10, abs=1e-10)


@pytest.mark.parametrize(
    ("unknown", "known"), [("actuator_force", "position"), ("position", "leg_length"), ("position", "fixed_step_size")]
)
def test_what_is_no_unknown_or_known_is_an_error(fmu: Fmu, unknown: str, known: str) -> None:
    with plant(fmu) as p:
        p.start()
        assert refused(p.directional, unknown, known, [1.0] * PLANT.by_name[known].variable.size) == ERROR
        assert "expected" in p.messages[-1].text


# --- rates of inputs and outputs -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [v.name for v in interface.OUTPUTS])
def test_output_derivatives_are_difference_quotients_over_time(fmu: Fmu, name: str) -> None:
    """Expected: central differences along the unit's own trajectory."""
    h = 1e-4
    with plant(fmu) as p:
        p.start(start_of(uneven_case()), tolerance=1e-12)
        p.step(0.0, 0.3 - h)
        early = p.get(name)
        p.step(0.3 - h, h)
        rate = p.output_rates(name)
        p.step(0.3, h)
        assert rate == pytest.approx((p.get(name) - early) / (2 * h), rel=1e-5, abs=1e-5)


def test_inputs_are_interpolated_by_their_rates(fmu2: Fmu) -> None:
    """Expected: the kernel with forces linear in time under DOP853."""
    case = uneven_case()
    kernel, q, u = Kernel(), parameter_vector(case.platform), case.inputs.to_vector()
    rates = np.array([5.0, -3.0, 8.0, 2.0, -6.0, 4.0])
    du = Inputs.from_actuators(rates).to_vector()
    end = solve_ivp(
        lambda t, x: kernel.derivatives(x, u + du * t, q).copy(),
        (0.0, 0.5),
        case.start.to_vector(),
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
    ).y[:6, -1]
    with plant(fmu2) as p:
        p.start(start_of(case))
        for k in range(5):
            p.set("actuator_force", u[:6] + rates * 0.1 * k)
            p.fmu.setRealInputDerivatives(p.references("actuator_force"), [1] * 6, rates.tolist())
            p.step(0.1 * k, 0.1)
            # at the end of the step the inputs are where their rates have brought them
            assert p.get("actuator_force") == pytest.approx(u[:6] + rates * 0.1 * (k + 1), rel=1e-12)
        assert p.pose == pytest.approx(end, abs=1e-8)
        # without new values they go on
        p.step(0.5, 0.1)
        assert p.get("actuator_force") == pytest.approx(u[:6] + rates * 0.6, rel=1e-12)


def test_rates_of_other_orders_or_other_variables_are_errors(fmu2: Fmu) -> None:
    with plant(fmu2) as p:
        p.start()
        force = p.references("actuator_force")[:1]
        assert refused(p.fmu.setRealInputDerivatives, force, [2], [1.0]) == ERROR
        assert "order 2" in p.messages[-1].text
        assert refused(p.fmu.setRealInputDerivatives, p.references("position")[:1], [1], [1.0]) == ERROR
        assert refused(p.fmu.setRealInputDerivatives, force, [1], [np.nan]) == ERROR
        assert refused(p.fmu.getRealOutputDerivatives, force, [1]) == ERROR
        assert refused(p.fmu.getRealOutputDerivatives, p.references("position")[:1], [0]) == ERROR
        assert refused(p.fmu.getRealOutputDerivatives, p.references("position"), [1, 1, 2]) == ERROR
        assert "order 2" in p.messages[-1].text


FEWER = [20.0, 28.0, 17.0, 33.0, 25.0, 12.0]

# --- FMI 3.0: intermediate update ----------------------------------------------------------------------------------


def intermediate(fmu: Fmu, act: Any, **options: Any) -> Plant:
    """An instance that calls `act(plant, time, may return early) -> time of early return or None`."""
    made: list[Plant] = []

    def update(
        _environment: Any, time: float, _set: bool, _get: bool, _finished: bool, early: bool, wanted: Any, at: Any
    ) -> None:
        answer = act(made[0], time, early)
        if answer is not None:
            wanted[0], at[0] = True, answer

    made.append(Plant(fmu, intermediateUpdate=update, requiredIntermediateVariables=[0, 3], **options))
    return made[0]


def test_intermediate_updates_come_at_the_states_that_a_step_passes(fmu3: Fmu) -> None:
    """Expected: each state between is one on the trajectory, as DOP853 has it."""
    case, seen = uneven_case(), []
    p = intermediate(fmu3, lambda p, t, _early: seen.append((t, p.get("time").item(), p.pose)), earlyReturnAllowed=True)
    p.start(start_of(case))
    p.step(0.0, 0.8)
    p.free()
    kernel, q, u = Kernel(), parameter_vector(case.platform), case.inputs.to_vector()
    path = solve_ivp(
        lambda _t, x: kernel.derivatives(x, u, q).copy(),
        (0.0, 0.8),
        case.start.to_vector(),
        method="DOP853",
        t_eval=[t for t, _, _ in seen],
        rtol=1e-12,
        atol=1e-12,
        max_step=0.01,
    )
    assert len(seen) > 5
    assert seen[-1][0] == 0.8
    for (time, shown, pose), expected in zip(seen, path.y[:6].T, strict=True):
        assert shown == time
        assert pose == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("allowed", [True, False])
def test_an_intermediate_update_says_what_may_be_done(fmu3: Fmu, allowed: bool) -> None:
    """Expected: inputs set, results read, an internal step finished; before the end an early return, if allowed."""
    seen: list[tuple[float, bool, bool, bool, bool]] = []
    p = Plant(
        fmu3,
        intermediateUpdate=lambda _environment, *told: seen.append(told[:5]),
        requiredIntermediateVariables=[0, 3],
        earlyReturnAllowed=allowed,
    )
    p.start(start_of(uneven_case()))
    p.step(0.0, 0.5)
    p.free()
    assert len(seen) > 5
    for time, *may in seen:
        assert may == [True, True, True, allowed and time < 0.5]


@pytest.mark.parametrize("wanted", ["at once", "later", "too late"])
def test_a_step_ends_early_when_the_importer_asks(fmu3: Fmu, wanted: str) -> None:
    asked: list[float] = []

    def act(_p: Plant, time: float, _early: bool) -> float | None:
        asked.append(time)
        return {"at once": time, "later": 0.333, "too late": 2.0}[wanted]

    p = intermediate(fmu3, act, earlyReturnAllowed=True)
    p.start(start_of(uneven_case()))
    _, _, early, last = p.step(0.0, 0.5)
    assert early == (wanted != "too late")
    assert last == {"at once": asked[0], "later": 0.333, "too late": 0.5}[wanted]
    assert p.get("time") == last
    end = p.pose
    p.free()
    with plant(fmu3) as q:
        q.start(start_of(uneven_case()))
        q.step(0.0, last)
        assert end == pytest.approx(q.pose, abs=1e-8)


def test_a_step_does_not_end_early_when_that_was_not_allowed(fmu3: Fmu) -> None:
    p = intermediate(fmu3, lambda _p, time, early: None if early else time, earlyReturnAllowed=False)
    p.start(start_of(uneven_case()))
    _, _, early, last = p.step(0.0, 0.5)
    p.free()
    assert not early
    assert last == 0.5


def test_inputs_set_between_hold_from_there_on(fmu3: Fmu) -> None:
    """Expected: the same forces set between two steps."""
    case, switched = uneven_case(), list[float]()

    def act(p: Plant, time: float, _early: bool) -> None:
        if time > 0.2 and not switched:
            switched.append(time)
            p.set("actuator_force", FEWER)

    p = intermediate(fmu3, act)
    p.start(start_of(case))
    p.step(0.0, 0.5)
    with plant(fmu3) as q:
        q.start(start_of(case))
        q.step(0.0, switched[0])
        q.set("actuator_force", FEWER)
        q.step(switched[0], 0.5 - switched[0])
        assert p.pose == pytest.approx(q.pose, abs=1e-8)
    p.free()


def test_reading_between_changes_nothing(fmu3: Fmu) -> None:
    """Expected: the bits of a run in which inputs are set alike and nothing is read."""

    def driven(read: bool) -> bytes:
        def act(p: Plant, time: float, _early: bool) -> None:
            p.set("actuator_force", 50 + 20 * np.sin(300 * time + np.arange(6)))
            if read:
                p.everything()

        p = intermediate(fmu3, act)
        p.start()
        p.step(0.0, 0.05)
        end = p.serialized()
        p.free()
        return end

    assert driven(read=True) == driven(read=False)


def test_only_inputs_may_be_set_and_nothing_else_called_between(fmu3: Fmu) -> None:
    statuses: list[int] = []

    def act(p: Plant, _time: float, _early: bool) -> None:
        calls = (p.fmu.reset, p.fmu.terminate, p.fmu.getFMUState, lambda: p.step(0.0, 0.1))
        statuses.extend(refused(call) for call in calls)
        statuses.append(refused(p.set, "platform_mass", 11.0))

    p = intermediate(fmu3, act)
    p.start()
    p.step(0.0, 0.1)
    p.free()
    assert set(statuses) == {ERROR}


def test_a_failed_step_undoes_what_was_set_between(fmu3: Fmu) -> None:
    p = intermediate(fmu3, lambda p, _t, _early: p.set("actuator_force", [-3000.0] * 6))
    p.start(start_of(uneven_case()))
    before = p.serialized()
    assert refused(p.step, 0.0, 1.0) == DISCARD
    assert p.serialized() == before
    p.free()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"eventModeUsed": True}, "event mode is not offered"),
        ({"requiredIntermediateVariables": [4711]}, "value reference 4711 is not available in intermediate updates"),
    ],
)
def test_what_is_not_declared_gives_no_instance(fmu3: Fmu, options: dict[str, Any], message: str) -> None:
    with pytest.raises(PlantError, match=f"cannot be instantiated: .*{message}"):
        Plant(fmu3, **options)


# --- model exchange ------------------------------------------------------------------------------------------------


def _vector() -> Any:
    return (c_double * 12)()


def test_model_exchange_has_twelve_states_with_nominals_and_derivatives(fmu: Fmu) -> None:
    """Expected: the order of the Derivatives in the description."""
    with plant(fmu, co_simulation=False) as p:
        p.start(start_of(uneven_case()))
        x, xdot, nominals = _vector(), _vector(), _vector()
        p.fmu.getContinuousStates(x, 12)
        (p.fmu.getDerivatives if p.is_fmi2 else p.fmu.getContinuousStateDerivatives)(xdot, 12)
        p.fmu.getNominalsOfContinuousStates(nominals, 12)
        derivatives = [unknown.variable for unknown in fmu.description.derivatives]
        names = [v.derivative.name for v in derivatives]
        if p.is_fmi2:
            assert names == [n for v in interface.STATES for n in v.scalar_names]
        else:
            assert names == [v.name for v in interface.STATES]
        assert list(x) == [float(v) for s in interface.STATES for v in p.get(s.name)]
        assert list(xdot) == [float(v) for s in interface.STATES for v in p.get(f"der({s.name})")]
        declared = {float(v.derivative.nominal) for v in derivatives}
        assert set(nominals) == declared == {1e-3}


def test_states_that_cannot_be_are_discarded(fmu: Fmu) -> None:
    with plant(fmu, co_simulation=False) as p:
        p.start()
        x = _vector()
        p.fmu.getContinuousStates(x, 12)
        kept = list(x)
        x[2] = np.nan
        assert refused(p.fmu.setContinuousStates, x, 12) == DISCARD
        p.fmu.getContinuousStates(x, 12)
        assert list(x) == kept
        assert refused(p.fmu.setContinuousStates, x, 11) == ERROR
        assert refused(p.fmu.setContinuousStates, POINTER(c_double)(), 12) == ERROR


def test_there_are_no_events_and_no_event_indicators(fmu: Fmu) -> None:
    with plant(fmu, co_simulation=False) as p:
        p.start()
        assert refused(p.fmu.getEventIndicators, (c_double * 1)(), 0) == OK
        assert refused(p.fmu.getEventIndicators, (c_double * 1)(), 1) == ERROR
        p.fmu.enterEventMode()
        news = p.fmu.newDiscreteStates() if p.is_fmi2 else p.fmu.updateDiscreteStates()
        assert not any(news[:5])
        p.set("platform_mass", 11.0)
        p.fmu.enterContinuousTimeMode()
        p.set("actuator_force", [1.0] * 6)
        assert refused(p.set, "leg_lower_mass", 12.0) == ERROR


def test_tunable_parameters_change_in_event_mode_and_in_fmi_2_in_continuous_time_too(fmu: Fmu) -> None:
    """Expected: FMI 3.0 asks for an error; FMI 2.0 does not, and CasADi sets parameters there."""
    with plant(fmu, co_simulation=False) as p:
        p.start()
        statuses = [refused(p.set, "platform_mass", 12.0), refused(p.set, "platform_inertia", np.diag([1.0, 1.0, 3.0]))]
        assert statuses == ([OK, OK] if p.is_fmi2 else [ERROR, ERROR])
        assert p.get("platform_mass") == (12.0 if p.is_fmi2 else UNEVEN.platform_mass)
        # the inertia as a whole is looked at when a step has been completed
        assert refused(p.fmu.completedIntegratorStep) == (ERROR if p.is_fmi2 else OK)


def test_states_are_set_by_name_in_continuous_time_like_all_at_once(fmu: Fmu) -> None:
    """Expected: the derivatives after setContinuousStates; nowhere else during a run, with the rules for a value."""
    state = {v.name: getattr(STATE, v.name) for v in interface.STATES}
    with plant(fmu, co_simulation=False) as p, plant(fmu, co_simulation=False) as q:
        for each in (p, q):
            each.start()
        for name, value in state.items():
            p.set(name, value)
        q.fmu.setContinuousStates((c_double * 12)(*np.concatenate(list(state.values()))), 12)
        for name in state:
            assert np.array_equal(p.get(f"der({name})"), q.get(f"der({name})"))
        assert refused(p.set, "orientation", [0.0, 1.6, 0.0]) == DISCARD
        assert "pitch" in p.messages[-1].text
        p.fmu.enterEventMode()
        assert refused(p.set, "position", STATE.position) == ERROR


def test_a_singular_pose_asks_for_the_end_of_model_exchange_and_says_why(fmu: Fmu) -> None:
    """Expected: by the standards a flag, no error; the next pose is judged anew."""
    with plant(fmu, co_simulation=False) as p:
        p.start()
        x = _vector()
        p.fmu.getContinuousStates(x, 12)
        home = x[5]
        x[5] = -2.5  # yaw beyond the singular pose
        p.fmu.setContinuousStates(x, 12)
        assert tuple(p.fmu.completedIntegratorStep()) == (0, 1)
        (message,) = p.messages
        assert "must end" in message.text
        assert "singular" in message.text
        assert (message.status, message.category) == (OK, "logStatusWarning")
        x[5] = home
        p.fmu.setContinuousStates(x, 12)
        assert tuple(p.fmu.completedIntegratorStep()) == (0, 0)
        assert len(p.messages) == 1


@pytest.mark.parametrize("co_simulation", [True, False])
def test_calls_of_the_other_kind_are_errors_in_every_mode(fmu: Fmu, co_simulation: bool) -> None:
    prefix, two = f"fmi{fmu.version[0]}", fmu.version == "2.0"
    nothing: list[Any] = [None, c_size_t(0), None, None, *([] if two else [c_size_t(0)])]
    others: dict[str, list[Any]] = (
        {"SetTime": [c_double(1.0)], "GetNominalsOfContinuousStates": [(c_double * 12)(), c_size_t(12)]}
        if co_simulation
        else {"GetRealOutputDerivatives" if two else "GetOutputDerivatives": nothing}
    )
    with plant(fmu, co_simulation) as p:
        for prepare in (lambda: None, p.start, p.fmu.terminate):
            prepare()
            for name, arguments in others.items():
                assert getattr(p.fmu.dll, prefix + name)(c_void_p(p.fmu.component), *arguments) == ERROR
                assert "not allowed in" in p.messages[-1].text
