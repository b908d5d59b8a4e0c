"""Clients of `compatibility.py`, which know a case's files alone: `python importers.py IMPORTER CASE [LIBRARY]`."""

import ctypes
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

case: dict[str, Any] = json.loads(Path(sys.argv[2]).read_text(encoding="utf-8")) if __name__ == "__main__" else {}


def told(what: str, found: Any, expected: str) -> None:
    """A line with the largest deviation."""
    print(json.dumps([what, float(np.abs(np.ravel(found) - np.ravel(case[expected])).max())]))


def elements(name: str, size: int = 6) -> list[str]:
    return [f"{name}[{k}]" for k in range(1, size + 1)]


def fmpy() -> None:
    """`simulate_fmu` of plant and controller, `simulate_ssp`."""
    from fmpy import simulate_fmu
    from fmpy.ssp.simulation import simulate_ssp

    def inputs(name: str, values: list[float], end: float, *, scalars: bool) -> Any:
        if scalars:
            kind: Any = [("time", float), *((element, float) for element in elements(name))]
            return np.array([(0.0, *values), (end, *values)], dtype=kind)
        return np.array([(0.0, values), (end, values)], dtype=[("time", float), (name, float, (6,))])

    for version in "23":
        scalars = version == "2"
        names = elements("position", 3) if scalars else ["position"]
        for kind in ("CoSimulation", "ModelExchange"):
            u = inputs("actuator_force", case["force"], case["end"], scalars=scalars)
            found = simulate_fmu(case[f"plant{version}"], fmi_type=kind, stop_time=case["end"], input=u, output=names,
                                 output_interval=0.01, relative_tolerance=1e-9)  # fmt: skip
            told(f"plant, FMI {version}.0, {kind}", [found[name][-1] for name in names], "position")
        names = elements("actuator_force") if scalars else ["actuator_force"]
        end = case["samples"] * case["step"]
        u = inputs("leg_length", case["lengths"], end, scalars=scalars)
        found = simulate_fmu(case[f"controller{version}"], stop_time=end, input=u, output=names,
                             output_interval=case["step"])  # fmt: skip
        told(f"controller, FMI {version}.0, CoSimulation", [found[name][-1] for name in names], "forces")
    result = simulate_ssp(case["ssp2"], stop_time=case["ssp_end"] - case["ssp_step"] / 2, step_size=case["ssp_step"])
    told("SSP, FMI 2.0", [result[f"plant.{name}"][-1] for name in elements("leg_length")], "ssp_lengths")


def casadi() -> None:
    """`DaeBuilder`: the plant's Model Exchange, integrated by classical Runge–Kutta."""
    import casadi as ca
    from fmpy import extract

    dae = ca.DaeBuilder("plant", str(extract(case["plant2"])))
    f = dae.create("f", ["x", "u"], ["ode"])
    x, u = (np.array(dae.start(names)).ravel() for names in (dae.x(), dae.u()))
    u[[dae.u().index(name) for name in elements("actuator_force")]] = case["force"]
    h = case["end"] / 1000
    for _ in range(1000):
        k1 = f(x, u)
        k2 = f(x + h / 2 * k1, u)
        k3 = f(x + h / 2 * k2, u)
        k4 = f(x + h * k3, u)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    position = np.array(x).ravel()[[dae.x().index(name) for name in elements("position", 3)]]
    told("plant, FMI 2.0, ModelExchange", position, "position")


def libcosim() -> None:
    """By libcosimpy: plant and controller as local slaves, and the SSP."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    end = case["samples"] * case["step"]
    for unit, name, values, result, n, expected, stop, step in (
        ("plant2", "actuator_force", case["force"], "position", 3, "position", case["end"], 0.01),
        ("controller2", "leg_length", case["lengths"], "actuator_force", 6, "forces", end, 1e-3),
    ):
        execution = CosimExecution.from_step_size(step_size=round(step * 1e9))
        index = execution.add_local_slave(CosimLocalSlave(fmu_path=case[unit], instance_name="unit"))
        at = {v.name.decode(): v.reference for v in execution.slave_variables(index)}
        for element, value in zip(elements(name), values, strict=True):
            assert execution.real_initial_value(index, at[element], value)
        observer = CosimObserver.create_last_value()
        execution.add_observer(observer)
        assert execution.simulate_until(round(stop * 1e9))
        found = observer.last_real_values(index, [at[element] for element in elements(result, n)])
        told(f"{unit[:-1]}, FMI 2.0, CoSimulation", found, expected)
    execution = CosimExecution.from_ssp_file(ssp_path=case["ssp2"])
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    plant = {info.name.decode(): info.index for info in execution.slave_infos()}["plant"]
    at = {v.name.decode(): v.reference for v in execution.slave_variables(plant)}
    for _ in range(round(case["ssp_end"] / case["ssp_step"])):
        execution.step(1)
    lengths = observer.last_real_values(plant, [at[element] for element in elements("leg_length")])
    told("SSP, FMI 2.0", lengths, "ssp_lengths")


def ecos() -> None:
    """By ecospy: the SSP with FMI 2.0 and 3.0, whose FMUs are plant and controller."""
    from ecospy.EcosSimulation import EcosSimulation

    for version in "23":
        simulation = EcosSimulation(case["ssp_step"], ssp_path=case[f"ssp{version}"])
        simulation.init()
        for _ in range(round(case["ssp_end"] / case["ssp_step"])):
            simulation.step()
        lengths = [simulation.get_real(f"plant::{name}") for name in elements("leg_length")]
        told(f"SSP, FMI {version}.0: plant and controller, CoSimulation", lengths, "ssp_lengths")


def fmi4c() -> None:
    """By ctypes: Co-Simulation of plant and controller, FMI 2.0, and of scalar units, FMI 3.0."""
    P, D, U, S = ctypes.c_void_p, ctypes.c_double, ctypes.c_uint, ctypes.c_size_t
    library, libc = ctypes.CDLL(sys.argv[3]), ctypes.CDLL(None)
    log = ctypes.CFUNCTYPE(None, P, P, ctypes.c_int, P, P)(lambda *_: None)
    for name in ("fmi4c_loadFmu", "fmi2_instantiate", "fmi3_instantiateCoSimulation", "fmi2_getVariableByName",
                 "fmi3_getVariableByName"):  # fmt: skip
        getattr(library, name).restype = P
    for name in ("fmi2_getVariableValueReference", "fmi3_getVariableValueReference"):
        getattr(library, name).restype = U

    def run(version: int, path: str, name: str, values: list[float], result: str, n: int, end: float, h: float) -> Any:
        """The last values of outputs under constant inputs."""
        fmu = P(library.fmi4c_loadFmu(path.encode(), b"unit"))
        of, by_name = (
            getattr(library, f"fmi{version}_{f}") for f in ("getVariableValueReference", "getVariableByName")
        )
        u, wanted = ((U * m)(*(of(P(by_name(fmu, element.encode()))) for element in elements(key, m)))
                     for key, m in ((name, 6), (result, n)))  # fmt: skip
        found, given, reached, flags = (D * n)(), (D * 6)(*values), D(), [ctypes.c_bool() for _ in range(3)]
        if version == 2:
            unit = P(library.fmi2_instantiate(fmu, 1, log, libc.calloc, libc.free, None, None, 0, 0))
            assert library.fmi2_setupExperiment(unit, 1, D(1e-9), D(0), 0, D(0)) == 0
            assert library.fmi2_enterInitializationMode(unit) == 0
            assert library.fmi2_setReal(unit, u, S(6), given) == 0
            assert library.fmi2_exitInitializationMode(unit) == 0
            for k in range(round(end / h)):
                assert library.fmi2_doStep(unit, D(k * h), D(h), 1) == 0
            assert library.fmi2_getReal(unit, wanted, S(n), found) == 0
            library.fmi2_freeInstance(unit)
            return list(found)
        unit = P(library.fmi3_instantiateCoSimulation(fmu, False, False, False, False, None, S(0), None, log, None))
        assert library.fmi3_enterInitializationMode(unit, True, D(1e-9), D(0), False, D(0)) == 0
        assert library.fmi3_setFloat64(unit, u, S(6), given, S(6)) == 0
        assert library.fmi3_exitInitializationMode(unit) == 0
        for k in range(round(end / h)):
            answers = [*map(ctypes.byref, flags), ctypes.byref(reached)]
            assert library.fmi3_doStep(unit, D(k * h), D(h), True, *answers) == 0
        assert library.fmi3_getFloat64(unit, wanted, S(n), found, S(n)) == 0
        library.fmi3_freeInstance(unit)
        return list(found)

    end = case["samples"] * case["step"]
    for version in (2, 3):
        which, words = ("2", "") if version == 2 else ("3_scalars", ", scalars")
        plant = run(version, case[f"plant{which}"], "actuator_force", case["force"], "position", 3, case["end"], 0.01)
        told(f"plant, FMI {version}.0{words}, CoSimulation", plant, "position")
        unit, lengths = case[f"controller{which}"], case["lengths"]
        controller = run(version, unit, "leg_length", lengths, "actuator_force", 6, end, case["step"])
        told(f"controller, FMI {version}.0{words}, CoSimulation", controller, "forces")


if __name__ == "__main__":
    {client.__name__: client for client in (fmpy, casadi, libcosim, ecos, fmi4c)}[sys.argv[1]]()
