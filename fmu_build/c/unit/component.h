/* The interface between a unit and its component: a system with inputs, parameters, states and results that is stepped
   from outside; and what components share. It depends neither on FMI nor on the component: plant/ has the platform,
   controller/ a sampled controller.

   Values are accessed by slot (model.h). A call that does not return DONE changes nothing and leaves the reason
   in `component_message`. */
#ifndef COMPONENT_H
#define COMPONENT_H

#include <stdarg.h>
#include <stddef.h>

#include "internal.h"

typedef struct component component;

typedef enum {
    DONE,
    NOT_POSSIBLE, /* the component cannot take this value or step; another may work */
    MISUSE        /* an invalid call */
} outcome;

/* Called after every internal step of a communication step, at the component's time. It may read results and set
   inputs, and may end the communication step early by reducing `*end`, not to before `time`. */
typedef struct {
    void *context;
    void (*notice)(void *context, double time, double *end);
} step_observer;

INTERNAL_BEGIN
/* Size in bytes of the memory for `component_reset`, aligned for a double. */
extern const size_t COMPONENT_SIZE;
/* All start values, time 0. */
void component_reset(component *c);
const char *component_message(const component *c);

/* Whether the slot can have this value. */
outcome component_check(component *c, int slot, double value);
/* Sets a value that `component_check` has accepted. */
void component_put(component *c, int slot, double value);
outcome component_get(component *c, int slot, double *value);
/* du/dt of an input from the current time on; to be checked like a value of the slot. */
void component_put_input_rate(component *c, int slot, double rate);

outcome component_set_experiment(component *c, double tolerance, double start_time, double stop_time);
/* Consistency of all parameters, which are set one by one. */
outcome component_check_parameters(component *c);
/* End of initialization: checks parameters and start state. */
outcome component_begin(component *c);
/* Steps from `time`, which must be the current time, over `step` seconds. `reached` is the time at the end. */
outcome component_step(component *c, double time, double step, const step_observer *observer, double *reached);

/* For external integrators and for derivatives; never called of a component without continuous states, since there is no
   instance for Model Exchange, and modes.h does not allow derivatives; xdot has N_STATES elements: */
outcome component_set_time(component *c, double time);
outcome component_derivatives(component *c, double xdot[]);
/* Whether the current state is valid. */
outcome component_check_state(component *c);

/* Changes of the N_STATES of xdot and the N_RESULTS along (dx, du, dp). */
outcome component_forward(component *c, const double dx[], const double du[], const double dp[], double dxdot[],
                          double dy[]);
/* Gradient of wxdot.xdot + wy.results. */
outcome component_reverse(component *c, const double wxdot[], const double wy[], double gx[], double gu[],
                          double gp[]);
/* d(results)/dt with the inputs changing at their rates. */
outcome component_result_rates(component *c, double rates[]);

/* The complete state: the first N_SAVED numbers of a component, finite except for the stop time, which may be infinite. */
extern const size_t N_SAVED;
enum { NOW, START_TIME, STOP_TIME }; /* positions in it */
/* Whether a component can be in a state of such numbers; 1 for each that it has been in. */
int component_can_restore(const double saved[]);
/* To be called after the state has been replaced. */
void component_forget(component *c);

/* ---- what components share ------------------------------------------------------------------------------------ */

#define MESSAGE_SIZE 400
/* Like snprintf into MESSAGE_SIZE characters of UTF-8, but without '%', in case an importer uses it as a format. Messages
   have the value found, the value expected, and a remedy. Returns NOT_POSSIBLE. */
outcome write_message(char message[MESSAGE_SIZE], const char *format, ...);
void write_message_of(char message[MESSAGE_SIZE], const char *format, va_list arguments);
/* The message for a value that a slot cannot have. Returns NOT_POSSIBLE. */
outcome refuse_value(int slot, double value, const char *expected, char message[MESSAGE_SIZE]);
/* Sets the times of a component's state: a finite start time, and a stop time not before it. */
outcome start_experiment(double state[], double start_time, double stop_time, char message[MESSAGE_SIZE]);
/* A step from the current time `now`, forward, not beyond the stop time, within the rounding of importers' clocks. */
outcome check_step(double now, double stop_time, double time, double step, char message[MESSAGE_SIZE]);
int all_finite(const double values[], int n);
INTERNAL_END

#endif
