/* Drives the linked FMI 2.0 unit of a platform with legs with stiction and compliance, or of an ideal one, to time its steps. */
#include <math.h>
#include <stdlib.h>
#include <time.h>

#include "fmi2Functions.h"
#include "model.h"
#include "plant_table.h"

#define EXPORTED __attribute__((visibility("default")))

static const double SAMPLE = 1e-3, PI = 3.14159265358979323846;

/* Of the processor, so that others on it do not count. */
static double seconds(void)
{
    return (double)clock() / CLOCKS_PER_SEC;
}

/* Seconds per step of 1 ms over `steps`, and the pose after them. In each step the host reads leg lengths and rates, and
   sets the start values of the forces plus stiffness [N/m] and damping [N.s/m] times the distances from a motion of the
   legs: from rest, 1 - cos(2 pi f t), with a peak at `speed` [m/s]. NAN if a call fails. */
EXPORTED double time_steps(double fixed_step_size, double tolerance, int steps, double frequency, double speed,
                           double stiffness, double damping, double pose[6])
{
    static const fmi2CallbackFunctions callbacks = {0};
    static fmi2ValueReference all[N_SLOTS];
    double held[N_LEGS], start[N_LEGS], legs[2 * N_LEGS], forces[N_LEGS];
    for (fmi2ValueReference slot = 0; slot < N_SLOTS; slot++)
        all[slot] = slot;
    const fmi2ValueReference *of_forces = all + FIRST_INPUT, *of_legs = all + FIRST_RESULT + R_LEG_LENGTH;
    fmi2Component c = fmi2Instantiate("plant", fmi2CoSimulation, "timer", NULL, &callbacks, fmi2False, fmi2False);
    if (!c)
        return NAN;
    fmi2Status worst = fmi2SetReal(c, all + FIXED_STEP_SIZE, 1, &fixed_step_size);
    worst |= fmi2SetupExperiment(c, fmi2True, tolerance, 0, fmi2False, 0);
    worst |= fmi2EnterInitializationMode(c);
    worst |= fmi2ExitInitializationMode(c);
    worst |= fmi2GetReal(c, of_forces, N_LEGS, held);
    worst |= fmi2GetReal(c, of_legs, N_LEGS, start);
    double rate = 2 * PI * frequency, begin = seconds();
    for (int k = 0; k < steps && worst == fmi2OK; k++) {
        double moved = speed / rate * (1 - cos(rate * k * SAMPLE)), moving = speed * sin(rate * k * SAMPLE);
        worst |= fmi2GetReal(c, of_legs, 2 * N_LEGS, legs);
        for (int i = 0; i < N_LEGS; i++)
            forces[i] = held[i] + stiffness * (start[i] + moved - legs[i]) + damping * (moving - legs[N_LEGS + i]);
        worst |= fmi2SetReal(c, of_forces, N_LEGS, forces);
        worst |= fmi2DoStep(c, k * SAMPLE, SAMPLE, fmi2True);
    }
    double each = (seconds() - begin) / steps;
    worst |= fmi2GetReal(c, all + FIRST_STATE, 6, pose);
    fmi2FreeInstance(c);
    return worst == fmi2OK ? each : NAN;
}
