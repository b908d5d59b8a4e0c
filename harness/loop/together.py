"""Combine the loops of many members into one; values common to all are stored once."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.loop.actuators import Actuators
from gough_stewart.harness.loop.loop import Change, Limits, Loop
from gough_stewart.harness.loop.seeds import Seed, Seeds
from gough_stewart.harness.loop.sensors import Sensors
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants import members
from gough_stewart.harness.plants.members import PerMember


def together(loops: Sequence[Loop]) -> Loop:
    """One loop of N members from N single loops, whose clocks and `on_stroke` are the same.

    Raises
    ------
    ControllerError
        Loops that cannot be combined; names the difference.
    """
    first = loops[0]
    for what, of in _ALIKE.items():
        for k, loop in enumerate(loops):
            if of(loop) != of(first):
                raise ControllerError(
                    f"{what} of loop 0 is {of(first)!r} and of loop {k} {of(loop)!r}; expected the same for all "
                    "members of an ensemble"
                )
    return Loop(
        timing=Timing(
            first.timing.duration,
            first.timing.sample_time,
            first.timing.plant_step,
            _numbers([loop.timing.jitter for loop in loops]),
            _seeds([loop.timing.seed for loop in loops]),
        ),
        reference=_arrays([loop.reference for loop in loops]),
        feedforward=_arrays([loop.feedforward for loop in loops]),
        start_force=_arrays([loop.start_force for loop in loops]),
        sensors=Sensors(
            _by_signal([loop.sensors.noise for loop in loops]),
            _by_signal([loop.sensors.quantisation for loop in loops]),
            first.sensors.sample_time,
            _seeds([loop.sensors.seed for loop in loops]),
        ),
        actuators=Actuators(
            _numbers([loop.actuators.force_limit for loop in loops], np.inf),
            _numbers([loop.actuators.rate_limit for loop in loops], np.inf),
            _numbers([loop.actuators.lag for loop in loops]),
            _numbers([loop.actuators.delay for loop in loops]),
        ),
        limits=Limits(
            (
                _numbers([loop.limits.stroke[0] for loop in loops]),
                _numbers([loop.limits.stroke[1] for loop in loops]),
            ),
            first.limits.on_stroke,
            _numbers([loop.limits.largest_position_error for loop in loops]),
        ),
        changes=_changes(loops),
        injection=_arrays([loop.injection for loop in loops]),
        shape=(len(loops),),
    )


_ALIKE: Mapping[str, Callable[[Loop], Any]] = {
    "shape": lambda loop: loop.shape or "that of a single run",
    "duration": lambda loop: loop.timing.duration,
    "sample_time": lambda loop: loop.timing.sample_time,
    "plant_step": lambda loop: loop.timing.plant_step,
    "the sensors' sample_time": lambda loop: loop.sensors.sample_time,
    "on_stroke": lambda loop: loop.limits.on_stroke,
    "whether there is a reference": lambda loop: loop.reference is not None,
    "whether there is an injection": lambda loop: loop.injection is not None,
}


def _numbers(values: Sequence[Any], none: float = np.nan) -> PerMember:
    """One value if all are the same, or an array (N,), with a number instead of None."""
    if all(value == values[0] for value in values):
        return values[0]
    return np.array([none if value is None else value for value in values])


def _arrays(arrays: Sequence[Any]) -> Any:
    """One array, or None, if all are the same, or a stack."""
    first = arrays[0]
    if all(each is first or np.array_equal(each, first) for each in arrays):
        return first
    return members.stacked(arrays)


def _by_signal(each: Sequence[Mapping[str, PerMember]]) -> dict[str, PerMember]:
    names = dict.fromkeys(name for one in each for name in one)
    return {name: _numbers([one.get(name) or 0.0 for one in each]) for name in names}


def _seeds(seeds: Sequence[Seeds]) -> Seeds:
    """One seed if all are the same: then all have the same random numbers."""
    single: list[Seed] = [seed for seed in seeds if not isinstance(seed, tuple)]
    return single[0] if all(_key(seed) == _key(single[0]) for seed in single) else tuple(single)


def _key(seed: Seed) -> Any:
    return (seed.entropy, seed.spawn_key) if isinstance(seed, SeedSequence) else seed


def _changes(loops: Sequence[Loop]) -> tuple[Change, ...]:
    """The changes of all members, in order of time, and of each member's list at equal times.

    The i-th changes of members at a row are combined if they change the same parameters, or the wrench.
    """
    if all(loop.changes is loops[0].changes for loop in loops):
        return loops[0].changes
    kinds: dict[Any, dict[int, Change]] = {}
    for member, loop in enumerate(loops):
        of_row: dict[int, int] = {}
        for change in loop.changes:
            row = loop.timing.row(change.time, "a change")
            of_row[row] = of_row.get(row, -1) + 1
            kind = (row, of_row[row], tuple(sorted(change.parameters)), change.external_wrench is not None)
            kinds.setdefault(kind, {})[member] = change
    # by row, then by their order in each member's list
    return tuple(_one(kinds[kind], len(loops)) for kind in sorted(kinds))


def _one(changes: Mapping[int, Change], n: int) -> Change:
    """The changes of some of n members as one."""
    some = next(iter(changes.values()))
    whose = np.array([member in changes for member in range(n)])
    each = [changes.get(member, some) for member in range(n)]
    values = {name: _values([change.parameters[name] for change in each]) for name in some.parameters}
    wrench = _arrays([change.external_wrench for change in each])
    return Change(some.time, values, wrench, None if whose.all() else whose)


def _values(values: Sequence[Any]) -> Any:
    """Values of a parameter of any shape: (N, *shape), or one value if all are the same."""
    arrays = [np.asarray(value) for value in values]
    return values[0] if all(np.array_equal(each, arrays[0]) for each in arrays) else np.stack(arrays)
