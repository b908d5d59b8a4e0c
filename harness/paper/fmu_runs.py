"""The open-loop case through the FMU, as any importer would run it: by FMPy."""

from pathlib import Path
from typing import Any, Literal

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from numpy.typing import NDArray

from gough_stewart.fmu_build.layout import BY_NAME
from gough_stewart.model import interface
from gough_stewart.model.errors import StepError
from gough_stewart.model.formulations.cases import OpenLoopCase

FmiType = Literal["CoSimulation", "ModelExchange"]
TOLERANCE = 1e-8


def run_fmu(fmu: Path, case: OpenLoopCase, fmi_type: FmiType) -> NDArray[np.float64]:
    """States (n, 12) at the case's times: a communication step a row, or FMPy's CVode on Model Exchange.

    The FMU's own start values are those of the case's platform; start of the motion and forces are set.

    Raises
    ------
    StepError
        The FMU or the solver gave up, with what the FMU told.
    """
    description = fmpy.read_model_description(str(fmu))
    scalars = description.fmiVersion == "2.0"
    starts, columns = dict[str, Any](), list[str]()
    for name, value in {**case.start._asdict(), "actuator_force": case.actuator_force}.items():
        elements = BY_NAME[name].variable.scalar_names
        starts |= dict(zip(elements, value.tolist(), strict=True)) if scalars else {name: value.tolist()}
    for variable in interface.STATES:
        columns += variable.scalar_names if scalars else [variable.name]
    told: list[str] = []
    try:
        result = fmpy.simulate_fmu(
            str(fmu),
            model_description=description,
            fmi_type=fmi_type,
            start_values=starts,
            output=columns,
            stop_time=case.duration,
            output_interval=case.duration / (len(case.time) - 1),
            relative_tolerance=TOLERANCE,
            debug_logging=True,
            # instance name comes first in FMI 2.0; the message is last in both
            logger=lambda *arguments: told.append(arguments[-1].decode()),
        )
    except (FMICallException, RuntimeError) as error:
        reason = "; ".join([*told, str(error)])
        raise StepError(f"FMI {description.fmiVersion} {fmi_type}", float("nan"), float("nan"), reason) from error
    if told or len(result) != len(case.time):
        last = float(result["time"][-1])
        raise StepError(f"FMI {description.fmiVersion} {fmi_type}: rows", len(result), last, "; ".join(told))
    return np.concatenate([np.asarray(result[c]).reshape(len(result), -1) for c in columns], axis=1)
