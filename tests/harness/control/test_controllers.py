"""PD, PID and linear controllers: gains with units, their formulas and their sampling, what is refused."""

from typing import Any

import control
import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart import Gains, GoughStewartError, LinearController, pid, sampled
from tests.support.uneven import UNEVEN

T = 2e-3
KP = np.array([1000.0, 1100, 1300, 900, 800, 1500])
KD = np.array([20.0, 30, 25, 35, 40, 15])
KI = np.array([300.0, 0, 250, 500, 100, 50])
PD_GAINS, PID_GAINS = Gains(100.0, 20.0), Gains(100.0, 20.0, 50.0)


def response(system: Any, z: complex) -> Any:
    """C (z − A)⁻¹ B + D."""
    return system.C @ np.linalg.solve(z * np.eye(len(system.A)) - system.A, system.B) + system.D


def of_choice(choice: Any, z: complex) -> Any:
    return response(choice.controller(UNEVEN, T).system, z)


def test_gains_are_those_named_channel_by_channel() -> None:
    """Expected: by Tustin's rule kp + kd s/(Tf s + 1) + ki/s at s = (2/T)(z − 1)/(z + 1), each channel its own."""
    z = np.exp(0.3j)
    s = 2 / T * (z - 1) / (z + 1)
    written = [f"{KP[0] / 1000} kN/m", *KP[1:]]
    derivative = KD * s / (0.004 * s + 1)
    pd = gs.PD(proportional_gain=written, derivative_gain=KD, derivative_filter="4 ms")  # type: ignore[arg-type]
    assert of_choice(pd, z)[:, :6] == pytest.approx(np.diag(KP + derivative), rel=1e-9)
    for values, integral in (({"integral_gain": KI}, KI), ({"integral_time": 0.25}, KP / 0.25)):
        choice = gs.PID(proportional_gain=KP, derivative_gain=KD, derivative_filter=0.004, **values)
        assert of_choice(choice, z)[:, :6] == pytest.approx(np.diag(KP + derivative + integral / s), rel=1e-9)


@pytest.mark.parametrize(
    "notch",
    [{"frequency": 41, "damping": 0.35, "depth": 0.15}, {"frequency": 220, "damping": 0.03}, {"frequency": 0.6}],
)
def test_the_notch_filters_the_forces_of_every_channel(notch: dict[str, Any]) -> None:
    """Expected: (s² + 2 g d s + 1)/(s² + 2 d s + 1) at s = i tan(π f T)/tan(π f₀ T); d = 0.5, g = 0 if unnamed."""
    gains: dict[str, Any] = {"proportional_gain": KP, "derivative_gain": KD, "integral_gain": KI}
    gains["derivative_filter"] = 0.004
    plain, notched = gs.PID(**gains), gs.PID(**gains, notch=gs.Notch(**notch))
    d, g = notch.get("damping", 0.5), notch.get("depth", 0.0)
    for f in (0.1, 17.0, notch["frequency"], 249.9):
        z, s = np.exp(2j * np.pi * f * T), 1j * np.tan(np.pi * f * T) / np.tan(np.pi * notch["frequency"] * T)
        whole = of_choice(plain, z)
        expected = whole * (s**2 + 2 * g * d * s + 1) / (s**2 + 2 * d * s + 1)
        assert of_choice(notched, z) == pytest.approx(expected, rel=1e-7, abs=1e-7 * np.abs(whole).max())


@pytest.mark.parametrize("space", ["leg", "task"])
def test_a_bandwidth_gives_gains_by_the_mass_that_each_channel_moves(space: Any) -> None:
    """Expected: kp = m ω², kd = 2 ζ m ω, ki = kp/Ti; m the diagonal of M, or the largest eigenvalue of J⁻ᵀ M J⁻¹."""
    home = UNEVEN.home_position, UNEVEN.home_orientation
    M, J = gs.mass_matrix(UNEVEN, *home), gs.leg_jacobian(UNEVEN, *home)
    at_legs = np.linalg.inv(J).T @ M @ np.linalg.inv(J)
    m = np.diag(M) if space == "task" else np.full(6, np.linalg.eigvalsh(at_legs).max())
    times: dict[str, Any] = {"integral_time": 0.5, "derivative_filter": 0.03, "anti_windup_time": 0.4}
    choice = gs.PID(space=space, bandwidth="12 rad/s", damping_ratio=0.9, **times)  # type: ignore[arg-type]
    for gains in (choice.gains(UNEVEN), gs.gains_from_bandwidth(UNEVEN, 6 / np.pi, 0.9, space, **times)):
        assert gains.proportional == pytest.approx(m * 12**2)
        assert gains.derivative == pytest.approx(2 * 0.9 * m * 12)
        assert gains.integral == pytest.approx(m * 12**2 / 0.5)
        assert (gains.derivative_filter, gains.anti_windup_time) == (0.03, 0.4)
    assert (choice.controller(UNEVEN, T).space, choice.controller(UNEVEN, T).sample_time) == (space, T)
    # ζ is 0.7 unless it is named, and a PD has no integral action
    plain = gs.PD(bandwidth="5 rad/s", space=space).gains(UNEVEN)  # type: ignore[arg-type]
    assert np.asarray(plain.derivative) / plain.proportional == pytest.approx(np.full(6, 1.4 / 5))
    assert np.asarray(plain.integral).tolist() == [0] * 6


def test_an_integral_faster_than_the_loop_is_unstable() -> None:
    """Expected: the bound Ti > 1/(2 ζ ωn) of the error message, by the poles of m s³ + kd s² + kp s + ki."""
    omega, zeta = 2 * np.pi * 2.0, 0.7
    edge = 1 / (2 * zeta * omega)
    with pytest.raises(GoughStewartError, match=r"integral_time is .*, say 0\.57 s$"):
        gs.gains_from_bandwidth(UNEVEN, 2.0, zeta, integral_time=0.99 * edge)
    gains = gs.gains_from_bandwidth(UNEVEN, 2.0, zeta, integral_time=1.01 * edge)
    kp, kd, ki = (np.asarray(v)[0] for v in (gains.proportional, gains.derivative, gains.integral))
    m = kp / omega**2
    assert np.roots([m, kd, kp, ki]).real.max() < 0 < np.roots([m, kd, kp, 1.03 * ki]).real.max()
    for bandwidth, damping_ratio, name in ((-1.0, 0.7, "bandwidth is -1"), (1.0, float("nan"), "damping_ratio is nan")):
        with pytest.raises(GoughStewartError, match=name):
            gs.gains_from_bandwidth(UNEVEN, bandwidth, damping_ratio)


def test_the_feedforward_is_that_of_rest_once_a_path_without_a_ramp_has_ended() -> None:
    """Expected: the static forces of the last pose; until its end the fastest motion brakes."""
    poses = [[0, 0, 0, 0, 0, 0], [0.03, 0, 0.06, 0, 0.05, 0]]
    path: dict[str, Any] = {"type": "path", "poses": poses, "relative_to": "home", "timing": "fastest", "margin": 0.3}
    settings = {"reference": path, "controller.feedforward": "computed_torque", "loop.duration": 0.4}
    record, platform = gs.run("heave_step", settings), gs.load_preset("motion_base")
    moving = np.flatnonzero(record["reference.velocity"].any(axis=1))
    ended = np.arange(len(record["time"])) > moving[-1] + 1
    pose = record["reference.position"][-1], record["reference.orientation"][-1]
    rest = gs.static_leg_forces(platform, *pose)
    assert ended.sum() > 50
    assert np.abs(record["controller.feedforward"][ended] - rest).max() < 1e-6 * np.abs(rest).max()
    assert np.abs(record["controller.feedforward"][~ended] - rest).max() > 0.1 * np.abs(rest).max()


def test_the_feedforward_looks_no_further_than_the_end_of_a_recording() -> None:
    """Expected: a run as long as the recording, whose last forces follow those before them."""
    record = gs.run("recorded_ride", {"controller.feedforward": "computed_torque"})
    assert record.metadata["outcome"]["status"] == "completed"
    last = record["controller.feedforward"][-4:]
    assert np.abs(np.diff(last, axis=0)).max() < 0.01 * np.abs(last).max()


def test_an_open_loop_adds_its_forces_to_the_feedforward() -> None:
    """Expected: the sum, and in the record the same as the force that acts."""
    settings: dict[str, Any] = {"loop.duration": 0.01, "controller": {"type": "open_loop", "feedforward": "gravity"}}
    alone = gs.run("pitch_sine", settings)["controller.feedforward"]
    settings["controller"]["force"] = ["0.1 kN", 2, 3, 4, 5, -6]
    both = gs.run("pitch_sine", settings)
    assert both["controller.feedforward"] - alone == pytest.approx(np.tile([100, 2, 3, 4, 5, -6], (len(alone), 1)))
    assert np.array_equal(both["controller.force"], both["controller.feedforward"])


def of_table(**table: Any) -> Any:
    return lambda: gs.load_experiment("heave_step", {"controller": table})


def of_notch(**values: Any) -> Any:
    return lambda: gs.PD(bandwidth=3, notch=gs.Notch(**values)).controller(UNEVEN, T)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (gs.PD, "^expected a bandwidth, or proportional_gain and derivative_gain$"),
        (lambda: gs.PD(bandwidth=1, derivative_gain=1), "^expected a bandwidth or gains, not both$"),
        (lambda: gs.PD(proportional_gain=1, derivative_gain=1, damping_ratio=1),
         "^damping_ratio needs a bandwidth; remove it, or replace the gains by a bandwidth$"),
        (lambda: gs.PD(bandwidth=-1), "^bandwidth: is -1; expected > 0 Hz$"),
        (lambda: gs.PD(bandwidth=1, dampin=1), "^dampin: unknown key .= 1.; did you mean 'damping_ratio'"),  # type: ignore[call-arg]
        (lambda: gs.PD(bandwidth=1, space="joint"), "^space: is 'joint'; expected 'leg' or 'task'$"),  # type: ignore[arg-type]
        (lambda: gs.PD(bandwidth=1, feedforward="x"), "expected 'none', 'gravity' or 'computed_torque'$"),  # type: ignore[arg-type]
        (lambda: gs.PD(bandwidth=1, discretisation="x"), "is 'x'; expected 'tustin', 'backward_diff' or 'zoh'$"),  # type: ignore[arg-type]
        (lambda: gs.PD(proportional_gain=KP[:5], derivative_gain=1),
         r"^proportional_gain: is array.*; expected a number \[N/m\] or a list of 6; found 5 values$"),
        (lambda: gs.PD(proportional_gain=[*KP[1:], "6 N"], derivative_gain=1),
         r"^proportional_gain: .*value 6 of 6: .*found the unit 'N'$"),
        (lambda: gs.PD(bandwidth=1, derivative_on="x"), "^derivative_on: is 'x'; expected 'error' or 'measurement'$"),  # type: ignore[arg-type]
        (lambda: gs.PD(bandwidth=1, model=3), r"^the key model was removed: controllers use the nominal model"),  # type: ignore[call-arg]
        (lambda: gs.PID(bandwidth=1), "^a PID needs an integral_time or an integral_gain; or choose type = 'pd'$"),
        (lambda: gs.PID(bandwidth=1, integral_gain=1), "^integral_gain needs gains; with a bandwidth use"),
        (lambda: gs.PID(proportional_gain=1, derivative_gain=1, integral_gain=1, integral_time=1),
         "^expected integral_gain or integral_time, not both$"),
        (of_notch(frequency=0), "frequency: is 0; expected > 0 Hz"),
        (of_notch(frequency="3 m"), "found the unit 'm'"),
        (of_notch(frequency=3, damping=-1), "damping: is -1; expected > 0"),
        (of_notch(frequency=3, depth=1), "depth: is 1; expected a number from 0 to below 1"),
        (of_notch(frequency=3, width=1), "width"),
        (of_notch(frequency=250), r"notch\.frequency is 250 Hz; expected less than 250 Hz"),
        (of_table(type="python", name="a"), "name and factory are of a file; file is missing, add it$"),
        (lambda: Gains(-1.0, 0.0), "^proportional gain is -1.0; expected finite numbers > 0$"),
        (lambda: Gains([1.0, 2.0, 3.0, 0.0, 5.0, 6.0], 0.0), "^proportional gain is .*expected finite numbers > 0$"),
        (lambda: Gains(1.0, float("inf")), "^derivative gain is inf; expected finite numbers >= 0$"),
        (lambda: Gains([1.0, 2.0], 0.0), r"proportional gain has shape \(2,\)"),
        (lambda: Gains("stiff", 0.0), "proportional gain is 'stiff'"),
        (lambda: Gains(1.0, -3.0, -2.0, -1.0), "^derivative gain is -3.0; expected finite numbers >= 0$"),
        (lambda: Gains(1.0, 1.0, 1.0, float("inf"), -1.0), "^derivative_filter is inf; expected a time > 0 s$"),
        (lambda: Gains(1.0, 1.0, 1.0, 1.0, float("nan")), "^anti_windup_time is nan; expected a time > 0 s$"),
        (lambda: pid(PD_GAINS, "nothing"), "derivative_on is 'nothing'"),  # type: ignore[arg-type]
        (lambda: sampled(pid(PD_GAINS), float("inf")), "^sample_time is inf; expected a"),
        (lambda: sampled(pid(PD_GAINS), T, "euler"), "'euler'; expected one of tustin, backward_diff, zoh$"),  # type: ignore[arg-type]
        (lambda: sampled(sampled(pid(PD_GAINS), T), T), r"is already discrete \(dt = 0.002 s\); expected a continuous"),
        (lambda: sampled(pid(Gains(1.0, 1.0, derivative_filter=1e-4)), 0.01),
         r"time constant of 0.0001 s.*derivative_filter of at least 0.005 s"),
    ],
)  # fmt: skip
def test_what_makes_no_controller_is_refused_by_name(make: Any, message: str) -> None:
    with pytest.raises(GoughStewartError, match=message):
        make()


def test_an_anti_windup_faster_than_the_samples_is_refused() -> None:
    """Expected: only channels with integral action count."""
    times = {"derivative_filter": 0.004, "anti_windup_time": T / 2}
    rest: dict[str, Any] = {"proportional_gain": KP, "derivative_gain": KD, **times}
    with pytest.raises(GoughStewartError, match=r"is 0.001 s; expected at least the sample_time of 0.002"):
        gs.PID(integral_gain=[0, 0, 0.5, 0, 0, 0], **rest).controller(UNEVEN, T)
    assert gs.PID(integral_gain=KI, **{**rest, "anti_windup_time": T}).controller(UNEVEN, T).system.B.shape[1] == 18
    assert gs.PID(integral_gain=0, **rest).controller(UNEVEN, T).system.B.shape[1] == 12


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
    # names by which python-control's interconnect joins them with a plant, also once they are sampled
    names = [f"{name}[{k}]" for name in ("reference_leg_length", "leg_length", "limit_excess") for k in range(1, 7)]
    forces = [f"actuator_force[{k}]" for k in range(1, 7)]
    for each in (system, sampled(system, T)):
        assert (each.nstates, each.name, each.input_labels, each.output_labels) == (6, "controller", names, forces)
    assert pid(PD_GAINS).input_labels == names[:12]


def test_defaults_follow_from_the_gains() -> None:
    """Expected: Tf = Td/20 with Td = kd/kp of the fastest channel; Tt = √(Ti Td), Ti without a derivative."""
    kp, kd, ki = np.array([[3.0, 5, 4, 6, 7, 2], [0.3, 0, 0.2, 0.7, 0.5, 0.1], [0.2, 0.4, 3, 2, 0.9, 5]])
    gains = Gains(kp, kd, ki)
    assert gains.filter_time == pytest.approx(0.05 / 20)
    for fastest in range(6):
        assert Gains(np.roll(kp, fastest - 3), np.full(6, 0.7)).filter_time == pytest.approx(0.1 / 20)
    assert gains.tracking_time == pytest.approx(np.where(kd > 0, np.sqrt(kd / ki), kp / ki))


@pytest.mark.parametrize("is_diagonal", [False, True])
@pytest.mark.parametrize("method", ["tustin", "backward_diff", "zoh"])
def test_sampling_is_python_controls(method: Any, is_diagonal: bool) -> None:
    """Expected: the matrices of `control.sample_system`, by SciPy, of states that depend on each other, or do not."""
    rng = np.random.default_rng(3)
    A = np.diag([-30.0, 0.0, 7.0, -110.0]) if is_diagonal else rng.normal(size=(4, 4)) - 20 * np.eye(4)
    system = control.ss(A, rng.normal(size=(4, 3)), rng.normal(size=(2, 4)), rng.normal(size=(2, 3)))
    found, expected = sampled(system, 0.01, method), control.sample_system(system, 0.01, method)
    for name in "ABCD":
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-12, abs=1e-15)
    assert found.dt == 0.01


def static(rows: int, columns: int) -> Any:
    return control.ss([], [], [], np.ones((rows, columns)), T)


def test_a_matrix_of_transfer_functions_drops_in() -> None:
    """Expected: the same response as its elements, with zeros beside the diagonal and one element that is not."""
    one, z = control.sample_system(control.tf([3.0, 1.0], [0.1, 1]), T, "tustin"), np.exp(0.4j)
    num, den = ([[[value] for value in row] for row in whole.tolist()] for whole in (np.zeros((6, 6)), np.ones((6, 6))))
    for k in range(6):
        num[k][k], den[k][k] = one.num_array[0, 0], one.den_array[0, 0]
    num[0][5] = [2.0]
    expected = np.asarray(one(z)) * np.eye(6)
    expected[0, 5] = 2.0
    assert response(LinearController(control.tf(num, den, T)).system, z) == pytest.approx(expected)


def test_a_transfer_function_with_more_zeros_than_poles_is_refused_with_the_remedy() -> None:
    """Expected: one line; what it recommends is kp + kd s/(Tf s + 1), at 2 Hz within the error of Tustin's rule."""
    zeros, poles = np.reshape([[1.0, 0.5]] * 36, (6, 6, 2)).tolist(), np.reshape([[1.0, -0.5]] * 36, (6, 6, 2)).tolist()
    zeros[4][4] = [1.0, 2.0, 3.0]
    uses: list[Any] = [lambda C: gs.run("heave_step", {"loop.duration": 0.01}, controller=C), lambda C: sampled(C, T)]
    # sampled, continuous, and one of 36 elements
    for improper in (control.tf([9e3, 8e4], [1], T), control.tf([9e3, 8e4], [1]), control.tf(zeros, poles, T)):
        for use in uses:
            with pytest.raises(GoughStewartError, match=r"improper transfer function, of degree . over ., which") as e:
                use(improper)
            assert "\n" not in str(e.value)
            assert "gs.sampled(control.tf([kd + kp * Tf, kp], [Tf, 1]), sample_time)" in str(e.value)
    kp, kd, Tf, s = 8e4, 9e3, 5e-3, 4j * np.pi
    filtered = sampled(control.tf([kd + kp * Tf, kp], [Tf, 1]), 1e-3)
    assert filtered(np.exp(s * 1e-3)) == pytest.approx(kp + kd * s / (Tf * s + 1), rel=1e-3)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ((static(6, 7),), r"7 inputs and 6 outputs; expected for the signals leg_length 6 inputs.*12.*18"),
        ((static(3, 6),), "3 outputs"),
        ((pid(PD_GAINS),), "continuous time; expected discrete time: sample it"),
        ((np.eye(6),), "controller is ndarray; expected a control.StateSpace"),
        ((gs.PD(bandwidth=2),), "controller is PD; .*; settings take it: {'controller': …}"),
        ((None,), "NoneType"),
        ((control.ss([], [], [], np.full((6, 6), np.nan), T),), "matrix D has elements that are not finite"),
        ((static(6, 6), ("leg_lenght",)), r"no signal 'leg_lenght'; did you mean 'leg_length'"),
        ((static(6, 6), ()), "no signals"),
        ((static(6, 6), "leg_length", "joint"), "space is 'joint'"),
        ((static(6, 12), ("position", "orientation"), "task"), "needs the signal leg_length"),
    ],
)
def test_linear_controllers_that_cannot_be_are_refused(arguments: Any, match: str) -> None:
    with pytest.raises(GoughStewartError, match=match):
        LinearController(*arguments)


@pytest.mark.parametrize(("designed", "is_fine"), [(1e-3, True), (1e-3 * (1 + 1e-12), True), (1e-3 * (1 - 1e-6), False),
                                                   (1e-3 * (1 + 1e-6), False), (1.0, False), (True, True)])  # fmt: skip
def test_another_sample_time_is_refused(designed: float, is_fine: bool) -> None:
    """Expected: one in a million is another one; rounding and a gain without a sample time are not."""
    controller = LinearController(control.ss([], [], [], np.eye(6), designed), "leg_length")  # type: ignore[arg-type]
    assert controller.signals == ("leg_length",)
    settings = {"loop.duration": 0.01, "loop.sample_time": 1e-3}
    if is_fine:
        gs.run("heave_step", settings, controller=controller)
        return
    with pytest.raises(GoughStewartError, match=r"the controller's sample time is .* s, the loop's 0.001 s; resample"):
        gs.run("heave_step", settings, controller=controller)
