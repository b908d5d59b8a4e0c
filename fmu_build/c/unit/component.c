/* What components share: messages, names and ranges of slots, checks of experiments and communication steps. */
#include "component.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "model.h"

#define TEXT(x) #x
#define TEXT_OF(macro) TEXT(macro)

void write_message_of(char message[MESSAGE_SIZE], const char *format, va_list arguments)
{
    vsnprintf(message, MESSAGE_SIZE, format, arguments);
    size_t n = strlen(message);
    for (size_t k = 0; k < n; k++) {
        unsigned char lead = (unsigned char)message[k];
        size_t following = lead >= 0xF0 ? 3 : lead >= 0xE0 ? 2 : lead >= 0xC0; /* bytes of a character */
        if (k + following >= n) /* the last one is incomplete */
            message[n = k] = 0;
        else if (lead == '%' || lead == '#') /* FMI interprets #...# as a reference to a variable */
            message[k] = '_';
    }
}

outcome write_message(char message[MESSAGE_SIZE], const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    write_message_of(message, format, arguments);
    va_end(arguments);
    return NOT_POSSIBLE;
}

const variable *variable_of(int slot) { return &VARIABLES[VARIABLE_OF_SLOT[slot]]; }

const char *write_slot_name(int slot, char name[NAME_SIZE])
{
    const variable *v = variable_of(slot);
    int k = slot - v->first;
    if (v->columns)
        snprintf(name, NAME_SIZE, "%s[%d,%d]", v->name, k / v->columns + 1, k % v->columns + 1);
    else if (v->role == DERIVATIVE) /* der(state[k]) */
        snprintf(name, NAME_SIZE, "%.*s[%d])", (int)strlen(v->name) - 1, v->name, k + 1);
    else if (v->size > 1)
        snprintf(name, NAME_SIZE, "%s[%d]", v->name, k + 1);
    else
        snprintf(name, NAME_SIZE, "%s", v->name);
    return name;
}

const char *expected_of_slot(int slot, double value)
{
    variable_range range = variable_of(slot)->range;
    if (!isfinite(value))
        return "a finite number";
    if (fabs(value) > LARGEST_NUMBER)
        return "a number below " TEXT_OF(LARGEST_NUMBER) " in SI units";
    if (range == POSITIVE && !(value > 0))
        return "a value > 0";
    if (range == NOT_NEGATIVE && !(value >= 0))
        return "a value >= 0";
    return NULL;
}

outcome refuse_value(int slot, double value, const char *expected, char message[MESSAGE_SIZE])
{
    const char *unit = variable_of(slot)->unit;
    return write_message(message, "%s = %g%s%s rejected; expected %s", NAME_OF_SLOT(slot), value, *unit ? " " : "", unit,
                         expected);
}

outcome start_experiment(double state[], double start_time, double stop_time, char message[MESSAGE_SIZE])
{
    if (!isfinite(start_time) || !(stop_time >= start_time))
        return write_message(message, "start time %g s, stop time %g s rejected; expected a finite start time and a stop "
                                      "time not before it", start_time, stop_time), MISUSE;
    state[NOW] = state[START_TIME] = start_time;
    state[STOP_TIME] = stop_time;
    return DONE;
}

outcome check_step(double now, double stop_time, double time, double step, char message[MESSAGE_SIZE])
{
    /* the rounding error of an importer's clock, but never a significant part of the step */
    double rounding = fmax(fmin(1e-9 * fmax(1, fabs(now)), 1e-3 * step), 4 * DBL_EPSILON * fabs(now));
    if (!isfinite(step) || !(step > 0))
        write_message(message, "communication step = %g s rejected; expected a step > 0", step);
    else if (!(fabs(time - now) <= rounding))
        write_message(message, "communication point %.17g s rejected; expected the current time %.17g s, since steps "
                               "must be consecutive", time, now);
    else if (!(time + step > now))
        write_message(message, "communication step = %g s rejected; it is too small to advance time %g s", step, now);
    else if (time + step > stop_time + rounding)
        write_message(message, "communication step to %.12g s rejected; the stop time is %.12g s", time + step,
                      stop_time);
    else
        return DONE;
    return MISUSE;
}

int all_finite(const double values[], int n)
{
    for (int i = 0; i < n; i++)
        if (!isfinite(values[i]))
            return 0;
    return 1;
}
