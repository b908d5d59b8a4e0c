"""The sampled loop, on a plant with a closed form and against python-control's discrete feedback."""

import control
import numpy as np
import pytest

from gough_stewart.harness.control.makers import Sample
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.loop.loop import Actuators, Change
from gough_stewart.harness.loop.run import simulate
from gough_stewart.model.vectors import FloatArray
from tests.support.fake_plants import LENGTH, LENGTHS, MASSES, VELOCITY, Masses, signals_of
from tests.support.loops import FORCES, constant, loop_of, pd, pd_channel, reference, run_with

SOME = np.random.default_rng(0).normal(size=(50, 6))


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_the_loop_is_python_controls_discrete_feedback(delay: int) -> None:
    """Expected: response of feedback(z⁻ᵈ C(z) P(z)) to the reference, P(z) the zero-order hold of 1/(m s²), leg by leg.

    The plant makes five steps a sample; the reference begins where the plant is, so that nothing jumps.
    """
    T = 0.01
    run = run_with(pd(T), loop_of(1.0, T, actuators=Actuators(delay=delay)))
    time = np.arange(101) * T
    wanted = reference(time)[:, LENGTH] - LENGTHS
    late = control.ss(control.tf([1], [1] + [0] * delay, T))
    for leg in range(6):
        plant = control.sample_system(control.ss([[0, 1], [0, 0]], [[0], [1 / MASSES[leg]]], [[1, 0]], 0), T)
        closed = control.feedback(control.series(control.ss(pd_channel(leg, T)), late, plant), 1)
        expected = control.forced_response(closed, time, wanted[:, leg]).outputs
        assert run.results[::5, 12 + leg] - LENGTHS[leg] == pytest.approx(expected, abs=1e-12)


def test_the_plant_step_changes_nothing_but_the_rows() -> None:
    """Expected: forces are held between samples, so that finer steps of an exact plant end in the same place."""
    coarse, fine = (run_with(pd(0.01), loop_of(plant_step=step)) for step in (0.01, 0.001))
    assert np.abs(coarse.results - fine.results[::10]).max() < 1e-11
    assert len(fine.time) == 501
    held = fine.inputs[:-1, :6].reshape(50, 10, 6)
    assert (held == held[:, :1]).all()
    assert (fine.sample_of_row == np.append(np.repeat(np.arange(50), 10), 49)).all()


def test_a_row_has_the_accelerations_of_the_forces_that_act_from_there_on() -> None:
    """Expected: F/m of the row's own forces, beside lengths and velocities before them."""
    run = run_with(pd(0.01), loop_of())
    expected = signals_of(run.results[:, LENGTH], run.results[:, VELOCITY], run.inputs[:, :6] / MASSES)
    assert run.results[:, :30] == pytest.approx(expected, abs=1e-12)
    assert run.results[1:, VELOCITY] - run.results[:-1, VELOCITY] == pytest.approx(
        0.002 * run.inputs[:-1, :6] / MASSES, abs=1e-12
    )


def test_command_is_law_and_feedforward_and_injection() -> None:
    """Expected: their sum, different in every leg and sample; without a law the rest alone."""
    feedforward, injection = SOME, np.roll(SOME, 7)
    loop = loop_of(feedforward=feedforward, injection=injection)
    run = run_with(constant(), loop)
    assert run.command == pytest.approx(FORCES + feedforward + injection, abs=1e-14)
    assert run.inputs[:-1:5, :6] == pytest.approx(run.command, abs=0)
    open_loop = simulate(Masses(), None, loop_of(feedforward=feedforward, wants=False))
    assert open_loop.inputs[:-1:5, :6] == pytest.approx(feedforward, abs=0)
    assert open_loop.controller_state.shape == (50, 0)
    assert open_loop.outcome == ("completed", 0.5, None)


def test_changes_come_into_effect_at_their_row() -> None:
    """Expected: a = F/m halves where m doubles; a wrench is an input from its time on, until the next one."""
    first, second = np.arange(1.0, 7), -np.arange(6.0)
    changes = (
        Change(0.1, {"platform_mass": 2.0}),
        Change(0.104, external_wrench=first),
        Change(0.202, {"platform_mass": 4.0}, second),
        Change(0.3, external_wrench=first),
    )
    run = run_with(constant(), loop_of(0.3, changes=changes))
    t = run.time[:-1, None] + 1e-9
    factor = np.where(t < 0.1, 1, np.where(t < 0.202, 2, 4))
    assert np.diff(run.results[:, VELOCITY], axis=0) == pytest.approx(0.002 * FORCES / MASSES / factor, abs=1e-12)
    t = run.time[:, None] + 1e-9
    wrench = np.where(t < 0.104, 0.0, np.where(t < 0.202, first, np.where(t < 0.3, second, first)))
    assert (run.inputs[:, 6:] == wrench).all()


def test_changes_at_one_time_all_come_in_their_order() -> None:
    one, two = np.full(6, 1.0), np.full(6, 2.0)
    changes = (Change(0.0, external_wrench=one), Change(0.0, {"platform_mass": 3.0}), Change(0.0, external_wrench=two))
    run = run_with(constant(), loop_of(0.1, changes=changes))
    assert (run.inputs[:, 6:] == two).all()
    assert run.results[-1, VELOCITY] == pytest.approx(0.1 * FORCES / MASSES / 3)


@pytest.mark.parametrize("leg", [0, 3, 5])
@pytest.mark.parametrize("value", [np.nan, -np.inf, 1e31])
def test_a_force_that_is_no_number_or_too_large_ends_the_run_before_it_acts(leg: int, value: float) -> None:
    """Expected: the row is kept with the forces before, the command as it was."""

    def breaking(sample: Sample) -> FloatArray:
        force = FORCES.copy()
        force[leg] = value if sample.time > 0.095 else force[leg]
        return force

    run = run_with(breaking, loop_of())
    assert run.outcome.status == "diverged"
    assert str(value) in str(run.outcome.cause)
    assert run.outcome.time == run.time[-1] == pytest.approx(0.1)
    assert (run.inputs[:, :6] == FORCES).all()
    assert run.command[10] == pytest.approx(np.where(np.arange(6) == leg, value, FORCES), nan_ok=True)
    assert not run.force_limited.any()
    first = run_with(constant(np.full(6, value)), loop_of())
    assert len(first.time) == 1
    assert first.outcome.time == 0


def test_ctrl_c_keeps_what_ran_so_far() -> None:
    """Expected: all rows up to the interruption, which comes with the first report after 0.5 s."""

    def interrupt(time: float) -> None:
        if time > 0.5:
            raise KeyboardInterrupt

    run = run_with(constant(), loop_of(2.0), progress=interrupt)
    assert run.outcome.status == "interrupted"
    assert run.outcome.time == run.time[-1]
    assert 0.5 < run.time[-1] < 0.7
    assert len(run.results) == len(run.time)


def test_progress_tells_the_time_now_and_then() -> None:
    told: list[float] = []
    run_with(constant(), loop_of(1.0), progress=told.append)
    assert told[0] == 0
    assert 4 < len(told) < 20
    assert np.diff(told) == pytest.approx(told[1])
    assert told[-1] > 0.8


def test_what_fails_before_the_first_row_is_an_error() -> None:
    """Expected: nothing to keep, so that errors and Ctrl-C go on as they are."""
    with pytest.raises(ControllerError, match="time 0 s; expected 6 forces"):
        run_with(lambda _sample: None, loop_of())

    def interrupt(_sample: Sample) -> list[float]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_with(interrupt, loop_of())


def test_a_controller_without_a_reference_is_refused() -> None:
    with pytest.raises(ControllerError, match="reference"):
        run_with(constant(), loop_of(wants=False))


def test_what_a_law_does_to_its_sample_changes_nothing() -> None:
    def careless(sample: Sample) -> FloatArray:
        for values in (*sample.reference.values(), *sample.measured.values()):
            values[:] = np.nan
        return FORCES

    loop = loop_of(0.1)
    careful = run_with(constant(), loop)
    assert run_with(careless, loop).results == pytest.approx(careful.results, abs=0)
