/* Two units of one state, stepped alike, one of them read from all the time: reading has to change nothing. */
#include <string.h>

#include "fuzz.h"

typedef struct {
    void *unit;
    int reads;
    double phase;
} twin;

/* The first input as a function of time, so that both twins set the same. */
static void update(fmi3InstanceEnvironment environment, fmi3Float64 time, fmi3Boolean sets_requested,
                   fmi3Boolean gets_allowed, fmi3Boolean step_finished, fmi3Boolean can_return_early,
                   fmi3Boolean *early_return_requested, fmi3Float64 *early_return_time)
{
    (void)sets_requested, (void)gets_allowed, (void)step_finished, (void)can_return_early;
    (void)early_return_requested, (void)early_return_time;
    twin *t = environment;
    double input[18], value[18];
    for (int k = 0; k < VARIABLES[0].size; k++)
        input[k] = 50 + 20 * sin(300 * time + t->phase * k);
    uint32_t first = 0;
    fmi3SetFloat64(t->unit, &first, 1, input, (size_t)VARIABLES[0].size);
    if (t->reads) {
        uint32_t row = (uint32_t)below(N_VARIABLES);
        fmi3GetFloat64(t->unit, &row, 1, value, (size_t)VARIABLES[row].size);
    }
}

static int restored(twin *t, void *state)
{
    t->unit = fmi3InstantiateCoSimulation("twin", RIGHT_TOKEN, NULL, fmi3False, fmi3False, fmi3False, fmi3False, NULL,
                                          0, t, NULL, update);
    return t->unit && fmi3SetFMUState(t->unit, state) == fmi3OK;
}

/* The whole state, as bytes. */
static size_t bytes_of(twin *t, unsigned char bytes[], size_t room)
{
    void *state = NULL;
    size_t size = 0;
    if (fmi3GetFMUState(t->unit, &state) != fmi3OK || fmi3SerializedFMUStateSize(t->unit, state, &size) != fmi3OK ||
        size > room || fmi3SerializeFMUState(t->unit, state, bytes, size) != fmi3OK)
        size = 0;
    fmi3FreeFMUState(t->unit, &state);
    return size;
}

void reading_changes_nothing(host *h)
{
    void *state = NULL;
    if (h->kind != CO_SIMULATION || h->mode != STEP ||
        CALL_EITHER(h, fmi2GetFMUstate, fmi3GetFMUState, h->unit, &state) != OK)
        return;
    double phase = fraction();
    twin silent = {.phase = phase}, read = {.reads = 1, .phase = phase};
    if (restored(&silent, state) && restored(&read, state)) {
        unsigned char one[MOST_BYTES] = {0}, other[MOST_BYTES] = {0};
        fmi3Boolean flags[3];
        double reached, time = h->time;
        for (int k = 0; k < 3; k++) {
            int a = (int)fmi3DoStep(silent.unit, time, 0.02, fmi3True, &flags[0], &flags[1], &flags[2], &reached);
            int b = (int)fmi3DoStep(read.unit, time, 0.02, fmi3True, &flags[0], &flags[1], &flags[2], &reached);
            require(a == b, "reading in the intermediate update does not change what a step returns");
            if (a != OK || b != OK)
                break;
            time = reached;
        }
        size_t size = bytes_of(&silent, one, sizeof one);
        require(size > 0 && size == bytes_of(&read, other, sizeof other) && memcmp(one, other, size) == 0,
                "reading in the intermediate update does not change the motion");
    }
    fmi3FreeInstance(silent.unit);
    fmi3FreeInstance(read.unit);
    CALL_EITHER(h, fmi2FreeFMUstate, fmi3FreeFMUState, h->unit, &state);
}
