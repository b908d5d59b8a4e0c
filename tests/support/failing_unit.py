"""An FMU with our description and somebody else's binary, which fails in mid-run in a way that can be chosen."""

import inspect
import re
import subprocess
import sys
import tempfile
import zipfile
from enum import IntEnum
from pathlib import Path

import fmpy.fmi2

from tests.support.fmu_plants import Fmu

# From this time on a step fails [s].
FAILS_AT = 0.0095
# The environment variable with the name of a file that the unit makes when it is freed.
FREED = "FREED"


class Failure(IntEnum):
    """What happens then; handed over in the place of the parameter `fixed_step_size`."""

    ERROR = 1
    FATAL = 2
    EXIT = 3
    CRASH = 4
    HANG = 5
    PRINT = 6  # no failure: it writes to its standard output, and goes on
    LEAVE = 7  # ends its process as if all were well
    WARN = 8  # no failure: it warns in each step
    UNKNOWN = 9  # a status that no standard knows
    LONG = 10  # an error with a message of 200 MB
    MANY = 11  # an error after 100,000 messages
    ALARM = 12  # an error by its message alone; the step says that all is well


_SOURCE = """
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
typedef struct {
  void (*log)(void*, const char*, int, const char*, const char*, ...);
  void* (*allocate)(size_t, size_t);
  void (*release)(void*);
  void* rest[2];
} Callbacks;
static int* failure;
static const Callbacks* callbacks;
#define API __attribute__((visibility("default")))
API void* fmi2Instantiate(const char* a, int b, const char* c, const char* d, const Callbacks* e, int f, int g) {
  (void)a; (void)b; (void)c; (void)d; (void)f; (void)g;
  callbacks = e;
  failure = e->allocate(1, sizeof *failure);
  return failure;
}
API int fmi2SetReal(void* c, const unsigned* references, size_t n, const double* values) {
  (void)c;
  for (size_t k = 0; k < n; k++) if (references[k] == FIXED_STEP_SIZE) *failure = (int)values[k];
  return 0;
}
API int fmi2GetReal(void* c, const unsigned* references, size_t n, double* values) {
  (void)c; (void)references;
  for (size_t k = 0; k < n; k++) values[k] = 1;
  return 0;
}
API int fmi2SetupExperiment(void* c, int d, double t, double s, int e, double u) {
  (void)c; (void)d; (void)t; (void)s; (void)e; (void)u;
  return 0;
}
API int fmi2EnterInitializationMode(void* c) { (void)c; return 0; }
API int fmi2ExitInitializationMode(void* c) { (void)c; return 0; }
API int fmi2DoStep(void* c, double time, double step, int n) {
  (void)c; (void)step; (void)n;
  if (time < FAILS_AT) return 0;
  switch (*failure) {
    case 1: callbacks->log(NULL, "plant", 3, "logStatusError", "the oil is cold"); return 3;
    case 2: return 4;
    case 3: fprintf(stderr, "out of oil\\n"); exit(7);
    case 4: abort();
    case 5: for (;;) sleep(1000);
    case 6: printf("%1000d\\n", 1); fflush(stdout); break;
    case 7: exit(0);
    case 8: callbacks->log(NULL, "plant", 1, "logStatusWarning", "the oil is warm"); break;
    case 9: return -1;
    case 10: {
      char* text = malloc(200000001);
      memset(text, 'x', 200000000);
      memcpy(text, "begin", 5);
      strcpy(text + 199999997, "end");
      callbacks->log(NULL, NULL, 3, "\\xff", text);
      return 3;
    }
    case 11: {
      char text[32];
      for (int k = 0; k < 100000; k++) {
        sprintf(text, "drop %d", k);
        callbacks->log(NULL, "plant", 1, "logStatusWarning", text);
      }
      return 3;
    }
    case 12: callbacks->log(NULL, "plant", 3, "logStatusError", "the oil is cold"); break;
  }
  return 0;
}
API void fmi2FreeInstance(void* c) {
  callbacks->release(c);
  const char* trace = getenv("FREED");
  if (trace) fclose(fopen(trace, "w"));
}
"""


def failing_unit(fmu: Fmu, target: Path) -> Path:
    """The archive of an FMU, FMI 2.0, with the binary replaced."""
    (reference,) = fmu.variables["fixed_step_size"].references
    source = _SOURCE.replace("FIXED_STEP_SIZE", str(reference)).replace("FAILS_AT", str(FAILS_AT))
    # what FMPy looks for and does not call here
    others = set(re.findall(r"def (fmi2[A-Z]\w+)\(", inspect.getsource(fmpy.fmi2)))
    others -= set(re.findall(r"fmi2\w+", source))
    source += "\n".join(f"API int {name}(void) {{ return 0; }}" for name in sorted(others))
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "unit.c").write_text(source)
        command = [sys.executable, "-m", "ziglang", "cc", "-O1", "-shared", "-fPIC", "unit.c", "-o", "unit.so"]
        subprocess.run(command, cwd=folder, check=True)
        library = Path(folder, "unit.so").read_bytes()
    with zipfile.ZipFile(fmu.path) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            is_binary = name.startswith("binaries/") and not name.endswith("/")
            new.writestr(name, library if is_binary else old.read(name))
    return target
