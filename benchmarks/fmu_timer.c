/* Times the linked FMI 2.0 unit over the paper's 1 s, and its equations alone.

   Usage: fmu_timer ROUNDS. Prints JSON: the pose after one step of 1 s, and the best time of ROUNDS rounds for each row
   [s]. A round with steps simulates 1 s; its initialisation is not timed. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "fmi2Functions.h"
#include "kernel.h"
#include "model.h"
#include "plant_table.h"

enum { STEPS = 1000, CALLS = 20000 };

static const double START_VALUES[N_STATES] = {0, 0, 3, 0, 0, -0.1, 0, 0.2, 0, 0, 0.1, 0};
static const double FORCES[6] = {55, 49.5, 55, 49.5, 55, 49.5};

static fmi2ValueReference all[N_SLOTS];

static double seconds(void)
{
    struct timespec t;
    timespec_get(&t, TIME_UTC);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void expect(fmi2Status status, const char *what)
{
    if (status == fmi2OK)
        return;
    fprintf(stderr, "%s returned %d\n", what, (int)status);
    exit(1);
}

static void begin(fmi2Component c, double fixed_step_size)
{
    expect(fmi2Reset(c), "fmi2Reset");
    expect(fmi2SetReal(c, all + FIRST_RESULT, N_STATES, START_VALUES), "fmi2SetReal");
    expect(fmi2SetReal(c, all + FIRST_INPUT, 6, FORCES), "fmi2SetReal");
    expect(fmi2SetReal(c, all + FIXED_STEP_SIZE, 1, &fixed_step_size), "fmi2SetReal");
    expect(fmi2SetupExperiment(c, fmi2True, 1e-8, 0, fmi2False, 0), "fmi2SetupExperiment");
    expect(fmi2EnterInitializationMode(c), "fmi2EnterInitializationMode");
    expect(fmi2ExitInitializationMode(c), "fmi2ExitInitializationMode");
}

/* Steps as with a controller: sets new forces in every step, then reads pose and leg lengths; seconds per step. */
static double time_control(fmi2Component c, double fixed_step_size)
{
    double forces[6], pose[6], lengths[6], sum = 0;
    begin(c, fixed_step_size);
    double start = seconds();
    for (int k = 0; k < STEPS; k++) {
        for (int leg = 0; leg < 6; leg++)
            forces[leg] = FORCES[leg] + 1e-3 * ((k + leg) % 7);
        expect(fmi2SetReal(c, all + FIRST_INPUT, 6, forces), "fmi2SetReal");
        expect(fmi2DoStep(c, k * 1e-3, 1e-3, fmi2True), "fmi2DoStep");
        expect(fmi2GetReal(c, all + FIRST_RESULT, 6, pose), "fmi2GetReal");
        expect(fmi2GetReal(c, all + FIRST_RESULT + R_LEG_LENGTH, 6, lengths), "fmi2GetReal");
        sum += pose[2] + lengths[0];
    }
    double each = (seconds() - start) / STEPS;
    if (!isfinite(sum))
        exit(1);
    return each;
}

static double time_second(fmi2Component c)
{
    begin(c, 0);
    double start = seconds();
    expect(fmi2DoStep(c, 0, 1, fmi2True), "fmi2DoStep");
    return seconds() - start;
}

/* The state changes slightly from call to call, so that no call can be optimised away. */
static double time_derivatives(void)
{
    double x[N_STATES], u[N_INPUTS] = {0}, xdot[N_STATES];
    for (int k = 0; k < N_STATES; k++)
        x[k] = START_VALUES[k];
    for (int leg = 0; leg < 6; leg++)
        u[leg] = FORCES[leg];
    double start = seconds();
    for (int k = 0; k < CALLS; k++) {
        kernel_derivatives(x, u, START_PARAMETERS, xdot);
        x[5] += 1e-9 * xdot[5];
    }
    return (seconds() - start) / CALLS;
}

int main(int argc, char **argv)
{
    static const fmi2CallbackFunctions callbacks = {0};
    enum { ROWS = 4 };
    static const char *const names[ROWS] = {"control", "second", "fixed", "derivatives"};
    double best[ROWS] = {INFINITY, INFINITY, INFINITY, INFINITY}, pose[6];
    long rounds = argc > 1 ? atol(argv[1]) : 0;
    for (fmi2ValueReference slot = 0; slot < N_SLOTS; slot++)
        all[slot] = slot;
    fmi2Component c = fmi2Instantiate("plant", fmi2CoSimulation, "timer", NULL, &callbacks, fmi2False, fmi2False);
    if (rounds < 1 || !c) {
        fprintf(stderr, "usage: fmu_timer ROUNDS\n");
        return 2;
    }
    for (long round = 0; round < rounds; round++) {
        const double measured[ROWS] = {time_control(c, 0), time_second(c), time_control(c, 1e-3), time_derivatives()};
        for (int row = 0; row < ROWS; row++)
            best[row] = fmin(best[row], measured[row]);
    }
    time_second(c);
    expect(fmi2GetReal(c, all + FIRST_RESULT, 6, pose), "fmi2GetReal");
    printf("{");
    for (int row = 0; row < ROWS; row++)
        printf("\"%s\": %.9g, ", names[row], best[row]);
    printf("\"pose\": [");
    for (int k = 0; k < 6; k++)
        printf("%s%.17g", k ? ", " : "", pose[k]);
    printf("]}\n");
    fmi2FreeInstance(c);
    return 0;
}
