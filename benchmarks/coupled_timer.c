/* Plant and controller as FMI 2.0 units in a host at 1 kHz, and the plant alone: seconds per step, the best of many rounds.

   coupled_timer PLANT.so GUID CONTROLLER.so GUID ROUNDS FORCES N MEASURED N SIGNALS: first value reference of the
   plant's actuator forces; the controller's forces; then n pairs of references, output of the plant and input of the
   controller. */
#define _POSIX_C_SOURCE 200809L
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "fmi2Functions.h"

enum { LEGS = 6, MOST = 24, STEPS = 1000 };
static const double STEP = 1e-3;

typedef struct {
    fmi2Component component;
    fmi2GetRealTYPE *get;
    fmi2SetRealTYPE *set;
    fmi2DoStepTYPE *step;
    fmi2ResetTYPE *reset;
    fmi2SetupExperimentTYPE *setup;
    fmi2EnterInitializationModeTYPE *enter;
    fmi2ExitInitializationModeTYPE *exit;
} unit;

static void hear(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                 fmi2String message, ...)
{
    (void)environment, (void)status, (void)category;
    fprintf(stderr, "%s: %s\n", name, message);
}

static void check(fmi2Status status, const char *what)
{
    if (status != fmi2OK) {
        fprintf(stderr, "%s: status %d\n", what, (int)status);
        exit(1);
    }
}

static unit load(const char *path, const char *guid, const char *name)
{
    static const fmi2CallbackFunctions callbacks = {hear, calloc, free, NULL, NULL};
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        fprintf(stderr, "%s\n", dlerror());
        exit(1);
    }
    unit u;
    fmi2InstantiateTYPE *instantiate;
    *(void **)&instantiate = dlsym(library, "fmi2Instantiate");
    *(void **)&u.get = dlsym(library, "fmi2GetReal");
    *(void **)&u.set = dlsym(library, "fmi2SetReal");
    *(void **)&u.step = dlsym(library, "fmi2DoStep");
    *(void **)&u.reset = dlsym(library, "fmi2Reset");
    *(void **)&u.setup = dlsym(library, "fmi2SetupExperiment");
    *(void **)&u.enter = dlsym(library, "fmi2EnterInitializationMode");
    *(void **)&u.exit = dlsym(library, "fmi2ExitInitializationMode");
    u.component = instantiate(name, fmi2CoSimulation, guid, "", &callbacks, fmi2False, fmi2True);
    if (!u.component)
        exit(1);
    return u;
}

static void start(unit u)
{
    check(u.reset(u.component), "reset");
    check(u.setup(u.component, fmi2False, 0, 0, fmi2False, 0), "setup");
    check(u.enter(u.component), "enter");
    check(u.exit(u.component), "exit");
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int main(int n_arguments, char **arguments)
{
    if (n_arguments < 9)
        return 2;
    unit plant = load(arguments[1], arguments[2], "plant"), controller = load(arguments[3], arguments[4], "controller");
    int rounds = atoi(arguments[5]), n = (n_arguments - 8) / 2;
    fmi2ValueReference to_plant[LEGS], from_controller[LEGS], from_plant[MOST], to_controller[MOST];
    for (int k = 0; k < LEGS; k++) {
        to_plant[k] = (fmi2ValueReference)(atoi(arguments[6]) + k);
        from_controller[k] = (fmi2ValueReference)(atoi(arguments[7]) + k);
    }
    for (int k = 0; k < n && k < MOST; k++) {
        from_plant[k] = (fmi2ValueReference)atoi(arguments[8 + 2 * k]);
        to_controller[k] = (fmi2ValueReference)atoi(arguments[9 + 2 * k]);
    }
    static double force[STEPS][LEGS], measured[STEPS][MOST];
    double together = 1e9, alone = 1e9, by_itself = 1e9, checksum = 0;
    for (int round = 0; round < rounds; round++) {
        start(plant), start(controller);
        double begin = now();
        for (int k = 0; k < STEPS; k++) {
            check(plant.get(plant.component, from_plant, (size_t)n, measured[k]), "get");
            check(controller.set(controller.component, to_controller, (size_t)n, measured[k]), "set");
            check(controller.get(controller.component, from_controller, LEGS, force[k]), "get");
            check(plant.set(plant.component, to_plant, LEGS, force[k]), "set");
            check(controller.step(controller.component, k * STEP, STEP, fmi2True), "controller");
            check(plant.step(plant.component, k * STEP, STEP, fmi2True), "plant");
        }
        double seconds = (now() - begin) / STEPS;
        together = seconds < together ? seconds : together;

        start(plant);
        double unused[MOST];
        begin = now();
        for (int k = 0; k < STEPS; k++) {
            check(plant.get(plant.component, from_plant, (size_t)n, unused), "get");
            check(plant.set(plant.component, to_plant, LEGS, force[k]), "set");
            check(plant.step(plant.component, k * STEP, STEP, fmi2True), "plant");
        }
        seconds = (now() - begin) / STEPS;
        alone = seconds < alone ? seconds : alone;

        start(controller);
        begin = now();
        for (int k = 0; k < STEPS; k++) {
            check(controller.set(controller.component, to_controller, (size_t)n, measured[k]), "set");
            check(controller.get(controller.component, from_controller, LEGS, unused), "get");
            check(controller.step(controller.component, k * STEP, STEP, fmi2True), "controller");
        }
        seconds = (now() - begin) / STEPS;
        by_itself = seconds < by_itself ? seconds : by_itself;
        checksum += force[STEPS - 1][0];
    }
    printf("{\"together\": %.9e, \"plant\": %.9e, \"controller\": %.9e, \"force\": %.9g}\n", together, alone, by_itself,
           checksum / rounds);
    return 0;
}
