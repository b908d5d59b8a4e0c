/* Within a communication step of the plant: shared declarations. */
#ifndef STEP_H
#define STEP_H

#define WIDTH 1
#include "plant.h"
#include "steps.h"

/* The current communication step. Internal steps move the component's time, states and derivatives. */
typedef struct {
    component *c;
    const step_observer *observer;
    int interpolates;
    double since; /* time at which the inputs had the values of `from` */
    double from[N_INPUTS];
    double size; /* of the next internal step; of the last one if it was too small, or the largest that is possible */
} communication_step;

/* A step from t over h, for the rates in its stages. */
typedef struct {
    const communication_step *step;
    double t, h;
} span;

typedef enum {
    REACHED_END,
    GIVEN_UP,        /* the component's message says why */
    STEP_TOO_SMALL,  /* the tolerance cannot be met */
    TOO_MANY_STEPS,
    NOT_FINITE,      /* in fixed steps */
    TOO_FAST         /* a fixed step needs more than MOST_SUBSTEPS, which reach `size` of it */
} integration;

INTERNAL_BEGIN
/* f(t, x) */
void find_rates(const communication_step *step, double t, const double x[N_STATES], double rate[N_STATES]);
/* Implements `find_stage`. */
void find_stage_rates(const void *of_span, double share, const double x[N_STATES], double rate[N_STATES]);
#if HAS_BRISTLES
/* A fixed step to t, of legs that stick: the state there and its derivatives. REACHED_END or TOO_FAST. */
integration sticking_step(communication_step *step, double t, double x[N_STATES], double rate[N_STATES]);
#endif
INTERNAL_END

#endif
