"""The sampled loop, on a plant with a closed form and against python-control's discrete feedback."""

from dataclasses import replace

import control
import numpy as np
import pytest

from gough_stewart.harness.control.python.sample import Sample
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.loop.loop import Actuators, Change, Limits, OnStroke
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.plants import signals
from gough_stewart.model import interface
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


def test_what_is_recorded_of_the_controller_is_its_recursion() -> None:
    """Expected: with x of the record, C x + D e is the command and A x + B e the next x, e of reference and record."""
    system = pd(0.01)
    run = run_with(system, loop_of())
    error = reference(run.time[:-1:5])[:, LENGTH] - run.measured[:, LENGTH]
    at = signals.positions(run.used)
    assert run.used == ("leg_length",)
    assert run.measured[:, at] == pytest.approx(run.results[:-1:5, at], abs=0)
    assert run.command == pytest.approx(run.controller_state @ system.C.T + error @ system.D.T, abs=1e-9)
    assert run.controller_state[1:] == pytest.approx(
        run.controller_state[:-1] @ system.A.T + error[:-1] @ system.B.T, abs=1e-9
    )


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


def test_a_failed_step_ends_the_run_with_its_cause() -> None:
    """Expected: rows up to the last good state, the plant's words; 0.1 s are 50 steps."""
    run = run_with(constant(), loop_of(), Masses(fails_at=0.1))
    assert run.outcome.status == "diverged"
    assert run.outcome.time == run.time[-1] == pytest.approx(0.1)
    assert "collapsed" in str(run.outcome.cause)
    for rows in (run.time, run.results, run.inputs, run.rate_limited, run.stroke_exceeded, run.sample_of_row):
        assert len(rows) == 51


@pytest.mark.parametrize("leg", [0, 3, 5])
@pytest.mark.parametrize("value", [np.nan, -np.inf])
def test_a_force_that_is_not_finite_ends_the_run_before_it_acts(leg: int, value: float) -> None:
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


@pytest.mark.parametrize("force", [1e31, -1e308])
def test_a_force_that_no_plant_takes_ends_the_run_before_it_acts(force: float) -> None:
    """Expected: the same outcome whatever the plant is; an FMU would refuse it, and the model fail in its step."""
    run = run_with(lambda s: np.append(FORCES[:5], force if s.time > 0.095 else FORCES[5]), loop_of())
    assert run.outcome.status == "diverged"
    assert f"{force!r}" in str(run.outcome.cause)
    assert run.time[-1] == pytest.approx(0.1)
    assert (run.inputs[:, :6] == FORCES).all()


def test_a_platform_that_has_left_its_reference_ends_the_run() -> None:
    """Expected: the first row whose distance, of all three components, is above the bound."""
    free = run_with(constant(), loop_of(2.0))
    distance = np.linalg.norm(reference(free.time)[:, :3] - free.results[:, :3], axis=1)
    bound = 0.5 * distance.max()
    first = int((distance > bound).argmax())
    assert 100 < first < 1000
    run = run_with(constant(), loop_of(2.0, limits=Limits(largest_position_error=bound)))
    assert run.outcome.status == "diverged"
    assert run.outcome.time == run.time[-1] == free.time[first]
    assert f"is {distance[first]:.3g} m from its reference; the limit is {bound:g} m" in str(run.outcome.cause)


def test_a_platform_at_the_very_bound_goes_on() -> None:
    """Expected: √(0.375² + 0.5²) = 0.625, without rounding, is not beyond 0.625."""
    loop = loop_of(0.1, wants=True)
    assert loop.reference is not None
    loop.reference[:, :3] = [0.375, -0.5, 0.0]
    for bound, status in ((0.625, "completed"), (0.6249, "diverged")):
        plant = Masses()
        plant.x[:] = 0.0
        loop = replace(loop, limits=Limits(largest_position_error=bound))
        assert run_with(constant(np.zeros(6)), loop, plant).outcome.status == status


def test_a_position_that_is_not_a_number_is_no_longer_at_its_reference() -> None:
    plant = Masses()
    plant.x[4] = np.nan
    run = run_with(constant(), loop_of(limits=Limits(largest_position_error=1e9)), plant)
    assert (run.outcome.status, len(run.time)) == ("diverged", 1)


@pytest.mark.parametrize(("stroke", "leg"), [((0.5, 1.62), 5), ((0.75, 9.0), 3), ((0.0, 1.31), 2)])
def test_the_stroke_warns_or_stops(stroke: tuple[float, float], leg: int) -> None:
    """Expected: L₀ + F t²/(2 m) beyond either end; flags from there on, or the end at the first such row.

    Leg 5 is 1.6 m long at the start, and leaves [0.5, 1.62] with a force of 1.3 N.
    """
    force = FORCES * [1, 1, -1, 1, -1, 1]
    start = LENGTHS.copy()
    plants = Masses(), Masses(), Masses()
    if leg == 2:
        for plant in plants:
            plant.x[4] = start[4] = 0.7  # out of the way
        force[1] = 0.7
    ways: tuple[OnStroke, ...] = ("ignore", "warn", "stop")
    ignored, warned, stopped = (
        run_with(constant(force), loop_of(1.0, limits=Limits(stroke, how)), plant)
        for how, plant in zip(ways, plants, strict=True)
    )
    length = start + force / MASSES * warned.time[:, None] ** 2 / 2
    beyond = (length < stroke[0]) | (length > stroke[1])
    assert (warned.stroke_exceeded == beyond).all()
    assert (ignored.stroke_exceeded == beyond).all()
    assert warned.outcome.status == ignored.outcome.status == "completed"
    first = int(beyond.any(axis=1).argmax())
    assert first > 10
    assert stopped.outcome.status == "stopped"
    assert stopped.outcome.time == stopped.time[-1] == warned.time[first]
    assert f"leg {leg} is {length[first, leg - 1]:.6g} m long; its stroke is {stroke[0]:g}" in str(
        stopped.outcome.cause
    )


def test_a_leg_at_its_very_limit_is_within_its_stroke() -> None:
    limits = Limits((0.8, 1.6))
    assert not limits.beyond_stroke(LENGTHS).any()
    assert limits.beyond_stroke(LENGTHS * 1.001).tolist() == [False] * 4 + [True, False]
    assert limits.beyond_stroke(LENGTHS * 0.999).tolist() == [False] * 2 + [True] + [False] * 3


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


def test_a_function_sees_reference_and_measurement_by_name() -> None:
    """Expected: at every sample the reference and the plant of that time, under the interface's names."""
    seen: list[Sample] = []

    def law(sample: Sample) -> FloatArray:
        seen.append(sample)
        return FORCES

    loop = loop_of(0.1)
    run = run_with(law, loop)
    assert [sample.time for sample in seen] == pytest.approx(0.01 * np.arange(10), abs=1e-15)
    accelerations = tuple(interface.BY_NAME[name] for name in ("acceleration", "angular_acceleration"))
    for sample, wanted, actual in zip(seen, reference(run.time[:-1:5]), run.results[:-1:5], strict=True):
        assert list(sample.measured) == list(signals.NAMES)
        assert np.concatenate(list(sample.measured.values())) == pytest.approx(actual[:24], abs=0)
        assert np.concatenate(list(sample.reference.values())) == pytest.approx(wanted, abs=1e-15)
        assert list(sample.reference) == [*signals.NAMES, *(v.name for v in accelerations)]


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


def test_a_function_that_fails_in_mid_run_ends_it_with_its_words() -> None:
    """Expected: an outcome with kind, text and time, and the rows before."""

    def failing(sample: Sample) -> FloatArray:
        if sample.time > 0.095:
            raise RuntimeError("no more")
        return FORCES

    run = run_with(failing, loop_of())
    assert run.outcome.status == "stopped"
    assert "failed at time 0.1 s with RuntimeError: no more" in str(run.outcome.cause)
    assert len(run.time) == 50
    assert run.outcome.time == run.time[-1]


def test_a_change_between_two_rows_is_refused() -> None:
    with pytest.raises(ControllerError, match=r"a change at 0.105 s.*multiple of the plant_step of 0.002 s"):
        run_with(constant(), loop_of(changes=(Change(0.105),)))
