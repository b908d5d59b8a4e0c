/* Integration of dx/dt = f(t, x) over a time span: Dormand-Prince 5(4) with error control, or classical RK4. A plant
   with bristles takes exponential steps instead (exponential.c). */
#ifndef INTEGRATOR_H
#define INTEGRATOR_H

#include "internal.h"
#include "model.h"
#include "plant_table.h"

#if HAS_BRISTLES
/* What friction does within a step; see kernel_grip. */
typedef struct {
    double decay[N_LEGS];
    double gain[N_LEGS * N_LEGS];
    double ratio[N_LEGS];
    double reach[N_LEGS];
    double sliding[N_LEGS];
} grip;
#endif

/* The differential equation and the callback for accepted steps. */
typedef struct {
    void *owner;
    void (*derivatives)(void *owner, double t, const double x[N_STATES], double xdot[N_STATES]);
    /* Called at the end of every internal step with the derivatives there. Returns 0 to stop. It may reduce `end`, and
       sets `changed` if f has changed. */
    int (*accept)(void *owner, double t, const double x[N_STATES], const double xdot[N_STATES], double *end,
                  int *changed);
#if HAS_BRISTLES
    /* rates d of the bristles at x: dz/dt = v - d z */
    void (*decays)(void *owner, const double x[N_STATES], double decay[N_LEGS]);
    void (*find_grip)(void *owner, const double x[N_STATES], grip *found);
    void (*sliding)(void *owner, const double x[N_STATES], double sliding[N_LEGS]);
#endif
} ode;

typedef enum {
    REACHED_END,
    GIVEN_UP,        /* by `accept` */
    STEP_TOO_SMALL,  /* the tolerance cannot be met */
    TOO_MANY_STEPS,
    NOT_FINITE,      /* in fixed steps */
    TOO_FAST         /* a fixed step needs more than MOST_SUBSTEPS, which reach `step` of it */
} integration;

/* The current point of an integration. */
typedef struct {
    double t;
    double x[N_STATES];
    double xdot[N_STATES]; /* f(t, x) */
    double step;           /* size of the next internal step; 0 to find one. Carry it over to the next span. */
} integration_point;

INTERNAL_BEGIN
/* Number of equal steps of at most `size`, within the rounding of times of this magnitude. */
double number_of_steps(double start, double end, double size);
/* Error per step below `tolerance`, relative and absolute in SI units. */
integration integrate_controlled(const ode *problem, integration_point *at, double end, double tolerance);
/* Moves the point to (t, x) with the derivatives there, and asks the owner; 0 if it gives up. */
int arrive(const ode *problem, integration_point *at, double t, const double x[N_STATES],
           const double xdot[N_STATES], double *end);
/* One step of size h from the point to t, which is left where it is: the state there and its derivatives. REACHED_END,
   NOT_FINITE or TOO_FAST. RK4, or with bristles the steps of exponential.c. */
integration fixed_step(const ode *problem, integration_point *at, double t, double h, double x[N_STATES],
                       double xdot[N_STATES]);
/* Equal steps, the largest not above `size`. */
integration integrate_fixed(const ode *problem, integration_point *at, double end, double size);
INTERNAL_END

#endif
