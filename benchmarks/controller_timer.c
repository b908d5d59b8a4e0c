/* Times a step of the exported controller and the derivatives of the plant, alternately.
 * Usage: controller_timer CALLS < numbers; reads x (12), u (12), p (N_PARAMETERS), measured (N_MEASURED), prints ns
 * per step and per call of the derivatives, the smallest of 400 rounds. Measurements change slightly from step to step. */
#include "controller.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

void kernel_derivatives(const double x[], const double u[], const double p[], double xdot[]);

static double seconds(void) {
    struct timespec t;
    timespec_get(&t, TIME_UTC);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int read(double *values, int n) {
    for (int i = 0; i < n; i++) if (scanf("%lf", values + i) != 1) return 0;
    return 1;
}

int main(int argc, char **argv) {
    double x[12], u[12], p[N_PARAMETERS], lengths[CONTROLLER_N_MEASURED], xdot[12], best[2] = {1e300, 1e300};
    controller_real measured[CONTROLLER_N_MEASURED];
    controller_parameters parameters = CONTROLLER_DEFAULTS;
    controller_coefficients coefficients;
    controller_memory memory;
    controller_real force[6];
    unsigned char limited[6];
    long calls = argc > 1 ? atol(argv[1]) : 0;
    if (calls <= 0 || !read(x, 12) || !read(u, 12) || !read(p, N_PARAMETERS)) return 2;
    if (!read(lengths, CONTROLLER_N_MEASURED) || controller_prepare(&parameters, &coefficients)) return 2;
    for (int k = 0; k < CONTROLLER_N_MEASURED; k++)
        measured[k] = (controller_real)(lengths[k] - (CONTROLLER_SINGLE ? (double)CONTROLLER_HOME[k] : 0));
    for (int round = 0; round < 400; round++) {
        controller_start(&parameters, &memory);
        double start = seconds();
        for (long k = 0; k < calls; k++) {
            controller_step(&parameters, &coefficients, &memory, measured, force, limited);
            measured[0] += (controller_real)1e-15 * force[0];
        }
        double middle = seconds();
        for (long k = 0; k < calls; k++) {
            kernel_derivatives(x, u, p, xdot);
            x[5] += 1e-9 * xdot[5];
        }
        double each[2] = {(middle - start) / (double)calls, (seconds() - middle) / (double)calls};
        for (int i = 0; i < 2; i++) if (each[i] < best[i]) best[i] = each[i];
    }
    printf("%.6f %.6f\n", 1e9 * best[0], 1e9 * best[1]);
    return 0;
}
