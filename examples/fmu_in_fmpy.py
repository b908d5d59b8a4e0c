"""The FMU in FMPy: a sampled controller lifts the platform, whose payload increases during the run.

Build the FMU first with `gough-stewart build`, or pass its folder: `python fmu_in_fmpy.py FOLDER`.
"""

import shutil
import sys
from pathlib import Path

import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description

path = Path(sys.argv[1] if len(sys.argv) > 1 else ".", "gough_stewart_fmi3.fmu")
if not path.is_file():
    sys.exit(f"{path} does not exist; build it with `gough-stewart build --out {path.parent}`")
description = read_model_description(str(path))
reference = {v.name: v.valueReference for v in description.modelVariables}

folder = extract(str(path))
fmu = instantiate_fmu(folder, description, "CoSimulation")


def get(name: str, n: int) -> np.ndarray:
    """Value of an array with n elements."""
    return np.array(fmu.getFloat64([reference[name]], nValues=n))


def put(name: str, value: list[float]) -> None:
    """Set an array, or a scalar as a list with one element."""
    fmu.setFloat64([reference[name]], value)


fmu.enterInitializationMode(tolerance=1e-8)
fmu.exitInitializationMode()

step, home = 0.002, get("leg_length", 6)
integral = np.zeros(6)
for k in range(1500):
    if k == 750:
        put("platform_mass", [15.0])  # adds 5 kg
    error = home + 0.1 - get("leg_length", 6)
    integral += error * step
    put("actuator_force", (28.5 + 3000 * error + 6000 * integral - 250 * get("leg_velocity", 6)).tolist())
    fmu.doStep(k * step, step)
    if (k + 1) % 250 == 0:
        height = get("position", 3)[2]
        print(f"t = {(k + 1) * step:.1f} s  z = {height:.4f} m  F = {get('actuator_force', 6).mean():.1f} N per leg")

fmu.terminate()
fmu.freeInstance()
shutil.rmtree(folder)
