/* Calls of a platform that rests in the first reference pose. On a machine, a timer calls controller_step once per
   sample_time, or per step of the drives, with the measurements; the header has the details. */
#include "controller.h"

#include <stdio.h>
#include <string.h>

#include "design.c"

int main(void)
{
    controller_parameters parameters = CONTROLLER_DEFAULTS;
    controller_coefficients coefficients;
    controller_memory memory;
    const controller_real measured[] = MEASURED;
#if HAS_REFERENCE_INPUTS
    const controller_real reference[] = REFERENCE;
#endif
    controller_real force[6];
    unsigned char limited[6];
    int k, leg, wrong;

    memset(&coefficients, 0, sizeof coefficients);
    wrong = controller_prepare(&parameters, &coefficients);
    if (wrong != 0) {
        printf("parameter %d has an invalid value\n", wrong);
        return 1;
    }
    controller_start(&parameters, &memory);
    for (k = 0; k < 5; ++k) {
#if HAS_REFERENCE_INPUTS
        controller_step(&parameters, &coefficients, &memory, measured, reference, force, limited);
#else
        controller_step(&parameters, &coefficients, &memory, measured, force, limited);
#endif
        printf("%g s:", k * (double)parameters.sample_time / STEPS_A_SAMPLE);
        for (leg = 0; leg < 6; ++leg)
            printf(" %.6g N%s", (double)force[leg], limited[leg] ? " (limited)" : "");
        printf("\n");
    }
    return 0;
}
