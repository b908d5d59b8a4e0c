/* The default experiment of an FMI 2.0 unit as checkers run it: a thousand communication steps, or steps of explicit
   Euler, every result read at each, under the unit's own start values or under no forces at all.

   Usage: checker cs|me start|none. Prints the time that was reached, whether the unit asked for the end, the number of
   messages of an error or worse, and the height. Ends with 1 if a call fails, which a checker counts as a fatal one. */
#include <stdio.h>
#include <string.h>

#include "fmi2Functions.h"

enum { STEPS = 1000, FORCES = 0, POSE = 12, N_STATES = 12, N_RESULTS = 60 }; /* references of the description */

static int errors;

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...)
{
    (void)environment;
    errors += status >= fmi2Error;
    fprintf(stderr, "%s, status %d, %s: %s\n", name, (int)status, category, message);
}

#define EXPECT_OK(call)                                                                                                \
    do {                                                                                                               \
        if ((call) != fmi2OK) {                                                                                        \
            fprintf(stderr, "failed: %s\n", #call);                                                                    \
            return 1;                                                                                                  \
        }                                                                                                              \
    } while (0)

static int read_all(fmi2Component c, double *height)
{
    fmi2ValueReference references[N_RESULTS];
    double values[N_RESULTS];
    for (fmi2ValueReference k = 0; k < N_RESULTS; k++)
        references[k] = POSE + k;
    EXPECT_OK(fmi2GetReal(c, references, N_RESULTS, values));
    *height = values[2];
    return 0;
}

static int events(fmi2Component c)
{
    fmi2EventInfo info = {.newDiscreteStatesNeeded = fmi2True};
    while (info.newDiscreteStatesNeeded)
        EXPECT_OK(fmi2NewDiscreteStates(c, &info));
    EXPECT_OK(fmi2EnterContinuousTimeMode(c));
    return 0;
}

int main(int argc, char **argv)
{
    static const fmi2CallbackFunctions callbacks = {.logger = logger};
    static const double none[6] = {0};
    const double step = 1.0 / STEPS;
    double time = 0, height = 0, x[N_STATES], rates[N_STATES];
    fmi2Boolean enter_event = fmi2False, terminate = fmi2False;
    fmi2ValueReference forces[6];
    if (argc != 3)
        return 2;
    int steps_itself = strcmp(argv[1], "cs") == 0;
    for (fmi2ValueReference k = 0; k < 6; k++)
        forces[k] = FORCES + k;

    fmi2Component c = fmi2Instantiate("checked", steps_itself ? fmi2CoSimulation : fmi2ModelExchange, "host", NULL,
                                      &callbacks, fmi2False, fmi2True);
    if (!c)
        return 1;
    EXPECT_OK(fmi2SetupExperiment(c, fmi2False, 0, 0, fmi2True, 1));
    EXPECT_OK(fmi2EnterInitializationMode(c));
    EXPECT_OK(fmi2ExitInitializationMode(c));
    if (strcmp(argv[2], "none") == 0)
        EXPECT_OK(fmi2SetReal(c, forces, 6, none));
    if (!steps_itself && events(c))
        return 1;
    for (int k = 0; k < STEPS && !terminate; k++) {
        if (read_all(c, &height))
            return 1;
        if (steps_itself) {
            EXPECT_OK(fmi2DoStep(c, time, step, fmi2True));
            time = (k + 1) * step;
            continue;
        }
        EXPECT_OK(fmi2GetContinuousStates(c, x, N_STATES));
        EXPECT_OK(fmi2GetDerivatives(c, rates, N_STATES));
        time = (k + 1) * step;
        EXPECT_OK(fmi2SetTime(c, time));
        for (int i = 0; i < N_STATES; i++)
            x[i] += step * rates[i];
        EXPECT_OK(fmi2SetContinuousStates(c, x, N_STATES));
        EXPECT_OK(fmi2CompletedIntegratorStep(c, fmi2True, &enter_event, &terminate));
    }
    if (!terminate && read_all(c, &height))
        return 1;
    EXPECT_OK(fmi2Terminate(c));
    fmi2FreeInstance(c);
    printf("%.9g %d %d %.17g\n", time, (int)terminate, errors, height);
    return 0;
}
