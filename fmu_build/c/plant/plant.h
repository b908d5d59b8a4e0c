/* The platform as a component: shared declarations. */
#ifndef PLANT_H
#define PLANT_H

#include "component.h"
#include "internal.h"
#include "model.h"
#include "plant_table.h"

/* The complete state. It has doubles only, since a saved state is a copy of them in this order. */
typedef struct {
    double time;
    double start_time;
    double stop_time; /* infinite if there is none */
    double tolerance;
    double internal_step; /* size of the next one; 0 before the first */
    double handedness;    /* sign of det J at the start of the motion; 0 before the start */
    double fixed_step_size;
    double largest_step; /* of fixed steps under these parameters, see `stable_step`; 0 before the first */
    double inputs[N_INPUTS];
    double input_rates[N_INPUTS]; /* du/dt from the current time on */
    double x[N_STATES];
    double p[N_PARAMETERS];
} plant_state;

/* The legs at one state. */
typedef struct {
    double length[N_LEGS];
    double length_rate[N_LEGS];
    double jacobian[N_LEGS][N_LEGS]; /* angles scaled to lengths by rho */
    double rho;
} leg_state;

/* Why a step was not possible, as data; the component's message has the same in words. */
typedef struct {
    double time;
    double value; /* of the quantity that is beyond its limit */
    char quantity[NAME_SIZE];
    char reason[MESSAGE_SIZE];
} step_failure;

/* It has plain data only, so that its memory may be of any host (stepper/stepper.c). */
struct component {
    plant_state s;
    step_failure failure;
    /* derived from the state, computed on demand */
    int has_xdot, has_results, has_legs;
    double xdot[N_STATES];
    double results[N_RESULTS];
    leg_state legs;
    int inertia_is_unchecked;
    char message[MESSAGE_SIZE];
};

INTERNAL_BEGIN
/* The failure of a step at the component's time, `at time T s: QUANTITY = VALUE UNIT: REASON`. Returns NOT_POSSIBLE. */
outcome refuse_step(component *c, const char *quantity, double value, const char *unit, const char *reason, ...);
/* Whether the current pose is within the limits: a pitch of 90 degrees, a leg of no length, a singular leg Jacobian.
   `handedness` is the sign of det J of the motion so far; if it is 0, it is set from this pose. */
outcome check_pose(component *c, double *handedness);

/* Validity of the parameters, as in gough_stewart.model.platform_checks; NOT_POSSIBLE with the reason. */
outcome check_parameters(const double p[N_PARAMETERS], char message[MESSAGE_SIZE]);
/* No two legs share both joints. */
outcome check_joints(const double p[N_PARAMETERS], char message[MESSAGE_SIZE]);
/* At the start, centres of mass are on the legs, and motors near the leg lengths. */
outcome check_start(const double p[N_PARAMETERS], const double x[N_STATES], const double leg_length[N_LEGS],
                    char message[MESSAGE_SIZE]);
INTERNAL_END

#endif
