/* The platform as a component that is stepped from outside: state, inputs, parameters, results. Nothing of FMI.

   Values are reached by slot (model.h). A call that does not return DONE has changed nothing, and has left its
   reason in `message`. */
#ifndef COMPONENT_H
#define COMPONENT_H

#include "internal.h"
#include "message.h"
#include "model.h"
#include "pose_limits.h"

/* All that the future depends on. Doubles only: a saved state is these, in this order. */
typedef struct {
    double time;
    double stop_time; /* infinite if there is none */
    double tolerance;
    double internal_step; /* to go on with; 0 before the first */
    double handedness;    /* side of the singular poses on which the motion began; 0 before it has */
    double fixed_step_size;
    double inputs[N_INPUTS];
    double input_rates[N_INPUTS]; /* du/dt from the present time on */
    double x[N_STATES];
    double p[N_PARAMETERS];
} component_state;

typedef struct {
    component_state s;
    /* results at the present time, computed when asked for */
    int has_xdot, has_results, has_legs;
    double xdot[N_STATES];
    double results[N_RESULTS];
    leg_state legs;
    int inertia_is_unchecked;
    char message[MESSAGE_SIZE];
} component;

typedef enum {
    DONE,
    NOT_POSSIBLE, /* a value or a step outside of what the platform can do; another may work */
    MISUSE        /* a call that makes no sense */
} outcome;

/* Told of every internal step of a communication step. Time is the component's; results may be read and inputs be
   set. May ask to end the communication step early, at `*end` or as soon as it is passed. */
typedef struct {
    void *context;
    void (*notice)(void *context, double time, double *end);
} observer;

INTERNAL_BEGIN
/* Start values everywhere, time 0. */
void component_reset(component *c);

/* `name[row,column]` of a slot, 1-based. */
void slot_name(int slot, char *name, int size);
/* The variable a slot belongs to. Here, since every set and get asks for it. */
static inline const variable *variable_of(int slot)
{
    return &VARIABLES[VARIABLE_OF_SLOT[slot]];
}

/* Is this a value that the slot can have? */
outcome component_check(component *c, int slot, double value);
/* Set what `component_check` has approved. */
void component_put(component *c, int slot, double value);
outcome component_get(component *c, int slot, double *value);

outcome component_set_experiment(component *c, double tolerance, double start_time, double stop_time);
/* Elements of the inertia are set one by one: whether they make a body is asked afterwards. */
outcome component_check_inertia(component *c);
/* The end of initialisation: a platform that can exist, in a pose from which it can move. */
outcome component_begin(component *c);
/* From `time`, which has to be the present time, over `step` seconds. `reached` is where it ended. */
outcome component_step(component *c, double time, double step, const observer *observer, double *reached);

/* For an integrator outside: */
outcome component_set_time(component *c, double time);
outcome component_set_states(component *c, const double x[N_STATES]);
outcome component_derivatives(component *c, double xdot[N_STATES]);
outcome component_check_pose(component *c);

/* Changes of xdot and results along (dx, du, dp). */
outcome component_forward(component *c, const double dx[], const double du[], const double dp[], double dxdot[],
                          double dy[]);
/* Gradient of wxdot.xdot + wy.results. */
outcome component_reverse(component *c, const double wxdot[], const double wy[], double gx[], double gu[],
                          double gp[]);
/* d(results)/dt with the inputs going on at their rates. */
outcome component_result_rates(component *c, double rates[N_RESULTS]);

/* After `s` has been replaced from outside. */
void component_forget_results(component *c);
INTERNAL_END

#endif
