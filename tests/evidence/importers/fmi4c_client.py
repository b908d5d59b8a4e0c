"""fmi4c, a C library, by ctypes: Co-Simulation of plant and controller, FMI 2.0, and of scalar units, FMI 3.0.

The second argument is its shared library.
"""

import ctypes
import json
import sys
from typing import Any

case: dict[str, Any] = json.load(open(sys.argv[1], encoding="utf-8"))  # noqa: PTH123, SIM115
library = ctypes.CDLL(sys.argv[2])
for name in ("fmi4c_loadFmu", "fmi2_instantiate", "fmi3_instantiateCoSimulation", "fmi2_getVariableByName",
             "fmi3_getVariableByName"):  # fmt: skip
    getattr(library, name).restype = ctypes.c_void_p
for name in ("fmi2_getVariableValueReference", "fmi3_getVariableValueReference"):
    getattr(library, name).restype = ctypes.c_uint
P, D, U, S = ctypes.c_void_p, ctypes.c_double, ctypes.c_uint, ctypes.c_size_t
LOG = ctypes.CFUNCTYPE(None, P, P, ctypes.c_int, P, P)(lambda *_: None)
libc = ctypes.CDLL(None)


def run(version: int, path: str, name: str, values: list[float], result: str, n: int, end: float, h: float) -> Any:
    """The last values of outputs under constant inputs."""
    fmu = P(library.fmi4c_loadFmu(path.encode(), b"unit"))
    of, by_name = (getattr(library, f"fmi{version}_{f}") for f in ("getVariableValueReference", "getVariableByName"))

    def references(key: str, m: int) -> Any:
        return (U * m)(*(of(P(by_name(fmu, f"{key}[{k}]".encode()))) for k in range(1, m + 1)))

    u, found, wanted, given = references(name, 6), (D * n)(), references(result, n), (D * 6)(*values)
    if version == 2:
        unit = P(library.fmi2_instantiate(fmu, 1, LOG, libc.calloc, libc.free, None, None, 0, 0))
        assert library.fmi2_setupExperiment(unit, 1, D(1e-9), D(0), 0, D(0)) == 0
        assert library.fmi2_enterInitializationMode(unit) == 0
        assert library.fmi2_setReal(unit, u, S(6), given) == 0
        assert library.fmi2_exitInitializationMode(unit) == 0
        for k in range(round(end / h)):
            assert library.fmi2_doStep(unit, D(k * h), D(h), 1) == 0
        assert library.fmi2_getReal(unit, wanted, S(n), found) == 0
        library.fmi2_freeInstance(unit)
        return list(found)
    flags = [ctypes.c_bool() for _ in range(3)]
    reached = D()
    unit = P(library.fmi3_instantiateCoSimulation(fmu, False, False, False, False, None, S(0), None, LOG, None))
    assert library.fmi3_enterInitializationMode(unit, True, D(1e-9), D(0), False, D(0)) == 0
    assert library.fmi3_setFloat64(unit, u, S(6), given, S(6)) == 0
    assert library.fmi3_exitInitializationMode(unit) == 0
    for k in range(round(end / h)):
        answers = [*map(ctypes.byref, flags), ctypes.byref(reached)]
        assert library.fmi3_doStep(unit, D(k * h), D(h), True, *answers) == 0
    assert library.fmi3_getFloat64(unit, wanted, S(n), found, S(n)) == 0
    library.fmi3_freeInstance(unit)
    return list(found)


duration = case["samples"] * case["step"]
for version in (2, 3):
    which = "2" if version == 2 else "3_scalars"
    for unit, arguments, expected in (
        ("plant", ("actuator_force", case["force"], "position", 3, case["end"], 0.01), "position"),
        ("controller", ("leg_length", case["lengths"], "actuator_force", 6, duration, case["step"]), "forces"),
    ):
        got = run(version, case[f"{unit}{which}"], *arguments)
        worst = max(abs(a - b) for a, b in zip(got, case[expected], strict=True))
        print(json.dumps([f"{unit}, FMI {version}.0{', scalars' if version == 3 else ''}, CoSimulation", worst]))
