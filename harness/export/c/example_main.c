/* Example of @p@.h: five @SAMPLE_OR_STEP@s of a platform that rests in the first reference pose. On a machine, a timer
   calls @p@_step once per @PERIOD@ with the measurements. */
#include "@p@.h"

#include <stdio.h>

int main(void)
{
    @p@_parameters parameters = @P@_DEFAULTS;
    @p@_coefficients coefficients;
    @p@_memory memory;
    const @V@ measured[] = {@FIRST_MEASURED@};
@if inputs
    const @V@ reference[] = {@FIRST_REFERENCE@};
@end
    @p@_real force[6];
    unsigned char limited[6];
    int k, leg, wrong;

    wrong = @p@_prepare(&parameters, &coefficients);
    if (wrong != 0) {
        printf("parameter %d has an invalid value\n", wrong);
        return 1;
    }
    @p@_start(&parameters, &memory);
    for (k = 0; k < 5; ++k) {
        @p@_step(&parameters, &coefficients, &memory, measured, @REFERENCE@force, limited);
        printf("%g s:", k * (double)parameters.sample_time@PER_SAMPLE@);
        for (leg = 0; leg < 6; ++leg)
            printf(" %.6g N%s", (double)force[leg], limited[leg] ? " (limited)" : "");
        printf("\n");
    }
    return 0;
}
