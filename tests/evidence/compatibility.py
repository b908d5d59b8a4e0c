"""Units and SSPs in every importer that can be had here, each in an environment of its own: the page Compatibility.

`python -m tests.evidence.compatibility` prints the rows of docs/compatibility.md; clients know the files alone. Ends
with 1 if one that runs deviates. `--fmi4c LIBRARY` is libfmi4c.so, built from source by CMake; `--libraries FOLDER`
goes to LD_LIBRARY_PATH: Ecos needs libtbb12. Expected: DOP853 on the equations in Python; the exported C; the harness.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import gough_stewart as gs
from gough_stewart.fmu_build.build import build_units
from gough_stewart.fmu_build.plant.plant_component import plant_component
from gough_stewart.harness.export.controller_units import component_of
from gough_stewart.harness.export.design import designed
from gough_stewart.harness.export.trace import traced
from gough_stewart.model.kernel import Kernel, parameter_vector
from tests.harness.export.sampled_unit import run_source
from tests.support.exported_loop import EXPORTED

CLIENTS = str(Path(__file__).with_name("importers.py"))
# In SI units: metres, and newtons of some 4 kN.
BOUND = 1e-6


@dataclass(frozen=True)
class Importer:
    """A client and what pip installs for it."""

    name: str
    packages: tuple[str, ...]
    client: str = ""  # none: whether it can be had is all that is tried


IMPORTERS = (
    Importer("FMPy", ("fmpy",), "fmpy"),
    Importer("CasADi", ("casadi", "fmpy"), "casadi"),
    Importer("libcosim", ("libcosimpy", "numpy"), "libcosim"),
    Importer("Ecos", ("ecospy", "numpy"), "ecos"),
    Importer("OMSimulator", ("omsimulator",)),
    Importer("PyFMI", ("pyfmi",)),
)


def case_in(folder: Path) -> dict[str, Any]:
    """Units, inputs and expected results."""
    platform, kernel = gs.load_preset("liu2000"), Kernel()
    force = (platform.home_actuator_force * (1 + 0.01 * np.arange(1, 7))).tolist()
    start = np.concatenate([platform.home_position, platform.home_orientation, np.zeros(6)])
    u, p = np.array([*force, *[0.0] * 6]), parameter_vector(platform)
    solved = solve_ivp(
        lambda _t, x: kernel.derivatives(x, u, p).copy(), (0, 0.3), start, method="DOP853", rtol=1e-12, atol=1e-12
    )
    plant, law = plant_component(platform), designed(gs.load_experiment("heave_step"))
    controller = component_of(law, traced(law), "controller")
    found: dict[str, Any] = {"force": force, "end": 0.3, "position": solved.y[:3, -1].tolist()}
    for name, component in (("plant", plant), ("controller", controller)):
        for version, path in zip("23", build_units(component, folder), strict=True):
            found[f"{name}{version}"] = str(path)
        scalars = replace(component, has_scalars_only=True)
        found[f"{name}3_scalars"] = str(build_units(scalars, folder / "scalars", fmi=["3.0"])[0])
    samples, step = 100, law.sample_time
    home = gs.load_preset("motion_base")
    lengths = gs.leg_geometry(home, home.home_position, home.home_orientation).length + 1e-3 * np.arange(-2, 4)
    source = next(path for path in gs.export("heave_step", forms="c", out=folder / "c") if path.suffix == ".c")
    forces = run_source(source, np.tile(lengths, (samples, 1)), None).force[-1]
    found |= {"lengths": lengths.tolist(), "samples": samples, "step": step, "forces": forces.tolist()}
    for version in "23":
        out = folder / f"ssp{version}"
        found[f"ssp{version}"] = str(gs.export("heave_step", EXPORTED, forms="ssp", ssp_fmi=f"{version}.0", out=out)[0])
    record = gs.run("heave_step", EXPORTED)
    found |= {"ssp_end": EXPORTED["loop.duration"], "ssp_step": EXPORTED["loop.sample_time"]}
    return found | {"ssp_lengths": record["leg_length"][-1].tolist()}


def installed(importer: Importer, folder: Path) -> tuple[str, str]:
    """The version and the Python of its environment, or "" and why it could not be had."""
    venv.create(folder, with_pip=True)
    python = str(folder / "bin/python")
    done = subprocess.run(
        [python, "-m", "pip", "install", "--quiet", *importer.packages], capture_output=True, text=True, check=False
    )
    if done.returncode:
        lines = [line.strip() for line in (done.stdout + done.stderr).splitlines() if "rror" in line]
        return "", max(lines, key=len, default="pip failed")[:200]
    ask = f"import importlib.metadata as m; print(m.version({importer.packages[0]!r}))"
    return subprocess.run([python, "-c", ask], capture_output=True, text=True, check=True).stdout.strip(), python


def results(command: list[str], libraries: str) -> Iterator[tuple[str, float | None, str]]:
    """What a client says: what ran, the deviation, and how it ended where it failed."""
    env = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    env["LD_LIBRARY_PATH"] = os.pathsep.join(filter(None, (libraries, env.get("LD_LIBRARY_PATH", ""))))
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
    for line in done.stdout.splitlines():
        if line.startswith('["'):
            what, deviation = json.loads(line)
            yield what, float(deviation), ""
    if done.returncode:
        yield "", None, (done.stderr.strip().splitlines() or ["ended without a word"])[-1]


def main() -> int:
    """Print the rows; 1 if an importer that runs deviates."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--fmi4c", help="libfmi4c.so, built from source")
    parser.add_argument("--libraries", default="", help="folder with shared libraries that importers need")
    options = parser.parse_args()
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="gough-stewart-importers-") as place:
        folder = Path(place)
        case = folder / "case.json"
        case.write_text(json.dumps(case_in(folder / "units")), encoding="utf-8")
        commands: list[tuple[str, str, list[str]]] = []
        for importer in IMPORTERS:
            version, python = installed(importer, folder / importer.name)
            if not version or not importer.client:
                print(f"| {importer.name} | {version} | nothing | {python if not version else 'installs'} |")
                continue
            commands.append((importer.name, version, [python, CLIENTS, importer.client, str(case)]))
        if options.fmi4c:
            commands.append(("fmi4c", "from source", [sys.executable, CLIENTS, "fmi4c", str(case), options.fmi4c]))
        for name, version, command in commands:
            for what, deviation, failure in results(command, options.libraries):
                is_wrong = deviation is None or not deviation <= BOUND
                wrong += is_wrong
                result = failure if deviation is None else f"{deviation:.0e}{' WRONG' if is_wrong else ''}"
                print(f"| {name} | {version} | {what} | {result} |", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
