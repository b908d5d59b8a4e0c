"""Members are looked at together only if the same acts on their loops at the same times."""

import numpy as np

from gough_stewart.harness.ensemble.chunk import LegErrors, oscillations
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.loop.rows import Outcome
from tests.support.uneven_loops import experiment_of


def test_members_with_other_times_of_changes_are_judged_apart() -> None:
    """Expected: of two members with the same sine of 23 Hz, the one that is at rest from 0.1 s on oscillates.

    The other changes at 1.9 of 2 s: what follows is too short to tell, and it is the first of its reference.
    """
    ensemble = {"change": {"1": {"at": {"grid": ["1.9 s", "0.1 s"]}}}, "members": 2}
    change = [{"at": 0.1, "factors": {"platform_mass": 1.2}}]
    loop = {"duration": 2.0, "sample_time": "5 ms"}
    experiment = experiment_of("pd", loop=loop, change=change, ensemble=ensemble)
    batch = Members(experiment).prepared(0, 2).batch
    times = [batch.member(k).loop.changes[0].time for k in range(2)]
    assert sorted(times) == [0.1, 1.9]
    late = times.index(1.9)
    batch = batch.take([late, 1 - late])
    kept = LegErrors(batch.timing)
    kept.start(2)
    wave = 1e-3 * np.sin(2 * np.pi * 23 * kept.time)
    kept.errors[:, 2, :] = wave[:, None]
    completed = [Outcome("completed", 2.0, None)] * 2
    first, second = oscillations(batch, completed, kept)
    assert first is None
    assert second is not None
    assert second.frequency is not None
    assert abs(second.frequency - 23) < 0.5
