"""The record of an open-loop case, for the page that shows it."""

import numpy as np
import polars

from gough_stewart.harness.open_loop import Trajectory
from gough_stewart.harness.record import Record, plain, table_of
from gough_stewart.harness.versions import versions
from gough_stewart.model import interface
from gough_stewart.model.cases import OpenLoopCase

_INPUT_COLUMNS = [name for variable in interface.INPUTS for name in variable.scalar_names]


def record_of_case(case: OpenLoopCase, run: Trajectory) -> Record:
    """Outputs, locals and inputs over time; nothing is wanted, measured or limited."""
    inputs = np.tile(case.inputs.to_vector(), (len(run.time), 1))
    metadata = {
        "title": case.title,
        "plant": "task-space kernel under DOP853",
        "outcome": {"status": "completed", "time": case.duration, "cause": None},
        "duration": case.duration,
        "platform": plain(case.platform),
        "versions": versions(),
    }
    return Record(table_of(run).hstack(polars.DataFrame(inputs, schema=_INPUT_COLUMNS)), metadata)
