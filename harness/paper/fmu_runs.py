"""The open-loop case with the FMU, run by FMPy like any importer."""

from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from numpy.typing import NDArray

from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.harness.plants.unit import FmiType, FmuInstance, UnitFile
from gough_stewart.model import interface
from gough_stewart.model.errors import StepError
from gough_stewart.model.formulations.cases import OpenLoopCase
from gough_stewart.model.interface import DEFAULT_TOLERANCE


def run_fmu(fmu: Path, case: OpenLoopCase, fmi_type: FmiType) -> NDArray[np.float64]:
    """States (n, 12) at the case's times: one communication step per row, or FMPy's CVode with Model Exchange.

    Parameters keep the FMU's start values, those of the case's platform; the initial state and forces are set.

    Raises
    ------
    StepError
        The FMU or the solver failed, with the FMU's messages.
    PlantError
        As `UnitFile` and `FmuInstance`.
    """
    with UnitFile(fmu) as file, FmuInstance(file, fmi_type) as unit:
        starts, columns = dict[str, Any](), list[str]()
        for name, value in {**case.start._asdict(), "actuator_force": case.actuator_force}.items():
            elements = PLANT.by_name[name].variable.scalar_names
            starts |= dict(zip(elements, value.tolist(), strict=True)) if unit.is_fmi2 else {name: value.tolist()}
        for variable in interface.STATES:
            columns += variable.scalar_names if unit.is_fmi2 else [variable.name]
        who = f"FMI {file.version} {fmi_type}"
        try:
            result = fmpy.simulate_fmu(
                str(file.folder),
                model_description=file.description,
                fmu_instance=unit.fmu,
                fmi_type=fmi_type,
                start_values=starts,
                output=columns,
                stop_time=case.duration,
                output_interval=case.duration / (len(case.time) - 1),
                relative_tolerance=DEFAULT_TOLERANCE,
            )
        except (FMICallException, RuntimeError) as error:
            reason = "; ".join(text for text in (unit.take_messages(), str(error)) if text)
            raise StepError(who, float("nan"), float("nan"), reason) from error
        if unit.messages or len(result) != len(case.time):
            raise StepError(f"{who}: rows", len(result), float(result["time"][-1]), unit.take_messages())
        return np.concatenate([np.asarray(result[c]).reshape(len(result), -1) for c in columns], axis=1)
