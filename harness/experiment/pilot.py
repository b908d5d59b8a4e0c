"""The pilot of an ensemble: eight machines run first to find the number of substeps that all members use.

They are the nominal one and seven drawn by the seed, whatever the number of members and their sampling, so that each
member has the same substeps in any ensemble of the experiment, in a search, and alone. No code of the user is called:
in the place of a controller in Python runs a stand-in, which follows the reference.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import ceil, pi

import numpy as np

from gough_stewart.harness.control.feedforward import feedforward
from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.linear import leg_space_mass
from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.batch import LANES, batch_of, prepared_members
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.loop.actuators import Actuators
from gough_stewart.harness.loop.observe import observe_all
from gough_stewart.harness.loop.rows import Observer, Rows
from gough_stewart.harness.motion.motion import end_of
from gough_stewart.harness.plants.lanes import substeps_for
from gough_stewart.model.errors import GoughStewartError

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
    plant, prepared = members.nominal.plant, pilots(members)
    if plant.fixed_step_size:
        return max(1, ceil(prepared[0].loop.timing.plant_step / plant.fixed_step_size - 1e-9))
    prepared = [stand_in(each) for each in prepared]
    substeps = 1
    for _ in range(_TRIES):
        batch = batch_of(prepared, substeps)
        with batch.plant:
            observe_all(batch.plant, batch.law_from, batch.loop, _Nothing())
            error = float(np.max(batch.plant.integration_error))
        if not np.isfinite(error):
            substeps *= 4
            continue
        needed = substeps_for(error, substeps, members.choice.tolerance)
        if needed <= substeps:
            break
        substeps = needed
    return substeps


def pilots(members: Members) -> list[Prepared]:
    """The nominal machine and the first of those drawn that can run, enough for one vector.

    Raises
    ------
    ExperimentError
        None of the machines tried can run, nor any of the first members.
    """
    found = [each for each in (_nominal(members),) if each is not None]
    drawn = 0
    for each in _drawn(members):
        drawn += 1
        found.append(each)
        if len(found) == LANES:
            break
    if not drawn:
        _check_possible(members)
    return found


def _nominal(members: Members) -> Prepared | None:
    try:
        return members.prepared(members.nominal)
    except GoughStewartError:
        return None  # what varies may be what it lacks


def _drawn(members: Members) -> Iterator[Prepared]:
    for first in range(0, _AMONG, LANES):
        last = first + LANES
        part = prepared_members(members, first, last, members.independent_draws(first, last))
        yield from (part.prepared[k] for k in sorted(part.prepared))


def _check_possible(members: Members) -> None:
    """Refuse an ensemble whose first members are all impossible."""
    last = min(members.count, _AMONG)
    part = prepared_members(members, 0, last)
    if not part.prepared:
        raise ExperimentError(
            members.nominal.where,
            "ensemble",
            f"none of the first {last} members is possible; the first: {part.impossible[0]}",
        )


def stand_in(prepared: Prepared) -> Prepared:
    """A member with a linear controller in the place of one in Python; any other member as it is.

    F = F_ct + M_leg (ωn² e_k + 2 ωn (e_k − e_{k−1})/T), with e the measured error of the leg lengths, M_leg the mass
    matrix seen by the legs at home and F_ct the computed torque, both of the nominal model; ωn is 2π · 3 Hz, or 0.3/T
    if that is less. It acts without the delay and the drives of the experiment, so that it is stable: the machine
    follows the reference, starts with the forces of a wrong model, and hears the sensors' noise, as with most
    controllers. These set the speed that the substeps have to resolve.
    """
    loop = prepared.loop
    if not _needs_stand_in(prepared) or prepared.reference is None:
        return prepared
    T = loop.timing.sample_time
    omega = min(_FASTEST, _FASTEST_A_SAMPLE / T)
    M = leg_space_mass(prepared.platform)
    P, D = omega**2 * M, 2 * omega / T * M
    system = StateSpace(np.zeros((6, 6)), np.eye(6), -D, P + D, T)  # its state is the error before
    middles = np.minimum(loop.timing.samples + T / 2, end_of(prepared.reference))
    forces = feedforward("computed_torque", prepared.platform, prepared.reference(middles))
    follows = replace(loop, feedforward=forces, actuators=Actuators(loop.actuators.force_limit))
    return replace(prepared, loop=follows, controller=LinearController(system))


def _needs_stand_in(prepared: Prepared) -> bool:
    """Whether its controller is code of the user."""
    return not (prepared.controller is None or isinstance(prepared.controller, LinearController | UnitController))


class _Nothing(Observer):
    def block(self, rows: Rows) -> None:
        pass
