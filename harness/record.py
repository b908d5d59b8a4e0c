"""Results as a table: `time`, then every output and local of the interface under its FMI 2.0 name."""

import numpy as np
import polars

from gough_stewart.harness.open_loop import Trajectory
from gough_stewart.model import interface


def table_of(run: Trajectory) -> polars.DataFrame:
    """One row per time."""
    columns = ["time", *interface.RESULT_COLUMNS]
    return polars.DataFrame(np.column_stack([run.time, run.results]), schema=columns)


def csv_of(run: Trajectory) -> bytes:
    """CSV with the shortest digits that read back to the same numbers."""
    return table_of(run).write_csv().encode()
