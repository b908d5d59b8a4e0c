"""CasADi's DaeBuilder: the plant's Model Exchange, integrated by classical Runge–Kutta."""

import json
import sys
from typing import Any

import casadi
import numpy as np
from fmpy import extract

case: dict[str, Any] = json.load(open(sys.argv[1], encoding="utf-8"))  # noqa: PTH123, SIM115
dae = casadi.DaeBuilder("plant", str(extract(case["plant2"])))
f = dae.create("f", ["x", "u"], ["ode"])
x, u = (np.array(dae.start(names)).ravel() for names in (dae.x(), dae.u()))
u[[dae.u().index(f"actuator_force[{k}]") for k in range(1, 7)]] = case["force"]
steps = 1000
h = case["end"] / steps
for _ in range(steps):
    k1 = f(x, u)
    k2 = f(x + h / 2 * k1, u)
    k3 = f(x + h / 2 * k2, u)
    k4 = f(x + h * k3, u)
    x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
found = np.array(x).ravel()[[dae.x().index(f"position[{k}]") for k in (1, 2, 3)]]
print(json.dumps(["plant, FMI 2.0, ModelExchange", float(np.abs(found - case["position"]).max())]))
