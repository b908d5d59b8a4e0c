"""Members that run side by side, each with another plant, controller and loop, and the same alone."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from gough_stewart import Gains, Sample
from gough_stewart.harness.control.laws_of_members import law_of, laws_of
from gough_stewart.harness.control.linear_controller import controller_of
from gough_stewart.harness.experiment.preparation import one_or_each, one_or_stacked
from gough_stewart.harness.loop.loop import Actuators, Change, Limits, Loop, Sensors, changes_of_members
from gough_stewart.harness.loop.run import Run, simulate
from gough_stewart.harness.loop.timing import Timing
from tests.support.arrays import FloatArray
from tests.support.fake_plants import ManyMasses, Masses
from tests.support.loops import KD, KP, reference

T = 0.01
# Where a row of all measured signals has its variables.
_PLACES = {
    "position": slice(0, 3),
    "orientation": slice(3, 6),
    "velocity": slice(6, 9),
    "angular_velocity": slice(9, 12),
    "leg_length": slice(12, 18),
    "leg_velocity": slice(18, 24),
}


@dataclass
class Member:
    """One of many: its plant, its controller, its loop."""

    loop: Loop
    controller: Any
    platform_mass: float = 1.0
    fails_at: float = np.inf


def alone(member: Member) -> Run:
    """As a single run."""
    made = controller_of(member.controller)
    return simulate(
        Masses(member.platform_mass, member.fails_at),
        law_of(made, T, np.zeros((0, 6, 6))),
        member.loop,
    )


def loop_of_members(loops: Sequence[Loop]) -> Loop:
    """One loop of members whose clocks are the same; a number where all have the same, else arrays."""
    n = len(loops)

    def sizes(what: str) -> dict[str, Any]:
        names = dict.fromkeys(name for loop in loops for name in getattr(loop.sensors, what))
        return {k: one_or_each([getattr(loop.sensors, what).get(k) or 0.0 for loop in loops]) for k in names}

    return Loop(
        timing=replace(
            loops[0].timing,
            jitter=one_or_each([loop.timing.jitter for loop in loops]),
            seed=tuple(loop.timing.seed for loop in loops),  # type: ignore[misc]
        ),
        reference=one_or_stacked([loop.reference for loop in loops]),
        feedforward=one_or_stacked([loop.feedforward for loop in loops]),
        start_force=one_or_stacked([loop.start_force for loop in loops]),
        sensors=Sensors(
            sizes("noise"),
            sizes("quantisation"),
            loops[0].sensors.sample_time,
            tuple(loop.sensors.seed for loop in loops),  # type: ignore[misc]
        ),
        actuators=Actuators(
            one_or_each([loop.actuators.force_limit for loop in loops], np.inf),
            one_or_each([loop.actuators.rate_limit for loop in loops], np.inf),
            one_or_each([loop.actuators.lag for loop in loops]),
            one_or_each([loop.actuators.delay for loop in loops]),
        ),
        limits=Limits(
            (
                one_or_each([loop.limits.stroke[0] for loop in loops]),
                one_or_each([loop.limits.stroke[1] for loop in loops]),
            ),
            loops[0].limits.on_stroke,
            one_or_each([loop.limits.largest_position_error for loop in loops]),
        ),
        changes=changes_of_members([loop.changes for loop in loops], loops[0].timing),
        injection=one_or_stacked([loop.injection for loop in loops]),
        shape=(n,),
    )


def side_by_side(some: Sequence[Member]) -> Run:
    """All at once."""
    return simulate(
        ManyMasses([each.platform_mass for each in some], [each.fails_at for each in some]),
        laws_of([controller_of(each.controller) for each in some], T, np.zeros((0, 6, 6))),
        loop_of_members([each.loop for each in some]),
    )


def assert_same(many: Run, k: int, single: Run) -> None:
    """Every row and sample of a member, up to its own end; flags and outcome, too."""
    rows = len(single.time)
    at = single.sample_of_row if single.sample_of_row.ndim == 1 else single.sample_of_row[:, 0]
    samples = int(at[-1]) + 1
    assert many.outcomes[k].status == single.outcomes[0].status
    assert many.outcomes[k].time == single.outcomes[0].time
    np.testing.assert_array_equal(many.of_member(k).time, single.time)
    for name, n in (("results", rows), ("inputs", rows), ("command", samples), ("controller_state", samples)):
        found, expected = getattr(many, name)[:n, k], getattr(single, name)[:n]
        expected = expected.reshape(found.shape)
        np.testing.assert_array_equal(found, expected)
    assert many.used
    for signal in many.used:
        part = _PLACES[signal]
        found, expected = many.measured[:samples, k, part], single.measured[:samples].reshape(samples, -1)[:, part]
        np.testing.assert_array_equal(found, expected)
    for name, n in (("rate_limited", rows), ("stroke_exceeded", rows), ("force_limited", samples)):
        found, expected = getattr(many, name)[:n, k], getattr(single, name)[:n]
        np.testing.assert_array_equal(found, expected.reshape(found.shape))
    whose = many.sample_of_row[:rows] if many.sample_of_row.ndim == 1 else many.sample_of_row[:rows, k]
    np.testing.assert_array_equal(whose, at)


def law_of_member(k: int) -> Any:
    """A function, exact to the last bit in one and in many: elementwise, with gains of its own."""

    def law(sample: Sample) -> FloatArray:
        error = sample.reference["leg_length"] - sample.measured["leg_length"]
        rate = sample.reference["leg_velocity"] - sample.measured["leg_velocity"]
        return np.asarray((1 + 0.1 * k) * KP * error + (1 - 0.05 * k) * KD * rate)

    return law


def gains_of_member(k: int, integral: bool = True) -> Gains:
    """Of six unequal channels, other ones for each member."""
    return Gains((1 + 0.1 * k) * KP, (1 - 0.05 * k) * KD, ((20 - k) * KP / 10) if integral else 0.0)


def member_of(k: int, controller: Any, features: Sequence[str] = ()) -> Member:
    """Member k, in whom everything is another that the features name."""
    on = set(features)
    rng = np.random.default_rng(k)
    timing = Timing(
        0.3, T, 0.002, jitter=(0.004 + 0.0015 * (k % 3)) * ("jitter" in on), seed=SeedSequence(5, spawn_key=(k,))
    )
    wanted = reference(timing.times) if "references" not in on else reference(timing.times * (1 + 0.1 * k))
    samples = len(timing.samples)
    loop = Loop(
        timing,
        wanted,
        feedforward=(1 + k) * rng.normal(size=(samples, 6)) if "feedforward" in on else np.zeros((samples, 6)),
        start_force=rng.normal(size=6) if "start" in on else np.zeros(6),
        sensors=Sensors(
            {"leg_length": 1e-4 * (k % 4), "leg_velocity": 1e-3} if "noise" in on else {},
            {"leg_length": 1e-4 * (1 + k % 2), "position": 1e-4 * (k % 2)} if "quantisation" in on else {},
            0.006 if "encoders" in on else None,
            seed=SeedSequence(5, spawn_key=(k,)),
        ),
        actuators=Actuators(
            (3.0 + k if k % 3 else None) if "force_limit" in on else None,
            (200.0 + 50 * k if k % 2 else None) if "rate_limit" in on else None,
            0.003 * (k % 3) if "lag" in on else 0.0,
            (k % 3) if "delays" in on else 1,
        ),
        limits=Limits((0.5, 1.75), "warn", 0.5),
        changes=(
            Change(0.1 + 0.02 * (k % 3), {"platform_mass": 1.5 + 0.1 * k}),
            Change(0.1, external_wrench=(1.0 + k) * np.arange(6.0)),
            Change(0.1 + 0.1 * (k % 2), {"platform_mass": 1.2}, external_wrench=-np.arange(6.0)),
        )[: k % 4]
        if "changes" in on
        else (),
        injection=rng.normal(size=(samples, 6)) if "injection" in on else None,
    )
    return Member(loop, controller, 1 + 0.07 * k)


FEATURES = [
    "jitter", "references", "feedforward", "start", "noise", "quantisation", "encoders", "force_limit", "rate_limit",
    "lag", "delays", "changes", "injection",
]  # fmt: skip
