"""The pilot of an ensemble: eight machines run first to find the number of substeps that all members use.

They are the nominal one and seven drawn by the seed, whatever the number of members and their sampling, so that each
member has the same substeps in any ensemble of the experiment, in a search, and alone. No code of the user is called:
in the place of a controller in Python runs a stand-in, which follows the reference.
"""

from dataclasses import replace
from math import ceil, pi

import numpy as np

from gough_stewart.harness.control.feedforward import feedforward
from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.linear import leg_space_mass
from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.batch import LANES, Batch
from gough_stewart.harness.experiment.distinct import Distinct
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.stages import Planned
from gough_stewart.harness.loop.actuators import Actuators
from gough_stewart.harness.loop.observe import observe_all
from gough_stewart.harness.loop.rows import Observer, Rows
from gough_stewart.harness.motion.motion import end_of
from gough_stewart.harness.plants.lanes import substeps_for
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# How many machines the pilot tries to find some that can run.
_AMONG = 64
_TRIES = 6
# The stand-in's natural frequency [rad/s], at most, and times the sample time: far from the limit of stability, 2.
_FASTEST, _FASTEST_A_SAMPLE = 2 * pi * 3, 0.3


def substeps_of(members: Members) -> int:
    """The number of substeps that the pilot needs for the experiment's tolerance.

    Raises
    ------
    ExperimentError
        No member is possible.
    PlantError, ReachError, ControllerError
        The machines cannot be run.
    """
    plant, batch = members.nominal.plant, pilots(members)
    if plant.fixed_step_size:
        return max(1, ceil(batch.timing[0].plant_step / plant.fixed_step_size - 1e-9))
    batch = stand_in(batch)
    substeps = 1
    for _ in range(_TRIES):
        running = batch.in_parallel(substeps)
        with running.plant:
            observe_all(running.plant, running.law_from, running.loop, _Nothing())
            error = float(np.max(running.plant.integration_error))
        if not np.isfinite(error):
            substeps *= 4
            continue
        needed = substeps_for(error, substeps, members.choice.tolerance)
        if needed <= substeps:
            break
        substeps = needed
    return substeps


def pilots(members: Members) -> Batch:
    """The nominal machine and the first of those drawn that can run, enough for one vector.

    Raises
    ------
    ExperimentError
        None of the machines tried can run, nor any of the first members.
    """
    for drawn in (LANES, 2 * LANES, 4 * LANES, _AMONG):
        values = members.independent_draws(0, drawn).values
        found = members.prepared_with([{}, *values], [None, *range(drawn)])  # what varies may be what the nominal lacks
        if len(found.batch) >= LANES:
            break
    if not found.numbers.any():
        first = members.prepared(0, min(members.count, _AMONG))
        if not len(first.batch):
            raise ExperimentError(
                members.nominal.where,
                "ensemble",
                f"none of the first {len(first.errors)} members is possible; the first: {first.reasons[0]}",
            )
        found = found if len(found.batch) else first
    return found.batch.take(range(min(len(found.batch), LANES)))


def stand_in(batch: Batch) -> Batch:
    """Members with a linear controller in the place of one in Python; any other members as they are.

    F = F_ct + M_leg (ωn² e_k + 2 ωn (e_k − e_{k−1})/T), with e the measured error of the leg lengths, M_leg the mass
    matrix seen by the legs at home and F_ct the computed torque, both of the nominal model; ωn is 2π · 3 Hz, or 0.3/T
    if that is less. It acts without the delay and the drives of the experiment, so that it is stable: the machine
    follows the reference, starts with the forces of a wrong model, and hears the sensors' noise, as with most
    controllers. These set the speed that the substeps have to resolve.
    """
    if all(each is None or isinstance(each, LinearController | UnitController) for each in batch.controller):
        return batch
    timing = batch.timing[0]
    T = timing.sample_time
    omega = min(_FASTEST, _FASTEST_A_SAMPLE / T)

    def linear(platform: Platform) -> LinearController:
        M = leg_space_mass(platform)
        P, D = omega**2 * M, 2 * omega / T * M
        return LinearController(StateSpace(np.zeros((6, 6)), np.eye(6), -D, P + D, T))  # its state is the error before

    def forces(platform: Platform, planned: Planned | None) -> FloatArray:
        assert planned is not None  # a controller has a reference
        middles = np.minimum(timing.samples + T / 2, end_of(planned.reference))
        return feedforward("computed_torque", platform, planned.reference(middles))

    return replace(
        batch,
        feedforward=Distinct.among([forces(*each) for each in zip(batch.platform, batch.planned, strict=True)]),
        actuators=batch.actuators.map(lambda each: Actuators(each.force_limit)),
        controller=batch.platform.map(linear),
    )


class _Nothing(Observer):
    def block(self, rows: Rows) -> None:
        pass
