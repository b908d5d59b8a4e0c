"""Controllers as experiments name them: gains with units, what they become, what is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart.harness.control.controllers import PD, PID, ControllerChoice, OpenLoop, PythonController
from gough_stewart.harness.control.laws import LinearController, fresh_controller
from gough_stewart.harness.errors import ControllerError
from gough_stewart.model.dynamics import mass_matrix
from gough_stewart.model.platform import Platform
from tests.support.random_platforms import random_platform

T = 2e-3
KP = np.array([1000.0, 1100, 1300, 900, 800, 1500])
KD = np.array([20.0, 30, 25, 35, 40, 15])
KI = np.array([300.0, 0, 250, 500, 100, 50])


@pytest.fixture(scope="module")
def platform() -> Platform:
    return random_platform(np.random.default_rng(12))


def response(choice: ControllerChoice, platform: Platform, z: complex) -> Any:
    """C (z − A)⁻¹ B + D."""
    made = choice.controller(platform, T)
    assert isinstance(made, LinearController)
    A, B, C, D = (getattr(made.system, name) for name in "ABCD")
    return C @ np.linalg.solve(z * np.eye(len(A)) - A, B) + D


def test_gains_are_those_named_channel_by_channel(platform: Platform) -> None:
    """Expected: by Tustin's rule kp + kd s/(Tf s + 1) + ki/s at s = (2/T)(z − 1)/(z + 1), each channel its own."""
    z = np.exp(0.3j)
    s = 2 / T * (z - 1) / (z + 1)
    written = [f"{KP[0] / 1000} kN/m", *KP[1:]]
    derivative = KD * s / (0.004 * s + 1)
    pd = PD(proportional_gain=written, derivative_gain=KD, derivative_filter="4 ms")  # type: ignore[arg-type]
    assert response(pd, platform, z)[:, :6] == pytest.approx(np.diag(KP + derivative), rel=1e-9)
    pid = PID(proportional_gain=KP, derivative_gain=KD, integral_gain=KI, derivative_filter=0.004)
    assert response(pid, platform, z)[:, :6] == pytest.approx(np.diag(KP + derivative + KI / s), rel=1e-9)
    timed = PID(proportional_gain=KP, derivative_gain=KD, integral_time=0.25, derivative_filter=0.004)
    assert response(timed, platform, z)[:, :6] == pytest.approx(np.diag(KP + derivative + KP / 0.25 / s), rel=1e-9)


def test_choices_of_a_pid_reach_the_system(platform: Platform) -> None:
    """Expected: kp alone from the reference, by backward differences s = (1 − z⁻¹)/T; 1/(Tt s) from the excess."""
    z = np.exp(0.3j)
    s = (1 - 1 / z) / T
    choice = PID(
        proportional_gain=KP,
        derivative_gain=KD,
        integral_gain=200,
        anti_windup_time=0.7,
        derivative_on="measurement",
        derivative_filter=1e-4,
        discretisation="backward_diff",
    )
    found = response(choice, platform, z)
    assert found[:, :6] == pytest.approx(np.diag(KP + 200 / s), rel=1e-9)
    assert found[:, 6:12] == pytest.approx(-np.diag(KP + KD * s / (1e-4 * s + 1) + 200 / s), rel=1e-9)
    assert found[:, 12:] == pytest.approx(np.eye(6) / (0.7 * s), rel=1e-9)


def test_a_bandwidth_in_task_space_gives_each_axis_its_gains(platform: Platform) -> None:
    """Expected: kp = m ω², kd = 2 ζ m ω, ki = kp/Ti with m the diagonal of the mass matrix at home."""
    choice = PID(
        space="task",
        bandwidth="12 rad/s",  # type: ignore[arg-type]
        damping_ratio=0.9,
        integral_time=0.5,
        derivative_filter=0.03,
        anti_windup_time=0.4,
    )
    m = np.diag(mass_matrix(platform, platform.home_position, platform.home_orientation))
    gains = choice.gains(platform)
    assert gains.proportional == pytest.approx(m * 12**2)
    assert gains.derivative == pytest.approx(2 * 0.9 * m * 12)
    assert gains.integral == pytest.approx(m * 12**2 / 0.5)
    assert (gains.derivative_filter, gains.anti_windup_time) == (0.03, 0.4)
    made = choice.controller(platform, T)
    assert made.space == "task"
    assert made.sample_time == T


def test_a_bandwidth_alone_has_a_damping_ratio_of_0_7(platform: Platform) -> None:
    """Expected: kd = 2 ζ m ω with kp = m ω², so kd/kp = 1.4/ω, in both spaces; without integral action."""
    for space in ("leg", "task"):
        gains = PD(bandwidth="5 rad/s", space=space).gains(platform)  # type: ignore[arg-type]
        assert np.asarray(gains.derivative) / gains.proportional == pytest.approx(np.full(6, 1.4 / 5))
        assert np.asarray(gains.integral).tolist() == [0] * 6


def test_an_open_loop_adds_its_forces_to_the_feedforward(platform: Platform) -> None:
    """Expected: the sum, row by row; nothing is fed back, so there is no controller."""
    force: list[Any] = ["1 kN", 2, 3, 4, 5, -6]
    choice: ControllerChoice = OpenLoop(force=force)
    feedforward = np.arange(12.0).reshape(2, 6)
    assert choice.planned(feedforward).tolist() == [[1000, 3, 5, 7, 9, -1], [1006, 9, 11, 13, 15, 5]]
    assert np.array_equal(OpenLoop().planned(feedforward), feedforward)
    assert not choice.is_closed
    assert choice.controller(platform, T) is None
    assert choice.gains(platform) is None


def test_what_feeds_back_leaves_the_feedforward_alone() -> None:
    choice = PD(proportional_gain=1, derivative_gain=1)
    feedforward = np.arange(12.0).reshape(2, 6)
    assert choice.is_closed
    assert np.array_equal(choice.planned(feedforward), feedforward)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (PD, "^expected a bandwidth, or proportional_gain and derivative_gain$"),
        (lambda: PD(proportional_gain=1), "^expected a bandwidth, or proportional_gain and derivative_gain$"),
        (lambda: PD(bandwidth=1, derivative_gain=1), "^expected a bandwidth or gains, not both$"),
        (
            lambda: PD(proportional_gain=1, derivative_gain=1, damping_ratio=1),
            "^damping_ratio needs a bandwidth; remove it, or replace the gains by a bandwidth$",
        ),
        (lambda: PD(bandwidth=-1), "^bandwidth: is -1; expected > 0 Hz$"),
        (lambda: PD(bandwidth=1, dampin=1), "^dampin: unknown key .= 1.; did you mean 'damping_ratio'"),  # type: ignore[call-arg]
        (lambda: PD(bandwidth=1, space="joint"), "^space: is 'joint'; expected 'leg' or 'task'$"),  # type: ignore[arg-type]
        (lambda: PD(bandwidth=1, feedforward="magic"), "expected 'none', 'gravity' or 'computed_torque'$"),  # type: ignore[arg-type]
        (lambda: PD(bandwidth=1, discretisation="euler"), "is 'euler'; expected 'tustin', 'backward_diff' or 'zoh'$"),  # type: ignore[arg-type]
        (
            lambda: PD(proportional_gain=KP[:5], derivative_gain=1),
            r"^proportional_gain: is array.*; expected a number \[N/m\] or a list of 6; found 5 values$",
        ),
        (
            lambda: PD(proportional_gain=[*KP[1:], "6 N"], derivative_gain=1),
            r"^proportional_gain: .*value 6 of 6: .*found the unit 'N'$",
        ),
        (lambda: PD(bandwidth=1, derivative_on="x"), "^derivative_on: is 'x'; expected 'error' or 'measurement'$"),  # type: ignore[arg-type]
        (lambda: PythonController(name="a"), "^name and factory are of a file; file is missing, add it$"),
        (lambda: PythonController(factory="a"), "^name and factory are of a file; file is missing, add it$"),
        (lambda: PD(bandwidth=1, model=3), r"^the key model was removed: controllers use the nominal model"),  # type: ignore[call-arg]
        (lambda: PID(bandwidth=1), "^a PID needs an integral_time or an integral_gain; or choose type = 'pd'$"),
        (lambda: PID(bandwidth=1, integral_gain=1), "^integral_gain needs gains; with a bandwidth use"),
        (
            lambda: PID(proportional_gain=1, derivative_gain=1, integral_gain=1, integral_time=1),
            "^expected integral_gain or integral_time, not both$",
        ),
    ],
)
def test_what_makes_no_controller_is_refused_by_name(make: Any, message: str) -> None:
    with pytest.raises(ControllerError, match=message):
        make()


def test_an_anti_windup_faster_than_the_samples_is_refused(platform: Platform) -> None:
    """Expected: only channels with integral action count."""
    rest: dict[str, Any] = {"derivative_gain": KD, "derivative_filter": 0.004, "anti_windup_time": T / 2}
    choice = PID(proportional_gain=KP, integral_gain=[0, 0, 0.5, 0, 0, 0], **rest)
    with pytest.raises(
        ControllerError, match=r"anti_windup_time is 0.001 s; expected at least the sample_time of 0.002"
    ):
        choice.controller(platform, T)
    without = PID(proportional_gain=KP, integral_gain=0, **rest)
    assert without.controller(platform, T).system.ninputs == 12


@pytest.mark.parametrize(
    ("text", "file", "message"),
    [
        ("other = 1", "mine.py", "mine.py: defines no 'controller'; expected the controller under that name"),
        ("1 / 0", "mine.py", "mine.py: fails with ZeroDivisionError: division by zero"),
        ("controller = 1", "mine.txt", "mine.txt: is not a Python file; expected a name that ends in .py"),
        ("controller = 1", "mine.py", "controller is int; expected a control.StateSpace"),
        ("", "other.py", "other.py: no such file; expected a Python file that defines 'controller'"),
    ],
)
def test_a_file_that_holds_no_controller_is_refused(
    text: str, file: str, message: str, platform: Platform, tmp_path: Path
) -> None:
    (tmp_path / file.replace("other", "mine")).write_text(text)
    with pytest.raises(ControllerError, match=message):
        PythonController(file=file).controller(platform, T, tmp_path)


def test_a_file_gives_the_object_of_the_wanted_name(platform: Platform, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("def first(sample):\n    return 1\n\n\ndef second(sample):\n    return 2\n")
    found = PythonController(file="mine.py", name="second").controller(platform, T, tmp_path)
    assert fresh_controller(found)(None) == 2  # type: ignore[arg-type, operator]
