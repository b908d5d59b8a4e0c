/* The platform as a component: shared declarations. */
#ifndef PLANT_H
#define PLANT_H

#include "component.h"
#include "internal.h"
#include "message.h"
#include "model.h"
#include "pose_limits.h"

/* The complete state. It has doubles only, since a saved state is a copy of them in this order. */
typedef struct {
    double time;
    double start_time;
    double stop_time; /* infinite if there is none */
    double tolerance;
    double internal_step; /* size of the next one; 0 before the first */
    double handedness;    /* sign of det J at the start of the motion; 0 before the start */
    double fixed_step_size;
    double inputs[N_INPUTS];
    double input_rates[N_INPUTS]; /* du/dt from the current time on */
    double x[N_STATES];
    double p[N_PARAMETERS];
} plant_state;

struct component {
    plant_state s;
    /* derived from the state, computed on demand */
    int has_xdot, has_results, has_legs;
    double xdot[N_STATES];
    double results[N_RESULTS];
    leg_state legs;
    int inertia_is_unchecked;
    double largest_step; /* see stable_step.h; 0 if it is not known */
    char message[MESSAGE_SIZE];
};

INTERNAL_BEGIN
/* To be called after `s` has been replaced. */
void forget_results(component *c);
INTERNAL_END

#endif
