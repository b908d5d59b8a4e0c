/* The paper's second through an FMI 2.0 library that is loaded at run time, on any system.

   Usage: trajectory LIBRARY GUID. Prints a pose a line, x y z and the three angles, from the start on. */
#include <stdio.h>
#include <string.h>

#include "fmi2FunctionTypes.h"

#ifdef _WIN32
#include <windows.h>

static void *open_library(const char *path)
{
    return (void *)LoadLibraryA(path);
}

static void *find(void *library, const char *name)
{
    FARPROC found = GetProcAddress((HMODULE)library, name);
    void *pointer;
    memcpy(&pointer, &found, sizeof pointer);
    return pointer;
}
#else
#include <dlfcn.h>

static void *open_library(const char *path)
{
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library)
        fprintf(stderr, "%s\n", dlerror());
    return library;
}

static void *find(void *library, const char *name)
{
    return dlsym(library, name);
}
#endif

enum { STEPS = 100, FORCES = 0, POSE = 12, N_STATES = 12 }; /* value references of fmu_build/component.py */

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...)
{
    (void)environment;
    fprintf(stderr, "%s, status %d, %s: %s\n", name, (int)status, category, message);
}

/* Functions are declared as the standard's types, and copied: C converts no object pointer to a function pointer. */
#define FIND(function)                                                                                                 \
    function##TYPE *function;                                                                                          \
    do {                                                                                                               \
        void *found = find(library, #function);                                                                        \
        if (!found) {                                                                                                  \
            fprintf(stderr, "the library has no %s\n", #function);                                                     \
            return 1;                                                                                                  \
        }                                                                                                              \
        memcpy(&function, &found, sizeof found);                                                                       \
    } while (0)

#define EXPECT_OK(call)                                                                                                \
    do {                                                                                                               \
        if ((call) != fmi2OK) {                                                                                        \
            fprintf(stderr, "failed: %s\n", #call);                                                                    \
            return 1;                                                                                                  \
        }                                                                                                              \
    } while (0)

int main(int argc, char **argv)
{
    static const double start[N_STATES] = {0, 0, 3, 0, 0, -0.1, 0, 0.2, 0, 0, 0.1, 0};
    static const double forces[6] = {55, 49.5, 55, 49.5, 55, 49.5};
    static const fmi2CallbackFunctions callbacks = {.logger = logger};
    fmi2ValueReference states[N_STATES], inputs[6];
    for (fmi2ValueReference k = 0; k < N_STATES; k++)
        states[k] = POSE + k;
    for (fmi2ValueReference k = 0; k < 6; k++)
        inputs[k] = FORCES + k;
    if (argc != 3) {
        fprintf(stderr, "usage: trajectory LIBRARY GUID\n");
        return 2;
    }
    void *library = open_library(argv[1]);
    if (!library) {
        fprintf(stderr, "cannot load %s\n", argv[1]);
        return 1;
    }
    FIND(fmi2Instantiate);
    FIND(fmi2SetReal);
    FIND(fmi2SetupExperiment);
    FIND(fmi2EnterInitializationMode);
    FIND(fmi2ExitInitializationMode);
    FIND(fmi2GetReal);
    FIND(fmi2DoStep);
    FIND(fmi2Terminate);
    FIND(fmi2FreeInstance);

    fmi2Component c = fmi2Instantiate("plant", fmi2CoSimulation, argv[2], NULL, &callbacks, fmi2False, fmi2True);
    if (!c)
        return 1;
    EXPECT_OK(fmi2SetReal(c, states, N_STATES, start));
    EXPECT_OK(fmi2SetReal(c, inputs, 6, forces));
    EXPECT_OK(fmi2SetupExperiment(c, fmi2True, 1e-8, 0, fmi2True, 1));
    EXPECT_OK(fmi2EnterInitializationMode(c));
    EXPECT_OK(fmi2ExitInitializationMode(c));
    for (int k = 0; k <= STEPS; k++) {
        double pose[6];
        if (k > 0)
            EXPECT_OK(fmi2DoStep(c, (k - 1) / 100.0, 0.01, fmi2True));
        EXPECT_OK(fmi2GetReal(c, states, 6, pose));
        for (int i = 0; i < 6; i++)
            printf("%.17g%c", pose[i], i < 5 ? ' ' : '\n');
    }
    EXPECT_OK(fmi2Terminate(c));
    fmi2FreeInstance(c);
    return 0;
}
