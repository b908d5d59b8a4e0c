#include "communication.h"

#include <float.h>
#include <math.h>

outcome check_experiment(double start_time, double stop_time, char message[MESSAGE_SIZE])
{
    if (!isfinite(start_time) || !(stop_time >= start_time)) {
        write_message(message,
                      "start time %g s, stop time %g s rejected; expected a finite start time and a stop time not "
                      "before it",
                      start_time, stop_time);
        return MISUSE;
    }
    return DONE;
}

outcome check_step(double now, double stop_time, double time, double step, char message[MESSAGE_SIZE])
{
    if (!isfinite(step) || !(step > 0)) {
        write_message(message, "communication step = %g s rejected; expected a step > 0", step);
        return MISUSE;
    }
    double resolution = DBL_EPSILON * fabs(now);
    /* the rounding error of an importer's clock, but never a significant part of the step */
    double rounding = fmax(fmin(1e-9 * fmax(1, fabs(now)), 1e-3 * step), 4 * resolution);
    if (!(fabs(time - now) <= rounding)) {
        write_message(message, "communication point %.17g s rejected; expected the current time %.17g s, since steps "
                               "must be consecutive", time, now);
        return MISUSE;
    }
    if (!(time + step > now)) {
        write_message(message, "communication step = %g s rejected; it is too small to advance time %g s", step, now);
        return MISUSE;
    }
    if (time + step > stop_time + rounding) {
        write_message(message, "communication step to %.12g s rejected; the stop time is %.12g s", time + step,
                      stop_time);
        return MISUSE;
    }
    return DONE;
}

int all_finite(const double values[], int n)
{
    for (int i = 0; i < n; i++)
        if (!isfinite(values[i]))
            return 0;
    return 1;
}
