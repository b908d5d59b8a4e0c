"""libcosim by libcosimpy: plant and controller as local slaves, and the SSP."""

import json
import sys
from typing import Any

import numpy as np
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

case: dict[str, Any] = json.load(open(sys.argv[1], encoding="utf-8"))  # noqa: PTH123, SIM115


def told(what: str, found: Any, expected: str) -> None:
    """A line with the largest deviation."""
    print(json.dumps([what, float(np.abs(np.ravel(found) - np.ravel(case[expected])).max())]))


for unit, name, values, result, n, expected, end, step in (
    ("plant2", "actuator_force", case["force"], "position", 3, "position", case["end"], 0.01),
    ("controller2", "leg_length", case["lengths"], "actuator_force", 6, "forces", case["samples"] * case["step"], 1e-3),
):
    execution = CosimExecution.from_step_size(step_size=round(step * 1e9))
    index = execution.add_local_slave(CosimLocalSlave(fmu_path=case[unit], instance_name="unit"))
    at = {v.name.decode(): v.reference for v in execution.slave_variables(index)}
    for k, value in enumerate(values, start=1):
        assert execution.real_initial_value(index, at[f"{name}[{k}]"], value)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    assert execution.simulate_until(round(end * 1e9))
    found = observer.last_real_values(index, [at[f"{result}[{k}]"] for k in range(1, n + 1)])
    told(f"{unit[:-1]}, FMI 2.0, CoSimulation", found, expected)

execution = CosimExecution.from_ssp_file(ssp_path=case["ssp2"])
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
plant = {info.name.decode(): info.index for info in execution.slave_infos()}["plant"]
at = {v.name.decode(): v.reference for v in execution.slave_variables(plant)}
for _ in range(round(case["ssp_end"] / case["ssp_step"])):
    execution.step(1)
told("SSP, FMI 2.0", observer.last_real_values(plant, [at[f"leg_length[{k}]"] for k in range(1, 7)]), "ssp_lengths")
