"""FMPy: `simulate_fmu` of plant and controller, `simulate_ssp`."""

import json
import sys
from typing import Any

import numpy as np
from fmpy import simulate_fmu
from fmpy.ssp.simulation import simulate_ssp

case: dict[str, Any] = json.load(open(sys.argv[1], encoding="utf-8"))  # noqa: PTH123, SIM115


def told(what: str, found: Any, expected: str) -> None:
    """A line with the largest deviation."""
    print(json.dumps([what, float(np.abs(np.ravel(found) - np.ravel(case[expected])).max())]))


def inputs(name: str, values: list[float], end: float, *, scalars: bool) -> Any:
    """Constant inputs."""
    if scalars:
        kind: Any = [("time", float), *((f"{name}[{k}]", float) for k in range(1, 7))]
        return np.array([(0.0, *values), (end, *values)], dtype=kind)
    return np.array([(0.0, values), (end, values)], dtype=[("time", float), (name, float, (6,))])


for version in ("2", "3"):
    scalars = version == "2"
    names = [f"position[{k}]" for k in (1, 2, 3)] if scalars else ["position"]
    for kind in ("CoSimulation", "ModelExchange"):
        u = inputs("actuator_force", case["force"], case["end"], scalars=scalars)
        found = simulate_fmu(case[f"plant{version}"], fmi_type=kind, stop_time=case["end"], input=u, output=names,
                             output_interval=0.01, relative_tolerance=1e-9)  # fmt: skip
        told(f"plant, FMI {version}.0, {kind}", [found[name][-1] for name in names], "position")
    names = [f"actuator_force[{k}]" for k in range(1, 7)] if scalars else ["actuator_force"]
    u = inputs("leg_length", case["lengths"], case["samples"] * case["step"], scalars=scalars)
    found = simulate_fmu(case[f"controller{version}"], stop_time=case["samples"] * case["step"], input=u, output=names,
                         output_interval=case["step"])  # fmt: skip
    told(f"controller, FMI {version}.0, CoSimulation", [found[name][-1] for name in names], "forces")
result = simulate_ssp(case["ssp2"], stop_time=case["ssp_end"] - case["ssp_step"] / 2, step_size=case["ssp_step"])
told("SSP, FMI 2.0", [result[f"plant.leg_length[{k}]"][-1] for k in range(1, 7)], "ssp_lengths")
