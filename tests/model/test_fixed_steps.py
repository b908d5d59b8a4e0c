"""Fixed steps with bristles. Expected: closed forms of one mass, the textbook's equations by SciPy, smaller steps."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gough_stewart.model import fixed_steps
from gough_stewart.model.errors import StepError
from gough_stewart.model.fixed_steps import Gripped, fixed_step
from gough_stewart.model.kernel import Kernel
from gough_stewart.model.stepping import SteppingModel
from gough_stewart.model.variant import Variant
from gough_stewart.model.vectors import FloatArray
from tests.support.one_mass import FC, S0, S1, gripped_mass, printed_rates
from tests.support.real_platforms import gripped, real_platform

ELASTO_PLASTIC, LUGRE = 1.0, 2.0


def after(system: Gripped, start: Any, steps: int, h: float) -> FloatArray:
    x = np.array(start, dtype=float)
    rate = system.derivatives(x)
    for _ in range(steps):
        x, rate = fixed_step(system, x, rate, h)
    return x


@pytest.mark.parametrize("model", [ELASTO_PLASTIC, LUGRE])
@pytest.mark.parametrize("force", [lambda t: 2.5 + 0 * t, lambda t: 12.0 * np.sin(25.0 * t)])
def test_steps_of_1_ms_move_a_mass_as_the_textbook_says(model: float, force: Any) -> None:
    """It breaks loose, to 0.7 m/s; the sine reverses it 4 times, at 12 m/s2. Expected: SciPy's LSODA at 1e-11."""
    found = after(gripped_mass(model, lambda x: force(x[3])), [0, 0, 1e-17, 0], 500, 1e-3)
    rates, end = printed_rates(model == LUGRE, force), float(found[3])
    atol: Any = [1e-13, 1e-13, 1e-16]
    expected = solve_ivp(rates, (0, end), [0, 0, 0], "LSODA", rtol=1e-11, atol=atol, max_step=1e-3).y[:, -1]
    assert np.abs(expected[1]) > 0.01
    assert found[0] == pytest.approx(expected[0], abs=2e-6)


@pytest.mark.parametrize("speed", [0.3, 1.0])
@pytest.mark.parametrize("model", [ELASTO_PLASTIC, LUGRE])
def test_a_mass_that_slides_before_its_bristle_bends_gives_it_its_momentum(model: float, speed: float) -> None:
    """Closed form: from then on it has lost σ1 z + F_c (t − τ), where τ is the time in which the bristle bends.

    ∫ (z_ss − z) ds = z_ss² over the path s of a bristle with LuGre's law, so τ = z_ss/v; less with the elastic range.
    """
    found = after(gripped_mass(model, lambda x: 0.4 * x[1]), [0, speed, 0, 0], 3, 1e-3)
    bent = FC / S0
    assert found[2] == pytest.approx(bent, rel=1e-9)
    lost = S1 * bent + FC * (found[3] - bent / speed)
    # of the time in which it bends, with its speed; and what the elastic range takes from τ, about a half
    bound = 0.02 * FC * bent / speed if model == LUGRE else 0.7 * FC * bent / speed
    assert speed - found[1] == pytest.approx(lost, abs=bound)


def test_it_has_order_4_while_a_leg_slides(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the errors of undivided steps fall by 2⁴, up to 180 time constants of the bristle in a step."""
    monkeypatch.setattr(fixed_steps, "RESOLUTION", 1.0)
    system = gripped_mass(LUGRE, lambda x: 30 * np.cos(40 * x[3]))
    start = [0.0, 0.9, FC / S0, 0.0]
    exact = after(system, start, 512, 0.016 / 512)
    errors = [np.abs(after(system, start, n, 0.016 / n) - exact)[:2].max() for n in (8, 16, 32)]
    assert errors[0] < 2e-6
    assert min(errors[0] / errors[1], errors[1] / errors[2]) > 12


def test_a_reversal_has_order_2(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the largest errors over 8 phases of a step fall by 2² and more, of undivided steps."""
    monkeypatch.setattr(fixed_steps, "RESOLUTION", np.inf)
    system = gripped_mass(LUGRE, lambda _: -3.0)
    worst = []
    exact = [after(system, [0.0, 2e-3 + 6e-5 * k, FC / S0, 0.0], 512, 2e-3 / 512) for k in range(8)]
    for n in (16, 32, 64):
        found = [after(system, [0.0, 2e-3 + 6e-5 * k, FC / S0, 0.0], n, 2e-3 / n) for k in range(8)]
        worst.append(np.abs(np.array(found) - exact)[:, 1].max())
    assert np.sqrt(worst[0] / worst[2]) > 3.5


@pytest.mark.parametrize("model", [ELASTO_PLASTIC, LUGRE])
def test_a_perturbed_bristle_returns(model: float) -> None:
    """Expected: a relative perturbation of 1e-12 does not grow; an unstable scheme rests on its fixed point without."""
    system = gripped_mass(model, lambda x: 4.0 + 0.4 * x[1])
    start = np.array([0.0, 0.8, FC / S0, 0.0])
    ends = [after(system, start * [1, 1, 1 + nudge, 1], 60, 1e-3) for nudge in (0.0, 1e-12, -1e-12)]
    assert ends[1] == pytest.approx(ends[0], rel=1e-12, abs=1e-16)
    assert ends[2] == pytest.approx(ends[0], rel=1e-12, abs=1e-16)


@pytest.mark.parametrize("springs", [False, True])
@pytest.mark.parametrize("friction", ["elasto_plastic", "lugre"])
def test_an_uneven_platform_moves_at_1_ms_as_under_error_control(friction: str, springs: bool) -> None:
    """Legs start with straight bristles at 0.1 m/s, break loose and reverse. Expected: the model at 1e-9."""
    platform = real_platform(friction, springs)
    model, kernel = SteppingModel(platform, 1e-9), Kernel(Variant.of(platform))
    model.set_many({"velocity": [0.06, -0.04, 0.1], "angular_velocity": [0.05, 0.1, -0.08]})
    x = model.state
    for k in range(40):
        waves = 60.0 * np.sin(60e-3 * k * np.arange(1.0, 7.0) + np.arange(6))
        inputs = np.concatenate([platform.home_actuator_force + waves, [3.0, -2.0, 5.0, 0.3, 0.1, -0.2]])
        model.set_inputs(inputs)
        model.do_step(1e-3 * k, 1e-3)
        x = after(gripped(kernel, platform, inputs), x, 1, 1e-3)
    np.testing.assert_allclose(x[:6], model.state[:6], rtol=0, atol=1e-6)


def test_legs_that_give_ring_after_a_jump_of_the_force() -> None:
    """Modes with a period of 2.8 steps, which RK4 damps within some. Expected: the motors of the model at 1e-9."""
    platform = real_platform("elasto_plastic", True, leg_armature=0.8)
    model, kernel = SteppingModel(platform, 1e-9), Kernel(Variant.of(platform))
    inputs = np.zeros(12)
    inputs[:6] = platform.home_actuator_force + 300 * np.array([1, -0.5, 0.7, 1.2, -0.8, 0.9])
    model.set_inputs(inputs)
    system, x, h = gripped(kernel, platform, inputs), model.state, 9e-4
    for k in range(8):
        model.do_step(k * h, h)
        x = after(system, x, 1, h)
        assert x[24:] == pytest.approx(model.state[24:], abs=1e-3)
    assert np.abs(model.state[24:]).max() > 0.3


def test_what_it_cannot_resolve_is_refused_with_a_step_that_it_can(monkeypatch: pytest.MonkeyPatch) -> None:
    """A leg at 1 m/s with a straight bristle takes 20 substeps: 8 reach a part of the step, which is not refused."""
    monkeypatch.setattr(fixed_steps, "MOST_SUBSTEPS", 8)
    system, start = gripped_mass(ELASTO_PLASTIC, lambda _: 0.0), np.array([0.0, 1.0, 0.0, 0.0])
    with pytest.raises(StepError, match=r"do not resolve a step of 0\.001 s; expected at most") as refused:
        fixed_step(system, start, system.derivatives(start), 1e-3)
    possible = float(str(refused.value).rsplit("at most ", 1)[1].split()[0])
    assert 1e-6 < possible < 1e-4
    fixed_step(system, start, system.derivatives(start), possible)


def test_what_diverges_is_refused() -> None:
    """No step passes a pole."""
    plain = gripped_mass(LUGRE, lambda _: 0.0)
    pole = plain._replace(derivatives=lambda x: np.array([np.inf if x[3] > 5e-4 else 0.0, 0.0, 0.0, 1.0]))
    with np.errstate(all="ignore"), pytest.raises(StepError, match=r"expected at most 0\.0005 s"):
        fixed_step(pole, np.zeros(4), np.array([0.0, 0, 0, 1]), 1e-3)


@pytest.mark.parametrize("share", [0.05, 1 / 6, 0.3, 0.5, 0.8])
def test_the_error_of_a_reversal_is_that_of_simpsons_rule_over_a_kink(share: float) -> None:
    """Expected: at least that for max(0, a (t − τ)), by the rule and by the exact integral; equal in the middle.

    Where v = s (t − τ) crosses 0, d z = |v| z/z_ss, so its slope jumps by a = 2 s |z|/z_ss.
    """
    h, slope, reach = 1e-3, 7.0, FC / S0
    before, after = -slope * share * h, slope * (1 - share) * h
    grip = gripped_mass(LUGRE, lambda _: 0.0).grip(np.array([0.0, 1.0, 0.0, 0.0]))
    z = np.full(1, 0.6 * reach)

    def at(v: float) -> Any:
        return grip._replace(decay=np.full(1, abs(v) / reach), sliding=np.full(1, v))

    system = Gripped(np.asarray, lambda _: at(after), lambda _: np.full(1, after), slice(0, 1), slice(1, 2))
    a = 2 * slope * z[0] / reach
    rule = h / 6 * (4 * a * max(0.0, h / 2 - share * h) + a * (h - share * h))
    exact = a * (h - share * h) ** 2 / 2
    (found,) = fixed_steps.reversal(system, at(before), z, z, h)
    assert found >= 0.999 * abs(rule - exact)
    assert found == pytest.approx(a * h**2 * share * (1 - share) / 6, rel=1e-12)
    if share == 0.5:
        assert found == pytest.approx(abs(rule - exact), rel=1e-12)
