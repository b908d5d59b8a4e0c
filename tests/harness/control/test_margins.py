"""Margins: closed forms, python-control's own on single loops, and loops driven to the edge."""

from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from gough_stewart.harness.control.gains import gains_from_bandwidth
from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.linear import leg_space_mass, linearise, modes
from gough_stewart.harness.control.loop_transfer import feedback_part, loop_transfer
from gough_stewart.harness.control.margins import (
    Margins,
    closed_loop,
    frequency_range,
    loop_margins,
    response,
)
from gough_stewart.harness.control.pid import Gains, pid, sampled
from gough_stewart.harness.control.state_space import control_system
from gough_stewart.harness.control.structured import bounds_of_the_largest, scaled_norm
from gough_stewart.harness.errors import ControllerError, UnstableLoopError
from gough_stewart.harness.experiment.margins import margins as margins_of
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform_toml import load_preset
from tests.support.laws import law_of
from tests.support.uneven import UNEVEN

T = 1e-3
POSE = UNEVEN.home_position + np.array([0.2, -0.1, 0.15]), UNEVEN.home_orientation + np.array([0.1, -0.05, 0.2])


def uneven_gains() -> Gains:
    """Of about 1 Hz, other ones in every leg."""
    even, factor = gains_from_bandwidth(UNEVEN, 1.0, 0.8), np.array([1.0, 0.8, 1.2, 0.7, 1.1, 0.9])
    return Gains(even.proportional * factor, even.derivative * factor[::-1])


@pytest.fixture(scope="module")
def L() -> Any:
    """The uneven platform under PD, delayed by two samples."""
    return control_system(loop_transfer(UNEVEN, LinearController(sampled(pid(uneven_gains()), T)), T, delay=2))


@pytest.fixture(scope="module")
def margins(L: Any) -> Margins:
    return loop_margins(L)


def diagonal(one: Any) -> Any:
    return control.append(*[control.ss(one)] * 6)


def largest_pole(loop: Any) -> float:
    return float(np.abs(closed_loop(loop).poles()).max())


def test_a_double_integrator_under_pd_has_its_closed_form() -> None:
    """Expected for L = (kp + kd s)/s²: ωc² = (kd² + √(kd⁴ + 4 kp²))/2, phase margin atan(kd ωc/kp), S − T by hand."""
    kp, kd = 4.0, 3.0
    margins = loop_margins(diagonal(control.tf([kd, kp], [1, 0, 0])))
    crossover = np.sqrt((kd**2 + np.sqrt(kd**4 + 4 * kp**2)) / 2)
    phase = np.arctan(kd * crossover / kp)
    for leg in margins.legs:
        assert leg.crossover == pytest.approx(crossover / (2 * np.pi), rel=1e-4)
        assert leg.phase == pytest.approx(phase, rel=1e-4)
        assert leg.delay == pytest.approx(phase / crossover, rel=1e-4)
        assert (leg.gain_down, leg.gain_up) == (0, np.inf)
    s = 1j * np.geomspace(0.01, 100, 200_000)
    loop = (kd * s + kp) / s**2
    assert margins.disk.alpha == pytest.approx(1 / np.abs((1 - loop) / (1 + loop) / 2).max(), rel=1e-6)
    assert margins.sensitivity_peak == pytest.approx(1.0, rel=1e-4)  # at high frequency
    assert margins.complementary_peak == pytest.approx(np.abs(loop / (1 + loop)).max(), rel=1e-6)


@settings(max_examples=4)
@given(kp=st.floats(1.0, 50.0), kd=st.floats(1.0, 10.0), lag=st.floats(0.001, 0.05))
def test_six_equal_loops_have_the_disk_margin_of_one(kp: float, kd: float, lag: float) -> None:
    """Expected: control.disk_margins and control.margin of the single loop, an independent computation."""
    one = control.tf([kd, kp], [lag, 1, 0, 0])
    if kd <= 1.5 * kp * lag:  # near the edge, or beyond
        return
    margins = loop_margins(diagonal(one))
    omega = np.geomspace(1e-1, 1e4, 5_000)
    alpha, gain_db, phase = control.disk_margins(control.ss(one), omega)
    assert margins.disk.alpha == pytest.approx(float(alpha), rel=1e-3)
    assert 20 * np.log10(margins.disk.gain[1]) == pytest.approx(float(gain_db), rel=1e-3)
    assert np.degrees(margins.disk.phase) == pytest.approx(float(phase), rel=1e-3)
    assert np.degrees(margins.legs[3].phase) == pytest.approx(control.margin(one)[1], rel=1e-3)
    assert (margins.legs[3].gain_down, margins.legs[3].gain_up) == (0, np.inf)  # by Routh, for all kd > kp lag


@pytest.mark.parametrize(
    ("one", "down", "up"),
    [
        (control.tf([4.0], [1, 3, 3, 1]), 0.0, 2.0),  # 4/(s + 1)³: closed s³ + 3 s² + 3 s + 1 + 4 k by Routh
        (control.tf([2.0], [1, -1]), 0.5, np.inf),  # pole 1 − 2 k
        (control.tf([-0.5], [1]), 0.0, 2.0),  # 1 − k/2 = 0
        (control.tf([1.0], [1, -1], 0.1), 0.0, 2.0),  # pole 1 − k, leaves the circle at −1
        (control.tf([1.0], [1, 0, 0]) * control.tf([1.0, 1.0], [0.01, 1]), 0.0, np.inf),  # Routh: 1 > 0.01
    ],
)
def test_gain_margins_have_their_closed_form_and_no_others(one: Any, down: float, up: float) -> None:
    """Expected: by hand, in the comments; also where the loop meets the axis only at frequency 0 or at its highest."""
    for leg in loop_margins(diagonal(one)).legs:
        assert leg.gain_down == pytest.approx(down, rel=1e-5)
        assert leg.gain_up == pytest.approx(up, rel=1e-5)


def test_a_narrow_resonance_is_not_overlooked() -> None:
    """Expected for 0.05/(s² + 2 ζ s + 1), ζ = 1e-5: |S| peaks where the closed loop does, (1.05 − 1)/(2 ζ √1.05)."""
    zeta = 1e-5
    margins = loop_margins(diagonal(control.tf([0.05], [1, 2 * zeta, 1])))
    assert margins.sensitivity_peak == pytest.approx(0.05 / (2 * zeta * np.sqrt(1.05)), rel=1e-3)
    # gain 1 at ω² ≈ 1.05 and 0.95, where the phase is −180° or 0° but for 2 ζ ω/0.05
    assert margins.legs[0].phase == pytest.approx(2 * zeta * np.sqrt(1.05) / 0.05, rel=1e-3)
    assert margins.legs[0].delay == pytest.approx(2 * zeta / 0.05, rel=1e-3)


@pytest.mark.parametrize("leg", [0, 3])
def test_a_leg_at_its_gain_margin_is_at_the_edge(L: Any, margins: Margins, leg: int) -> None:
    """Expected: 1 % within the margins the closed loop is stable, 1 % beyond it is not; by eigenvalues."""
    claimed = margins.legs[leg]
    for factor, stable in (
        (0.99 * claimed.gain_up, True),
        (1.01 * claimed.gain_up, False),
        (1.01 * claimed.gain_down, True),
        (0.99 * claimed.gain_down, False),
    ):
        changed = np.eye(6)
        changed[leg, leg] = factor
        assert (largest_pole(L * control.ss([], [], [], changed, T)) < 1) == stable


def test_a_leg_at_its_delay_margin_is_at_the_edge(L: Any, margins: Margins) -> None:
    """Expected: whole samples less than the margin are borne by one leg, more are not."""
    samples = margins.legs[0].delay / T
    for delay, stable in ((int(samples), True), (int(samples) + 1, False)):
        late = control.ss(control.tf([1], [1] + [0] * delay, T))
        one = control.append(late, *[control.ss([], [], [], [[1.0]], T)] * 5)
        assert (largest_pole(L * one) < 1) == stable


@given(seed=st.integers(0, 10_000))
def test_all_legs_may_change_at_once_within_the_disk(L: Any, margins: Margins, seed: int) -> None:
    """Expected: any gains within the guaranteed range leave the loop stable (Seiler, Packard & Gahinet 2020)."""
    low, high = margins.disk.gain
    gains = np.exp(np.random.default_rng(seed).uniform(np.log(low), np.log(high), 6))
    assert largest_pole(L * control.ss([], [], [], np.diag(gains), T)) < 1


def test_the_response_is_python_controls(L: Any) -> None:
    """Expected: the system called at z = e^(iωT)."""
    omega = np.array([0.3, 20.0, 900.0])
    for k, each in enumerate(omega):
        assert response(L, omega)[k] == pytest.approx(L(np.exp(1j * each * T)), rel=1e-8)


def test_the_frequency_range_ends_at_half_the_sample_rate(L: Any) -> None:
    low, high = frequency_range(L)
    assert high == pytest.approx(np.pi / T)
    assert low < 0.1


def test_the_frequency_range_is_about_the_poles_of_both_loops() -> None:
    """Expected: a thousandth of the slowest pole to a hundred times the fastest, of k/(s + a) and its closed loop."""
    slow, fast = (diagonal(control.tf([k], [1.0, a])) for k, a in ((3.0, 2.0), (-1.5, 2.0)))
    assert frequency_range(slow) == pytest.approx((2.0 / 1000, 100 * 5.0))
    assert frequency_range(fast) == pytest.approx((0.5 / 1000, 100 * 2.0))
    # sampled: up to half the rate; an integrator's own pole does not count
    pole, gain = np.exp(-0.7 * T), np.exp(-0.7 * T) - np.exp(-40.0 * T)
    low, high = frequency_range(diagonal(control.tf([gain], [1.0, -pole], T)))
    assert (low, high) == pytest.approx((0.7 / 1000, np.pi / T))
    assert frequency_range(diagonal(control.tf([1.0], [1.0, 0.0])))[0] == pytest.approx(1.0 / 1000)


def test_an_unstable_loop_has_no_margins() -> None:
    """Expected: with 45 samples of delay the pose is lost; the error names the eigenvalue."""
    platform = load_preset("motion_base")
    controller = LinearController(sampled(pid(gains_from_bandwidth(platform, 4.0, 0.8)), T))
    with pytest.raises(
        UnstableLoopError, match=r"unstable \(worst eigenvalue \|z\| = 1\.\d+ at [\d.]+ Hz, expected below 1"
    ) as caught:
        loop_margins(loop_transfer(platform, controller, T, delay=45))
    assert abs(caught.value.eigenvalue) > 1
    with pytest.raises(UnstableLoopError, match=r"1/s at [0-9.]+ Hz, expected left of 0"):
        loop_margins(diagonal(control.tf([1.0], [1, 0, 0])))


@pytest.mark.parametrize(
    ("gain", "message"),
    [
        (0.5, r"stable with all gains × 8: choose a higher bandwidth"),
        (1.0, r"stable with all gains × 4: choose a higher bandwidth"),
        (2.0, r"stable with all gains × 2: choose a higher bandwidth"),
    ],
)
def test_a_loop_with_too_little_gain_is_advised_to_have_more(gain: float, message: str) -> None:
    """Expected: (s − 1)(s + 3) + k is stable from k = 3 on, by Routh's rule."""
    with pytest.raises(UnstableLoopError, match=message):
        loop_margins(diagonal(control.tf([gain], [1, 2, -3])))


@pytest.mark.parametrize(("gain", "factor"), [(7.0, "0.5"), (20.0, "0.25"), (40.0, "0.125")])
def test_a_loop_with_too_much_gain_is_advised_to_have_less(gain: float, factor: str) -> None:
    """Expected: s³ + 3 s² + 2 s + k is stable below k = 6, by Routh's rule."""
    with pytest.raises(UnstableLoopError, match=rf"stable with all gains × {factor}: choose a lower bandwidth"):
        loop_margins(diagonal(control.tf([gain], [1, 3, 2, 0])))


def test_a_loop_that_no_gain_helps_says_so() -> None:
    """Expected: s² (s + 2) + k has a root to the right for every k > 0, by Routh's rule."""
    with pytest.raises(UnstableLoopError, match=r"no gains from × 0\.0625 to × 16 make it stable"):
        loop_margins(diagonal(control.tf([1.0], [1, 2, 0, 0])))


def test_what_moved_an_eigenvalue_of_an_experiment_is_named() -> None:
    """Expected: each alone makes the loop stable, as margins of the experiment without it show."""
    lazy = {"controller.bandwidth": 8, "actuators.lag": 0.1, "loop.duration": 1}
    with pytest.raises(UnstableLoopError, match=r"it is stable without the actuators' lag of 0\.1 s") as caught:
        margins_of("heave_step", lazy)
    assert "delay" not in str(caught.value)
    assert margins_of("heave_step", {**lazy, "actuators.lag": 0}).disk.alpha > 0
    with pytest.raises(UnstableLoopError, match=r"it is stable at a sample_time of 0\.01 s"):
        margins_of("too_slow")


def test_a_delay_of_too_many_samples_is_refused_before_it_fills_the_memory() -> None:
    with pytest.raises(
        ControllerError, match=r"a delay of 1000 samples of 0\.001 s gives a linear loop of 60.. states"
    ):
        margins_of("heave_step", {"loop.delay": 1000, "loop.duration": 3})


@pytest.mark.parametrize("count", [3, 40])
def test_the_response_of_many_states_is_that_of_the_equations(count: int) -> None:
    """Expected: C (z − A)⁻¹ B + D, solved at each frequency as it stands."""
    rng = np.random.default_rng(8)
    A = rng.normal(size=(90, 90))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    loop = control.ss(A, rng.normal(size=(90, 6)), rng.normal(size=(6, 90)), rng.normal(size=(6, 6)), T)
    omega = np.geomspace(1, 3000, count)
    expected = [loop.C @ np.linalg.solve(np.exp(1j * w * T) * np.eye(90) - A, loop.B) + loop.D for w in omega]
    assert np.abs(response(loop, omega) - expected).max() < 1e-10 * np.abs(expected).max()


def test_loops_that_are_none_are_refused() -> None:
    for loop, message in (
        (np.ones((6, 5)), "is 6×5; expected as many outputs as inputs"),
        (np.full((6, 6), np.nan), "is not finite"),
        (-np.eye(6), "expected a delay or a lag"),
        # 1 + L has no digits left: the condition number is 6/(4 ε)
        (np.diag([5, 0, 0, 0, 0, 4 * np.finfo(float).eps - 1]), "expected a delay or a lag"),
    ):
        with pytest.raises(ControllerError, match=message):
            loop_margins(control.ss([], [], [], loop))


def test_a_static_loop_has_the_margins_of_a_number() -> None:
    """Expected for L = 2: S = 1/3, T = 2/3, α = 2/|S − T| = 6; no gain > 0 and no delay makes it unstable."""
    margins = loop_margins(control.ss([], [], [], 2 * np.eye(6)))
    assert margins.disk.alpha == pytest.approx(6)
    assert margins.disk.gain == (0, np.inf)
    assert (margins.sensitivity_peak, margins.complementary_peak) == pytest.approx((1 / 3, 2 / 3))
    assert {(leg.gain_down, leg.gain_up, leg.phase, leg.delay) for leg in margins.legs} == {(0, np.inf, np.inf, np.inf)}


def test_plain_types_have_none_for_what_is_infinite() -> None:
    said = loop_margins(diagonal(control.tf([3.0, 4.0], [1, 0, 0]))).as_dict()
    assert said["legs"][0]["gain_up"] is None
    assert isinstance(said["disk"]["gain"], list)


@pytest.mark.parametrize("space", ["leg", "task"])
def test_gains_give_the_modes_that_their_formula_says(space: Any) -> None:
    """Expected, without gravity: m_k s² + kd s + kp per eigenvalue; in task space ω and ζ of all axes."""
    platform = load_preset("liu2000")
    floating = type(platform)(**(platform.as_dict() | {"gravity": np.zeros(3)}))
    gains = gains_from_bandwidth(floating, 2.0, 0.7, space)
    kp, kd = np.asarray(gains.proportional), np.asarray(gains.derivative)
    h = 1e-5
    # an ideal derivative: the difference over a sample so short that it hardly matters
    z = control.tf([1, 0], [1], h)
    ideal = control.append(*(control.ss(kp[k] + kd[k] * (z - 1) / (z * h)) for k in range(6)))
    found = modes(closed_loop(loop_transfer(floating, LinearController(ideal, space=space), h)))[:12]
    if space == "leg":
        masses = np.linalg.eigvalsh(leg_space_mass(floating))
        expected = [root for m in masses for root in np.roots([m, kd[0], kp[0]])]
        assert min(abs(root) for root in expected) == pytest.approx(found[0].frequency * 2 * np.pi, rel=1e-3)
        assert any(mode.frequency == pytest.approx(2.0, rel=1e-3) for mode in found)
        assert any(mode.damping_ratio == pytest.approx(0.7, rel=1e-3) for mode in found)
    else:
        slow = [mode for mode in found if mode.frequency < 10]
        assert len(slow) == 6
        for mode in slow:
            assert mode.frequency == pytest.approx(2.0, rel=0.02)
            assert mode.damping_ratio == pytest.approx(0.7, rel=0.02)


def test_an_integral_faster_than_the_loop_is_unstable() -> None:
    """Expected: the bound Ti > 1/(2 ζ ωn) of the error message, by the poles of m s³ + kd s² + kp s + ki."""
    platform = load_preset("liu2000")
    omega, zeta = 2 * np.pi * 2.0, 0.7
    edge = 1 / (2 * zeta * omega)
    with pytest.raises(ValueError, match="integral_time is"):
        gains_from_bandwidth(platform, 2.0, zeta, integral_time=0.99 * edge)
    gains = gains_from_bandwidth(platform, 2.0, zeta, integral_time=1.01 * edge)
    kp, kd, ki = (np.asarray(v)[0] for v in (gains.proportional, gains.derivative, gains.integral))
    m = kp / omega**2
    assert np.roots([m, kd, kp, ki]).real.max() < 0
    assert np.roots([m, kd, kp, ki * 1.03]).real.max() > 0
    for bandwidth, damping_ratio in ((-1.0, 0.7), (1.0, float("nan"))):
        with pytest.raises(ValueError, match="expected a number > 0"):
            gains_from_bandwidth(platform, bandwidth, damping_ratio)


def test_the_feedback_part_turns_the_sign_of_the_measurement() -> None:
    """Expected: F = −C y for errors, and for references and measurements; constant gains tell."""
    platform = load_preset("liu2000")
    K = np.arange(36.0).reshape(6, 6)
    errors = feedback_part(platform, LinearController(control.ss([], [], [], K, T)))
    both = feedback_part(platform, LinearController(control.ss([], [], [], np.hstack([7 * K, -K]), T)))
    assert pytest.approx(K) == errors.D
    assert pytest.approx(K) == both.D


@pytest.mark.parametrize("space", ["leg", "task"])
def test_the_feedback_part_is_what_the_law_does_to_a_measurement(space: Any) -> None:
    """Expected: minus the forces of the law in a run, for a length that is off by a little; mixed channels, no excess.

    At a pose off home, where J is neither its transpose nor that of home; a reference that stays.
    """
    rng = np.random.default_rng(9)
    A, B, C, D = (rng.uniform(-0.3, 0.3, shape) for shape in ((3, 3), (3, 18), (6, 3), (6, 18)))
    controller = LinearController(control.ss(A, B, C, D, T), space=space)
    J = np.tile(leg_jacobian(UNEVEN, *POSE), (8, 1, 1))
    part = feedback_part(UNEVEN, controller, *POSE)
    for leg in range(6):
        law = law_of(controller, T, J, np.zeros(24), np.zeros(24))
        off = rng.normal(size=8)
        measured = np.zeros((8, 24))
        measured[1:, 12 + leg] = off[1:]
        forces = np.array([law.force(k, k * T, np.zeros(30), y, np.zeros(6)) for k, y in enumerate(measured)])
        answer = control.forced_response(control_system(part), np.arange(8) * T, measured[:, 12:18].T).outputs.T
        assert answer == pytest.approx(-forces, abs=1e-12)


@pytest.mark.parametrize("space", ["leg", "task"])
def test_the_loop_is_what_goes_around_at_a_frequency(space: Any) -> None:
    """Expected: C(z) z⁻² P(z), with P of the exponential of plant, lag and hold in one matrix; every element of it."""
    tau, delay = 0.004, 2
    controller = LinearController(sampled(pid(uneven_gains()), T), space=space)
    plant = linearise(UNEVEN, *POSE, "leg_length")
    n = plant.nstates
    whole = np.zeros((n + 12, n + 12))  # plant, lags, held forces
    whole[:n, :n], whole[:n, n : n + 6] = plant.A, plant.B[:, :6]
    whole[n : n + 6, n : n + 6], whole[n : n + 6, n + 6 :] = -np.eye(6) / tau, np.eye(6) / tau
    held = expm(whole * T)[: n + 6]
    z = np.exp(1j * 30.0 * T)
    out = np.hstack([plant.C, np.zeros((6, 6))])
    P = out @ np.linalg.solve(z * np.eye(n + 6) - held[:, : n + 6], held[:, n + 6 :])
    C = control_system(feedback_part(UNEVEN, controller, *POSE))(z)
    found = loop_transfer(UNEVEN, controller, T, delay=delay, lag=tau, position=POSE[0], orientation=POSE[1])
    assert control_system(found)(z) == pytest.approx(C @ P * z**-delay, rel=1e-7, abs=1e-9)


def test_the_lag_of_the_actuators_is_in_the_loop() -> None:
    """Expected: a factor |1/(1 + iωτ)| well below half the sample rate."""
    platform, tau = load_preset("liu2000"), 0.05
    controller = LinearController(sampled(pid(Gains(1e3, 100.0)), T))
    omega = np.array([2.0, 20.0])
    with_lag, without = (response(loop_transfer(platform, controller, T, lag=lag), omega) for lag in (tau, 0.0))
    ratio = np.abs(with_lag[:, 0, 0] / without[:, 0, 0])
    assert ratio == pytest.approx(1 / np.abs(1 + 1j * omega * tau), rel=1e-2)


def test_the_states_of_lags_and_delays_are_counted() -> None:
    """Expected: 12 of the platform, 6 of the lags, 6 of each sample of delay, 6 of the PD; 300 are few enough."""
    controller = LinearController(sampled(pid(uneven_gains()), T))
    with pytest.raises(ControllerError, match=r"delay of 47 samples .* loop of 306 states; expected at most 300"):
        loop_transfer(UNEVEN, controller, T, delay=47, lag=0.02)
    with pytest.raises(ControllerError, match=r"delay of 48 samples .* loop of 306 states; expected at most 300"):
        loop_transfer(UNEVEN, controller, T, delay=48)


def test_a_controller_of_another_sample_time_is_refused() -> None:
    controller = LinearController(sampled(pid(Gains(1e3, 100.0)), T))
    with pytest.raises(ValueError, match=r"sample time is 0.001 s, the loop's 0.002 s"):
        loop_transfer(load_preset("liu2000"), controller, 2 * T)


def test_the_scaled_norm_is_the_structured_singular_value() -> None:
    """Expected: √|ab| of ((0, a), (b, 0)), and the largest element of a diagonal matrix.

    Of six channels, never below the spectral radius of any M U, U diagonal and unitary.
    """
    pairs = np.array([[[0, 100], [0.01, 0]], [[0, 3j], [12, 0]], [[2, 0], [0, -5j]]], dtype=complex)
    assert scaled_norm(pairs) == pytest.approx([1.0, 6.0, 5.0], rel=1e-9)
    rng = np.random.default_rng(8)
    M = rng.normal(size=(20, 6, 6)) + 1j * rng.normal(size=(20, 6, 6))
    scales = np.exp(2 * rng.normal(size=(20, 6)))
    badly = np.asarray(scales[:, :, None] * M / scales[:, None, :], dtype=complex)
    bound, phases = scaled_norm(badly), np.exp(2j * np.pi * rng.uniform(size=(3000, 1, 6)))
    lower = np.array([np.abs(np.linalg.eigvals(each * phases)).max() for each in M])
    assert (lower <= bound * (1 + 1e-12)).all()
    assert (bound < 1.35 * lower).all()
    # what scaling cannot change, by whatever road it comes
    assert bound == pytest.approx(scaled_norm(M), rel=0.01)
    assert (bound < np.linalg.norm(badly, 2, axis=(1, 2)) / 2).sum() > 15


@pytest.mark.parametrize("n", [1, 16, 17, 200])
def test_the_largest_scaled_norm_is_found_without_the_others(n: int) -> None:
    """Expected: the largest of all scaled norms, in its place; elsewhere bounds between scaled norm and largest.

    All are of about one size: of the 200, twenty have larger bounds after balancing than the one that is the largest.
    """
    rng = np.random.default_rng(9)
    M = rng.normal(size=(n, 6, 6)) + 1j * rng.normal(size=(n, 6, 6))
    M /= 1 + np.linalg.norm(M, 2, axis=(1, 2))[:, None, None]
    bounds, each = bounds_of_the_largest(M), scaled_norm(M)
    assert int(bounds.argmax()) == int(each.argmax())
    assert bounds.max() == each.max()
    assert (bounds >= each).all()
    assert (n <= 16) == (bounds == each).all()


def test_coulomb_friction_is_left_out_of_model_and_loop_alike() -> None:
    """Expected: its slope F/v at rest, 100 N over 1 mm/s, would damp the linear platform a hundred times over."""
    platform = load_preset("motion_base")
    slowest = modes(linearise(platform, coulomb_friction=True))[-1]
    assert slowest.eigenvalue.real < -80
    assert modes(linearise(platform))[-1].frequency < 2
    assert modes(linearise(type(platform)(**(platform.as_dict() | {"leg_coulomb_friction": 0.0}))))[-1].frequency < 2
