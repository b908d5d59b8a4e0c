/* The clock of a unit: one, periodic, an input; value reference CLOCK_REFERENCE. See instance.h. */
#include <math.h>

#include "instance.h"

/* 1 if these calls are allowed, and all references are that of the clock; a unit without clocks has nothing else. */
static int are_clocks(const fmi_instance *i, const char *function, fmi_call call, const uint32_t clocks[], size_t n,
                      const void *values)
{
    if (!HAS_CLOCK)
        return no_such_type(i, function, n) == STATUS_OK;
    if (!is_allowed(i, function, call) || !has_array(i, function, clocks, n, "value references") ||
        !has_array(i, function, values, n, "values"))
        return 0;
    for (size_t k = 0; k < n; k++)
        if (clocks[k] != CLOCK_REFERENCE) {
            report(i, STATUS_ERROR, "%s: no clock has value reference %lu; expected %d", function,
                   (unsigned long)clocks[k], CLOCK_REFERENCE);
            return 0;
        }
    return 1;
}

fmi_status set_clocks(fmi_instance *i, const char *function, const uint32_t clocks[], size_t n,
                      const _Bool active[])
{
    if (!are_clocks(i, function, CALL_CLOCK, clocks, n, active))
        return STATUS_ERROR;
    for (size_t k = 0; k < n; k++)
        if (!active[k] && component_is_ticking(i->core))
            return report(i, STATUS_ERROR,
                          "%s: the clock is active and cannot be deactivated (canBeDeactivated is false); expected "
                          "fmi3UpdateDiscreteStates, which ends its tick", function);
    for (size_t k = 0; k < n; k++)
        if (active[k] && !component_is_ticking(i->core)) {
            outcome begun = component_begin_tick(i->core);
            if (begun != DONE)
                return conclude(i, function, CALL_CLOCK, begun);
        }
    return STATUS_OK;
}

fmi_status get_clocks(const fmi_instance *i, const char *function, const uint32_t clocks[], size_t n,
                      _Bool active[])
{
    if (!are_clocks(i, function, CALL_CLOCK, clocks, n, active))
        return STATUS_ERROR;
    for (size_t k = 0; k < n; k++)
        active[k] = component_is_ticking(i->core) != 0;
    return STATUS_OK;
}

fmi_status get_intervals(const fmi_instance *i, const char *function, const uint32_t clocks[], size_t n,
                         double intervals[])
{
    if (!are_clocks(i, function, CALL_GET_INTERVAL, clocks, n, intervals))
        return STATUS_ERROR;
    for (size_t k = 0; k < n; k++)
        intervals[k] = component_interval(i->core);
    return STATUS_OK;
}

fmi_status set_intervals(fmi_instance *i, const char *function, const uint32_t clocks[], size_t n,
                         const double intervals[])
{
    if (!are_clocks(i, function, CALL_SET_INTERVAL, clocks, n, intervals))
        return STATUS_ERROR;
    for (size_t k = 0; k < n; k++)
        if (!(intervals[k] > 0 && intervals[k] < HUGE_VAL))
            return report(i, STATUS_ERROR, "%s: interval = %g s rejected; expected a number > 0", function,
                          intervals[k]);
    for (size_t k = 0; k < n; k++)
        component_set_interval(i->core, intervals[k]);
    return STATUS_OK;
}

fmi_status get_shifts(const fmi_instance *i, const char *function, const uint32_t clocks[], size_t n, double shifts[])
{
    if (!are_clocks(i, function, CALL_GET_INTERVAL, clocks, n, shifts))
        return STATUS_ERROR;
    for (size_t k = 0; k < n; k++)
        shifts[k] = 0;
    return STATUS_OK;
}

fmi_status update_discrete(fmi_instance *i, const char *function)
{
    if (!is_allowed(i, function, CALL_UPDATE_DISCRETE))
        return STATUS_ERROR;
    return component_is_ticking(i->core) ? conclude(i, function, CALL_UPDATE_DISCRETE, component_end_tick(i->core))
                                         : STATUS_OK;
}

fmi_status enter_step(fmi_instance *i, const char *function)
{
    if (!is_allowed(i, function, CALL_ENTER_STEP))
        return STATUS_ERROR;
    if (component_is_ticking(i->core))
        return report(i, STATUS_ERROR, "%s: the clock is active; expected fmi3UpdateDiscreteStates before, which ends "
                                       "its tick", function);
    i->mode = STEP;
    return STATUS_OK;
}

fmi_status activate(fmi_instance *i, const char *function, uint32_t clock, double time)
{
    if (!is_allowed(i, function, CALL_ACTIVATE) || !are_clocks(i, function, CALL_ACTIVATE, &clock, 1, &time))
        return STATUS_ERROR;
    return conclude(i, function, CALL_ACTIVATE, component_tick(i->core, time));
}
