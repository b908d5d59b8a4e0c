"""Why a member of many platforms cannot continue, in the messages of the stepping model."""

from collections.abc import Iterable, Sequence

import numpy as np

from gough_stewart.fmu_build.lanes import Failure
from gough_stewart.harness.plants.lane_batch import Batch
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model import interface
from gough_stewart.model.errors import PlatformError, StepError
from gough_stewart.model.kinematics import conditioning, leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_checks import check_leg_com_offsets
from gough_stewart.model.pose_limits import leg_collapsed, pitch_reached, singular_pose
from gough_stewart.model.vectors import FloatArray


def failure_of(batch: Batch, k: int, begin: float, size: float, substeps: int) -> StepError:
    """The error of member `k` in one of `substeps` of a `size` [s] of a step that starts at a time [s]."""
    failure, x, u = int(batch.failure[k]), batch.reached[:, k], batch.inputs[:, k]
    time = begin + float(batch.failed_at[k]) * size
    if failure == Failure.NOT_FINITE:
        if not np.isfinite(u).all():
            return StepError(*_first_not_finite(interface.INPUTS, u), begin, "expected finite numbers")
        remedy = f"more than {substeps} substeps, smaller forces, or smoother friction (leg_friction_velocity)"
        return StepError(*_first_not_finite(interface.STATES, x), time, f"the motion is not finite; it needs {remedy}")
    if failure == Failure.PITCHED:
        return pitch_reached(float(x[4]), time)
    platform, pose = batch.parameters_of([k]), (x[None, :3], x[None, 3:6])
    if failure >= Failure.COLLAPSED:
        leg = failure - Failure.COLLAPSED
        with np.errstate(all="ignore"):
            return leg_collapsed(leg, float(leg_geometry(platform, *pose).length[0, leg]), time)
    number = float(conditioning(platform, *pose).condition_number[0])
    return singular_pose(number, time, passed=failure == Failure.PASSED_SINGULAR)


def short_legs(batch: Batch, platforms: Sequence[Platform], members: BoolArray, time: float) -> dict[int, StepError]:
    """Which members (N,) have a leg too short for a part's centre of mass."""
    n = len(platforms)
    parameters, x = batch.parameters_of(slice(n)), batch.states[:, :n].T
    shortest = leg_geometry(parameters, x[:, :3], x[:, 3:6]).length.min(axis=-1)
    farthest = np.maximum(parameters.leg_lower_com, parameters.leg_upper_com)
    found = {}
    for k in map(int, np.flatnonzero((farthest > shortest) & members)):
        try:
            check_leg_com_offsets(platforms[k], float(shortest[k]), "start")
        except PlatformError as error:
            value = float(getattr(platforms[k], error.field))
            found[k] = StepError(error.field, value, time, str(error).partition(": ")[2])
    return found


def _first_not_finite(variables: Iterable[interface.Variable], values: FloatArray) -> tuple[str, float]:
    """Name and value of the first element that is not finite."""
    names = [name for v in variables for name in v.scalar_names]
    at = int(np.flatnonzero(~np.isfinite(values))[0])
    return names[at], float(values[at])
