/* A master of a controller with a clock, FMI 3.0, in both kinds: it knows the description and the standard.

   Usage: clocked cs|se TICKS INPUTS RESULTS START INTERVAL. Inputs are values of all references below INPUTS, and outputs
   of the next RESULTS references, with the sizes of the table of variables. Input j of tick k is
   2 + ((7 j + 13 k) mod 31) / 32, exactly. Prints a line of hexadecimal numbers for each tick: all outputs. In
   Co-Simulation half of the ticks are made with other inputs first, saved before the end of the tick, and restored. Ends
   with 1 if a call fails. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "model.h"

enum { MOST = 200 };

static void logger(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message)
{
    (void)environment;
    fprintf(stderr, "status %d, %s: %s\n", (int)status, category, message);
}

#define EXPECT(condition)                                                                                              \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "failed: %s\n", #condition);                                                               \
            exit(1);                                                                                                   \
        }                                                                                                              \
    } while (0)

static const fmi3ValueReference CLOCK = CLOCK_REFERENCE;

static int set_inputs(fmi3Instance c, unsigned inputs, int tick)
{
    double values[MOST];
    fmi3ValueReference references[MOST];
    int n = 0;
    for (unsigned k = 0; k < inputs; k++) {
        references[k] = k;
        for (int j = 0; j < VARIABLES[k].size; j++, n++)
            values[n] = 2 + (7 * n + 13 * tick) % 31 / 32.0;
    }
    return fmi3SetFloat64(c, references, inputs, values, (size_t)n) == fmi3OK;
}

static void get_results(fmi3Instance c, unsigned inputs, unsigned results, double values[MOST], int *n)
{
    *n = 0;
    for (fmi3ValueReference k = inputs; k < inputs + results; k++) {
        EXPECT(fmi3GetFloat64(c, &k, 1, values + *n, (size_t)VARIABLES[k].size) == fmi3OK);
        *n += VARIABLES[k].size;
    }
}

static void update(fmi3Instance c)
{
    fmi3Boolean again = fmi3True, end, nominals, values, timed;
    double next;
    EXPECT(fmi3UpdateDiscreteStates(c, &again, &end, &nominals, &values, &timed, &next) == fmi3OK);
    EXPECT(!again && !end && !nominals && !values && !timed);
}

/* A tick that is begun with other inputs, saved, restored, and made. */
static void tick(fmi3Instance c, unsigned inputs, unsigned results, int k, double found[MOST], int *n)
{
    fmi3Clock active = fmi3ClockActive, inactive = fmi3ClockInactive, state = fmi3ClockActive;
    fmi3FMUState saved = NULL;
    EXPECT(fmi3GetClock(c, &CLOCK, 1, &state) == fmi3OK && state == fmi3ClockInactive);
    EXPECT(fmi3SetClock(c, &CLOCK, 1, &active) == fmi3OK);
    EXPECT(fmi3GetClock(c, &CLOCK, 1, &state) == fmi3OK && state == fmi3ClockActive);
    if (k % 2) {
        EXPECT(set_inputs(c, inputs, k + 5));
        EXPECT(fmi3GetFMUState(c, &saved) == fmi3OK);
        get_results(c, inputs, results, found, n);
        update(c);
        EXPECT(fmi3SetFMUState(c, saved) == fmi3OK && fmi3FreeFMUState(c, &saved) == fmi3OK);
        EXPECT(fmi3GetClock(c, &CLOCK, 1, &state) == fmi3OK && state == fmi3ClockActive);
    }
    EXPECT(set_inputs(c, inputs, k));
    get_results(c, inputs, results, found, n);
    EXPECT(fmi3SetClock(c, &CLOCK, 1, &inactive) == fmi3Error); /* canBeDeactivated is false */
    EXPECT(fmi3EnterStepMode(c) == fmi3Error);                  /* the tick is not ended */
    update(c);
}

int main(int argc, char **argv)
{
    if (argc != 7)
        return 2;
    int in_steps = strcmp(argv[1], "cs") == 0, ticks = atoi(argv[2]), n = 0;
    unsigned inputs = (unsigned)atoi(argv[3]), results = (unsigned)atoi(argv[4]);
    double start = atof(argv[5]), interval = atof(argv[6]), found[MOST];
    fmi3Boolean event, end, early;
    double reached;

    EXPECT(!fmi3InstantiateModelExchange("c", "host", NULL, fmi3False, fmi3False, NULL, NULL));
    EXPECT(!fmi3InstantiateCoSimulation("c", "host", NULL, fmi3False, fmi3False, fmi3False, fmi3False, NULL, 0, NULL, NULL,
                                        NULL)); /* without event mode */
    fmi3Instance c = in_steps
                         ? fmi3InstantiateCoSimulation("c", "host", NULL, fmi3False, fmi3False, fmi3True, fmi3False, NULL,
                                                       0, NULL, logger, NULL)
                         : fmi3InstantiateScheduledExecution("c", "host", NULL, fmi3False, fmi3False, NULL, logger, NULL,
                                                             NULL, NULL);
    EXPECT(c);
    EXPECT(fmi3EnterInitializationMode(c, fmi3False, 0, start, fmi3False, 0) == fmi3OK);
    double told = 0, shift = 1;
    fmi3IntervalQualifier qualifier;
    EXPECT(fmi3GetIntervalDecimal(c, &CLOCK, 1, &told, &qualifier) == fmi3OK && told == interval);
    EXPECT(fmi3GetShiftDecimal(c, &CLOCK, 1, &shift) == fmi3OK && shift == 0);
    EXPECT(fmi3SetIntervalDecimal(c, &CLOCK, 1, &interval) == fmi3OK);
    EXPECT(fmi3ExitInitializationMode(c) == fmi3OK);
    for (int k = 0; k < ticks; k++) {
        double time = start + k * interval, next = start + (k + 1) * interval;
        if (in_steps) {
            tick(c, inputs, results, k, found, &n);
            EXPECT(fmi3EnterStepMode(c) == fmi3OK);
            EXPECT(!set_inputs(c, inputs, 0)); /* they belong to the clock */
            EXPECT(fmi3DoStep(c, time, 2 * interval, fmi3True, &event, &end, &early, &reached) == fmi3Error);
            EXPECT(fmi3DoStep(c, time, next - time, fmi3True, &event, &end, &early, &reached) == fmi3OK);
            EXPECT(reached == time + (next - time) && !end && !early);
            EXPECT(fmi3EnterEventMode(c) == fmi3OK);
        } else {
            EXPECT(set_inputs(c, inputs, k));
            EXPECT(fmi3ActivateModelPartition(c, CLOCK, next) == fmi3Error); /* at another time */
            EXPECT(fmi3ActivateModelPartition(c, CLOCK, time) == fmi3OK);
            EXPECT(fmi3ActivateModelPartition(c, CLOCK, time) == fmi3Error); /* not twice */
            get_results(c, inputs, results, found, &n);
        }
        for (int j = 0; j < n; j++)
            printf("%a%s", found[j], j < n - 1 ? " " : "\n");
    }
    EXPECT(fmi3Terminate(c) == fmi3OK);
    fmi3FreeInstance(c);
    return 0;
}
