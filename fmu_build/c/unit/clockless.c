/* Stubs for a component without a clock. They are never called, since modes.h does not allow it. */
#include "component.h"

double component_interval(const component *c)
{
    (void)c;
    return 0;
}

void component_set_interval(component *c, double interval)
{
    (void)c, (void)interval;
}

outcome component_begin_tick(component *c)
{
    (void)c;
    return MISUSE;
}

int component_is_ticking(const component *c)
{
    (void)c;
    return 0;
}

outcome component_end_tick(component *c)
{
    (void)c;
    return MISUSE;
}

outcome component_tick(component *c, double time)
{
    (void)c, (void)time;
    return MISUSE;
}
