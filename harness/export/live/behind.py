"""What is drawn behind the curves of an open loop: its forces alone, by the code that reproduces the paper."""

from dataclasses import replace
from typing import Any

import numpy as np

from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.paper.open_loop import run_kernel
from gough_stewart.model.errors import StepError
from gough_stewart.model.formulations.cases import OpenLoopCase, paper_case

# Digits that a chart does not show are not carried: [m, rad].
_DIGITS = 7


def behind_of(experiment: Experiment, prepared: Prepared) -> dict[str, Any] | None:
    """Pose and lengths over time under constant forces, by DOP853, which shares no code with the page's C.

    None if they are not constant, something changes them, or they drive the platform into a pose that it cannot pass.
    """
    forces, duration = np.reshape(prepared.loop.feedforward, (-1, 6)), experiment.loop.duration
    if prepared.loop.changes or np.ptp(forces, axis=0).any():
        return None
    case = OpenLoopCase(experiment.title, prepared.machine, prepared.start, forces[0], duration)
    try:
        run = run_kernel(case)
    except StepError:
        return None
    pose = np.concatenate([run["position"], run["orientation"]], axis=1)
    return {
        "time": run.time.tolist(),
        "pose": np.round(pose, _DIGITS).tolist(),
        "length": np.round(run["leg_length"], _DIGITS).tolist(),
        "isPublished": _is_published(case),
    }


def _is_published(case: OpenLoopCase) -> bool:
    paper = paper_case()
    plain = (replace(each.platform, name="", source="") for each in (case, paper))
    return (
        len({repr(each) for each in plain}) == 1
        and np.array_equal(case.start.to_vector(), paper.start.to_vector())
        and np.array_equal(case.actuator_force, paper.actuator_force)
    )
