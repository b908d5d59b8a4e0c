/* Stubs for a component without continuous states. They are never called: there is no instance for Model Exchange, and
   modes.h does not allow derivatives. */
#include "component.h"

outcome component_set_time(component *c, double time)
{
    (void)c, (void)time;
    return MISUSE;
}

void component_get_states(const component *c, double x[])
{
    (void)c, (void)x;
}

outcome component_set_states(component *c, const double x[])
{
    (void)c, (void)x;
    return MISUSE;
}

outcome component_derivatives(component *c, double xdot[])
{
    (void)c, (void)xdot;
    return MISUSE;
}

outcome component_check_state(component *c)
{
    (void)c;
    return MISUSE;
}

outcome component_forward(component *c, const double dx[], const double du[], const double dp[], double dxdot[],
                          double dy[])
{
    (void)c, (void)dx, (void)du, (void)dp, (void)dxdot, (void)dy;
    return MISUSE;
}

outcome component_reverse(component *c, const double wxdot[], const double wy[], double gx[], double gu[],
                          double gp[])
{
    (void)c, (void)wxdot, (void)wy, (void)gx, (void)gu, (void)gp;
    return MISUSE;
}

outcome component_result_rates(component *c, double rates[])
{
    (void)c, (void)rates;
    return MISUSE;
}
