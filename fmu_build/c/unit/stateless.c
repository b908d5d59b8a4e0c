/* Stubs for a component without continuous states. They are never called: there is no instance for Model Exchange, and
   modes.h does not allow derivatives. */
#include "component.h"

#define NOTHING(name, ...)                                                                                             \
    outcome name(component *c, __VA_ARGS__)                                                                            \
    {                                                                                                                  \
        (void)c;                                                                                                       \
        return MISUSE;                                                                                                 \
    }
#pragma GCC diagnostic ignored "-Wunused-parameter"

NOTHING(component_set_time, double time)
NOTHING(component_set_states, const double x[])
NOTHING(component_derivatives, double xdot[])
NOTHING(component_forward, const double dx[], const double du[], const double dp[], double dxdot[], double dy[])
NOTHING(component_reverse, const double wxdot[], const double wy[], double gx[], double gu[], double gp[])
NOTHING(component_result_rates, double rates[])

outcome component_check_state(component *c)
{
    (void)c;
    return MISUSE;
}

void component_get_states(const component *c, double x[]) { (void)c, (void)x; }
