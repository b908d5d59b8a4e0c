"""The stepping model's contract, rule by rule; numbers are those of its docstring. Rule 7 has a file of its own."""

import pickle
from copy import copy, deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart.model import interface
from gough_stewart.model.dynamics import mass_matrix
from gough_stewart.model.errors import InterfaceError, PlatformError, StepError
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.stepping import Snapshot, SteppingModel
from tests.support.uneven import INPUTS, STATE, UNEVEN

FORCES = INPUTS.actuator_force.tolist()
OTHER_FORCES = [31.0, 58.0, 44.0, 52.0, 37.0, 49.0]


def started(tolerance: float = 1e-8) -> SteppingModel:
    """The uneven platform in motion under all inputs, ready for its first step; regular for 0.9 s."""
    model = SteppingModel(UNEVEN, tolerance)
    model.set_many({**STATE._asdict(), **INPUTS._asdict()})
    return model


def refused(model: SteppingModel, call: Any, error: type[Exception], message: str) -> Exception:
    """The call fails with this message and leaves the model as it was (rule 8)."""
    before = model.save_state()
    with pytest.raises(error, match=message) as caught:
        call()
    assert model.save_state() == before
    return caught.value


def test_rule_1_starts_at_home_at_rest_at_time_zero_and_stands_still() -> None:
    """Expected: nothing moves; six different forces hold an uneven platform in gravity aslant."""
    model = SteppingModel(UNEVEN)
    assert model.time == 0
    assert np.array_equal(model.get("position"), UNEVEN.home_position)
    assert np.array_equal(model.get("orientation"), UNEVEN.home_orientation)
    assert np.array_equal(model.state[6:], np.zeros(6))
    assert len(set(np.ravel(model.get("actuator_force")))) == 6
    assert np.array_equal(model.get("external_force"), np.zeros(3))
    home = model.state
    model.do_step(0.0, 1.0)
    assert np.abs(model.state - home).max() < 1e-12


def test_rule_2_variables_go_by_whole_and_by_element() -> None:
    model = SteppingModel(UNEVEN)
    model.set("actuator_force", [1, 2, 3, 4, 5, 6])
    model.set("actuator_force[3]", 7.0)
    assert np.array_equal(model.get("actuator_force"), [1, 2, 7, 4, 5, 6])
    assert model.get("actuator_force[3]") == 7.0
    model.set("base_points[2,3]", 0.01)
    assert model.get("base_points[2,3]") == 0.01
    model.set("position[3]", 3.1)
    assert model.get("position[3]") == 3.1
    assert isinstance(model.get("kinetic_energy"), float)


@pytest.mark.parametrize(
    ("name", "value", "error", "message"),
    [
        ("actuator_forces", FORCES, InterfaceError, "did you mean 'actuator_force'"),
        (3, FORCES, InterfaceError, "expected the name of a variable"),
        ("actuator_force", FORCES[:5], InterfaceError, r"has shape \(5,\); expected numbers of shape \(6,\)"),
        ("actuator_force", [1, 2, np.nan, 4, 5, 6], InterfaceError, r"actuator_force: is \[1.0, 2.0, nan"),
        ("actuator_force[2]", np.inf, InterfaceError, r"actuator_force\[2\]: is inf"),
        ("actuator_force", [True] * 6, InterfaceError, "expected numbers"),
        ("actuator_force", ["1"] * 6, InterfaceError, "expected numbers"),
        ("actuator_force", np.ones(6) * 1j, InterfaceError, "expected numbers"),
        ("actuator_force", [10**400] * 6, InterfaceError, "expected numbers"),
        ("platform_mass", None, InterfaceError, "is None; expected one number"),
        ("actuator_force[2]", FORCES, InterfaceError, "has shape"),
        ("external_force", "up", InterfaceError, "expected numbers"),
        ("leg_length", [3.0] * 6, InterfaceError, "is computed"),
        ("kinetic_energy", 1.0, InterfaceError, "is computed"),
        ("fixed_step_size", 1e-3, InterfaceError, "parameter of the FMU"),
        ("orientation", [0, 1.6, 0], InterfaceError, "expected a pitch within"),
        ("orientation[2]", -1.6, InterfaceError, "expected a pitch within"),
        ("platform_mass", -1.0, PlatformError, "is -1 kg; expected > 0"),
        ("leg_coulomb_friction", -1.0, PlatformError, "is -1 N; expected >= 0"),
    ],
)
def test_rule_3_refuses_what_cannot_be_set(name: Any, value: Any, error: type[Exception], message: str) -> None:
    model = started()
    refused(model, lambda: model.set(name, value), error, message)


def test_rule_3_states_and_fixed_parameters_only_before_the_first_step() -> None:
    model = started()
    model.set("leg_lower_mass", 2.5)
    model.do_step(0.0, 0.01)
    refused(model, lambda: model.set("position", [0, 0, 3]), InterfaceError, "before the first step")
    refused(model, lambda: model.set("leg_lower_mass", 2.0), InterfaceError, "before the first step")
    model.set("platform_mass", 12.0)
    assert model.platform.platform_mass == 12.0


def test_rule_3_set_many_sets_all_or_none() -> None:
    model = started()
    refused(model, lambda: model.set_many({"external_force": [1, 2, 3], "gravity": [0, 0]}), InterfaceError, "gravity")


def test_rule_3_elements_of_an_inertia_can_be_set_together() -> None:
    """Expected: one by one each would be asymmetric, which no inertia is."""
    model = started()
    refused(model, lambda: model.set("platform_inertia[1,2]", 0.5), PlatformError, "not symmetric")
    model.set_many({"platform_inertia[1,2]": 0.5, "platform_inertia[2,1]": 0.5})
    expected = np.array([[4.6, 0.5, -0.28], [0.5, 5.7, 0.41], [-0.28, 0.41, 8.1]])
    assert np.array_equal(model.platform.platform_inertia, expected)


def test_rule_4_get_gives_every_variable_as_a_copy() -> None:
    model = started()
    before = model.save_state()
    for variable in interface.VARIABLES:
        if variable.name == "fixed_step_size":
            continue
        value = model.get(variable.name)
        assert np.shape(value) == variable.shape
        if variable.shape:
            np.asarray(value)[...] = 99.0
    assert model.save_state() == before
    with pytest.raises(InterfaceError, match="stepping model has none"):
        model.get("fixed_step_size")


def test_rule_4_outputs_follow_the_present_inputs() -> None:
    """Expected: M δa = δF: a change of force shows in the acceleration at once, before any step."""
    model = started()
    change = np.array([20.0, -30.0, 100.0])
    first = model.results()
    model.set("external_force", INPUTS.external_force + change)
    second = model.results()
    moved = np.concatenate([second[name] - first[name] for name in ("acceleration", "angular_acceleration")])
    M = mass_matrix(UNEVEN, STATE.position, STATE.orientation)
    assert M @ moved == pytest.approx(np.concatenate([change, np.zeros(3)]), abs=1e-10)
    assert np.array_equal(model.result_vector()[:3], model.get("position"))


def test_rule_4_every_element_goes_by_its_own_name() -> None:
    """Expected: the element of the whole at the indices of the name, one-based."""
    model = started()
    for variable in interface.VARIABLES:
        if variable.shape:
            whole = np.asarray(model.get(variable.name))
            for index in np.ndindex(whole.shape):
                assert model.get(f"{variable.name}[{','.join(str(k + 1) for k in index)}]") == whole[index]


@given(st.lists(st.floats(1e-4, 0.14), min_size=1, max_size=6))
def test_rule_5_the_motion_does_not_depend_on_how_time_is_cut(steps: list[float]) -> None:
    """Expected: one step over the same time, within the tolerance."""
    cut, whole = started(), started()
    for step in steps:
        cut.do_step(cut.time, step)
    whole.do_step(0.0, cut.time)
    assert np.allclose(cut.state, whole.state, atol=1e-7)


def test_rule_5_inputs_are_held_over_a_step() -> None:
    """Expected: a second model stepped with the same piecewise constant force by other steps."""
    one, other = started(), started()
    for model, n in ((one, 1), (other, 4)):
        for forces in (FORCES, OTHER_FORCES):
            model.set("actuator_force", forces)
            for _ in range(n):
                model.do_step(model.time, 0.2 / n)
    assert np.allclose(one.state, other.state, atol=1e-7)


@pytest.mark.parametrize(
    ("time", "step", "message"),
    [
        (0.0, 0.0, "step = 0 .*expected a communication step > 0"),
        (0.0, -0.1, "expected a communication step > 0"),
        (0.5, 0.1, "expected the model's current time"),
    ],
)
def test_rule_5_refuses_wrong_times(time: float, step: float, message: str) -> None:
    model = started()
    refused(model, lambda: model.do_step(time, step), StepError, message)


@pytest.mark.parametrize("value", [np.nan, np.inf, "0.1", None, True, 1j, [0.1], 10**400])
def test_rule_5_refuses_times_that_are_no_numbers(value: Any) -> None:
    model = started()
    refused(model, lambda: model.do_step(0.0, value), InterfaceError, "step: is|step: has shape")
    refused(model, lambda: model.do_step(value, 0.1), InterfaceError, "time: is|time: has shape")


def test_rule_5_time_is_a_plain_float_whatever_the_step_was() -> None:
    model = started()
    model.do_step(0, np.float32(0.25))  # type: ignore[arg-type]
    assert type(model.time) is float


def test_rule_5_a_stale_time_is_refused_also_late_and_for_tiny_steps() -> None:
    """Expected: at t = 1000 s a mismatch of a whole step of 1e-6 s is no rounding."""
    model = SteppingModel(replace(UNEVEN, gravity=np.zeros(3)))
    model.do_step(0.0, 1000.0)
    model.do_step(1000.0, 1e-6)
    refused(model, lambda: model.do_step(1000.0, 1e-6), StepError, "current time")
    model.do_step(1000.0 + 1e-6, 1e-6)


# Present time, step, and the largest accepted difference: 1e-9 of the time or of 1 s, but no more than a thousandth of
# the step, nor less than a few units of rounding, 2⁻⁴⁵ s at 200 s. The last is to be refused.
CLOCKS = [
    (0.5, 1e-3, 0.97e-9, 1.03e-9),
    (0.5, 1e-7, 0.97e-10, 1.03e-10),
    (200.0, 1e-3, 1.94e-7, 2.06e-7),
    (200.0, 1e-11, 4 * 2.0**-45, 8 * 2.0**-45),
]


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("now", "step", "inside", "outside"), CLOCKS)
def test_rule_5_a_clock_may_round_a_little(now: float, step: float, inside: float, outside: float, side: int) -> None:
    model = SteppingModel(replace(UNEVEN, gravity=np.zeros(3)))
    model.do_step(0.0, now)
    refused(model, lambda: model.do_step(now + side * outside, step), StepError, "current time")
    model.do_step(now + side * inside, step)


@pytest.mark.parametrize("copied", [deepcopy, copy, lambda model: pickle.loads(pickle.dumps(model))])
def test_rule_9_copies_go_their_own_way(copied: Any) -> None:
    """Expected: the same future, and no effect on the original."""
    model = started()
    model.do_step(0.0, 0.1)
    before, other = model.save_state(), copied(model)
    other.do_step(0.1, 0.1)
    other.set("actuator_force", np.zeros(6))
    assert model.save_state() == before
    model.do_step(0.1, 0.1)
    assert np.array_equal(model.state, other.state)


def test_rule_9_only_snapshots_are_restored() -> None:
    model = started()
    refused(model, lambda: model.restore_state(None), InterfaceError, "expected a snapshot from save_state")  # type: ignore[arg-type]


def test_a_platform_is_asked_for_by_name_of_its_loader() -> None:
    with pytest.raises(InterfaceError, match="expected a Platform, such as load_preset"):
        SteppingModel("liu2000")  # type: ignore[arg-type]


def test_rule_5_refuses_a_step_too_small_to_count() -> None:
    model = started()
    model.do_step(0.0, 0.5)
    refused(model, lambda: model.do_step(0.5, 1e-18), StepError, "too small to advance the time")


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10])
def test_rule_6_the_error_is_of_the_order_of_the_tolerance(tolerance: float) -> None:
    """Expected: the same model at tolerance 1e-13."""
    model, exact = started(tolerance=tolerance), started(tolerance=1e-13)
    model.do_step(0.0, 0.5)
    exact.do_step(0.0, 0.5)
    assert np.abs(model.state - exact.state).max() < 10 * tolerance


@pytest.mark.parametrize("tolerance", [0.0, -1e-8, 0.1, np.nan, 1e-14, None, "1e-8", True])
def test_rule_6_refuses_a_tolerance_that_makes_no_sense(tolerance: Any) -> None:
    with pytest.raises(InterfaceError, match="tolerance"):
        SteppingModel(UNEVEN, tolerance)


def test_rule_6_many_short_steps_use_few_internal_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: 13 evaluations for a short communication step: 12 of one step of DOP853, and one to begin with.

    Without the step size carried over, a search for a first step would come on top.
    """
    model = started()
    model.do_step(0.0, 0.1)
    calls = 0
    evaluate = model._kernel.derivatives

    def counted(*arguments: Any) -> Any:
        nonlocal calls
        calls += 1
        return evaluate(*arguments)

    monkeypatch.setattr(model._kernel, "derivatives", counted)
    for k in range(20):
        model.do_step(0.1 + k * 1e-3, 1e-3)
    assert calls == 20 * 13


def test_rule_9_a_restored_model_repeats_its_future_to_the_last_bit() -> None:
    model = started()
    model.do_step(0.0, 0.3)
    snapshot = model.save_state()
    assert isinstance(snapshot, Snapshot)

    def future() -> bytes:
        model.set("platform_mass", 15.0)
        for k in range(5):
            model.set("actuator_force[1]", 40.0 + k)
            model.do_step(model.time, 0.02)
        return model.state.tobytes()

    once = future()
    model.restore_state(snapshot)
    assert model.time == 0.3
    assert model.platform == UNEVEN
    assert future() == once


def test_rule_9_a_snapshot_moves_to_another_model() -> None:
    model, other = started(), SteppingModel(UNEVEN)
    model.do_step(0.0, 0.3)
    other.restore_state(model.save_state())
    for each in (model, other):
        each.do_step(0.3, 0.1)
    assert model.save_state() == other.save_state()


def test_rule_9_reset_is_a_new_model() -> None:
    model = started()
    model.set("platform_mass", 12.0)
    model.do_step(0.0, 0.3)
    model.reset()
    assert model.save_state() == SteppingModel(UNEVEN).save_state()


def test_rule_10_limits_are_not_enforced() -> None:
    limited = replace(UNEVEN, leg_length_max=3.35, actuator_force_max=1.0)
    model = SteppingModel(limited)
    model.set_many({**STATE._asdict(), **INPUTS._asdict()})
    model.do_step(0.0, 0.5)
    assert model.results()["leg_length"].max() > 3.4


def test_linearisation_predicts_a_small_step() -> None:
    """Expected: x(h) from x + h (f + A h f/2), the second-order Taylor step."""
    model, h = started(), 1e-4
    A = model.linearise().A
    x = model.state
    f = model._kernel.derivatives(x, model._u, model._p).copy()
    model.do_step(0.0, h)
    assert np.allclose(model.state, x + h * f + 0.5 * h * h * A @ f, atol=1e-10)


def test_rule_6_tolerances_from_1e_13_to_1e_2_are_taken() -> None:
    """Expected: both ends, and just beyond them an error with the range."""
    for tolerance in (1e-13, 1e-2):
        SteppingModel(UNEVEN, tolerance)
    for beyond in (0.9e-13, 1.1e-2):
        with pytest.raises(
            InterfaceError, match=rf"^tolerance: is {beyond!r}; expected 1e-13 to 0.01, for example 1e-08$"
        ):
            SteppingModel(UNEVEN, beyond)


def test_rule_3_a_pitch_is_refused_where_a_step_would_be() -> None:
    """Expected: 1e-3 rad below 90°, either sign, from both sides; as a whole and by element."""
    far = np.pi / 2 - 1e-3
    model = started()
    for sign in (1, -1):
        for name, inside, outside in (
            ("orientation", [0.3, sign * (far - 1e-9), 0.2], [0.3, sign * (far + 1e-9), 0.2]),
            ("orientation[2]", sign * (far - 1e-9), sign * (far + 1e-9)),
        ):
            model.set(name, inside)
            refused(
                model, lambda n=name, o=outside: model.set(n, o), InterfaceError, r"orientation\[2\]: is .*±1.5698 rad"
            )


def test_rule_3_what_is_set_is_what_is_had_and_nothing_else_changes() -> None:
    """Expected: every input, state and parameter one after the other, whole and its last element."""
    for variable in interface.VARIABLES:
        is_set = variable.causality == "input" or variable.is_state or variable in interface.PLATFORM_PARAMETERS
        if not is_set or variable.name == "platform_inertia":
            continue
        model = started()
        before = {v.name: np.array(model.get(v.name)) for v in interface.VARIABLES if v.name != "fixed_step_size"}
        value = np.array(before[variable.name] * 1.01 + (0.01 if variable.lower_bound is None else 0.0))
        model.set(variable.name, value)
        assert np.array_equal(model.get(variable.name), value), variable.name
        last = variable.scalar_names[-1]
        number = float(value.reshape(-1)[-1]) * 1.01
        model.set(last, number)
        value = value.copy()
        value.reshape(-1)[-1] = number
        for other in (*interface.INPUTS, *interface.STATES, *interface.PLATFORM_PARAMETERS):
            expected = value if other is variable else before[other.name]
            assert np.array_equal(model.get(other.name), expected), (variable.name, other.name)
        model.reset()
        assert model.save_state() == SteppingModel(UNEVEN).save_state()


def test_rule_3_each_refusal_says_why_and_what_to_do() -> None:
    """Expected: whole sentences, of computed, of fixed and of state variables."""
    model = started()
    model.do_step(0.0, 1e-3)
    for name, text in (
        ("leg_length", "leg_length: is computed (output); set inputs, parameters or states instead"),
        ("joint_force[2,3]", "joint_force: is computed (local); set inputs, parameters or states instead"),
        ("velocity[3]", "velocity: is a state, which can only be set before the first step; call reset() first"),
        (
            "base_points[1,1]",
            "base_points: is a fixed parameter, which can only be set before the first step; call reset() first",
        ),
        ("fixed_step_size", "fixed_step_size: is a parameter of the FMU; of the stepping model it is an argument"),
        ("external_force", "external_force: is 1.0; expected numbers of shape (3,) [N], external force at Op, world"),
        ("external_force[3]", "external_force[3]: is 'a'; expected one number [N], external force at Op, world compo"),
    ):
        value: Any = "a" if name == "external_force[3]" else 1.0
        found = refused(model, lambda n=name, v=value: model.set(n, v), InterfaceError, "^")
        assert str(found).startswith(text.replace("is 1.0;", "has shape ();"))
    with pytest.raises(InterfaceError) as caught:
        model.get("fixed_step_size")
    assert str(caught.value).startswith("fixed_step_size: ")
    assert str(caught.value).endswith("; the stepping model has none")


def test_linearisation_has_the_rows_of_the_results_and_the_columns_of_states_and_inputs() -> None:
    """Expected: derivatives of ẋ and of the results by differences, of an uneven platform in motion; copies."""
    model = started()
    blocks = model.linearise()
    A, B, C, D = blocks
    assert (A.shape, B.shape, C.shape, D.shape) == ((12, 12), (12, 12), (50, 12), (50, 12))
    x, u = STATE.to_vector(), INPUTS.to_vector()

    def found(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        other = SteppingModel(UNEVEN)
        other.set_many({**interface.unpack(interface.STATES, x), **interface.unpack(interface.INPUTS, u)})
        return other.result_vector()

    h = 1e-5
    for k in (0, 2, 3, 5, 6, 9, 11):
        e = h * np.eye(12)[k]
        by_state, by_input = (
            (found(x + e, u) - found(x - e, u)) / (2 * h),
            (found(x, u + e) - found(x, u - e)) / (2 * h),
        )
        assert C[:, k] == pytest.approx(by_state, abs=1e-6 * np.abs(C).max())
        assert D[:, k] == pytest.approx(by_input, abs=1e-6 * np.abs(D).max())
        # accelerations are the last rows of ẋ, and rows 24 to 29 of the results
        assert A[6:, k] == pytest.approx(by_state[24:30], abs=1e-6 * np.abs(C).max())
        assert B[6:, k] == pytest.approx(by_input[24:30], abs=1e-6 * np.abs(D).max())
    kept = [block.copy() for block in blocks]
    model.do_step(0.0, 0.1)
    model.linearise()
    assert all(np.array_equal(a, b) for a, b in zip(blocks, kept, strict=True))


def test_rule_4_results_are_those_of_independent_equations() -> None:
    """Expected: Newton and Euler's accelerations and joint forces; NumPy's lengths; the vector in the same order."""
    model = started()
    found, vector = model.results(), model.result_vector()
    R = matrix_from_orientation(STATE.orientation)
    expected = newton_euler.solve(UNEVEN, STATE.position, R, STATE.velocity, STATE.angular_velocity, *INPUTS)
    assert found["acceleration"] == pytest.approx(expected.linear, rel=1e-9)
    assert found["angular_acceleration"] == pytest.approx(expected.angular, rel=1e-9)
    assert found["joint_force"] == pytest.approx(expected.joint_force, rel=1e-8, abs=1e-8)
    lengths = np.linalg.norm(STATE.position + UNEVEN.platform_points @ R.T - UNEVEN.base_points, axis=1)
    assert found["leg_length"] == pytest.approx(lengths, rel=1e-12)
    assert list(found) == [v.name for v in interface.RESULTS]
    assert np.array_equal(interface.pack(interface.RESULTS, found), vector)
    for name in interface.RESULT_COLUMNS:
        assert model.get(name) == vector[interface.RESULT_COLUMNS.index(name)]


def test_rule_9_a_snapshot_holds_all_there_is() -> None:
    """Expected: each number where it belongs, from 7.3 s on; the next internal step goes on where it was."""
    model = started()
    model.do_step(0.0, 0.3)
    model.set_many({"platform_mass": 12.5, "external_torque": [1.0, 2.0, 3.0]})
    snapshot = model.save_state()
    assert snapshot.time == 0.3
    assert snapshot.started
    assert snapshot.x == tuple(model.state.tolist())
    assert snapshot.u == (*FORCES, *INPUTS.external_force.tolist(), 1.0, 2.0, 3.0)
    assert snapshot.platform == replace(UNEVEN, platform_mass=12.5)
    assert snapshot.internal_step is not None
    assert 1e-4 < snapshot.internal_step < 10
    other = SteppingModel(UNEVEN)
    other.restore_state(replace(snapshot, time=7.3))
    other.do_step(7.3, 0.01)
    model.do_step(0.3, 0.01)
    assert other.time == 7.3 + 0.01
    assert other.state == pytest.approx(model.state, abs=1e-12)
    assert other.platform == model.platform
    before = SteppingModel(UNEVEN).save_state()
    assert (before.time, before.internal_step, before.started) == (0.0, None, False)
