/* The platform as a component: what the files of this room share. */
#ifndef PLANT_H
#define PLANT_H

#include "component.h"
#include "internal.h"
#include "message.h"
#include "model.h"
#include "pose_limits.h"

/* All that the future depends on. Doubles only: a saved state is these, in this order. */
typedef struct {
    double time;
    double start_time;
    double stop_time; /* infinite if there is none */
    double tolerance;
    double internal_step; /* to go on with; 0 before the first */
    double handedness;    /* side of the singular poses on which the motion began; 0 before it has */
    double fixed_step_size;
    double inputs[N_INPUTS];
    double input_rates[N_INPUTS]; /* du/dt from the present time on */
    double x[N_STATES];
    double p[N_PARAMETERS];
} plant_state;

struct component {
    plant_state s;
    /* what follows from the state, computed when asked for */
    int has_xdot, has_results, has_legs;
    double xdot[N_STATES];
    double results[N_RESULTS];
    leg_state legs;
    int inertia_is_unchecked;
    char message[MESSAGE_SIZE];
};

INTERNAL_BEGIN
/* After `s` has been replaced from outside. */
void forget_results(component *c);
INTERNAL_END

#endif
