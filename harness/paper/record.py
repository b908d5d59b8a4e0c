"""The record of an open-loop case, for its HTML page."""

import numpy as np
import polars

from gough_stewart.harness.output.versions import versions
from gough_stewart.harness.paper.open_loop import Trajectory
from gough_stewart.harness.results.record import Record, plain
from gough_stewart.model import interface
from gough_stewart.model.formulations.cases import OpenLoopCase

_INPUT_COLUMNS = [name for variable in interface.INPUTS for name in variable.scalar_names]


def table_of(run: Trajectory) -> polars.DataFrame:
    """An open-loop trajectory: `time`, then every output and local."""
    names = ["time", *interface.RESULT_COLUMNS]
    return polars.DataFrame(np.column_stack([run.time, run.results]), schema=names)


def csv_of(run: Trajectory) -> bytes:
    """`table_of` as CSV with the fewest digits that read back to the same numbers."""
    return table_of(run).write_csv().encode()


def record_of_case(case: OpenLoopCase, run: Trajectory) -> Record:
    """Outputs, locals and inputs over time; there are no references, measurements or limits."""
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
