"""Controllers as python-control systems: their formulas, their sampling, what is refused."""

from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gough_stewart as gs
from gough_stewart.harness.control.laws import LinearController, controller_of
from gough_stewart.harness.control.pid import Gains, pid, sampled
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.motion.limits.reach import legs_of
from gough_stewart.harness.motion.references import Circle
from gough_stewart.harness.plants.signals import SIZE
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import load_preset
from gough_stewart.model.vectors import FloatArray
from tests.support.laws import law_of

positive = st.floats(1e-3, 1e5)
PD = Gains(100.0, 20.0)
PID = Gains(100.0, 20.0, 50.0)


def response(system: Any, s: complex) -> Any:
    """Transfer matrix at s (or z)."""
    return np.asarray(system(s)).reshape(system.noutputs, system.ninputs)


@given(kp=positive, kd=positive, ki=positive, filter_time=st.floats(1e-4, 1.0), omega=st.floats(0.1, 1e3))
def test_pid_is_its_formula(kp: float, kd: float, ki: float, filter_time: float, omega: float) -> None:
    """Expected: kp + kd s/(Tf s + 1) + ki/s from r, its negative from y, 1/(Tt s) from the excess."""
    s = 1j * omega
    H = response(pid(Gains(kp, kd, ki, filter_time, 2.0)), s)
    expected = kp + kd * s / (filter_time * s + 1) + ki / s
    assert H[:, :6] == pytest.approx(expected * np.eye(6), rel=1e-9)
    assert H[:, 6:12] == pytest.approx(-expected * np.eye(6), rel=1e-9)
    assert H[:, 12:] == pytest.approx(np.eye(6) / (2.0 * s), rel=1e-9)


def test_the_derivative_of_the_measurement_leaves_the_reference_alone() -> None:
    """Expected: kp from the reference, −(kp + kd s/(Tf s + 1)) from the measurement."""
    s = 3j
    H = response(pid(Gains(100.0, 20.0, derivative_filter=0.01), "measurement"), s)
    assert H[:, :6] == pytest.approx(100.0 * np.eye(6))
    assert H[:, 6:] == pytest.approx(-(100.0 + 20 * s / (0.01 * s + 1)) * np.eye(6))


def test_channels_may_differ() -> None:
    """Expected: each channel has its own gain, without crosstalk."""
    kp = np.arange(1.0, 7.0)
    H = response(pid(Gains(kp, 0.0)), 1j)
    assert pytest.approx(np.hstack([np.diag(kp), -np.diag(kp)])) == H
    mixed = response(pid(Gains(kp, 0.0, [0, 0, 3.0, 0, 0, 0])), 1j)
    assert mixed[:, :6] == pytest.approx(np.diag(kp + np.array([0, 0, 3.0, 0, 0, 0]) / 1j))


@pytest.mark.parametrize("derivative_on", ["error", "measurement"])
def test_channels_have_the_actions_for_which_they_have_a_gain(derivative_on: Any) -> None:
    """Expected: channel by channel by the formula, the first without a derivative; a state for each action, no more."""
    kp, kd, ki = np.array([[7.0, 5, 6, 4, 3, 8], [0.0, 2, 0, 3, 1, 0], [0.0, 0, 5, 0, 2, 1]])
    s, Tf, Tt = 1.3j, 0.07, 0.4
    system = pid(Gains(kp, kd, ki, Tf, Tt), derivative_on)
    H, derivative = response(system, s), kd * s / (Tf * s + 1)
    wanted = kp + ki / s + (derivative if derivative_on == "error" else 0.0)
    assert H[:, :6] == pytest.approx(np.diag(wanted), abs=1e-12)
    assert H[:, 6:12] == pytest.approx(-np.diag(kp + ki / s + derivative), abs=1e-12)
    assert H[:, 12:] == pytest.approx(np.diag((ki > 0) / (Tt * s)), abs=1e-12)
    assert system.nstates == 6


def test_names_fit_the_plants() -> None:
    """Expected: the interface's names, so that python-control's interconnect joins them by name."""
    system = pid(PID)
    assert system.output_labels == [f"actuator_force[{k}]" for k in range(1, 7)]
    for form, kinds in ((PID, 3), (PD, 2)):
        names = ("reference_leg_length", "leg_length", "limit_excess")[:kinds]
        assert pid(form).input_labels == [f"{name}[{k}]" for name in names for k in range(1, 7)]
    discrete = sampled(system, 1e-2)
    assert (discrete.input_labels, discrete.output_labels) == (system.input_labels, system.output_labels)
    assert discrete.name == system.name == "controller"


def test_defaults_follow_from_the_gains() -> None:
    """Expected: Tf = Td/20 with Td = kd/kp = 0.2 s; Tt = √(Ti Td) with Ti = kp/ki = 2 s."""
    assert PID.filter_time == pytest.approx(0.01)
    assert PID.tracking_time == pytest.approx(np.full(6, np.sqrt(0.4)))
    assert Gains(1.0, 0.0, 2.0).tracking_time == pytest.approx(np.full(6, 0.5))
    # each channel its own: √(kd/ki), kp/ki without a derivative
    kp, kd, ki = (
        np.array([3.0, 5, 4, 6, 7, 2]),
        np.array([0.3, 0, 0.2, 0.7, 0.5, 0.1]),
        np.array([0.2, 0.4, 3, 2, 0.9, 5]),
    )
    expected = np.where(kd > 0, np.sqrt(kd / ki), kp / ki)
    assert Gains(kp, kd, ki).tracking_time == pytest.approx(expected)


@given(omega=st.floats(0.01, 100.0))
def test_sampling_is_tustins_rule(omega: float) -> None:
    """Expected: H(z) = G(s) at s = (2/T)(z − 1)/(z + 1)."""
    T = 0.01
    continuous = pid(PID)
    z = np.exp(1j * omega * T)
    s = 2 / T * (z - 1) / (z + 1)
    assert response(sampled(continuous, T), z) == pytest.approx(response(continuous, s), rel=1e-8)


def test_backward_differences_take_any_filter() -> None:
    """Expected: H(z) = G(s) at s = (1 − z⁻¹)/T; Tustin's rule would ring."""
    fast = pid(Gains(100.0, 20.0, derivative_filter=1e-4))
    z = np.exp(0.3j)
    discrete = sampled(fast, 0.01, "backward_diff")
    assert response(discrete, z) == pytest.approx(response(fast, (1 - 1 / z) / 0.01), rel=1e-8)
    with pytest.raises(ControllerError, match=r"time constant of 0.0001 s.*derivative_filter of at least 0.005 s"):
        sampled(fast, 0.01)


@pytest.mark.parametrize(
    ("build", "match"),
    [
        (lambda: Gains(-1.0, 0.0), "proportional gain is -1.0; expected finite numbers > 0"),
        (lambda: Gains([1.0, 2.0, 0.0, 3.0, 4.0, 5.0], 0.0), "proportional gain is .*; expected finite numbers > 0"),
        (lambda: Gains(1.0, float("nan")), "derivative gain is nan"),
        (lambda: Gains(1.0, [1.0, 2.0, float("nan"), 3.0, 4.0, 5.0]), "derivative gain is .*; expected finite numbers"),
        (lambda: Gains([1.0, 2.0], 0.0), r"proportional gain has shape \(2,\)"),
        (lambda: Gains("stiff", 0.0), "proportional gain is 'stiff'"),
        (lambda: Gains(1.0, 0.0, -2.0), "^integral gain is -2.0; expected finite numbers >= 0$"),
        (lambda: Gains(1.0, -3.0), "^derivative gain is -3.0; expected finite numbers >= 0$"),
        (lambda: Gains(0.0, 1.0), "^proportional gain is 0.0; expected finite numbers > 0$"),
        # the first of several, in this order
        (lambda: Gains(-1.0, -1.0, -1.0, -1.0, -1.0), "^proportional gain is"),
        (lambda: Gains(1.0, -1.0, -1.0, -1.0, -1.0), "^derivative gain is"),
        (lambda: Gains(1.0, 1.0, 1.0, -1.0, -1.0), "^derivative_filter is -1.0; expected a time > 0 s$"),
        (lambda: Gains(1.0, 1.0, 1.0, float("inf")), "^derivative_filter is inf; expected a time > 0 s$"),
        (lambda: Gains(1.0, 1.0, 1.0, 1.0, float("nan")), "^anti_windup_time is nan; expected a time > 0 s$"),
        (lambda: sampled(pid(PD), float("inf")), "^sample_time is inf; expected a time > 0 s$"),
        (lambda: Gains(1.0, 1.0, derivative_filter=0.0), "derivative_filter is 0.0; expected a time > 0 s"),
        (lambda: Gains(1.0, 1.0, 1.0, anti_windup_time=-1.0), "anti_windup_time is -1.0"),
        (lambda: pid(PD, "nothing"), "derivative_on is 'nothing'"),  # type: ignore[arg-type]
        (lambda: sampled(pid(PD), 0.0), "sample_time is 0.0"),
        (lambda: sampled(pid(PD), 0.01, "euler"), "'euler'; expected one of tustin, backward_diff, zoh$"),  # type: ignore[arg-type]
    ],
)
def test_what_cannot_be_is_refused(build: Any, match: str) -> None:
    with pytest.raises(ControllerError, match=match):
        build()


T = 0.01


def static(rows: int, columns: int) -> Any:
    return control.ss([], [], [], np.ones((rows, columns)), T)


@pytest.mark.parametrize("columns", [6, 12, 18])
def test_systems_of_three_sizes_drop_in(columns: int) -> None:
    """Expected: errors; references and measurements; and the excess. With ones for gains, their sums."""
    law = law_of(controller_of(static(6, columns)), T, np.zeros((0, 6, 6)), np.zeros(SIZE), np.zeros(SIZE))
    wanted, measured, excess = np.zeros(SIZE), np.zeros(SIZE), np.full(6, 100.0)
    wanted[12:18], measured[12:18] = 3.0, 1.0
    expected = {6: 12.0, 12: 24.0, 18: 624.0}[columns]
    assert law.force(0, 0.0, wanted, measured, excess) == pytest.approx(np.full(6, expected))


def test_a_matrix_of_transfer_functions_drops_in() -> None:
    """Expected: the same response as its elements, with zeros beside the diagonal and one element that is not."""
    one = control.sample_system(control.tf([3.0, 1.0], [0.1, 1]), T, "tustin")
    num = [
        [one.num_array[0, 0] if i == j else [2.0] if (i, j) == (0, 5) else [0.0] for j in range(6)] for i in range(6)
    ]
    den = [[one.den_array[0, 0] if i == j else [1.0] for j in range(6)] for i in range(6)]
    made = controller_of(control.tf(num, den, T))
    assert isinstance(made, LinearController)
    z = np.exp(0.4j)
    expected = np.asarray(one(z)) * np.eye(6)
    expected[0, 5] = 2.0
    assert response(made.system, z) == pytest.approx(expected)


def test_a_state_feedback_takes_twelve_errors() -> None:
    """Expected: signals in the order in which they are named."""
    names = ("position", "orientation", "velocity", "angular_velocity")
    gain = np.arange(72.0).reshape(6, 12)
    controller = LinearController(control.ss([], [], [], gain, T), names)
    law = law_of(controller, T, np.zeros((0, 6, 6)), np.zeros(SIZE), np.zeros(SIZE))
    wanted = np.arange(SIZE) / 2  # angles within half a turn
    assert law.force(0, 0.0, wanted, np.zeros(SIZE), np.zeros(6)) == pytest.approx(gain @ wanted[:12])


def test_a_controller_in_task_space_goes_through_the_jacobian() -> None:
    """Expected: F = J⁻ᵀ K J⁻¹ (L_r − L)."""
    rng = np.random.default_rng(1)
    J, K = rng.normal(size=(2, 6, 6)), rng.normal(size=(6, 6))
    law = law_of(LinearController(control.ss([], [], [], K, T), space="task"), T, J, np.zeros(SIZE), np.zeros(SIZE))
    wanted = np.zeros(SIZE)
    wanted[12:18] = error = rng.normal(size=6)
    expected = np.linalg.solve(J[1].T, K @ np.linalg.solve(J[1], error))
    assert law.force(1, 0.0, wanted, np.zeros(SIZE), np.zeros(6)) == pytest.approx(expected)


def test_task_space_tells_references_from_measurements() -> None:
    """Expected: F = J⁻ᵀ (K_r J⁻¹ (L_r − L_0) + K_y J⁻¹ (L − L_0)); a derivative on the measurement needs its own."""
    rng = np.random.default_rng(2)
    J, K = rng.normal(size=(1, 6, 6)), rng.normal(size=(6, 12))
    start, wanted, measured = (rng.normal(size=SIZE) for _ in range(3))
    law = law_of(LinearController(control.ss([], [], [], K, T), space="task"), T, J, start, start)
    r, y = (np.linalg.solve(J[0], (each - start)[12:18]) for each in (wanted, measured))
    expected = np.linalg.solve(J[0].T, K @ np.concatenate([r, y]))
    assert law.force(0, 0.0, wanted, measured, np.zeros(6)) == pytest.approx(expected)


def test_the_rate_of_a_measurement_in_task_space_is_the_twist() -> None:
    """Expected: J⁻¹ L̇ = (v, ω) of a platform that moves far from where it began; the filter's own lag is second order.

    Poses J⁻¹ (L − L_0) would have the rate of J⁻¹ in it, too: 10 % and more off.
    """
    platform, T = load_preset("motion_base"), 1e-3
    time: FloatArray = np.arange(400.0) * T
    motion = Circle(position=platform.home_position, orientation=np.zeros(3), radius=0.3, frequency=0.6)(time)
    J = np.asarray(leg_jacobian(platform, motion.position, motion.orientation))
    measured = np.zeros((len(time), SIZE))
    measured[:, 12:18] = legs_of(platform, motion).leg_length
    # the backward difference of the measurements, as the wrench
    difference = control.ss(
        np.zeros((6, 6)),
        np.hstack([np.zeros((6, 6)), np.eye(6)]),
        -np.eye(6) / T,
        np.hstack([np.zeros((6, 6)), np.eye(6)]) / T,
        T,
    )
    law = law_of(LinearController(difference, space="task"), T, J, measured[0], measured[0])
    forces = [law.force(k, t, measured[k], measured[k], np.zeros(6)) for k, t in enumerate(time)]
    twist = np.array([j.T @ force for j, force in zip(J, forces, strict=True)])
    middle = np.hstack([(motion.velocity[:-1] + motion.velocity[1:]) / 2, np.zeros((len(time) - 1, 3))])
    assert np.abs(twist[1:] - middle).max() < 2e-3 * np.abs(middle).max()


@pytest.mark.parametrize("space", ["leg", "task"])
@pytest.mark.parametrize("gains", [PD, PID], ids=["pd", "pid"])
def test_a_start_off_the_reference_gives_no_kick_of_the_derivative(gains: Gains, space: Any) -> None:
    """Expected: kp e in the first sample, unequal in every channel; its integral only from the next one on."""
    rng = np.random.default_rng(4)
    wanted, measured = np.zeros(SIZE), np.zeros(SIZE)
    measured[12:18] = rng.uniform(2, 3, 6)
    error = rng.normal(size=6) * 0.01
    wanted[12:18] = measured[12:18] + error
    J = np.eye(6) if space == "leg" else rng.normal(size=(6, 6)) + 3 * np.eye(6)
    law = law_of(LinearController(sampled(pid(gains), T, "backward_diff"), space=space), T, J[None], wanted, measured)
    force = law.force(0, 0.0, wanted, measured, np.zeros(6))
    e = np.linalg.solve(J, error)
    wrench = (np.asarray(gains.proportional) + T * np.asarray(gains.integral)) * e
    assert J.T @ force == pytest.approx(wrench, rel=1e-9)


def test_the_memory_at_rest_leaves_integrators_at_zero_in_any_coordinates() -> None:
    """Expected: a lag of gain 5 settled beside a double integrator at zero; coordinates mixed at random."""
    rng = np.random.default_rng(6)
    A = np.array([[0.9, 0, 0], [0, 1, T], [0, 0, 1]])
    B, C = np.array([[0.5], [0.0], [T]]), np.array([[1.0, 1.0, 0.0]])
    mix = rng.normal(size=(3, 3))
    one = control.ss(mix @ A @ np.linalg.inv(mix), mix @ B, C @ np.linalg.inv(mix), 0, T)
    law = law_of(controller_of(control.append(*[one] * 6)), T, np.zeros((0, 6, 6)), np.full(SIZE, 2.0), np.zeros(SIZE))
    assert law.force(0, 0.0, np.full(SIZE, 2.0), np.zeros(SIZE), np.zeros(6)) == pytest.approx(np.full(6, 10.0))


@pytest.mark.parametrize("derivative_on", ["error", "measurement"])
def test_a_controller_starts_at_rest(derivative_on: Any) -> None:
    """Expected: no force while the legs stay where they are and where they are wanted, whatever their length."""
    start = np.zeros(SIZE)
    start[12:18] = np.linspace(2, 3, 6)
    law = law_of(LinearController(sampled(pid(PID, derivative_on), T)), T, np.zeros((0, 6, 6)), start, start)
    for k in range(3):
        assert np.abs(law.force(k, k * T, start, start, np.zeros(6))).max() < 1e-8


@pytest.mark.parametrize(
    ("given_one", "match"),
    [
        (static(6, 7), r"7 inputs and 6 outputs; expected for the signals leg_length 6 inputs.*12.*18"),
        (static(3, 6), "3 outputs"),
        (pid(PD), "continuous time; expected discrete time: sample it"),
        (np.eye(6), "controller is ndarray; expected a control.StateSpace"),
        (None, "NoneType"),
    ],
)
def test_controllers_of_the_wrong_kind_are_refused(given_one: Any, match: str) -> None:
    with pytest.raises(ControllerError, match=match):
        controller_of(given_one)


IMPROPER = {
    "discrete": control.tf([9e3, 8e4], [1], T),
    "continuous": control.tf([9e3, 8e4], [1]),
    "one of 36 elements": control.tf(
        [[[1, 2, 3] if i == j == 4 else [1, 0.5] for j in range(6)] for i in range(6)],
        [[[1, -0.5] for _ in range(6)] for _ in range(6)],
        T,
    ),
}


@pytest.mark.parametrize("name", IMPROPER)
@pytest.mark.parametrize(
    "use",
    [
        lambda system: gs.run("heave_step", {"loop.duration": 0.01}, controller=system),
        lambda system: gs.margins("heave_step", controller=system),
        LinearController,
        lambda system: gs.sampled(system, T),
    ],
    ids=["run", "margins", "controller", "sampled"],
)
def test_a_transfer_function_with_more_zeros_than_poles_is_refused_with_the_remedy(use: Any, name: str) -> None:
    """Expected: one line; what it recommends is a controller that runs."""
    with pytest.raises(
        gs.GoughStewartError, match=r"improper transfer function, of degree (1 over 0|2 over 1), which"
    ) as e:
        use(IMPROPER[name])
    assert "\n" not in str(e.value)
    assert "gs.sampled(control.tf([kd + kp * Tf, kp], [Tf, 1]), sample_time)" in str(e.value)
    kp, kd, Tf = 8e4, 9e3, 5e-3
    filtered = gs.sampled(control.tf([kd + kp * Tf, kp], [Tf, 1]), 1e-3)
    # kp + kd s/(Tf s + 1) at 2 Hz, within the error of Tustin's rule
    s = 4j * np.pi
    assert filtered(np.exp(s * 1e-3)) == pytest.approx(kp + kd * s / (Tf * s + 1), rel=1e-3)


def test_signals_and_spaces_are_checked() -> None:
    with pytest.raises(ControllerError, match=r"no signal 'leg_lenght'; did you mean 'leg_length'"):
        LinearController(static(6, 6), ("leg_lenght",))
    with pytest.raises(ControllerError, match="no signals"):
        LinearController(static(6, 6), ())
    with pytest.raises(ControllerError, match="space is 'joint'"):
        LinearController(static(6, 6), space="joint")  # type: ignore[arg-type]
    with pytest.raises(ControllerError, match="needs the signal leg_length"):
        LinearController(static(6, 6), ("position", "orientation"), "task")


def test_one_signal_may_be_named_without_a_list() -> None:
    """Expected: the same as a list of one, also in task space, which takes that of the legs alone."""
    for space in ("leg", "task"):
        controller = LinearController(static(6, 6), "leg_length", space)  # type: ignore[arg-type]
        assert controller.signals == ("leg_length",)


def test_another_sample_time_is_refused() -> None:
    """Expected: one in a million is another one; one in a million million comes of rounding."""
    controller = controller_of(static(6, 6))
    with pytest.raises(ControllerError, match=r"sample time is 0.01 s, the loop's 0.001 s"):
        law_of(controller, 0.001, np.zeros((0, 6, 6)), np.zeros(SIZE), np.zeros(SIZE))
    assert isinstance(controller, LinearController)
    for factor in (1 - 1e-6, 1 + 1e-6):
        with pytest.raises(ControllerError, match=r"sample time is 0.01 s"):
            controller.check_sample_time(T * factor)
    for factor in (1 - 1e-12, 1 + 1e-12):
        controller.check_sample_time(T * factor)
