/* A component as a unit sees it: what is stepped from outside, with inputs, parameters, states and results. Nothing of
   FMI, and nothing of what the component is: plant/ has the platform, controller/ a sampled controller.

   Values are reached by slot (model.h). A call that does not return DONE has changed nothing, and has left its reason
   in `component_message`. */
#ifndef COMPONENT_H
#define COMPONENT_H

#include <stddef.h>

#include "internal.h"

typedef struct component component;

typedef enum {
    DONE,
    NOT_POSSIBLE, /* a value or a step outside of what the component can do; another may work */
    MISUSE        /* a call that makes no sense */
} outcome;

/* Told of every internal step of a communication step. Time is the component's; results may be read and inputs be
   set. May ask to end the communication step early, at `*end` or as soon as it is passed. */
typedef struct {
    void *context;
    void (*notice)(void *context, double time, double *end);
} step_observer;

INTERNAL_BEGIN
/* Bytes to be given to `component_reset`, aligned for a double. */
extern const size_t COMPONENT_SIZE;
/* Start values everywhere, time 0. */
void component_reset(component *c);
const char *component_message(const component *c);

/* Is this a value that the slot can have? */
outcome component_check(component *c, int slot, double value);
/* Set what `component_check` has approved. */
void component_put(component *c, int slot, double value);
outcome component_get(component *c, int slot, double *value);
/* du/dt of an input from the present time on; approved like a value of the slot. */
void component_put_input_rate(component *c, int slot, double rate);

outcome component_set_experiment(component *c, double tolerance, double start_time, double stop_time);
/* Parameters are set one by one: whether they go together is asked afterwards. */
outcome component_check_parameters(component *c);
/* The end of initialisation: a component that can exist, in a state from which it can go on. */
outcome component_begin(component *c);
/* From `time`, which has to be the present time, over `step` seconds. `reached` is where it ended. */
outcome component_step(component *c, double time, double step, const step_observer *observer, double *reached);

double component_time(const component *c);

/* For an integrator outside, and sensitivities. A component without continuous states has none of them: stateless.c.
   Vectors of N_STATES: */
outcome component_set_time(component *c, double time);
void component_get_states(const component *c, double x[]);
outcome component_set_states(component *c, const double x[]);
outcome component_derivatives(component *c, double xdot[]);
/* May a motion pass the present state? */
outcome component_check_state(component *c);

/* Changes of the N_STATES of xdot and the N_RESULTS along (dx, du, dp). */
outcome component_forward(component *c, const double dx[], const double du[], const double dp[], double dxdot[],
                          double dy[]);
/* Gradient of wxdot.xdot + wy.results. */
outcome component_reverse(component *c, const double wxdot[], const double wy[], double gx[], double gu[],
                          double gp[]);
/* d(results)/dt with the inputs going on at their rates. */
outcome component_result_rates(component *c, double rates[]);

/* All that the future depends on, as numbers. */
extern const size_t N_SAVED;
void component_save(const component *c, double saved[]);
/* Can a component be in this state? 1 for what `component_save` has written. */
int component_can_restore(const double saved[]);
void component_restore(component *c, const double saved[]);
INTERNAL_END

#endif
