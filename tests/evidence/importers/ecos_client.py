"""Ecos by ecospy: the SSP with FMI 2.0 and 3.0, whose FMUs are plant and controller."""

import json
import sys
from typing import Any

import numpy as np
from ecospy.EcosSimulation import EcosSimulation

case: dict[str, Any] = json.load(open(sys.argv[1], encoding="utf-8"))  # noqa: PTH123, SIM115
for version in ("2", "3"):
    simulation = EcosSimulation(case["ssp_step"], ssp_path=case[f"ssp{version}"])
    simulation.init()
    for _ in range(round(case["ssp_end"] / case["ssp_step"])):
        simulation.step()
    found = [simulation.get_real(f"plant::leg_length[{k}]") for k in range(1, 7)]
    deviation = float(np.abs(np.array(found) - case["ssp_lengths"]).max())
    print(json.dumps([f"SSP, FMI {version}.0: plant and controller, CoSimulation", deviation]))
