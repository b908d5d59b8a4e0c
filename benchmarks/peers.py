"""Accuracy and cost beside MuJoCo, on the model that `build --as mjcf` writes: extra `evidence`, by hand.

`motion_base` without Coulomb friction, which is smooth here and a constraint there, is moved for 1 s by six forces that
hold for 1 ms each. Error: of the position at the end, against SciPy's integration of our equations at a tolerance of
1e-12. Cost: the best of some rounds in turn, on one core, each in a loop in Python that sets forces and reads the
position every 1 ms. Then 512 members with different payloads, in one call for each 1 ms, and by `mujoco.rollout`.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
from rich.console import Console
from rich.table import Table

import gough_stewart as gs
from gough_stewart.harness.plants.lanes import BatchPlant
from gough_stewart.model.interface import N_INPUTS, State
from gough_stewart.model.platform import Platform

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmarks.fmu import seconds_of_the_model, stepped_by_fmpy

ROUNDS, STEP = 5, 1e-3
MEMBERS, STEPS_OF_MEMBERS = 512, 100
# Seconds, and the position at the end [m].
Measured = tuple[float, Any]
INTEGRATORS = {
    name: getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}") for name in ("Euler", "implicitfast", "RK4")
}
# Of MuJoCo's `option` and `equality`: as its documentation has them if nothing is said, as exported, and stiffer.
DEFAULTS, EXPORTED, STIFF = "its defaults", "as exported", "stiffest closures"
SETTINGS = [
    *((DEFAULTS, "Euler", 1), (DEFAULTS, "Euler", 10)),
    *((EXPORTED, "Euler", 1), (EXPORTED, "implicitfast", 1), (EXPORTED, "implicitfast", 4)),
    *((EXPORTED, "implicitfast", 20), (EXPORTED, "RK4", 1), (EXPORTED, "RK4", 4)),
    *((STIFF, "RK4", 1), (STIFF, "RK4", 4)),
]


def forces_of(platform: Platform) -> list[list[float]]:
    """Actuator forces (1000, 6) of 1 s, within 30 % of those at home, each leg's at its own phase."""
    phase = 2 * np.pi * STEP * np.arange(1000)[:, None] + np.arange(6)
    swing = 0.3 * np.sin(phase) * [1, 0.5, -0.7, 0.9, 0.3, -1]
    return (platform.home_actuator_force * (1 + swing)).tolist()  # type: ignore[no-any-return]


def judged(platform: Platform, forces: list[list[float]]) -> Any:
    """The position at the end, by SciPy at 1e-12."""
    plant = gs.SteppingModel(platform, integrator="scipy", tolerance=1e-12)
    for k, force in enumerate(forces):
        plant.set("actuator_force", force)
        plant.do_step(k * STEP, STEP)
        length = np.asarray(plant.get("leg_length"))
        if not ((length > platform.leg_length_min) & (length < platform.leg_length_max)).all():
            raise RuntimeError("a leg leaves its stroke, whose ends MuJoCo's joints have and our plant has not")
    return np.asarray(plant.get("position"))


def exported(platform: Platform, folder: Path) -> Any:
    """The platform in MuJoCo."""
    (file,) = gs.build(folder, forms=["mjcf"], platform=platform)
    return mujoco.MjModel.from_xml_path(str(file))


def with_settings(model: Any, kind: str, integrator: str, substeps: int) -> Any:
    """Set the integrator, the time step of 1 ms over `substeps`, and the closures of a kind."""
    model.opt.timestep, model.opt.integrator = STEP / substeps, INTEGRATORS[integrator]
    if kind == DEFAULTS:
        model.eq_solref[:], model.eq_solimp[:] = (0.02, 1), (0.9, 0.95, 0.001, 0.5, 2)
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_AUTO
    elif kind == STIFF:
        model.eq_solref[:] = 2 * model.opt.timestep, 1  # the least time constant that it takes
    return model


def stepped_by_mujoco(model: Any, substeps: int, forces: list[list[float]]) -> Measured:
    """From its key frame, by `mj_step` in a loop in Python."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    begin = time.process_time()
    for force in forces:
        data.ctrl[:] = force
        mujoco.mj_step(model, data, substeps)
        data.sensordata[:3].copy()
    seconds = time.process_time() - begin
    mujoco.mj_forward(model, data)  # sensors are those before the last step
    return seconds, data.sensordata[:3].copy()


def by_the_unit(by_fmpy: Callable[[list[list[float]]], Measured], forces: list[list[float]]) -> Measured:
    """Of the FMU, for all steps."""
    seconds, position = by_fmpy(forces)
    return seconds * len(forces), position


def by_the_model(platform: Platform, forces: list[list[float]]) -> Measured:
    """Of `SteppingModel`, for all steps."""
    seconds, position = seconds_of_the_model(platform, forces)
    return seconds * len(forces), position


def best_of(rows: dict[str, Callable[[], Measured]], rounds: int) -> dict[str, Measured]:
    """The least seconds of each, and its position."""
    best = {name: row() for name, row in rows.items()}
    for _ in range(rounds - 1):
        for name, row in rows.items():
            best[name] = min(best[name][0], row()[0]), best[name][1]
    return best


def one(platform: Platform, folder: Path, rounds: int) -> dict[str, Measured]:
    """Seconds for a simulated one, and the error of the position at its end [m]."""
    forces = forces_of(platform)
    exact = judged(platform, forces)
    Console().print(f"The platform moves by {1e3 * np.abs(exact - platform.home_position).max():.1f} mm.")
    rows: dict[str, Callable[[], Measured]] = {
        "the unit through FMPy": partial(by_the_unit, stepped_by_fmpy(platform, folder), forces),
        "SteppingModel": partial(by_the_model, platform, forces),
    }
    for kind, integrator, substeps in SETTINGS:
        model = with_settings(exported(platform, folder), kind, integrator, substeps)
        name = f"MuJoCo, {kind}, {integrator}, {1 / substeps:g} ms"
        rows[name] = partial(stepped_by_mujoco, model, substeps, forces)
    measured = best_of(rows, rounds)
    return {name: (seconds, np.abs(position - exact).max()) for name, (seconds, position) in measured.items()}


def lanes(platforms: list[Platform], forces: Any) -> Measured:
    """All members at once, in a call for each step."""
    starts = [State(platform.home_position, platform.home_orientation, *np.zeros((2, 3))) for platform in platforms]
    plant = BatchPlant(platforms, starts, tolerance=1e-8)
    inputs = np.zeros((len(platforms), N_INPUTS))
    begin = time.process_time()
    for k, force in enumerate(forces):
        inputs[:, :6] = force
        plant.set_inputs(inputs)
        plant.do_step(k * STEP, STEP)
    return time.process_time() - begin, plant.signals()[:, :3]


def rollout(models: list[Any], forces: Any) -> Measured:
    """The same by MuJoCo's function for many, on one thread."""
    data, size = mujoco.MjData(models[0]), mujoco.mj_stateSize(models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_resetDataKeyframe(models[0], data, 0)
    start = np.zeros(size)
    mujoco.mj_getState(models[0], data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    begin = time.process_time()
    states, _ = mujoco.rollout.rollout(models, data, np.tile(start, (len(models), 1)), np.asarray(forces))
    seconds = time.process_time() - begin
    ends = []
    for model, state in zip(models, states[:, -1], strict=True):
        mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        mujoco.mj_forward(model, data)
        ends.append(data.sensordata[:3].copy())
    return seconds, np.array(ends)


def many(platform: Platform, folder: Path, members: int, rounds: int) -> dict[str, Measured]:
    """Seconds for a simulated one of each of the members, and the largest error of the first eight at the end [m]."""
    masses = platform.platform_mass * np.linspace(0.8, 1.2, members)
    platforms = [replace(platform, platform_mass=float(mass)) for mass in masses]
    forces = forces_of(platform)[:STEPS_OF_MEMBERS]
    rows: dict[str, Callable[[], Measured]] = {"the compiled batch": partial(lanes, platforms, forces)}
    for integrator in ("implicitfast", "RK4"):
        models = [with_settings(exported(member, folder), EXPORTED, integrator, 1) for member in platforms]
        rows[f"mujoco.rollout, as exported, {integrator}, 1 ms"] = partial(rollout, models, forces)
    exact = np.array([judged(member, forces) for member in platforms[:8]])
    simulated = STEP * STEPS_OF_MEMBERS
    return {
        name: (seconds / simulated, np.abs(position[:8] - exact).max())
        for name, (seconds, position) in best_of(rows, rounds).items()
    }


def main() -> int:
    """Measure, and print the tables."""
    platform = replace(gs.load_preset("motion_base"), leg_coulomb_friction=0.0)
    with tempfile.TemporaryDirectory() as folder:
        alone, together = one(platform, Path(folder), ROUNDS), many(platform, Path(folder), MEMBERS, 2)
    for title, measured in (("one platform, 1 s", alone), (f"{MEMBERS} platforms, 1 s of each", together)):
        unit = 1 if measured is together else 1e3
        table = Table(title, "error, mm", "s" if measured is together else "ms", "× the first", min_width=90)
        first = next(iter(measured.values()))[0]
        for name, (seconds, error) in measured.items():
            table.add_row(name, f"{1e3 * error:.1e}", f"{unit * seconds:.3g}", f"{seconds / first:.1f}")
        Console().print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
