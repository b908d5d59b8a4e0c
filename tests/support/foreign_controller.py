"""A controller as somebody else would make one: FMI 2.0, its own names, u = gain (r − y) after each step."""

import inspect
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy.fmi2

# How the unit calls what the loop calls leg_length, reference_leg_length and actuator_force.
NAMES = {"leg_length": "y_{}", "reference_leg_length": "r", "actuator_force": "u"}
# When a step fails where the gain is below 0: with this gain by its status, with others by a crash.
FAILS_AT = 0.5
REFUSES = -2.0
# It takes no larger gain.
MOST = 1e9
_SOURCE = """
#include <stddef.h>
#include <stdlib.h>
enum { Y, R = 6, U = 12, GAIN = 18, READY, N };
#define API __attribute__((visibility("default")))
API void* fmi2Instantiate(const char* a, int b, const char* c, const char* d, const void* e, int f, int g) {
  double* v = calloc(N, sizeof *v);
  v[GAIN] = 1000;
  return v;
}
API int fmi2SetReal(void* c, const unsigned* references, size_t n, const double* values) {
  for (size_t k = 0; k < n; k++) {
    if (references[k] == GAIN && values[k] > MOST) return 3;
    ((double*)c)[references[k]] = values[k];
  }
  return 0;
}
API int fmi2GetReal(void* c, const unsigned* references, size_t n, double* values) {
  for (size_t k = 0; k < n; k++) values[k] = ((double*)c)[references[k]];
  return 0;
}
API int fmi2SetupExperiment(void* c, int d, double t, double s, int e, double u) {
  return 0;
}
API int fmi2EnterInitializationMode(void* c) { return 0; }
API int fmi2ExitInitializationMode(void* c) { ((double*)c)[READY] = 1; return 0; }
API int fmi2DoStep(void* c, double time, double step, int n) {
  double* v = c;
  if (!v[READY]) return 3;
  if (v[GAIN] < 0 && time >= FAILS_AT) {
    if (v[GAIN] == REFUSES) return 3;
    abort();
  }
  for (int k = 0; k < 6; k++) v[U + k] = v[GAIN] * (v[R + k] - v[Y + k]);
  return 0;
}
API void fmi2FreeInstance(void* c) { free(c); }
"""


def foreign_controller(target: Path, *, unit: str = "m", outputs: int = 6) -> Path:
    """The archive; with another unit of lengths, or fewer outputs, a wrong one."""
    source = _SOURCE
    for word, number in (("FAILS_AT", FAILS_AT), ("REFUSES", REFUSES), ("MOST", MOST)):
        source = source.replace(word, str(number))
    # what FMPy looks for and does not call here
    called = set(re.findall(r"fmi2\w+", source))
    others = set(re.findall(r"def (fmi2[A-Z]\w+)\(", inspect.getsource(fmpy.fmi2))) - called
    source += "\n".join(f"API int {name}(void) {{ return 0; }}" for name in sorted(others))
    names = [name.format(k) for name in ("y_{}", "r[{}]", "u[{}]") for k in range(1, 7)]
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{k}" causality="{"input" if k < 12 else "output"}">'
        + (f'<Real unit="{unit}" start="0"/>' if k < 12 else '<Real unit="N"/>')
        + "</ScalarVariable>"
        for k, name in enumerate(names[: 12 + outputs])
    )
    unknowns = "".join(f'<Unknown index="{k}"/>' for k in range(13, 13 + outputs))
    description = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Theirs" guid="0" variableNamingConvention="structured">
<CoSimulation modelIdentifier="theirs"/>
<UnitDefinitions><Unit name="{unit}"/><Unit name="N"/></UnitDefinitions>
<ModelVariables>{variables}
<ScalarVariable name="gain" valueReference="18" causality="parameter" variability="fixed">
<Real start="1000"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs>{unknowns}</Outputs></ModelStructure>
</fmiModelDescription>"""
    code, library = target.with_suffix(".c"), f"theirs{fmpy.sharedLibraryExtension}"
    code.write_text(source)
    built = target.with_name(library)
    subprocess.run([sys.executable, "-m", "ziglang", "cc", "-shared", "-O1", "-o", str(built), str(code)], check=True)
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(built, f"binaries/{fmpy.platform}/{library}")
    return target
